"""PhysGaussian's boundary conditions -> forces and boundaries of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SceneError
from phys4dgen.physgaussian.boundary_types import (
    BoundaryCondition,
    BoundingBox,
    Cuboid,
    Impulse,
    ReleaseSequentially,
    Rotation,
    SurfaceCollider,
    Translation,
)
from phys4dgen.physgaussian.configuration import Configuration, Mode
from phys4dgen.physgaussian.placement import Placement

__all__ = ["Carried", "carry_over"]

_WALL_CELLS = 3
_RESET_SUBSTEPS = 15
_LARGEST_FRICTION = 10.0


@dataclass
class Carried:
    """What boundary conditions become.

    Attributes:
        forces: entries of the scene's ``forces``.
        boundaries: entries of the scene's ``boundaries``.
        notes: what differs, one sentence each.
    """

    forces: list[dict[str, Any]] = field(default_factory=list)
    boundaries: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Context:
    config: Configuration
    placement: Placement
    places: NDArray[np.float64]
    masses_kg: NDArray[np.float64]
    mode: Mode
    carried: Carried
    name: str

    def note(self, text: str) -> None:
        self.carried.notes.append(f"{self.name}: {text}")

    def window(self, start_s: float, end_s: float) -> dict[str, float] | None:
        """``from_s`` and ``to_s``; None, with a note, where the film does not meet it."""
        start_s = max(start_s, 0.0)
        if end_s <= start_s or start_s >= self.config.end_s:
            self.note(f"acts from {start_s:g} to {end_s:g} s, outside the film of {self.config.end_s:g} s; left out.")
            return None
        times = {"from_s": start_s} if start_s > 0 else {}
        return times | ({"to_s": end_s} if end_s < self.config.end_s else {})

    def chosen(self, point: Any, half: Any) -> int:
        """Gaussians in a box of MPM space at first."""
        return int((np.abs(self.places - point) < half).all(1).sum())


def carry_over(
    config: Configuration,
    placement: Placement,
    places: NDArray[np.float64],
    *,
    masses_kg: NDArray[np.float64],
    mode: Mode,
) -> Carried:
    """Turn every boundary condition into what our solver has.

    Args:
        config: the configuration.
        placement: of the object in MPM space.
        places: of the simulated Gaussians in MPM space, [N, 3].
        masses_kg: of their particles in PhysGaussian, [N].
        mode: in ``compat`` with PhysGaussian's defects where the solver can have them.
    """
    carried = Carried()
    for number, condition in enumerate(config.boundary_conditions):
        name = f"boundary_conditions.{number} {condition.type}"
        context = _Context(config, placement, places, masses_kg, mode, carried, name)
        _carry(condition, context)
    return carried


def _carry(condition: BoundaryCondition, at: _Context) -> None:
    match condition:
        case BoundingBox():
            _bounding_box(condition, at)
        case Cuboid():
            _cuboid(condition, at)
        case Impulse():
            _impulse(condition, at)
        case Translation():
            _translation(condition, at)
        case Rotation():
            _rotation(condition, at)
        case SurfaceCollider():
            _surface(condition, at)
        case ReleaseSequentially():
            _release(condition, at)


def _bounding_box(condition: BoundingBox, at: _Context) -> None:
    """The outermost three nodes lose the velocity out of the domain: walls half a cell inside the third."""
    nodes = at.config.n_grid
    half = (nodes - 2 * _WALL_CELLS) / 2 * at.config.cell
    if half <= 0:
        raise SceneError(f"{at.name}: n_grid {nodes} leaves no room between its walls; expected more than 6.")
    times = at.window(condition.start_time, condition.end_time)
    if times is None:
        return
    if times:
        at.note("is there for a part of the film only in PhysGaussian; here for all of it.")
    middle = (nodes - 1) / 2 * at.config.cell
    shape = at.placement.box([middle] * 3, [half] * 3)
    at.carried.boundaries.append(
        {"kind": "container", "shape": shape, "contact": "separate", "friction": 0.0, "restitution": 0.0}
    )


def _cuboid(condition: Cuboid, at: _Context) -> None:
    """Grid nodes in the box have its velocity: a sticky block."""
    times = at.window(condition.start_time, condition.end_time)
    if times is not None:
        velocity = at.placement.vector(condition.velocity)
        moving = {"velocity_ms": velocity} if any(velocity) else {}
        box = at.placement.box(condition.point, condition.size)
        at.carried.boundaries.append({**box, "contact": "sticky", "restitution": 0.0, **moving, **times})
    if condition.reset == 0:
        return
    if at.mode == "corrected":
        at.note(
            "reset stops everything before start_time and for 15 substeps after end_time in PhysGaussian; left out."
        )
        return
    after = condition.end_time + _RESET_SUBSTEPS * at.config.substep_dt
    for start_s, end_s in ((0.0, condition.start_time), (condition.end_time, after)):
        if end_s > start_s and start_s < at.config.end_s:
            at.carried.boundaries.append({"kind": "pin", "from_s": start_s, "to_s": end_s})


def _impulse(condition: Impulse, at: _Context) -> None:
    """It adds f dt / m_p in some substeps; with its masses, not ours, that is the same change of velocity here."""
    inside = (np.abs(at.places - condition.point) < condition.size).all(1)
    if not inside.any():
        at.note("its box holds no Gaussian; left out.")
        return
    times = at.window(condition.start_time, condition.start_time + condition.num_dt * at.config.substep_dt)
    if times is None:
        return
    masses = at.masses_kg[inside]
    region = at.placement.box(condition.point, condition.size)
    value = at.placement.vector(np.array(condition.force) * len(masses) / masses.sum())
    at.carried.forces.append({"kind": "acceleration", "value_ms2": value, "region": region} | times)
    at.note(
        f"the same force on each of {len(masses):,} particles, whose masses in PhysGaussian differ "
        f"{masses.max() / masses.min():.0f} times, becomes the acceleration that it gives them together."
    )


def _translation(condition: Translation, at: _Context) -> None:
    times = at.window(condition.start_time, condition.end_time)
    if times is None:
        return
    if at.chosen(condition.point, condition.size) == 0:
        at.note("its box holds no Gaussian; left out.")
        return
    region = at.placement.box(condition.point, condition.size)
    value = at.placement.vector(condition.velocity)
    at.carried.forces.append({"kind": "velocity", "value_ms": value, "region": region} | times)


def _rotation(condition: Rotation, at: _Context) -> None:
    """Its turn is left-handed about its normal, so ours is about the opposite axis."""
    times = at.window(condition.start_time, condition.end_time)
    if times is None:
        return
    normal = _unit(condition.normal, at)
    half_height, radius = condition.half_height_and_radius
    center, back = at.placement.point(condition.point), at.placement.vector(-normal)
    region = {
        "kind": "cylinder",
        "center": center,
        "axis": back,
        "radius": at.placement.length(radius),
        "height": at.placement.length(2 * half_height),
    }
    turn = {"kind": "rotation", "axis": back, "center": center, "rate_deg_s": math.degrees(condition.rotation_scale)}
    along = {"along_ms": -condition.translation_scale} if condition.translation_scale else {}
    at.carried.forces.append({**turn, **along, "region": region, **times})


def _surface(condition: SurfaceCollider, at: _Context) -> None:
    """A half space; PhysGaussian computes slip and friction, and then stops everything behind it all the same."""
    times = at.window(condition.start_time, condition.end_time)
    if times is None:
        return
    meant = condition.surface if condition.surface in ("sticky", "slip", "cut") else "separate"
    contact = "sticky" if meant == "cut" or at.mode == "compat" else meant
    if meant == "cut":
        at.note("'cut' stops all but a slab at 0.4 to 0.53 of its own scene; it becomes sticky.")
    elif meant != "sticky" and at.mode == "corrected":
        at.note(f"PhysGaussian makes every surface sticky; this one is '{meant}', as the file says.")
    elif meant != "sticky":
        at.note(f"sticky, as PhysGaussian computes it, although the file says '{meant}'.")
    if contact == "slip" and condition.friction > 0:
        at.note(f"friction {condition.friction:g} of a 'slip' surface is left out; 'separate' is the one that rubs.")
    friction = min(condition.friction, _LARGEST_FRICTION)
    plane = {
        "kind": "plane",
        "point": at.placement.point(condition.point),
        "normal": at.placement.vector(_unit(condition.normal, at)),
        "contact": contact,
        "restitution": 0.0,
    }
    at.carried.boundaries.append(plane | ({"friction": friction} if contact == "separate" else {}) | times)


def _release(condition: ReleaseSequentially, at: _Context) -> None:
    """Boxes about end_position, each a fiftieth smaller than the last and held a fiftieth longer."""
    axes = [axis for axis in range(3) if condition.normal[axis] != 0]
    reach = abs(condition.end_position - condition.start_position)
    if not axes or reach == 0 or condition.end_time <= 0:
        raise SceneError(f"{at.name}: expected a normal, two different positions and an end_time after 0.")
    axis = axes[-1]
    if condition.num_layers != 50:
        at.note(
            f"num_layers: PhysGaussian takes 50 whatever is given ({condition.num_layers}); the front is continuous."
        )
    if condition.start_time > 0:
        at.note(f"in PhysGaussian nothing is held before {condition.start_time:g} s; here from the start.")
    outwards = 1.0 if condition.start_position > condition.end_position else -1.0
    for side in (outwards, -outwards):
        middle = np.ones(3)
        middle[axis] = condition.end_position + side * reach / 2
        half = np.ones(3)
        half[axis] = reach / 2
        inside = (np.abs(at.places - middle) < half).all(1)
        if not inside.any():
            continue
        # the front reaches end_position at end_time, and each place before it in proportion
        share = 1 - np.abs(at.places[inside, axis] - condition.end_position) / reach
        first_s, last_s = condition.end_time * float(share.min()), condition.end_time * float(share.max())
        inwards = np.zeros(3)
        inwards[axis] = -side
        at.carried.boundaries.append(
            {
                "kind": "release",
                "region": at.placement.box(middle, half),
                "direction": at.placement.vector(inwards),
                "from_s": round(first_s, 9),
                "to_s": round(max(last_s, first_s + at.config.substep_dt), 9),
            }
        )
        if side == -outwards:
            at.note("PhysGaussian holds as much beyond end_position as before it, and lets both go from outside in.")


def _unit(normal: Any, at: _Context) -> NDArray[np.float64]:
    vector = np.asarray(normal, np.float64)
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise SceneError(f"{at.name}: expected a normal, got a vector of length 0.")
    return vector / length
