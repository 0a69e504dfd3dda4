"""From parts with shapes, paint and material to a bundled object with its truth.

Where shapes overlap, the part of higher ``precedence`` owns the overlap (a carrot in snow); between parts of equal
precedence the one named first does. No part has Gaussians inside another: what nobody can see is not in a capture.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types import rotation_to_z_up
from phys4dgen.zoo.blade import Blade
from phys4dgen.zoo.dressing import Dressed, lit_gaussians
from phys4dgen.zoo.lights import LIGHTS
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.zoo_object import MotionName, PartTruth, ZooObject

__all__ = ["Paint", "Part", "Shape", "assemble"]

Paint = Callable[[Patch], Array]
"""Samples -> sRGB albedo, shape [N, 3]."""

UP = np.array([0.0, 1.0, 0.0])
OVERLAP_SIDE = 48
"""Points along each side of the box in which the overlap of two shapes is measured."""


class Shape(Protocol):
    """What a part is built of; metres, y up, the ground at y = 0."""

    @property
    def lower(self) -> Array:
        """Corner of a box around the shape, shape [3]."""
        ...

    @property
    def upper(self) -> Array:
        """The opposite corner, shape [3]."""
        ...

    @property
    def volume_m3(self) -> float:
        """Volume of the material."""
        ...

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether each point [N, 3] lies in the material."""
        ...

    def sample(self, spacing_m: float, rng: np.random.Generator) -> Patch:
        """Samples of the surface."""
        ...


@dataclass(frozen=True, eq=False)
class Part:
    """One material part.

    Attributes:
        name: of the part.
        material: its name in the material library.
        shapes: what it is made of.
        spacing_m: distance between neighbouring Gaussians.
        paint: its colour.
        precedence: who owns the space that shapes share, see above.
        transmission: share of the light on the far side that shines through.
        gloss: change of sRGB colour towards the mirror image of the key light.
        area_m2: of the mid-surface of a sheet or the side of a rod.
        thickness_m: of a sheet, a rod or a wall.
        filling: library name of the stuff that stands in for the air that a closed wall holds.
    """

    name: str
    material: str
    shapes: Sequence[Shape]
    spacing_m: float
    paint: Paint
    precedence: int = 0
    transmission: float = 0.0
    gloss: float = 0.0
    area_m2: float | None = None
    thickness_m: float | None = None
    filling: str | None = None


def assemble(
    parts: Sequence[Part],
    *,
    metres_per_unit: float,
    motion: MotionName,
    held: Sequence[str] = (),
    scene: Mapping[str, Any] | None = None,
    seed: int,
    light: str,
) -> ZooObject:
    """Sample, paint and light the parts.

    Args:
        parts: numbered in this order, from the ground up.
        metres_per_unit: length of an input unit.
        motion: the preset that shows the object best.
        held: parts that stand still.
        scene: further settings of the demo scene, keys as in scene.yaml.
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    rng = np.random.default_rng([seed, 2])
    dressed = []
    for number, part in enumerate(parts):
        for shape in part.shapes:
            patch = shape.sample(part.spacing_m, rng)
            patch = patch.subset(~_buried(patch.points, shape, parts))
            dressed.append(Dressed(number, patch, part.paint(patch), transmission=part.transmission, gloss=part.gloss))
    gaussians = lit_gaussians(
        dressed,
        metres_per_unit=metres_per_unit,
        pixel_m=4 / 3 * max(part.spacing_m for part in parts),
        light=LIGHTS[light],
    )
    lower, upper = gaussians.robust_bounds(rotation=rotation_to_z_up(UP))
    height_m = float(upper[2] - lower[2]) * metres_per_unit
    ranked = sorted(range(len(parts)), key=lambda number: -parts[number].precedence)
    claims = [(number, shape) for number in ranked for shape in parts[number].shapes]

    def inside(points: NDArray[Any]) -> NDArray[np.int32]:
        metres = np.asarray(points, np.float64) * metres_per_unit
        owner = np.full(len(metres), -1, np.int32)
        for number, shape in claims:
            owner[(owner < 0) & _within(metres, shape)] = number
        return owner

    return ZooObject(
        gaussians=gaussians,
        labels=np.concatenate([np.full(len(d.patch), d.part, np.int32) for d in dressed]),
        part_names=tuple(part.name for part in parts),
        up=UP,
        metres_per_unit=metres_per_unit,
        height_m=height_m,
        measure=lambda: _truth(parts, claims),
        motion=motion,
        default_scene=_default_scene(parts, height_m, held) | dict(scene or {}),
        inside=inside,
    )


def _within(points: Array, shape: Shape) -> NDArray[np.bool_]:
    """``shape.contains`` asked only about the points in the shape's box."""
    found = np.zeros(len(points), bool)
    boxed = np.flatnonzero(((points > shape.lower) & (points < shape.upper)).all(1))
    found[boxed] = shape.contains(points[boxed])
    return found


