"""The fixed table of view directions: what ``object``, ``carve`` and ``scene`` mean.

ARCHITECTURE.md 2, Views; docs/conventions.md.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SceneError, did_you_mean
from phys4dgen.types.checks import frozen

__all__ = ["ViewPreset", "short_tour", "view_directions"]

ViewPreset = Literal["object", "carve", "scene"]

_SCENE_VIEWS = 120
_SCENE_LOWEST_DEG = -30.0
_GOLDEN_ANGLE_DEG = 180 * (3 - math.sqrt(5))


@cache
def view_directions(preset: ViewPreset) -> NDArray[np.float64]:
    """Azimuth and elevation of every view of a preset, in degrees, shape [V, 2]; see ``cameras`` for the axes.

    ``object``: 29 = 8 azimuths at -20, 10 and 40 deg, 4 azimuths at 70 deg, the top.
    ``carve``: 49 = 12 azimuths at -30, -5, 20 and 50 deg, the top.
    ``scene``: 120 = a Fibonacci sphere above -30 deg along a short closed path, so that neighbours look alike.
    """
    if preset == "object":
        return frozen(np.array([*_rings(8, (-20, 10, 40)), *_rings(4, (70,)), (0.0, 90.0)]))
    if preset == "carve":
        return frozen(np.array([*_rings(12, (-30, -5, 20, 50)), (0.0, 90.0)]))
    if preset == "scene":
        directions = _fibonacci_cap(_SCENE_VIEWS, _SCENE_LOWEST_DEG)
        return frozen(directions[short_tour(_unit_vectors(directions))])
    known = get_args(ViewPreset)
    raise SceneError(f"views.preset: expected one of {', '.join(known)}, got '{preset}'.{did_you_mean(preset, known)}")


def _rings(azimuth_count: int, elevations_deg: tuple[float, ...]) -> list[tuple[float, float]]:
    step_deg = 360 / azimuth_count
    return [(step_deg * i, float(elevation)) for elevation in elevations_deg for i in range(azimuth_count)]


def _fibonacci_cap(count: int, lowest_deg: float) -> NDArray[np.float64]:
    """``count`` directions of equal area on the sphere above an elevation; azimuth, elevation in degrees."""
    i = np.arange(count, dtype=np.float64)
    height = 1 - (i + 0.5) / count * (1 - math.sin(math.radians(lowest_deg)))
    azimuth_deg = np.mod(i * _GOLDEN_ANGLE_DEG, 360.0)
    return np.stack([azimuth_deg, np.degrees(np.arcsin(height))], axis=1).astype(np.float64)


def _unit_vectors(directions_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    azimuth, elevation = np.radians(directions_deg).T
    return np.stack(
        [np.cos(elevation) * np.sin(azimuth), -np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], axis=1
    )


def short_tour(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """A short closed tour through ``points`` [V, 3]: nearest neighbours, then 2-opt until nothing gets shorter."""
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    n = len(points)
    tour = [0]
    unvisited = set(range(1, n))
    while unvisited:
        nearest = min(sorted(unvisited), key=lambda j: distance[tour[-1], j])
        tour.append(nearest)
        unvisited.remove(nearest)
    order = np.array(tour)
    improved = True
    while improved:
        improved = False
        for i in range(n - 1):
            # Replace the edges (i, i+1) and (j, j+1) by (i, j) and (i+1, j+1), for the best j of all.
            j = np.arange(i + 1, n)
            after = order[(j + 1) % n]
            gain = distance[order[i], order[i + 1]] + distance[order[j], after]
            gain -= distance[order[i], order[j]] + distance[order[i + 1], after]
            best = int(np.argmax(gain))
            if gain[best] > 1e-9:
                order[i + 1 : j[best] + 1] = order[i + 1 : j[best] + 1][::-1]
                improved = True
    return order
