"""The four pictures that LGM looks at: from files, or from a network that imagines them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from phys4dgen.errors import FormatError
from phys4dgen.reconstruct.foreground import Cutout
from phys4dgen.reconstruct.lgm.configuration import VIEWS
from phys4dgen.reconstruct.picture import read_picture

__all__ = ["FourViews", "MultiViewGenerator", "read_views"]

_SQUARE = 0.01
"""A view may be that much wider than high, or the other way round."""
_WHITE = 0.9
_BORDER_PX = 4
_FILTER = Image.Resampling.BILINEAR


@dataclass(frozen=True, eq=False)
class FourViews:
    """An object seen from the front, the viewer's right, the back and the viewer's left, as ``rays.view_cameras`` see.

    Attributes:
        rgb: straight sRGB in [0, 1], shape [4, S, S, 3], float32.
        alpha: opacity in [0, 1], shape [4, S, S], float32; 1 throughout where a view shows the object on white.
        source: what made them, for the report.
        warnings: what may be wrong with them, one sentence each.
    """

    rgb: NDArray[np.float32]
    alpha: NDArray[np.float32]
    source: str
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = np.shape(self.rgb)
        if len(shape) != 4 or shape[0] != VIEWS or shape[1] != shape[2] or shape[3] != 3:
            raise ValueError(f"rgb: expected shape ({VIEWS}, S, S, 3), got {shape}.")
        if np.shape(self.alpha) != shape[:3]:
            raise ValueError(f"alpha: expected shape {shape[:3]}, got {np.shape(self.alpha)}.")

    def on_white(self) -> NDArray[np.float32]:
        """The object on a white background, shape [4, S, S, 3]."""
        opacity = self.alpha[..., None]
        return (self.rgb * opacity + (1 - opacity)).astype(np.float32)


class MultiViewGenerator(Protocol):
    """Imagines the four views of an object from one picture of it, as multi-view diffusion models do."""

    def __call__(self, cutout: Cutout) -> FourViews:
        """The four views; the first shows the object as the picture does."""
        ...


def read_views(paths: Sequence[Path], *, size_px: int) -> FourViews:
    """Four views that the user has: rendered, photographed on a turntable, or made by another program.

    Args:
        paths: square pictures: front, from the viewer's right, back, from the viewer's left.
        size_px: side to which they are brought.

    Raises:
        FormatError: a file cannot be read, or is not square.
    """
    rgba = np.stack([_squared(path, size_px) for path in paths])
    views = FourViews(rgba[..., :3], rgba[..., 3], "four views given")
    border = np.ones((size_px, size_px), bool)
    border[_BORDER_PX:-_BORDER_PX, _BORDER_PX:-_BORDER_PX] = False
    dark = [
        path.name for path, picture in zip(paths, views.on_white(), strict=True) if np.median(picture[border]) < _WHITE
    ]
    if not dark:
        return views
    warning = f"LGM expects the object on white or on nothing, but the background of {', '.join(dark)} is darker."
    return replace(views, warnings=(warning,))


def _squared(path: Path, size_px: int) -> NDArray[np.float32]:
    """Straight RGBA of a square picture, [size_px, size_px, 4]; opaque where the file has no alpha channel."""
    picture = read_picture(path)
    height, width = picture.size
    if abs(width - height) > _SQUARE * height:
        raise FormatError(
            f"{path}: expected a square view, got {width} x {height} pixels; crop it, the object in the middle and as "
            "large as in the other views."
        )
    alpha = np.ones((height, width), np.float32) if picture.alpha is None else picture.alpha
    # Colours of transparent pixels mean nothing, so they must not bleed into the edge.
    premultiplied = np.concatenate([picture.rgb * alpha[..., None], alpha[..., None]], -1)
    channels = [
        np.asarray(Image.fromarray(np.ascontiguousarray(premultiplied[..., c])).resize((size_px, size_px), _FILTER))
        for c in range(4)
    ]
    opacity = np.clip(channels[3], 0, 1)[..., None]
    rgb = np.clip(np.stack(channels[:3], -1) / np.maximum(opacity, 1e-4), 0, 1)
    return np.concatenate([rgb, opacity], -1).astype(np.float32)
