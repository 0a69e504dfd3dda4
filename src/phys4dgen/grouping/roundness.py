"""Rods from sheets: a stalk and a leaf of one green differ in how flat the surface is around a point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.grouping.supervoxels import Supervoxels

__all__ = ["rod_likeness"]

_REACH = 0.05
"""Of the object's radius: how far around a patch its shape is looked at."""
_MOST_NEIGHBOURS = 400
_FEWEST_NEIGHBOURS = 8
_THIN = 0.2
"""Thinness from which a patch surely belongs to something thin; a solid's edge is no rod."""
_COLOR_SCALE2 = 150.0


def rod_likeness(patches: Supervoxels, points: NDArray[np.float64], *, radius: float) -> NDArray[np.float64]:
    """How far each patch is a piece of a thin rod, 0 (solid or sheet) to 1; shape [S].

    Args:
        patches: S patches of the visible surface.
        points: their Gaussians' centres, in the order of ``patches.core``, shape [C, 3].
        radius: half the object's diagonal, input units.
    """
    flat = _planarity(patches, points, _REACH * radius)
    alike = np.exp(-((patches.mean[:, None] - patches.mean[None]) ** 2).sum(2) / _COLOR_SCALE2)
    weight = patches.border * alike
    weight = weight / np.maximum(weight.sum(1, keepdims=True), 1e-9)
    thin = _averaged(_averaged(patches.thinness, weight), weight)
    return _averaged(1 - flat, weight) * np.clip(thin / _THIN, 0, 1)


def _planarity(patches: Supervoxels, points: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """1 where the surface around a patch is flat, 0 where it is as thick as wide; shape [S]."""
    count = min(_MOST_NEIGHBOURS, len(points))
    distance, near = KDTree(points).query(patches.centre, count, distance_upper_bound=reach, workers=-1)
    distance, near = distance.reshape(len(patches.centre), -1), near.reshape(len(patches.centre), -1)
    inside = np.isfinite(distance)
    weight = inside / np.maximum(inside.sum(1), 1)[:, None]
    offset = points[np.where(inside, near, 0)] - patches.centre[:, None]
    offset -= np.einsum("sk,ska->sa", weight, offset)[:, None]
    products = np.einsum("sk,ska,skb->sab", weight, offset, offset)
    variances = np.linalg.eigvalsh(products)
    flat = 1 - np.sqrt(np.maximum(variances[:, 0], 0) / np.maximum(variances[:, 1], 1e-12 * reach**2))
    # Too few points around it: nothing speaks for a rod.
    return np.where(inside.sum(1) < _FEWEST_NEIGHBOURS, 1.0, flat)


def _averaged(values: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half the value of a patch, half the weighted mean of its neighbours'; its own where it has none. Shape [S]."""
    has_neighbours = weight.sum(1) > 0
    return np.where(has_neighbours, (values + weight @ values) / 2, values)
