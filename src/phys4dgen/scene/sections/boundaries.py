"""Section ``boundaries``: what the object may not pass, and what of it may not move.

Points, lengths and normals are in the input's coordinates; velocities in metres per second along the input's axes.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Tag, field_validator, model_validator

from phys4dgen.scene.sections.regions import BoxRegion, Region, SphereRegion, checked_size
from phys4dgen.scene.sections.values import (
    ALL_PARTS,
    Auto,
    Direction,
    Length,
    PartAddress,
    Section,
    Vector,
    as_tuple,
    kind_of,
)

__all__ = [
    "Boundary",
    "BoxObstacle",
    "CapsuleObstacle",
    "Container",
    "Ground",
    "Obstacle",
    "Pin",
    "PlaneObstacle",
    "Plate",
    "Release",
    "SphereObstacle",
    "Waypoint",
]

Friction = Annotated[float, Field(ge=0, le=10)]
Contact = Literal["separate", "slip", "sticky"]
Seconds = Annotated[float, Field(ge=0, le=1e6)]
Until = Annotated[float, Field(gt=0, le=1e6)] | None


def _ordered(from_s: float, to_s: float | None) -> None:
    if to_s is not None and to_s <= from_s:
        raise ValueError(f"to_s must be later than from_s, got {from_s:g} to {to_s:g} s")


class _Touched(Section):
    """How a surface meets the object."""

    kind: Any
    """which"""
    friction: Friction = 0.4
    """Coulomb's coefficient"""
    contact: Contact = "separate"
    """separate: pushes, never pulls, and rubs; slip: holds on without friction; sticky: what touches it stays"""
    restitution: Annotated[float, Field(ge=0, le=1)] = 0.2
    """share of its speed with which a rigid part leaves the surface; soft ones bounce by their own elasticity"""


class Ground(_Touched):
    """A level plane on which the object falls or stands."""

    kind: Literal["ground"] = "ground"
    """ground: nothing passes below it"""
    below_m: Auto | Annotated[float, Field(ge=0, le=1000)] = "auto"
    """from the object's lowest point down to the plane; auto: drop_height_rel where the preset is drop, else 0"""


class Waypoint(Section):
    """Where an obstacle is at one time."""

    at_s: Seconds
    """when"""
    shift: Vector
    """from where it starts, in the input's units"""


Path = Annotated[tuple[Waypoint, ...], BeforeValidator(as_tuple), Field(max_length=1000)]


class _Moving(_Touched):
    """A solid obstacle, at rest or moving."""

    velocity_ms: Vector = (0.0, 0.0, 0.0)
    """with which it moves while it is there"""
    path: Path = ()
    """instead of velocity_ms: places and times, straight between them; it stays at the last"""
    from_s: Seconds = 0.0
    """from when on it is there"""
    to_s: Until = None
    """until when; null: to the end of the film"""

    @model_validator(mode="after")
    def _one_motion(self) -> _Moving:
        _ordered(self.from_s, self.to_s)
        if self.path and any(self.velocity_ms):
            raise ValueError("velocity_ms and path both say how it moves; keep one of them")
        times = [point.at_s for point in self.path]
        if any(b <= a for a, b in pairwise(times)):
            raise ValueError(f"path: expected times that grow, got {times}")
        return self


class PlaneObstacle(_Moving):
    """A wall without end, of any slope."""

    kind: Literal["plane"] = "plane"
    """plane: nothing passes behind it"""
    point: Vector
    """on the plane, in the input's coordinates"""
    normal: Direction
    """out of the wall, towards the object, in the input's axes"""


class BoxObstacle(_Moving):
    """A solid box."""

    kind: Literal["box"] = "box"
    """box: a solid block"""
    center: Vector
    """in the input's coordinates"""
    size: Vector
    """its three edges, whole, in the input's units"""
    rotation_deg: Vector = (0.0, 0.0, 0.0)
    """turns about the input's x, then y, then z axis"""

    _positive_edges = field_validator("size")(checked_size)


class SphereObstacle(_Moving):
    """A solid sphere."""

    kind: Literal["sphere"] = "sphere"
    """sphere: a solid ball"""
    center: Vector
    """in the input's coordinates"""
    radius: Length
    """in the input's units"""


