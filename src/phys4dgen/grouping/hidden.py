"""Parts of Gaussians that no view shows: undersides, what lies between things, what is faint or stray.

They follow the part that is near and has a like colour there. Near means along the surface that they themselves form:
the underside of a plate goes on into its rim, though the cup that stands on the plate is nearer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.grouping.lighting import LAB_OFFSET
from phys4dgen.grouping.supervoxels import LIGHTNESS_WEIGHT
from phys4dgen.types import Gaussians
from phys4dgen.types.color import srgb_to_lab

__all__ = ["follow"]

_AROUND = 16
"""How many Gaussians of a part say what colour it has there: the colour of a single one is mostly noise."""
_LEAST_WEIGHT = 0.02
"""Added to opacity, by which Gaussians count in that colour."""
_COLOR_SCALE = 16.0
"""Difference of colour, light aside, at which a Gaussian belongs to a part much less."""
_LIGHT_WEIGHT = 0.25
"""How much of a difference that more or less light explains counts."""
_DISTANCE_FLOOR = 0.03
"""Of the object's radius: parts nearer than this are equally near."""
_CELL = 0.05
"""Of the object's radius: cells in which the places of a part are averaged before distances are taken."""
_CELLS_AROUND = 32
"""How many of a part's nearest cells are asked for the least distance along the surface."""
_ACROSS = 16.0
"""By how much squared distances across the surface that a Gaussian lies in count more than those along it."""
_SURFACE_NEIGHBOURS = 24
"""Gaussians that say how that surface lies."""
_SOLID = 0.05
"""Opacity from which a Gaussian counts there."""


def follow(
    gaussians: Gaussians, core: NDArray[np.intp], label: NDArray[np.int64], rest: NDArray[np.intp], *, radius: float
) -> NDArray[np.int64]:
    """Part that is near and, where it is near, of like colour, for each Gaussian of ``rest``, shape [M].

    Every part is asked, not only the few nearest Gaussians: a white Gaussian buried in the pot lies closer to the soil.

    Args:
        gaussians: N static Gaussians.
        core: indices of those whose part is known, at least one, shape [K].
        label: their parts, shape [K].
        rest: indices of the others, shape [M].
        radius: half the object's diagonal, input units.
    """
    lab = srgb_to_lab(gaussians.base_colors) * [LIGHTNESS_WEIGHT, 1, 1]
    lab[:, 0] += LIGHTNESS_WEIGHT * LAB_OFFSET  # all three now shrink by one factor where there is less light
    opacities = gaussians.opacities.astype(np.float64) + _LEAST_WEIGHT
    means = gaussians.means.astype(np.float64)
    places = means[rest]
    normals = _normals(means[np.union1d(core, np.flatnonzero(gaussians.opacities > _SOLID))], places)
    floor = _DISTANCE_FLOOR * radius
    best = np.full(len(rest), -1.0)
    part = np.zeros(len(rest), np.int64)
    for candidate in np.unique(label):
        members = core[label == candidate]
        distance, near = _nearest(means[members], places, _AROUND)
        near = members[near]
        weight = opacities[near] / (distance + floor)
        local = (weight[:, :, None] * lab[near]).sum(1) / weight.sum(1)[:, None]
        likeness = np.exp(-_difference_but_for_light(lab[rest], local) / _COLOR_SCALE)
        score = likeness / (_distance_along(_cells(means[members], _CELL * radius), places, normals) + floor)
        part = np.where(score > best, candidate, part)
        best = np.maximum(score, best)
    return part


def _nearest(
    points: NDArray[np.float64], places: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Distances and indices of the nearest ``points`` [P, 3] to each place [M, 3], both [M, at most count]."""
    distance, index = KDTree(points).query(places, min(count, len(points)), workers=-1)
    return distance.reshape(len(places), -1), index.reshape(len(places), -1)


def _normals(points: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Direction in which the points about each place spread least, shape [M, 3]."""
    _, index = _nearest(points, places, _SURFACE_NEIGHBOURS)
    offset = points[index]
    offset -= offset.mean(1, keepdims=True)
    return np.linalg.eigh(np.einsum("mki,mkj->mij", offset, offset))[1][:, :, 0]


def _cells(points: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Mean place of the points in each cubic cell that holds any, shape [C, 3]."""
    _, cell = np.unique(np.floor(points / size).astype(np.int64), axis=0, return_inverse=True)
    cell = cell.ravel()
    return np.stack([np.bincount(cell, axis) for axis in points.T], 1) / np.bincount(cell)[:, None]


def _distance_along(
    points: NDArray[np.float64], places: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Least distance from each place to the points, more where it leads across the surface there, shape [M]."""
    distance, index = _nearest(points, places, _CELLS_AROUND)
    across = ((points[index] - places[:, None]) * normals[:, None]).sum(2)
    return np.sqrt((distance**2 + (_ACROSS - 1) * across**2).min(1))


def _difference_but_for_light(shown: NDArray[np.float64], lit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Difference of colours (lightness from where light shrinks it to nothing, a, b), both [M, 3]; shape [M].

    What no camera of the views sees lies mostly in the shade, inside and between things. There all colours are nearly
    black, and the darkest part would win everything; hence less light than on ``lit`` is held against it but little.
    """
    square = (lit**2).sum(1)
    light = np.clip((shown * lit).sum(1) / square, 0, 1)
    residual = ((shown - light[:, None] * lit) ** 2).sum(1)
    return np.sqrt(residual + square * (_LIGHT_WEIGHT * (1 - light)) ** 2)
