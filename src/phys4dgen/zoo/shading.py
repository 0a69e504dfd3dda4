"""Baked light: a sky dome, a soft key light and a ground bounce, with occlusion from orthographic depth maps.

The colours of a captured splat hold the light of the room. The bundled object gets its light here: the irradiance of
every Gaussian is summed over directions, each tested against a depth map of all Gaussians seen from that direction
(shadow maps averaged over the sphere = ambient occlusion; over a narrow cone = a soft shadow).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.zoo.lights import Light
from phys4dgen.zoo.patch import Array

Array32 = NDArray[np.float32]

__all__ = ["bake_irradiance", "gloss_sh1", "linear_to_srgb", "srgb_to_linear"]


def srgb_to_linear(color: NDArray[np.floating]) -> Array:
    """Decode sRGB in [0, 1] to linear light (IEC 61966-2-1)."""
    c = np.asarray(color, np.float64)
    return np.where(c <= 0.04045, c / 12.92, ((np.maximum(c, 0.04045) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: NDArray[np.floating]) -> Array:
    """Encode linear light as sRGB; values above 0.8 roll off smoothly, so that highlights keep their hue."""
    x = np.maximum(np.asarray(light, np.float64), 0)
    knee = 0.8
    x = np.where(x > knee, knee + (1 - knee) * (1 - np.exp(-(x - knee) / (1 - knee))), x)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)


def bake_irradiance(points: Array, normals: Array, *, transmission: Array, light: Light, pixel_m: float) -> Array:
    """Irradiance / pi of every sample in linear light, shape [N, 3]; y is up and the ground is y = 0.

    Args:
        points: metres, shape [N, 3].
        normals: unit, shape [N, 3].
        transmission: share of the light on the far side that shines through (leaves, petals), shape [N].
        light: key light, sky and ground.
        pixel_m: pixel of the depth maps; wider than the spacing of the samples, so that surfaces are closed in them.
    """
    place, facing = points.astype(np.float32), normals.astype(np.float32)
    through = transmission.astype(np.float32)
    sky = _fibonacci_sphere(64)
    rise = sky[:, 1:2]
    radiance = light.horizon_color + (light.zenith_color - light.horizon_color) * np.clip(rise, 0, 1)
    radiance = radiance * (0.75 + 0.45 * np.clip(rise, 0, 1)) * 4 / len(sky)
    ground = rise[:, 0] < 0
    radiance[ground] = light.bounce_color * 4 / len(sky)
    key = _cone(light.key_direction, half_angle_deg=9.0, count=10)
    key_radiance = np.tile(light.key_color / len(key), (len(key), 1))

    open_ground = 1 - 0.85 * np.exp(
        -np.maximum(place[:, 1], 0) / (12.5 * pixel_m)
    )  # the object shades the ground beside it
    result = np.zeros((len(points), 3), np.float32)
    for direction, color, from_ground in zip(
        np.vstack([sky, key]).astype(np.float32),
        np.vstack([radiance, key_radiance]).astype(np.float32),
        np.concatenate([ground, np.zeros(len(key), bool)]),
        strict=True,
    ):
        cosine = facing @ direction
        received = np.maximum(cosine, 0) + through * np.maximum(-cosine, 0)
        received *= _lit(place, direction, cosine, pixel_m)
        if from_ground:
            received *= open_ground
        result += received[:, None] * color
    # Neighbours that face the same way share their light: removes the grain of the depth maps.
    outside = points + 2.5 * pixel_m * normals
    _, neighbours = KDTree(outside, balanced_tree=False, compact_nodes=False).query(outside, k=12)
    return result[neighbours].mean(1, dtype=np.float64)


def gloss_sh1(normals: Array, strength: Array, key_direction: Array) -> Array:
    """Degree-1 spherical harmonics that brighten a surface towards the mirror image of the key light.

    Args:
        normals: unit, shape [N, 3].
        strength: change of sRGB colour when looking straight along the mirror direction, shape [N].
        key_direction: unit vector towards the key light, shape [3].

    Returns:
        Coefficients of one channel (the same for all three), shape [N, 3], in the order y, z, x of 3DGS.
    """
    facing = normals @ key_direction
    mirror = 2 * facing[:, None] * normals - key_direction
    # 3DGS evaluates SH along camera -> Gaussian: the camera that sees the highlight looks along -mirror.
    gradient = -mirror * (strength * np.clip(facing, 0, 1))[:, None]
    return gradient[:, [1, 2, 0]] * np.array([-1.0, 1.0, -1.0]) / 0.4886025119029199


def _lit(points: Array32, direction: Array32, cosine: Array32, pixel_m: float) -> Array32:
    """1 where nothing lies between the sample and the light, 0 in shadow; shape [N]."""
    side = np.cross(direction, [0.0, 1.0, 0.0] if abs(direction[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    axes = np.stack([side / pixel_m, np.cross(direction, side) / pixel_m, -direction], 1)
    column, row, depth = (points @ axes.astype(np.float32)).T
    column, row = (column - column.min()).astype(np.int32), (row - row.min()).astype(np.int32)
    index = column * (row.max() + 1) + row
    nearest = np.full(int(index.max()) + 1, np.inf, np.float32)
    np.minimum.at(nearest, index, depth)
    slope = np.sqrt(np.maximum(1 - cosine * cosine, 0)) / np.maximum(np.abs(cosine), 0.25)
    return (depth < nearest[index] + pixel_m * (1.25 + slope)).astype(np.float32)


def _fibonacci_sphere(count: int) -> Array:
    """Evenly spread unit vectors, shape [count, 3]."""
    k = np.arange(count) + 0.5
    y = 1 - 2 * k / count
    angle = np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - y * y)
    return np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], 1)


def _cone(axis: Array, *, half_angle_deg: float, count: int) -> Array:
    """Unit vectors spread over a cone about ``axis``, shape [count, 3]."""
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    k = np.arange(count) + 0.5
    radius = np.tan(np.deg2rad(half_angle_deg)) * np.sqrt(k / count)
    angle = np.pi * (1 + 5**0.5) * k
    spread = axis + radius[:, None] * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(axis, side))
    return spread / np.linalg.norm(spread, axis=1, keepdims=True)
