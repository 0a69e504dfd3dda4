"""One segment of a picture, alone (Paper: Sec. 3.4, masked sub-images)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["masked_sub_image"]

_MARGIN = 0.1
_GREY = 128


def masked_sub_image(rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The segment on a grey square with a margin, because CLIP cuts the middle square out of a picture.

    The paper blackens all else in the whole picture, in which a small part is a few pixels.

    Args:
        rgb: shape [H, W, 3].
        mask: with at least one pixel, shape [H, W].
    """
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    top, left = int(rows[0]), int(columns[0])
    height, width = int(rows[-1]) + 1 - top, int(columns[-1]) + 1 - left
    side = round((1 + 2 * _MARGIN) * max(height, width)) + 2
    square = np.full((side, side, 3), _GREY, np.uint8)
    inside = mask[top : top + height, left : left + width]
    y, x = (side - height) // 2, (side - width) // 2
    square[y : y + height, x : x + width][inside] = rgb[top : top + height, left : left + width][inside]
    return square
