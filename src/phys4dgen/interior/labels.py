"""The paper's label grid: which part owns each cell of the inside, and whether it is surface or interior.

Paper: Sec. 3.3 and appendix. A valid cell is *surface* when it lies inside the confidence ellipsoid of a Gaussian
(squared Mahalanobis distance below the chi-square quantile with 3 degrees of freedom, at most 10 cells per Gaussian)
or belongs to the outermost layer, which closes the surface. A surface cell takes the part of its nearest Gaussian; an
interior cell casts rays along the six axes and takes the majority of the parts of the first surface cells hit.
Choices where the paper is silent: PHYSICS.md 4.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.stats import chi2

from phys4dgen.interior.morphology import outermost_layer
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import Gaussians

__all__ = ["LabelGrid", "label_cells"]

_FLOOR_REL = 0.25
"""Isotropic standard deviation in cells added to every Gaussian: flat splats would cover no cell centre at all."""

_CANDIDATE_CELLS = 32
_CHUNK = 16384


@dataclass(frozen=True, eq=False)
class LabelGrid:
    """Labels of the cells of a grid.

    Attributes:
        grid: the cells.
        part: part of each valid cell, -1 outside the body, shape ``grid.shape``, int32.
        is_interior: valid cells that are not surface, shape ``grid.shape``.
    """

    grid: VoxelGrid
    part: NDArray[np.int32]
    is_interior: NDArray[np.bool_]


def label_cells(
    gaussians: Gaussians,
    labels: NDArray[np.int32],
    grid: VoxelGrid,
    valid: NDArray[np.bool_],
    rotation: NDArray[np.float64],
    *,
    confidence: float = 0.95,
    max_cells_per_gaussian: int = 10,
) -> LabelGrid:
    """Label every valid cell with a part, and say which are interior.

    Args:
        gaussians: the object.
        labels: part of each Gaussian, [N].
        grid: label grid in upright axes (32 cells along the longest side by default).
        valid: cells inside the body, ``grid.shape``.
        rotation: input axes -> upright axes, [3, 3].
        confidence: of the chi-square test.
        max_cells_per_gaussian: the nearest cells in Mahalanobis distance that one Gaussian may claim.
    """
    means = gaussians.means.astype(np.float64) @ rotation.T
    seen = gaussians.opacities > 0.02
    surface = _covered_by_ellipsoids(
        gaussians.subset(seen), means[seen], grid, valid, rotation, confidence, max_cells_per_gaussian
    )
    surface |= outermost_layer(valid)

    part = np.full(grid.shape, -1, np.int32)
    cells = np.argwhere(surface)
    if len(cells):
        _, nearest = KDTree(means[seen]).query(grid.centers(cells), workers=-1)
        part[surface] = labels[seen][nearest]
    interior = valid & ~surface
    _vote_along_axes(part, surface, interior)
    return LabelGrid(grid, part, interior)


def _covered_by_ellipsoids(
    gaussians: Gaussians,
    means: NDArray[np.float64],
    grid: VoxelGrid,
    valid: NDArray[np.bool_],
    rotation: NDArray[np.float64],
    confidence: float,
    max_cells: int,
) -> NDArray[np.bool_]:
    """Cells inside the confidence ellipsoid of some Gaussian, at most ``max_cells`` for each Gaussian.

    Candidates are a Gaussian's nearest cells in space; the ``max_cells`` nearest in Mahalanobis distance are taken.
    """
    limit = float(chi2.ppf(confidence, 3))
    covered = np.zeros(grid.shape, bool)
    cells = np.argwhere(valid)
    if len(cells) == 0:
        return covered
    centers = grid.centers(cells)
    tree = KDTree(centers)
    k = min(_CANDIDATE_CELLS, len(centers))
    floor = np.eye(3) * (_FLOOR_REL * grid.side) ** 2
    for start in range(0, len(means), _CHUNK):
        some = np.arange(start, min(start + _CHUNK, len(means)))
        inverse = np.linalg.inv(rotation @ gaussians.subset(some).covariances() @ rotation.T + floor)
        _, near = tree.query(means[some], k=k, workers=-1)
        near = near.reshape(len(inverse), k)
        apart = centers[near] - means[some, None]
        distance2 = np.einsum("nka,nab,nkb->nk", apart, inverse, apart, optimize=True)
        chosen = np.argsort(distance2, axis=1, kind="stable")[:, :max_cells]
        inside = np.take_along_axis(distance2, chosen, 1) < limit
        covered[tuple(cells[np.take_along_axis(near, chosen, 1)[inside]].T)] = True
    return covered


def _vote_along_axes(part: NDArray[np.int32], surface: NDArray[np.bool_], interior: NDArray[np.bool_]) -> None:
    """Give each interior cell the majority part of the first surface cells along the six axes (in place).

    Ties go to the nearest hit; a cell without any hit takes the nearest surface cell's part.
    """
    cells = np.argwhere(interior)
    if len(cells) == 0:
        return
    parts = int(part.max()) + 1
    votes = np.zeros((len(cells), max(parts, 1)))
    for axis in range(3):
        for direction in (1, -1):
            hit, distance = _first_hit(part, surface, axis, direction)
            where = tuple(cells.T)
            found = hit[where] >= 0
            # One vote, plus a tie-breaking crumb that is larger for nearer hits.
            votes[np.flatnonzero(found), hit[where][found]] += 1 + 1e-3 / (1 + distance[where][found])
    part[tuple(cells.T)] = votes.argmax(1)
    lonely = votes.sum(1) == 0
    if lonely.any() and surface.any():
        surface_cells = np.argwhere(surface)
        _, nearest = KDTree(surface_cells).query(cells[lonely])
        part[tuple(cells[lonely].T)] = part[tuple(surface_cells[nearest].T)]


def _first_hit(
    part: NDArray[np.int32], surface: NDArray[np.bool_], axis: int, direction: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Part of, and distance in cells to, the first surface cell that a ray meets; -1 where it meets none."""
    moved_part = np.moveaxis(part, axis, 0)[::direction]
    moved_surface = np.moveaxis(surface, axis, 0)[::direction]
    hit = np.full(moved_part.shape, -1, np.int32)
    distance = np.zeros(moved_part.shape, np.int32)
    current = np.full(moved_part.shape[1:], -1, np.int32)
    steps = np.zeros(moved_part.shape[1:], np.int32)
    for k in range(moved_part.shape[0] - 1, -1, -1):  # from the far end towards the ray's start
        hit[k], distance[k] = current, steps
        current = np.where(moved_surface[k], moved_part[k], current)
        steps = np.where(moved_surface[k], 0, steps) + 1
    return np.moveaxis(hit[::direction], 0, axis), np.moveaxis(distance[::direction], 0, axis)
