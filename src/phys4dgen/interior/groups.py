"""Which particles hang together: groups of points within reach of each other.

A solid body of a million voxels has a hundred million pairs of near neighbours. Its inside is connected by being a
lattice, so only its outermost voxels are compared with anything else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from phys4dgen.interior.morphology import connected_pieces, outermost_layer

__all__ = ["body_surface", "graph_components", "particle_groups", "point_groups"]


def graph_components(pairs: NDArray[np.int64], count: int) -> NDArray[np.int32]:
    """Component of each of ``count`` nodes joined by ``pairs`` [E, 2], [count]."""
    graph = sparse.csr_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def point_groups(
    position: NDArray[np.float64], reach: float, *, body: NDArray[np.int32] | None = None
) -> NDArray[np.int32]:
    """Group of each point: points within ``reach`` of each other hang together, and so on.

    Args:
        position: points, [S, 3].
        reach: in the unit of the points.
        body: points of equal number belong together at any distance; -1 belongs to nothing, [S].
    """
    pairs = KDTree(position).query_pairs(reach, output_type="ndarray")
    if body is not None:
        own = np.flatnonzero(body >= 0)
        _, first, number = np.unique(body[own], return_index=True, return_inverse=True)
        pairs = np.concatenate([pairs, np.stack([own, own[first[number]]], 1)])
    return graph_components(pairs, len(position))


def body_surface(index: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.int32]]:
    """Whether each voxel [V, 3] of a body is an outermost one, and its connected piece from 0."""
    if len(index) == 0:
        return np.zeros(0, bool), np.zeros(0, np.int32)
    place = tuple((index - index.min(0) + 1).T)
    solid = np.zeros(np.ptp(index, axis=0) + 3, bool)
    solid[place] = True
    return outermost_layer(solid)[place], (connected_pieces(solid)[0][place] - 1).astype(np.int32)


def particle_groups(middle: NDArray[np.float64], is_voxel: NDArray[np.bool_], reach: float) -> NDArray[np.int32]:
    """Group of each particle by the distance of the middles (mid-surface, centre line, or the voxel itself).

    Args:
        middle: voxels, [P, 3]; particles of one site follow each other.
        is_voxel: particles of solid voxels, whose middles are whole numbers, [P].
        reach: at least the diagonal of a voxel.
    """
    voxel, other = np.flatnonzero(is_voxel), np.flatnonzero(~is_voxel)
    outer, piece = body_surface(np.rint(middle[voxel]).astype(np.int64))
    new_site = np.ones(len(other), bool)
    new_site[1:] = (middle[other[1:]] != middle[other[:-1]]).any(1)
    sites = other[new_site]
    group = point_groups(
        np.concatenate([middle[voxel[outer]], middle[sites]]),
        reach,
        body=np.concatenate([piece[outer], np.full(len(sites), -1, np.int32)]),
    )
    of_piece = np.zeros(int(piece.max(initial=-1)) + 1, np.int32)
    of_piece[piece[outer]] = group[: int(outer.sum())]
    found = np.zeros(len(middle), np.int32)
    found[voxel] = of_piece[piece]
    found[other] = group[int(outer.sum()) :][np.cumsum(new_site) - 1]
    return found