class CapsuleObstacle(_Moving):
    """A rod with round ends."""

    kind: Literal["capsule"] = "capsule"
    """capsule: a rod with round ends"""
    start: Vector
    """middle of one end, in the input's coordinates"""
    end: Vector
    """middle of the other"""
    radius: Length
    """in the input's units"""

    @model_validator(mode="after")
    def _has_length(self) -> CapsuleObstacle:
        if self.start == self.end:
            raise ValueError("start and end are the same point; use kind: sphere")
        return self


class Plate(_Touched):
    """A flat plate that comes upon the object, presses it, stays and goes back; as large as the object by itself."""

    kind: Literal["plate"] = "plate"
    """plate: presses the object, stays, and lets go"""
    towards: Auto | Direction = "auto"
    """the way it goes, in the input's axes; auto: down"""
    depth_rel: Annotated[float, Field(gt=0, lt=1)] = 0.3
    """how far it goes on after it has touched, of the object's extent along that way"""
    force_n: Annotated[float, Field(gt=0, le=1e9)] | None = None
    """instead of going to depth_rel it pushes with this force, in newtons, as a weight would"""
    gap_rel: Annotated[float, Field(ge=0, le=10)] = 0.05
    """from the plate to the object at first, of the same extent"""
    size_rel: Annotated[float, Field(gt=0, le=10)] = 1.25
    """its edges, of the object's extent across"""
    from_s: Seconds = 0.0
    """when it starts"""
    press_s: Annotated[float, Field(gt=0, le=1e6)] = 0.6
    """time that it takes to come and press"""
    hold_s: Seconds = 0.3
    """time that it stays"""
    release_s: Annotated[float, Field(gt=0, le=1e6)] | None = 0.4
    """time that it takes to go back; null: it stays"""


class Container(_Touched):
    """Walls that keep everything inside."""

    kind: Literal["container"] = "container"
    """container: nothing leaves it"""
    shape: (
        Annotated[Annotated[BoxRegion, Tag("box")] | Annotated[SphereRegion, Tag("sphere")], kind_of("box")] | None
    ) = None
    """a box or a sphere; null: a box round the object as it stands, margin_rel away from it"""
    margin_rel: Annotated[float, Field(ge=0, le=100)] = 0.5
    """without shape: from the object to each wall, of the object's longest side; the floor is under it"""


class Pin(Section):
    """What does not move during a time window."""

    kind: Literal["pin"] = "pin"
    """pin: a part or a region that is held in the air"""
    part: PartAddress = ALL_PARTS
    """name of a part, or all"""
    region: Region | None = None
    """only what lies in it at rest; null: everywhere"""
    from_s: Seconds = 0.0
    """start of the window"""
    to_s: Until = None
    """end of the window; null: to the end of the film"""

    @model_validator(mode="after")
    def _window_is_ordered(self) -> Pin:
        _ordered(self.from_s, self.to_s)
        return self


class Release(Section):
    """What is held at first and let go layer by layer."""

    kind: Literal["release"] = "release"
    """release: held at first, let go layer by layer"""
    part: PartAddress = ALL_PARTS
    """name of a part, or all"""
    region: Region | None = None
    """only what lies in it at rest; null: everywhere"""
    direction: Auto | Direction = "auto"
    """the way the front goes that lets go, in the input's axes; auto: up, so that the lowest goes first"""
    from_s: Seconds = 0.0
    """when the front starts"""
    to_s: Annotated[float, Field(gt=0, le=1e6)]
    """when it has passed everything"""

    @model_validator(mode="after")
    def _window_is_ordered(self) -> Release:
        _ordered(self.from_s, self.to_s)
        return self


Obstacle = PlaneObstacle | BoxObstacle | SphereObstacle | CapsuleObstacle

Boundary = Annotated[
    Annotated[Ground, Tag("ground")]
    | Annotated[PlaneObstacle, Tag("plane")]
    | Annotated[BoxObstacle, Tag("box")]
    | Annotated[SphereObstacle, Tag("sphere")]
    | Annotated[CapsuleObstacle, Tag("capsule")]
    | Annotated[Plate, Tag("plate")]
    | Annotated[Container, Tag("container")]
    | Annotated[Pin, Tag("pin")]
    | Annotated[Release, Tag("release")],
    kind_of("ground"),
]
"""Anything that limits motion; ``kind`` says which, ground if it is left out."""
