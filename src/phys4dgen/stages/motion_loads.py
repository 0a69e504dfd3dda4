"""Forces and boundaries of a scene as what the solver gets: metres, z up, particles instead of names and regions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen import scene as sections
from phys4dgen.errors import SimulationError
from phys4dgen.mpm import (
    Acceleration,
    Attractor,
    Drive,
    Impulse,
    Noise,
    PerParticleForce,
    TotalForce,
    Vortex,
    Wind,
)
from phys4dgen.mpm.loads import Load, checked_vector
from phys4dgen.scene import ALL_PARTS
from phys4dgen.types import Continuum, Frame, Parts

__all__ = ["LoadMaker", "in_region", "is_lasting", "meant", "pinned", "told_parts"]

_AIR_KGM3 = 1.2
_DRAG_COEFFICIENT = 1.0


@dataclass(frozen=True, eq=False)
class LoadMaker:
    """Turns what a scene says into loads and drives.

    Attributes:
        frame: input coordinates -> metres.
        parts: names of the parts.
        continuum: particles.
        mass_kg: true mass of each particle, [P].
        longest_m: longest side of the object.
    """

    frame: Frame
    parts: Parts
    continuum: Continuum
    mass_kg: NDArray[np.float64]
    longest_m: float

    def loads(self, forces: Iterable[sections.Force]) -> tuple[Load, ...]:
        """The forces that act through accelerations."""
        return tuple(self._load(force) for force in forces if not isinstance(force, _DRIVING))

    def drives(
        self, forces: Iterable[sections.Force], boundaries: Iterable[sections.Boundary], *, held: NDArray[np.bool_]
    ) -> tuple[Drive, ...]:
        """The forces that set velocities, then what is pinned for a time; ``held`` [P] never moves."""
        found = [self._drive(force, held) for force in forces if isinstance(force, _DRIVING)]
        for boundary in boundaries:
            if isinstance(boundary, sections.Pin) and not is_lasting(boundary):
                found.append(Drive(from_s=boundary.from_s, to_s=_end(boundary.to_s), **self._selection(boundary)))
            elif isinstance(boundary, sections.Release):
                found.append(self._release(boundary))
        return tuple(found)

    def _meant(self, selected: Any) -> NDArray[np.bool_]:
        return meant(selected, self.continuum, self.parts)

    def _selection(self, selected: Any) -> dict[str, Any]:
        if selected.region is None and selected.part in (ALL_PARTS, *self.parts.names):
            part = None if selected.part == ALL_PARTS else self.parts.names.index(selected.part)
            return {"part": part, "chosen": None}
        return {"part": None, "chosen": self._meant(selected)}

    def _vector(self, values: Iterable[float]) -> tuple[float, float, float]:
        """A vector in SI units, from the input's axes to z up."""
        x, y, z = (float(value) for value in self.frame.rotation @ np.array(list(values)))
        return x, y, z

    def _point(self, values: Iterable[float]) -> tuple[float, float, float]:
        x, y, z = (float(value) for value in self.frame.to_metres(np.array(list(values))))
        return x, y, z

    def _length(self, value: float) -> float:
        return value * self.frame.metres_per_unit

    def _load(self, force: Any) -> Load:
        chosen = self._selection(force)
        if isinstance(force, sections.Impulse):
            return Impulse(self._vector(force.value_ns), from_s=force.at_s, **chosen)
        window = {"from_s": force.from_s, "to_s": _end(force.to_s), "ramp_s": force.ramp_s, **chosen}
        match force:
            case sections.AccelerationForce():
                return Acceleration(self._vector(force.value_ms2), **window)
            case sections.TotalForce():
                return TotalForce(self._vector(force.value_n), **window)
            case sections.PerParticleForce():
                return PerParticleForce(self._vector(force.value_n), **window)
            case sections.Wind():
                velocity = self._vector(force.velocity_ms)
                quadratic = self._drag_per_m(force, np.array(velocity))
                return Wind(velocity, drag_per_m=quadratic, drag_per_s=force.drag_per_s, **window)
            case sections.Attractor():
                return Attractor(
                    self._point(force.center),
                    force.strength_ms2,
                    self._length(force.radius),
                    falloff=force.falloff,
                    **window,
                )
            case sections.Vortex():
                return Vortex(
                    self._point(force.center),
                    self._vector(force.axis),
                    force.swirl_ms2,
                    self._length(force.radius),
                    inwards_ms2=force.inwards_ms2,
                    falloff=force.falloff,
                    **window,
                )
            case _:
                assert isinstance(force, sections.Noise)
                length_m = 0.5 * self.longest_m if isinstance(force.length, str) else self._length(force.length)
                return Noise(force.strength_ms2, length_m, time_scale_s=force.time_s, seed=force.seed, **window)

    def _drag_per_m(self, wind: sections.Wind, velocity_ms: NDArray[np.float64]) -> float:
        """rho_air C_d A / 2 M with the area A that the particles show to the wind; in still air the mean of three."""
        if not isinstance(wind.drag_per_m, str):
            return wind.drag_per_m
        if wind.drag_per_s > 0:
            return 0.0
        mine = self._meant(wind)
        points = self.frame.to_metres(self.continuum.positions[mine])
        speed = float(np.linalg.norm(velocity_ms))
        views = [velocity_ms / speed] if speed > 0 else list(np.eye(3))
        area_m2 = np.mean([_shown_area_m2(points, view, self.continuum.spacing_m) for view in views])
        return float(0.5 * _AIR_KGM3 * _DRAG_COEFFICIENT * area_m2 / self.mass_kg[mine].sum())

    def _drive(self, force: Any, held: NDArray[np.bool_]) -> Drive:
        window = {"from_s": force.from_s, "to_s": _end(force.to_s), **self._selection(force)}
        if isinstance(force, sections.VelocitySet):
            return Drive(velocity_ms=self._vector(force.value_ms), **window)
        assert isinstance(force, sections.RotationSet)
        axis = np.array(self._vector(force.axis))
        axis /= np.linalg.norm(axis)
        if isinstance(force.center, str):
            mine = self._meant(force) & ~held
            points = self.frame.to_metres(self.continuum.positions[mine])
            center = np.average(points, axis=0, weights=self.mass_kg[mine]) if mine.any() else np.zeros(3)
        else:
            center = np.array(self._point(force.center))
        return Drive(
            velocity_ms=checked_vector(force.along_ms * axis, "velocity_ms"),
            spin_rad_s=checked_vector(math.radians(force.rate_deg_s) * axis, "spin_rad_s"),
            center_m=checked_vector(center, "center_m"),
            **window,
        )

    def _release(self, release: sections.Release) -> Drive:
        up = self.frame.up if isinstance(release.direction, str) else np.array(release.direction)
        along = self.continuum.positions @ (up / np.linalg.norm(up))
        mine = self._meant(release)
        low, high = along[mine].min(), along[mine].max()
        share = np.clip((along - low) / max(float(high - low), 1e-300), 0, 1)
        let_go_s = release.from_s + (release.to_s - release.from_s) * share
        return Drive(to_s=release.to_s, let_go_s=let_go_s, **self._selection(release))


