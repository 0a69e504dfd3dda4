"""The generalised winding number of oriented Gaussians: about one inside, zero outside, whatever holes there are.

G. Barill et al., Fast Winding Numbers for Soups and Clouds, 2018 sum the solid angles of oriented points. Here the
same field solves a Poisson equation on the voxel grid (M. Kazhdan et al., Poisson Surface Reconstruction, 2006): its
gradient is minus the normals of the surface, spread over the voxels that hold them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fftfreq, irfftn, next_fast_len, rfftfreq, rfftn

from phys4dgen.interior.normals import OrientedPoints
from phys4dgen.interior.voxels import VoxelGrid

__all__ = ["winding_number"]

_MARGIN = 8
"""Empty voxels around the grid: what the transform takes for the next copy of the object stays away."""


def winding_number(points: OrientedPoints, grid: VoxelGrid) -> NDArray[np.float32]:
    """Winding number at the voxel centres, ``grid.shape``.

    Args:
        points: oriented Gaussians in upright axes.
        grid: voxels in upright axes.
    """
    shape = tuple(int(next_fast_len(count + 2 * _MARGIN, real=True) or 0) for count in grid.shape)
    flux = points.normal * (points.area / grid.side**2)[:, None]
    frequency = np.meshgrid(
        2 * np.pi * fftfreq(shape[0]), 2 * np.pi * fftfreq(shape[1]), 2 * np.pi * rfftfreq(shape[2]), indexing="ij"
    )
    transform = np.zeros(frequency[0].shape, np.complex64)
    for axis in range(3):
        spread = _spread((points.position - grid.lower) / grid.side - 0.5 + _MARGIN, flux[:, axis], shape)
        transform += np.asarray(rfftn(spread, workers=-1)) * frequency[axis].astype(np.float32)
    square = frequency[0] ** 2 + frequency[1] ** 2 + frequency[2] ** 2
    square[0, 0, 0] = 1
    field = np.asarray(irfftn(1j * transform / square.astype(np.float32), s=shape, workers=-1))
    inner = tuple(slice(_MARGIN, _MARGIN + count) for count in grid.shape)
    return (field[inner] - field[0].mean()).astype(np.float32)  # the first plane lies in the empty margin


def _spread(place: NDArray[np.float64], value: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Values at places in voxels, shared among the eight voxel centres around each (trilinear)."""
    low = np.floor(place).astype(np.int64)
    share = place - low
    total = np.zeros(int(np.prod(shape)))
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(np.array(corner) == 1, share, 1 - share).prod(1)
        cell = np.ravel_multi_index(tuple((low + corner).T), shape, mode="clip")
        total += np.bincount(cell, weight * value, minlength=len(total))
    return total.reshape(shape).astype(np.float32)
