"""Particles: solids on a lattice of half a grid cell, sheets on two faces, ribbons in four strands and rods in nine.

Two layers at +-t / (2 sqrt 3) of the mid-surface have the second moment t^3 / 12 of the true sheet, so that MPM
bends it as Euler and Bernoulli say although it is thinner than a grid cell; one layer would not resist bending at
all. Inside a wide sheet that is not too oblique one particle per site, on one face and on the other by turns as on a
chequerboard, bends nearly as well for half the price; its rim has both (decision 12). 3 x 3 strands sqrt(3/32) d apart
have the second moment of a round rod, (d/4)^2, and keep it when the rod is thickened to three cells; 2 x 2 strands at
+-d/4 lose energy once they stand a cell apart (measured: damping ratio 0.12 at a diameter of 2 cells, against 0.005 for
3 x 3 at 3.2). (PHYSICS.md 1.11.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.interior.ribbons import measure_width
from phys4dgen.interior.sites import Sites
from phys4dgen.types import ROD, SHEET, SOLID

__all__ = ["Seeds", "join_seeds", "seed_rods", "seed_sheets", "seed_solid"]

_LARGEST_SPACING_CELLS = 0.501
"""Of particles by turns: three quarters of a cell apart they are far too soft (decision 12)."""


@dataclass(frozen=True, eq=False)
class Seeds:
    """Particles before they know their part; lengths in voxels, upright axes.

    Attributes:
        middle: on the mid-surface, centre line, or the particle itself in solids, [P, 3].
        offset: from the middle to the particle at the true thickness, [P, 3].
        volume: voxels cubed, [P].
        shape: SOLID, SHEET or ROD, [P], int8.
        thickness: sheet thickness or rod diameter, NaN in solids, [P].
        measured: the thickness was read from the Gaussians, [P].
        site: number of the site that the particle belongs to; solids are a site each, [P].
    """

    middle: NDArray[np.float64]
    offset: NDArray[np.float64]
    volume: NDArray[np.float64]
    shape: NDArray[np.int8]
    thickness: NDArray[np.float64]
    measured: NDArray[np.bool_]
    site: NDArray[np.int32]


def seed_solid(index: NDArray[np.int64], share: NDArray[np.float64]) -> Seeds:
    """One particle at the centre of every thick voxel; its volume is the share of the voxel that is solid."""
    p = len(index)
    return Seeds(
        index.astype(np.float64),
        np.zeros((p, 3)),
        share,
        np.full(p, SOLID, np.int8),
        np.full(p, np.nan),
        np.zeros(p, bool),
        np.arange(p, dtype=np.int32),
    )


def seed_sheets(
    sites: Sites, thickness: NDArray[np.float64], measured: NDArray[np.bool_], *, spacing_cells: float = 0.5
) -> Seeds:
    """Particles of a sheet, at +-t / (2 sqrt 3) along the normal: both at the rim, one of the two by turns inside.

    Where the sheet is a ribbon (ribbons.py) there are four per site, in a square and in a diamond by turns across the
    ribbon; both have the second moments of the site's cross-section, one voxel wide and t thick.

    Args:
        sites: of sheets, S of them.
        thickness: in voxels, [S].
        measured: the thickness was read from the Gaussians, [S].
        spacing_cells: a voxel in grid cells; beyond half a cell both faces stay everywhere.
    """
    width = measure_width(sites)
    odd, narrow = sites.is_odd[:, None], width.is_narrow[:, None]
    half, corner = 1 / (2 * math.sqrt(3)), 1 / math.sqrt(6)
    sides = np.where(odd, [corner, -corner, 0, 0], [half, half, -half, -half])
    rises = np.where(odd, [0, 0, corner, -corner], [half, -half, half, -half])
    sides = np.where(narrow, sides, 0.0)
    rises = np.where(narrow, rises, [half, -half, 0, 0])
    # Columns of the table: one face, the other face, and two more of a ribbon.
    by_turns = np.where(odd, [True, False, False, False], [False, True, False, False])
    is_single = width.is_inner & (spacing_cells <= _LARGEST_SPACING_CELLS)
    present = np.where(is_single[:, None], by_turns, narrow | (np.arange(4) < 2))
    site, column = np.nonzero(present)
    p = len(site)
    return Seeds(
        sites.position[site] + sides[site, column][:, None] * width.across[site],
        (rises[site, column] * thickness[site])[:, None] * sites.direction[site],
        (sites.extent * thickness / present.sum(1))[site],
        np.full(p, SHEET, np.int8),
        thickness[site],
        measured[site],
        site.astype(np.int32),
    )


def seed_rods(sites: Sites, diameter: NDArray[np.float64], measured: NDArray[np.bool_]) -> Seeds:
    """Nine particles per site, in 3 x 3 strands across the axis."""
    s = len(sites)
    axis = sites.direction
    # The same helper axis along a whole rod keeps the strands straight.
    helper = np.where(np.abs(axis[:, 2:]) < 0.9, [[0.0, 0, 1]], [[1.0, 0, 0]])
    a = np.cross(axis, helper)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(axis, a)
    step = math.sqrt(3 / 32) * diameter[:, None]
    strands = np.stack([step * (i * a + j * b) for i in (-1, 0, 1) for j in (-1, 0, 1)], 1)
    return Seeds(
        np.repeat(sites.position, 9, 0),
        strands.reshape(-1, 3),
        np.repeat(sites.extent * math.pi * diameter**2 / 36, 9),
        np.full(9 * s, ROD, np.int8),
        np.repeat(diameter, 9),
        np.repeat(measured, 9),
        np.repeat(np.arange(s, dtype=np.int32), 9),
    )


def join_seeds(groups: list[Seeds]) -> Seeds:
    """All particles in one list; no two groups share a site."""
    first = np.cumsum([0, *(g.site.max(initial=-1) + 1 for g in groups[:-1])])
    return Seeds(
        np.concatenate([g.middle for g in groups]),
        np.concatenate([g.offset for g in groups]),
        np.concatenate([g.volume for g in groups]),
        np.concatenate([g.shape for g in groups]),
        np.concatenate([g.thickness for g in groups]),
        np.concatenate([g.measured for g in groups]),
        np.concatenate([g.site + offset for g, offset in zip(groups, first, strict=True)]).astype(np.int32),
    )
