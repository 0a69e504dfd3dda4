"""Which Gaussians are the visible surface of a view, and at which pixel (Paper: Sec. 3.2, Projection and Aggregation).

A Gaussian is visible where its depth agrees with the rendered median depth at the pixel that its centre falls on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
from numpy.typing import NDArray

from phys4dgen.types import Camera

__all__ = ["for_all_chunks", "visible_pixels"]

_CHUNK = 8192
"""Gaussians worked on at a time, so that all arrays on the way stay in the cache of a core."""


def visible_pixels(
    means: NDArray[np.float32], camera: Camera, depth: NDArray[np.float32], *, tolerance: float | NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """The Gaussians that a view sees.

    Args:
        means: centres, shape [N, 3].
        camera: the view's camera.
        depth: median depth of the view, 0 where there is none, shape [H, W], input units.
        tolerance: largest difference from the rendered depth, either way, input units; one, or one a Gaussian [N]. A
            Gaussian far in front of the median surface is a faint one: the pixel shows what lies behind it.

    Returns:
        Index of the Gaussian, row and column of its pixel, and difference of depth in input units, each of shape [M].
    """
    pixels, z = camera.project(means)
    inside = (z > 0) & (pixels >= 0).all(1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
    index = np.flatnonzero(inside)
    column, row = pixels[index].astype(np.intp).T
    seen = depth[row, column]
    difference = np.abs(seen - z[index])
    agrees = (seen > 0) & (difference <= np.broadcast_to(tolerance, len(means))[index])
    return index[agrees], row[agrees], column[agrees], difference[agrees]


def for_all_chunks(count: int, work: Callable[[slice], None]) -> None:
    """Call ``work`` for slices that cover 0 .. count-1, several at a time; each writes to its own rows only."""
    with ThreadPoolExecutor(numba.get_num_threads(), "chunks") as pool:
        for _ in pool.map(work, _chunks(count)):
            pass


def _chunks(count: int) -> Iterator[slice]:
    return (slice(start, min(start + _CHUNK, count)) for start in range(0, count, _CHUNK))
