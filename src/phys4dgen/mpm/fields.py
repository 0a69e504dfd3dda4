"""Loads that depend on where a particle is or how fast it moves: wind, attractor, vortex, noise, force per particle.

A field is asked once per segment, for its middle; no particle moves by more than a third of a cell in it. Drag is then
applied in each substep as v <- v + (1 - exp(-c dt)) (w - v), which is stable for any rate c.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.loads import Load, Vector, checked_vector

__all__ = ["Answer", "Attractor", "Field", "Noise", "PerParticleForce", "Sample", "Vortex", "Wind"]

_SOFT = 0.1
"""Within this share of its radius a field that grows towards its centre stays finite."""

_WAVES = 24


@dataclass(frozen=True, eq=False)
class Sample:
    """M particles as a field is asked about them.

    Attributes:
        positions_m: [M, 3].
        velocities_ms: [M, 3].
        mass_kg: [M].
        time_s: when.
    """

    positions_m: NDArray[np.float64]
    velocities_ms: NDArray[np.float64]
    mass_kg: NDArray[np.float64]
    time_s: float


@dataclass(frozen=True, eq=False)
class Answer:
    """What a field does to M particles.

    Attributes:
        acceleration_ms2: [M, 3].
        drag_per_s: rate c of c (w - v), [M]; None without drag.
        air_ms: the velocity w, [3].
    """

    acceleration_ms2: NDArray[np.float64]
    drag_per_s: NDArray[np.float64] | None = None
    air_ms: Vector = (0.0, 0.0, 0.0)


class Field(Load, ABC):
    """A load that differs from particle to particle."""

    @abstractmethod
    def at(self, state: Sample) -> Answer:
        """What the particles feel when the window is fully open."""


@dataclass(frozen=True, eq=False)
class PerParticleForce(Field):
    """The same force on every particle (Paper: Sec. C.2, a_p = f / m_p).

    Attributes:
        value_n: N.
    """

    value_n: Vector

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "value_n", checked_vector(self.value_n, "value_n"))

    def at(self, state: Sample) -> Answer:
        """See ``Field``."""
        return Answer(np.array(self.value_n) / state.mass_kg[:, None])


@dataclass(frozen=True, eq=False)
class Wind(Field):
    """Drag towards the velocity w of the air, a = (drag_per_s + drag_per_m |w - v|) (w - v).

    Attributes:
        velocity_ms: w.
        drag_per_m: quadratic drag rho_air C_d A / 2 M, 1/m.
        drag_per_s: linear drag, 1/s.
    """

    velocity_ms: Vector
    drag_per_m: float = 0.0
    drag_per_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "velocity_ms", checked_vector(self.velocity_ms, "velocity_ms"))
        if not (self.drag_per_m >= 0 and self.drag_per_s >= 0):
            raise ValueError(f"drag: expected zero or more, got {self.drag_per_m} per m and {self.drag_per_s} per s.")

    def at(self, state: Sample) -> Answer:
        """See ``Field``."""
        slip = np.linalg.norm(np.array(self.velocity_ms) - state.velocities_ms, axis=1)
        return Answer(np.zeros_like(state.velocities_ms), self.drag_per_s + self.drag_per_m * slip, self.velocity_ms)


@dataclass(frozen=True, eq=False)
class Attractor(Field):
    """A point that attracts: a = strength (radius / s)^falloff towards it, s^2 = r^2 + (radius / 10)^2.

    Attributes:
        center_m: the point.
        strength_ms2: about the acceleration at ``radius_m``; negative repels.
        radius_m: see the formula.
        falloff: -1 is a spring, 0 the same everywhere, 2 as gravity.
    """

    center_m: Vector
    strength_ms2: float
    radius_m: float
    falloff: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "center_m", checked_vector(self.center_m, "center_m"))
        if not self.radius_m > 0:
            raise ValueError(f"radius_m: expected a positive number, got {self.radius_m}.")

    def at(self, state: Sample) -> Answer:
        """See ``Field``."""
        away = state.positions_m - np.array(self.center_m)
        return Answer(-self.strength_ms2 * _unit_and_falloff(away, self.radius_m, self.falloff))


@dataclass(frozen=True, eq=False)
class Vortex(Field):
    """A whirl about an axis: (radius / s)^falloff times a swirl round it and a pull towards it, s as ``Attractor``.

    Attributes:
        center_m: a point of the axis.
        axis: its direction; the whirl is right-handed.
        swirl_ms2, inwards_ms2: about the accelerations at ``radius_m``.
        radius_m, falloff: as ``Attractor``.
    """

    center_m: Vector
    axis: Vector
    swirl_ms2: float
    radius_m: float
    inwards_ms2: float = 0.0
    falloff: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "center_m", checked_vector(self.center_m, "center_m"))
        axis = np.array(checked_vector(self.axis, "axis"))
        if not np.linalg.norm(axis) > 0:
            raise ValueError("axis: expected a direction, got a vector of length 0.")
        object.__setattr__(self, "axis", checked_vector((axis / np.linalg.norm(axis)).tolist(), "axis"))
        if not self.radius_m > 0:
            raise ValueError(f"radius_m: expected a positive number, got {self.radius_m}.")

    def at(self, state: Sample) -> Answer:
        """See ``Field``."""
        axis = np.array(self.axis)
        away = state.positions_m - np.array(self.center_m)
        away -= (away @ axis)[:, None] * axis
        outwards = _unit_and_falloff(away, self.radius_m, self.falloff)
        return Answer(self.swirl_ms2 * np.cross(axis, outwards) - self.inwards_ms2 * outwards)


@dataclass(frozen=True, eq=False)
class Noise(Field):
    """Random accelerations, smooth in space and time, without sources: a sum of transverse waves.

    Attributes:
        strength_ms2: root mean square.
        length_m: over which it changes.
        time_scale_s: in which it changes.
        seed: of the waves.
    """

    strength_ms2: float
    length_m: float
    time_scale_s: float = 0.5
    seed: int = 0
    _waves: tuple[NDArray[np.float64], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.length_m > 0 and self.time_scale_s > 0):
            raise ValueError(
                f"length_m, time_scale_s: expected positive numbers, got {self.length_m}, {self.time_scale_s}."
            )
        rng = np.random.default_rng(self.seed)
        wave_vectors = rng.normal(size=(_WAVES, 3)) / self.length_m * 2
        rates = rng.normal(size=_WAVES) / self.time_scale_s * 2
        directions = np.cross(wave_vectors, rng.normal(size=(_WAVES, 3)))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        waves = (wave_vectors, rates, rng.uniform(0, 2 * np.pi, _WAVES), directions * np.sqrt(2 / _WAVES))
        object.__setattr__(self, "_waves", waves)

    def at(self, state: Sample) -> Answer:
        """See ``Field``."""
        wave_vectors, rates, phases, directions = self._waves
        phase = state.positions_m @ wave_vectors.T + rates * state.time_s + phases
        return Answer(self.strength_ms2 * np.cos(phase) @ directions)


def _unit_and_falloff(away_m: NDArray[np.float64], radius_m: float, falloff: float) -> NDArray[np.float64]:
    """Vectors from the centre as (x / s) (radius / s)^falloff, [M, 3]."""
    distance = np.sqrt((away_m**2).sum(1) + (_SOFT * radius_m) ** 2)
    return away_m / distance[:, None] * ((radius_m / distance) ** falloff)[:, None]
