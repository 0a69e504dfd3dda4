"""Segments of a picture by colour and shape: the stand-in for CLIP's embeddings, which needs no weights.

What changes little with light and viewpoint: where a segment lies within the object, how much of it it takes, how wide
and high it is, its hue against its lightness, and whether it is lighter or darker than the object as a whole.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types.color import srgb_to_lab

__all__ = ["DESCRIPTOR_FLOOR", "descriptor_similarity", "segment_descriptors"]

DESCRIPTOR_FLOOR = 0.2
"""Segments that are less alike are not the same part."""

_LIGHTNESS_OFFSET = 70.0
"""a and b shrink with lightness in the shade; they are divided by lightness and this."""
_SCALES = np.array([0.15, 0.12, 0.2, 0.2, 0.7, 0.12, 0.12, 18.0])
"""By how much each number of a descriptor typically differs between two pictures of the same part: x, y, width, height,
logarithm of the area, two of hue, lightness."""


def segment_descriptors(
    rgb: NDArray[np.uint8], segments: NDArray[np.int32], numbers: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Eight numbers for each segment, shape [S, 8], in units of their usual difference.

    Args:
        rgb: shape [H, W, 3].
        segments: number of the segment of each pixel, negative for background, shape [H, W].
        numbers: the S segments wanted, each with at least one pixel.
    """
    rows, columns = np.nonzero(segments >= 0)
    lower = np.array([columns.min(), rows.min()])
    size = np.array([np.ptp(columns), np.ptp(rows)]) + 1.0
    lab = srgb_to_lab(rgb[rows, columns] / 255.0)
    lightness = float(np.median(lab[:, 0]))
    found = np.zeros((len(numbers), len(_SCALES)))
    for place, number in enumerate(numbers):
        mine = segments[rows, columns] == number
        xy = (np.stack([columns, rows], 1)[mine] + 0.5 - lower) / size
        middle, spread = np.median(xy, 0), np.quantile(xy, 0.95, axis=0) - np.quantile(xy, 0.05, axis=0)
        mean = np.median(lab[mine], 0)
        hue = mean[1:] / (mean[0] + _LIGHTNESS_OFFSET)
        found[place] = [*middle, *spread, np.log(mine.mean()), *hue, mean[0] - lightness]
    return found / _SCALES


def descriptor_similarity(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """1 for segments that are alike, towards 0 for others, shape [A, B]."""
    return np.exp(-0.25 * np.square(a[:, None] - b).mean(2))
