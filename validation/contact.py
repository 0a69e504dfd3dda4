"""What meets the ground: a ball that bounces, a block that slides or sticks (B12, B17)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phys4dgen.mpm import Ground, Settings, Simulator
from validation.bodies import body, lattice
from validation.case import Check, Outcome, benchmark
from validation.chart import Chart, Curve

__all__ = ["block_on_a_slope", "dropped_ball"]

G_MS2 = 9.81


@benchmark(
    "B12",
    "Ball dropped on the ground",
    source="Energy cannot grow; rebound as a float64 prototype found at two resolutions (0.86)",
    variants={"6 cells": {"cells": 6}, "10 cells": {"cells": 10}},
    in_tests=("6 cells",),
)
def dropped_ball(*, cells: int) -> Outcome:
    """An elastic ball (E 1e5 Pa, 0.2 m across) falls 0.5 m on ground that separates, without friction."""
    diameter, fall = 0.2, 0.5
    dx = diameter / cells
    x = lattice((2 * cells,) * 3, dx / 2, (-0.1, -0.1, 0.0))
    x = x[np.linalg.norm(x - [0, 0, 0.1], axis=1) < 0.1] + [0, 0, fall]
    b = body(x, (dx / 2) ** 3, E=1e5)
    settings = Settings(dx, 0.01, gravity_ms2=(0, 0, -G_MS2), ground=Ground(0.0, friction=0.0))
    simulator = Simulator(b, settings)
    frames = [simulator.advance() for _ in range(75)]
    speed = np.array([frame.momentum_kgms[2] for frame in frames]) / b.mass_kg.sum()
    centre = np.array([frame.positions_m[:, 2].mean() for frame in frames])
    stored = np.array([frame.kinetic_energy_j + frame.elastic_energy_j for frame in frames])
    energy = stored + G_MS2 * b.mass_kg.sum() * centre
    hit = int(speed.argmin())
    up = hit + int(speed[hit:].argmax())
    lowest = min(frame.positions_m[:, 2].min() for frame in frames)
    times = np.array([frame.time_s for frame in frames])
    flight = np.sqrt(2 * fall / G_MS2)
    falling = times <= flight
    return Outcome(
        (
            Check.between("rebound speed / impact speed", speed[up] / -speed[hit], low=0.75, high=0.95),
            Check.near("apex / height of the fall", (centre[up:].max() - 0.1) / fall, expected=0.74, tolerance=0.1),
            Check.between("lowest particle, cells", lowest / dx, low=-0.5),
            Check.between("largest rise of energy between frames, share", np.diff(energy).max() / energy[0], high=1e-3),
        ),
        (
            Chart(
                f"Height of the ball's centre, {cells} cells",
                "time, s",
                "height, m",
                (
                    Curve("free fall", times[falling], 0.1 + fall - G_MS2 * times[falling] ** 2 / 2, "theory"),
                    Curve("engine", times, centre),
                ),
            ),
        ),
    )


@benchmark(
    "B17",
    "Block on a slope",
    source="Coulomb: x = g t^2 (sin a - mu cos a) / 2",
    variants={"soft": {"is_rigid": False}, "rigid": {"is_rigid": True}},
    in_tests=("soft", "rigid"),
)
def block_on_a_slope(*, is_rigid: bool) -> Outcome:
    """A block of 6 x 6 x 4 cells (soft: E 1e6 Pa) on ground tilted by 24 degrees: mu = tan 15 slides, tan 30 sticks."""
    angle, dx = np.radians(24), 0.02
    b = body(lattice((12, 12, 8), dx / 2), (dx / 2) ** 3, E=1e10 if is_rigid else 1e6)
    if is_rigid:
        b = replace(b, rigid_group=np.zeros(len(b), np.int32))
    gravity = (G_MS2 * np.sin(angle), 0.0, -G_MS2 * np.cos(angle))

    def places_m(friction: float, frames: int) -> np.ndarray:
        settings = Settings(dx, 0.05, gravity_ms2=gravity, ground=Ground(0.0, friction=friction))
        simulator = Simulator(b, settings)
        start = b.positions_m[:, 0].mean()
        return np.array([simulator.advance().positions_m[:, 0].mean() - start for _ in range(frames)])

    friction = np.tan(np.radians(15))
    slid, stuck = places_m(friction, 10), places_m(np.tan(np.radians(30)), 16)
    times = 0.05 * np.arange(1, 17)
    theory = G_MS2 * times**2 / 2 * (np.sin(angle) - friction * np.cos(angle))
    return Outcome(
        (
            Check.share("slid after 0.5 s, m", slid[-1], expected=theory[9], tolerance=0.05),
            Check.between("creep of the block that sticks, once settled, m", np.ptp(stuck[9:]), high=1e-4),
            Check.between("where it sticks, m", abs(stuck[-1]), high=0.03),
        ),
        (
            Chart(
                f"{'Rigid' if is_rigid else 'Soft'} block on a slope of 24 degrees",
                "time, s",
                "slid, m",
                (
                    Curve("Coulomb, mu = tan 15", times[:10], theory[:10], "theory"),
                    Curve("engine, tan 15", times[:10], slid, "dots"),
                    Curve("engine, tan 30", times, stuck, "dots"),
                ),
            ),
        ),
    )
