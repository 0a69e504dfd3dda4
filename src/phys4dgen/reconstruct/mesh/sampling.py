"""Points on triangles, evenly spaced: no two nearer than a distance, no place further than it from one.

Dart throwing (Cook 1986, "Stochastic sampling in computer graphics") of random candidates, all at once: in each round
every candidate whose rank is best among its live neighbours stays and its neighbours go (Luby 1986).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

__all__ = ["Samples", "even_samples"]

CANDIDATES = 6
"""Thrown per sample wanted."""
PACKING = 0.54
"""Samples times squared distance over area, as CANDIDATES leave it; measured."""


class Samples(NamedTuple):
    """Points on triangles.

    Attributes:
        points: shape [N, 3].
        faces: triangle of each, shape [N].
        weights: barycentric coordinates in it, shape [N, 3].
        normals: unit normals of the triangles, shape [N, 3].
        spacing: root of the area per sample, units of the triangles.
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int64]
    weights: NDArray[np.float64]
    normals: NDArray[np.float64]
    spacing: float


def even_samples(triangles: NDArray[np.float64], count: int, *, seed: int = 0) -> Samples:
    """About ``count`` points, evenly spread by area.

    Args:
        triangles: corners, shape [F, 3, 3]; those without area get no point.
        count: samples wanted; the result differs by a few per cent.
        seed: of the random numbers.

    Raises:
        ValueError: the triangles have no area.
    """
    rng = np.random.default_rng(seed)
    twice = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(twice, axis=1)
    area = 0.5 * float(lengths.sum())
    if not area > 0:
        raise ValueError("triangles: expected a surface, got triangles without area.")
    thrown = CANDIDATES * count
    # One candidate per equal share of the area, in random order: the order is the rank.
    places = (rng.permutation(thrown) + rng.random(thrown)) / thrown
    faces = np.searchsorted(np.cumsum(lengths) / lengths.sum(), places, side="right")
    faces = np.minimum(faces, len(triangles) - 1)
    root, second = np.sqrt(rng.random(thrown)), rng.random(thrown)
    weights = np.stack([1 - root, root * (1 - second), root * second], 1)
    points = np.einsum("nk,nkd->nd", weights, triangles[faces])
    normals = twice[faces] / np.maximum(lengths[faces], 1e-300)[:, None]
    kept = _spread(points, normals, distance=math.sqrt(PACKING * area / count))
    return Samples(points[kept], faces[kept], weights[kept], normals[kept], math.sqrt(area / len(kept)))


def _spread(points: NDArray[np.float64], normals: NDArray[np.float64], *, distance: float) -> NDArray[np.int64]:
    """Indices of points of which no two on the same side of the surface are nearer than ``distance``."""
    pairs = np.sort(KDTree(points).query_pairs(distance, output_type="ndarray"), axis=1)
    first, second = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(1) > 0].T
    alive = np.ones(len(points), bool)
    while len(first):
        beaten = np.zeros(len(points), bool)
        beaten[second] = True
        stays = alive & ~beaten
        alive[second[stays[first]]] = False
        open_pairs = alive[first] & alive[second]
        first, second = first[open_pairs], second[open_pairs]
    return np.flatnonzero(alive)
