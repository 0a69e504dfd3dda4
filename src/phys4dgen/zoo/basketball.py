"""A basketball of size 7: a rubber shell of 4.5 mm with pebbled panels and black channels, full of air."""

from __future__ import annotations

import numpy as np

from phys4dgen.zoo.assembly import Part, assemble
from phys4dgen.zoo.forms import ball, hollow, shaped, turned_deg
from phys4dgen.zoo.paints import mottled
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.texture import mix, srgb, value_noise
from phys4dgen.zoo.zoo_object import ZooObject

__all__ = ["basketball"]

RADIUS_M = 0.1195
WALL_M = 0.0045
CHANNEL_HALF_M = 0.0054
CENTRE_M = np.array([0.0, RADIUS_M, 0.0])
POSE = turned_deg(x=-28, y=20, z=18)


def basketball(*, seed: int = 0, light: str = "studio") -> ZooObject:
    """Build the basketball.

    Args:
        seed: of the small irregularities.
        light: a name in ``lights.LIGHTS``.
    """
    leather = mottled("b4521c", "dd7d38", wavelength_m=0.045, seed=seed + 1)

    def skin(patch: Patch) -> Array:
        pebbles = 1 + 0.07 * value_noise(patch.points, 0.0060, seed=seed + 2)
        return mix(leather(patch) * pebbles[:, None], srgb("1d1a19"), 1.15 * _channel(patch.points))

    shell = hollow(shaped(ball(RADIUS_M, CENTRE_M), lambda p: -0.0016 * _channel(p), reach_m=0.0), WALL_M)
    return assemble(
        [Part("ball", "natural_rubber", [shell], 0.0024, skin, gloss=0.05, thickness_m=WALL_M, filling="pu_foam")],
        metres_per_unit=0.24, motion="drop", seed=seed, light=light,
    )  # fmt: skip


def _channel(points: Array) -> Array:
    """1 in the middle of a channel, 0 on the panels, shape [N]: two great circles and two bowed loops."""
    local = (points - CENTRE_M) @ POSE
    x, y, z = (local / np.maximum(np.linalg.norm(local, axis=1, keepdims=True), 1e-9)).T
    bow = np.abs(x) - 0.50 - 0.16 * z * z
    steepness = np.sqrt(np.maximum(1 - x * x, 0.05) + (0.32 * z) ** 2)
    gap = RADIUS_M * np.minimum(np.minimum(np.abs(x), np.abs(y)), np.abs(bow) / steepness)
    return np.maximum(1 - (gap / CHANNEL_HALF_M) ** 2, 0)
