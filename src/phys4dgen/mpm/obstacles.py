"""Solid obstacles: half spaces, boxes, balls, rods and hollow balls, at rest, moving as told, or pushed by a force.

Soft matter meets them at grid nodes inside the obstacle (``solids.py``), rigid parts with the points of their hull
(``kernels/rigid_contact.py``). Boxes, balls and rods are one shape, a box with rounded edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.contacts import CONTACT_KINDS
from phys4dgen.mpm.loads import Vector, checked_vector

__all__ = ["HalfSpace", "HollowBall", "Motion", "Obstacle", "Push", "RoundedBox", "Shape"]

_STEADY_PER_S = 20.0  # a pushed obstacle loses its speed at this rate, so that it comes to rest on what it presses


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """Everything behind a plane.

    Attributes:
        point_m: on the plane.
        normal: out of the solid; made a unit vector.
    """

    point_m: Vector
    normal: Vector

    def __post_init__(self) -> None:
        object.__setattr__(self, "point_m", checked_vector(self.point_m, "point_m"))
        object.__setattr__(self, "normal", _unit(self.normal))

    def distances(self, points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Signed distance to the surface, negative in the solid, [K], and outward normals, [K, 3]."""
        normal = np.array(self.normal)
        normals = np.broadcast_to(normal, points_m.shape)
        return (points_m - np.array(self.point_m)) @ normal, normals

    @property
    def box_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Corners of a box around the solid."""
        return np.full(3, -np.inf), np.full(3, np.inf)


@dataclass(frozen=True, eq=False)
class RoundedBox:
    """All points within ``radius_m`` of a box: a ball where the box is a point, a rod where it is a line.

    Attributes:
        center_m: of the box.
        half_m: half its edges, zero or more.
        radius_m: zero or more.
        rotation: its axes as columns, [3, 3].
    """

    center_m: Vector
    half_m: Vector = (0.0, 0.0, 0.0)
    radius_m: float = 0.0
    rotation: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "center_m", checked_vector(self.center_m, "center_m"))
        object.__setattr__(self, "half_m", checked_vector(self.half_m, "half_m"))
        if min(self.half_m) < 0 or not self.radius_m >= 0 or max(self.half_m) + self.radius_m <= 0:
            raise ValueError(f"half_m, radius_m: expected a solid, got {self.half_m} and {self.radius_m}.")
        if self.rotation.shape != (3, 3) or not np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6):
            raise ValueError(f"rotation: expected a rotation matrix, got {self.rotation.tolist()}.")

    def distances(self, points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See ``HalfSpace.distances``."""
        local = (points_m - np.array(self.center_m)) @ self.rotation
        beyond = np.abs(local) - np.array(self.half_m)
        outside = np.maximum(beyond, 0)
        length = np.linalg.norm(outside, axis=1)
        nearest = beyond.argmax(1)
        inside = np.zeros_like(local)
        inside[np.arange(len(local)), nearest] = 1
        outwards = np.where(length[:, None] > 1e-12, outside / np.maximum(length, 1e-12)[:, None], inside)
        distance = length + np.minimum(beyond.max(1), 0) - self.radius_m
        return distance, np.where(local < 0, -outwards, outwards) @ self.rotation.T

    @property
    def box_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See ``HalfSpace.box_m``."""
        reach = np.abs(self.rotation) @ np.array(self.half_m) + self.radius_m
        return np.array(self.center_m) - reach, np.array(self.center_m) + reach


@dataclass(frozen=True, eq=False)
class HollowBall:
    """Everything outside a ball: what is inside stays there.

    Attributes:
        center_m: of the ball.
        radius_m: its radius.
    """

    center_m: Vector
    radius_m: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "center_m", checked_vector(self.center_m, "center_m"))
        if not self.radius_m > 0:
            raise ValueError(f"radius_m: expected a positive number, got {self.radius_m}.")

    def distances(self, points_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See ``HalfSpace.distances``."""
        away = points_m - np.array(self.center_m)
        length = np.linalg.norm(away, axis=1)
        return self.radius_m - length, -away / np.maximum(length, 1e-12)[:, None]

    @property
    def box_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See ``HalfSpace.box_m``."""
        return np.full(3, -np.inf), np.full(3, np.inf)


Shape = HalfSpace | RoundedBox | HollowBall


@dataclass(frozen=True, eq=False)
class Motion:
    """Where an obstacle is: straight between places, before the first and after the last at rest.

    Attributes:
        times_s: growing, [K].
        shifts_m: from where the obstacle is described, [K, 3].
    """

    times_s: NDArray[np.float64]
    shifts_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.shifts_m.shape != (len(self.times_s), 3) or not (np.diff(self.times_s) > 0).all():
            raise ValueError(
                f"times_s, shifts_m: expected growing times and a place for each, got {self.times_s.tolist()} and "
                f"{self.shifts_m.shape}."
            )

    @classmethod
    def steady(cls, velocity_ms: Vector, *, from_s: float, to_s: float) -> Motion:
        """With one velocity during a window."""
        end_s = to_s if math.isfinite(to_s) else from_s + 1e6
        times = np.array([from_s, end_s])
        return cls(times, np.outer(times - from_s, checked_vector(velocity_ms, "velocity_ms")))

    def shift_m(self, time_s: float) -> NDArray[np.float64]:
        """Where it is, [3]."""
        return np.array([np.interp(time_s, self.times_s, self.shifts_m[:, axis]) for axis in range(3)])


@dataclass(frozen=True, eq=False)
class Push:
    """A force that moves an obstacle along a line until what resists balances it, and then takes it back.

    Attributes:
        towards: the way, a unit vector.
        force_n: when it has grown to its full size.
        mass_kg: of the obstacle.
        from_s, ramp_s: it begins, and has grown after so long.
        until_s: the obstacle goes back from then on, infinite: never.
        back_s: and is where it was after so long.
    """

    towards: Vector
    force_n: float
    mass_kg: float
    from_s: float = 0.0
    ramp_s: float = 0.5
    until_s: float = math.inf
    back_s: float = 0.5

    def __post_init__(self) -> None:
        object.__setattr__(self, "towards", _unit(self.towards))
        if not (self.force_n > 0 and self.mass_kg > 0 and self.ramp_s > 0 and self.back_s > 0):
            raise ValueError("force_n, mass_kg, ramp_s, back_s: expected positive numbers.")

    @property
    def acceleration_ms2(self) -> float:
        """That of the obstacle where nothing resists."""
        return self.force_n / self.mass_kg

    def next_speed_ms(self, travel_m: float, speed_ms: float, resistance_n: float, from_s: float, to_s: float) -> float:
        """Speed along the way between two times.

        Args:
            travel_m: how far it has gone.
            speed_ms: in the time step before.
            resistance_n: force along the way that it gives to the body.
            from_s: the first time.
            to_s: the second.
        """
        step_s = to_s - from_s
        if from_s >= self.until_s:
            left_s = max(self.until_s + self.back_s - from_s, step_s)
            return -travel_m / left_s
        share = min(max((0.5 * (from_s + to_s) - self.from_s) / self.ramp_s, 0.0), 1.0)
        gained = step_s * (self.force_n * share - resistance_n) / self.mass_kg
        return (speed_ms + gained) / (1 + _STEADY_PER_S * step_s)


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A solid that nothing passes.

    Attributes:
        shape: at the start of its motion.
        contact: "separate": pushes, never pulls, with Coulomb friction; "slip": no motion through the surface in
            either direction, no friction; "sticky": what touches it moves with it.
        friction: Coulomb's coefficient for "separate".
        restitution: of rigid parts, as ``Ground``.
        motion: as told, or None.
        push: or moved by a force, or None.
        from_s, to_s: when it is there.
    """

    shape: Shape
    contact: Literal["separate", "slip", "sticky"] = "separate"
    friction: float = 0.5
    restitution: float = 0.2
    motion: Motion | None = None
    push: Push | None = None
    from_s: float = 0.0
    to_s: float = math.inf

    def __post_init__(self) -> None:
        if self.contact not in CONTACT_KINDS:
            raise ValueError(f"contact: expected 'separate', 'slip' or 'sticky', got '{self.contact}'.")
        if not (math.isfinite(self.friction) and self.friction >= 0):
            raise ValueError(f"friction: expected zero or more, got {self.friction}.")
        if not 0 <= self.restitution <= 1:
            raise ValueError(f"restitution: expected 0 to 1, got {self.restitution}.")
        if not (math.isfinite(self.from_s) and self.from_s < self.to_s):
            raise ValueError(f"from_s, to_s: expected from_s < to_s, got {self.from_s} and {self.to_s}.")
        if self.motion is not None and self.push is not None:
            raise ValueError("motion, push: an obstacle moves as told or is pushed, not both.")

    @property
    def is_standing(self) -> bool:
        """Whether it is always there and never moves."""
        return self.motion is None and self.push is None and self.from_s <= 0 and math.isinf(self.to_s)

    def is_there(self, time_s: float) -> bool:
        """Whether it is there at a time."""
        return self.from_s <= time_s < self.to_s

    def shift_m(self, time_s: float) -> NDArray[np.float64]:
        """How far it has moved as told, [3]."""
        return np.zeros(3) if self.motion is None else self.motion.shift_m(time_s)

    def velocity_ms(self, from_s: float, to_s: float) -> NDArray[np.float64]:
        """Its mean velocity as told between two times, [3]."""
        return (self.shift_m(to_s) - self.shift_m(from_s)) / (to_s - from_s)


def _unit(vector: Vector) -> Vector:
    x = np.array(checked_vector(vector, "normal"))
    length = float(np.linalg.norm(x))
    if not length > 0:
        raise ValueError("normal: expected a direction, got a vector of length 0.")
    return checked_vector((x / length).tolist(), "normal")
