"""From the working grid to the world, so that the canonical camera sees the picture again.

A point of the front lies on the viewing ray of its pixel: x shrinks by (1 - z / D) towards the optical axis, and y
towards the horizon. The horizon is put at the height of the base, where y is 0 whatever the depth: a base that is flat in
the picture stays flat. Behind the outline nothing is seen, so y is left alone there. The middle surface bends forward by
r^2 / D, which makes circles seen from above circles again.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.reconstruct.framing import CAMERA_DISTANCE, HALF_HEIGHT
from phys4dgen.reconstruct.inflate.surface import Walls, at

__all__ = ["InflatedSolid", "Perspective"]


@dataclass(frozen=True, eq=False)
class Perspective:
    """The map from working pixels to world units (y up, camera on +z).

    Attributes:
        bend: how far the middle surface is moved forward, world units, shape [S, S].
        horizon_row: row of the picture at the height of the camera.
    """

    bend: NDArray[np.float64]
    horizon_row: float

    @property
    def unit(self) -> float:
        """Side of a working pixel in the plane z = 0, world units."""
        return 2 * HALF_HEIGHT / len(self.bend)

    @property
    def horizon(self) -> float:
        """Height of the camera, world units."""
        return -(self.horizon_row + 0.5 - len(self.bend) / 2) * self.unit

    def to_world(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points [M, 3] (column, row, height, px) in world units."""
        x, y, z = self._upright(position)
        return np.stack([x * (1 - z / CAMERA_DISTANCE), self._toward_horizon(y, z), z], 1)

    def tangents_to_world(self, position: NDArray[np.float64], tangents: NDArray[np.float64]) -> NDArray[np.float64]:
        """Tangent vectors [M, 3] (px, rows downwards) at points [M, 3], carried by the derivative of the map."""
        x, y, z = self._upright(position)
        slope_y, slope_x = np.gradient(self.bend)
        tx, ty, tz = (tangents * [1, -1, 1] * self.unit).T
        tz = tz + (at(slope_x, position) * tangents[:, 0] + at(slope_y, position) * tangents[:, 1])
        in_front = z > 0
        shrink_y = np.where(in_front, 1 - z / CAMERA_DISTANCE, 1)
        return np.stack(
            [
                tx * (1 - z / CAMERA_DISTANCE) - x * tz / CAMERA_DISTANCE,
                ty * shrink_y - np.where(in_front, (y - self.horizon) * tz / CAMERA_DISTANCE, 0),
                tz,
            ],
            1,
        )

    def from_world(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """The inverse of ``to_world``; points on the far side of the camera have none and come out far away."""
        x, y, z = np.asarray(points, np.float64).T
        shrink = np.maximum(1 - z / CAMERA_DISTANCE, 1e-6)
        shrink_y = np.where(z > 0, shrink, 1)
        size = len(self.bend)
        column = x / shrink / self.unit + size / 2 - 0.5
        row = size / 2 - 0.5 - ((y - self.horizon) / shrink_y + self.horizon) / self.unit
        position = np.stack([column, row, z / self.unit], 1)
        position[:, 2] -= at(self.bend, position) / self.unit
        return position

    def _upright(
        self, position: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Orthographic x, y and final z, world units."""
        middle = len(self.bend) / 2
        x = (position[:, 0] + 0.5 - middle) * self.unit
        y = -(position[:, 1] + 0.5 - middle) * self.unit
        return x, y, position[:, 2] * self.unit + at(self.bend, position)

    def _toward_horizon(self, y: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(z > 0, self.horizon + (y - self.horizon) * (1 - z / CAMERA_DISTANCE), y)


@dataclass(frozen=True, eq=False)
class InflatedSolid:
    """The exact inside of an inflated object.

    Attributes:
        front: v = h^2 of the front wall, px^2, shape [S, S].
        back: v of the back wall.
        bend: see ``Perspective``.
        base: row of the flat base, px; infinite where there is none.
        horizon_row: see ``Perspective``.
    """

    front: NDArray[np.float32]
    back: NDArray[np.float32]
    bend: NDArray[np.float32]
    base: float
    horizon_row: float

    @classmethod
    def of(cls, body: Walls, perspective: Perspective) -> InflatedSolid:
        """The inside of a body under a perspective."""
        maps = (body.front, body.back, perspective.bend)
        return cls(*(m.astype(np.float32) for m in maps), float(body.base), float(perspective.horizon_row))

    def contains(self, points: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether points [N, 3], in the coordinates of the Gaussians, lie inside; shape [N]."""
        position = Perspective(self.bend, self.horizon_row).from_world(points)
        size = len(self.bend)
        on_grid = ((position[:, :2] >= 0) & (position[:, :2] <= size - 1)).all(1)
        wall = np.where(position[:, 2] > 0, at(self.front, position), at(self.back, position))
        return on_grid & (wall > position[:, 2] ** 2) & (position[:, 1] <= self.base)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The fields as arrays, for a file."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> InflatedSolid:
        """The inverse of ``arrays``."""
        values = {field.name: arrays[field.name] for field in fields(cls)}
        return cls(**{name: v if v.ndim else v.item() for name, v in values.items()})
