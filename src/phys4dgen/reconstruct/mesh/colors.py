"""The colour of a mesh at points of its surface."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.reconstruct.mesh.surface import Surface

__all__ = ["colors_at", "linear_to_srgb", "srgb_to_linear"]

_LIGHT = np.array([0.35, 0.75, 0.55])
"""Towards the lamp that shades surfaces of one colour; from above whether y or z is up."""
_SHADOW = 0.25
"""Share of the light that reaches the side turned away."""


def colors_at(
    surface: Surface,
    faces: NDArray[np.int64],
    weights: NDArray[np.float64],
    *,
    normals: NDArray[np.float64],
    spacing: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Colour and opacity of points.

    A texture is averaged over the area that a point stands for. A surface of one colour throughout is shaded, so that
    its form can be seen.

    Args:
        surface: of one material.
        faces: triangle of each point, shape [N].
        weights: barycentric coordinates, shape [N, 3].
        normals: unit outward normals, shape [N, 3].
        spacing: root of the area per point, file units.

    Returns:
        sRGB [N, 3] and opacity [N], both in [0, 1].
    """
    rgba = np.einsum("nk,nkc->nc", weights, surface.corner_rgba[faces])
    if surface.texture is not None and surface.uv is not None:
        seen = _textured(surface.texture, surface.uv, surface.triangles, faces, weights, spacing)
        rgba = rgba * np.concatenate([srgb_to_linear(seen[:, :3]), seen[:, 3:]], 1)
    if surface.is_plain:
        half_lambert = 0.5 + 0.5 * normals @ (_LIGHT / np.linalg.norm(_LIGHT))
        rgba[:, :3] *= (_SHADOW + (1 - _SHADOW) * half_lambert)[:, None]
    alpha = np.clip(rgba[:, 3], 0, 1)
    if surface.alpha_cutoff is not None:
        alpha = np.where(alpha >= surface.alpha_cutoff, 1.0, 0.0)
    return linear_to_srgb(np.clip(rgba[:, :3], 0, 1)).astype(np.float32), alpha.astype(np.float32)


def srgb_to_linear(rgb: NDArray[Any]) -> NDArray[Any]:
    """Light of gamma-encoded sRGB in [0, 1]; IEC 61966-2-1."""
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(rgb: NDArray[Any]) -> NDArray[Any]:
    """Gamma-encoded sRGB of light in [0, 1]."""
    return np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * np.maximum(rgb, 1e-9) ** (1 / 2.4) - 0.055)


def _textured(
    texture: NDArray[np.float32],
    uv: NDArray[Any],
    triangles: NDArray[np.float64],
    faces: NDArray[np.int64],
    weights: NDArray[np.float64],
    spacing: float,
) -> NDArray[np.float32]:
    """SRGB and opacity [N, 4], each from the level of the pyramid whose texels are as large as a point's share."""
    height, width = texture.shape[:2]
    at = np.einsum("nk,nkc->nc", weights, uv[faces])
    edges, sides = uv[faces, 1:] - uv[faces, :1], triangles[faces, 1:] - triangles[faces, :1]
    texels = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]) * width * height
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    per_point = texels / np.maximum(area, 1e-300) * spacing**2
    levels = _pyramid(texture)
    level = np.clip(np.rint(0.5 * np.log2(np.maximum(per_point, 1))), 0, len(levels) - 1).astype(np.int64)
    seen = np.zeros((len(faces), 4), np.float32)
    for index, picture in enumerate(levels):
        chosen = level == index
        seen[chosen] = _bilinear(picture, at[chosen])
    opacity = np.maximum(seen[:, 3:], 1e-6)
    return np.concatenate([np.clip(seen[:, :3] / opacity, 0, 1), seen[:, 3:]], 1).astype(np.float32)


def _pyramid(texture: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """The texture, premultiplied, at full, half, quarter ... size; odd sides drop their last row or column."""
    levels = [np.concatenate([texture[..., :3] * texture[..., 3:], texture[..., 3:]], -1)]
    for _ in range(int(math.log2(max(min(texture.shape[:2]), 1)))):
        height, width = (side // 2 * 2 for side in levels[-1].shape[:2])
        quarters = levels[-1][:height, :width].reshape(height // 2, 2, width // 2, 2, 4)
        levels.append(quarters.mean((1, 3)))
    return levels


def _bilinear(picture: NDArray[np.float32], uv: NDArray[np.float64]) -> NDArray[np.float32]:
    """Values [N, C] at texture coordinates [N, 2] (origin at the lower left); the texture repeats."""
    height, width = picture.shape[:2]
    x, y = (uv[:, 0] % 1) * width - 0.5, (1 - uv[:, 1] % 1) * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, down = (x - column)[:, None], (y - row)[:, None]
    left_column, right_column = column % width, (column + 1) % width
    upper_row, lower_row = row % height, (row + 1) % height
    upper = picture[upper_row, left_column] * (1 - right) + picture[upper_row, right_column] * right
    lower = picture[lower_row, left_column] * (1 - right) + picture[lower_row, right_column] * right
    return (upper * (1 - down) + lower * down).astype(np.float32)
