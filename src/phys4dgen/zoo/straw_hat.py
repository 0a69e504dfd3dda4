"""A straw hat, 0.38 m wide: plaited straw sewn in a spiral, with a blue ribbon."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Paint, Part, assemble
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.solids import Lifted, Revolved, rounded_profile
from phys4dgen.zoo.texture import fractal_noise, mix, srgb, value_noise
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["straw_hat"]

STRAW_M = 0.0030
RIBBON_M = 0.0016
BRAID_M = 0.0075
"""Width of the plait that is sewn into the hat."""
LIFT_M = 0.0138
"""Raises the hat so far that the lowest places of its brim touch the ground."""


def straw_hat(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the hat.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    straw, ribbon = (Revolved(outline, np.zeros(3), np.eye(3)) for outline in (_straw_outline(), _ribbon_outline()))
    return assemble(
        [
            Part(
                "straw", "leaf_blade", [Lifted(straw, _wave, 0.02)], 0.0029, _plaited(seed + 1),
                transmission=0.12, area_m2=straw.volume_m3 / STRAW_M, thickness_m=STRAW_M,
            ),
            Part(
                "ribbon", "cotton_fabric", [Lifted(ribbon, _wave, 0.02)], 0.0024, _grosgrain(seed + 2),
                precedence=1, area_m2=ribbon.volume_m3 / RIBBON_M, thickness_m=RIBBON_M,
            ),
        ],
        metres_per_unit=0.38, motion="drop", seed=seed, light=light,
    )  # fmt: skip


def _wave(x: Array, z: Array) -> Array:
    """The brim dips in front and behind and rises at the sides; the crown stays as it was blocked."""
    turn = np.arctan2(z, x)
    beyond = np.maximum(np.hypot(x, z) - 0.098, 0) / 0.092
    return LIFT_M + 0.013 * beyond**1.5 * (np.cos(2 * turn) + 0.25 * np.cos(3 * turn + 1.0))


def _straw_outline() -> Array:
    """One thickness of straw from the edge of the brim to the top of the crown, and back below."""
    top = np.array([[0.190, 0.003], [0.108, 0.004], [0.094, 0.012], [0.084, 0.090], [0.060, 0.1060], [0, 0.1090]])
    line = rounded_profile(top, np.array([0, 0.008, 0.008, 0.014, 0.014, 0]), steps=9)
    run = np.gradient(line, axis=0)
    run /= np.linalg.norm(run, axis=1, keepdims=True)
    outward = np.stack([-run[:, 1], run[:, 0]], 1)
    outward[-1] = [0, -1] if outward[-1, 1] < 0 else [0, 1]
    half = STRAW_M / 2 * np.where(outward[:, 1:] < 0, -1, 1)
    upper, lower = line + half * outward, line - half * outward
    upper[-1, 0] = lower[-1, 0] = 0
    return np.vstack([lower[::-1], upper])


def _ribbon_outline() -> Array:
    """A band round the foot of the crown."""
    foot, head = np.array([0.0953, 0.020]), np.array([0.0918, 0.046])
    out = RIBBON_M * np.array([0.99, 0.13])
    return np.array([foot, foot + out, head + out, head])


def _plaited(seed: int) -> Paint:
    """Rows of plait, each woven of slanting straws."""

    def paint(patch: Patch) -> Array:
        along = patch.coords[:, 0]
        turn = np.arctan2(patch.points[:, 2], patch.points[:, 0])
        girth = np.maximum(np.hypot(patch.points[:, 0], patch.points[:, 2]), 0.01)
        row = np.mod(along / BRAID_M, 1.0)
        seam = np.exp(-((np.minimum(row, 1 - row) / 0.13) ** 2))
        slant = np.where(row < 0.5, 1, -1) * along / 0.006
        straws = np.cos(2 * np.pi * (np.round(2 * np.pi * girth / 0.011) / (2 * np.pi) * turn + slant))
        age = fractal_noise(patch.points, 0.05, seed=seed)
        color = mix(srgb("c89a4e"), srgb("f0d590"), 0.55 + 0.30 * straws + 0.35 * age)
        return color * (1 - 0.32 * seam + 0.06 * value_noise(patch.points, 0.006, seed=seed + 1))[:, None]

    return paint


def _grosgrain(seed: int) -> Paint:
    """Navy ribbon with fine ribs and a lighter edge."""

    def paint(patch: Patch) -> Array:
        turn = np.arctan2(patch.points[:, 2], patch.points[:, 0])
        ribs = np.cos(130 * turn) + 0.8 * fractal_noise(patch.points, 0.02, seed=seed)
        return mix(srgb("1b2c57"), srgb("3a5596"), 0.45 + 0.3 * ribs)

    return paint
