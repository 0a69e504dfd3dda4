"""Sand that collapses and sand that stands (B15, B16)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import Body, LawId, Settings, Simulator
from validation.bodies import body
from validation.case import Check, Outcome, benchmark
from validation.chart import Chart, Curve
from validation.slices import ground_at_zero, moment, plane_walls, slice_of
from validation.states import States

__all__ = ["column_collapse", "pile", "plane_strain_angle_deg"]

G_MS2 = 9.81
_RADIUS_M = 0.1
_DENSITY_KGM3 = 1600.0


def plane_strain_angle_deg(phi_deg: float) -> float:
    """The friction angle of triaxial compression with which Drucker and Prager's cone is Mohr-Coulomb in plane strain.

    There alpha = sqrt(2)/3 sin(phi); in triaxial compression alpha = sqrt(2/3) 2 sin / (3 - sin).
    """
    share = np.sqrt(2) / 3 * np.sin(np.radians(phi_deg)) / np.sqrt(2 / 3)
    return float(np.degrees(np.arcsin(3 * share / (2 + share))))


def _sand(x: NDArray[np.float64], dx: float, phi_deg: float) -> Body:
    return body(
        x, (dx / 2) ** 3, E=5e5, rho=_DENSITY_KGM3, nu=0.3, law=LawId.DRUCKER_PRAGER,
        friction_angle_deg=plane_strain_angle_deg(phi_deg),
    )  # fmt: skip


def _profile(x: NDArray[np.float64], dx: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Height of the surface above the ground by place, in bins of a cell, as far as sand lies without a gap."""
    number = np.floor(x[:, 0] / dx).astype(int)
    heights = np.zeros(number.max() + 2)
    np.maximum.at(heights, np.maximum(number, 0), x[:, 2] + dx / 4)
    end = int(np.argmax(heights < 0.5 * dx)) or len(heights)
    return (np.arange(end) + 0.5) * dx, heights[:end]


def _slope_deg(places: NDArray[np.float64], heights: NDArray[np.float64]) -> float:
    """Mean slope of the middle of a surface: between 20 and 80 % of its length."""
    middle = (places > 0.2 * places[-1]) & (places < 0.8 * places[-1])
    return float(np.degrees(np.arctan(-np.polyfit(places[middle], heights[middle], 1)[0])))


def _runout(aspect: float) -> float:
    """Dr / r0 of a column in a channel, Lube et al. 2005."""
    return 1.2 * aspect if aspect < 2.3 else 1.9 * aspect ** (2 / 3)


@benchmark(
    "B15",
    "Collapse of a column of sand",
    source=(
        "G. Lube et al., Phys. Rev. E 72, 041301 (2005): dr/r0 = 1.2 a (a < 1.8), 1.9 a^(2/3) (a > 2.8); "
        "E. Lajeunesse et al., Phys. Fluids 17, 103302 (2005)"
    ),
    variants={
        "a = 0.5": {"aspect": 0.5, "tolerance": np.inf},
        "a = 1": {"aspect": 1.0},
        "a = 2": {"aspect": 2.0},
        "a = 3": {"aspect": 3.0},
        "a = 1, phi = 20": {"aspect": 1.0, "phi_deg": 20.0, "tolerance": np.inf},
        "a = 1, phi = 40": {"aspect": 1.0, "phi_deg": 40.0, "tolerance": np.inf},
    },
)
def column_collapse(*, aspect: float, phi_deg: float = 30.0, tolerance: float = 0.2) -> Outcome:
    """A slice of dry sand, r0 = 10 cells wide and a r0 high, is let go beside a smooth wall on a rough ground.

    phi is that of plane strain, 30 degrees where nothing is said. Between the two laws (a = 2) their mean bounds count.
    The experiments are for grains of about 30 degrees, so other angles are for comparison (B16).
    """
    dx = _RADIUS_M / 10
    x = slice_of(_RADIUS_M, aspect * _RADIUS_M, dx)
    settings = Settings(
        dx, 0.05, gravity_ms2=(0, 0, -G_MS2), ground=ground_at_zero("sticky"), obstacles=plane_walls(dx)
    )
    simulator = Simulator(_sand(x, dx, phi_deg), settings)
    start = simulator.frame.positions_m
    fronts, moments = [], [moment("start", start, start)]
    speed = np.inf
    while simulator.frame.time_s < 3.0 and not (speed < 0.005 and simulator.frame.time_s > 0.5):
        frame = simulator.advance()
        speed = frame.max_speed_ms
        fronts.append((frame.time_s, (_front_m(frame.positions_m, dx) - _RADIUS_M) / _RADIUS_M))
        if len(fronts) == 3:
            moments.append(moment(f"{frame.time_s:.2f} s", frame.positions_m, start))
    last = simulator.frame
    places, heights = _profile(last.positions_m, dx)
    expected = _runout(aspect)
    reached = fronts[-1][1]
    mark = _RADIUS_M * (1 + expected)
    moments.append(
        moment(
            f"{last.time_s:.2f} s; line: experiment", last.positions_m, start,
            lines=(np.array([[mark, 0], [mark, 0.3 * _RADIUS_M]]),),
        )
    )  # fmt: skip
    slope = _slope_deg(places, heights)
    return Outcome(
        (
            Check.share("dr / r0", reached, expected=expected, tolerance=tolerance),
            Check.between("largest speed at the end, m/s", speed, high=0.01),
            Check.between("slope at rest / phi (B16)", slope / phi_deg, low=0.6 if aspect == 1 else -np.inf, high=1.05),
        ),
        (
            Chart(
                f"Front of the column, a = {aspect:g}, phi = {phi_deg:g} degrees",
                "time, s",
                "dr / r0",
                (
                    Curve("experiment, at rest", [0, last.time_s], [expected] * 2, "theory"),
                    Curve("engine", *np.array(fronts).T),
                ),
            ),
        ),
        (
            States(
                f"Column of sand, a = {aspect:g}",
                tuple(moments),
                (0, _RADIUS_M * max(3.0, 1.4 + expected), 0, _RADIUS_M * max(1.2, aspect * 1.05)),
                dx / 1.6,
            ),
        ),
    )


