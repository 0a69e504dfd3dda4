"""Ground and obstacles during a simulation: where they are in each segment, and what the body does to them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.contacts import CONTACT_KINDS, Entries
from phys4dgen.mpm.obstacles import HalfSpace, Obstacle, RoundedBox
from phys4dgen.mpm.settings import Settings

__all__ = ["Solids"]

_GAP_CELLS = 0.0
"""Nodes at least this deep stop what is soft: a body rests 0.65 to 0.93 cells above the highest of them, which lie up
to one cell deeper."""

_SHELL_CELLS = 4.5  # no particle outside reaches a node deeper than that
_TABLE_COUNT = 23


class Solids:
    """The obstacles of a simulation, in their order, and the ground behind them.

    Attributes:
        count: of all.
        shifts_m: how far each obstacle has moved, at the start of a segment and after it, [O, 3].
        velocities_ms: during the segment, [O, 3].
        given_kgms: momentum that each of all has given since ``forget`` was called, [count, 3].
        state: what changes from frame to frame beside the time: of pushed obstacles how far and how fast they go and
            what resists them, [O, 3].
    """

    def __init__(self, settings: Settings, *, origin_m: NDArray[np.float64], mass_unit_kg: float) -> None:
        self._obstacles = settings.obstacles
        self._origin_m, self._dx_m = origin_m, settings.dx_m
        self._mass_unit_kg = mass_unit_kg
        self._all = self._obstacles
        ground = settings.ground
        if ground is not None:
            plane = HalfSpace((0.0, 0.0, ground.height_m), (0.0, 0.0, 1.0))
            level = Obstacle(plane, contact=ground.contact, friction=ground.friction, restitution=ground.restitution)
            self._all = (*self._obstacles, level)
        self.count = len(self._all)
        self.shifts_m = np.zeros((len(self._obstacles), 3))
        self.velocities_ms = np.zeros((len(self._obstacles), 3))
        self.given_kgms = np.zeros((self.count, 3))
        self.state = np.zeros((len(self._obstacles), 3))
        self._there = np.zeros(len(self._obstacles), np.bool_)

    @property
    def ground_number(self) -> int:
        """Number of the ground."""
        return len(self._obstacles)

    @property
    def always_stand(self) -> bool:
        """Whether none ever moves, comes or goes."""
        return all(obstacle.is_standing for obstacle in self._obstacles)

    def top_speed_ms(self, from_s: float, to_s: float) -> float:
        """The largest speed to reckon with between two times."""
        speeds = [
            float(np.linalg.norm(obstacle.velocity_ms(from_s, to_s)))
            if obstacle.push is None
            else abs(state[1]) + obstacle.push.acceleration_ms2 * (to_s - from_s)
            for obstacle, state in zip(self._obstacles, self.state, strict=True)
            if obstacle.is_there(from_s)
        ]
        return max(speeds, default=0.0)

    def begin(self, from_s: float, to_s: float) -> None:
        """Put every obstacle where it is in the segment between two times."""
        for number, obstacle in enumerate(self._obstacles):
            self._there[number] = obstacle.is_there(0.5 * (from_s + to_s))
            if obstacle.push is None:
                self.shifts_m[number] = obstacle.shift_m(from_s)
                self.velocities_ms[number] = obstacle.velocity_ms(from_s, to_s)
            else:
                travel, speed, resistance_n = self.state[number]
                speed = obstacle.push.next_speed_ms(travel, speed, resistance_n, from_s, to_s)
                way = np.array(obstacle.push.towards)
                self.shifts_m[number], self.velocities_ms[number] = travel * way, speed * way
                self.state[number] = travel + speed * (to_s - from_s), speed, 0.0

    def end(
        self,
        from_s: float,
        to_s: float,
        contacts: tuple[NDArray[Any], ...],
        *,
        kept: float,
        rigid: NDArray[np.float64] | None,
        soft_share: NDArray[np.floating] | None,
    ) -> None:
        """Take the impulses of a segment from the grid's contacts and the rigid groups, and set them to zero.

        Args:
            from_s: start of the segment.
            to_s: its end.
            contacts: of the grid.
            kept: share of velocities that damping leaves in a substep; solids meet what is left and give as much less.
            rigid: impulses on rigid groups, [count, 3], or None without them.
            soft_share: share of the mass at each contact that reads the limited velocity, [fields, K], or None: all.
        """
        nodes, impulses = contacts[1], contacts[3]
        numbered = nodes[:, 3] >= 0
        taken = np.zeros((self.count, 3))
        felt = (impulses if soft_share is None else impulses * soft_share[..., None]).sum(0)
        np.add.at(taken, nodes[numbered, 3], felt[numbered])
        impulses[:] = 0
        if rigid is not None:
            taken += rigid
            rigid[:] = 0
        taken *= self._mass_unit_kg / kept
        self.given_kgms += taken
        self.shifts_m += self.velocities_ms * (to_s - from_s)
        for number, obstacle in enumerate(self._obstacles):
            if obstacle.push is not None:
                self.state[number, 2] = taken[number] @ np.array(obstacle.push.towards) / (to_s - from_s)

    def forget(self) -> None:
        """Begin to add up the momentum given from zero."""
        self.given_kgms[:] = 0

    def entries(self, shift: NDArray[np.int64], nodes: tuple[int, int, int]) -> list[Entries]:
        """Nodes of a grid at which the obstacles stop soft matter, for ``Grid.set_contacts``."""
        return [self._nodes_of(number, shift, nodes) for number in np.flatnonzero(self._there).tolist()]

    def met_by(
        self, points_m: NDArray[np.float64]
    ) -> list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]:
        """(distances [K], outward normals [K, 3], velocity [3]) of every solid that is there from points [K, 3]."""
        found = []
        for number, obstacle in enumerate(self._all):
            if number == self.ground_number:
                found.append((*obstacle.shape.distances(points_m), np.zeros(3)))
            elif self._there[number]:
                moved = self.shifts_m[number]
                found.append((*obstacle.shape.distances(points_m - moved), self.velocities_ms[number]))
        return found

    def _nodes_of(self, number: int, shift: NDArray[np.int64], nodes: tuple[int, int, int]) -> Entries:
        obstacle, dx_m = self._obstacles[number], self._dx_m
        moved = self.shifts_m[number]
        low, high = (corner + moved - self._origin_m for corner in obstacle.shape.box_m)
        first = np.maximum(np.clip(np.floor(low / dx_m), -(2.0**40), 2.0**40).astype(np.int64), shift)
        last = np.clip(np.ceil(high / dx_m), -(2.0**40), 2.0**40).astype(np.int64)
        last = np.minimum(last, shift + np.array(nodes) - 1)
        if (last < first).any():
            return np.zeros((0, 3), np.int64), np.zeros((0, 4), np.int32), np.zeros((0, 7), np.float32)
        axes = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        distance, normals = obstacle.shape.distances(places * dx_m + self._origin_m - moved)
        inside = (distance <= -self._gap_m(obstacle)) & (distance > -_SHELL_CELLS * dx_m)
        count = int(inside.sum())
        kinds = np.tile(np.array([CONTACT_KINDS[obstacle.contact], 1, number, -1], np.int32), (count, 1))
        velocity = np.broadcast_to(self.velocities_ms[number], (count, 3))
        planes = np.column_stack([normals[inside], np.full(count, obstacle.friction), velocity])
        return places[inside], kinds, planes.astype(np.float32)

    def _gap_m(self, obstacle: Obstacle) -> float:
        """How deep the first nodes lie that stop; less in what is so thin that none would."""
        gap_m, shape = _GAP_CELLS * self._dx_m, obstacle.shape
        if isinstance(shape, RoundedBox):
            return min(gap_m, 0.5 * (min(shape.half_m) + shape.radius_m))
        return gap_m

    def table(self) -> NDArray[np.float64]:
        """All solids as ``rigid_contact.strike`` reads them at the start of a segment, [count, 23].

        Columns: shape (0 half space, 1 rounded box, 2 hollow ball), position 3, velocity 3, rotation 9 or normal 3,
        half edges 3, radius, contact kind (-1 where it is not there), friction, restitution.
        """
        table = np.zeros((self.count, _TABLE_COUNT))
        for number, (row, obstacle) in enumerate(zip(table, self._all, strict=True)):
            shape, is_ground = obstacle.shape, number == self.ground_number
            start = np.array(shape.point_m if isinstance(shape, HalfSpace) else shape.center_m)
            row[1:4] = start - self._origin_m + (0.0 if is_ground else self.shifts_m[number])
            row[4:7] = 0.0 if is_ground else self.velocities_ms[number]
            if isinstance(shape, HalfSpace):
                row[7:10] = shape.normal
            elif isinstance(shape, RoundedBox):
                row[0] = 1
                row[7:16], row[16:19], row[19] = shape.rotation.ravel(), shape.half_m, shape.radius_m
            else:
                row[0], row[19] = 2, shape.radius_m
            row[20] = CONTACT_KINDS[obstacle.contact] if is_ground or self._there[number] else -1
            row[21:23] = obstacle.friction, obstacle.restitution
        return table
