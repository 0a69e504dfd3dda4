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

__all__ = ["carve"]

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
    alive = np.arange(len(points))
    for view, camera in enumerate(views.cameras):
        if len(alive) == 0:
            break
        mask = views.alpha[view] > _MASK_ALPHA
        # A pixel that shows nothing has no surface in front: its neighbours' depth decides inside the dilated rim.
        depth = minimum_filter(np.where(mask, views.depth[view], np.inf), 3)
        mask = binary_dilation(mask, np.ones((3, 3), bool))
        pixels, z = camera.project(points[alive])
        u = np.floor(pixels[:, 0]).astype(np.int64)
        v = np.floor(pixels[:, 1]).astype(np.int64)
        in_picture = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height) & (z > 0)
        u = np.clip(u, 0, camera.width - 1)
        v = np.clip(v, 0, camera.height - 1)
        inside = mask[v, u] & (z >= depth[v, u] - 0.5 * grid.side)
        alive = alive[inside | ~in_picture]
    solid = np.zeros(len(points), bool)
    solid[alive] = True
    return solid.reshape(grid.shape)
