"""Objects that stand in each other at the start: how far one has to be moved until they are apart."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.errors import SceneError
from phys4dgen.progress import Progress
from phys4dgen.scene import PlacedObject

__all__ = ["overlap_m", "refuse_overlap"]

_INSIDE = 0.75
"""A particle nearer to one of another object, in particle spacings, lies in that object; neighbours in one object
stand one spacing apart."""

_STEPS = 12
"""Halvings of the search for the shift."""

_DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])


def refuse_overlap(
    points_m: Mapping[str, NDArray[np.float64]],
    objects: Mapping[str, PlacedObject],
    *,
    spacing_m: float,
    cell_m: float,
    progress: Progress,
) -> None:
    """Refuse objects that stand in each other by more than a grid cell, and warn where it is less.

    Args:
        points_m: particles of each object, metres, z up, [P, 3].
        objects: where the scene puts them.
        spacing_m: between neighbouring particles of one object.
        cell_m: grid cell dx.
        progress: told of objects that touch.

    Raises:
        SceneError: names two objects, how far they overlap, and a place where one would be free.
    """
    for first, second in combinations(points_m, 2):
        shift_m = overlap_m(points_m[first], points_m[second], spacing_m=spacing_m)
        depth_m = float(np.linalg.norm(shift_m))
        if depth_m > cell_m:
            place = ", ".join(f"{value:.4g}" for value in np.array(objects[second].position_m) + shift_m)
            raise SceneError(
                f"objects: '{first}' and '{second}' overlap by {_millimetres(depth_m)} at the start; move one of them, "
                f"for example with objects.{second}.position_m: [{place}]."
            )
        if depth_m > 0:
            progress.warn(
                f"{first} and {second} overlap by {_millimetres(depth_m)} at the start, less than a grid cell; what "
                "touches from the start sticks together until it is pulled apart."
            )


def overlap_m(first: NDArray[np.float64], second: NDArray[np.float64], *, spacing_m: float) -> NDArray[np.float64]:
    """The shortest shift along an axis that frees ``second`` of ``first``, [3]; zero where they do not overlap.

    Args:
        first: particles that fill an object, [P, 3].
        second: particles that fill another, [Q, 3].
        spacing_m: between neighbouring particles.
    """
    reach = _INSIDE * spacing_m
    tree = KDTree(first)

    def are_apart(points: NDArray[np.float64]) -> bool:
        low, high = first.min(0) - reach, first.max(0) + reach
        near = points[((points > low) & (points < high)).all(1)]
        return len(near) == 0 or not np.isfinite(tree.query(near, distance_upper_bound=reach)[0]).any()

    if are_apart(second):
        return np.zeros(3)
    shifts = []
    for direction in _DIRECTIONS:
        # at the far end the boxes are apart
        far = float((first @ direction).max() - (second @ direction).min()) + reach
        near = 0.0
        for _ in range(_STEPS):
            middle = 0.5 * (near + far)
            near, far = (near, middle) if are_apart(second + middle * direction) else (middle, far)
        shifts.append(far * direction)
    return min(shifts, key=lambda shift: float(np.linalg.norm(shift)))


def _millimetres(length_m: float) -> str:
    return f"{1e3 * length_m:.3g} mm"
