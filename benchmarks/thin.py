"""Bending frequency of thin sheets and rods over Euler-Bernoulli or Timoshenko theory.

    python benchmarks/thin.py [--quick]

A free strip or rod starts with the velocity of its first bending mode and swings. The table says its frequency over
theory, smallest and largest over where it lies between the grid's nodes and how it is tilted: as it is ("raw"), and as
the product simulates it, thickened at least to ``phys4dgen.body``'s floor ("product"). The mode of a free beam needs
no clamp, whose place is uncertain by a cell.

Why raw thin sheets are too stiff: the velocity gradient of MLS-MPM is a linear fit (the APIC matrix), which reads a
field x^2 with an error of its third central moment m3 = d/4 - d^3 at a distance d (cells) from the nearest node. A
curvature kappa thus makes a spurious shear 2 m3 kappa dx, alternating in sign, whose energy adds the factor
1 + 12 (G / E) (2 m3)^2 (dx / t)^2 to the bending stiffness, whatever the length: 2.32, or 1.52 times the frequency,
for nu = 0, d = 1/4 and t/dx = 0.2; none at d = 0 and 1/2; 1.026 times the frequency at most at t = dx.
"""

from __future__ import annotations

import argparse
import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.body import ROD_FLOOR_CELLS, SHEET_FLOOR_CELLS
from phys4dgen.motion import damped_frequency
from phys4dgen.mpm import Body, LawId, Settings, Simulator

DX_M = 0.005
E_PA = 1e6
RHO_KGM3 = 1000.0
SHAPES = ("sheet", "rod")
FREE_FREE = 4.730041  # first root of cos(k) cosh(k) = 1
FRAMES_PER_PERIOD = 20


def theory_hz(shape: str, *, t_m: float, length_m: float) -> float:
    """First bending frequency of a free beam of nu = 0, with Timoshenko's correction to first order."""
    gyration = t_m / math.sqrt(12) if shape == "sheet" else t_m / 4
    slow = FREE_FREE**2 / (2 * math.pi * length_m**2) * gyration * math.sqrt(E_PA / RHO_KGM3)
    shear = 2 / (5 / 6)  # E / (kappa G)
    return slow / math.sqrt(1 + (gyration / length_m) ** 2 * (12.3 + 49.5 * shear))


def cross_section(shape: str, t_m: float) -> tuple[NDArray[Any], float]:
    """Particle places across the axis (y, z) and the volume of each per metre of axis, as interior discovery seeds."""
    if shape == "rod" and t_m <= 3.01 * DX_M:
        strand = t_m * math.sqrt(3 / 32) * np.array([-1.0, 0.0, 1.0])
        places = np.stack(np.meshgrid(strand, strand, indexing="ij"), -1).reshape(-1, 2)
        return places, math.pi * t_m**2 / 4 / 9
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
    across = (np.arange(6) - 2.5) * h
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
    places, area = cross_section(shape, simulated)
    length = max(20.0, 14 * max(t_dx, floor_cells)) * DX_M
    along = np.arange(round(length / (DX_M / 2))) * DX_M / 2 + DX_M / 4
    x = np.concatenate([np.column_stack([np.full(len(places), s), places]) for s in along])
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
    one = np.ones(len(x))
    volume = np.append(np.full(len(x) - 1, area * DX_M / 2), (DX_M / 2) ** 3)
    modulus = E_PA / grow ** (power + 2) * one
    density = RHO_KGM3 / grow**power * one
    held = np.arange(len(x)) == len(x) - 1
    law, part = np.full(len(x), LawId.NEO_HOOKEAN, np.int32), np.zeros(len(x), np.int32)
    body = Body(x, volume, density, modulus, 0 * one, law, part, held, ("beam",), v)
    simulator = Simulator(body, Settings(DX_M, 1 / (FRAMES_PER_PERIOD * f), cfl=0.6, max_substeps_per_frame=10**6))
    normal = turn @ [0.0, 0.0, 1.0]
    weight = np.append(bend, 0.0) / (bend**2).sum()
    signal = [weight @ ((simulator.advance().positions_m - x) @ normal) for _ in range(2 * FRAMES_PER_PERIOD)]
    return damped_frequency(np.array(signal), 1 / (FRAMES_PER_PERIOD * f))[0] / f


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Bending of thin parts over theory.")
    parser.add_argument("--quick", action="store_true", help="two thicknesses, no tilts")
    quick = parser.parse_args().quick
    thicknesses = (0.2, 1.0) if quick else (0.1, 0.2, 0.5, 1.0, 2.0, 4.0)
    tilts = (0.0,) if quick else (0.0, 20.0, 45.0)
    phases = tuple(itertools.product((0.0, 0.25), (0.0, 0.5)))
    print(f"{'':22}{'raw: smallest':>15}{'largest':>9}{'product: smallest':>19}{'largest':>9}")
    for shape, t_dx in itertools.product(SHAPES, thicknesses):
        floor = SHEET_FLOOR_CELLS if shape == "sheet" else ROD_FLOOR_CELLS
        columns = []
        for cells in (0.0, floor):
            found = [
                ratio(shape, t_dx=t_dx, floor_cells=cells, phase=phase, tilt_deg=tilt)
                for phase, tilt in itertools.product(phases, tilts)
            ]
            columns += [min(found), max(found)]
        print(
            f"{shape + ',':6} t/dx = {t_dx:<8g}{columns[0]:15.3f}{columns[1]:9.3f}{columns[2]:19.3f}{columns[3]:9.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
