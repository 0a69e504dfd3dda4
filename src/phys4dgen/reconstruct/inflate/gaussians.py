"""Surface points -> flat Gaussians that lie in the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen.reconstruct.inflate.perspective import Perspective
from phys4dgen.reconstruct.inflate.surface import Kind, SurfacePoints
from phys4dgen.types import Gaussians

__all__ = ["oriented_gaussians"]

WIDTH = 0.62
"""Standard deviation in the surface, of the spacing of points: neighbours overlap to an even, opaque wall."""
FLATNESS = 0.18
"""Standard deviation across the surface, of the one in it."""
OPACITY = 0.98


def oriented_gaussians(points: SurfacePoints, perspective: Perspective) -> tuple[Gaussians, NDArray[np.float64]]:
    """Grey Gaussians in the surface, world units, and their outward unit normals [M, 3]."""
    normal = points.normal
    across = np.cross(normal, [0.0, 0.0, 1.0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 1e-4, across / np.maximum(length, 1e-9), [1.0, 0.0, 0.0])
    steepest = np.cross(across, normal)
    # One Gaussian per pixel of a slope: stretched along it.
    stretch = np.where(points.kind == Kind.FRONT, 1 / np.clip(np.abs(normal[:, 2]), 0.5, 1), 1)
    along = perspective.tangents_to_world(points.position, steepest)
    aside = perspective.tangents_to_world(points.position, across)
    along_length = np.linalg.norm(along, axis=1)
    outward = np.cross(aside, along)  # the flip of the row axis turns the product round
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    first = along / along_length[:, None]
    second = np.cross(outward, first)
    width = WIDTH * points.spacing
    scales = np.stack(
        [
            width * stretch * along_length,
            width * np.linalg.norm(aside, axis=1),
            FLATNESS * width * perspective.unit,
        ],
        1,
    )
    axes = np.stack([first, second, outward], -1)
    count = len(normal)
    return (
        Gaussians(
            means=perspective.to_world(points.position).astype(np.float32),
            quats_wxyz=Rotation.from_matrix(axes).as_quat(scalar_first=True).astype(np.float32),
            scales=np.maximum(scales, 1e-6).astype(np.float32),
            opacities=np.full(count, OPACITY, np.float32),
            sh=np.zeros((count, 1, 3), np.float32),
        ),
        outward,
    )
