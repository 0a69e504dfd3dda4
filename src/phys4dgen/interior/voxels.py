"""A cubic voxel grid in upright axes (z up), in the input's units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["VoxelGrid"]


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """Cubic voxels (PHYSICS.md 4.2: per-axis voxels would flatten on thin objects).

    Attributes:
        lower: lower corner in upright axes, shape [3], input units.
        side: edge length of a voxel, input units.
        shape: number of voxels along x, y, z.
    """

    lower: NDArray[np.float64]
    side: float
    shape: tuple[int, int, int]

    @staticmethod
    def around(lower: NDArray[Any], upper: NDArray[Any], side: float, *, padding: int) -> VoxelGrid:
        """The smallest grid of ``side`` that covers the box, with ``padding`` voxels around it."""
        counts = np.maximum(np.ceil((np.asarray(upper) - lower) / side - 1e-9).astype(int), 1)
        middle = (np.asarray(lower, np.float64) + upper) / 2
        shape = counts + 2 * padding
        return VoxelGrid(middle - shape * side / 2, float(side), (int(shape[0]), int(shape[1]), int(shape[2])))

    def centers(self, index: NDArray[Any]) -> NDArray[np.float64]:
        """Centres of voxels [.., 3] (integer indices), upright axes."""
        return self.lower + (np.asarray(index) + 0.5) * self.side

    def index_of(self, points: NDArray[Any]) -> NDArray[np.int64]:
        """Voxel index [.., 3] of points, clipped to the grid."""
        index = np.floor((np.asarray(points) - self.lower) / self.side).astype(np.int64)
        return np.clip(index, 0, np.array(self.shape) - 1)

    def contains(self, points: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether each point lies inside the grid."""
        relative = (np.asarray(points) - self.lower) / self.side
        return np.asarray(((relative >= 0) & (relative < np.array(self.shape))).all(-1))

    def all_centers(self) -> NDArray[np.float64]:
        """Centres of all voxels in C order, shape [nx * ny * nz, 3]."""
        axes = [self.lower[a] + (np.arange(self.shape[a]) + 0.5) * self.side for a in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
