"""Paints: functions that give the samples of a part their albedo, built on the noise of ``texture``."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phys4dgen.zoo.assembly import Paint
from phys4dgen.zoo.patch import Array, Patch
from phys4dgen.zoo.texture import fractal_noise, mix, srgb, value_noise

__all__ = ["mottled", "with_speckles", "wood_grain"]


def mottled(
    dark: str, pale: str, *, wavelength_m: float, seed: int, stretch: ArrayLike = (1, 1, 1), contrast: float = 0.75
) -> Paint:
    """Soft patches between two colours.

    Args:
        dark: hexadecimal sRGB.
        pale: hexadecimal sRGB.
        wavelength_m: of the largest patches.
        seed: of the noise.
        stretch: length of the patches along each axis relative to the wavelength.
        contrast: 1 uses the two colours in full.
    """
    scale = 1 / np.asarray(stretch, np.float64)

    def paint(patch: Patch) -> Array:
        noise = fractal_noise(patch.points * scale, wavelength_m, seed=seed, octaves=4)
        return mix(srgb(dark), srgb(pale), 0.5 + contrast * noise)

    return paint


def with_speckles(base: Paint, color: str, *, wavelength_m: float, share: float, seed: int) -> Paint:
    """Small spots on another paint; ``share`` of the surface is about the part that they cover."""

    def paint(patch: Patch) -> Array:
        noise = value_noise(patch.points, wavelength_m, seed=seed)
        rank = np.argsort(np.argsort(noise)) / max(len(noise), 1)
        return mix(base(patch), srgb(color), np.clip((rank - 1 + share) / (0.4 * share), 0, 1))

    return paint


def wood_grain(dark: str, pale: str, *, ring_m: float, seed: int, axis: int = 1, centre: ArrayLike = (0, 0)) -> Paint:
    """Growth rings about a pith that runs along ``axis``, cut by the surface, with fine pores.

    Args:
        dark: hexadecimal sRGB of the late wood.
        pale: hexadecimal sRGB of the early wood.
        ring_m: distance between rings.
        seed: of the irregularities.
        axis: 0, 1 or 2.
        centre: where the pith crosses the other two axes, metres, shape [2].
    """
    across = [k for k in range(3) if k != axis]
    squeeze = np.where(np.arange(3) == axis, 0.06, 1.0)

    def paint(patch: Patch) -> Array:
        wander = fractal_noise(patch.points * np.where(np.arange(3) == axis, 0.25, 1.0), 12 * ring_m, seed=seed)
        distance = np.linalg.norm(patch.points[:, across] - np.asarray(centre), axis=1) + 2.5 * ring_m * wander
        phase = np.mod(distance / ring_m, 1.0)
        late = phase**3 * np.clip((1 - phase) / 0.12, 0, 1)
        fibre = fractal_noise(patch.points * squeeze, 0.5 * ring_m, seed=seed + 5)
        return mix(srgb(pale), srgb(dark), 0.12 + 0.85 * late + 0.35 * fibre)

    return paint
