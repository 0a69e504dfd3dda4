"""Waves along bars: axial vibration, pulses, two materials (B4, B5, B8, B9, B9b)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import HalfSpace, LawId, Obstacle, Settings, Simulator
from validation.bodies import STRONG, body, lattice
from validation.case import Check, Outcome, benchmark
from validation.chart import Chart, Curve
from validation.signals import frequency_hz

__all__ = ["fixed_free_bar", "free_bar", "pulse", "two_materials"]

_SOLIDS = tuple(law for law in LawId if law is not LawId.FLUID)


@benchmark(
    "B4",
    "Free bar rings along its axis",
    source="Wave equation: f = sqrt(E / rho) / 2L",
    variants={
        "16 cells": {"cells": 16, "tolerance": 0.02},
        "64 cells": {"cells": 64},
        **{law.name.lower(): {"law": law} for law in _SOLIDS},
    },
    in_tests=("neo_hookean", "fixed_corotated"),
)
def free_bar(*, cells: int = 32, law: LawId = LawId.NEO_HOOKEAN, tolerance: float = 0.01) -> Outcome:
    """A free bar (E 1e5 Pa, nu = 0) of 3 x 3 cells starts in its first axial mode; laws are far below their yield."""
    dx, E, rho = 0.01, 1e5, 1000.0
    length, c = cells * dx, np.sqrt(E / rho)
    x = lattice((2 * cells, 6, 6), dx / 2)
    v = np.zeros_like(x)
    v[:, 0] = 0.01 * np.cos(np.pi * x[:, 0] / length)
    period = 2 * length / c
    b = body(x, (dx / 2) ** 3, E=E, rho=rho, nu=0.0, law=law, v=v, **STRONG)
    simulator = Simulator(b, Settings(dx, period / 20))
    right, left = x[:, 0] > length - dx, x[:, 0] < dx
    found = []
    for _ in range(80):
        positions = simulator.advance().positions_m
        found.append(positions[right, 0].mean() - positions[left, 0].mean())
    f = frequency_hz(np.array(found), period / 20)
    return Outcome((Check.share("frequency, Hz", f, expected=1 / period, tolerance=tolerance),))


@benchmark(
    "B5",
    "Bar held at one end rings along its axis",
    source="Wave equation: f = sqrt(E / rho) / 4L. The wall is where the held nodes end: first order in dx",
    variants={
        "wall on a node": {"wall_dx": 0.0, "tolerance": 0.02},
        "wall between nodes": {"wall_dx": 0.5, "tolerance": 1 / 32},
    },
    in_tests=("wall on a node", "wall between nodes"),
)
def fixed_free_bar(*, wall_dx: float, tolerance: float) -> Outcome:
    """A bar (E 1e5 Pa, nu = 0) of 32 x 3 x 3 cells, held at one end, starts in its first axial mode."""
    dx, cells, E, rho = 0.01, 32, 1e5, 1000.0
    length, c = cells * dx, np.sqrt(E / rho)
    period = 4 * length / c
    x = lattice((2 * cells + 8, 6, 6), dx / 2, (-4 * dx, 0, 0))
    x = np.concatenate([x, [[-(8 + wall_dx) * dx, 0, 0]]])  # a crumb that sets where the grid's nodes lie
    held = x[:, 0] < 0
    v = np.zeros_like(x)
    v[:, 0] = np.where(held, 0, 0.01 * np.sin(np.pi * x[:, 0] / (2 * length)))
    simulator = Simulator(body(x, (dx / 2) ** 3, E=E, rho=rho, nu=0.0, held=held, v=v), Settings(dx, period / 20))
    end = x[:, 0] > length - dx
    reached = np.array([simulator.advance().positions_m[end, 0].mean() for _ in range(60)])
    f = frequency_hz(reached, period / 20)
    return Outcome((Check.share("frequency, Hz", f, expected=1 / period, tolerance=tolerance),))


def _profile(
    x: NDArray[np.float64], v: NDArray[np.float64], dx: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean velocity [N] by place along the axis, in bins of half a cell."""
    places, group = np.unique(np.round(x / (dx / 4)).astype(int), return_inverse=True)
    return places * dx / 4, np.bincount(group, v) / np.bincount(group)


