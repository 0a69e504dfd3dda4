"""The union of inscribed balls: the roundest body that an outline allows without a seam.

Every pixel c of the mask carries a ball of the radius R(c) of the largest disc that fits there. The surface of their
union is h^2(p) = max over c of R(c)^2 - |p - c|^2, a power distance transform, exact in linear time by two passes of
lower envelopes of parabolas (Felzenszwalb and Huttenlocher, "Distance Transforms of Sampled Functions", Theory of
Computing 2012). A disc gives a sphere and a strip a cylinder; inflation by Poisson's equation makes strips too thick by
a factor of sqrt(2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from phys4dgen.reconstruct.mask_geometry import depth_inside

__all__ = ["Balls", "inscribed_balls"]

_OUTSIDE = -1e9


@dataclass(frozen=True, eq=False)
class Balls:
    """The ball that covers each pixel highest.

    Attributes:
        height_squared: h^2 of the union, 0 outside the mask, px^2, shape [H, W].
        centre_y: row of the ball's centre, shape [H, W].
        centre_x: column of the ball's centre, shape [H, W].
        radius: of the ball, px, shape [H, W].
    """

    height_squared: NDArray[np.float64]
    centre_y: NDArray[np.int64]
    centre_x: NDArray[np.int64]
    radius: NDArray[np.float64]


def inscribed_balls(mask: NDArray[np.bool_]) -> Balls:
    """The union of the balls inscribed in a mask [H, W]."""
    radius = np.maximum(depth_inside(mask) - 0.5, 0)
    height_squared, centre_y, centre_x = _power_distance(np.where(mask, radius**2, _OUTSIDE))
    return Balls(
        np.where(mask, np.maximum(height_squared, 0), 0),
        centre_y,
        centre_x,
        np.maximum(radius[centre_y, centre_x], 0.5),
    )


@njit(cache=True)
def _lower_envelope(values, least, source):  # pyright: ignore
    """Set least[q] = min over p of values[p] + (q - p)^2, and the p that attains it."""
    n = values.shape[0]
    vertex = np.zeros(n, np.int64)
    boundary = np.zeros(n + 1)
    boundary[0], boundary[1] = -1e30, 1e30
    k = 0
    for q in range(1, n):
        while True:
            p = vertex[k]
            crossing = (values[q] + q * q - values[p] - p * p) / (2 * q - 2 * p)
            if crossing > boundary[k]:
                break
            k -= 1
        k += 1
        vertex[k] = q
        boundary[k], boundary[k + 1] = crossing, 1e30
    k = 0
    for q in range(n):
        while boundary[k + 1] < q:
            k += 1
        p = vertex[k]
        least[q] = (q - p) * (q - p) + values[p]
        source[q] = p


@njit(cache=True)
def _power_distance(weight):  # pyright: ignore
    """Maximum over c of weight(c) - |p - c|^2 for every pixel p, and the row and column of that c."""
    height, width = weight.shape
    along_x = np.zeros((height, width))
    source_x = np.zeros((height, width), np.int64)
    for y in range(height):
        _lower_envelope(-weight[y], along_x[y], source_x[y])
    best = np.zeros((height, width))
    centre_y = np.zeros((height, width), np.int64)
    centre_x = np.zeros((height, width), np.int64)
    column = np.zeros(height)
    source = np.zeros(height, np.int64)
    for x in range(width):
        _lower_envelope(along_x[:, x].copy(), column, source)
        for y in range(height):
            best[y, x] = -column[y]
            centre_y[y, x] = source[y]
            centre_x[y, x] = source_x[source[y], x]
    return best, centre_y, centre_x
