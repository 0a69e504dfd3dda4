"""The bundled demo object: a flower in a terracotta pot as Gaussians, 0.35 m tall, y up, made by code.

Shapes come from ``flower_shapes``, colour from ``texture``, light from ``shading``. Everything is built in metres with
the ground at y = 0 and divided by ``METRES_PER_UNIT`` at the end, so that the object is about one unit tall.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types import rotation_to_z_up
from phys4dgen.zoo import texture
from phys4dgen.zoo.dressing import Dressed, lit_gaussians
from phys4dgen.zoo.flower_shapes import (
    HEART,
    HEART_RADIUS_M,
    LEAVES,
    MATERIALS,
    PART_NAMES,
    PETALS,
    POT,
    SOIL,
    SOIL_HEIGHT_M,
    STEM,
    UP,
    WALL_M,
    FlowerShapes,
)
from phys4dgen.zoo.lights import LIGHTS
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["METRES_PER_UNIT", "potted_flower"]

METRES_PER_UNIT = 0.35
SPACING_M = {POT: 0.0018, SOIL: 0.0012, STEM: 0.00085, LEAVES: 0.00122, PETALS: 0.0009, HEART: 0.00075}
"""Distance between neighbouring Gaussians: finer where the picture has finer detail."""
SHADOW_PIXEL_M = 0.0024


def potted_flower(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the potted flower, about 80,000 Gaussians with spherical harmonics of degree 1.

    Args:
        seed: of the small irregularities; the same seed gives the same arrays.
        light: a name in ``lights.LIGHTS``.
    """
    shapes = FlowerShapes(seed)
    dressed = _dress(shapes, seed)
    gaussians = lit_gaussians(dressed, metres_per_unit=METRES_PER_UNIT, pixel_m=SHADOW_PIXEL_M, light=LIGHTS[light])
    lower, upper = gaussians.robust_bounds(rotation=rotation_to_z_up(UP))
    height_m = float(upper[2] - lower[2]) * METRES_PER_UNIT

    def inside(points: NDArray[Any]) -> NDArray[np.int32]:
        return shapes.inside(np.asarray(points, np.float64) * METRES_PER_UNIT)

    return ZooObject(
        gaussians=gaussians,
        labels=np.concatenate([np.full(len(d.patch), d.part, np.int32) for d in dressed]),
        part_names=PART_NAMES,
        up=UP,
        metres_per_unit=METRES_PER_UNIT,
        height_m=height_m,
        measure=shapes.truth,
        motion="sway",
        default_scene=_default_scene(height_m),
        inside=inside,
    )


def _dress(shapes: FlowerShapes, seed: int) -> list[Dressed]:
    """Sample every shape and paint it."""
    rng = np.random.default_rng([seed, 2])
    pot = shapes.pot.sample(SPACING_M[POT], rng, line=shapes.pot_skin)
    soil = shapes.soil_patch(SPACING_M[SOIL], rng)
    grain = rng.uniform(-1, 1, len(soil))
    dressed = [
        Dressed(POT, pot, texture.terracotta(pot.points, seed=seed + 1), gloss=0.03),
        Dressed(SOIL, soil, texture.potting_soil(soil.points, grain=grain, seed=seed + 2)),
    ]
    for number, rod in enumerate(shapes.rods):
        patch = rod.sample(SPACING_M[STEM], rng)
        patch = patch.subset(shapes.is_bare(rod, patch.points + np.array([0.0, 0.002, 0.0])))  # 2 mm into the soil
        color = texture.stem(patch.points, low_m=SOIL_HEIGHT_M, high_m=0.32, seed=seed + 3 + number)
        dressed.append(Dressed(STEM, patch, color, gloss=0.07))
    for number, blade in enumerate(shapes.leaves):
        patch = blade.sample(SPACING_M[LEAVES], rng)
        color = texture.leaf(
            patch.coords,
            length_to_width=blade.length_m / blade.half_width_m,
            youth=number / (len(shapes.leaves) - 1),
            seed=seed + 20 + number,
        )
        dressed.append(Dressed(LEAVES, patch, color, transmission=0.30, gloss=0.10))
    for number, blade in enumerate(shapes.petals):
        patch = blade.sample(SPACING_M[PETALS], rng)
        color = texture.petal(patch.coords, tint=float(rng.uniform(-1, 1)), seed=seed + 60 + number)
        dressed.append(Dressed(PETALS, patch, color, transmission=0.42, gloss=0.03))
    heart = shapes.heart.sample(SPACING_M[HEART], rng)
    local = (heart.points - shapes.heart.origin) @ shapes.heart.rotation
    color = texture.heart(local, radius_m=HEART_RADIUS_M, seed=seed + 90)
    dressed.append(Dressed(HEART, heart, color, transmission=0.1))
    return dressed


def _default_scene(height_m: float) -> dict[str, Any]:
    """Settings of the demo scene: the pot and its soil are held, a gust moves the rest."""
    held = ("pot", "soil")
    return {
        "up": "+y",
        "height_m": height_m,
        "grouping": {"names": dict(enumerate(PART_NAMES))},
        "simulation": {"grid": 48},  # a demo should not keep anyone waiting for a minute
        "parts": {
            name: {
                "hold": "fixed" if name in held else "free",
                "material": material,
                **({"thickness_m": WALL_M} if name == "pot" else {}),
            }
            for name, material in zip(PART_NAMES, MATERIALS, strict=True)
        },
    }
