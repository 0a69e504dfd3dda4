"""Boundaries of a scene that are solid, as the solver gets them and as the film draws them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen import scene as sections
from phys4dgen.mpm import HalfSpace, HollowBall, Motion, Obstacle, Push, RoundedBox
from phys4dgen.types import Frame

__all__ = ["ObstacleMaker", "Solid", "drawn_obstacles"]

_PLATE_THICKNESS = 0.05
"""Of a plate, of its shorter edge."""

_LEAST_CELLS = 3.0
"""Half the thickness from which an obstacle stops everything; particles slip through thinner ones."""

_PLATE_INERTIA = 0.2
"""Mass of a plate that pushes with a force, of a weight of that force: light, so that it does not bounce."""

_GRAVITY_MS2 = 9.81

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Solid:
    """An obstacle and what a film shows of it.

    Attributes:
        obstacle: as the solver has it.
        drawn: None: nothing, for it has no end or would hide the object.
    """

    obstacle: Obstacle
    drawn: RoundedBox | None


@dataclass(frozen=True, eq=False)
class ObstacleMaker:
    """Turns boundaries into obstacles.

    Attributes:
        frame: input coordinates -> metres.
        points_m: particles at rest, metres, z up, [P, 3].
        margin_m: how far material reaches beyond its particles.
        cell_m: grid cell of the simulation.
    """

    frame: Frame
    points_m: NDArray[np.float64]
    margin_m: float
    cell_m: float

    def solids(self, boundaries: Iterable[sections.Boundary]) -> tuple[Solid, ...]:
        """All solids but the ground, in the order of the boundaries; a container gives one for each wall."""
        found: list[Solid] = []
        for boundary in boundaries:
            match boundary:
                case sections.Plate():
                    found.append(self._plate(boundary))
                case sections.Container():
                    found += self._container(boundary)
                case (
                    sections.PlaneObstacle()
                    | sections.BoxObstacle()
                    | sections.SphereObstacle()
                    | sections.CapsuleObstacle()
                ):
                    to_s = math.inf if boundary.to_s is None else boundary.to_s
                    shape = self._shape(boundary)
                    obstacle = Obstacle(
                        shape, motion=self._motion(boundary), from_s=boundary.from_s, to_s=to_s, **_touch(boundary)
                    )
                    found.append(Solid(obstacle, shape if isinstance(shape, RoundedBox) else None))
                case _:
                    pass  # the ground is the solver's own; pins and releases are drives
        return tuple(found)

    def _shape(self, solid: Any) -> HalfSpace | RoundedBox:
        match solid:
            case sections.PlaneObstacle():
                return HalfSpace(self._point(solid.point), self._direction(solid.normal))
            case sections.BoxObstacle():
                half = 0.5 * np.array(solid.size) * self.frame.metres_per_unit
                return RoundedBox(self._point(solid.center), _triple(half), rotation=self._turned(solid.rotation_deg))
            case sections.SphereObstacle():
                return RoundedBox(self._point(solid.center), radius_m=solid.radius * self.frame.metres_per_unit)
            case _:
                start, end = np.array(self._point(solid.start)), np.array(self._point(solid.end))
                length = float(np.linalg.norm(end - start))
                return RoundedBox(
                    _triple(0.5 * (start + end)),
                    (0.0, 0.0, 0.5 * length),
                    radius_m=solid.radius * self.frame.metres_per_unit,
                    rotation=_axes_with_z((end - start) / length),
                )

    def _motion(self, solid: Any) -> Motion | None:
        if solid.path:
            shifts = np.array([self.frame.to_metres(np.array(point.shift)) for point in solid.path])
            return Motion(np.array([point.at_s for point in solid.path]), shifts)
        if not any(solid.velocity_ms):
            return None
        to_s = math.inf if solid.to_s is None else solid.to_s
        return Motion.steady(_triple(self.frame.rotation @ np.array(solid.velocity_ms)), from_s=solid.from_s, to_s=to_s)

    def _plate(self, plate: sections.Plate) -> Solid:
        down = -self.frame.up if isinstance(plate.towards, str) else np.array(plate.towards)
        way = self.frame.rotation @ (down / np.linalg.norm(down))
        axes = _axes_with_z(way)
        local = self.points_m @ axes
        low, high = local.min(0) - self.margin_m, local.max(0) + self.margin_m
        extent = high - low
        half = 0.5 * plate.size_rel * extent
        half[2] = 0.5 * _PLATE_THICKNESS * float(2 * half[:2].min())
        rounding = 0.4 * half[2]
        middle = 0.5 * (low + high)
        middle[2] = low[2] - half[2] - plate.gap_rel * extent[2]
        drawn = RoundedBox(_triple(axes @ middle), _triple(half - rounding), rounding, rotation=axes)
        # the grid wants it thick: what is hidden behind the plate is as solid as the plate
        hidden = np.array([0.0, 0.0, max(_LEAST_CELLS * self.cell_m - half[2], 0.0)])
        shape = RoundedBox(
            _triple(axes @ (middle - hidden)), _triple(half - rounding + hidden), rounding, rotation=axes
        )
        if plate.force_n is not None:
            return Solid(Obstacle(shape, push=_push(plate, plate.force_n, way), **_touch(plate)), drawn)
        pressed = plate.from_s + plate.press_s
        times, travel = [plate.from_s, pressed], [0.0, (plate.gap_rel + plate.depth_rel) * extent[2]]
        if plate.release_s is not None:
            if plate.hold_s > 0:
                times, travel = [*times, pressed + plate.hold_s], [*travel, travel[-1]]
            times, travel = [*times, pressed + plate.hold_s + plate.release_s], [*travel, 0.0]
        return Solid(Obstacle(shape, motion=Motion(np.array(times), np.outer(travel, way)), **_touch(plate)), drawn)

    def _container(self, container: sections.Container) -> list[Solid]:
        shape = container.shape
        if isinstance(shape, sections.SphereRegion):
            ball = HollowBall(self._point(shape.center), shape.radius * self.frame.metres_per_unit)
            return [Solid(Obstacle(ball, **_touch(container)), None)]
        if shape is None:
            low, high = self.points_m.min(0) - self.margin_m, self.points_m.max(0) + self.margin_m
            away = container.margin_rel * float((high - low).max())
            low, high = low - [away, away, 0], high + away
            center, half, axes = 0.5 * (low + high), 0.5 * (high - low), np.eye(3)
        else:
            center, axes = np.array(self._point(shape.center)), self._turned(shape.rotation_deg)
            half = 0.5 * np.array(shape.size) * self.frame.metres_per_unit
        walls = []
        for axis in range(3):
            for side in (-1.0, 1.0):
                outwards = side * axes[:, axis]
                wall = HalfSpace(_triple(center + half[axis] * outwards), _triple(-outwards))
                walls.append(Solid(Obstacle(wall, **_touch(container)), None))
        return walls

    def _point(self, values: Iterable[float]) -> Vector:
        return _triple(self.frame.to_metres(np.array(list(values))))

    def _direction(self, values: Iterable[float]) -> Vector:
        return _triple(self.frame.rotation @ np.array(list(values)))

    def _turned(self, rotation_deg: Vector) -> NDArray[np.float64]:
        """Axes of a box that is turned in the input's axes, as columns, z up."""
        return self.frame.rotation @ Rotation.from_euler("xyz", rotation_deg, degrees=True).as_matrix()


