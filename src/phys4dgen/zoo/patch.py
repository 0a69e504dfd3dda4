"""Oriented surface samples that become Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

__all__ = ["Array", "Patch", "joined", "ragged_rows", "staggered"]


@dataclass(frozen=True, eq=False)
class Patch:
    """N samples of a surface, in metres.

    Attributes:
        points: shape [N, 3].
        normals: unit, pointing out of the material, shape [N, 3].
        tangents: unit, perpendicular to the normals, shape [N, 3].
        sigmas: standard deviations along tangent, normal x tangent and normal, shape [N, 3].
        coords: two coordinates on the surface for the texture (their meaning is the surface's) and the face: 1 upper
            or outer, -1 lower; shape [N, 3].
    """

    points: Array
    normals: Array
    tangents: Array
    sigmas: Array
    coords: Array

    def __len__(self) -> int:
        return len(self.points)

    def subset(self, keep: NDArray[np.bool_]) -> Patch:
        """The samples that a mask [N] selects."""
        return Patch(*(getattr(self, name)[keep] for name in FIELDS))

    def moved(self, origin: Array, rotation: Array) -> Patch:
        """The samples turned about the origin, then moved to ``origin``; columns of ``rotation`` are the new axes."""
        turn = rotation.T
        return Patch(self.points @ turn + origin, self.normals @ turn, self.tangents @ turn, self.sigmas, self.coords)


FIELDS = ("points", "normals", "tangents", "sigmas", "coords")


def joined(patches: list[Patch]) -> Patch:
    """All samples of ``patches`` in their order."""
    return Patch(*(np.concatenate([getattr(patch, name) for patch in patches]) for name in FIELDS))


def ragged_rows(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row number and place within the row of every sample, for rows of ``counts`` samples; two arrays [sum(counts)]."""
    row = np.repeat(np.arange(len(counts)), counts)
    return row, np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)


def staggered(row: NDArray[np.int64], place: NDArray[np.int64], counts: NDArray[np.int64]) -> Array:
    """Positions in (0, 1) along each row, every second row shifted by half a cell (an almost hexagonal pattern)."""
    return (place + 0.5 + np.where(row % 2 == 0, 0.25, -0.25)) / counts[row]
