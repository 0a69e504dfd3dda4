"""A coarse model of a body's stiffness, solved exactly: it sees the slow swings that a local solver takes long to find.

Its motions are quadratic B-splines on a grid several times as coarse, as far as free nodes of the fine grid take part.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from phys4dgen.mpm.held import spline_weights
from phys4dgen.mpm.kernels.coarse import add_stiffness
from phys4dgen.mpm.strands import Strands

__all__ = ["CoarseStiffness"]

_FINEST, _COARSER = 6.0, 1.25
_MOST_SPLINES = 1000
_LEAST_DIAGONAL = 1e-6  # of the largest
_GUARD = 1e-9  # added to the scaled diagonal


class CoarseStiffness:
    """Answers to forces on the nodes of the fine grid, in a space of slow motions."""

    def __init__(
        self,
        strands: Strands,
        is_free: NDArray[np.bool_],
        places: NDArray[np.float64],
        moduli: NDArray[np.float64],
        dx_m: float,
    ) -> None:
        """Assemble and factorise.

        Args:
            strands: the n nodes of the fine grid around the K particles, which forces act on.
            is_free: nodes of the fine grid that may move, [fields, nx, ny, nz].
            places: of the particles, in cells of the fine grid, [K, 3].
            moduli: lambda and mu of each times its volume, [K, 2].
            dx_m: side of a fine cell.
        """
        nodes = np.stack(np.unravel_index(strands.node, is_free.shape), 1)[:, 1:]
        free = is_free.ravel()[strands.node]
        coarsening = _FINEST
        while True:
            lowest, weights = spline_weights(np.arange(max(is_free.shape[1:]))[:, None] / coarsening)
            first = lowest[:, 0] + 1  # the first node lies in cell -1 or 0
            along = weights[..., 0].T
            number_of = _splines(strands.copies, first[nodes])
            count = int(number_of.max()) + 1
            if count <= _MOST_SPLINES:
                break
            coarsening *= _COARSER
        values = np.stack(
            [
                along[nodes[:, 0], i] * along[nodes[:, 1], j] * along[nodes[:, 2], k]
                for i, j, k in product(range(3), repeat=3)
            ],
            1,
        )
        rows = np.repeat(np.arange(len(nodes)), 27)
        entries = (values * free[:, None]).ravel(), (rows, number_of.ravel())
        self._spread = sparse.csr_matrix(entries, (len(nodes), count))
        self._collect = sparse.csr_matrix(self._spread.T)
        blocks = np.zeros((count, count, 3, 3))
        cell, _ = spline_weights(places)
        add_stiffness(
            strands.copies,
            cell,
            places - cell - 1,
            moduli,
            1 / dx_m,
            np.tile(first, (3, 1)),
            np.tile(along, (3, 1, 1)),
            free,
            number_of,
            blocks,
        )
        matrix = sparse.csr_matrix(blocks.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count))
        diagonal = matrix.diagonal()
        self._kept = np.flatnonzero(diagonal > _LEAST_DIAGONAL * diagonal.max())
        self._scale = 1 / np.sqrt(diagonal[self._kept])
        own = sparse.diags(self._scale)
        inner = own @ matrix[self._kept][:, self._kept] @ own + _GUARD * sparse.eye(len(self._kept))
        self._solve = splu(sparse.csc_matrix(inner), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve

    def answer(self, forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """Displacements [n, 3] under forces [n, 3]."""
        collected = np.asarray(self._collect @ forces)
        found = np.zeros(collected.size)
        found[self._kept] = self._scale * self._solve(self._scale * collected.ravel()[self._kept])
        return np.asarray(self._spread @ found.reshape(-1, 3))


def _splines(copies: NDArray[np.int32], first: NDArray[np.int64]) -> NDArray[np.int32]:
    """Numbers of the 27 splines that reach each of n nodes, [n, 27]; like nodes, splines are parted between strands.

    Args:
        copies: the 27 nodes around each particle, [K, 27].
        first: first spline that reaches a node along each axis, [n, 3].
    """
    block, n = copies.reshape(-1, 3, 3, 3).astype(np.int64), len(first)
    own = np.arange(27)
    ends: list[NDArray[np.int64]] = []
    for axis, step in enumerate((9, 3, 1)):
        here, there = np.delete(block, 2, axis + 1).ravel(), np.delete(block, 0, axis + 1).ravel()
        here, there = np.divmod(np.unique(here * n + there), n)
        farther = (first[there, axis] > first[here, axis])[:, None]
        shared = ~farther | (own // step % 3 > 0)
        pair = np.stack([27 * here[:, None] + own, 27 * there[:, None] + own - step * farther])
        ends.append(pair[:, shared])
    start, end = np.concatenate(ends, 1)
    links = sparse.coo_matrix((np.ones(len(start), np.int8), (start, end)), (27 * n, 27 * n))
    return np.asarray(connected_components(links, directed=False)[1], np.int32).reshape(n, 27)
