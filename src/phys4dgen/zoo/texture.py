"""Procedural albedo: lattice noise, veins, grain and speckle, all in sRGB colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.zoo.patch import Array

__all__ = [
    "fractal_noise",
    "heart",
    "leaf",
    "mix",
    "petal",
    "potting_soil",
    "srgb",
    "stem",
    "terracotta",
    "value_noise",
]


def srgb(hex_color: str) -> Array:
    """``"c8714e"`` -> RGB in [0, 1], shape [3]."""
    return np.array([int(hex_color[k : k + 2], 16) for k in (0, 2, 4)]) / 255.0


def mix(first: Array, second: Array, share: NDArray[np.floating]) -> Array:
    """Blend of two colours ([3] or [N, 3]), ``share`` [N] of the second; shape [N, 3]."""
    s = np.clip(share, 0, 1)[:, None]
    return first * (1 - s) + second * s


def value_noise(points: Array, wavelength: float, *, seed: int) -> Array:
    """Smooth noise in [-1, 1] with one random value per cell corner; points [N, D], result [N]."""
    q = points / wavelength
    base = np.floor(q)
    t = q - base
    t = t * t * (3 - 2 * t)
    dims = points.shape[1]
    primes = np.array([0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D], np.uint64)[:dims]
    keys = (base.astype(np.int64).astype(np.uint64) * primes).sum(1, dtype=np.uint64)
    total = np.zeros(len(points))
    for corner in range(2**dims):
        bits = [(corner >> d) & 1 for d in range(dims)]
        weight = np.ones(len(points))
        for d, bit in enumerate(bits):
            weight *= t[:, d] if bit else 1 - t[:, d]
        total += weight * _hashed(keys + (np.array(bits, np.uint64) * primes).sum(dtype=np.uint64), seed)
    return total


def fractal_noise(points: Array, wavelength: float, *, seed: int, octaves: int = 3) -> Array:
    """Sum of octaves of ``value_noise``, each half as long and half as strong; roughly in [-1, 1], shape [N]."""
    total = np.zeros(len(points))
    for octave in range(octaves):
        total += 0.5**octave * value_noise(points, wavelength * 0.5**octave, seed=seed + octave)
    return total / (2 - 0.5 ** (octaves - 1))


def terracotta(points: Array, *, seed: int) -> Array:
    """Fired clay: mottled, with faint turning marks and a pale bloom of minerals towards the foot; [N, 3]."""
    mottle = fractal_noise(points, 0.022, seed=seed, octaves=4)
    turning = value_noise(points * np.array([0.12, 1.0, 0.12]), 0.0028, seed=seed + 10)
    color = mix(srgb("c0623d"), srgb("d58a62"), 0.5 + 0.6 * mottle + 0.22 * turning)
    bloom = fractal_noise(points * np.array([1.0, 0.6, 1.0]), 0.030, seed=seed + 20, octaves=4)
    low = np.clip(1 - points[:, 1] / 0.075, 0, 1)
    color = mix(color, srgb("dcb59c"), 0.9 * np.clip(bloom + 0.75 * low - 0.45, 0, 0.6))
    speck = value_noise(points, 0.0021, seed=seed + 30)
    return color * (1 + 0.05 * turning + 0.06 * speck)[:, None]


def potting_soil(points: Array, *, grain: Array, seed: int) -> Array:
    """Dark crumbs with chips of bark and white perlite; ``grain`` in [-1, 1] lightens each sample by itself; [N, 3]."""
    crumb = fractal_noise(points, 0.0055, seed=seed, octaves=3)
    color = mix(srgb("2b1d14"), srgb("5d4331"), 0.45 + 0.9 * crumb)
    chip = value_noise(points * np.array([1.0, 1.0, 0.45]), 0.0042, seed=seed + 10)
    color = mix(color, srgb("8a6644"), 3.0 * np.clip(chip - 0.55, 0, 0.3))
    color = color * (1 + 0.28 * grain)[:, None]
    perlite = value_noise(points, 0.0034, seed=seed + 20)
    return mix(color, srgb("d9d2c6"), 7.0 * np.clip(perlite - 0.76, 0, 0.14))


def stem(points: Array, *, low_m: float, high_m: float, seed: int) -> Array:
    """Green stalk, a little red-brown at the foot and fresher towards the top; [N, 3]."""
    rise = (points[:, 1] - low_m) / (high_m - low_m)
    color = mix(srgb("6f8a3f"), srgb("8fb455"), rise)
    color = mix(color, srgb("7d6a3c"), 0.7 * np.exp(-np.maximum(rise, 0) / 0.10))
    streak = value_noise(points * np.array([1.0, 0.12, 1.0]), 0.0022, seed=seed)
    return color * (1 + 0.09 * streak + 0.05 * fractal_noise(points, 0.012, seed=seed + 5))[:, None]


def leaf(coords: Array, *, length_to_width: float, youth: float, seed: int) -> Array:
    """Leaf blade with a pale midrib, arched side veins and mottled fields between them; [N, 3].

    Args:
        coords: (u along the midrib, v in [-1, 1] across, face: -1 is the paler lower one), shape [N, 3].
        length_to_width: length over half width, turns the coordinates into true proportions.
        youth: 0 old and dark, 1 fresh.
        seed: of the mottling.
    """
    u, v, face = coords.T
    a = np.abs(v)
    field = np.stack([u * length_to_width, v], 1)
    dark, fresh = srgb("2c5a2b"), srgb("5d9440")
    color = mix(dark, fresh, 0.25 + 0.55 * youth + 0.22 * fractal_noise(field, 0.55, seed=seed) + 0.18 * u)
    # Side veins leave the midrib at about 50 degrees and bend towards the tip.
    phase = (u * length_to_width - 0.62 * a - 0.35 * a * a + 0.07 * np.sign(v)) / (length_to_width / 9.0)
    distance = np.abs(phase - np.round(phase))
    vein = np.exp(-((distance / 0.10) ** 2)) * np.clip(1.1 - a, 0, 1) * np.clip(a / 0.06, 0, 1)
    bulge = np.cos(2 * np.pi * phase) * np.clip(1.2 - a, 0, 1)
    color = color * (1 - 0.07 * bulge)[:, None]
    pale = srgb("9dbd73")
    color = mix(color, pale, 0.38 * vein)
    rib = np.exp(-((v / (0.045 + 0.05 * (1 - u))) ** 2)) * (1 - 0.5 * u)
    color = mix(color, pale, 0.72 * rib)
    color = mix(color, srgb("7f9c4a"), 0.35 * np.clip((a - 0.93) / 0.07, 0, 1))
    underside = mix(color, srgb("8fb072"), np.full(len(u), 0.42))
    return np.where(face[:, None] > 0, color, underside)


def petal(coords: Array, *, tint: float, seed: int) -> Array:
    """Petal: deep at the base, blushing towards a pale tip, fine lengthwise veins; [N, 3].

    Args:
        coords: (u along the petal, v in [-1, 1] across, face), shape [N, 3].
        tint: in [-1, 1], moves the whole petal towards pale or deep.
        seed: of the irregularities.
    """
    u, v, face = coords.T
    wobble = fractal_noise(np.stack([3 * u, 1.2 * v], 1), 0.8, seed=seed)
    along = np.clip(u + 0.07 * wobble + 0.05 * tint, 0, 1)
    color = mix(srgb("8e1145"), srgb("cf3f7a"), np.clip(along / 0.42, 0, 1) ** 0.9)
    color = mix(color, srgb("ee9dba"), np.clip((along - 0.34) / 0.66, 0, 1) ** 1.15)
    stripe = value_noise(np.stack([0.30 * u, v], 1), 0.17, seed=seed + 10)
    color = mix(color, srgb("9a1c55"), 0.55 * np.clip(stripe, 0, 1) * np.clip(1.25 - u, 0, 1))
    groove = np.cos(3 * np.pi * v) * np.clip(1.1 - np.abs(v), 0, 1)  # two shallow furrows along the petal
    color = color * (1 + 0.07 * groove)[:, None]
    color = mix(color, srgb("f3b9cc"), 0.35 * np.clip((np.abs(v) - 0.7) / 0.3, 0, 1) * np.clip(u / 0.4, 0, 1))
    underside = mix(color, srgb("e6a9bd"), np.full(len(u), 0.35))
    return np.where(face[:, None] > 0, color, underside)


def heart(local: Array, *, radius_m: float, seed: int) -> Array:
    """Florets in golden-angle spirals: warm yellow, browner in the middle; local points about the axis y, [N, 3]."""
    count = 150
    k = np.arange(count) + 0.5
    ring = radius_m * np.sqrt(k / count)
    angle = k * np.pi * (3 - 5**0.5)
    florets = np.stack([ring * np.cos(angle), ring * np.sin(angle)], 1)
    plane = local[:, [0, 2]]
    near = np.sqrt(((plane[:, None] - florets[None]) ** 2).sum(-1).min(1)) / (radius_m * np.sqrt(np.pi / count))
    out = np.linalg.norm(plane, axis=1) / radius_m
    color = mix(srgb("8a6a1c"), srgb("e9ac1f"), np.clip(0.05 + 1.5 * out, 0, 1))
    color = mix(color, srgb("c9711a"), np.clip(4 * (out - 0.8), 0, 0.6))
    return color * (1.16 - 0.75 * np.clip(near, 0, 1) ** 1.5 + 0.06 * value_noise(local, 0.0015, seed=seed))[:, None]


def _hashed(keys: NDArray[np.uint64], seed: int) -> Array:
    """A fixed pseudo-random value in [-1, 1] per key (integer mixing), shape [N]."""
    h = keys + np.uint64(seed % 2**32) * np.uint64(0x27D4EB2F)
    h ^= h >> np.uint64(15)
    h *= np.uint64(0x2C1B3C6D)
    h ^= h >> np.uint64(12)
    h *= np.uint64(0x297A2D39)
    h ^= h >> np.uint64(15)
    return (h & np.uint64(0xFFFFFF)).astype(np.float64) / float(0x7FFFFF) - 1.0
