"""From the working grid to the world, so that the canonical camera sees the picture again.

A point of the front lies on the viewing ray of its pixel: x shrinks by (1 - z / D) towards the optical axis, and y
towards the horizon. The horizon is put at the height of the base, where y does not change with the depth: a base that
is flat in the picture stays flat. Behind the outline nothing is seen, so y is left alone there. The middle surface
bends forward by r^2 / D, which makes circles seen from above circles again. Where the camera looks down (the base of
the outline is curved), the body leans towards the camera, along the rays again, and then everything is turned upright.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.reconstruct.framing import CAMERA_DISTANCE, HALF_HEIGHT
from phys4dgen.reconstruct.inflate.surface import Walls, at
from phys4dgen.reconstruct.mask_geometry import slopes

__all__ = ["InflatedSolid", "Perspective"]


@dataclass(frozen=True, eq=False)
class Perspective:
    """The map from working pixels to world units (y up, camera on +z).

    Attributes:
        bend: how far the middle surface is moved forward, world units, shape [S, S].
        horizon_row: row of the picture at the height of the camera.
        tilt: see ``Walls``.
    """

    bend: NDArray[np.floating]
    horizon_row: float
    tilt: float

    @property
    def unit(self) -> float:
        """Side of a working pixel in the plane z = 0, world units."""
        return 2 * HALF_HEIGHT / len(self.bend)

    @property
    def horizon(self) -> float:
        """Height of the camera, world units."""
        return -(self.horizon_row + 0.5 - len(self.bend) / 2) * self.unit

    @property
    def lean(self) -> float:
        """Tangent of the camera's elevation: how far the upright leans towards the camera.

        The base, at y = -tilt z before, must be square to the upright (0, 1, lean) after z has become z + lean y.
        """
        s = min(self.tilt, 0.49)
        return 2 * s / (1 + math.sqrt(1 - 4 * s * s))

    @property
    def upright(self) -> NDArray[np.float64]:
        """Rotation from the camera's axes (x right, y up, z towards it) to the world's, shape [3, 3]."""
        angle = math.atan(self.lean)
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[1, 0, 0], [0, c, s], [0, -s, c]])

    def to_world(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points [M, 3] (column, row, height, px) in world units."""
        x, y, z = self._upright(position)
        return np.stack([x * (1 - z / CAMERA_DISTANCE), self._toward_horizon(y, z), z], 1) @ self.upright.T

    def tangents_to_world(self, position: NDArray[np.float64], tangents: NDArray[np.float64]) -> NDArray[np.float64]:
        """Tangent vectors [M, 3] (px, rows downwards) at points [M, 3], carried by the derivative of the map."""
        x, y, z = self._upright(position)
        slope_x, slope_y = slopes(self.bend)
        slope_y = slope_y - self.lean * self.unit
        tx, ty, tz = (tangents * [1, -1, 1] * self.unit).T
        tz = tz + (at(slope_x, position) * tangents[:, 0] + at(slope_y, position) * tangents[:, 1])
        in_front = z > 0
        shrink_y = np.where(in_front, 1 - z / CAMERA_DISTANCE, 1)
        carried = np.stack(
            [
                tx * (1 - z / CAMERA_DISTANCE) - x * tz / CAMERA_DISTANCE,
                ty * shrink_y - np.where(in_front, (y - self.horizon) * tz / CAMERA_DISTANCE, 0),
                tz,
            ],
            1,
        )
        return carried @ self.upright.T

    def from_world(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """The inverse of ``to_world``; points on the far side of the camera have none and come out far away."""
        x, y, z = (np.asarray(points, np.float64) @ self.upright).T
        shrink = np.maximum(1 - z / CAMERA_DISTANCE, 1e-6)
        shrink_y = np.where(z > 0, shrink, 1)
        size = len(self.bend)
        column = x / shrink / self.unit + size / 2 - 0.5
        row = size / 2 - 0.5 - ((y - self.horizon) / shrink_y + self.horizon) / self.unit
        position = np.stack([column, row, z], 1)
        position[:, 2] = (z - self._forward(position)) / self.unit
        return position

    def _upright(
        self, position: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Orthographic x, y and final z, world units."""
        middle = len(self.bend) / 2
        x = (position[:, 0] + 0.5 - middle) * self.unit
        y = -(position[:, 1] + 0.5 - middle) * self.unit
        return x, y, position[:, 2] * self.unit + self._forward(position)

    def _forward(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far points are moved towards the camera, world units."""
        return at(self.bend, position) + self.lean * (self.horizon_row - position[:, 1]) * self.unit

    def _toward_horizon(self, y: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(z > 0, self.horizon + (y - self.horizon) * (1 - z / CAMERA_DISTANCE), y)


@dataclass(frozen=True, eq=False)
class InflatedSolid:
    """The exact inside of an inflated object.

    Attributes:
        front: v = h^2 of the front wall, px^2, shape [S, S].
        back: v of the back wall.
        bend: see ``Perspective``.
        base: see ``Walls``.
        tilt: see ``Walls``.
        horizon_row: see ``Perspective``.
    """

    front: NDArray[np.float32]
    back: NDArray[np.float32]
    bend: NDArray[np.float32]
    base: float
    tilt: float
    horizon_row: float

    @classmethod
    def of(cls, body: Walls, perspective: Perspective) -> InflatedSolid:
        """The inside of a body under a perspective."""
        front, back, bend = (m.astype(np.float32) for m in (body.front, body.back, perspective.bend))
        return cls(front, back, bend, base=body.base, tilt=body.tilt, horizon_row=perspective.horizon_row)

    def contains(self, points: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether points [N, 3], in the coordinates of the Gaussians, lie inside; shape [N]."""
        position = Perspective(self.bend, self.horizon_row, self.tilt).from_world(points)
        size = len(self.bend)
        on_grid = ((position[:, :2] >= 0) & (position[:, :2] <= size - 1)).all(1)
        wall = np.where(position[:, 2] > 0, at(self.front, position), at(self.back, position))
        above_base = position[:, 1] <= self.base + self.tilt * position[:, 2]
        return on_grid & (wall > position[:, 2] ** 2) & above_base

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The fields as arrays, for a file."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> InflatedSolid:
        """The inverse of ``arrays``."""
        base, tilt, horizon_row = (float(arrays[name]) for name in ("base", "tilt", "horizon_row"))
        return cls(arrays["front"], arrays["back"], arrays["bend"], base=base, tilt=tilt, horizon_row=horizon_row)
