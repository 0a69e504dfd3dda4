"""Weight and bending: a column under its own weight, a cantilever that sags and swings (B3, B6, B7, B21)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import Body, Settings, Simulator
from validation.bodies import body, clamped, lattice
from validation.case import Check, Outcome, benchmark
from validation.chart import Chart, Curve
from validation.signals import frequency_hz

__all__ = ["cantilever_sag", "cantilever_swing", "column", "scaled_twin"]

G_MS2 = 9.81
_CANTILEVER_ROOT = 1.8751041  # first root of cos(k) cosh(k) = -1


@benchmark(
    "B3",
    "Column under its own weight",
    source="Linear elasticity: u(z) = rho g (H z - z^2 / 2) / E, sigma(z) = rho g (H - z)",
    in_tests=("",),
)
def column() -> Outcome:
    """A column (E 1e5 Pa, nu = 0) of 4 x 4 x 16 cells, 1 m high, held at its foot, sinks and comes to rest.

    Stress is compared more than two cells above the clamp. The column is strained by 10 % at its foot, so theory itself
    is 2 % short.
    """
    dx, height, E, rho = 1 / 16, 1.0, 1e5, 1000.0
    h = dx / 2
    free, foot = lattice((8, 8, 32), h), lattice((8, 8, 6), h, (0, 0, -6 * h))
    x, held = clamped(free, foot, dx)
    b = body(x, h**3, E=E, rho=rho, nu=0.0, held=held)
    omega = np.pi / 2 * np.sqrt(E / rho) / height
    simulator = Simulator(b, Settings(dx, 0.5, gravity_ms2=(0, 0, -G_MS2), damping_per_s=0.5 * omega))
    for _ in range(6):
        frame = simulator.advance()
    z = free[:, 2]
    sunk = (x - frame.positions_m)[~held, 2]
    expected = rho * G_MS2 * (height * z - z**2 / 2) / E
    # nu = 0: the axial stress of a Neo-Hookean solid is mu (l - 1/l) over its unchanged section, mu = E / 2
    stretch = frame.deformation_gradients[~held, 2, 2].astype(float)
    stress = -E / 2 * (stretch - 1 / stretch)
    weight = rho * G_MS2 * (height - z)
    inside, top = z > 2 * dx, z > height - h
    scatter = np.sqrt(np.mean((stress - weight)[inside] ** 2)) / (rho * G_MS2 * height)
    line = (np.abs(free[:, 0] - free[:, 0].min()) < h / 4) & (np.abs(free[:, 1] - free[:, 1].min()) < h / 4)
    return Outcome(
        (
            Check.share("sinking of the top, m", sunk[top].mean(), expected=expected[top].mean(), tolerance=0.05),
            Check.between("rms error of stress / (rho g H)", scatter, high=0.08),
            Check.between("largest speed at the end, m/s", frame.max_speed_ms, high=1e-3),
        ),
        (
            Chart(
                "Sinking of the column",
                "height above the clamp, m",
                "sinking, m",
                (
                    Curve("linear elasticity", z[line], expected[line], "theory"),
                    Curve("engine", z[line], sunk[line], "dots"),
                ),
            ),
        ),
    )


def _cantilever(
    cells: int, layers: int, *, slender: int, E: float, rho: float
) -> tuple[Body, NDArray[np.bool_], float, float]:
    """A beam (nu = 0) of square section clamped at x = 0: (body, who is at its tip, height, length)."""
    dx = 0.01
    h, size, length = dx / layers, cells * dx, slender * cells * dx
    half, across = -size / 2, layers * cells
    beam = lattice((slender * across, across, across), h, (0, half, half))
    root = lattice((3 * layers, across, across), h, (-3 * dx, half, half))
    x, held = clamped(beam, root, dx, axis=0)
    b = body(x, h**3, E=E, rho=rho, nu=0.0, held=held)
    return b, x[:, 0] > length - dx, size, length


def _second_moment_share(layers: int) -> float:
    """Second moment of particles in the middle of so many slices of a section, over that of the solid section."""
    return 1 - 1 / layers**2


@benchmark(
    "B6",
    "Cantilever sags under its weight",
    source="Timoshenko beam: w L^4 / 8EI + w L^2 / 2 kappa G A, kappa = 5/6",
    variants={
        "2 cells high": {"cells": 2, "tolerance": 0.08},
        "4 cells high": {"cells": 4, "tolerance": 0.04},
        "6 cells high": {"cells": 6, "tolerance": 0.03},
        "2 cells high, two particles a cell": {"cells": 2, "layers": 2, "tolerance": 0.08},
    },
)
def cantilever_sag(*, cells: int, layers: int = 3, tolerance: float) -> Outcome:
    """A beam of square section (E 1e6 Pa, nu = 0, L/h = 8) sags by 2 % of its length, damped until it rests.

    Three particles a cell along each axis stand for the solid section. Two, as objects are seeded, are k = 2 h / dx
    layers in the middle of as many slices, which have 1 - 1/k^2 of its second moment: 6 % less at two cells. That row
    is judged by the section of its layers; against the solid one it is reported.
    """
    E, rho, slender = 1e6, 1000.0, 8
    b, tip, size, length = _cantilever(cells, layers, slender=slender, E=E, rho=rho)
    gravity = 0.02 * 8 * E * size**2 / (12 * rho * length**3)
    share = 1.0 if layers > 2 else _second_moment_share(layers * cells)
    bending = rho * gravity * 12 * length**4 / (8 * E * size**2)
    shear = rho * gravity * length**2 / (2 * 5 / 6 * E / 2)
    f1 = _CANTILEVER_ROOT**2 / (2 * np.pi * length**2) * size / np.sqrt(12) * np.sqrt(E / rho)
    settings = Settings(
        0.01,
        0.5 / f1,
        gravity_ms2=(0, 0, -gravity),
        damping_per_s=4 * np.pi * f1,
        cfl=0.6,
        max_substeps_per_frame=10**6,
    )
    simulator = Simulator(b, settings)
    sags = []
    for _ in range(5):
        sags.append(-(simulator.advance().positions_m - b.positions_m)[tip, 2].mean())
    at_tip = b.positions_m[tip, 0].mean() / length
    # the mean of the tip's particles lies a little inside: the slope there is w L^3 / 6EI
    slope = rho * gravity * 12 * length**3 / (6 * E * size**2)
    bent = bending - slope * (1 - at_tip) * length
    of_solid = Check("sag of the tip / that of the solid section", sags[-1] / (bent + shear), expected=1.0)
    return Outcome(
        (
            Check.share("sag of the tip, m", sags[-1], expected=bent / share + shear, tolerance=tolerance),
            Check.between("change over the last half period, share", abs(sags[-1] / sags[-2] - 1), high=5e-3),
            *((of_solid,) if layers == 2 else ()),
        )
    )


@benchmark(
    "B7",
    "Cantilever swings",
    source="Euler-Bernoulli: f = 1.8751^2 / (2 pi L^2) sqrt(E I / rho A)",
    variants={"2 cells high": {"cells": 2, "tolerance": 0.08}, "4 cells high": {"cells": 4, "tolerance": 0.05}},
)
def cantilever_swing(*, cells: int, tolerance: float) -> Outcome:
    """The beam of B6, three particles a cell, starts with the velocity of its first mode, without weight."""
    E, rho, slender = 1e6, 1000.0, 8
    b, _, size, length = _cantilever(cells, 3, slender=slender, E=E, rho=rho)
    f1 = _CANTILEVER_ROOT**2 / (2 * np.pi * length**2) * size / np.sqrt(12) * np.sqrt(E / rho)
    k = _CANTILEVER_ROOT * np.clip(b.positions_m[:, 0] / length, 0, 1)
    sigma = (np.cosh(_CANTILEVER_ROOT) + np.cos(_CANTILEVER_ROOT)) / (
        np.sinh(_CANTILEVER_ROOT) + np.sin(_CANTILEVER_ROOT)
    )
    mode = (np.cosh(k) - np.cos(k) - sigma * (np.sinh(k) - np.sin(k))) / 2
    v = np.zeros_like(b.positions_m)
    v[:, 2] = np.where(b.held, 0, 0.01 * length * 2 * np.pi * f1 * mode)
    frame_time = 1 / (20 * f1)
    simulator = Simulator(
        replace(b, velocities_ms=v), Settings(0.01, frame_time, cfl=0.6, max_substeps_per_frame=10**6)
    )
    weight = mode * ~b.held
    swing = (
        np.array([weight @ (simulator.advance().positions_m - b.positions_m)[:, 2] for _ in range(48)]) / weight.sum()
    )
    f = frequency_hz(swing, frame_time)
    times = np.arange(1, len(swing) + 1) * frame_time
    top = np.abs(swing).max()
    return Outcome(
        (Check.share("frequency, Hz", f, expected=f1, tolerance=tolerance),),
        (
            Chart(
                f"Cantilever, {cells} cells high",
                "time, s",
                "deflection / largest",
                (
                    Curve("theory", times, np.sin(2 * np.pi * f1 * times), "theory"),
                    Curve("engine", times, swing / top),
                ),
            ),
        ),
    )


@benchmark(
    "B21",
    "The same thing at another size",
    source="Similarity: lengths s, density rho / s^2, gravity s g, the same E and times give the same shape",
    in_tests=("",),
)
def scaled_twin() -> Outcome:
    """A clamped beam that gravity bends, and a twin s = 1 / 0.3 times as large."""
    frames = []
    dx, scale = 0.01, 1 / 0.3
    for s in (1.0, scale):
        h = s * dx / 2
        beam, root = lattice((40, 6, 6), h), lattice((6, 6, 6), h, (-6 * h, 0, 0))
        x, held = clamped(beam, root, s * dx, axis=0)
        b = body(x, h**3, E=5e5, rho=1000.0 / s**2, held=held)
        simulator = Simulator(b, Settings(s * dx, 0.05, gravity_ms2=(0, 0, -G_MS2 * s)))
        frames.append([simulator.advance() for _ in range(4)][-1])
    small, large = frames
    length = 20 * dx
    off = np.abs(large.positions_m / scale - small.positions_m).max() / length
    sag = np.abs(small.positions_m - simulator.body.positions_m / scale).max() / length
    return Outcome(
        (
            Check.between("largest difference, share of the length", off, high=1e-4),
            Check.between("largest movement, share of the length", sag, low=0.1),
        )
    )
