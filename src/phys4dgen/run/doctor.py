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

__all__ = ["Finding", "examine"]

_FREE_GB = 5.0
"""A run of 100,000 Gaussians and 48 frames takes 1.4 GB."""

_OPTIONAL: Mapping[str, str] = {
    "onnxruntime": "runs learned mattes (objects cut out of photographs)",
    "torch": "runs learned models (LGM, SAM2, CLIP)",
    "transformers": "runs learned models (SAM2, CLIP)",
    "openai": "speaks to a multimodal language model that names materials",
    "gsplat": "renders on a CUDA device",
    "trimesh": "reads meshes (.glb, .obj, .ply, .stl)",
}
"""What stand-ins do on their own where a package is absent; the report names them."""

_KEYS = ("OPENAI_API_KEY", "OPENAI_BASE_URL", "HF_TOKEN")
_WEIGHTS = {"HF_HOME": "~/.cache/huggingface", "TORCH_HOME": "~/.cache/torch"}


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
        *(_package(name) for name in _OPTIONAL),
        *(_weights(name) for name in _WEIGHTS),
        *(_key(name) for name in _KEYS),
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


def _package(name: str) -> Finding:
    purpose = _OPTIONAL[name]
    if importlib.util.find_spec(name) is None:
        return Finding(name, "optional", f"absent; {purpose}", f"pip install {name}")
    return Finding(name, "ready", f"{importlib.metadata.version(name)}; {purpose}")


def _weights(variable: str) -> Finding:
    folder = Path(os.environ.get(variable) or _WEIGHTS[variable]).expanduser()
    there = folder.is_dir() and any(folder.iterdir())
    detail = f"{folder} {'holds files' if there else 'holds no weights'}"
    return Finding(f"weights ({variable})", "ready" if there else "optional", detail)


def _key(variable: str) -> Finding:
    if os.environ.get(variable):
        return Finding(variable, "ready", "is set")
    return Finding(variable, "optional", "is not set", f"export {variable}=...")
