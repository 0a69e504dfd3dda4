"""Where the weights of a learned model lie on this machine. Nothing is ever downloaded here."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from phys4dgen.errors import StageError

__all__ = ["chosen_device", "weights_folder"]

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


def _snapshot(name: str, *, model: str) -> Path:
    """The folder of a hub id in the local cache."""
    from huggingface_hub import try_to_load_from_cache  # pyright: ignore[reportMissingImports]

    try:
        config = try_to_load_from_cache(name, _CONFIG)
    except ValueError:  # no id of the hub, such as a path with several slashes
        config = None
    if not isinstance(config, str):
        raise StageError(
            f"{model}: the weights '{name}' are not on this machine and are never fetched unasked; "
            f"'hf download {name}' gets them, or name a folder that holds them."
        )
    return Path(config).parent