def pinned(boundaries: Iterable[sections.Boundary], continuum: Continuum, parts: Parts) -> NDArray[np.bool_]:
    """Particles that are pinned for the whole film, [P]."""
    mine = np.zeros(len(continuum), np.bool_)
    for boundary in boundaries:
        if isinstance(boundary, sections.Pin) and is_lasting(boundary):
            mine |= meant(boundary, continuum, parts)
    return mine


def meant(selected: Any, continuum: Continuum, parts: Parts) -> NDArray[np.bool_]:
    """Particles that a force, a pin or a release speaks of, [P].

    Raises:
        SimulationError: there are none.
    """
    mine = np.ones(len(continuum), np.bool_)
    if selected.part != ALL_PARTS:
        mine &= _of_parts(selected.part, continuum, parts)
    if selected.region is not None:
        mine &= in_region(selected.region, continuum.positions)
        if not mine.any():
            whose = "the object" if selected.part == ALL_PARTS else f"part '{selected.part}'"
            raise SimulationError(
                f"The region of a {selected.kind} holds nothing of {whose}; regions are in the input's "
                f"coordinates, in which it spans {_span(continuum, parts, selected.part)}."
            )
    return mine


_DRIVING = (sections.VelocitySet, sections.RotationSet)


def told_parts(forces: Iterable[sections.Force], parts: Parts) -> set[str]:
    """Parts whose velocity a force sets, as a whole; they are not held by themselves."""
    told = [f.part for f in forces if isinstance(f, _DRIVING) and f.part != ALL_PARTS and f.region is None]
    return {part for name in told for part in sections.parts_meant(name, parts.names)}


def is_lasting(pin: sections.Pin) -> bool:
    """Whether a pin holds for the whole film."""
    return pin.from_s == 0 and pin.to_s is None


def in_region(region: sections.Region, points: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Which points [N, 3] in the input's coordinates lie in a region, [N]."""
    away = np.asarray(points, np.float64) - np.array(region.center)
    match region:
        case sections.BoxRegion():
            turned = away @ Rotation.from_euler("xyz", region.rotation_deg, degrees=True).as_matrix()
            return (np.abs(turned) <= np.array(region.size) / 2).all(1)
        case sections.SphereRegion():
            return np.linalg.norm(away, axis=1) <= region.radius
        case _:
            axis = np.array(region.axis) / np.linalg.norm(region.axis)
            along = away @ axis
            across = np.linalg.norm(away - along[:, None] * axis, axis=1)
            return (np.abs(along) <= region.height / 2) & (across <= region.radius)


def _of_parts(name: str, continuum: Continuum, parts: Parts) -> NDArray[np.bool_]:
    """Particles of a part, or of all parts of an object, [P]."""
    return np.isin(continuum.part, [parts.names.index(part) for part in sections.parts_meant(name, parts.names)])


def _end(to_s: float | None) -> float:
    return math.inf if to_s is None else to_s


def _shown_area_m2(points_m: NDArray[np.float64], view: NDArray[np.float64], step_m: float) -> float:
    """Area of particles [n, 3] of a spacing ``step_m`` seen along a unit vector."""
    rows = np.linalg.svd(view[None])[2][1:]
    cells = np.unique(np.floor(points_m @ rows.T / (1.5 * step_m)), axis=0)
    return len(cells) * (1.5 * step_m) ** 2


def _span(continuum: Continuum, parts: Parts, part: str) -> str:
    mine = _of_parts(part, continuum, parts)
    low, high = continuum.positions[mine].min(0), continuum.positions[mine].max(0)
    return f"[{', '.join(f'{v:.3g}' for v in low)}] to [{', '.join(f'{v:.3g}' for v in high)}]"
