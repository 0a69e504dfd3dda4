"""What this machine has of what phys4dgen can use: ``phys4dgen doctor``."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from phys4dgen.materials.mllm.endpoint import KEY_VARIABLES
from phys4dgen.reconstruct.matte_onnx import DOWNLOAD_COMMAND, find_matte_model
from phys4dgen.render.gsplat_backend import cuda_driver_is_installed
from phys4dgen.scene.sections.models import Clip, Sam2
from phys4dgen.weights import cached_file

__all__ = ["Finding", "examine"]

_FREE_GB = 5.0
"""A run of 100,000 Gaussians and 48 frames takes 1.4 GB."""

_OPTIONAL: Mapping[str, tuple[str, str]] = {
    "onnxruntime": ("matte", "runs learned mattes (objects cut out of photographs)"),
    "torch": ("models", "runs learned models (LGM, SAM2, CLIP)"),
    "transformers": ("models", "runs learned models (SAM2, CLIP)"),
    "safetensors": ("models", "reads their weights"),
    "openai": ("mllm", "speaks to a multimodal language model that names materials"),
    "gsplat": ("gsplat", "renders on a CUDA device"),
    "trimesh": ("mesh", "reads meshes (.glb, .obj, .ply, .stl)"),
}
"""By package its extra and what it is for; stand-ins do without on their own, and the report names them."""

_LGM = "ashawkey/LGM", "model_fp16_fixrot.safetensors"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        name: what it is.
        state: ready; missing (every run needs it); optional (absent, a stand-in works).
        detail: what was found, in a few words.
        fix: the one command or step that gets it; empty where nothing is to be done.
    """

    name: str
    state: Literal["ready", "missing", "optional"]
    detail: str
    fix: str = ""


def examine(folder: Path | None = None) -> list[Finding]:
    """Look at this machine; values of keys are never read out.

    Args:
        folder: where runs will lie, for the free disk; None for the current folder.
    """
    return [
        _python(),
        _processor(),
        _threads(),
        _kernels(),
        _ffmpeg(),
        _disk(Path.cwd() if folder is None else folder),
        _cuda(),
        *(_package(name) for name in _OPTIONAL),
        _weights("SAM2", "finds parts", repository=Sam2().weights),
        _weights("CLIP", "names parts and materials", repository=Clip().weights),
        _weights("LGM", "makes Gaussians of four views", repository=_LGM[0], file=_LGM[1]),
        _matte(),
        *(_key(name) for name in KEY_VARIABLES),
    ]


def _python() -> Finding:
    version = importlib.metadata.version("phys4dgen")
    return Finding("phys4dgen", "ready", f"{version} on Python {sys.version.split()[0]}, {sys.platform}")


def _processor() -> Finding:
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features()
    lanes = [name for name in ("avx512f", "avx2", "fma", "neon") if features.get(name)]
    name = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    if os.environ.get("NUMBA_CPU_NAME") == "generic":
        return Finding("processor", "ready", "generic code is asked for, which is slow", "unset NUMBA_CPU_NAME")
    return Finding("processor", "ready", f"{name}: {', '.join(lanes) or 'no wide vectors, which is slow'}")


def _threads() -> Finding:
    import numba

    used, cores = numba.get_num_threads(), os.cpu_count() or 1
    detail = f"{used} of {cores} cores are used"
    return Finding("threads", "ready", detail, "unset NUMBA_NUM_THREADS" if used < cores else "")


def _kernels() -> Finding:
    from phys4dgen.run.kernels import compiled_kernels, kernel_cache_is_writable

    count = compiled_kernels()
    if count:
        return Finding("compiled kernels", "ready", f"{count} are cached")
    if not kernel_cache_is_writable():
        step = "export NUMBA_CACHE_DIR=~/.cache/phys4dgen"
        return Finding("compiled kernels", "missing", "their cache cannot be written: every start takes a minute", step)
    return Finding("compiled kernels", "ready", "none yet: the first run takes half a minute longer")


def _ffmpeg() -> Finding:
    from phys4dgen.export.video import ffmpeg_executable

    found = ffmpeg_executable()
    if found is None:
        return Finding("ffmpeg", "optional", "absent: films become animated WebP", "pip install imageio-ffmpeg")
    return Finding("ffmpeg", "ready", Path(found).name)


def _disk(folder: Path) -> Finding:
    free_gb = shutil.disk_usage(folder).free / 1e9
    if free_gb < _FREE_GB:
        return Finding(
            "disk", "missing", f"{free_gb:.1f} GB free here, a run may take more", "make room, or --output.frames none"
        )
    return Finding("disk", "ready", f"{free_gb:,.0f} GB free here")


def _cuda() -> Finding:
    if cuda_driver_is_installed():
        return Finding("CUDA", "ready", "NVIDIA's driver is installed")
    return Finding("CUDA", "optional", "no NVIDIA driver: everything runs on the CPU")


def _package(name: str) -> Finding:
    extra, purpose = _OPTIONAL[name]
    if importlib.util.find_spec(name) is None:
        return Finding(name, "optional", f"absent; {purpose}", f"pip install 'phys4dgen[{extra}]'")
    return Finding(name, "ready", f"{importlib.metadata.version(name)}; {purpose}")


def _weights(model: str, purpose: str, *, repository: str, file: str = "model.safetensors") -> Finding:
    """Weights in the local cache of the Hugging Face hub."""
    name = f"{model} weights"
    if importlib.util.find_spec("huggingface_hub") is None:
        detail = f"the cache of the Hugging Face hub cannot be read; {purpose}"
        return Finding(name, "optional", detail, "pip install 'phys4dgen[models]'")
    found = cached_file(repository, file)
    if found is None:
        wanted = repository if file == "model.safetensors" else f"{repository} {file}"
        return Finding(name, "optional", f"not here; {purpose}", f"hf download {wanted}")
    return Finding(name, "ready", f"{found}; {purpose}")


def _matte() -> Finding:
    name, purpose = "matte weights", "cuts objects out of photographs"
    found = find_matte_model()
    if found is None:
        return Finding(name, "optional", f"no IS-Net or U2-Net of rembg; {purpose}", DOWNLOAD_COMMAND)
    return Finding(name, "ready", f"{found}; {purpose}")


def _key(variable: str) -> Finding:
    owner = KEY_VARIABLES[variable]
    if os.environ.get(variable, "").strip():
        return Finding(variable, "ready", f"is set; the key of {owner}")
    return Finding(variable, "optional", f"is not set; the key of {owner}", f"export {variable}=...")