def _peak(places: NDArray[np.float64], v: NDArray[np.float64]) -> tuple[float, float]:
    """Place and height of the highest point, from the parabola through its neighbours."""
    top = int(v.argmax())
    a, b, c = v[top - 1 : top + 2]
    shift = 0.5 * (a - c) / (a - 2 * b + c)
    return float(places[top] + shift * (places[top + 1] - places[top])), float(b - 0.25 * (a - c) * shift)


@benchmark(
    "B8",
    "Pressure and shear pulses in an infinite solid",
    source="c_p = sqrt((lam + 2 mu) / rho), c_s = sqrt(mu / rho); d'Alembert: half of a velocity pulse goes each way",
    variants={
        f"{wave}, width {cells:g} cells": {"wave": wave, "cells": cells, "tolerance": tolerance}
        for wave in ("P", "S")
        for cells, tolerance in ((3.2, 0.05), (6.4, 0.02))
    },
)
def pulse(*, wave: str, cells: float, tolerance: float) -> Outcome:
    """A solid (E 1e6 Pa, nu = 0.3) starts with a velocity exp(-(x / width)^2) along x (P) or y (S) and no strain.

    For P it is a bar of 2 x 2 cells between slip walls that leave all its nodes no way but x; for S it is so wide that
    what its free sides do does not arrive. Speed is that of the highest point over 16 cells, once the halves are apart.
    """
    dx, E, rho, nu = 0.01, 1e6, 1000.0, 0.3
    mu = E / (2 * (1 + nu))
    c_p, c_s = float(np.sqrt(2 * mu * (1 - nu) / (1 - 2 * nu) / rho)), float(np.sqrt(mu / rho))
    c, direction = (c_p, 0) if wave == "P" else (c_s, 1)
    apart, travel = 2 * cells, 16.0
    half = round(apart + travel + 3 * cells)
    wide = 1 if wave == "P" else round((apart + travel) * c_p / c)
    counts = (4 * half, 4 * wide, 4)
    x = lattice(counts, dx / 2, [-n * dx / 4 for n in counts])
    v = np.zeros_like(x)
    v[:, direction] = 0.01 * np.exp(-((x[:, 0] / (cells * dx)) ** 2))
    side = 2.6 * dx  # so far inside, so far from its surface, every node is stopped
    walls = (
        Obstacle(HalfSpace((0.0, side, 0.0), (0.0, 1.0, 0.0)), contact="slip"),
        Obstacle(HalfSpace((0.0, 0.0, side), (0.0, 0.0, 1.0)), contact="slip"),
    )
    frame_time = travel / 8 * dx / c
    settings = Settings(dx, frame_time, obstacles=walls if wave == "P" else ())
    simulator = Simulator(body(x, (dx / 2) ** 3, E=E, rho=rho, nu=nu, v=v), settings)
    core = (np.abs(x[:, 1]) < dx) & (np.abs(x[:, 2]) < dx) & (x[:, 0] > 0)
    times, peaks, curves = [], [], []
    while simulator.frame.time_s < (apart + travel) * dx / c:
        frame = simulator.advance()
        places, height = _profile(x[core, 0], frame.velocities_ms[core, direction], dx)
        if frame.time_s >= apart * dx / c:
            times.append(frame.time_s)
            peaks.append(_peak(places, height))
            curves.append((places / dx, height / 0.01))
    where, heights = np.array(peaks).T
    speed = np.polyfit(times, where, 1)[0]
    return Outcome(
        (
            Check.share(f"speed of the {wave} pulse, m/s", speed, expected=c, tolerance=tolerance),
            Check("height of the pulse at the end, share", heights[-1] / 0.01, expected=0.5, relative=True),
        ),
        (
            Chart(
                f"{wave} pulse, {cells:g} cells wide: first and last moment measured",
                "place, cells",
                "velocity / initial peak",
                tuple(
                    curve
                    for t, (at, height) in ((times[0], curves[0]), (times[-1], curves[-1]))
                    for curve in (
                        Curve(
                            "d'Alembert" if t == times[0] else "",
                            at,
                            0.5 * np.exp(-(((at - c * t / dx) / cells) ** 2)),
                            "theory",
                        ),
                        Curve(f"engine, {1000 * t:.1f} ms", at, height, "dots"),
                    )
                ),
            ),
        ),
    )


