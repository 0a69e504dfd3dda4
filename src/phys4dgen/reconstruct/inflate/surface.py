"""Points on the surface of the inflated body, before perspective; lengths are working pixels.

The body is F(x, y, z) > 0 with F = v(x, y) - z^2, v = h^2 inside the outline and falling on steadily beyond it. F is
smooth at the rim, where h itself is not; that keeps the sides from becoming paper edges. The front is sampled once per
pixel where it faces the camera, everything else once per cell of a cubic lattice that the surface crosses.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

from phys4dgen.reconstruct.inflate.silhouette import Silhouette
from phys4dgen.reconstruct.inflate.thickness import smoothstep

__all__ = ["BACK_SPACING", "FRONT_SPACING", "Kind", "SurfacePoints", "Walls", "at", "surface_points", "walls"]

FRONT_SPACING = 1.25
"""Lattice of the steep front, px."""
BACK_SPACING = 1.6
"""Lattice of the back, px: nobody has a picture of it."""
STEEPEST_PER_PIXEL = 1.6
"""Slope of the front up to which one Gaussian per pixel closes it."""
FRONT_INSET, BACK_INSET = 0.9, 1.2
"""How far the surface stays inside the outline, px: Gaussians have a width."""


class Kind(IntEnum):
    """Which sampling a point comes from."""

    FRONT = 0
    STEEP = 1
    BACK = 2
    BASE = 3


@dataclass(frozen=True, eq=False)
class Walls:
    """v = h^2 of the two walls as smooth functions of the pixel, negative outside; px^2, shape [S, S].

    Attributes:
        front: towards the camera.
        back: away from it.
        base: height of the flat base, px (rows count downwards); infinite where there is none.
    """

    front: NDArray[np.float64]
    back: NDArray[np.float64]
    base: float


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """M points on the surface.

    Attributes:
        position: column, row, height towards the camera, px, shape [M, 3].
        normal: unit, outward, shape [M, 3].
        spacing: distance of neighbours, px, shape [M].
        kind: see ``Kind``, shape [M].
    """

    position: NDArray[np.float64]
    normal: NDArray[np.float64]
    spacing: NDArray[np.float64]
    kind: NDArray[np.int8]


def walls(
    outline: Silhouette, front: NDArray[np.float64], back: NDArray[np.float64], *, radius: NDArray[np.float64]
) -> Walls:
    """The walls of a body.

    Args:
        outline: of the object.
        front: depth h of the front, shape [S, S].
        back: depth h of the back.
        radius: of the inscribed ball of each pixel.
    """
    nearest = nd.distance_transform_edt(~outline.mask, return_distances=False, return_indices=True)
    rows, columns = np.asarray(nearest)
    if outline.base_row is not None:  # below the base the body goes on as it is there
        rows = np.minimum(rows, outline.base_row - 1)
        nearest_in_row = nd.distance_transform_edt(
            ~outline.mask, sampling=(1e3, 1.0), return_distances=False, return_indices=True
        )
        below = np.arange(len(outline.mask))[:, None] >= outline.base_row
        columns = np.where(below, np.asarray(nearest_in_row)[1][rows, np.arange(outline.mask.shape[1])], columns)
    local = np.maximum(nd.gaussian_filter(radius[rows, columns], 2), 1)
    slope = np.maximum(2 * local, 4)

    def wall(height: NDArray[np.float64], inset: float) -> NDArray[np.float64]:
        squared = height[rows, columns] ** 2
        distance = outline.rim_distance - np.minimum(inset, 0.45 * local)
        inside = np.minimum(squared, 3 * local * distance + squared * smoothstep(distance, 0, 4))
        return np.where(distance > 0, np.maximum(inside, 0.3 * distance), slope * distance)

    base = np.inf if outline.base_row is None else outline.base_row + 0.5 - FRONT_INSET
    return Walls(wall(front, FRONT_INSET), wall(back, BACK_INSET), base)


def surface_points(body: Walls, mask: NDArray[np.bool_]) -> SurfacePoints:
    """Sample the whole surface: front, steep front, back and base."""
    front_height = np.sqrt(np.maximum(body.front, 0))
    dy, dx = np.gradient(front_height)
    steep = nd.maximum_filter(np.hypot(dx, dy), 1)
    facing = mask & (body.front > 0) & (steep < STEEPEST_PER_PIXEL)
    facing &= (np.arange(len(mask)) <= body.base)[:, None]
    y, x = np.nonzero(facing)
    position = np.stack([x, y, front_height[y, x]], 1)
    normal = _unit(np.stack([-dx[y, x], -dy[y, x], np.ones(len(x))], 1))
    parts = [(position, normal, 1.0, Kind.FRONT)]

    position, normal = _lattice_points(body.front, FRONT_SPACING, body.base)
    open_ = at(facing.astype(float), position) < 0.75
    parts.append((position[open_], normal[open_], FRONT_SPACING, Kind.STEEP))

    position, normal = _lattice_points(body.back, BACK_SPACING, body.base)
    mirror = np.array([1.0, 1.0, -1.0])
    parts.append((position * mirror, normal * mirror, BACK_SPACING, Kind.BACK))

    if np.isfinite(body.base):
        position = _base_points(body, FRONT_SPACING)
        parts.append((position, np.tile([0.0, 1.0, 0.0], (len(position), 1)), FRONT_SPACING, Kind.BASE))
    return SurfacePoints(
        position=np.concatenate([part[0] for part in parts]),
        normal=np.concatenate([part[1] for part in parts]),
        spacing=np.concatenate([np.full(len(part[0]), part[2]) for part in parts]),
        kind=np.concatenate([np.full(len(part[0]), part[3], np.int8) for part in parts]),
    )


def at(image: NDArray[np.floating], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """A map [S, S] (or [S, S, C]) at points [M, 2 or 3] by bilinear interpolation; shape [M] (or [M, C])."""
    where = [position[:, 1], position[:, 0]]
    if image.ndim == 2:
        return nd.map_coordinates(image, where, order=1, mode="nearest")
    return np.stack([nd.map_coordinates(image[..., c], where, order=1, mode="nearest") for c in range(3)], -1)


def _lattice_points(
    v: NDArray[np.float64], spacing: float, base: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One point per cell with z > 0 that the surface v = z^2 crosses, moved onto it, and the outward normals.

    F falls monotonically with z, so that the cells crossed above one square of the lattice lie between the least and
    the greatest height of its corners: no volume of values is needed.
    """
    size = v.shape[0]
    grid = np.arange(int(size / spacing) + 1) * spacing
    y, x = np.meshgrid(grid, grid, indexing="ij")
    corner = np.sqrt(np.maximum(nd.map_coordinates(v, [y, x], order=1, mode="nearest"), 0))
    corners = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]])
    first = np.floor(corners.min(0) / spacing).astype(np.int64)
    count = np.ceil(corners.max(0) / spacing).astype(np.int64) - first
    count[(grid[:-1] + 0.5 * spacing) > base] = 0
    row, column = np.nonzero(count > 0)
    repeat = count[row, column]
    start = np.cumsum(repeat) - repeat
    level = np.arange(int(repeat.sum())) - np.repeat(start - first[row, column], repeat)
    cell = np.stack([np.repeat(column, repeat), np.repeat(row, repeat), level], 1)
    position = (cell + 0.5) * spacing

    slope_y, slope_x = np.gradient(v)
    for _ in range(3):  # Newton's steps along the gradient, at most one cell long
        gradient = _gradient(slope_x, slope_y, position)
        excess = at(v, position) - position[:, 2] ** 2
        step = (excess / np.maximum((gradient**2).sum(1), 1e-3))[:, None] * gradient
        length = np.linalg.norm(step, axis=1, keepdims=True)
        position = position - step * np.minimum(1, spacing / np.maximum(length, 1e-9))
        position[:, 2] = np.maximum(position[:, 2], 0)
        position[:, 1] = np.minimum(position[:, 1], base)
    return position, _unit(-_gradient(slope_x, slope_y, position, least_z=0.05))


def _base_points(body: Walls, spacing: float) -> NDArray[np.float64]:
    """The flat base on a lattice of its own."""
    size = body.front.shape[0]
    x = np.arange(0, size, spacing)
    level = np.stack([x, np.full(len(x), body.base)], 1)
    front, back = (np.sqrt(np.maximum(at(v, level), 0)) for v in (body.front, body.back))
    z = np.arange(-np.ceil(back.max()), np.ceil(front.max()) + spacing, spacing)
    grid_x, grid_z = np.meshgrid(x, z, indexing="ij")
    inside = (grid_z < front[:, None] - 0.3 * spacing) & (grid_z > 0.3 * spacing - back[:, None])
    inside &= (front + back)[:, None] > 0
    return np.stack([grid_x[inside], np.full(int(inside.sum()), body.base), grid_z[inside]], 1)


def _gradient(
    slope_x: NDArray[np.float64], slope_y: NDArray[np.float64], position: NDArray[np.float64], least_z: float = 0.0
) -> NDArray[np.float64]:
    return np.stack([at(slope_x, position), at(slope_y, position), -2 * np.maximum(position[:, 2], least_z)], 1)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
