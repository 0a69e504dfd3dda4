"""Solid voxels by accumulated opacity: thin things that carving loses.

A leaf thinner than a voxel has no voxel whose centre is behind its depth in every view. Its Gaussians, however,
accumulate opacity there; no single Gaussian is cut by its opacity (23-46 % of a capture's Gaussians have an opacity
below 0.1, MANIFEST.md), only the sum is.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import Gaussians

__all__ = ["accumulated_opacity", "density_threshold"]

_FLOOR_REL = 0.35
"""Isotropic standard deviation, in voxels, added to every Gaussian: flat splats would fall between voxel centres."""

_CUT_MAHALANOBIS2 = 9.0


@njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def _accumulate(means, inverse, radius, weight, lower, side, shape, slabs):  # pragma: no cover - compiled
    density = np.zeros(shape, np.float32)
    for slab in prange(slabs):  # every slab of x-planes belongs to one thread: the sum's order is fixed
        first = shape[0] * slab // slabs
        last = shape[0] * (slab + 1) // slabs - 1
        for k in range(means.shape[0]):
            i0 = max(first, math.floor((means[k, 0] - radius[k, 0] - lower[0]) / side))
            i1 = min(last, math.floor((means[k, 0] + radius[k, 0] - lower[0]) / side))
            if i0 > i1:
                continue
            j0 = max(0, math.floor((means[k, 1] - radius[k, 1] - lower[1]) / side))
            j1 = min(shape[1] - 1, math.floor((means[k, 1] + radius[k, 1] - lower[1]) / side))
            l0 = max(0, math.floor((means[k, 2] - radius[k, 2] - lower[2]) / side))
            l1 = min(shape[2] - 1, math.floor((means[k, 2] + radius[k, 2] - lower[2]) / side))
            for i in range(i0, i1 + 1):
                x = lower[0] + (i + 0.5) * side - means[k, 0]
                for j in range(j0, j1 + 1):
                    y = lower[1] + (j + 0.5) * side - means[k, 1]
                    for l in range(l0, l1 + 1):  # noqa: E741
                        z = lower[2] + (l + 0.5) * side - means[k, 2]
                        q = inverse[k, 0, 0] * x * x + inverse[k, 1, 1] * y * y + inverse[k, 2, 2] * z * z
                        q += 2 * (inverse[k, 0, 1] * x * y + inverse[k, 0, 2] * x * z + inverse[k, 1, 2] * y * z)
                        if q < _CUT_MAHALANOBIS2:
                            density[i, j, l] += weight[k] * math.exp(-0.5 * q)
    return density


def accumulated_opacity(gaussians: Gaussians, grid: VoxelGrid, rotation: NDArray[np.float64]) -> NDArray[np.float32]:
    """Sum over Gaussians of opacity times their (floored) density at each voxel centre; shape ``grid.shape``.

    The floor makes a Gaussian larger; its peak is lowered so that its optical mass (cube root of the volume ratio)
    is kept.
    """
    covariance = rotation @ gaussians.covariances() @ rotation.T
    floor = np.eye(3) * (_FLOOR_REL * grid.side) ** 2
    floored = covariance + floor
    tiny = np.eye(3) * (1e-3 * grid.side) ** 2
    loss = np.sqrt(np.linalg.det(covariance + tiny) / np.linalg.det(floored)) ** (1 / 3)
    radius = math.sqrt(_CUT_MAHALANOBIS2) * np.sqrt(np.diagonal(floored, axis1=1, axis2=2))
    means = gaussians.means.astype(np.float64) @ rotation.T
    # A few huge, faint Gaussians (haze of a capture) would cost more than all others and say nothing about a solid.
    useful = (radius.max(1) < 0.25 * grid.side * max(grid.shape)) & (gaussians.opacities > 1 / 255)
    return _accumulate(
        means[useful],
        np.linalg.inv(floored[useful]),
        radius[useful],
        (gaussians.opacities * loss)[useful],
        grid.lower,
        grid.side,
        grid.shape,
        8,
    )


def density_threshold(gaussians: Gaussians, grid: VoxelGrid, rotation: NDArray[np.float64]) -> float:
    """Threshold on the accumulated opacity: 0.6 for dense captures, 0.3 for sparse ones.

    Dense means at least 5 Gaussians per occupied voxel, sparse at most 2 (MOTION.md, technique 2); between them the
    threshold is interpolated.
    """
    seen = gaussians.opacities > 0.1
    points = gaussians.means[seen if seen.any() else slice(None)].astype(np.float64) @ rotation.T
    index = grid.index_of(points[grid.contains(points)])
    if len(index) == 0:
        return 0.3
    occupied = len(np.unique(np.ravel_multi_index(tuple(index.T), grid.shape)))
    return float(np.interp(len(index) / occupied, [2.0, 5.0], [0.3, 0.6]))
