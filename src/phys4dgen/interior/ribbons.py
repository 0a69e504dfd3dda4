"""How wide a sheet is around each of its sites.

Where it is only one or two sites wide (grass, the blades of a palm, the tips of leaves), two layers are not enough. Two
layers of such a ribbon make a chain of two or four particles per step along it, always at the same places of the
cross-section. Oblique to the grid, MLS-MPM has modes that a chain like that does not feel: a ribbon of two sites
swung with a damping ratio of 0.30 where none was asked for and stayed bent; one of one site was limp. The same ribbon
with four particles per site, in a square and in a diamond by turns, has 0.02 to 0.05 (decision 12).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.interior.sites import Sites

__all__ = ["SheetWidth", "measure_width"]

_REACH = 3.2
_FLATNESS = 0.5
_SAME_SHEET = 0.7
"""A neighbour belongs to the same sheet where it lies beside the site (sine of its rise) and faces the same way."""

_NARROW = 2.5
_FIRST_RING = 1.6
_LARGEST_ANGLE = math.radians(70)
"""Seen from a site, its neighbours beyond the first ones leave no wider angle open where the sheet goes on for two or
more sites to every side. Two rows from a straight edge it is 35 degrees at most, one row from it 74 or more, whatever
the normal; captures are between."""

_LARGEST_CELL = 1.35
"""Of a site's cell on the sheet, voxels squared. The columns of more oblique sheets stand in a triangular lattice, on
which two colours cannot alternate: with one particle per site, such a sheet is too soft (decision 12)."""


@dataclass(frozen=True, eq=False)
class SheetWidth:
    """What is around each of S sites of sheets.

    Attributes:
        is_narrow: the sheet is a ribbon, one or two sites wide, [S].
        is_inner: the sheet goes on for two sites or more to every side, and they lie much as a square lattice, [S].
        across: unit vector in the sheet, across the ribbon, [S, 3].
    """

    is_narrow: NDArray[np.bool_]
    is_inner: NDArray[np.bool_]
    across: NDArray[np.float64]


def measure_width(sites: Sites) -> SheetWidth:
    """Width of a sheet around its sites, which are one voxel apart, from how its sites spread there."""
    s = len(sites)
    pairs = KDTree(sites.position).query_pairs(_REACH, output_type="ndarray") if s else np.zeros((0, 2), np.intp)
    apart = sites.position[pairs[:, 1]] - sites.position[pairs[:, 0]]
    one, other = sites.direction[pairs[:, 0]], sites.direction[pairs[:, 1]]
    rise = np.maximum(np.abs((apart * one).sum(1)), np.abs((apart * other).sum(1)))
    same = (rise < _FLATNESS * np.linalg.norm(apart, axis=1)) & (np.abs((one * other).sum(1)) > _SAME_SHEET)
    pairs, apart = pairs[same], apart[same]

    count = 1.0 + np.bincount(pairs.ravel(), minlength=s)
    first, second = np.zeros((s, 3)), np.zeros((s, 3, 3))
    product = apart[:, :, None] * apart[:, None, :]
    for column, sign in ((0, 1.0), (1, -1.0)):
        np.add.at(first, pairs[:, column], sign * apart)
        np.add.at(second, pairs[:, column], product)
    mean = first / count[:, None]
    covariance = second / count[:, None, None] - mean[:, :, None] * mean[:, None, :]
    flat = np.eye(3) - sites.direction[:, :, None] * sites.direction[:, None, :]
    variances, axes = np.linalg.eigh(flat @ covariance @ flat)
    # n sites in a row, one voxel apart, have the variance (n^2 - 1) / 12.
    width = np.sqrt(12 * np.maximum(variances[:, 1], 0) + 1)
    across = np.cross(sites.direction, axes[:, :, 2])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    is_narrow = (width < _NARROW) & (length[:, 0] > 0.5)
    cell = np.linalg.norm(np.cross(sites.edge_a, sites.edge_b), axis=1)
    is_inner = (_widest_angle(sites.direction, pairs, apart) < _LARGEST_ANGLE) & (cell < _LARGEST_CELL)
    return SheetWidth(is_narrow, is_inner, across / np.maximum(length, 1e-12))


def _widest_angle(
    normal: NDArray[np.float64], pairs: NDArray[np.intp], apart: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The widest angle in the sheet between the directions to a site's neighbours beyond the first ring, [S]."""
    far = np.linalg.norm(apart, axis=1) > _FIRST_RING
    site = np.concatenate([pairs[far, 0], pairs[far, 1]])
    step = np.concatenate([apart[far], -apart[far]])
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin(1)])
    v = np.cross(normal, u)
    angle = np.arctan2((step * v[site]).sum(1), (step * u[site]).sum(1))
    order = np.lexsort((angle, site))
    site, angle = site[order], angle[order]
    seen, first, count = np.unique(site, return_index=True, return_counts=True)
    following = np.roll(angle, -1)
    following[first + count - 1] = angle[first] + 2 * math.pi
    widest = np.full(len(normal), 2 * math.pi)
    widest[seen] = np.maximum.reduceat(following - angle, first) if len(seen) else 0.0
    return widest
