"""Foreground by a saliency network in an ONNX file: U2-Net and IS-Net, run by onnxruntime (extra ``matte``).

U2-Net (Qin et al., "U2-Net: Going Deeper with Nested U-Structure for Salient Object Detection", Pattern Recognition
2020) takes 320 x 320 pixels with ImageNet statistics; IS-Net (Qin et al., "Highly Accurate Dichotomous Image
Segmentation", ECCV 2022) takes 1024 x 1024 pixels centred at 0. Both give one map; model files and folders are those
of rembg, so that what a machine already has is found.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from phys4dgen.errors import StageError

__all__ = ["DOWNLOAD_COMMAND", "find_matte_model", "matte_alpha"]

_KNOWN = ("isnet-general-use", "u2net", "silueta", "u2netp")
"""Names of rembg's models, best first."""
_IMAGENET_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_IMAGENET_STD = np.array([0.229, 0.224, 0.225], np.float32)
_U2NET_SIDE_PX = 320
_MAX_SIDE_PX = 2048

DOWNLOAD_COMMAND = (
    "curl -L --create-dirs -o ~/.u2net/isnet-general-use.onnx "
    "https://github.com/danielgatis/rembg/releases/download/v0.0.0/isnet-general-use.onnx"
)
"""The one command that puts a model where it is found."""


def find_matte_model() -> Path | None:
    """The best model file in rembg's folders, or None.

    Looked through: ``$U2NET_HOME``, ``$REMBG_HOME/models`` and their defaults ``~/.u2net`` and ``~/.rembg/models``.
    """
    homes = [Path(os.environ[name]).expanduser() for name in ("U2NET_HOME", "REMBG_HOME") if os.environ.get(name)]
    homes += [Path.home() / ".u2net", Path.home() / ".rembg"]
    for name in _KNOWN:
        for home in homes:
            for path in (home / f"{name}.onnx", home / "models" / name / f"{name}.onnx"):
                if path.is_file():
                    return path
    return None


def matte_alpha(rgb: NDArray[np.float32], model: Path) -> NDArray[np.float32]:
    """Opacity of the salient object.

    Args:
        rgb: sRGB in [0, 1], shape [H, W, 3].
        model: an ONNX file of U2-Net or IS-Net.

    Returns:
        Opacity in [0, 1], shape [H, W].

    Raises:
        StageError: onnxruntime or the file is missing, or the file holds another kind of network.
    """
    session = _session(model)
    inputs = session.get_inputs()
    shape = list(inputs[0].shape)
    if len(inputs) != 1 or len(shape) != 4 or shape[1] != 3:
        raise StageError(
            f"{model}: expected a network from one picture [1, 3, H, W] to one map (U2-Net or IS-Net), got inputs "
            f"{[entry.shape for entry in inputs]}."
        )
    side = shape[2] if isinstance(shape[2], int) else (1024 if "isnet" in model.name else _U2NET_SIDE_PX)
    if not 32 <= side <= _MAX_SIDE_PX:
        raise StageError(f"{model}: expected an input of 32 to {_MAX_SIDE_PX} pixels, got {side}.")
    eight_bit = Image.fromarray(np.rint(rgb * 255).astype(np.uint8))
    pixels = np.asarray(eight_bit.resize((side, side), Image.Resampling.LANCZOS), np.float32) / 255
    if side <= _U2NET_SIDE_PX:
        pixels = (pixels / max(float(pixels.max()), 1e-6) - _IMAGENET_MEAN) / _IMAGENET_STD
    else:
        pixels = pixels - 0.5
    batch = np.ascontiguousarray(pixels.transpose(2, 0, 1)[None], np.float32)
    output = np.asarray(session.run([session.get_outputs()[0].name], {inputs[0].name: batch})[0], np.float32)
    saliency = np.squeeze(output)
    if saliency.ndim != 2 or not np.isfinite(saliency).all():
        raise StageError(f"{model}: expected one finite map, got shape {output.shape}; the file may be damaged.")
    low, high = float(saliency.min()), float(saliency.max())
    if high - low < 1e-6:
        raise StageError(f"{model}: the network found no object in the picture; give a mask with --mask.")
    height, width = rgb.shape[:2]
    unit = Image.fromarray((saliency - low) / (high - low)).resize((width, height), Image.Resampling.BICUBIC)
    return np.clip(np.asarray(unit, np.float32), 0, 1)


def _session(model: Path) -> Any:
    """An inference session on the CPU."""
    if not model.is_file():
        raise StageError(f"{model}: there is no such matting model; get one with: {DOWNLOAD_COMMAND}")
    try:
        import onnxruntime  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise StageError(
            "Matting by a network needs onnxruntime; install it with: pip install 'phys4dgen[matte]'"
        ) from error
    try:
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 3
        return onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise StageError(f"{model}: onnxruntime cannot load the file: {str(error).splitlines()[0]}") from error
