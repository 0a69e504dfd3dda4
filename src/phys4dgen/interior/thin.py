"""Where the solid is thin, and what it is there: a sheet (leaf, petal, cloth) or a rod (stem, petiole).

Voxels of half a grid cell cannot say how thick a leaf of one millimetre is; they say where its middle runs. This
module splits the solid into thick and thin voxels and gives each thin voxel the local geometry of the thing it
stands for. Neighbourhoods are walked through the solid, never through the air, so that a leaf does not borrow the
shape of the next leaf. (PHYSICS.md 1.11, MOTION.md technique 4.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import binary_closing, generate_binary_structure

from phys4dgen.interior.morphology import connected_pieces, distance_to_false
from phys4dgen.types import ROD, SHEET

__all__ = ["ThinVoxels", "describe_thin_voxels", "neighbor_graph", "split_thick_and_thin"]

_CORE_EDT = 2.25
"""Voxels whose distance to the outside exceeds this lie in something at least five voxels (2.5 cells, of which the
voxels' own widening is half a cell) thick."""

_RIM_REACH = 6.0
_RIM_FOOT = 0.3
"""Share of a rim's voxels that touch the thick body; of a leaf's or a stem's less than a tenth do."""

_SHEET_REACH = 3
_ROD_REACH = 6
_ROD_RATIO = 0.2
"""A neighbourhood is a rod where its second-largest variance is below this share of the largest."""

_ROD_GROWTH = 2.4
"""So is one that gains no more voxels than this from reach 3 to reach 6: rods and their branchings grow like the
reach (13 / 7), sheets like its square (3.4)."""

_COMPACT_RATIO = 0.5
"""The same growth is seen in a strip wider than the reach, which is no rod: there the near variances are alike."""

_STOUT_RATIO = 0.7
"""Where the Gaussians say that a thing is not flat, this much elongation makes it a rod: a stem where leaves join."""


@dataclass(frozen=True, eq=False)
class ThinVoxels:
    """Local geometry of the T thin voxels.

    Attributes:
        index: voxel indices, [T, 3].
        kind: SHEET or ROD, [T], int8.
        direction: unit normal of the sheet or unit axis of the rod, [T, 3], upright axes.
        middle: centroid of the neighbourhood, in voxels, [T, 3].
    """

    index: NDArray[np.int64]
    kind: NDArray[np.int8]
    direction: NDArray[np.float64]
    middle: NDArray[np.float64]


def split_thick_and_thin(solid: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Thick voxels (a ball of 2.25 voxels fits around them inside the solid) and the thin rest.

    Edges and corners of a thick body, which no ball reaches, belong to the body: a thin remainder that stays within
    three voxels of a thick one is thick, and so is a low rim that stands on it with much of its own breadth.
    """
    core = _edt(solid) > _CORE_EDT
    if not core.any():
        return np.zeros_like(solid), solid.copy()
    # Slits between a carved body and the denser skin around it are gaps of the method, not of the object.
    closed = np.asarray(binary_closing(np.pad(solid, 2), generate_binary_structure(3, 2)), bool)[2:-2, 2:-2, 2:-2]
    solid = solid | (closed & (distance_to_false(~core) <= _CORE_EDT + 1.5))
    core = _edt(solid) > _CORE_EDT
    from_core = distance_to_false(~core)
    thick = solid & (from_core <= _CORE_EDT)
    thin = solid & ~thick
    labels, count = connected_pieces(thin)
    if count:
        reach = np.zeros(count + 1)
        distance = distance_to_false(~thick)[thin]
        np.maximum.at(reach, labels[thin], distance)
        touching = np.bincount(labels[thin][distance < 2], minlength=count + 1)
        foot_share = touching / np.maximum(np.bincount(labels[thin], minlength=count + 1), 1)
        near = (reach <= 3.0) | ((reach <= _RIM_REACH) & (foot_share > _RIM_FOOT))
        near[0] = False
        thick |= near[labels]
    return thick, solid & ~thick


def _edt(solid: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance in voxels to the outside; the border of the array counts as outside."""
    return distance_to_false(np.pad(solid, 1))[1:-1, 1:-1, 1:-1]


def neighbor_graph(index: NDArray[np.int64], shape: tuple[int, ...]) -> sparse.csr_matrix:
    """26-neighbourhood of voxels as a symmetric 0/1 matrix with a full diagonal, [T, T]."""
    padded = np.array(shape) + 2
    number = np.full(padded, -1, np.int64)
    place = index + 1
    number[tuple(place.T)] = np.arange(len(index))
    rows, columns = [], []
    for offset in np.ndindex(3, 3, 3):
        other = number[tuple((place + np.array(offset) - 1).T)]
        found = other >= 0
        rows.append(np.flatnonzero(found))
        columns.append(other[found])
    row, column = np.concatenate(rows), np.concatenate(columns)
    ones = np.ones(len(row), np.float32)
    return sparse.csr_matrix((ones, (row, column)), shape=(len(index), len(index)))


def describe_thin_voxels(thin: NDArray[np.bool_], stout: NDArray[np.bool_] | None = None) -> ThinVoxels:
    """Tell sheets from rods, with the normal or axis and the middle at each thin voxel.

    Args:
        thin: the voxels, [nx, ny, nz].
        stout: for each thin voxel in C order, whether the Gaussians around it are certainly not flat, [T].
    """
    index = np.argwhere(thin)
    if len(index) == 0:
        return ThinVoxels(index, np.zeros(0, np.int8), np.zeros((0, 3)), np.zeros((0, 3)))
    graph = neighbor_graph(index, thin.shape)
    steps = {1: graph}
    for k in range(2, _ROD_REACH + 1):
        steps[k] = steps[k - 1] @ graph
        steps[k].data[:] = 1
    near_middle, near, near_vectors, near_count = _local_moments(index, steps[_SHEET_REACH], _SHEET_REACH + 0.25)
    _, values, vectors, count = _local_moments(index, steps[_ROD_REACH], _ROD_REACH + 0.25)
    rod = values[:, 1] < _ROD_RATIO * np.maximum(values[:, 2], 1e-9)
    rod |= (count < _ROD_GROWTH * near_count) & (near[:, 1] < _COMPACT_RATIO * np.maximum(near[:, 2], 1e-9))
    if stout is not None:
        rod |= stout & (near[:, 1] < _STOUT_RATIO * np.maximum(near[:, 2], 1e-9))
    rod = _majority(rod, steps[2])
    direction = np.where(rod[:, None], vectors[:, :, 2], near_vectors[:, :, 0])
    kind = np.where(rod, ROD, SHEET).astype(np.int8)
    direction = _smooth_direction(direction, kind, steps[2])
    return ThinVoxels(index, kind, direction, near_middle)


def _local_moments(
    index: NDArray[np.int64], reachable: sparse.csr_matrix, radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Centroid, ascending variances, their directions and the count of reachable voxels within ``radius`` of each."""
    pairs = reachable.tocoo()
    apart = index[pairs.row] - index[pairs.col]
    close = (apart * apart).sum(1) <= radius * radius
    weights = sparse.csr_matrix(
        (np.ones(int(close.sum())), (pairs.row[close], pairs.col[close])), shape=reachable.shape
    )
    count = np.asarray(weights.sum(1)).ravel()
    x = index.astype(np.float64)
    products = np.stack([x[:, a] * x[:, b] for a in range(3) for b in range(3)], 1)
    mean = (weights @ x) / count[:, None]
    second = ((weights @ products) / count[:, None]).reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(second - mean[:, :, None] * mean[:, None, :])
    return mean, np.maximum(values, 0), vectors, count


def _majority(flag: NDArray[np.bool_], graph: sparse.csr_matrix) -> NDArray[np.bool_]:
    share = np.asarray(graph @ flag.astype(np.float64)) / np.asarray(graph.sum(1)).ravel()
    return share > 0.5


def _smooth_direction(
    direction: NDArray[np.float64], kind: NDArray[np.int8], graph: sparse.csr_matrix
) -> NDArray[np.float64]:
    """Mean axis of the neighbours of the same kind (of n n^T, since a normal has no sign)."""
    result = direction.copy()
    for value in (SHEET, ROD):
        own = np.flatnonzero(kind == value)
        if len(own) == 0:
            continue
        local = graph[own][:, own]
        n = direction[own]
        dyads = np.stack([n[:, a] * n[:, b] for a in range(3) for b in range(3)], 1)
        _, vectors = np.linalg.eigh((local @ dyads).reshape(-1, 3, 3))
        result[own] = vectors[:, :, 2]
    return result
