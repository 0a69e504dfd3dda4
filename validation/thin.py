"""Bending frequency of thin sheets and rods over theory, by thickness, place between the nodes and tilt (B22).

A free strip or rod starts with the velocity of its first bending mode and swings. The mode of a free beam needs no
clamp, whose place is uncertain by a cell.

Why raw thin sheets are too stiff: the velocity gradient of MLS-MPM is a linear fit (the APIC matrix), which reads a
field x^2 with an error of its third central moment m3 = d/4 - d^3 at a distance d (cells) from the nearest node. A
curvature kappa thus makes a spurious shear 2 m3 kappa dx, alternating in sign, whose energy adds the factor
1 + 12 (G / E) (2 m3)^2 (dx / t)^2 to the bending stiffness, whatever the length: 2.32, or 1.52 times the frequency,
for nu = 0, d = 1/4 and t/dx = 0.2; none at d = 0 and 1/2; 1.026 times the frequency at most at t = dx.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.body import ROD_FLOOR_CELLS, ROD_LIMIT_CELLS, SHEET_FLOOR_CELLS, SHEET_LIMIT_CELLS
from phys4dgen.interior.seed import Seeds, seed_rods, seed_sheets
from phys4dgen.interior.sites import Sites
from phys4dgen.mpm import Settings, Simulator
from validation.bodies import body
from validation.case import Check, Outcome, benchmark
from validation.signals import frequency_hz

__all__ = ["bending_scan", "ratio"]

DX_M = 0.005
E_PA = 1e6
RHO_KGM3 = 1000.0
THICKNESSES = (0.1, 0.2, 0.5, 1.0, 2.0, 4.0)
TILTS_DEG = (0.0, 20.0, 45.0)
PHASES = tuple(itertools.product((0.0, 0.25), (0.0, 0.5)))
STRIP_SITES = 10
FREE_FREE = 4.730041  # first root of cos(k) cosh(k) = 1
FRAMES_PER_PERIOD = 20
FRAMES = 52


def theory_hz(shape: str, *, t_m: float, length_m: float) -> float:
    """First bending frequency of a free beam of nu = 0, with Timoshenko's correction to first order."""
    gyration = t_m / math.sqrt(12) if shape == "sheet" else t_m / 4
    slow = FREE_FREE**2 / (2 * math.pi * length_m**2) * gyration * math.sqrt(E_PA / RHO_KGM3)
    shear = 2 / (5 / 6)  # E / (kappa G)
    return slow / math.sqrt(1 + (gyration / length_m) ** 2 * (12.3 + 49.5 * shear))


