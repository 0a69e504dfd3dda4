"""The bundled demo object: a flower in a terracotta pot as Gaussians, 0.35 m tall, y up, made by code.

Shapes come from ``flower_shapes``, colour from ``texture``, light from ``shading``. Everything is built in metres with
the ground at y = 0 and divided by ``METRES_PER_UNIT`` at the end, so that the object is about one unit tall.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen.types import SH_C0, Gaussians, rotation_to_z_up
from phys4dgen.zoo import shading, texture
from phys4dgen.zoo.flower_shapes import (
    HEART,
    HEART_RADIUS_M,
    LEAVES,
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
from phys4dgen.zoo.patch import Array, Patch, joined
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["METRES_PER_UNIT", "potted_flower"]

METRES_PER_UNIT = 0.35
OPACITY = 0.97
SPACING_M = {POT: 0.0018, SOIL: 0.0012, STEM: 0.00085, LEAVES: 0.00122, PETALS: 0.0009, HEART: 0.00075}
"""Distance between neighbouring Gaussians: finer where the picture has finer detail."""


@dataclass(frozen=True, eq=False)
class _Dressed:
    """Samples of one part with their colour and how they take light."""

    part: int
    patch: Patch
    albedo: Array  # sRGB, [N, 3]
    transmission: float  # share of the light on the far side that shines through
    gloss: float  # change of colour towards the mirror image of the key light


def potted_flower(*, seed: int = 0) -> ZooObject:
    """Build the potted flower, about 80,000 Gaussians with spherical harmonics of degree 1.

    Args:
        seed: of the small irregularities; the same seed gives the same arrays.
    """
    shapes = FlowerShapes(seed)
    dressed = _dress(shapes, seed)
    gaussians = _as_gaussians(dressed)
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
        truth=shapes.truth(),
        default_scene=_default_scene(height_m),
        inside=inside,
    )


def _dress(shapes: FlowerShapes, seed: int) -> list[_Dressed]:
    """Sample every shape and paint it."""
    rng = np.random.default_rng([seed, 2])
    pot = shapes.pot.sample(shapes.pot_skin, SPACING_M[POT], rng)
    soil = shapes.soil_patch(SPACING_M[SOIL], rng)
    grain = rng.uniform(-1, 1, len(soil))
    dressed = [
        _Dressed(POT, pot, texture.terracotta(pot.points, seed=seed + 1), transmission=0.0, gloss=0.03),
        _Dressed(
            SOIL, soil, texture.potting_soil(soil.points, grain=grain, seed=seed + 2), transmission=0.0, gloss=0.0
        ),
    ]
    for number, rod in enumerate(shapes.rods):
        patch = rod.sample(SPACING_M[STEM], rng)
        patch = patch.subset(shapes.is_bare(rod, patch.points + np.array([0.0, 0.002, 0.0])))  # 2 mm into the soil
        color = texture.stem(patch.points, low_m=SOIL_HEIGHT_M, high_m=0.32, seed=seed + 3 + number)
        dressed.append(_Dressed(STEM, patch, color, transmission=0.0, gloss=0.07))
    for number, blade in enumerate(shapes.leaves):
        patch = blade.sample(SPACING_M[LEAVES], rng)
        color = texture.leaf(
            patch.coords,
            length_to_width=blade.length_m / blade.half_width_m,
            youth=number / (len(shapes.leaves) - 1),
            seed=seed + 20 + number,
        )
        dressed.append(_Dressed(LEAVES, patch, color, transmission=0.30, gloss=0.10))
    for number, blade in enumerate(shapes.petals):
        patch = blade.sample(SPACING_M[PETALS], rng)
        color = texture.petal(patch.coords, tint=float(rng.uniform(-1, 1)), seed=seed + 60 + number)
        dressed.append(_Dressed(PETALS, patch, color, transmission=0.42, gloss=0.03))
    heart = shapes.heart.sample(shapes.heart.profile, SPACING_M[HEART], rng)
    local = (heart.points - shapes.heart.origin) @ shapes.heart.rotation
    color = texture.heart(local, radius_m=HEART_RADIUS_M, seed=seed + 90)
    dressed.append(_Dressed(HEART, heart, color, transmission=0.1, gloss=0.0))
    return dressed


def _as_gaussians(dressed: list[_Dressed]) -> Gaussians:
    """Light the samples and turn them into Gaussians in input units."""
    counts = [len(d.patch) for d in dressed]
    patch = joined([d.patch for d in dressed])
    albedo = shading.srgb_to_linear(np.concatenate([d.albedo for d in dressed]))
    irradiance = shading.bake_irradiance(
        patch.points, patch.normals, transmission=np.repeat([d.transmission for d in dressed], counts)
    )
    sh = np.zeros((len(patch), 4, 3))
    sh[:, 0] = (shading.linear_to_srgb(albedo * irradiance) - 0.5) / SH_C0
    sh[:, 1:] = shading.gloss_sh1(patch.normals, np.repeat([d.gloss for d in dressed], counts))[:, :, None]
    axes = np.stack([patch.tangents, np.cross(patch.normals, patch.tangents), patch.normals], -1)
    return Gaussians(
        means=(patch.points / METRES_PER_UNIT).astype(np.float32),
        quats_wxyz=Rotation.from_matrix(axes).as_quat(canonical=True)[:, [3, 0, 1, 2]].astype(np.float32),
        scales=(patch.sigmas / METRES_PER_UNIT).astype(np.float32),
        opacities=np.full(len(patch), OPACITY, np.float32),
        sh=sh.astype(np.float32),
    )


def _default_scene(height_m: float) -> dict[str, Any]:
    """Settings of the demo scene: the pot and its soil are held, a gust moves the rest."""
    materials = {
        "pot": "terracotta",
        "soil": "soil",
        "stem": "herbaceous stem",
        "leaves": "leaf blade",
        "petals": "petal",
        "heart": "herbaceous stem",
    }
    held = ("pot", "soil")
    return {
        "up": "+y",
        "height_m": height_m,
        "grouping": {"names": dict(enumerate(PART_NAMES))},
        "motion": {"preset": "sway"},
        "simulation": {"grid": 48},  # a demo should not keep anyone waiting for a minute
        "parts": {
            name: {
                "hold": "fixed" if name in held else "free",
                "material": material,
                **({"thickness_m": WALL_M} if name == "pot" else {}),
            }
            for name, material in materials.items()
        },
    }
