"""Which way the surface faces at each Gaussian: away from the inside, towards the cameras that see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.types import Gaussians, Views

__all__ = ["OrientedPoints", "oriented_points", "seen_from"]

_SOLID_OPACITY = 0.3
_NEIGHBORS = 12
_MASK_ALPHA = 0.5


@dataclass(frozen=True, eq=False)
class OrientedPoints:
    """Gaussians that some view sees, in upright axes and input units.

    Attributes:
        position: centres, [M, 3].
        normal: unit, outward, [M, 3].
        area: of the surface that the Gaussian stands for, [M].
        index: number among all Gaussians, [M].
    """

    position: NDArray[np.float64]
    normal: NDArray[np.float64]
    area: NDArray[np.float64]
    index: NDArray[np.int64]


def oriented_points(
    gaussians: Gaussians,
    views: Views,
    *,
    rotation: NDArray[np.float64],
    tolerance: float,
    chosen: NDArray[np.int64] | None = None,
) -> OrientedPoints:
    """Normals of the visible Gaussians, from their flatness and from how their neighbours lie.

    Args:
        gaussians: the object.
        views: rendered views with alpha and median depth.
        rotation: input axes -> upright axes, [3, 3].
        tolerance: how far behind the depth of a pixel a Gaussian still counts as seen, input units.
        chosen: numbers of the views that count; None for all.
    """
    index = np.flatnonzero(gaussians.opacities > _SOLID_OPACITY)
    seen, toward = seen_from(gaussians.means[index].astype(np.float64), views, tolerance=tolerance, chosen=chosen)
    index, toward = index[seen], toward[seen] @ rotation.T
    position = gaussians.means[index].astype(np.float64) @ rotation.T
    if len(index) == 0:
        return OrientedPoints(position, position, np.zeros(0), index)
    covariance = rotation @ gaussians.subset(index).covariances() @ rotation.T
    k = min(_NEIGHBORS, len(index))
    distance, near = KDTree(position).query(position, k=k, workers=-1)
    distance, near = distance.reshape(-1, k), near.reshape(-1, k)
    around = position[near] - position[near].mean(1, keepdims=True)
    shape = covariance + np.einsum("nka,nkb->nab", around, around) / k
    normal = np.linalg.eigh(shape)[1][:, :, 0]
    normal *= np.where((normal * toward).sum(1) < 0, -1.0, 1.0)[:, None]
    # Of the neighbours only those that face the same way share the area: the other face of a wall does not.
    alike = np.einsum("na,nka->nk", normal, normal[near]) > 0
    area = np.pi * distance[:, -1] ** 2 / alike.sum(1)
    return OrientedPoints(position, normal, area, index)


def seen_from(
    points: NDArray[np.float64], views: Views, *, tolerance: float, chosen: NDArray[np.int64] | None = None
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether any view sees each point [M, 3] (input axes), and the sum of the unit vectors to the views that do."""
    seen = np.zeros(len(points), bool)
    toward = np.zeros((len(points), 3))
    for k in range(len(views)) if chosen is None else chosen:
        camera = views.cameras[k]
        pixels, depth = camera.project(points)
        column, row = np.floor(pixels.T).astype(np.int64)
        inside = (depth > 0) & (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
        number = np.flatnonzero(inside)
        row, column = row[number], column[number]
        shown = (views.alpha[k, row, column] > _MASK_ALPHA) & (depth[number] <= views.depth[k, row, column] + tolerance)
        number = number[shown]
        ray = camera.position - points[number]
        toward[number] += ray / np.linalg.norm(ray, axis=1, keepdims=True)
        seen[number] = True
    return seen, toward
