"""A hamburger, 9 cm tall: a sesame bun, a grilled patty, a slice of cheese whose corners droop, lettuce."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.blade import Blade
from phys4dgen.zoo.forms import lathe, lifted, placed, rounded_box, shaped, turned_deg
from phys4dgen.zoo.implicit import Implicit
from phys4dgen.zoo.paints import mottled, with_speckles
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.solids import rounded_profile
from phys4dgen.zoo.texture import fractal_noise, mix, srgb, value_noise
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["hamburger"]

CHEESE_HALF_M = 0.0520
CHEESE_M = 0.0034
LETTUCE_M = 0.0010
CROWN_FOOT_M = 0.0475
SEED_M = 0.0022
"""Half length of a sesame seed."""


def hamburger(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the hamburger.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    rng = np.random.default_rng([seed, 1])
    lettuce = [_lettuce_leaf(k, rng) for k in range(11)]
    char = with_speckles(
        mottled("3a2014", "7a4a2e", wavelength_m=0.010, seed=seed + 2), "1f100a", wavelength_m=0.004,
        share=0.2, seed=seed + 3,
    )  # fmt: skip
    return assemble(
        [
            Part("bun", "bread", [_heel(seed), _crown(seed)], 0.00165, _baked(seed + 1), gloss=0.05),
            Part("patty", "meat_grilled", [_patty(seed)], 0.00140, char, gloss=0.04),
            Part(
                "cheese", "cheese", [_cheese()], 0.00145,
                mottled("eba21f", "ffd467", wavelength_m=0.016, seed=seed + 4),
                precedence=1, gloss=0.06, area_m2=(2 * CHEESE_HALF_M) ** 2, thickness_m=CHEESE_M,
            ),
            Part(
                "lettuce", "lettuce_leaf", lettuce, 0.00160, _crisp(seed + 5),
                precedence=2, transmission=0.35, gloss=0.06,
                area_m2=sum(leaf.area_m2 for leaf in lettuce), thickness_m=LETTUCE_M,
            ),
        ],
        metres_per_unit=0.11, motion="drop", seed=seed, light=light,
    )  # fmt: skip


def _heel(seed: int) -> Implicit:
    """The lower half of the bun."""
    corners = np.array([[0, 0], [0.046, 0], [0.053, 0.010], [0.0505, 0.0215], [0, 0.0215]])
    half = lathe(rounded_profile(corners, np.array([0, 0.005, 0.007, 0.004, 0])))
    return shaped(half, lambda p: 0.0007 * fractal_noise(p, 0.03, seed=seed + 10), reach_m=0.0007)


def _crown(seed: int) -> Implicit:
    """The domed upper half, with sesame seeds in a golden-angle spiral."""
    foot = CROWN_FOOT_M
    corners = np.array(
        [
            [0, foot], [0.049, foot], [0.0555, foot + 0.010], [0.047, foot + 0.033], [0.022, foot + 0.0445],
            [0, foot + 0.0445],
        ]
    )  # fmt: skip
    dome = lathe(rounded_profile(corners, np.array([0, 0.004, 0.0078, 0.0140, 0.0135, 0])))

    def swell(points: Array) -> Array:
        return 0.0007 * fractal_noise(points, 0.03, seed=seed + 11) + 0.0010 * _sesame(points)

    return shaped(dome, swell, reach_m=0.0017)


def _sesame(points: Array) -> Array:
    """1 in the middle of a seed on the crown, 0 beside it, shape [N]."""
    k = np.arange(80) + 0.5
    ring, turn = 0.044 * np.sqrt(k / len(k)), k * np.pi * (3 - 5**0.5)
    centres = np.stack([ring * np.cos(turn), ring * np.sin(turn)], 1)
    found = np.zeros(len(points))
    above = np.flatnonzero(points[:, 1] > CROWN_FOOT_M + 0.012)
    plane = points[above][:, [0, 2]]
    gap, nearest = map(np.asarray, KDTree(centres).query(plane, distance_upper_bound=SEED_M))
    hit = np.isfinite(gap)
    offset = plane[hit] - centres[nearest[hit]]
    lean = 2.4 * k[nearest[hit]]  # every seed lies another way
    along = offset[:, 0] * np.cos(lean) + offset[:, 1] * np.sin(lean)
    across = offset[:, 1] * np.cos(lean) - offset[:, 0] * np.sin(lean)
    found[above[hit]] = np.maximum(1 - (along / SEED_M) ** 2 - (across / (0.6 * SEED_M)) ** 2, 0)
    return found


def _patty(seed: int) -> Implicit:
    """Minced meat with a ragged edge."""
    corners = np.array([[0, 0.0205], [0.0525, 0.0205], [0.0545, 0.0290], [0.0525, 0.0375], [0, 0.0375]])
    disc = lathe(rounded_profile(corners, np.array([0, 0.0045, 0.004, 0.0045, 0])))
    return shaped(disc, lambda p: 0.0016 * fractal_noise(p, 0.011, seed=seed + 12), reach_m=0.0016)


def _cheese() -> Implicit:
    """A square slice, molten over the edge of the patty."""
    slice_ = placed(rounded_box((CHEESE_HALF_M, CHEESE_M / 2, CHEESE_HALF_M), 0.0014), (0, 0.0394, 0), turned_deg(y=22))

    def droop(x: Array, z: Array) -> Array:
        beyond = np.maximum(np.hypot(x, z) - 0.045, 0)
        return -12.0 * beyond**2 / (1 + 12.0 * beyond)

    return lifted(slice_, droop, reach_m=0.012)


def _lettuce_leaf(index: int, rng: np.random.Generator) -> Blade:
    """One of the frilly leaves that look out all round."""
    turn = 2 * np.pi * (index + 0.3 * rng.uniform(-1, 1)) / 11
    return Blade(
        origin=np.array([0.024 * np.cos(turn), 0.0436 + 0.0006 * (index % 3), 0.024 * np.sin(turn)]),
        outward=np.array([np.cos(turn), 0.0, np.sin(turn)]),
        up=np.array([0.0, 1.0, 0.0]),
        length_m=0.041 + 0.004 * rng.uniform(-1, 1),
        half_width_m=0.021,
        thickness_m=LETTUCE_M,
        base_power=0.9,
        tip_power=0.30,
        base_half_width_m=0.006,
        elevation_start_deg=3.0,
        elevation_end_deg=-8.0 + 14 * rng.uniform(-1, 1),
        roll_end_deg=10 * rng.uniform(-1, 1),
        ripple=0.22,
        ripple_waves=3.6,
        ripple_phase=float(rng.uniform(0, 2 * np.pi)),
    )


def _baked(seed: int) -> Paint:
    """Golden brown on top, paler towards the cut, with ivory seeds; crumb where it was cut."""
    crumb = mottled("e3c58f", "f6e6c3", wavelength_m=0.005, seed=seed)

    def paint(patch: Patch) -> Array:
        height = patch.points[:, 1]
        rise = np.where(height > CROWN_FOOT_M - 0.003, (height - CROWN_FOOT_M) / 0.030, 1 - height / 0.022)
        tan = 0.25 + 0.75 * np.clip(rise, 0, 1) + 0.28 * fractal_noise(patch.points, 0.022, seed=seed + 1, octaves=4)
        crust = mix(srgb("e2ab62"), srgb("a8622a"), tan)
        cut = (np.abs(patch.normals[:, 1]) > 0.9) & (np.abs(height - 0.034) < 0.017)
        return mix(np.where(cut[:, None], crumb(patch), crust), srgb("f4e3bd"), 3 * _sesame(patch.points))

    return paint


def _crisp(seed: int) -> Paint:
    """Pale at the rib, green at the frill."""

    def paint(patch: Patch) -> Array:
        u, v, _ = patch.coords.T
        frill = 0.15 + 0.65 * u + 0.25 * np.abs(v) + 0.3 * value_noise(patch.points, 0.006, seed=seed)
        return mix(srgb("c5dc8c"), srgb("4f9a31"), frill)

    return paint
