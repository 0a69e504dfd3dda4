"""Water at rest and water that breaks loose (B13, B14)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import HalfSpace, LawId, Obstacle, Settings, Simulator
from validation.bodies import body, lattice
from validation.case import Check, Outcome, benchmark
from validation.chart import Chart, Curve
from validation.slices import ground_at_zero, moment, plane_walls, slice_of
from validation.states import States

__all__ = ["dam_break", "water_column"]

G_MS2 = 9.81
_NU = 0.45  # only sets how the modulus of the interface makes the bulk modulus


def _modulus_pa(density_kgm3: float, sound_ms: float) -> float:
    """Young's modulus that gives the fluid its speed of sound: K = rho c0^2 = E / 3 (1 - 2 nu)."""
    return density_kgm3 * sound_ms**2 * 3 * (1 - 2 * _NU)


@benchmark("B13", "Water at rest in a column", source="Hydrostatics: p = rho g (H - z)")
def water_column() -> Outcome:
    """Water (rho 1000, c0 = 15 sqrt(g H)) of 3 x 3 x 16 cells, 1 m high, between slip walls, damped until it rests.

    Slope and error are those above the lowest cell. The ground stops nodes 0.7 cells below its surface, so that what
    lies on it is seen to touch it. They feel the pressure p of the fluid above through the spline w alone, and carry
    the weight P of the column by int p (-w') dz = P: over the lowest half cell w falls from 0.32 to 0.045, so that p is
    up to 3.6 P there, and hydrostatic above. Such a fluid is compressed by p / rho c0^2, here by 1.5 %.
    """
    dx, height, rho = 1 / 16, 1.0, 1000.0
    x = lattice((6, 6, 32), dx / 2)
    sound = 15 * np.sqrt(G_MS2 * height)
    modulus = _modulus_pa(rho, sound)
    b = body(x, (dx / 2) ** 3, E=modulus, rho=rho, nu=_NU, law=LawId.FLUID, viscosity_pas=1.0)
    side = 3.6 * dx  # so far inside, so far from its surface, every node is stopped
    walls = tuple(
        Obstacle(HalfSpace((side, side, 0.0), normal), contact="slip") for normal in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    )
    simulator = Simulator(
        b,
        Settings(
            dx,
            0.25,
            gravity_ms2=(0, 0, -G_MS2),
            ground=ground_at_zero("separate"),
            obstacles=walls,
            damping_per_s=np.pi * sound / (4 * height),
        ),
    )
    for _ in range(4):
        frame = simulator.advance()
    # frames tell nothing of the volume of a fluid, so its state is read where the engine keeps it
    ((_, index, _, (growth, rest)),) = simulator._particles.soft_states()
    ratio = np.ones(len(x))
    ratio[index] += growth + rest
    pressure = rho * sound**2 / 7 * (ratio**-7 - 1)
    weight = G_MS2 * b.mass_kg.sum()
    z = frame.positions_m[:, 2]
    surface = height * ratio.mean()  # where the volume ends
    expected = rho * G_MS2 * (surface - z)
    above = z > dx
    slope = -np.polyfit(z[above], pressure[above], 1)[0] / (rho * G_MS2)
    scatter = np.sqrt(np.mean((pressure - expected)[above] ** 2)) / (rho * G_MS2 * height)
    lowest = z < 0.5 * dx
    line = np.argsort(z)[:: len(z) // 120]
    return Outcome(
        (
            Check.near("slope of the pressure / rho g", slope, expected=1.0, tolerance=0.10),
            Check.between("rms error of pressure / (rho g H)", scatter, high=0.15),
            Check("lowest half cell: pressure / hydrostatic", (pressure / expected)[lowest].mean(), expected=1.0),
            Check.share("force on the ground, N", -frame.reactions_n[-1, 2], expected=weight, tolerance=0.01),
            Check.between("largest speed at the end / c0", frame.max_speed_ms / sound, high=1e-3),
        ),
        (
            Chart(
                "Pressure in the column",
                "height, m",
                "pressure, kPa",
                (
                    Curve("hydrostatics", [0, surface], [rho * G_MS2 * surface / 1e3, 0], "theory"),
                    Curve("engine", z[line], pressure[line] / 1e3, "dots"),
                ),
            ),
        ),
    )


_MARTIN_MOYCE_FRONT = np.array(
    [
        (0.41, 1.11), (0.84, 1.22), (1.19, 1.44), (1.43, 1.67), (1.63, 1.89), (1.83, 2.11), (1.98, 2.33), (2.20, 2.56),
        (2.32, 2.78), (2.51, 3.00), (2.65, 3.22), (2.83, 3.44), (2.98, 3.67), (3.11, 3.89), (3.33, 4.11),
    ]
)  # fmt: skip
"""T = t sqrt(2 g / a) and Z = x / a of the front, n^2 = 2, a = 0.05715 m."""

_MARTIN_MOYCE_HEIGHT = np.array(
    [
        (0.56, 0.94), (0.77, 0.89), (0.93, 0.83), (1.08, 0.78), (1.28, 0.72), (1.46, 0.67), (1.66, 0.61), (1.84, 0.56),
        (2.00, 0.50), (2.21, 0.44), (2.45, 0.39), (2.70, 0.33), (3.06, 0.28), (3.44, 0.22), (4.20, 0.17),
    ]
)  # fmt: skip
"""t sqrt(g / a) and H / 2a of the column at the wall."""


@benchmark(
    "B14",
    "Dam break",
    source="J. C. Martin, W. J. Moyce, Phil. Trans. R. Soc. A 244 (1952) 312-324, tables 2 and 6 (n^2 = 2)",
    variants={"a = 8 cells": {"cells": 8}, "a = 16 cells": {"cells": 16}},
)
def dam_break(*, cells: int) -> Outcome:
    """A slice of water a = 57 mm wide and 2a high is let go beside a wall, on a floor without friction.

    As usual the experiment may be late by the time that the gate took, up to 0.4 in T = t sqrt(2 g / a); the best shift
    is used. The front is where 99.8 % of the water is behind.
    """
    a = 0.05715
    dx, rho = a / cells, 1000.0
    x = slice_of(a, 2 * a, dx)
    sound = 10 * np.sqrt(G_MS2 * 2 * a)
    b = body(x, (dx / 2) ** 3, E=_modulus_pa(rho, sound), rho=rho, nu=_NU, law=LawId.FLUID, viscosity_pas=1e-3)
    unit = np.sqrt(a / (2 * G_MS2))
    settings = Settings(
        dx, 0.1 * unit, gravity_ms2=(0, 0, -G_MS2), ground=ground_at_zero("separate"), obstacles=plane_walls(dx)
    )
    simulator = Simulator(b, settings)
    start = simulator.frame.positions_m
    fronts, heights, moments = [(0.0, 1.0)], [(0.0, 1.0)], [moment("T = 0", start, start)]
    for number in range(1, 36):
        at = simulator.advance().positions_m
        time = 0.1 * number
        fronts.append((time, (np.quantile(at[:, 0], 0.998) + dx / 4) / a))
        heights.append((time / np.sqrt(2), (np.quantile(at[at[:, 0] < 2 * dx, 2], 0.98) + dx / 4) / (2 * a)))
        if number in (12, 22, 33):
            moments.append(moment(f"T = {time:.1f}", at, start))
    front = np.array(fronts)
    shifts = np.linspace(0, 0.4, 81)
    errors = [_rms(front, _MARTIN_MOYCE_FRONT - [shift, 0]) for shift in shifts]
    shift = shifts[int(np.argmin(errors))]
    late = _MARTIN_MOYCE_FRONT[:, 0] > 1.2
    expected = np.polyfit(*_MARTIN_MOYCE_FRONT[late].T, 1)[0]
    mine = (front[:, 0] > 1.2) & (front[:, 0] < 3.1)
    speed = np.polyfit(*front[mine].T, 1)[0]
    return Outcome(
        (
            Check.between("rms error of Z = x / a, best shift in T", min(errors), high=0.12),
            Check.share("speed of the front, dZ / dT", speed, expected=expected, tolerance=0.2),
            Check("shift in T", shift, 0.0, 0.4),
        ),
        (
            Chart(
                f"Dam break, a = {cells} cells",
                "time (front: t sqrt(2g/a); height: t sqrt(g/a))",
                "front x / a; height / 2a",
                (
                    Curve("experiment: front, shifted", *(_MARTIN_MOYCE_FRONT - [shift, 0]).T, "dots"),
                    Curve("experiment: height", *_MARTIN_MOYCE_HEIGHT.T, "dots"),
                    Curve("engine: front", *front.T),
                    Curve("engine: height", *np.array(heights).T),
                ),
            ),
        ),
        (States("Dam break", tuple(moments), (0, 4.3 * a, 0, 2.1 * a), dx / 1.6),) if cells == 16 else (),
    )


def _rms(curve: NDArray[np.float64], points: NDArray[np.float64]) -> float:
    """Root mean square distance of points from a curve, along the second axis."""
    return float(np.sqrt(np.mean((np.interp(points[:, 0], curve[:, 0], curve[:, 1]) - points[:, 1]) ** 2)))
