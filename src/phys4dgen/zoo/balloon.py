"""A balloon tied to a block of wood, 0.74 m tall: a thin rubber skin, a cotton string, a pine cube."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.forms import hollow, lathe, placed, rounded_box, turned_deg
from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.paints import mottled, wood_grain
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.solids import Tube, bezier, rounded_profile
from phys4dgen.zoo.texture import mix, srgb
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["balloon"]

BLOCK_M = 0.070
NECK_M = np.array([0.012, 0.400, 0.006])
"""Where the string is tied."""
SKIN_M = 0.0004
STRING_RADIUS_M = 0.0016


def balloon(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the balloon.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    string = _string()
    return assemble(
        [
            Part(
                "block", "softwood", [_block()], 0.0019,
                wood_grain("a8713a", "e6bd80", ring_m=0.0060, seed=seed + 1, axis=0, centre=(-0.010, 0.020)),
                gloss=0.02,
            ),
            Part(
                "string", "cotton_fabric", [string], 0.0013,
                mottled("b9ad98", "f2ecdf", wavelength_m=0.004, seed=seed + 2), precedence=1,
                area_m2=string.area_m2, thickness_m=2 * STRING_RADIUS_M,
            ),
            Part(
                "balloon", "natural_rubber", [_skin()], 0.0036, _rubber(seed + 3),
                transmission=0.30, gloss=0.16, thickness_m=SKIN_M, filling="polyester_fibrefill",
            ),
        ],
        metres_per_unit=0.74, motion="sway", held=["block"], seed=seed, light=light,
    )  # fmt: skip


def _block() -> Implicit:
    half = BLOCK_M / 2
    return placed(rounded_box((half, half, half), 0.0035), (0, half, 0), turned_deg(y=24))


def _string() -> Tube:
    """Taut, with a slight bow; it runs into the wood."""
    foot, knot = np.array([0.0, BLOCK_M - 0.010, 0.0]), NECK_M + np.array([0.0, 0.006, 0.0])
    bow = np.array([[-0.004, 0.17, 0.002], [0.016, 0.28, 0.008]])
    return Tube(bezier(np.vstack([foot, bow, knot]), 200), np.full(200, STRING_RADIUS_M))


def _skin() -> Implicit:
    """A pear that narrows to its neck, below it the rolled lip."""
    corners = np.array(
        [
            [0, -0.012], [0.0100, -0.012], [0.0092, -0.006], [0.0042, 0.000], [0.0070, 0.009], [0.0520, 0.060],
            [0.1210, 0.135], [0.1340, 0.235], [0.0850, 0.318], [0.0300, 0.338], [0, 0.338],
        ]
    )  # fmt: skip
    rounding = np.array([0, 0.002, 0.002, 0.003, 0.004, 0.045, 0.050, 0.048, 0.046, 0.012, 0])
    pear = lathe(rounded_profile(corners, rounding, steps=12))
    return hollow(placed(pear, NECK_M, turned_deg(x=2, z=-3)), SKIN_M)


def _rubber(seed: int) -> Paint:
    """Crimson, paler and thinner where it is stretched most, darker at the neck."""
    tint = mottled("c4162e", "e5404c", wavelength_m=0.09, seed=seed)

    def paint(patch: Patch) -> Array:
        rise = (patch.points[:, 1] - NECK_M[1]) / 0.3
        return mix(tint(patch), srgb("8f0d22"), 0.9 * np.exp(-np.maximum(rise, 0) / 0.12))

    return paint
