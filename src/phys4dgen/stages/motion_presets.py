"""What a motion preset means: weight, boundaries, what is held by itself, what is turned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SceneError
from phys4dgen.motion import LOWEST_SHARE
from phys4dgen.mpm import Drive
from phys4dgen.scene import (
    ALL_PARTS,
    Boundary,
    Container,
    Ground,
    MaterialChange,
    Pin,
    PlaneObstacle,
    Plate,
    Release,
    RotationSet,
    Scene,
    VelocitySet,
    parts_meant,
)
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.motion_changes import melting
from phys4dgen.types import MaterialBook, Parts

__all__ = ["Circumstances", "acts_by_itself", "circumstances", "twist"]

_GRAVITY_MS2 = 9.81
_PRESS_S, _PRESSED_S, _RELEASE_S = 0.3, 0.15, 0.2
_TWISTING_S, _TWISTED_S = 0.35, 0.12
"""Shares of the film's duration."""

_PRESS_FRICTION = 0.6
_TWISTED_TOP = 0.2
_TWISTED_FOOT = 0.25


@dataclass(frozen=True)
class Circumstances:
    """What a preset adds to the scene.

    Attributes:
        preset: its name; not auto.
        gravity: whether weight acts.
        gravity_ms2: when it does, z up.
        boundaries: of the scene and of the preset.
        changes: of materials, likewise.
        holds_what_stands: whether what stands on the ground is held where the user does not say what is.
    """

    preset: str
    gravity: Literal["rest", "on", "off"]
    gravity_ms2: tuple[float, float, float]
    boundaries: tuple[Boundary, ...]
    changes: tuple[MaterialChange, ...]
    holds_what_stands: bool

    @property
    def lowest_share(self) -> float:
        """How much of the height is held where no part stands on the ground by itself."""
        return _TWISTED_FOOT if self.preset == "twist" else LOWEST_SHARE

    @property
    def ground(self) -> Ground | None:
        """The ground, if there is one."""
        return next((boundary for boundary in self.boundaries if isinstance(boundary, Ground)), None)


def acts_by_itself(scene: Scene) -> bool:
    """Whether the scene says what happens, so that ``auto`` need not find it out: a force, or more than a ground."""
    return bool(scene.forces) or any(not isinstance(boundary, Ground) for boundary in scene.boundaries)


def circumstances(scene: Scene, asset: Asset, parts: Parts, book: MaterialBook, preset: str) -> Circumstances:
    """What happens to the object besides its forces.

    Raises:
        SceneError: ``melt`` does not know what melts.
    """
    kinds = {type(boundary) for boundary in scene.boundaries}
    boundaries = scene.boundaries
    if preset == "press" and Plate not in kinds:
        boundaries = (*boundaries, _plate(scene))
    if preset in ("drop", "press", "melt") and Ground not in kinds:
        # without weight nothing but the ground keeps what is pressed from jumping off when it is let go
        glued = Ground(friction=_PRESS_FRICTION, contact="sticky")
        boundaries = (*boundaries, glued if preset == "press" else Ground())
    meant = [(change, name) for change in scene.changes for name in parts_meant(change.part, parts.names)]
    changes = tuple(change.model_copy(update={"part": name}) for change, name in meant)
    if preset == "melt":
        for part in _melting_parts(scene, parts):
            density_kgm3 = book.parts[part].interior.density_kgm3
            changes = (*changes, melting(scene, part, density_kgm3, asset.height_m))
    gravity = scene.gravity
    if gravity == "auto":
        # what is pressed and not held by its ground jumps when it is let go, and must come down again
        jumps = preset == "press" and any(isinstance(b, Ground) and b.contact == "separate" for b in boundaries)
        weighs = preset in ("drop", "melt") or jumps or scene.gravity_ms2 != "auto"
        gravity = "on" if weighs else "rest"
    return Circumstances(
        preset,
        gravity,
        _gravity_ms2(scene, asset) if gravity == "on" else (0.0, 0.0, 0.0),
        boundaries,
        changes,
        _holds_what_stands(scene, preset, gravity),
    )


def _melting_parts(scene: Scene, parts: Parts) -> tuple[str, ...]:
    if scene.motion.part is not None:
        return parts_meant(scene.motion.part, parts.names)
    if parts.count == 1:
        return parts.names
    raise SceneError(f"motion: say what melts with 'part' (--motion.part NAME): {', '.join(parts.names)}.")


def _plate(scene: Scene) -> Plate:
    duration_s = scene.simulation.duration_s
    return Plate(
        depth_rel=scene.motion.press_depth_rel,
        force_n=scene.motion.press_force_n,
        press_s=_PRESS_S * duration_s,
        hold_s=_PRESSED_S * duration_s,
        release_s=_RELEASE_S * duration_s,
    )


def _gravity_ms2(scene: Scene, asset: Asset) -> tuple[float, float, float]:
    if isinstance(scene.gravity_ms2, str):
        return 0.0, 0.0, -_GRAVITY_MS2
    x, y, z = (float(value) for value in asset.frame.rotation @ np.array(scene.gravity_ms2))
    return x, y, z


def _holds_what_stands(scene: Scene, preset: str, gravity: str) -> bool:
    """Something must keep the object in the film, unless it lies on something or all of it is told where to go."""
    if preset in ("sway", "twist"):
        return True
    if preset != "rest" or scene.objects or not acts_by_itself(scene):
        return False
    carrying = (Ground, PlaneObstacle, Container, Pin, Release)
    if gravity == "on" and any(isinstance(boundary, carrying) for boundary in scene.boundaries):
        return False
    told = (f for f in scene.forces if isinstance(f, (VelocitySet, RotationSet)))
    return not any(force.part == ALL_PARTS and force.region is None for force in told)


def twist(
    scene: Scene,
    *,
    points_m: NDArray[np.float64],
    part: NDArray[np.int32],
    part_names: tuple[str, ...],
    mass_kg: NDArray[np.float64],
    held: NDArray[np.bool_],
) -> tuple[Drive, Drive]:
    """What ``twist`` turns: to the angle asked for, then held there, then let go.

    Args:
        scene: how far, and of which part.
        points_m: particles at rest, z up, [P, 3].
        part: part of each, [P].
        part_names: names by number.
        mass_kg: of each particle.
        held: particles that do not move.

    Raises:
        SceneError: it is held.
    """
    name = scene.motion.part
    if name is None:
        low, high = points_m[:, 2].min(), points_m[:, 2].max()
        chosen = points_m[:, 2] > high - _TWISTED_TOP * (high - low)
    else:
        chosen = np.isin(part, [part_names.index(own) for own in parts_meant(name, part_names)])
    chosen = chosen & ~held
    if not chosen.any():
        raise SceneError(f"motion.part: '{name or 'the top'}' is held and cannot be twisted; free it or name another.")
    center = np.average(points_m[chosen], axis=0, weights=mass_kg[chosen])
    duration_s = scene.simulation.duration_s
    turned_s = _TWISTING_S * duration_s
    spin = (0.0, 0.0, math.radians(scene.motion.twist_deg) / turned_s)
    x, y, z = (float(value) for value in center)
    return (
        Drive(spin_rad_s=spin, center_m=(x, y, z), to_s=turned_s, chosen=chosen),
        Drive(from_s=turned_s, to_s=turned_s + _TWISTED_S * duration_s, chosen=chosen),
    )
