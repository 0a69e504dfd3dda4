"""The object cut out of its picture: by alpha channel, mask, network or border colour, in this order.

Paper: Sec. 3.1 starts from an object on an empty background. Whatever finds the object, the cut-out is cleaned the same
way: translucent shadows and crumbs are not matter.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import StageError
from phys4dgen.reconstruct.border_color import cut_by_border_color
from phys4dgen.reconstruct.mask_geometry import depth_inside, pieces
from phys4dgen.reconstruct.matte_onnx import DOWNLOAD_COMMAND, find_matte_model, matte_alpha
from phys4dgen.reconstruct.picture import Picture, read_mask, read_picture

__all__ = ["Cutout", "cut_out"]

_SOLID = 0.9
"""Opacity from which on a pixel is certainly the object."""
_CRUMB = 0.01
"""Pieces smaller than this share of the largest one are left out."""


@dataclass(frozen=True, eq=False)
class Cutout:
    """An object on nothing.

    Attributes:
        rgba: straight sRGB and opacity in [0, 1], shape [H, W, 4], float32.
        source: what found the object: alpha channel, mask, network or border colour.
        warnings: what may be wrong with it, one sentence each.
    """

    rgba: NDArray[np.float32]
    source: str
    warnings: tuple[str, ...]


def cut_out(path: Path | str, *, mask: Path | None = None, matte_model: Path | None = None) -> Cutout:
    """Cut the object out of a picture.

    A mask or a model that is named is used; otherwise a real alpha channel, then a model found in rembg's folders,
    then the colour of the border.

    Args:
        path: the picture.
        mask: picture of the same section, white where the object is.
        matte_model: ONNX file of U2-Net or IS-Net.

    Raises:
        FormatError: a file cannot be read.
        StageError: the object cannot be found; says what would help.
    """
    picture = read_picture(path)
    alpha, source, warnings = _alpha(picture, Path(path), mask, matte_model)
    cleaned = _without_shadows(alpha)
    inside = cleaned > 0.5
    if inside.mean() < 1e-3 or inside.sum() < 256:
        raise StageError(
            f"{path}: the object found by {source} is {100 * inside.mean():.2f} % of the picture; "
            "expected more than that, so give a mask with --mask or crop the picture."
        )
    if inside.mean() > 0.98:
        raise StageError(
            f"{path}: the whole picture counts as the object by {source}; leave some background around it, or give a "
            "mask with --mask."
        )
    touched = [name for name, line in _edges(inside).items() if line.mean() > 0.02]
    if touched:
        warnings.append(
            f"The object is cut off at the {' and '.join(touched)} of the picture; the cut becomes a flat end."
        )
    rgba = np.concatenate([picture.rgb, cleaned[..., None]], -1)
    return Cutout(rgba.astype(np.float32), source, tuple(warnings))


def _alpha(
    picture: Picture, path: Path, mask: Path | None, matte_model: Path | None
) -> tuple[NDArray[np.float32], str, list[str]]:
    """Opacity of the object, what found it, and warnings."""
    if mask is not None:
        return read_mask(mask, size=picture.size), "mask", []
    if matte_model is not None:
        return matte_alpha(picture.rgb, matte_model), f"network {matte_model.name}", []
    if picture.alpha is not None and (picture.alpha < 0.5).mean() > 0.005:
        return picture.alpha, "alpha channel", []
    found = find_matte_model() if importlib.util.find_spec("onnxruntime") is not None else None
    if found is not None:
        return matte_alpha(picture.rgb, found), f"network {found.name}", []
    cut = cut_by_border_color(picture.rgb)
    if cut.problem:
        raise StageError(
            f"{path}: cannot find the object, {cut.problem}; give a mask with --mask FILE, or a matting network with "
            f"--matte-model FILE (pip install 'phys4dgen[matte]'; {DOWNLOAD_COMMAND})."
        )
    warning = "The object was found by the colour of the border (stand-in for a matting network); check the cut-out."
    return cut.alpha, "border colour (stand-in)", [warning]


def _without_shadows(alpha: NDArray[np.float32]) -> NDArray[np.float32]:
    """Keep solid pieces and the soft pixels next to them: a cast shadow is translucent over a wide area."""
    solid = alpha > _SOLID
    if not solid.any():
        return np.zeros_like(alpha)
    labels, sizes = pieces(solid)
    if len(sizes) > 1:
        solid = np.isin(labels, 1 + np.flatnonzero(sizes >= _CRUMB * sizes.max()))
    reach = max(1.5, 0.006 * float(np.sqrt(solid.sum())))
    keep = np.clip(reach + 1 - depth_inside(~solid), 0, 1)
    return (alpha * keep).astype(np.float32)


def _edges(mask: NDArray[np.bool_]) -> dict[str, NDArray[np.bool_]]:
    return {"top": mask[0], "bottom": mask[-1], "left": mask[:, 0], "right": mask[:, -1]}