def beam_particles(shape: str, *, t_m: float, length_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places of the particles along x from 0 to ``length_m``, and their volumes, as interior discovery seeds them."""
    h = DX_M / 2
    slices = round(length_m / h)
    if t_m <= 1.001 * (SHEET_LIMIT_CELLS if shape == "sheet" else ROD_LIMIT_CELLS) * DX_M:
        seeds = _seeds(shape, t_m / h, slices)
        return (seeds.middle + seeds.offset) * h, seeds.volume * h**3
    places, area = _thick_section(shape, t_m)
    along = (np.arange(slices) + 0.5) * h
    x = np.concatenate([np.column_stack([np.full(len(places), s), places]) for s in along])
    return x, np.full(len(x), area * h)


def _seeds(shape: str, thickness: float, slices: int) -> Seeds:
    """The product's particles of a sheet ten sites wide or of a rod, in voxels."""
    rows = STRIP_SITES if shape == "sheet" else 1
    along, across = (place.ravel() for place in np.meshgrid(np.arange(slices), np.arange(rows), indexing="ij"))
    s = len(along)
    zero = np.zeros((s, 3))
    sites = Sites(
        np.column_stack([along + 0.5, across - (rows - 1) / 2, np.zeros(s)]),
        np.tile([0.0, 0.0, 1.0] if shape == "sheet" else [1.0, 0.0, 0.0], (s, 1)),
        np.ones(s),
        zero,
        zero,
        is_bridge=np.zeros(s, bool),
        is_odd=(along + across) % 2 > 0,
    )
    seed = seed_sheets if shape == "sheet" else seed_rods
    return seed(sites, np.full(s, thickness), np.ones(s, bool))


def _thick_section(shape: str, t_m: float) -> tuple[NDArray[Any], float]:
    """Places across the axis (y, z) of what discovery takes for a solid, and the volume of each per metre of axis."""
    h = DX_M / 2
    if shape == "rod":
        count = math.ceil(t_m / h)
        grid = (np.arange(count) - (count - 1) / 2) * h
        places = np.stack(np.meshgrid(grid, grid, indexing="ij"), -1).reshape(-1, 2)
        places = places[np.hypot(*places.T) < t_m / 2]
        places *= t_m / 4 / float(np.sqrt((places[:, 1] ** 2).mean()))  # the second moment of the round rod
        return places, math.pi * t_m**2 / 4 / len(places)
    count = max(2, math.ceil(2 * t_m / DX_M))
    layers = ((np.arange(count) + 0.5) / count - 0.5) * t_m / math.sqrt(1 - 1 / count**2)
    across = (np.arange(STRIP_SITES) - (STRIP_SITES - 1) / 2) * h
    places = np.stack(np.meshgrid(across, layers, indexing="ij"), -1).reshape(-1, 2)
    return places, h * t_m / count


def mode_shape(xi: NDArray[np.float64]) -> NDArray[np.float64]:
    """First free-free mode at xi in [0, 1], 1 at the ends."""
    k = FREE_FREE
    sigma = (math.cosh(k) - math.cos(k)) / (math.sinh(k) - math.sin(k))
    return (np.cosh(k * xi) + np.cos(k * xi) - sigma * (np.sinh(k * xi) + np.sin(k * xi))) / 2


def ratio(shape: str, *, t_dx: float, floor_cells: float, phase: tuple[float, float], tilt_deg: float) -> float:
    """Simulated over theoretical frequency.

    Args:
        shape: sheet or rod.
        t_dx: thickness or diameter in cells.
        floor_cells: simulated at least so thick, with the same mass and bending stiffness; 0 for raw.
        phase: of the middle of the beam between nodes, along the axis and across, in cells.
        tilt_deg: of the axis against the grid.
    """
    t, simulated = t_dx * DX_M, max(t_dx, floor_cells) * DX_M
    power = 1 if shape == "sheet" else 2
    grow = simulated / t
    length = max(20.0, 14 * max(t_dx, floor_cells)) * DX_M
    x, volume = beam_particles(shape, t_m=simulated, length_m=length)
    f = theory_hz(shape, t_m=t, length_m=length)
    bend = mode_shape(x[:, 0] / length)
    v = np.zeros_like(x)
    v[:, 2] = 0.01 * length * 2 * math.pi * f * bend
    c, s = math.cos(math.radians(tilt_deg)), math.sin(math.radians(tilt_deg))
    turn = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    x = (x - [length / 2, 0, 0]) @ turn.T + DX_M * np.array([phase[0], 0.25, phase[1]])
    # A crumb far below, on a node, says where the nodes lie: the grid's origin is the lowest corner of the body.
    x = np.concatenate([x, DX_M * np.floor(x.min(0) / DX_M - 6)[None]])
    v = np.concatenate([v @ turn.T, np.zeros((1, 3))])
    volume = np.append(volume, (DX_M / 2) ** 3)
    held = np.arange(len(x)) == len(x) - 1
    beam = body(
        x, volume, E=E_PA / grow ** (power + 2), rho=RHO_KGM3 / grow**power, nu=0.0, held=held, v=v, names=("beam",)
    )
    simulator = Simulator(beam, Settings(DX_M, 1 / (FRAMES_PER_PERIOD * f), cfl=0.6, max_substeps_per_frame=10**6))
    normal = turn @ [0.0, 0.0, 1.0]
    weight = np.append(bend * volume[:-1], 0.0) / (bend**2 * volume[:-1]).sum()
    signal = [weight @ ((simulator.advance().positions_m - x) @ normal) for _ in range(FRAMES)]
    return frequency_hz(np.array(signal), 1 / (FRAMES_PER_PERIOD * f)) / f


@benchmark(
    "B22",
    "Thin sheets and rods bend",
    source="Free beam, first mode: f = 4.730^2 / (2 pi L^2) sqrt(E I / rho A), Timoshenko's first-order correction",
    variants={
        f"{shape}, t/dx = {t_dx:g}": {"shape": shape, "t_dx": t_dx}
        for shape in ("sheet", "rod")
        for t_dx in THICKNESSES
    },
)
def bending_scan(*, shape: str, t_dx: float) -> Outcome:
    """A free strip or rod (nu = 0) in four places between the grid's nodes and at tilts of 0, 20 and 45 degrees.

    "as the product simulates it": thickened at least to one cell, with its mass and bending stiffness kept; "as it is":
    without that. The particles are those of the product: two layers at a sheet's rim and one particle by turns inside,
    3 x 3 strands in a rod; what is thicker than a cell (three, of a rod) has layers half a cell apart, as a solid has.
    """
    floor = SHEET_FLOOR_CELLS if shape == "sheet" else ROD_FLOOR_CELLS
    places = list(itertools.product(PHASES, TILTS_DEG))

    def scan(floor_cells: float) -> list[float]:
        return [
            ratio(shape, t_dx=t_dx, floor_cells=floor_cells, phase=phase, tilt_deg=tilt_deg)
            for phase, tilt_deg in places
        ]

    product = scan(floor)
    raw = scan(0.0) if t_dx < floor else product
    return Outcome(
        (
            Check.between("as the product simulates it, smallest f / theory", min(product), low=0.9),
            Check.between("as the product simulates it, largest f / theory", max(product), high=1.1),
            Check.between("as it is, smallest f / theory", min(raw)),
            Check.between("as it is, largest f / theory", max(raw)),
        )
    )