@benchmark(
    "B9",
    "Pulse at the joint of two materials",
    source="Acoustic impedance Z = sqrt(rho E): R = (Z1 - Z2) / (Z1 + Z2), T = 2 Z1 / (Z1 + Z2)",
    variants={
        "E2 = 4 E1": {"stiffer": 4.0, "tolerance": 0.05},
        "E2 = 100 E1 (B9b)": {"stiffer": 100.0, "tolerance": np.inf},
    },
)
def two_materials(*, stiffer: float, tolerance: float) -> Outcome:
    """A bar (nu = 0) of 2 x 2 cells; a velocity pulse 12 cells wide at half height meets a joint of two moduli.

    A mesh-free joint is two cells wide, so at a great jump the pulse would have to be longer; that is reported only.
    """
    dx, E, rho, width, amplitude = 0.01, 1e5, 1000.0, 12.0, 0.005
    c = np.sqrt(E / rho)
    ratio = np.sqrt(stiffer)
    before, pulse_at, after = 80, 40.0, round(40 * ratio)  # cells; the joint is at 0
    x = lattice((2 * (before + after), 4, 4), dx / 2, (-before * dx, 0, 0))
    v = np.zeros_like(x)
    v[:, 0] = amplitude * np.exp(-4 * np.log(2) * ((x[:, 0] / dx + pulse_at) / width) ** 2)
    modulus = np.where(x[:, 0] < 0, E, stiffer * E)
    frame_time = 5 * dx / c
    simulator = Simulator(body(x, (dx / 2) ** 3, E=modulus, rho=rho, nu=0.0, v=v), Settings(dx, frame_time))
    frames = [simulator.advance() for _ in range(12)]  # 60 cells of the softer bar
    (places, incident), (_, final) = (
        _profile(x[:, 0], frame.velocities_ms[:, 0], dx) for frame in (frames[3], frames[-1])
    )
    at = places / dx
    incident_peak = _peak(places[at < 0], incident[at < 0])[1]
    back = (at < -8) & (at > -40)
    reflected = final[back][np.abs(final[back]).argmax()]
    through = _peak(places[at > 4], final[at > 4])[1]
    expected_back, expected_through = (1 - ratio) / (1 + ratio), 2 / (1 + ratio)
    momentum = np.array([frame.momentum_kgms[0] for frame in frames])
    return Outcome(
        (
            Check.share("reflected / incident", reflected / incident_peak, expected=expected_back, tolerance=tolerance),
            Check.share(
                "transmitted / incident", through / incident_peak, expected=expected_through, tolerance=tolerance
            ),
            Check.between("change of momentum, share", np.ptp(momentum) / momentum[0], high=1e-5),
        ),
        (
            Chart(
                f"Pulse at the joint, E2 = {stiffer:g} E1",
                "place, cells",
                "velocity / incident peak",
                (
                    Curve("before", at, incident / incident_peak),
                    Curve("after", at, final / incident_peak),
                    Curve("R", [at[0], 0], [expected_back] * 2, "theory"),
                    Curve("T", [0, at[-1]], [expected_through] * 2, "theory"),
                ),
            ),
        ),
    )