def _front_m(x: NDArray[np.float64], dx: float) -> float:
    """Where 99.5 % of the sand is behind."""
    return float(np.quantile(x[:, 0], 0.995)) + dx / 4


@benchmark(
    "B16",
    "A pile of sand stands below its friction angle and slides above it",
    source="Mohr-Coulomb: a dry slope stands up to phi",
    variants={f"phi = {phi:g}": {"phi_deg": phi} for phi in (25.0, 35.0)},
)
def pile(*, phi_deg: float) -> Outcome:
    """Half piles 24 cells long beside a smooth wall on a rough ground, built at phi - 3 and phi + 5 degrees."""
    length, cells = 0.24, 24
    dx = length / cells
    slid, crept, moments, slopes = [], [], [], []
    for built in (phi_deg - 3, phi_deg + 5):
        top = np.array([[0.0, length * np.tan(np.radians(built))], [length, 0.0]])
        x = slice_of(length, float(top[0, 1]), dx, top=top)
        settings = Settings(
            dx, 0.1, gravity_ms2=(0, 0, -G_MS2), ground=ground_at_zero("sticky"), obstacles=plane_walls(dx)
        )
        simulator = Simulator(_sand(x, dx, phi_deg), settings)
        middle, frame = [simulator.advance() for _ in range(10)][4::5]
        crept.append(np.quantile(np.linalg.norm(frame.positions_m - middle.positions_m, axis=1), 0.9) / dx)
        moved = np.linalg.norm(frame.positions_m - x, axis=1)
        slid.append(np.quantile(moved, 0.9) / dx)
        slopes.append(_slope_deg(*_profile(frame.positions_m, dx)))
        moments.append(moment(f"built at {built:g}, after 1 s", frame.positions_m, x, lines=(top,)))
    return Outcome(
        (
            Check.between("built at phi - 3: way that 90 % have not moved, cells", slid[0], high=0.5),
            Check.between("the same in the second half second, cells", crept[0], high=0.1),
            Check.between("built at phi + 5: way that 10 % have moved, cells", slid[1], low=1.0),
            Check.near("slope of the first pile at rest, degrees", slopes[0], expected=phi_deg - 3, tolerance=1.5),
            Check.between("slope of the second pile at rest, degrees", slopes[1], low=0.6 * phi_deg, high=phi_deg + 1),
        ),
        (),
        (States(f"Piles of sand, phi = {phi_deg:g}", tuple(moments), (0, 1.3 * length, 0, 0.85 * length), dx / 1.6),),
    )
