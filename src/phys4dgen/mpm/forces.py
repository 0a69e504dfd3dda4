"""Loads as what the kernels take: the velocity that nodes and particles gain in each substep.

What acts on everything alike acts on the grid. All else is added to the momentum that particles give to the grid, so
that held nodes resist it, by rows of *kicks*: particles under the same loads share a row; where there are fields every
particle has its own, constant over a segment. Windows are integrated exactly over each substep, with fields over each
segment. Without loads there are no rows, and nothing is paid for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.fields import Field, Sample
from phys4dgen.mpm.loads import Load, UniformLoad
from phys4dgen.mpm.settings import Settings

__all__ = ["Kicks", "planned_speed_gain_ms"]


class Kicks:
    """The loads on one body.

    Attributes:
        row_of: row of the kicks of each particle of the body, int64 [P].
        has_fields: whether positions and velocities are needed for each segment.
    """

    def __init__(
        self, body: Body, *, gravity_ms2: Sequence[float], loads: Sequence[Load], origin_m: NDArray[np.float64]
    ) -> None:
        """Prepare.

        Args:
            body: as simulated.
            gravity_ms2: acceleration of everything.
            loads: uniform ones and fields.
            origin_m: of the positions that ``gains`` gets.

        Raises:
            SimulationError: a load names a part that does not exist.
        """
        self._gravity = np.asarray(gravity_ms2, np.float64)
        self._mass_kg = body.mass_kg
        self._origin_m = origin_m
        uniform = [(load, load.selects(body)) for load in loads if isinstance(load, UniformLoad)]
        self._everywhere = [(load, self._mass_of(mask)) for load, mask in uniform if load.is_everything]
        self._partial = [(load, mask, self._mass_of(mask)) for load, mask in uniform if not load.is_everything]
        self._fields = [(load, load.selects(body)) for load in loads if isinstance(load, Field)]
        self.has_fields = bool(self._fields)
        p = len(body)
        if self.has_fields:
            self.row_of = np.arange(p)
            self._members = [mask for _, mask, _ in self._partial]
        elif self._partial:
            membership = np.stack([mask for _, mask, _ in self._partial], 1)
            combinations, row_of = np.unique(membership, axis=0, return_inverse=True)
            self.row_of = row_of.reshape(-1)
            self._members = list(combinations.T)
        else:
            self.row_of = np.zeros(p, np.int64)
            self._members = []

    def _mass_of(self, mask: NDArray[np.bool_]) -> float:
        return max(float(self._mass_kg[mask].sum()), 1e-300)

    def gains(
        self,
        times_s: NDArray[np.float64],
        *,
        index: NDArray[np.int64],
        positions_m: NDArray[np.float64],
        velocities_ms: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What happens to velocities in the S substeps of a segment.

        Args:
            times_s: S + 1 times that bound the substeps.
            index: numbers in the body of M particles, [M]; the others are not asked about.
            positions_m: their positions from the origin; used by fields only.
            velocities_ms: their velocities.

        Returns:
            (velocity gained by everything [S, 3], kicks (k, beta) by row: v <- v + k - beta v, [S or 1 or 0, rows, 4]).
        """
        everything = np.diff(times_s)[:, None] * self._gravity
        for load, mass in self._everywhere:
            everything += np.diff(load.gained_ms(times_s, mass), axis=0)
        if not self._members and not self._fields:
            return everything, np.zeros((len(everything), 0, 4))
        if self.has_fields:
            return everything, self._particle_kicks(times_s, index, positions_m, velocities_ms)
        kicks = np.zeros((len(everything), len(self._members[0]), 4))
        for (load, _, mass), rows in zip(self._partial, self._members, strict=True):
            kicks[:, rows, :3] += np.diff(load.gained_ms(times_s, mass), axis=0)[:, None]
        return everything, kicks

    def _particle_kicks(
        self,
        times_s: NDArray[np.float64],
        index: NDArray[np.int64],
        positions_m: NDArray[np.float64],
        velocities_ms: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """One row per particle of the body, the same in all substeps, [1, P, 4]."""
        substeps, p = len(times_s) - 1, len(self._mass_kg)
        dt_s = (times_s[-1] - times_s[0]) / substeps
        gained, rate, drawn = np.zeros((p, 3)), np.zeros(p), np.zeros((p, 3))
        for (load, _, mass), mask in zip(self._partial, self._members, strict=True):
            gained[mask] += np.diff(load.gained_ms(times_s[[0, -1]], mass), axis=0)[0] / substeps
        for field, mask in self._fields:
            open_s = float(np.diff(field.open_s(times_s[[0, -1]]))[0]) / substeps
            here = mask[index]
            if open_s <= 0 or not here.any():
                continue
            mine = index[here]
            # where the particle will be in the middle of the segment: of second order, and keeps the energy of orbits
            middle_m = positions_m[here] + 0.5 * substeps * dt_s * velocities_ms[here] + self._origin_m
            answer = field.at(Sample(middle_m, velocities_ms[here], self._mass_kg[mine], float(times_s.mean())))
            gained[mine] += open_s * answer.acceleration_ms2
            if answer.drag_per_s is not None:
                share = answer.drag_per_s * (open_s / dt_s)
                rate[mine] += share
                drawn[mine] += share[:, None] * np.array(answer.air_ms)
        beta = -np.expm1(-rate * dt_s)
        # beta (w - v) with w the mean of the winds, each weighted by its rate
        gained += (beta / np.maximum(rate, 1e-300))[:, None] * drawn
        return np.concatenate([gained, beta[:, None]], 1)[None]

    def peak_acceleration_ms2(
        self,
        from_s: float,
        to_s: float,
        *,
        index: NDArray[np.int64],
        positions_m: NDArray[np.float64],
        velocities_ms: NDArray[np.float64],
    ) -> float:
        """An upper bound of the acceleration that loads cause between two times, fields taken as they are at first."""
        total = float(np.linalg.norm(self._gravity))
        times = np.array([from_s, to_s])
        for load, mass in [*self._everywhere, *((load, mass) for load, _, mass in self._partial)]:
            if load.from_s < to_s and load.to_s > from_s:
                gained = np.linalg.norm(np.diff(load.gained_ms(times, mass), axis=0))
                total += max(float(gained) / (to_s - from_s), load.peak_ms2(mass))
        if self.has_fields:
            kicks = self._particle_kicks(times, index, positions_m, velocities_ms)[0, index]
            change = kicks[:, :3] - kicks[:, 3:] * velocities_ms
            total += float(np.linalg.norm(change, axis=1).max(initial=0.0)) / (to_s - from_s)
        return total


def planned_speed_gain_ms(body: Body, settings: Settings) -> float:
    """An upper bound of the speed that loads give during the first frame."""
    assert body.velocities_ms is not None
    moving = np.flatnonzero(~body.held)
    origin = np.zeros(3)
    kicks = Kicks(body, gravity_ms2=settings.gravity_ms2, loads=settings.loads, origin_m=origin)
    peak = kicks.peak_acceleration_ms2(
        0.0,
        settings.frame_time_s,
        index=moving,
        positions_m=body.positions_m[moving],
        velocities_ms=body.velocities_ms[moving],
    )
    return peak * settings.frame_time_s
