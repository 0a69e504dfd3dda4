"""Points on the surface of the inflated body, before perspective; lengths are working pixels.

The body is F(x, y, z) > 0 with F = v(x, y) - z^2, v = h^2 inside the outline and falling on steadily beyond it. F is
smooth at the rim, where h itself is not; that keeps the sides from becoming paper edges. The front is sampled once per
pixel where it faces the camera, everything else once per cell of a cubic lattice that the surface crosses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

from phys4dgen.reconstruct.inflate.revolution import smoothstep
from phys4dgen.reconstruct.inflate.silhouette import Silhouette
from phys4dgen.reconstruct.mask_geometry import nearest_inside, slopes

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
        base: row of the flat base in the plane z = 0, px; infinite where there is none.
        tilt: the base is at ``base + tilt * z``.
    """

    front: NDArray[np.float64]
    back: NDArray[np.float64]
    base: float
    tilt: float

    def base_at(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Row of the base at heights z towards the camera."""
        return self.base + self.tilt * z


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
    rows, columns = nearest_inside(outline.mask)
    if outline.base_row is not None:  # below the base the body goes on as it is there
        last = outline.base_row - 1
        below = np.arange(len(outline.mask))[:, None] > last
        rows = np.where(below, last, rows)
        columns = np.where(below, nearest_inside(outline.mask, along_rows=True)[1][last], columns)
    local = np.maximum(nd.gaussian_filter(radius[rows, columns], 2), 1)
    slope = np.maximum(2 * local, 4)

    def wall(height: NDArray[np.float64], inset: float) -> NDArray[np.float64]:
        inset_px = np.minimum(inset, 0.45 * local)
        squared = np.maximum(height[rows, columns] - inset_px, 0) ** 2
        distance = outline.rim_distance - inset_px
        inside = np.minimum(squared, 3 * local * distance + squared * smoothstep(distance, 0, 4))
        return np.where(distance > 0, np.maximum(inside, 0.3 * distance), slope * distance)

    base = np.inf if outline.base_row is None else outline.base_row + 0.5 - FRONT_INSET
    return Walls(wall(front, FRONT_INSET), wall(back, BACK_INSET), base, outline.tilt)


def surface_points(body: Walls, mask: NDArray[np.bool_]) -> SurfacePoints:
    """Sample the whole surface: front, steep front, back and base."""
    front_height = np.sqrt(np.maximum(body.front, 0))
    dx, dy = slopes(front_height)
    facing = mask & (body.front > 0) & (np.hypot(dx, dy) < STEEPEST_PER_PIXEL)
    facing &= np.arange(len(mask))[:, None] <= body.base_at(front_height)
    y, x = np.nonzero(facing)
    position = np.stack([x, y, front_height[y, x]], 1).astype(np.float64)
    normal = _unit(np.stack([-dx[y, x], -dy[y, x], np.ones(len(x))], 1))
    parts: list[tuple[NDArray[np.float64], NDArray[np.float64], float, Kind]] = []
    parts.append((position, normal, 1.0, Kind.FRONT))

    position, normal = _lattice_points(body, FRONT_SPACING, side=1)
    open_ = at(facing.astype(float), position) < 0.75
    parts.append((position[open_], normal[open_], FRONT_SPACING, Kind.STEEP))

    position, normal = _lattice_points(body, BACK_SPACING, side=-1)
    parts.append((position, normal, BACK_SPACING, Kind.BACK))

    if np.isfinite(body.base):
        position = _base_points(body, FRONT_SPACING)
        normal = _unit(np.tile([0.0, 1.0, -body.tilt], (len(position), 1)))
        parts.append((position, normal, FRONT_SPACING, Kind.BASE))
    return SurfacePoints(
        position=np.concatenate([part[0] for part in parts]),
        normal=np.concatenate([part[1] for part in parts]),
        spacing=np.concatenate([np.full(len(part[0]), part[2]) for part in parts]),
        kind=np.concatenate([np.full(len(part[0]), part[3], np.int8) for part in parts]),
    )


def at(image: NDArray[np.floating], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """A map [S, S] (or [S, S, C]) at points [M, 2 or 3] by bilinear interpolation; shape [M] (or [M, C])."""
    where = np.stack([position[:, 1], position[:, 0]])
    if image.ndim == 2:
        return np.asarray(nd.map_coordinates(image, where, order=1, mode="nearest"), np.float64)
    return np.stack([at(image[..., c], position) for c in range(image.shape[2])], -1)


def _lattice_points(body: Walls, spacing: float, *, side: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One point per cell that one wall (side 1: front, -1: back) crosses, moved onto it, and the outward normals.

    F falls monotonically with z, so that the cells crossed above one square of the lattice lie between the least and
    the greatest height of its corners: no volume of values is needed.
    """
    v = body.front if side > 0 else body.back
    size = v.shape[0]
    grid = np.arange(int(size / spacing) + 1) * spacing
    y, x = np.meshgrid(grid, grid, indexing="ij")
    corner = np.sqrt(np.maximum(nd.map_coordinates(v, [y, x], order=1, mode="nearest"), 0))
    corners = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]])
    first = np.floor(corners.min(0) / spacing).astype(np.int64)
    count = np.ceil(corners.max(0) / spacing).astype(np.int64) - first
    row, column = np.nonzero(count > 0)
    repeat = count[row, column]
    start = np.cumsum(repeat) - repeat
    level = np.arange(int(repeat.sum())) - np.repeat(start - first[row, column], repeat)
    cell = np.stack([np.repeat(column, repeat), np.repeat(row, repeat), level], 1)
    position = np.asarray((cell + 0.5) * spacing, np.float64)
    position = position[position[:, 1] <= body.base_at(side * position[:, 2])]

    slope_x, slope_y = slopes(v)
    for _ in range(3):  # Newton's steps along the gradient, at most one cell long
        gradient = _gradient(slope_x, slope_y, position)
        excess = at(v, position) - position[:, 2] ** 2
        step = (excess / np.maximum((gradient**2).sum(1), 1e-3))[:, None] * gradient
        length = np.linalg.norm(step, axis=1, keepdims=True)
        position = position - step * np.minimum(1, spacing / np.maximum(length, 1e-9))
        position[:, 2] = np.maximum(position[:, 2], 0)
        position[:, 1] = np.minimum(position[:, 1], body.base_at(side * position[:, 2]))
    towards = np.array([1.0, 1.0, side])
    return position * towards, _unit(-_gradient(slope_x, slope_y, position, least_z=0.05)) * towards


def _base_points(body: Walls, spacing: float) -> NDArray[np.float64]:
    """The flat base on a lattice of its own."""
    size = body.front.shape[0]
    reach = math.ceil(math.sqrt(max(float(body.front.max()), float(body.back.max()), 0.0)))
    x, z = np.meshgrid(np.arange(0, size, spacing), np.arange(-reach, reach + spacing, spacing), indexing="ij")
    position = np.stack([x.ravel(), body.base_at(z.ravel()), z.ravel()], 1)
    depth = np.sqrt(np.maximum(np.where(position[:, 2] > 0, at(body.front, position), at(body.back, position)), 0))
    return position[np.abs(position[:, 2]) < depth - 0.3 * spacing]


def _gradient(
    slope_x: NDArray[np.float64], slope_y: NDArray[np.float64], position: NDArray[np.float64], least_z: float = 0.0
) -> NDArray[np.float64]:
    return np.stack([at(slope_x, position), at(slope_y, position), -2 * np.maximum(position[:, 2], least_z)], 1)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
