"""Velocity fields: bodies that must not weld are carried by copies of the grid, and meet where they share nodes.

On one grid everything closer than about two cells moves as one. Particles with different ``Body.body_id`` get
different fields while their boxes of nodes overlap; bodies that are far apart share one, so that a few fields (and
often one) serve many bodies: a greedy colouring of their neighbourhood, anew at every sort.

Where two fields share a node, the plane that parts them is the one with the widest gap between the particles around the
node, searched from the volume gradients of either field and of both and the way from one centre of volume to the other.
Flat faces, edges and thin sheets so get their true normals and gaps, where gradients alone tilt at edges (J. A. Nairn
et al., CMAME 362 (2020) 112859, on finding planes from particles).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.kernels.pair_contact import MOMENTS, field_moments, list_particles, widest_gaps

__all__ = ["VelocityFields", "no_pairs"]

_DRIFT = 1  # cells that a particle may move between two sorts
_REACH = 2  # nodes beyond a particle's lowest one
_LEAST_VOLUME = 1e-9  # in cells; less matter at a node is none
_LEAST_LENGTH = 1e-6

Pairs = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]
"""See ``kernels.pair_contact.limit_pairs``."""


def no_pairs(rows: int) -> Pairs:
    """Of a grid with so many rows where no fields meet."""
    return (
        np.zeros(rows + 1, np.int32),
        np.zeros((0, 3), np.int32),
        np.zeros((0, 4), np.float32),
        np.zeros(0, np.float32),
    )


class VelocityFields:
    """Which body is in which field, from sort to sort.

    Attributes:
        of_range: field of each range of particles, int64 [ranges].
        count: of the fields in use.
    """

    def __init__(self, body_of_range: NDArray[np.int64]) -> None:
        """Prepare for ranges of particles that belong to bodies 0 .. B - 1."""
        self._body_of_range = body_of_range
        self.of_range = np.zeros(len(body_of_range), np.int64)
        self.count = 1
        self._shared: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []

    def assign(self, cells: NDArray[np.int32], ranges: NDArray[np.int64]) -> None:
        """Give bodies that may meet before the next sort different fields.

        Args:
            cells: lowest node of each particle, int32 [3, stride].
            ranges: first and one past the last particle of each range in each chunk, int64 [ranges, chunks, 2].
        """
        bodies = int(self._body_of_range.max()) + 1
        if bodies == 1:
            return
        low, high = np.full((bodies, 3), 2**30), np.full((bodies, 3), -(2**30))
        for body, of_range in zip(self._body_of_range, ranges, strict=True):
            mine = cells[:, of_range[0, 0] : of_range[-1, 1]]
            low[body] = np.minimum(low[body], mine.min(1))
            high[body] = np.maximum(high[body], mine.max(1) + _REACH)
        first, last = low - _DRIFT, high + _DRIFT
        before = np.asarray((first[:, None] <= last[None]).all(2))
        near = before & before.T
        field = np.zeros(bodies, np.int64)
        self._shared = []
        for body in range(bodies):
            neighbours = np.flatnonzero(near[body, :body])
            field[body] = min(set(range(body + 1)) - set(field[neighbours].tolist()))
            self._shared += [(np.maximum(low[body], low[n]), np.minimum(high[body], high[n])) for n in neighbours]
        self.of_range = field[self._body_of_range]
        self.count = int(field.max()) + 1

    def of_particles(self, ranges: NDArray[np.int64]) -> NDArray[np.int32]:
        """Field of the particle at each place, int32 [stride]."""
        lengths = ranges[:, -1, 1] - ranges[:, 0, 0]
        return np.repeat(self.of_range, lengths).astype(np.int32)

    def pairs(
        self,
        columns: NDArray[np.float32],
        ranges: NDArray[np.int64],
        is_fluid: NDArray[np.float32],
        *,
        dx_m: float,
        mass_unit_kg: float,
        friction: float,
        shift: NDArray[np.int64],
        nodes: tuple[int, int, int],
    ) -> Pairs:
        """Where fields meet in a grid of ``nodes`` whose first is the world node ``shift``, for ``limit_pairs``.

        ``is_fluid`` is 1 for particles that slide without Coulomb's friction.
        """
        shared = [(low, high) for low, high in self._shared if (low <= high).all()]
        rows = nodes[0] * nodes[1]
        if not shared:
            return no_pairs(rows)
        first = np.maximum(np.min([low for low, _ in shared], axis=0), shift)
        last = np.minimum(np.max([high for _, high in shared], axis=0), shift + np.array(nodes) - 1)
        size = tuple(int(n) for n in last - first + 1)
        field_of = self.of_particles(ranges)
        moments = np.zeros((self.count, *size, MOMENTS), np.float32)
        field_moments(columns, field_of, is_fluid, 1 / dx_m, mass_unit_kg, first, moments)
        present = moments[..., 0] > _LEAST_VOLUME
        found = [
            np.column_stack([np.argwhere(present[a] & present[b]), np.full((n, 2), (a, b))])
            for a in range(self.count)
            for b in range(a + 1, self.count)
            if (n := int((present[a] & present[b]).sum()))
        ]
        if not found:
            return no_pairs(rows)
        table = np.concatenate(found)
        row = (table[:, 0] + first[0] - shift[0]) * nodes[1] + table[:, 1] + first[1] - shift[1]
        order = np.lexsort((table[:, 2], row))
        table, row = table[order], row[order]
        node_of_row, slots = np.unique(np.ravel_multi_index(tuple(table[:, :3].T), size), return_inverse=True)
        numbers = np.full(size, -1, np.int32)
        numbers.reshape(-1)[node_of_row] = np.arange(len(node_of_row))
        bounds = np.zeros(len(node_of_row) + 1, np.int64)
        list_particles(columns, 1 / dx_m, first, numbers, bounds[1:], np.zeros(0, np.int32))
        bounds = np.cumsum(bounds)
        members = np.zeros(bounds[-1], np.int32)
        list_particles(columns, 1 / dx_m, first, numbers, bounds[:-1].copy(), members)
        found_planes = np.zeros((len(table), 4), np.float32)
        where, candidates = table[:, :3] + first, _candidates(moments, table)
        sides = np.ascontiguousarray(table[:, 3:])
        widest_gaps(
            columns, field_of, 1 / dx_m, mass_unit_kg, where, slots, bounds, members, sides, candidates, found_planes
        )
        starts = np.searchsorted(row, np.arange(rows + 1)).astype(np.int32)
        place = np.column_stack([table[:, 2] + first[2] - shift[2], table[:, 3:]]).astype(np.int32)
        gaps_m = np.ascontiguousarray(found_planes[:, 3] * dx_m, np.float32)
        share = moments[..., 7] / np.maximum(moments[..., 0], _LEAST_VOLUME)
        x, y, z, a, b = table.T
        found_planes[:, 3] = friction * (1 - np.maximum(share[a, x, y, z], share[b, x, y, z]))
        return starts, place, found_planes, gaps_m


def _candidates(moments: NDArray[Any], table: NDArray[np.int64]) -> NDArray[np.float32]:
    """Normals from the first to the second field of each pair [K, CANDIDATES, 3]; a line of moments where one fails."""
    x, y, z, a, b = table.T
    of_a, of_b = moments[a, x, y, z].astype(np.float64), moments[b, x, y, z].astype(np.float64)
    apart = of_b[:, 4:7] / of_b[:, :1] - of_a[:, 4:7] / of_a[:, :1]
    wanted = np.stack([of_b[:, 1:4] - of_a[:, 1:4], -of_a[:, 1:4], of_b[:, 1:4], apart], 1)
    length = np.linalg.norm(wanted, axis=2, keepdims=True)
    upright = np.broadcast_to([0.0, 0.0, 1.0], wanted.shape)
    unit = np.where(length > _LEAST_LENGTH, wanted / np.maximum(length, _LEAST_LENGTH), upright)
    # a candidate against the way from one centre to the other would swap the sides
    turned = np.einsum("kci,ki->kc", unit, apart) < 0
    return np.where(turned[..., None], -unit, unit).astype(np.float32)
