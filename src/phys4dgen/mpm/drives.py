"""Prescribed motion: what moves as it is told, whatever resists (Paper: Sec. C.2, the first kind of force).

A velocity that is written on particles alone loses against the stress of their neighbours, substep by substep. Here the
grid's nodes that belong to driven particles by more than half of their mass get it: inside, the particles then follow
exactly (uniform motion and turns are reproduced by the splines), and what is grown together with them is clamped.

Solids win against drives: where the motion would carry a driven particle into the ground or an obstacle, the whole
drive loses that component of its velocity, so that the part stays on the surface or slides along it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.contacts import Entries
from phys4dgen.mpm.kernels.contact import STICKY
from phys4dgen.mpm.kernels.layout import POSITION
from phys4dgen.mpm.kernels.shares import node_masses
from phys4dgen.mpm.loads import Selection, Vector, checked_vector

__all__ = ["Drive", "DrivenNodes"]

_OWN_SHARE = 0.499  # a node right between driven and free matter is driven
_LEAST_MASS = 1e-6  # of the mean particle mass
_SWEEPS = 8  # over the solids that a drive meets at once

Meet = Callable[[NDArray[np.float64]], list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]]
"""From points [K, 3] to (distance [K], outward normal [K, 3], velocity [3]) of each solid (``Solids.met_by``)."""


@dataclass(frozen=True, eq=False)
class Drive(Selection):
    """The velocity v = u + w x (x - c - u t) of what it means, t from the start of its window.

    Attributes:
        velocity_ms: u.
        spin_rad_s: w.
        center_m: c, a point of the axis at ``from_s``.
        from_s, to_s: the window.
        let_go_s: end of the window of each particle, where they differ, shape [P]; earlier than ``to_s``.
    """

    velocity_ms: Vector = (0.0, 0.0, 0.0)
    spin_rad_s: Vector = (0.0, 0.0, 0.0)
    center_m: Vector = (0.0, 0.0, 0.0)
    from_s: float = 0.0
    to_s: float = math.inf
    let_go_s: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        for name in ("velocity_ms", "spin_rad_s", "center_m"):
            object.__setattr__(self, name, checked_vector(getattr(self, name), name))
        if not (math.isfinite(self.from_s) and self.from_s < self.to_s):
            raise ValueError(f"from_s, to_s: expected from_s < to_s, got {self.from_s} and {self.to_s}.")

    def velocities_ms(self, points_m: NDArray[np.float64], time_s: float) -> NDArray[np.float64]:
        """The velocity at points [K, 3]."""
        u = np.array(self.velocity_ms)
        arms = points_m - np.array(self.center_m) - u * (time_s - self.from_s)
        return u + np.cross(np.array(self.spin_rad_s), arms)

    def drives(self, body: Body, time_s: float) -> NDArray[np.bool_]:
        """Particles of ``body`` that it drives now, [P]."""
        if not self.from_s <= time_s < self.to_s:
            return np.zeros(len(body), np.bool_)
        meant = self.selects(body)
        return meant if self.let_go_s is None else meant & (time_s < self.let_go_s)


class DrivenNodes:
    """The drives of one body."""

    def __init__(self, body: Body, drives: Sequence[Drive], *, origin_m: NDArray[np.float64], dx_m: float) -> None:
        """Prepare; raises SimulationError where a drive names a part that does not exist."""
        self._body, self._drives = body, tuple(drives)
        self._origin_m, self._dx_m = origin_m, dx_m
        self._radii_m = np.cbrt(body.volume_m3) / 2
        self._places = [body.positions_m[drive.selects(body)] for drive in drives]

    def top_speed_ms(self, time_s: float) -> float:
        """The largest velocity that is set now."""
        speeds = [
            float(np.linalg.norm(drive.velocities_ms(places, drive.from_s), axis=1).max(initial=0.0))
            for drive, places in zip(self._drives, self._places, strict=True)
            if drive.from_s <= time_s < drive.to_s
        ]
        return max(speeds, default=0.0)

    def entries(
        self,
        columns: NDArray[np.float32],
        numbers: NDArray[np.int64],
        fields: NDArray[np.int32],
        *,
        from_s: float,
        to_s: float,
        solids: Meet,
        shift: NDArray[np.int64],
        nodes: tuple[int, int, int],
    ) -> list[Entries]:
        """Nodes with a velocity that is set, for ``contacts.contact_arrays``, in a grid as ``grid.Grid`` has it.

        Args:
            columns: of the particles, see ``kernels.layout``.
            numbers: number in the body of each.
            fields: velocity field of each.
            from_s: start of the segment.
            to_s: its end.
            solids: ground and obstacles at its start.
            shift: world node of the grid's first node.
            nodes: nodes of the grid along x, y, z.
        """
        time_s = 0.5 * (from_s + to_s)
        owner = np.full(len(self._body), -1, np.int32)
        for number, drive in enumerate(self._drives):
            owner[drive.drives(self._body, time_s)] = number
        found = []
        present = np.unique(owner[owner >= 0])
        if len(present) == 0:
            return []
        owner_of_column = owner[numbers]
        total, own = np.zeros((2, *nodes), np.float32)
        for number in present:
            drive = self._drives[number]
            mine = owner_of_column == number
            points = columns[POSITION : POSITION + 3, mine].T.astype(np.float64) + self._origin_m
            yielded = _yielded_ms(
                drive.velocities_ms(points, time_s), solids(points), self._radii_m[numbers[mine]], to_s - from_s
            )
            for field in np.unique(fields[mine]):
                total[:], own[:] = 0, 0
                there = fields == field
                inverse_dx = np.float32(1 / self._dx_m)
                node_masses(columns[:, there], mine[there].astype(np.float32), inverse_dx, shift, total, own)
                places = np.argwhere((own > _OWN_SHARE * total) & (own > _LEAST_MASS)) + shift
                kinds = np.tile(np.array([STICKY, 0, -1, field], np.int32), (len(places), 1))
                planes = np.zeros((len(places), 7), np.float32)
                planes[:, 4:] = drive.velocities_ms(places * self._dx_m + self._origin_m, time_s) + yielded
                found.append((places, kinds, planes))
        return found


def _yielded_ms(
    velocities_ms: NDArray[np.float64],
    solids: list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]],
    radii_m: NDArray[np.float64],
    time_s: float,
) -> NDArray[np.float64]:
    """What the solids that driven particles would enter within a time take from the velocity of all of them, [3].

    Args:
        velocities_ms: that are set, [K, 3].
        solids: see ``Meet``, for the K particles.
        radii_m: half their size, [K].
        time_s: ahead.
    """
    change = np.zeros(3)
    for _ in range(_SWEEPS):
        unchanged = True
        for distances, normals, surface_ms in solids:
            set_speed = np.einsum("ki,ki->k", velocities_ms, normals)
            # a drive that stands still, as a pin does, stands against a solid that comes
            slowest = np.minimum(normals @ surface_ms, 0.0) - np.maximum(distances - radii_m, 0.0) / time_s
            missing = np.where(set_speed < 0, slowest - set_speed - normals @ change, 0.0)
            worst = int(missing.argmax())
            if missing[worst] > 1e-9 * abs(set_speed[worst]):
                change += missing[worst] * normals[worst]
                unchanged = False
        if unchanged:
            break
    return change
