"""Directions in which an object could stand: planes that touch it in many places.

A plane is brought up to the object from each of 3,000 directions. Its contact is the largest number of points in a band
of 1.5 % of the object's size within the first 5 %, so that haze below the ground does not lift the object. Local maxima
of the contact are candidates, each turned to the plane that fits the points in its band; the principal axes of the
object join them, for rounded objects touch the ground at hardly any point, and so do the opposites of the widest
contacts: the top of a pedestal may be wider than its feet.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, KDTree

from phys4dgen.upright.occupied import Occupied

__all__ = ["BAND", "Contact", "candidate_downs", "contact_below", "fitted_to_base"]

BAND = 0.015
"""Thickness of the band, of the object's size."""

_BIN = 0.0025
_DEEPEST = 0.05
_BINS = round(_DEEPEST / _BIN)
_BAND_BINS = round(BAND / _BIN)
_DIRECTIONS = 3000
_MOST_PEAKS = 16
_MOST_OPPOSITES = 8
_FARTHEST_PEAK_DEG = 8.0
_LARGEST_TURN_DEG = 12.0
_SAME_DEG = 4.0
_SKIN = 0.07
_MOST_FACETS = 400
_FITTING_BANDS = (0.02, 0.015, 0.015, 0.01, 0.01)
_BASE = 0.03
_BASE_ROUNDS = 4
_LEAST_WIDTH = 4.0


class Contact(NamedTuple):
    """Where the ground meets the object.

    Attributes:
        points: that lie in the band.
        height: of the lower side of the band along ``down``, input units.
    """

    points: int
    height: float


class _Skin(NamedTuple):
    """Points that a plane can touch, and how many of the outermost are left out as noise."""

    points: NDArray[np.float64]
    ignored: int


def candidate_downs(cells: Occupied) -> NDArray[np.float64]:
    """Unit vectors that may point down, the widest contact first, shape [C, 3]."""
    skin = _skin(cells)
    found: list[NDArray[np.float64]] = []

    def add(down: NDArray[np.float64]) -> None:
        if all(float(down @ other) < np.cos(np.radians(_SAME_DEG)) for other in found):
            found.append(down)

    for peak in _peaks(skin, cells.size):
        add(_fitted(skin, peak, cells.size))
        if len(found) == _MOST_PEAKS:
            break
    offsets = cells.points - cells.points.mean(0)
    for axis in np.linalg.eigh(offsets.T @ offsets)[1].T:
        for down in (axis, -axis):
            add(_fitted(skin, down, cells.size))
            add(down)
    for stand in found[:_MOST_OPPOSITES]:
        add(-stand)
    return np.array(found)


def contact_below(cells: Occupied, down: NDArray[np.float64]) -> Contact:
    """The widest contact near the lowest points."""
    along = cells.points @ down
    return _contact(along, _lowest(along, _ignored(cells)), cells.size)


def fitted_to_base(cells: Occupied, start: NDArray[np.float64]) -> NDArray[np.float64]:
    """The direction turned, by 12 degrees at most, until it is normal to all that lies within 3 % of the ground.

    The narrow band that finds a stand may cut a thick saucer slantwise; this one holds it whole. A base that is hardly
    wider than the band is thick has no such normal.
    """
    down = start
    for _ in range(_BASE_ROUNDS):
        along = cells.points @ down
        base = cells.points[np.abs(along - contact_below(cells, down).height) < _BASE * cells.size]
        offsets = base - base.mean(0)
        spread, axes = np.linalg.eigh(offsets.T @ offsets)
        normal = axes[:, 0] if axes[:, 0] @ down > 0 else -axes[:, 0]
        too_narrow = spread[1] < _LEAST_WIDTH**2 * spread[0]
        if too_narrow or normal @ start < np.cos(np.radians(_LARGEST_TURN_DEG)):
            return down
        down = normal
    return down


def _skin(cells: Occupied) -> _Skin:
    """Points near the convex hull."""
    equations = ConvexHull(cells.points).equations
    if len(equations) > _MOST_FACETS:
        equations = equations[np.random.default_rng(0).choice(len(equations), _MOST_FACETS, replace=False)]
    outside = (cells.points @ equations[:, :3].T + equations[:, 3]).max(1)
    return _Skin(cells.points[outside > -_SKIN * cells.size], _ignored(cells))


def _ignored(cells: Occupied) -> int:
    return max(2, round(0.001 * len(cells.points)))


def _lowest(along: NDArray[np.float64], ignored: int) -> float:
    place = max(len(along) - ignored, 0)
    return float(np.partition(along, place)[place])


def _contact(along: NDArray[np.float64], lowest: float, size: float) -> Contact:
    depth = np.maximum(lowest - along, 0) / size
    bins = (depth[depth < _DEEPEST + BAND] / _BIN).astype(np.int64)
    below = np.concatenate([[0], np.cumsum(np.bincount(bins, minlength=_BINS + _BAND_BINS))])
    in_band = below[_BAND_BINS : _BINS + 1] - below[: _BINS + 1 - _BAND_BINS]
    first = int(in_band.argmax())
    return Contact(int(in_band[first]), lowest - first * _BIN * size)


def _peaks(skin: _Skin, size: float) -> NDArray[np.float64]:
    """Directions whose contact is the largest within 8 degrees, the largest first."""
    directions, neighbours = _directions()
    along = directions.astype(np.float32) @ skin.points.T.astype(np.float32)
    place = max(along.shape[1] - skin.ignored, 0)
    lowest = np.partition(along, place, axis=1)[:, place]
    counts = np.array([_contact(row, low, size).points for row, low in zip(along, lowest, strict=True)])
    peaks = np.flatnonzero([counts[i] >= counts[near].max() for i, near in enumerate(neighbours)])
    return directions[peaks[np.argsort(-counts[peaks], kind="stable")]]


@cache
def _directions() -> tuple[NDArray[np.float64], tuple[list[int], ...]]:
    """Evenly spread directions, and those within 8 degrees of each."""
    directions = _sphere(_DIRECTIONS)
    reach = 2 * np.sin(np.radians(_FARTHEST_PEAK_DEG) / 2)
    return directions, tuple(KDTree(directions).query_ball_point(directions, reach))


def _fitted(skin: _Skin, start: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """The direction turned until it is normal to the points that the plane touches; at most 12 degrees."""
    down = start
    for band in _FITTING_BANDS:
        along = skin.points @ down
        contact = _contact(along, _lowest(along, skin.ignored), size)
        touching = skin.points[np.abs(along - contact.height + 0.5 * BAND * size) < band * size]
        if len(touching) < 8:
            return down
        offsets = touching - touching.mean(0)
        spread, axes = np.linalg.eigh(offsets.T @ offsets / len(offsets))
        normal = axes[:, 0] * (1.0 if axes[:, 0] @ down > 0 else -1.0)
        if spread[1] < (BAND * size) ** 2 or normal @ start < np.cos(np.radians(_LARGEST_TURN_DEG)):
            return down
        down = normal
    return down


def _sphere(count: int) -> NDArray[np.float64]:
    """Evenly spread unit vectors (Fibonacci's spiral), shape [count, 3]."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.pi * (1 + 5**0.5) * (np.arange(count) + 0.5)
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], 1)
