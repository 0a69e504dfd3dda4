"""Where the weights of a learned model lie on this machine. Nothing is ever downloaded here."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

from phys4dgen.errors import StageError

__all__ = ["cached_file", "chosen_device", "load_model", "read_config", "weights_folder"]

_MAX_CONFIG_BYTES = 1 << 20
_PACKAGES = ("torch", "transformers")
_CONFIG, _TENSORS = "config.json", ("model.safetensors", "model.safetensors.index.json")


def weights_folder(name: str, *, model: str) -> Path:
    """The local folder with a model's configuration and weights.

    Args:
        name: a folder, or an id of the Hugging Face hub such as ``facebook/sam2.1-hiera-tiny``, whose snapshot is
            looked for in the hub's cache.
        model: what the model is called in errors (SAM2, CLIP).

    Raises:
        StageError: the packages or the weights are missing; names the command that gets them.
    """
    absent = [package for package in _PACKAGES if importlib.util.find_spec(package) is None]
    if absent:
        raise StageError(
            f"{model} needs {' and '.join(absent)}, which {'is' if len(absent) == 1 else 'are'} not installed: "
            "pip install 'phys4dgen[models]'."
        )
    folder = Path(name).expanduser()
    if not folder.is_dir():
        folder = _snapshot(name, model=model)
    for wanted in ((_CONFIG,), _TENSORS):
        if not any((folder / file).is_file() for file in wanted):
            raise StageError(
                f"{model}: expected {wanted[0]} in {folder}, got none; weights are read from safetensors files only, "
                "as save_pretrained writes them."
            )
    return folder


def read_config(folder: Path, *, model: str, model_type: str) -> dict[str, Any]:
    """The configuration of a checkpoint.

    Args:
        folder: from ``weights_folder``.
        model: what the model is called in errors.
        model_type: what the configuration must say that it is.

    Raises:
        StageError: it cannot be read, or is of another model.
    """
    path = folder / _CONFIG
    try:
        if path.stat().st_size > _MAX_CONFIG_BYTES:
            raise StageError(f"{model}: expected at most {_MAX_CONFIG_BYTES:,} bytes in {path}, got more.")
        config = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise StageError(f"{model}: {path} cannot be read as the configuration of a checkpoint: {error}.") from error
    found = config.get("model_type") if isinstance(config, dict) else None
    if found != model_type:
        raise StageError(f"{model}: expected a checkpoint of model_type {model_type} in {folder}, got {found}.")
    return config


def load_model(kind: Any, folder: Path, *, model: str, model_type: str, device: str) -> Any:
    """A model of Transformers with its weights, all of them: absent ones would silently be random.

    Args:
        kind: class of Transformers.
        folder: from ``weights_folder``.
        model: what the model is called in errors.
        model_type: of its configuration.
        device: of PyTorch.

    Raises:
        StageError: the folder holds another model, or lacks weights.
    """
    import torch  # pyright: ignore[reportMissingImports]
    from safetensors import SafetensorError  # pyright: ignore[reportMissingImports]
    from transformers.utils import logging  # pyright: ignore[reportMissingImports]

    read_config(folder, model=model, model_type=model_type)
    logging.disable_progress_bar()
    try:
        loaded, report = kind.from_pretrained(
            str(folder), local_files_only=True, use_safetensors=True, dtype=torch.float32, output_loading_info=True
        )
    except (OSError, ValueError, KeyError, RuntimeError, SafetensorError) as error:
        reason = " ".join(str(error).split())[:200]
        raise StageError(f"{model}: the checkpoint in {folder} cannot be read: {reason}.") from error
    absent = sorted(report["missing_keys"])
    if absent:
        raise StageError(
            f"{model}: the checkpoint in {folder} lacks {len(absent)} weights, the first of them {absent[0]}; get it "
            "anew."
        )
    return loaded.to(torch.device(device)).eval()


def chosen_device(wanted: str) -> str:
    """The device that a learned model runs on: ``auto`` is cuda where PyTorch sees one, else cpu.

    Raises:
        StageError: cuda is asked for and absent.
    """
    import torch  # pyright: ignore[reportMissingImports]

    found = torch.cuda.is_available()
    if wanted == "cuda" and not found:
        raise StageError("device: PyTorch sees no CUDA device here; use 'auto' or 'cpu'.")
    return "cuda" if found and wanted != "cpu" else "cpu"


def cached_file(name: str, file: str) -> Path | None:
    """A file of a hub id in the local cache; None where it is not there. Needs huggingface_hub."""
    from huggingface_hub import try_to_load_from_cache  # pyright: ignore[reportMissingImports]

    try:
        found = try_to_load_from_cache(name, file)
    except ValueError:  # no id of the hub, such as a path with several slashes
        return None
    return Path(found) if isinstance(found, str) else None


def _snapshot(name: str, *, model: str) -> Path:
    """The folder of a hub id in the local cache."""
    config = cached_file(name, _CONFIG)
    if config is None:
        raise StageError(
            f"{model}: the weights '{name}' are not on this machine and are never fetched unasked; "
            f"'hf download {name}' gets them, or name a folder that holds them."
        )
    return config.parent
