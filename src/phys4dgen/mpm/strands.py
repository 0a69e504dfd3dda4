"""Nodes that are parted between strands of matter which only come close to each other.

Everything that shares a node of the grid moves with it, so that a leaf that hangs near another one is held by it, over
a gap of up to three cells. That hold lasts until the leaf moves by a part of a cell: then it lets go. Weight must not
rest on it. Here each strand has its own copy of the nodes, where no chain of near particles joins it with the others
around the node (W. Hegemann et al., *A level set method for ductile fracture*, SCA 2013, parts the nodes of a cracked
body this way). Forces that balance on each copy balance on the node as well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from phys4dgen.mpm.kernels.stiffness import part_nodes

__all__ = ["Strands"]

_NEAR_CELLS = 1.1
"""Particles of one piece of matter are joined by steps no longer than this (``interior`` links over one cell)."""


class Strands:
    """The nodes around K particles, with copies.

    Attributes:
        copies: the 27 copies that each particle takes part in, int32 [K, 27].
        node: flat number of the node that each of n copies is of, int64 [n].
    """

    def __init__(self, nodes: NDArray[np.int64], places: NDArray[np.float64], is_free: NDArray[np.bool_]) -> None:
        """Part the nodes; a strand that hangs on nothing for itself keeps to whatever it shares a node with.

        Args:
            nodes: flat number of the 27 nodes of each particle, [K, 27].
            places: of the particles, in cells, [K, 3].
            is_free: whether each node may move, flat.
        """
        flat = nodes.ravel()
        by_node, starts = _sorted(flat)
        copies = np.zeros(len(flat), np.int32)
        loose = np.zeros(len(places), np.bool_)
        count = part_nodes(by_node, starts, places, _NEAR_CELLS, loose, copies)
        loose = _on_nothing(copies, count, is_free[flat])
        if loose.any():
            count = part_nodes(by_node, starts, places, _NEAR_CELLS, loose, copies)
        self.copies = copies.reshape(-1, 27)
        self.node = np.zeros(count, np.int64)
        self.node[copies] = flat


def _sorted(numbers: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The order that sorts, and where each run of equal numbers starts in it, with the length at the end."""
    order = np.argsort(numbers, kind="stable").astype(np.int64)
    ranked = numbers[order]
    starts = np.flatnonzero(np.concatenate([[True], ranked[1:] != ranked[:-1]]))
    return order, np.append(starts, len(ranked)).astype(np.int64)


def _on_nothing(copies: NDArray[np.int32], count: int, entry_is_free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of K particles share copies with nothing that leads to a node that is not free."""
    k = len(copies) // 27
    particle = np.repeat(np.arange(k), 27)
    links = sparse.coo_matrix((np.ones(len(copies), np.int8), (particle, k + copies)), (k + count, k + count))
    _, piece = connected_components(links, directed=False)
    hangs = np.zeros(int(piece.max()) + 1, np.bool_)
    hangs[piece[particle[~entry_is_free]]] = True
    return ~hangs[piece[:k]]
