"""Clamped strips cut from oblique sheets: frequency over theory and damping, by how their sites are seeded.

    python benchmarks/strips.py

One strip per normal, one cell thick and twelve sites wide, with the sites that interior discovery makes: one per voxel
column. It starts with a bend and swings, nothing damped. Three seedings: both faces everywhere, one face by turns
inside however oblique the sheet is, and the product's own; then, with sites three quarters of a cell apart, by turns
against both faces. Printed: area per site in voxels squared, particles, frequency over that of a clamped beam, and
damping ratio (by the first and the last swing; 0.3 is where the estimate ends). Exit code 1 where the product's own
frequency is more than 0.05 from that of both faces, or its damping ratio more than 0.025 above.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace

import numpy as np

from phys4dgen.interior.seed import seed_sheets
from phys4dgen.interior.sites import Sites
from phys4dgen.motion import damped_frequency
from phys4dgen.mpm import Body, Settings, Simulator

NORMALS = (
    (0, 0, 1),
    (0, 0.34, 1),
    (1, 0.5, 0.5),
    (1, 0.7, 0.2),
    (1, 0.6, 0.6),
    (1, 0.7, 0.7),
    (-1, 0.8, 0.9),
    (1, 1, 1),
)
CELL_M, E_PA, RHO_KGM3 = 5e-3, 2e4, 60.0
CLAMPED_FREE = 0.1615  # f = 0.1615 t / L^2 sqrt(E / rho), first mode of a beam of thickness t
LENGTH_CELLS, WIDTH_SITES, HELD_SITES = 30, 12, 6
FRAMES, FRAMES_PER_PERIOD = 44, 20
CLOSE_FREQUENCY, CLOSE_DAMPING = 0.05, 0.025


def main() -> int:
    """Print the table; 1 where the product's seeding does worse than it should."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    far = 0
    for normal in NORMALS:
        sites, along = strip(normal, spacing_cells=0.5)
        # Cells without area never count as too oblique; voxels of a whole cell never carry one face alone.
        flat = replace(sites, edge_a=0 * sites.edge_a, edge_b=0 * sites.edge_b)
        both = swing(sites, along, spacing_cells=0.5, seeded_as_cells=1.0)
        turns = swing(flat, along, spacing_cells=0.5, seeded_as_cells=0.5)
        own = swing(sites, along, spacing_cells=0.5, seeded_as_cells=0.5)
        print(f"{normal!s:16} {sites.extent[0]:.2f}   both {_row(both)}   by turns {_row(turns)}   now {_row(own)}")
        far += abs(own[1] - both[1]) > CLOSE_FREQUENCY or own[2] - both[2] > CLOSE_DAMPING
    print("sites three quarters of a cell apart")
    for normal in NORMALS[:3]:
        sites, along = strip(normal, spacing_cells=0.75)
        both, turns = (swing(sites, along, spacing_cells=0.75, seeded_as_cells=cells) for cells in (0.75, 0.5))
        print(f"{normal!s:16} {sites.extent[0]:.2f}   both {_row(both)}   by turns {_row(turns)}")
    return int(far > 0)


def strip(normal: tuple[float, ...], *, spacing_cells: float) -> tuple[Sites, np.ndarray]:
    """Column sites of a strip, in voxels, and the direction of its long side."""
    n = np.array(normal) / np.linalg.norm(normal)
    axis = int(np.abs(n).argmax())
    n *= np.sign(n[axis])
    others = [(axis + 1) % 3, (axis + 2) % 3]
    edges = np.zeros((2, 3))
    edges[[0, 1], others] = 1
    edges[:, axis] = -n[others] / n[axis]
    length = LENGTH_CELLS / spacing_cells
    reach = np.arange(-int(length), int(length) + 1)
    columns = np.stack(np.meshgrid(reach, reach, indexing="ij"), -1).reshape(-1, 2)
    along = np.cross(n, [0.3, 0.5, 0.81])  # oblique to the columns
    along /= np.linalg.norm(along)
    position = columns @ edges
    inside = (np.abs(position @ along) < length / 2) & (np.abs(position @ np.cross(n, along)) < WIDTH_SITES / 2)
    s = int(inside.sum())
    sites = Sites(
        position[inside],
        np.tile(n, (s, 1)),
        np.full(s, 1 / n[axis]),
        np.tile(edges[0], (s, 1)),
        np.tile(edges[1], (s, 1)),
        is_bridge=np.zeros(s, bool),
        is_odd=columns[inside].sum(1) % 2 > 0,
    )
    return sites, along


def swing(sites: Sites, along: np.ndarray, *, spacing_cells: float, seeded_as_cells: float) -> tuple[int, float, float]:
    """Particles, frequency over theory and damping ratio of the strip, clamped at one end.

    ``seeded_as_cells`` is the spacing that the seeding is told, which decides whether one face may do.
    """
    voxel_m = CELL_M * spacing_cells
    thickness = np.full(len(sites), 1 / spacing_cells)
    seeds = seed_sheets(sites, thickness, np.ones(len(sites), bool), spacing_cells=seeded_as_cells)
    points_m = (seeds.middle + seeds.offset) * voxel_m
    p = len(points_m)
    along_m = points_m @ along
    along_m -= along_m.min() + HELD_SITES * voxel_m
    length_m = LENGTH_CELLS * CELL_M - HELD_SITES * voxel_m
    frequency_hz = CLAMPED_FREE * CELL_M / length_m**2 * math.sqrt(E_PA / RHO_KGM3)
    speed_ms = np.clip(along_m / length_m, 0, 1) ** 2 * 2 * math.pi * frequency_hz * 0.1 * length_m
    normal = sites.direction[0]
    body = Body(
        positions_m=points_m - points_m.min(0) + 0.3 * CELL_M,
        volume_m3=seeds.volume * voxel_m**3,
        density_kgm3=np.full(p, RHO_KGM3),
        youngs_modulus_pa=np.full(p, E_PA),
        poisson_ratio=np.zeros(p),
        law=np.zeros(p, np.int32),
        part=np.zeros(p, np.int32),
        held=along_m < 0,
        part_names=("strip",),
        velocities_ms=speed_ms[:, None] * normal,
    )
    step_s = 1 / (FRAMES_PER_PERIOD * frequency_hz)
    simulator = Simulator(body, Settings(dx_m=CELL_M, frame_time_s=step_s, cfl=0.6, chunks=1))
    tip = along_m > along_m.max() - 2 * voxel_m
    rest = body.positions_m[tip]
    moved = np.array([((simulator.advance().positions_m[tip] - rest) @ normal).mean() for _ in range(FRAMES)])
    found_hz, ratio = damped_frequency(moved, step_s)
    return p, found_hz / frequency_hz, ratio


def _row(found: tuple[int, float, float]) -> str:
    return "{:5} {:.3f} {:.3f}".format(*found)


if __name__ == "__main__":
    sys.exit(main())
