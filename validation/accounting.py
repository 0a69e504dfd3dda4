"""The work that loads and solids do on a body, told from its frames alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import Body, Frame, Impulse, Settings
from phys4dgen.mpm.fields import Field, Sample
from phys4dgen.mpm.loads import UniformLoad

__all__ = ["Account"]

_GAUSS_POINTS = 5


class Account:
    """Adds up work, frame by frame.

    Gravity and uniform loads do m a . (way of each particle), exactly; fields along the cubic path that has the
    places and velocities of both frames, drag with its mean at both ends, a blow m dv . (v + dv / 2). Moving obstacles
    do -(reaction) . (way). What a drive gives is what is missing in the balance of momentum, so a scene with a drive
    has no held parts; it does that momentum times its velocity, or that of what it drives where solids stop it.

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
                work += share * float(mass @ _work_of_field(load, body, last, frame, mine))
        shifts = frame.obstacle_shifts_m - last.obstacle_shifts_m
        work -= float((frame.reactions_n[: len(shifts)] * shifts).sum())
        given = given - frame.reactions_n.sum(0) * frame_s
        for drive in settings.drives:
            if drive.from_s <= last.time_s < drive.to_s:
                kept = np.exp(-settings.damping_per_s * frame_s)
                missing = frame.momentum_kgms - (last.momentum_kgms + given) * kept
                followed_ms = way[drive.selects(body)].mean(0) / frame_s
                work += max(0.0, float(missing @ np.array(drive.velocity_ms)), float(missing @ followed_ms))
        self.work_j += float(work)
        self._last = frame


def _work_of_field(load: Field, body: Body, last: Frame, frame: Frame, mine: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Work per mass of a field that acts on particles ``mine`` from one frame to the next, [M].

    Fields may turn within a frame (a vortex whose core the particles cross), so the integral of a . dx is taken by
    Gauss' rule along the cubic with the places and velocities of both frames. Drag depends on velocities, which a
    collision changes at once: there the mean of both ends does not take the bend of the cubic for speed.
    """
    step_s = frame.time_s - last.time_s
    mass_kg = body.mass_kg[mine]
    x0, x1 = last.positions_m[mine], frame.positions_m[mine]
    v0, v1 = last.velocities_ms[mine].astype(float), frame.velocities_ms[mine].astype(float)
    work = np.zeros(len(mass_kg))
    for node, weight in zip(*np.polynomial.legendre.leggauss(_GAUSS_POINTS), strict=True):
        s = (1 + node) / 2
        place = (1 + 2 * s) * (1 - s) ** 2 * x0 + s**2 * (3 - 2 * s) * x1
        place += step_s * s * (1 - s) * ((1 - s) * v0 - s * v1)
        slope = 6 * s * (1 - s) * (x1 - x0) + step_s * ((1 - s) * (1 - 3 * s) * v0 + s * (3 * s - 2) * v1)
        felt = load.at(Sample(place, slope / step_s, mass_kg, last.time_s + s * step_s)).acceleration_ms2
        work += weight / 2 * np.einsum("pi,pi->p", felt, slope)
    drag = (_drag(load, Sample(x0, v0, mass_kg, last.time_s)) + _drag(load, Sample(x1, v1, mass_kg, frame.time_s))) / 2
    return work + np.einsum("pi,pi->p", drag, x1 - x0)


def _drag(load: Field, state: Sample) -> NDArray[np.float64]:
    """Acceleration by the air of a field, [M, 3]."""
    answer = load.at(state)
    if answer.drag_per_s is None:
        return np.zeros_like(state.velocities_ms)
    rate = np.broadcast_to(answer.drag_per_s, len(state.mass_kg))[:, None]
    return rate * (np.array(answer.air_ms) - state.velocities_ms)
