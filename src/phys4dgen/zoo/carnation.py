"""A carnation in a vase, 0.36 m tall: glazed porcelain, a grey-green stalk with narrow leaves, ruffled red petals."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.blade import Blade
from phys4dgen.zoo.paints import mottled
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.solids import Revolved, Tube, bezier, rounded_profile
from phys4dgen.zoo.texture import fractal_noise, mix, srgb, value_noise
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["carnation"]

WALL_M = 0.0050
STALK_RADIUS_M = 0.0028
LEAF_M = 0.0010
PETAL_M = 0.0006
STALK_CONTROLS_M = np.array(
    [[0.004, 0.004, 0.0], [0.030, 0.130, 0.004], [-0.022, 0.220, -0.008], [0.010, 0.306, 0.006]]
)
# Petals of each whorl, from the outside inwards: how many, elevation at the base and at the tip, length.
WHORLS = ((9, 34.0, -16.0, 0.034), (9, 48.0, 8.0, 0.033), (8, 62.0, 34.0, 0.031), (6, 74.0, 60.0, 0.028))
# Height on the stalk, azimuth and length of the leaves; the knots of a carnation carry two each.
LEAVES = ((0.178, 20, 0.085), (0.182, 200, 0.080), (0.226, 105, 0.070), (0.230, 285, 0.066), (0.264, 10, 0.044))


def carnation(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the carnation.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    rng = np.random.default_rng([seed, 1])
    line = bezier(STALK_CONTROLS_M, 240)
    stalk, calyx = _stalk(line), _calyx(line)
    leaves = [_leaf(line, plan, rng) for plan in LEAVES]
    petals = [_petal(calyx, whorl, k, rng) for whorl in WHORLS for k in range(whorl[0])]
    green = mottled("6d8f68", "a3bd92", wavelength_m=0.008, seed=seed + 2, stretch=(1, 5, 1))
    return assemble(
        [
            Part("vase", "ceramic", [_vase()], 0.0027, _porcelain(seed + 1), gloss=0.10, thickness_m=WALL_M),
            Part(
                "stem", "herbaceous_stem", [stalk, calyx], 0.0010, green, precedence=1, gloss=0.04,
                area_m2=stalk.area_m2, thickness_m=2 * STALK_RADIUS_M,
            ),
            Part(
                "leaves", "leaf_blade", leaves, 0.0013,
                mottled("648a63", "98b68c", wavelength_m=0.007, seed=seed + 3, stretch=(3, 3, 3)),
                transmission=0.25, gloss=0.05, area_m2=sum(leaf.area_m2 for leaf in leaves), thickness_m=LEAF_M,
            ),
            Part(
                "petals", "petal", petals, 0.0013, _crimson(seed + 4),
                transmission=0.40, gloss=0.03, area_m2=sum(petal.area_m2 for petal in petals), thickness_m=PETAL_M,
            ),
        ],
        metres_per_unit=0.36, motion="sway", held=["vase"], seed=seed, light=light,
    )  # fmt: skip


def _vase() -> Revolved:
    """A bottle vase; its neck is just wide enough for the stalk, which leans on it."""
    corners = np.array(
        [
            [0, 0], [0.030, 0], [0.048, 0.040], [0.036, 0.085], [0.0125, 0.120], [0.0130, 0.140], [0.0190, 0.152],
            [0.0160, 0.152], [0.0080, 0.140], [0.0075, 0.120], [0.031, 0.083], [0.043, 0.040], [0.028, 0.006],
            [0, 0.006],
        ]
    )  # fmt: skip
    rounding = np.array([0, 0.004, 0.022, 0.020, 0.013, 0.006, 0.0014, 0.0014, 0.006, 0.013, 0.020, 0.022, 0.004, 0])
    return Revolved(rounded_profile(corners, rounding, steps=8), np.zeros(3), np.eye(3))


def _stalk(line: Array) -> Tube:
    """Round, thicker at its knots."""
    knots = np.array([0.05, 0.115, 0.180, 0.228, 0.264])
    swelling = np.exp(-(((line[:, 1:2] - knots) / 0.0030) ** 2)).sum(1)
    return Tube(line, STALK_RADIUS_M * (1 + 0.35 * swelling))


def _calyx(line: Array) -> Revolved:
    """The green cup that holds the petals, on the end of the stalk."""
    axis = (line[-1] - line[-4]) / np.linalg.norm(line[-1] - line[-4])
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    rotation = np.stack([side, axis, np.cross(side, axis)], 1)
    corners = np.array([[0, -0.003], [0.0030, -0.003], [0.0078, 0.006], [0.0085, 0.020], [0.0070, 0.0215], [0, 0.0200]])
    return Revolved(rounded_profile(corners, np.array([0, 0.001, 0.004, 0.001, 0.001, 0])), line[-1], rotation)


def _leaf(line: Array, plan: tuple[float, float, float], rng: np.random.Generator) -> Blade:
    """A narrow leaf that arches away from its knot."""
    height, azimuth_deg, length = plan
    azimuth = np.deg2rad(azimuth_deg)
    return Blade(
        origin=line[int(np.argmin(np.abs(line[:, 1] - height)))],
        outward=np.array([np.cos(azimuth), 0.0, np.sin(azimuth)]),
        up=np.array([0.0, 1.0, 0.0]),
        length_m=length,
        half_width_m=0.0042,
        thickness_m=LEAF_M,
        base_power=0.20,
        tip_power=0.75,
        base_half_width_m=0.0022,
        elevation_start_deg=68.0,
        elevation_end_deg=-26.0 + 14 * rng.uniform(-1, 1),
        roll_end_deg=14 * rng.uniform(-1, 1),
        fold=0.35,
    )


def _petal(calyx: Revolved, whorl: tuple[int, float, float, float], index: int, rng: np.random.Generator) -> Blade:
    """One petal: a narrow claw in the calyx, a broad frilled end."""
    count, start_deg, end_deg, length = whorl
    turn = 2 * np.pi * (index + 0.35 * rng.uniform(-1, 1)) / count + start_deg
    x, axis, z = calyx.rotation.T
    outward = np.cos(turn) * x + np.sin(turn) * z
    lift_deg = 7 * rng.uniform(-1, 1)
    return Blade(
        origin=calyx.origin + 0.0185 * axis + 0.0045 * np.cos(np.deg2rad(start_deg)) * outward,
        outward=outward,
        up=axis,
        length_m=length * (1 + 0.08 * rng.uniform(-1, 1)),
        half_width_m=0.0135,
        thickness_m=PETAL_M,
        base_power=0.95,
        tip_power=0.24,
        base_half_width_m=0.0018,
        elevation_start_deg=start_deg + lift_deg,
        elevation_end_deg=end_deg + 2 * lift_deg,
        roll_end_deg=24 * rng.uniform(-1, 1),
        cup_per_m=18.0,
        ripple=0.20,
        ripple_waves=3.2,
        ripple_phase=float(rng.uniform(0, 2 * np.pi)),
    )


def _porcelain(seed: int) -> Paint:
    """White glaze with a painted cobalt band of leaves round the belly."""
    glaze = mottled("d5dce2", "f6f7f6", wavelength_m=0.020, seed=seed)
    cobalt = mottled("203c82", "4767ab", wavelength_m=0.006, seed=seed + 1)

    def paint(patch: Patch) -> Array:
        x, height, z = patch.points.T
        turn = np.arctan2(z, x)
        wave = 0.040 + 0.006 * np.sin(6 * turn)
        leaf = np.cos(12 * turn + np.sign(height - wave) * 1.2 + 260 * (height - wave))
        vine = (np.abs(height - wave) < 0.0014) | ((leaf > 0.55) & (np.abs(height - wave) < 0.0095))
        bands = (np.abs(height - 0.066) < 0.0016) | (np.abs(height - 0.012) < 0.0016)
        painted = (vine | bands) & ((patch.normals[:, [0, 2]] * np.stack([x, z], 1)).sum(1) > 0)
        return mix(glaze(patch), cobalt(patch), painted.astype(float))

    return paint


def _crimson(seed: int) -> Paint:
    """Deep red in the throat, rose towards the frill, with a pale hem."""

    def paint(patch: Patch) -> Array:
        u, v, _ = patch.coords.T
        wobble = fractal_noise(patch.points, 0.012, seed=seed)
        color = mix(srgb("7d0c22"), srgb("d8324f"), 1.25 * u - 0.15 + 0.2 * wobble)
        vein = value_noise(np.stack([0.4 * u, v], 1), 0.12, seed=seed + 1)
        color = color * (1 + 0.12 * vein)[:, None]
        hem = np.maximum(u, 0.97 * np.abs(v) * (u > 0.4))
        return mix(color, srgb("f7b7bf"), 0.75 * np.clip((hem - 0.93) / 0.07, 0, 1))

    return paint
