"""How thick an object is below each patch of its surface: a wheel and the car it is on, a handset and its telephone.

The shape diameter function of L. Shapira, A. Shamir and D. Cohen-Or, "Consistent Mesh Partitioning and Skeletonisation
Using the Shape Diameter Function", The Visual Computer 24(4), 2008: rays go from a patch into the object, in a cone
about its inward normal, until they meet the surface on the other side; the median of their lengths is the diameter.
Here the surface is the voxels that hold a visible Gaussian. It changes little along one thing, whatever its pose, and
mostly a lot where two things of one colour meet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.grouping.supervoxels import Supervoxels

__all__ = ["log_diameter"]

_RAYS = 32
_HALF_ANGLE = np.deg2rad(50)
_FEWEST_HITS = 8
"""With fewer rays that meet anything (the underside is missing) the diameter is not known."""
_TAIL_PERCENT = 0.5
"""On each side of each axis: beyond it lies what is stray."""
_MOST_VOXELS = 60
"""Along half the object's diagonal."""
_SPACINGS = 1.3
"""Width of a voxel in distances to the fourth neighbour: wide enough that the surface has no holes."""
_SKIPPED = 2.5
"""Voxels that a ray passes before it may meet the surface, lest it meet the one that it starts from."""
_STEP = 0.5
"""Of a voxel."""
_LEAST = 0.03
"""Least diameter told apart, in half diagonals."""
_UNKNOWN = 0.3
"""Taken where neither a patch nor any patch around it knows."""


def log_diameter(patches: Supervoxels, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Natural logarithm of the diameter, in halves of the object's diagonal, below each patch; shape [S].

    Patches whose rays leave the object take what is known around them.

    Args:
        patches: S patches of the visible surface.
        points: their Gaussians' centres, in the order of ``patches.core``, shape [C, 3].
    """
    lower, upper = np.percentile(points, [_TAIL_PERCENT, 100 - _TAIL_PERCENT], axis=0)
    half = max(float(np.linalg.norm(upper - lower)) / 2, 1e-12)
    spacing = KDTree(points).query(points, min(5, len(points)), workers=-1)[0].reshape(len(points), -1)[:, -1]
    voxel = max(_SPACINGS * float(np.median(spacing)), half / _MOST_VOXELS)
    lower = lower - 2 * voxel
    shape = np.ceil((upper - lower) / voxel).astype(np.int64) + 2
    cell, inside = _cells((points - lower) / voxel, shape)
    solid = np.zeros(shape, np.bool_)
    solid[tuple(cell[inside].T)] = True
    length = _lengths(solid, (patches.centre - lower) / voxel, _cone(-patches.normal), 2 * half / voxel) * voxel / half
    hits = np.isfinite(length).sum(1)
    middle = np.sort(length, axis=1)[np.arange(len(length)), np.maximum(hits - 1, 0) // 2]  # missing ones sort last
    known = hits >= _FEWEST_HITS
    return _spread(np.log(np.clip(np.where(known, middle, 1.0), _LEAST, 2.0)), known, patches.border)


def _cone(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit directions spread evenly over a cone about each unit axis [S, 3], shape [S, R, 3]."""
    number = np.arange(_RAYS) + 0.5
    along = 1 - number / _RAYS * (1 - float(np.cos(_HALF_ANGLE)))
    turn = np.pi * (1 + 5**0.5) * number  # as the seeds of a sunflower
    across = np.sqrt(1 - along**2)
    side = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]))
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    frame = np.stack([side, np.cross(axis, side), axis], 1)
    return np.asarray(np.stack([across * np.cos(turn), across * np.sin(turn), along], 1) @ frame, np.float64)


def _cells(places: NDArray[np.float64], shape: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Voxel of each place [M, 3] and whether there is one."""
    cell = np.floor(places).astype(np.int64)
    return cell, np.asarray(((cell >= 0) & (cell < shape)).all(1))


def _lengths(
    solid: NDArray[np.bool_], start: NDArray[np.float64], direction: NDArray[np.float64], farthest: float
) -> NDArray[np.float64]:
    """How far rays from each start [S, 3] go until they meet a solid voxel, infinite where never; voxels, [S, R]."""
    length = np.full(direction.shape[:2], np.inf)
    patch, ray = np.nonzero(np.isfinite(direction).all(2))
    for travelled in np.arange(_SKIPPED, farthest, _STEP):
        cell, inside = _cells(start[patch] + travelled * direction[patch, ray], np.array(solid.shape))
        patch, ray, cell = patch[inside], ray[inside], cell[inside]
        meets = solid[tuple(cell.T)]
        length[patch[meets], ray[meets]] = travelled
        patch, ray = patch[~meets], ray[~meets]
        if not len(patch):
            break
    return length


def _spread(values: NDArray[np.float64], known: NDArray[np.bool_], border: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values [S] with the mean of neighbours, by their borders [S, S], where they are not known, ring by ring."""
    values = np.where(known, values, np.log(_UNKNOWN))
    while not known.all():
        weight = border @ known
        new = ~known & (weight > 0)
        if not new.any():
            break
        values[new] = (border[new] @ np.where(known, values, 0)) / weight[new]
        known = known | new
    return values
