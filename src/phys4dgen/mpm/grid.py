"""The background grid: as many whole cells as the body needs, laid anew when the body nears its edge.

Between segments the grid holds no state, so it can move and grow freely; world cells never move, so results do not
depend on where the grid was laid.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.contacts import Entries, contact_arrays, ground_nodes
from phys4dgen.mpm.held import HeldNodes
from phys4dgen.mpm.kernels.sorting import span_rows

__all__ = ["Grid"]

_DRIFT = 1  # cells that a particle may move between two sorts
_ROW = 3  # nodes beyond a particle's lowest node that rows of lanes touch
_GROUP = 4  # nodes of a row of lanes along z
_SPARE = 64  # elements past the end that the last loads may touch


class Grid:
    """Momentum and velocity of a box of nodes, in copies one behind the other along x for several velocity fields.

    Attributes:
        shift: world node of the first node, int64 [3].
        nodes: nodes along x, y, z of one field; nz is a multiple of 4.
        fields: velocity fields.
        momentum: private grids of the chunks, (px, py, pz, mass) per node, float32 [chunks, 4 fields nodes + spare].
        velocity: (vx, vy, vz, mass) per node, float32 [4 fields nodes + spare].
        unblocked: the velocity but for ground and obstacles, for rigid parts, as ``velocity``; empty without them.
        contacts: nodes where something limits the velocity, see ``contacts.contact_arrays``.
        contacts_are_set: whether ``set_contacts`` was called.
        free: 1 where a node may move, 0 where it is held, float32 [nodes + spare].
    """

    def __init__(
        self,
        extent: NDArray[np.int64],
        *,
        chunks: int,
        padding: int,
        held: HeldNodes,
        ground: tuple[int, int, float, int] | None = None,
        with_rigid: bool = False,
        fields: int = 1,
    ) -> None:
        """Lay a grid around particles whose lowest nodes span ``extent`` (low and high along x, y, z).

        ``ground`` is its highest node along z, its kind of contact, its friction and its number.
        """
        self.shift = extent[0::2] - _DRIFT - padding
        self.nodes = self.nodes_for(extent, padding)
        self.fields = fields
        count = int(np.prod(self.nodes))
        self.momentum = np.zeros((chunks, 4 * fields * count + _SPARE), np.float32)
        self.velocity = np.zeros(4 * fields * count + _SPARE, np.float32)
        self.free = np.ones(count + _SPARE, np.float32)
        self._spans = np.zeros((chunks, fields * self.nodes[0], self.nodes[1], 2), np.int32)
        self.unblocked = np.zeros(len(self.velocity) if with_rigid else 0, np.float32)
        self._standing = [held.contacts()]
        if ground is not None:
            self._standing.append(ground_nodes(*ground, shift=self.shift, nodes=self.nodes))
        self.set_contacts(())
        self.contacts_are_set = False
        held.write_to(self.free[:count].reshape(self.nodes), self.shift)

    def set_contacts(self, entries: Sequence[Entries]) -> None:
        """Let these nodes be limited besides those of held parts and ground, which come first."""
        self.contacts = contact_arrays(
            [*self._standing, *entries], shift=self.shift, nodes=self.nodes, fields=self.fields
        )
        self.contacts_are_set = True

    @staticmethod
    def nodes_for(extent: NDArray[np.int64], padding: int) -> tuple[int, int, int]:
        """Nodes along x, y, z that a grid around ``extent`` has."""
        nx, ny, nz = (int(n) for n in extent[1::2] - extent[0::2] + 1 + 2 * (_DRIFT + padding) + _ROW)
        return nx, ny, -(-nz // _GROUP) * _GROUP

    def holds(self, extent: NDArray[np.int64]) -> bool:
        """Whether particles that span ``extent`` may drift until the next sort and stay inside."""
        low, high = extent[0::2] - self.shift, extent[1::2] - self.shift
        return bool((low >= _DRIFT).all() and (high + _DRIFT + _ROW < self.nodes).all())

    @property
    def numbers(self) -> tuple[int, int, int, int, int]:
        """(shift_x, shift_y, shift_z, ny, nz) for the kernels."""
        x, y, z = (int(n) for n in self.shift)
        return x, y, z, self.nodes[1], self.nodes[2]

    def chunk_limits(
        self,
        cells: NDArray[np.int32],
        ranges: NDArray[np.int64],
        extent: NDArray[np.int64],
        field_of_range: NDArray[np.int64],
    ) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Spans [chunks, fields nx, ny, 2] that each chunk may write to, bounds [ranges, chunks, 6] of lowest nodes.

        ``cells`` are the particles' lowest world nodes in sorted order, ``ranges`` as in ``step.advance``.
        """
        planes = field_of_range * self.nodes[0]
        self._spans[:] = 0
        span_rows(cells, ranges, planes, self.shift, self._spans)
        bounds = np.zeros((*ranges.shape[:2], 6), np.int32)
        bounds[..., 2::2] = extent[2::2] - self.shift[1:] - _DRIFT
        bounds[..., 3::2] = extent[3::2] - self.shift[1:] + _DRIFT
        for number, chunk in np.argwhere(ranges[..., 1] > ranges[..., 0]):
            first, last = ranges[number, chunk]
            start = planes[number] - self.shift[0]
            bounds[number, chunk, 0] = cells[0, first] + start - _DRIFT
            bounds[number, chunk, 1] = cells[0, last - 1] + start + _DRIFT
        return self._spans, bounds
