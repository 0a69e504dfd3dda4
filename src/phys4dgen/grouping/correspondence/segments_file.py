"""The segments that a user has drawn on a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError
from phys4dgen.grouping.label_maps import read_label_png

__all__ = ["read_segments"]

_MAX_SIDE_PX = 16_384


def read_segments(path: Path, height: int, width: int) -> NDArray[np.int32]:
    """Read a grey or indexed PNG of segments; -1 for nothing, else the number of the segment, [height, width].

    The picture may have been scaled down on reading; then so is this.

    Args:
        path: the file.
        height: of the picture that it belongs to, as read.
        width: likewise.

    Raises:
        FormatError: it is no such file, or of another shape.
    """
    values = read_label_png(path, max_side_px=_MAX_SIDE_PX) + 1
    if abs(values.shape[0] * width - values.shape[1] * height) > max(values.shape):
        raise FormatError(
            f"{path}: expected segments of the shape of their picture, {width} x {height} px, got {values.shape[1]} x "
            f"{values.shape[0]}."
        )
    row = ((np.arange(height) + 0.5) * values.shape[0] / height).astype(np.intp)
    column = ((np.arange(width) + 0.5) * values.shape[1] / width).astype(np.intp)
    scaled = values[np.ix_(row, column)]
    return np.where(scaled > 0, scaled, -1).astype(np.int32)
