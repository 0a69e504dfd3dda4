"""A stoneware cup of coffee, 9 cm tall: a speckled glaze over a bare brown foot, a handle, the coffee."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.forms import blended, lathe, rod
from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.paints import mottled, with_speckles
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.solids import Revolved, bezier, rounded_profile
from phys4dgen.zoo.texture import fractal_noise, mix, srgb
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["cup"]

WALL_M = 0.0045
COFFEE_M = 0.0740


def cup(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the cup.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    return assemble(
        [
            Part("cup", "ceramic", [_cup()], 0.00130, _glaze(seed + 1), precedence=1, gloss=0.09, thickness_m=WALL_M),
            Part("coffee", "water", [_coffee()], 0.00095, _crema(seed + 2), gloss=0.08),
        ],
        metres_per_unit=0.09, motion="drop", seed=seed, light=light,
    )  # fmt: skip


def _cup() -> Implicit:
    """Foot ring, belly and lip turned on the wheel; the handle pulled on afterwards."""
    corners = np.array(
        [
            [0, 0.003], [0.023, 0.003], [0.0245, 0], [0.0285, 0], [0.0290, 0.006], [0.0400, 0.020], [0.0425, 0.050],
            [0.0410, 0.0880], [0.0410 - WALL_M, 0.0880], [0.0425 - WALL_M, 0.050], [0.0395 - WALL_M, 0.022],
            [0.0240, 0.0095], [0, 0.0085],
        ]
    )  # fmt: skip
    rounding = np.array([0, 0.001, 0.001, 0.0015, 0.002, 0.012, 0.015, 0.0021, 0.0021, 0.015, 0.010, 0.006, 0])
    pulled = bezier(np.array([[0.0385, 0.0730, 0], [0.0800, 0.0900, 0], [0.0800, 0.0200, 0], [0.0385, 0.0270, 0]]), 13)
    thickness = 0.0052 - 0.0012 * np.sin(np.linspace(0, np.pi, 13))
    return blended(0.006, lathe(rounded_profile(corners, rounding)), rod(pulled, thickness))


def _coffee() -> Revolved:
    """Fills the cup; its side lies in the wall, which owns that space."""
    outline = np.array(
        [[0, 0.007], [0.0250, 0.009], [0.0370, 0.0220], [0.0395, 0.0500], [0.0387, COFFEE_M], [0, COFFEE_M]]
    )
    return Revolved(outline, np.zeros(3), np.eye(3))


def _glaze(seed: int) -> Paint:
    """Oatmeal glaze with iron specks that breaks blue towards the lip; bare clay below."""
    oatmeal = with_speckles(
        mottled("cfc4ae", "efe8d8", wavelength_m=0.020, seed=seed), "6b4c35", wavelength_m=0.0024, share=0.035,
        seed=seed + 1,
    )  # fmt: skip
    clay = mottled("8a5a3a", "b07a52", wavelength_m=0.006, seed=seed + 2)
    blue = mottled("3f6488", "7fa3bd", wavelength_m=0.008, seed=seed + 3)

    def paint(patch: Patch) -> Array:
        x, height, z = patch.points.T
        run = 0.006 * fractal_noise(patch.points, 0.014, seed=seed + 4)
        radius = np.hypot(x, z)
        faces_axis = (patch.normals[:, [0, 2]] * np.stack([x, z], 1)).sum(1) < 0
        inside = (radius < 0.0395) & (height > 0.008) & (faces_axis | (patch.normals[:, 1] > 0.5))
        dipped = np.clip((height - 0.064 - run) / 0.006, 0, 1) * (radius < 0.0475)
        color = mix(oatmeal(patch), blue(patch), np.where(inside, np.clip((height - 0.08) / 0.004, 0, 1), dipped))
        return mix(color, clay(patch), np.where(inside, 0.0, np.clip((0.0135 + 0.3 * run - height) / 0.0015, 0, 1)))

    return paint


def _crema(seed: int) -> Paint:
    """Dark coffee with a hazel rim and swirls of foam."""

    def paint(patch: Patch) -> Array:
        x, _, z = patch.points.T
        turn = np.arctan2(z, x) + 60 * np.hypot(x, z)
        swirl = fractal_noise(patch.points + 0.004 * np.stack([np.cos(turn), 0 * x, np.sin(turn)], 1), 0.012, seed=seed)
        rim = np.clip((np.hypot(x, z) - 0.031) / 0.006, 0, 1)
        return mix(srgb("2a1509"), srgb("9a6332"), 0.25 + 0.55 * swirl + 0.55 * rim)

    return paint
