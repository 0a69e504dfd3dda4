"""Which part each particle belongs to, and whether it takes the part's interior material."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.interior.labels import LabelGrid
from phys4dgen.interior.normals import oriented_points
from phys4dgen.types import SOLID, Gaussians, Parts, Views

__all__ = ["fill_vessel", "part_of_particles"]

_NEIGHBORS = 8
_FACES = 32  # surfaces nearest to a particle that may be the face of its wall
_COVERED = 0.5  # of what lies deep in a vessel, at least so much lies under its filling
_NEAR = 1.5  # particle spacings: Gaussians nearer than this say more than a cell of the label grid


def part_of_particles(
    gaussians: Gaussians,
    labels: NDArray[np.int32],
    points_up: NDArray[np.float64],
    shape: NDArray[np.int8],
    labelled: LabelGrid,
    side: float,
    rotation: NDArray[np.float64],
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Part of each particle: the Gaussians around it where there are any, else its label cell's.

    The cells of the label grid are as wide as a leaf stands from its stem; Gaussians within 1.5 particle spacings
    say more than the cell does.
    """
    seen = gaussians.opacities > 0.1 if (gaussians.opacities > 0.1).any() else gaussians.opacities > 0
    tree = KDTree(gaussians.means[seen].astype(np.float64) @ rotation.T)
    cell = tuple(labelled.grid.index_of(points_up).T)
    part = labelled.part[cell].astype(np.int32)
    deep = (shape == SOLID) & (part >= 0)
    nearest, _ = tree.query(points_up[deep], distance_upper_bound=_NEAR * side, workers=-1)
    deep[deep] = ~np.isfinite(nearest)

    near_surface = np.flatnonzero(~deep)
    k = min(_NEIGHBORS, tree.n)
    distance, near = tree.query(points_up[near_surface], k=k, workers=-1)
    distance, near = distance.reshape(-1, k), near.reshape(-1, k)
    weight = np.exp(-0.5 * (distance / (0.5 * side)) ** 2) * gaussians.opacities[seen][near] + 1e-12 / (1 + distance)
    votes = np.zeros((len(near_surface), int(labels.max()) + 1))
    for j in range(k):
        votes[np.arange(len(near_surface)), labels[seen][near[:, j]]] += weight[:, j]
    part[near_surface] = votes.argmax(1)
    is_interior = labelled.is_interior[cell] & deep
    return part, is_interior


def fill_vessel(
    part: NDArray[np.int32],
    is_interior: NDArray[np.bool_],
    vessel: int,
    points_up: NDArray[np.float64],
    gaussians: Gaussians,
    views: Views,
    parts: Parts,
    rotation: NDArray[np.float64],
    wall: float,
) -> None:
    """Give what lies deeper than the wall of a vessel to the part that is seen on top of it (in place).

    No picture shows where pot ends and soil begins; a known wall thickness does.
    """
    mine = parts.labels == vessel
    means = gaussians.means.astype(np.float64) @ rotation.T
    members = np.flatnonzero(part == vessel)
    if len(members) == 0 or mine.all():
        return
    # Only surfaces that the particle lies behind count: what faces it is the other side of the cavity's wall.
    shell = oriented_points(gaussians.subset(mine), views, rotation=rotation, tolerance=0.5 * wall)
    k = min(_FACES, len(shell.index))
    if k == 0:
        return
    distance, near = KDTree(shell.position).query(points_up[members], k=k, distance_upper_bound=wall, workers=-1)
    distance, near = distance.reshape(-1, k), near.reshape(-1, k)
    found = np.isfinite(distance)
    near[~found] = 0
    ahead = np.einsum("pka,pka->pk", points_up[members][:, None] - shell.position[near], shell.normal[near])
    deep = members[~(found & (ahead <= 0)).any(1)]
    if len(deep) == 0:
        return
    # The filling is what is seen first when one looks up from inside: the lowest other Gaussian of each column.
    others = np.flatnonzero(~mine & (gaussians.opacities > 0.3))
    distance, above = KDTree(means[others][:, :2]).query(points_up[deep][:, :2], k=min(32, len(others)), workers=-1)
    above = others[above.reshape(len(deep), -1)]
    over = (distance.reshape(above.shape) < wall) & (means[above, 2] > points_up[deep][:, 2:])  # not what it stands on
    height = np.where(over, means[above, 2], np.inf)
    lowest = above[np.arange(len(deep)), height.argmin(1)][np.isfinite(height.min(1))]
    if len(lowest) < _COVERED * len(deep):
        return
    filling = np.bincount(parts.labels[lowest], minlength=parts.count).argmax()
    part[deep] = filling
    is_interior[deep] = True
