"""Section ``forces``: what acts on the parts, besides the motion's own.

Vectors of forces and velocities are in the input's axes and in SI units; points, radii and regions are in the input's
coordinates. Particles are chosen once, by where they lie at rest.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, Tag, model_validator

from phys4dgen.scene.sections.regions import Region
from phys4dgen.scene.sections.values import ALL_PARTS, Auto, Direction, Length, PartAddress, Section, Vector, kind_of

__all__ = [
    "AccelerationForce",
    "Attractor",
    "Force",
    "Impulse",
    "Noise",
    "PerParticleForce",
    "RotationSet",
    "TotalForce",
    "VelocitySet",
    "Vortex",
    "Wind",
]

Seconds = Annotated[float, Field(ge=0, le=1e6)]


class _Selected(Section):
    """What a force acts on."""

    kind: Any
    """which"""
    part: PartAddress = ALL_PARTS
    """name of a part, or all"""
    region: Region | None = None
    """only what lies in it at rest; null: everywhere"""


class _Timed(_Selected):
    """A force during a time window."""

    from_s: Seconds = 0.0
    """start of the window"""
    to_s: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """end of the window; null: to the end of the film"""

    @model_validator(mode="after")
    def _window_is_ordered(self) -> _Timed:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s must be later than from_s, got {self.from_s:g} to {self.to_s:g} s")
        return self


class _Ramped(_Timed):
    """A force that may rise and fade."""

    ramp_s: Seconds = 0.0
    """rises smoothly during the first and fades during the last so many seconds of its window"""

    @model_validator(mode="after")
    def _ramps_fit(self) -> _Ramped:
        length = float("inf") if self.to_s is None else self.to_s - self.from_s
        if 2 * self.ramp_s > length:
            raise ValueError(f"ramp_s: rising and fading take {2 * self.ramp_s:g} s, the window has {length:g} s")
        return self


class AccelerationForce(_Ramped):
    """An acceleration of every particle: a force in proportion to mass, as weight is."""

    kind: Literal["acceleration"] = "acceleration"
    """acceleration: metres per second squared on all of the part's mass"""
    value_ms2: Vector
    """in the input's axes"""


class TotalForce(_Ramped):
    """A force on all of the part together, shared in proportion to mass."""

    kind: Literal["total_force"] = "total_force"
    """total_force: newtons on the whole part"""
    value_n: Vector
    """in the input's axes"""


class PerParticleForce(_Ramped):
    """The same force on every particle (Paper: Sec. C.2, a_p = f / m_p): what it does depends on how many there are."""

    kind: Literal["per_particle_force"] = "per_particle_force"
    """per_particle_force: newtons on each particle, as in the paper"""
    value_n: Vector
    """in the input's axes"""


class Impulse(_Selected):
    """A blow: momentum given at once, shared in proportion to mass."""

    kind: Literal["impulse"] = "impulse"
    """impulse: newton seconds on the whole part at one time"""
    value_ns: Vector
    """in the input's axes"""
    at_s: Seconds = 0.0
    """when"""


class VelocitySet(_Timed):
    """A velocity that nothing can change during the window (Paper: Sec. C.2, the first kind of force)."""

    kind: Literal["velocity"] = "velocity"
    """velocity: the part moves as said, whatever resists"""
    value_ms: Vector
    """in the input's axes; [0, 0, 0] holds it where it is"""


class RotationSet(_Timed):
    """A turn about an axis that nothing can change during the window."""

    kind: Literal["rotation"] = "rotation"
    """rotation: the part turns as said, whatever resists"""
    axis: Direction
    """in the input's axes; the turn is right-handed"""
    rate_deg_s: Annotated[float, Field(ge=-1e5, le=1e5)]
    """degrees per second"""
    center: Auto | Vector = "auto"
    """a point of the axis, in the input's coordinates; auto: centre of mass of what turns"""
    along_ms: Annotated[float, Field(ge=-1e3, le=1e3)] = 0.0
    """speed along the axis, as of a screw"""


class Wind(_Ramped):
    """Moving air and its drag, a = (1/s + 1/m |w - v|) (w - v) with the air's velocity w."""

    kind: Literal["wind"] = "wind"
    """wind: drag towards the air's velocity; with [0, 0, 0] still air"""
    velocity_ms: Vector
    """of the air, in the input's axes"""
    drag_per_m: Auto | Annotated[float, Field(ge=0, le=1e6)] = "auto"
    """quadratic drag; auto: 1.2 kg/m3 of air on the area that faces the wind (drag coefficient 1), unless drag_per_s
    is given"""
    drag_per_s: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """linear drag"""


class Attractor(_Ramped):
    """A point that attracts: strength_ms2 (radius / r)^falloff towards it, softened within a tenth of the radius."""

    kind: Literal["attractor"] = "attractor"
    """attractor: towards a point"""
    center: Vector
    """in the input's coordinates"""
    strength_ms2: Annotated[float, Field(ge=-1e6, le=1e6)]
    """at the distance radius; negative repels"""
    radius: Length
    """where strength_ms2 holds, in the input's units"""
    falloff: Annotated[float, Field(ge=-1, le=4)] = 2.0
    """-1: a spring; 0: the same everywhere; 2: as gravity"""


class Vortex(_Ramped):
    """A whirl about an axis: swirl_ms2 (radius / r)^falloff round it, and inwards_ms2 likewise towards it."""

    kind: Literal["vortex"] = "vortex"
    """vortex: round an axis"""
    center: Vector
    """a point of the axis, in the input's coordinates"""
    axis: Direction
    """in the input's axes; the whirl is right-handed"""
    swirl_ms2: Annotated[float, Field(ge=-1e6, le=1e6)]
    """round the axis, at the distance radius"""
    inwards_ms2: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0
    """towards the axis, at the distance radius"""
    radius: Length
    """where the strengths hold, in the input's units"""
    falloff: Annotated[float, Field(ge=-1, le=4)] = 0.0
    """-1: as in a rigid turn; 0: the same everywhere; 1: as in a free whirl; softened within a tenth of the radius"""


class Noise(_Ramped):
    """Random pushes, smooth in space and time, without sources: turbulence."""

    kind: Literal["noise"] = "noise"
    """noise: random and smooth"""
    strength_ms2: Annotated[float, Field(gt=0, le=1e6)]
    """root mean square"""
    length: Auto | Length = "auto"
    """over which it changes, in the input's units; auto: half of the longest side"""
    time_s: Annotated[float, Field(gt=0, le=1e3)] = 0.5
    """in which it changes"""
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] = 0
    """of what is drawn at random"""


Force = Annotated[
    Annotated[AccelerationForce, Tag("acceleration")]
    | Annotated[TotalForce, Tag("total_force")]
    | Annotated[PerParticleForce, Tag("per_particle_force")]
    | Annotated[Impulse, Tag("impulse")]
    | Annotated[VelocitySet, Tag("velocity")]
    | Annotated[RotationSet, Tag("rotation")]
    | Annotated[Wind, Tag("wind")]
    | Annotated[Attractor, Tag("attractor")]
    | Annotated[Vortex, Tag("vortex")]
    | Annotated[Noise, Tag("noise")],
    kind_of("acceleration"),
]
"""Anything that acts; ``kind`` says which, acceleration if it is left out."""
