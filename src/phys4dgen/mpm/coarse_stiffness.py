"""A coarse model of a body's stiffness, solved exactly: it sees the slow swings that a local solver takes long to find.

Its motions are quadratic B-splines on a grid several times as coarse, as far as free nodes of the fine grid take part.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from phys4dgen.mpm.held import spline_weights
from phys4dgen.mpm.kernels.coarse import add_stiffness

__all__ = ["CoarseStiffness"]

_FINEST, _COARSER = 6.0, 1.25
_MOST_SPLINES = 1000
_LEAST_DIAGONAL = 1e-6  # of the largest
_GUARD = 1e-9  # added to the scaled diagonal
_REACH = 3  # splines that share a particle are no farther apart


class CoarseStiffness:
    """Answers to forces on the nodes of the fine grid, in a space of slow motions."""

    def __init__(
        self,
        used: NDArray[np.int64],
        is_free: NDArray[np.bool_],
        places: NDArray[np.float64],
        field_of: NDArray[np.int32],
        moduli: NDArray[np.float64],
        dx_m: float,
    ) -> None:
        """Assemble and factorise.

        Args:
            used: flat numbers of n nodes of the fine grid, those that forces act on.
            is_free: nodes of the fine grid that may move, [fields, nx, ny, nz].
            places: of the K particles, in cells of the fine grid, [K, 3].
            field_of: field of each, [K].
            moduli: lambda and mu of each times its volume, [2, K].
            dx_m: side of a fine cell.
        """
        nodes = np.stack(np.unravel_index(used, is_free.shape), 1)
        coarsening = _FINEST
        while True:
            lowest, weights = spline_weights(np.arange(max(is_free.shape[1:]))[:, None] / coarsening)
            first = lowest[:, 0] + 1  # the first node lies in cell -1 or 0
            along = weights[..., 0].T
            size = tuple(int(first[n - 1]) + 3 for n in is_free.shape[1:])
            rows, columns, values = _entries(nodes, first, along, (is_free.shape[0], *size))
            splines, numbers = np.unique(columns, return_inverse=True)
            if len(splines) <= _MOST_SPLINES:
                break
            coarsening *= _COARSER
        values = values * is_free.ravel()[used][rows]
        self._spread = sparse.csr_matrix((values, (rows, numbers)), (len(used), len(splines)))
        self._collect = sparse.csr_matrix(self._spread.T)
        number_of = np.full(is_free.shape[0] * int(np.prod(size)), -1, np.int64)
        number_of[splines] = np.arange(len(splines))
        blocks = np.zeros((len(splines), (2 * _REACH + 1) ** 3, 3, 3))
        cell, _ = spline_weights(places)
        add_stiffness(
            np.column_stack([field_of, cell]).astype(np.int64),
            places - cell - 1,
            moduli,
            1 / dx_m,
            np.tile(first, (3, 1)),
            np.tile(along, (3, 1, 1)),
            is_free,
            np.array(size),
            number_of,
            blocks,
        )
        matrix = _matrix(blocks, splines, (is_free.shape[0], *size), number_of)
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


def _entries(
    nodes: NDArray[np.int64], first: NDArray[np.int64], along: NDArray[np.float64], size: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Node, spline and value of each spline at each node [n, 4], field first."""
    rows, columns, values = [], [], []
    field, *place = nodes.T
    for offsets in product(range(3), repeat=3):
        splines = [first[axis] + offset for axis, offset in zip(place, offsets, strict=True)]
        rows.append(np.arange(len(nodes)))
        columns.append(np.ravel_multi_index((field, *splines), size))
        values.append(np.prod([along[axis, offset] for axis, offset in zip(place, offsets, strict=True)], axis=0))
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)


def _matrix(
    blocks: NDArray[np.float64], splines: NDArray[np.int64], size: tuple[int, ...], number_of: NDArray[np.int64]
) -> sparse.csr_matrix:
    """The sparse matrix of the 3 x 3 blocks between each spline and those around it."""
    place = np.stack(np.unravel_index(splines, size))
    rows, columns, values = [], [], []
    for number, offset in enumerate(product(range(-_REACH, _REACH + 1), repeat=3)):
        other = place + np.array([0, *offset])[:, None]
        inside = ((other >= 0) & (other < np.array(size)[:, None])).all(0)
        there = np.flatnonzero(inside)
        target = number_of[np.ravel_multi_index(tuple(other[:, there]), size)]
        there, target = there[target >= 0], target[target >= 0]
        for a, b in product(range(3), repeat=2):
            rows.append(3 * there + a)
            columns.append(3 * target + b)
            values.append(blocks[there, number, a, b])
    count = 3 * len(splines)
    table = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    matrix = sparse.csr_matrix(table, (count, count))
    matrix.eliminate_zeros()
    return matrix
