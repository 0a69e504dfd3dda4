"""A snowman, 0.92 m tall: three balls of packed snow, a knitted scarf, a felt hat, a carrot and coal."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.forms import ball, blended, carved, ellipsoid, placed, ring, rod, rounded_box, shaped, turned_deg
from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.paints import mottled, with_speckles
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.solids import Revolved, rounded_profile
from phys4dgen.zoo.texture import fractal_noise, mix, srgb, value_noise
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["snowman"]

BALLS_M = ((0.205, 0.195), (0.150, 0.475), (0.115, 0.695))
"""Radius and height of the middle, from below."""
HEAD_M = np.array([0.0, 0.695, 0.0])
NECK_M = 0.594
HAT_TILT_DEG = 7.0
BAND_M = (0.212, 0.240)
"""Where the hat's ribbon lies along the outline."""


def snowman(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the snowman.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    snow = with_speckles(
        mottled("c9d9ea", "fbfdff", wavelength_m=0.085, seed=seed + 1),
        "cddcec", wavelength_m=0.009, share=0.06, seed=seed + 2,
    )  # fmt: skip
    return assemble(
        [
            Part("body", "snow_packed", [_body(seed)], 0.0072, snow),
            Part("scarf", "wool_knit", [_scarf()], 0.0050, _knitted(seed + 3), precedence=1),
            Part(
                "coal", "concrete", _coals(), 0.0030,
                mottled("131316", "3c3b40", wavelength_m=0.010, seed=seed + 4), precedence=1, gloss=0.10,
            ),
            Part("nose", "parenchyma", [_carrot()], 0.0034, _carrot_skin(seed + 5), precedence=1, gloss=0.04),
            Part("hat", "felt", [_hat()], 0.0050, _felt(seed + 6), precedence=1),
        ],
        metres_per_unit=0.92, motion="drop", seed=seed, light=light,
    )  # fmt: skip


def _body(seed: int) -> Implicit:
    """Three balls pressed onto each other, flat at the foot, lumpy from being rolled by hand."""
    whole = blended(0.03, *(ball(radius, (0, height, 0)) for radius, height in BALLS_M))
    ground = rounded_box((0.4, 0.2, 0.4), 0.01, (0, -0.2, 0))
    lumpy = shaped(whole, lambda p: 0.0035 * fractal_noise(p, 0.09, seed=seed, octaves=2), reach_m=0.0035)
    return carved(lumpy, ground, radius_m=0.02)


def _scarf() -> Implicit:
    """Once round the neck and knotted at the side of the chest, both ends hanging down."""
    loop = placed(ring(0.104, (0.024, 0.026), 0.020), (0, NECK_M, 0), turned_deg(x=5))
    knot = ellipsoid((0.030, 0.030, 0.024), (0.058, NECK_M - 0.012, 0.114))
    front = placed(
        rounded_box((0.026, 0.085, 0.010), 0.009), (0.075, NECK_M - 0.100, 0.138), turned_deg(x=-4, y=26, z=7)
    )
    back = placed(
        rounded_box((0.024, 0.060, 0.010), 0.009), (0.030, NECK_M - 0.078, 0.146), turned_deg(x=-6, y=14, z=-9)
    )
    return blended(0.016, loop, knot, front, back)


def _coals() -> list[Implicit]:
    """Two eyes, a smile of six pebbles and three buttons, pressed half into the snow."""
    head_radius = BALLS_M[2][0]

    def on_head(azimuth_deg: float, elevation_deg: float, size_m: float) -> Implicit:
        a, e = np.deg2rad([azimuth_deg, elevation_deg])
        outward = np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
        return ellipsoid((size_m, 0.92 * size_m, size_m), HEAD_M + 0.995 * head_radius * outward)

    eyes = [on_head(azimuth, 20, 0.0145) for azimuth in (-22, 22)]
    smile = [on_head(azimuth, -34 + 0.011 * azimuth**2, 0.0080) for azimuth in (-32, -20, -7, 7, 20, 32)]
    heights = (0.500, 0.410, 0.290)
    depths = [_front_m(height) for height in heights]
    buttons = [ellipsoid((0.016, 0.016, 0.012), (-0.018, h, d)) for h, d in zip(heights, depths, strict=True)]
    return eyes + smile + buttons


def _front_m(height_m: float) -> float:
    """How far the body reaches towards +z at a height."""
    return max(np.sqrt(max(r * r - (height_m - y) ** 2, 0)) for r, y in BALLS_M)


def _carrot() -> Implicit:
    """Pointed, a little bent, with shallow rings; its thick end sits in the snow."""
    t = np.linspace(0, 1, 9)
    line = HEAD_M + np.stack([0.004 * np.sin(2.2 * t), 0.004 + 0.016 * t * t, 0.085 + 0.155 * t], 1)
    root = rod(line, 0.0235 * (1 - t) ** 0.85 + 0.0028)
    return shaped(root, lambda p: 0.0007 * np.sin(p[:, 2] / 0.0042) - 0.0004, reach_m=0.0005)


def _hat() -> Revolved:
    """A top hat of thick felt, filled, set at an angle."""
    corners = np.array(
        [[0, 0], [0.140, 0.004], [0.143, 0.014], [0.088, 0.013], [0.080, 0.060], [0.088, 0.135], [0.0, 0.132]]
    )
    profile = rounded_profile(corners, np.array([0, 0.004, 0.004, 0.008, 0.03, 0.010, 0]))
    return Revolved(profile, HEAD_M + np.array([0.012, 0.083, -0.006]), turned_deg(x=-4, z=-HAT_TILT_DEG))


def _knitted(seed: int) -> Paint:
    """Red wool with cream stripes and the ribs of the stitches."""

    def paint(patch: Patch) -> Array:
        x, y, z = patch.points.T
        hangs = y < NECK_M - 0.035
        along = np.where(hangs, y / 0.030, np.arctan2(x, z) / (2 * np.pi) * 20)
        stripe = np.clip((np.cos(2 * np.pi * along) - 0.25) / 0.2, 0, 1)
        stitch = value_noise(patch.points, 0.0055, seed=seed) + 0.5 * np.sin(2 * np.pi * patch.points[:, 1] / 0.0085)
        color = mix(srgb("b3202b"), srgb("efe3cb"), stripe)
        return color * (1 + 0.13 * stitch + 0.08 * fractal_noise(patch.points, 0.04, seed=seed + 7))[:, None]

    return paint


def _carrot_skin(seed: int) -> Paint:
    """Orange with darker rings."""

    def paint(patch: Patch) -> Array:
        rings = value_noise(patch.points * np.array([0.25, 0.25, 1.0]), 0.0036, seed=seed)
        color = mix(srgb("d9661b"), srgb("f59a3d"), 0.5 + 0.4 * fractal_noise(patch.points, 0.03, seed=seed + 1))
        return color * (1 + 0.14 * rings)[:, None]

    return paint


def _felt(seed: int) -> Paint:
    """Charcoal felt with a black ribbon above the brim."""
    cloth = mottled("24262d", "4a4d57", wavelength_m=0.014, seed=seed, contrast=0.8)

    def paint(patch: Patch) -> Array:
        up_crown = (patch.coords[:, 0] - BAND_M[0]) / (BAND_M[1] - BAND_M[0])
        return mix(cloth(patch), srgb("15161a"), 0.8 * ((up_crown > 0) & (up_crown < 1)))

    return paint