def _buried(points: Array, own: Shape, parts: Sequence[Part]) -> NDArray[np.bool_]:
    """Which points [N, 3] of a shape's surface lie inside another shape; sheets are too thin to bury anything."""
    others = [s for part in parts for s in part.shapes if s is not own and not isinstance(s, Blade)]
    return np.any([_within(points, shape) for shape in others], axis=0) if others else np.zeros(len(points), bool)


def _truth(parts: Sequence[Part], claims: Sequence[tuple[int, Shape]]) -> dict[str, PartTruth]:
    """Exact geometry of every part: its shapes' volumes without what others own."""
    volumes = np.zeros(len(parts))
    for rank, (number, shape) in enumerate(claims):
        volumes[number] += shape.volume_m3 - _shared_m3(shape, [other for _, other in claims[:rank]])
    return {
        part.name: PartTruth(
            material=part.material,
            volume_m3=float(volume),
            area_m2=part.area_m2,
            thickness_m=part.thickness_m,
        )
        for part, volume in zip(parts, volumes, strict=True)
    }


def _shared_m3(shape: Shape, owners: Sequence[Shape]) -> float:
    """Volume of ``shape`` that lies in any of ``owners`` (midpoint rule in the box that they share)."""
    near = [o for o in owners if (np.minimum(shape.upper, o.upper) > np.maximum(shape.lower, o.lower)).all()]
    if not near:
        return 0.0
    points, weight_m3 = shape.volume_points() if isinstance(shape, Blade) else _lattice(shape, near)
    shared = np.any([_within(points, owner) for owner in near], axis=0)
    return float((weight_m3 * shared).sum())


def _lattice(shape: Shape, near: Sequence[Shape]) -> tuple[Array, Array]:
    """Points [M, 3] of ``shape`` in the box that it shares with ``near``, and the volume that each stands for."""
    lower = np.maximum(shape.lower, np.min([owner.lower for owner in near], axis=0))
    upper = np.minimum(shape.upper, np.max([owner.upper for owner in near], axis=0))
    cell = (upper - lower) / OVERLAP_SIDE
    points = lower + (np.argwhere(np.ones((OVERLAP_SIDE,) * 3)) + 0.5) * cell
    points = points[shape.contains(points)]
    return points, np.full(len(points), cell.prod())


def _default_scene(parts: Sequence[Part], height_m: float, held: Sequence[str]) -> dict[str, Any]:
    """Settings of the demo scene besides the motion: size, names, materials and what is held."""

    def options(part: Part) -> dict[str, Any]:
        chosen = {
            "hold": "fixed" if part.name in held else "free",
            "material": part.material,
            "interior_material": part.filling,
            "thickness_m": part.thickness_m,
        }
        return {key: value for key, value in chosen.items() if value is not None}

    return {
        "up": "+y",
        "height_m": height_m,
        "grouping": {"names": {number: part.name for number, part in enumerate(parts)}},
        "simulation": {"grid": 48},  # a demo should not keep anyone waiting for a minute
        "parts": {part.name: options(part) for part in parts},
    }
