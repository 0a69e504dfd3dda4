"""A sandcastle on the beach, 0.31 m to the tip of its flag: damp sand on a mound of dry sand."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.blade import Blade
from phys4dgen.zoo.forms import blended, carved, lathe, mirrored, placed, rod, rounded_box, shaped, turned_deg, united
from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.paints import mottled, with_speckles, wood_grain
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.solids import Tube, rounded_profile
from phys4dgen.zoo.texture import fractal_noise, mix, srgb, value_noise
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["sandcastle"]

TOWER_M = 0.082
"""Distance of the corner towers from the middle along x and z."""
KEEP_TOP_M = 0.205
POLE_TOP_M = 0.310
POLE_RADIUS_M = 0.0022
FLAG_M = 0.0012


def sandcastle(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the sandcastle.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    pole = Tube(np.array([[0, y, 0] for y in np.linspace(0.17, POLE_TOP_M, 60)]), np.full(60, POLE_RADIUS_M))
    flag = _flag()
    return assemble(
        [
            Part("base", "sand_dry", [_base(seed)], 0.0030, _sand("cdb183", "ecd9b2", seed + 1)),
            Part("castle", "sand_damp", [_castle(seed)], 0.0029, _sand("bf9f6e", "e0c494", seed + 2), precedence=1),
            Part(
                "pole", "softwood", [pole], 0.0012, wood_grain("6e4a2a", "b48554", ring_m=0.0012, seed=seed + 3),
                precedence=2, area_m2=np.pi * 2 * POLE_RADIUS_M * (POLE_TOP_M - KEEP_TOP_M),
                thickness_m=2 * POLE_RADIUS_M,
            ),
            Part(
                "flag", "cotton_fabric", [flag], 0.0014, _flag_cloth(seed + 4),
                transmission=0.25, area_m2=flag.area_m2, thickness_m=FLAG_M,
            ),
        ],
        metres_per_unit=0.31, motion="drop", seed=seed, light=light,
    )  # fmt: skip


def _sand(dark: str, pale: str, seed: int) -> Paint:
    """Sand with darker and lighter grains."""
    grains = with_speckles(
        mottled(dark, pale, wavelength_m=0.016, seed=seed, contrast=0.6), "a5865a", wavelength_m=0.0050, share=0.08,
        seed=seed + 10,
    )  # fmt: skip
    return with_speckles(grains, "f3e5c6", wavelength_m=0.0050, share=0.06, seed=seed + 20)


def _base(seed: int) -> Implicit:
    """A low mound."""
    corners = np.array([[0, 0], [0.150, 0], [0.140, 0.012], [0.112, 0.028], [0, 0.030]])
    mound = lathe(rounded_profile(corners, np.array([0, 0.003, 0.010, 0.016, 0])))
    return shaped(mound, lambda p: 0.0028 * fractal_noise(p, 0.040, seed=seed + 5), reach_m=0.0028)


def _castle(seed: int) -> Implicit:
    """Four walls and towers from buckets round a keep; merlons on top, a gate to the front."""
    tower = placed(_tower(0.034, 0.022, 0.130), (TOWER_M, 0.018, TOWER_M))
    side = rounded_box((TOWER_M, 0.038, 0.0135), 0.003, (0, 0.056, TOWER_M))
    ahead = rounded_box((0.0135, 0.038, TOWER_M), 0.003, (TOWER_M, 0.056, 0))
    across = mirrored(rounded_box((0.0055, 0.010, 0.2), 0.002, (0.011, 0.0965, 0)))
    along = mirrored(rounded_box((0.2, 0.010, 0.0055), 0.002, (0, 0.0965, 0.011)))
    gaps = [placed(across, (0.022, 0, 0)), placed(along, (0, 0, 0.022))]  # four of each, once the quarter is mirrored
    gate = united(
        rounded_box((0.015, 0.020, 0.03), 0.001, (0, 0.042, TOWER_M)),
        rod([[0, 0.062, TOWER_M - 0.03], [0, 0.062, TOWER_M + 0.03]], 0.015),
    )
    court = carved(mirrored(blended(0.006, carved(united(side, ahead), *gaps), tower)), gate)
    keep = placed(_tower(0.050, 0.034, KEEP_TOP_M - 0.020), (0, 0.020, 0))
    whole = blended(0.006, court, keep)
    return shaped(whole, lambda p: 0.0011 * value_noise(p, 0.012, seed=seed + 6), reach_m=0.0011)


def _tower(foot_m: float, neck_m: float, height_m: float) -> Implicit:
    """Turned out of a bucket: tapering, with a wider crown that six gaps divide."""
    crown = 1.16 * neck_m
    corners = np.array(
        [[0, 0], [foot_m, 0], [neck_m, 0.80 * height_m], [crown, 0.84 * height_m], [crown, height_m], [0, height_m]]
    )
    body = lathe(rounded_profile(corners, np.array([0, 0.002, 0.003, 0.003, 0.002, 0])))
    gap = rounded_box((0.1, 0.075 * height_m, 0.19 * neck_m), 0.0015, (0, height_m, 0))
    return carved(body, gap, mirrored(placed(gap, rotation=turned_deg(y=60))))


def _flag() -> Blade:
    """A pennant that a light breeze lifts."""
    return Blade(
        origin=np.array([0.0, POLE_TOP_M - 0.022, 0.0]),
        outward=np.array([0.94, 0.0, 0.34]) / np.hypot(0.94, 0.34),
        up=np.array([0.34, 0.0, -0.94]) / np.hypot(0.94, 0.34),
        length_m=0.078,
        half_width_m=0.0170,
        thickness_m=FLAG_M,
        base_power=0.04,
        tip_power=0.80,
        base_half_width_m=0.0030,
        elevation_start_deg=24.0,
        elevation_end_deg=-30.0,
        ripple=0.12,
        ripple_waves=1.6,
    )


def _flag_cloth(seed: int) -> Paint:
    """Red cotton with a white stripe."""

    def paint(patch: Patch) -> Array:
        _, v, _ = patch.coords.T
        weave = value_noise(patch.points, 0.0028, seed=seed) + fractal_noise(patch.points, 0.015, seed=seed + 1)
        color = mix(srgb("c2262c"), srgb("f1ece1"), np.clip((0.34 - np.abs(v)) / 0.05, 0, 1))
        return color * (1 + 0.10 * weave)[:, None]

    return paint
