"""A claw hammer, 0.32 m tall: a forged steel head on a hickory handle, set down on the handle's end, leaning."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.forms import blended, lathe, placed, rod, rounded_box, stretched, turned_deg, united
from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.paints import mottled, wood_grain
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.solids import rounded_profile
from phys4dgen.zoo.texture import mix, srgb, value_noise
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["hammer"]

EYE_M = 0.290
"""Height of the middle of the head above the end of the handle."""
LEAN = turned_deg(z=9.0)
FOOT_M = np.array([0.0, 0.0022, 0.0])
"""Where the end of the handle stands: its lower edge touches the ground."""


def hammer(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the hammer.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    wood = wood_grain("8f5a2c", "dcab6c", ring_m=0.0042, seed=seed + 1, centre=(0.012, 0.016))
    return assemble(
        [
            Part("handle", "hardwood", [_standing(_handle())], 0.00135, _upright(wood), precedence=1, gloss=0.05),
            Part("head", "steel", [_standing(_head())], 0.00120, _upright(_forged(seed + 2)), gloss=0.10),
        ],
        metres_per_unit=0.32, motion="drop", seed=seed, light=light,
    )  # fmt: skip


def _standing(solid: Implicit) -> Implicit:
    return placed(solid, FOOT_M, LEAN)


def _upright(paint: Paint) -> Paint:
    """The paint applied in the hammer's own axes."""
    return lambda patch: paint(patch.moved(-FOOT_M @ LEAN, LEAN.T))


def _handle() -> Implicit:
    """Oval, swelling towards the grip's end; its top shows above the head."""
    outline = np.array(
        [
            [0, 0], [0.0170, 0.0], [0.0185, 0.010], [0.0160, 0.060], [0.0138, 0.120], [0.0120, 0.200],
            [0.0132, 0.262], [0.0128, EYE_M + 0.0185], [0, EYE_M + 0.0185],
        ]
    )  # fmt: skip
    rounding = np.array([0, 0.004, 0.006, 0.02, 0.03, 0.03, 0.02, 0.002, 0])
    return stretched(lathe(rounded_profile(outline, rounding, steps=4)), (1.0, 1.0, 0.76))


def _head() -> Implicit:
    """Cheeks round the eye, a poll with a bevelled face towards +x, two tines that curl down towards -x."""
    cheeks = rounded_box((0.021, 0.0165, 0.0145), 0.004, (0, EYE_M, 0))
    neck = rod([[0.0, EYE_M, 0], [0.046, EYE_M, 0]], [0.0135, 0.0112])
    face = np.array([[0, 0], [0.0125, 0], [0.0160, 0.0045], [0.0160, 0.0190], [0.0140, 0.0212], [0, 0.0220]])
    poll = placed(lathe(face), (0.044, EYE_M, 0), turned_deg(z=-90))
    t = np.linspace(0, 1, 7)
    tines = []
    for side in (-1.0, 1.0):
        curl = np.stack([-0.010 - 0.072 * t, EYE_M + 0.004 - 0.032 * t**2.1, side * (0.0045 + 0.0085 * t)], 1)
        tines.append(rod(curl, 0.0102 - 0.0066 * t))
    return united(blended(0.012, cheeks, neck, *tines), blended(0.004, neck, poll))


def _forged(seed: int) -> Paint:
    """Dark scale on the cheeks, brushed bright metal at the face and the claw."""
    scale = mottled("4b4f55", "7c8188", wavelength_m=0.016, seed=seed)

    def paint(patch: Patch) -> Array:
        brushed = value_noise(patch.points * np.array([0.2, 1.0, 1.0]), 0.0030, seed=seed + 1)
        bright = mix(srgb("868d94"), srgb("b4babf"), 0.5 + 0.5 * brushed)
        worn = np.clip((np.abs(patch.points[:, 0] + 0.004) - 0.036) / 0.016, 0, 1)
        return mix(scale(patch), bright, worn)

    return paint
