"""Hollow parts: only a wall of known thickness is filled. No picture shows what a closed tin holds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.interior.labels import LabelGrid
from phys4dgen.interior.morphology import distance_to_false
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import Gaussians

__all__ = ["hollowed"]

_LEAST_WALL = 2.0  # voxels: a thinner skin of voxels would fall apart; its sheet then takes the true thickness
_SOLID_OPACITY = 0.3


def hollowed(
    solid: NDArray[np.bool_],
    walls: Mapping[int, float],
    *,
    gaussians: Gaussians,
    grid: VoxelGrid,
    labelled: LabelGrid,
    rotation: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """The solid without what lies deeper than the wall inside the hollow parts.

    Args:
        solid: solid voxels, ``grid.shape``.
        walls: wall thickness by part number, input units.
        gaussians: the object, whose surface the depth is counted from.
        grid: voxels in upright axes.
        labelled: which part owns which place.
        rotation: input axes -> upright axes, [3, 3].
    """
    depth = distance_to_false(np.pad(solid, 1))[1:-1, 1:-1, 1:-1] - 0.5
    index = np.argwhere(solid & (depth > _LEAST_WALL))
    points = grid.centers(index)
    part = labelled.part[tuple(labelled.grid.index_of(points).T)]
    tree = KDTree(gaussians.means[gaussians.opacities > _SOLID_OPACITY].astype(np.float64) @ rotation.T)
    result = solid.copy()
    for number, wall in walls.items():
        own = part == number
        reach = max(wall / grid.side, _LEAST_WALL)
        far, _ = tree.query(points[own], distance_upper_bound=reach * grid.side, workers=-1)
        deep = ~np.isfinite(far) & (depth[tuple(index[own].T)] > reach)
        result[tuple(index[own][deep].T)] = False
    return result
