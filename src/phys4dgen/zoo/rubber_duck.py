"""A rubber duck, 9 cm tall: a hollow yellow body, an orange beak, black eyes."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.forms import ball, blended, carved, ellipsoid, hollow, placed, rod, rounded_box, turned_deg
from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.paints import mottled
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.texture import fractal_noise, mix, srgb
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["rubber_duck"]

WALL_M = 0.0022
HEAD_M = np.array([0.0, 0.0660, 0.0200])
HEAD_RADIUS_M = 0.0245


def rubber_duck(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the duck; it looks towards +z.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    return assemble(
        [
            Part(
                "body", "vinyl", [hollow(_body(), WALL_M)], 0.00110, _yellow(seed + 1),
                gloss=0.09, thickness_m=WALL_M, filling="pu_foam",
            ),
            Part(
                "beak", "vinyl", [_beak()], 0.00075, mottled("d8560f", "f58a33", wavelength_m=0.008, seed=seed + 2),
                precedence=1, gloss=0.09,
            ),
            Part(
                "eyes", "vinyl", [_eye(-1), _eye(1)], 0.00045,
                mottled("0e0d10", "34313a", wavelength_m=0.003, seed=seed + 3), precedence=2, gloss=0.15,
            ),
        ],
        metres_per_unit=0.09, motion="drop", seed=seed, light=light,
    )  # fmt: skip


def _body() -> Implicit:
    """Trunk, breast, upturned tail, wings and head in one skin, flat below."""
    trunk = ellipsoid((0.0350, 0.0270, 0.0440), (0, 0.0265, -0.0060))
    breast = ball(0.0260, (0, 0.0300, 0.0180))
    tail = rod([[0, 0.0340, -0.0360], [0, 0.0500, -0.0540]], [0.0150, 0.0035])
    wings = [
        placed(ellipsoid((0.0085, 0.0140, 0.0240)), (side * 0.0320, 0.0330, -0.0100), turned_deg(x=16, y=side * 8))
        for side in (-1, 1)
    ]
    wing_tips = [
        rod([[side * 0.0340, 0.0370, -0.0240], [side * 0.0350, 0.0460, -0.0370]], [0.0065, 0.0022]) for side in (-1, 1)
    ]
    skin = blended(0.010, blended(0.016, trunk, breast, tail, ball(HEAD_RADIUS_M, HEAD_M)), *wings, *wing_tips)
    return carved(skin, rounded_box((0.1, 0.05, 0.1), 0.002, (0, -0.05, 0)), radius_m=0.006)


def _beak() -> Implicit:
    """Two flat bills, the upper one turned up at the tip."""
    upper = placed(ellipsoid((0.0120, 0.0040, 0.0135)), HEAD_M + np.array([0, -0.0030, 0.0285]), turned_deg(x=-14))
    lower = placed(ellipsoid((0.0095, 0.0032, 0.0105)), HEAD_M + np.array([0, -0.0088, 0.0265]), turned_deg(x=10))
    return blended(0.004, upper, lower)


def _eye(side: int) -> Implicit:
    outward = np.array([side * 0.56, 0.36, 0.75])
    return ball(0.0042, HEAD_M + 0.966 * HEAD_RADIUS_M * outward / np.linalg.norm(outward))


def _yellow(seed: int) -> Paint:
    """Warm yellow, a little deeper below, with the bloom of the mould."""

    def paint(patch: Patch) -> Array:
        bloom = fractal_noise(patch.points, 0.022, seed=seed, octaves=4)
        depth = 0.55 - 4 * (patch.points[:, 1] - 0.045) + 0.55 * bloom
        return mix(srgb("fcdc4a"), srgb("eab112"), depth)

    return paint
