"""Solid voxels by space carving: what no view can see through or past.

Paper: Sec. 3.3 keeps a sample when every view projects it inside the foreground mask and behind the rendered depth.
Made robust as PHYSICS.md 4.2 and 4.5b measured: the mask is dilated by one pixel (with the depth's minimum over
3 x 3 there) and the depth test has a tolerance of half a voxel, so that many views do not eat the silhouette away.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, minimum_filter

from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import Views

__all__ = ["carve", "solid_share"]

_MASK_ALPHA = 0.5


def carve(grid: VoxelGrid, views: Views, rotation: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Voxels that lie inside the mask and behind the depth of every view that sees them.

    Args:
        grid: voxels in upright axes.
        views: rendered views with alpha and median depth.
        rotation: input axes -> upright axes, [3, 3].

    Returns:
        Boolean array of ``grid.shape``.
    """
    points = (grid.all_centers() @ rotation).astype(np.float32)  # upright -> input axes
    return _behind_all(points, views, tolerance=0.5 * grid.side).reshape(grid.shape)


def solid_share(
    grid: VoxelGrid, index: NDArray[np.int64], views: Views, rotation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Share of each voxel's volume that lies behind the surface, from 3 x 3 x 3 points without tolerance, [V].

    The tolerance that keeps carving robust makes a body half a voxel fatter; this is the correction for its volume.
    """
    steps = (np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), -1).reshape(-1, 3)) / 3
    points = grid.centers(index)[:, None] + steps * grid.side
    inside = _behind_all((points.reshape(-1, 3) @ rotation).astype(np.float32), views, tolerance=0.0)
    return inside.reshape(len(index), -1).mean(1)


def _behind_all(points: NDArray[np.float32], views: Views, *, tolerance: float) -> NDArray[np.bool_]:
    """Points [P, 3] (input axes) that no view sees through or in front of the surface."""
    alive = np.arange(len(points))
    for view, camera in enumerate(views.cameras):
        if len(alive) == 0:
            break
        mask = views.alpha[view] > _MASK_ALPHA
        # A pixel that shows nothing has no surface in front: its neighbours' depth decides inside the dilated rim.
        depth = minimum_filter(np.where(mask, views.depth[view], np.inf), 3)
        mask = np.asarray(binary_dilation(mask, np.ones((3, 3), bool)), bool)
        pixels, z = camera.project(points[alive])
        u = np.floor(pixels[:, 0]).astype(np.int64)
        v = np.floor(pixels[:, 1]).astype(np.int64)
        in_picture = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height) & (z > 0)
        u = np.clip(u, 0, camera.width - 1)
        v = np.clip(v, 0, camera.height - 1)
        inside = mask[v, u] & (z >= depth[v, u] - tolerance)
        alive = alive[inside | ~in_picture]
    solid = np.zeros(len(points), bool)
    solid[alive] = True
    return solid
