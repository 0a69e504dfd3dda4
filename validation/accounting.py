"""The work that loads and solids do on a body, told from its frames alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import Body, Frame, Impulse, Settings
from phys4dgen.mpm.fields import Field
from phys4dgen.mpm.loads import UniformLoad

__all__ = ["Account"]


class Account:
    """Adds up work, frame by frame.

    Gravity and uniform loads do m a . (way of each particle), exactly; fields the same with the mean of their
    accelerations at both ends of a frame, a blow m dv . (v + dv / 2). Moving obstacles do -(reaction) . (way). What a
    drive gives is what is missing in the balance of momentum, so a scene with a drive has no held parts; it does that
    momentum times the drive's velocity.

    Attributes:
        work_j: done so far.
    """

    def __init__(self, body: Body, settings: Settings, start: Frame) -> None:
        if settings.drives and (body.held.any() or any(isinstance(load, Field) for load in settings.loads)):
            raise ValueError("the work of a drive cannot be told from outside beside held parts or fields.")
        self._body, self._settings, self._last = body, settings, start
        self._mass_kg = np.where(body.held, 0.0, body.mass_kg)
        self.work_j = 0.0

    def add(self, frame: Frame) -> None:
        """Take the work since the frame before."""
        body, settings, last = self._body, self._settings, self._last
        way = frame.positions_m - last.positions_m
        times = np.array([last.time_s, frame.time_s])
        frame_s = frame.time_s - last.time_s
        gravity = np.array(settings.gravity_ms2)
        work = self._mass_kg @ (way @ gravity)
        given = self._mass_kg.sum() * gravity * frame_s
        for load in settings.loads:
            mine = load.selects(body)
            mass = self._mass_kg[mine]
            if isinstance(load, UniformLoad):
                gained = np.diff(load.gained_ms(times, float(mass.sum())), axis=0)[0]
                given = given + mass.sum() * gained
                if isinstance(load, Impulse):
                    work += mass @ (last.velocities_ms[mine] @ gained + gained @ gained / 2)
                else:
                    work += mass @ (way[mine] @ gained) / frame_s
            elif isinstance(load, Field):
                share = float(np.diff(load.open_s(times))[0]) / frame_s
                felt = (_felt(load, body, last, mine) + _felt(load, body, frame, mine)) / 2
                work += share * (mass @ np.einsum("pi,pi->p", felt, way[mine]))
        shifts = frame.obstacle_shifts_m - last.obstacle_shifts_m
        work -= float((frame.reactions_n[: len(shifts)] * shifts).sum())
        given = given - frame.reactions_n.sum(0) * frame_s
        for drive in settings.drives:
            if drive.from_s <= last.time_s < drive.to_s:
                kept = np.exp(-settings.damping_per_s * frame_s)
                missing = frame.momentum_kgms - (last.momentum_kgms + given) * kept
                work += max(0.0, float(missing @ np.array(drive.velocity_ms)))
        self.work_j += float(work)
        self._last = frame


def _felt(load: Field, body: Body, frame: Frame, mine: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Acceleration by a field of the particles it means, [M, 3]."""
    v = frame.velocities_ms[mine].astype(float)
    answer = load.at(frame.positions_m[mine], v, body.mass_kg[mine], frame.time_s)
    if answer.drag_per_s is None:
        return answer.acceleration_ms2
    rate = np.broadcast_to(answer.drag_per_s, len(v))[:, None]
    return answer.acceleration_ms2 + rate * (np.array(answer.air_ms) - v)