def drawn_obstacles(solids: Iterable[Solid], frame: Frame) -> list[dict[str, Any]]:
    """What a film draws of obstacles, in the input's coordinates: rounded boxes, by number, and when they are there."""
    drawn = []
    for number, solid in enumerate(solids):
        shape, obstacle = solid.drawn, solid.obstacle
        if shape is not None:
            drawn.append(
                {
                    "number": number,
                    "center": frame.from_metres(np.array(shape.center_m)).tolist(),
                    "half": (np.array(shape.half_m) / frame.metres_per_unit).tolist(),
                    "radius": shape.radius_m / frame.metres_per_unit,
                    "axes": (frame.rotation.T @ shape.rotation).tolist(),
                    "from_s": obstacle.from_s,
                    "to_s": None if math.isinf(obstacle.to_s) else obstacle.to_s,
                }
            )
    return drawn


def _push(plate: sections.Plate, force_n: float, way: NDArray[np.float64]) -> Push:
    """What moves a plate that pushes with a force."""
    ends = plate.release_s is not None
    return Push(
        _triple(way),
        force_n,
        _PLATE_INERTIA * force_n / _GRAVITY_MS2,
        from_s=plate.from_s,
        ramp_s=plate.press_s,
        until_s=plate.from_s + plate.press_s + plate.hold_s if ends else math.inf,
        back_s=plate.release_s if plate.release_s is not None else 1.0,
    )


def _touch(boundary: Any) -> dict[str, Any]:
    return {"contact": boundary.contact, "friction": boundary.friction, "restitution": boundary.restitution}


def _axes_with_z(z: NDArray[np.float64]) -> NDArray[np.float64]:
    """A rotation matrix whose third column is a unit vector, its others as upright and level as can be, [3, 3]."""
    other = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = other - (other @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], 1)


def _triple(values: NDArray[np.float64]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
