"""Solid voxels by space carving: what no view can see through or past.

Paper: Sec. 3.3 keeps a sample when every view projects it inside the foreground mask and behind the rendered depth.
Made robust as PHYSICS.md 4.2 and 4.5b measured: the mask is dilated by one pixel (with the depth's minimum over
3 x 3 there) and the depth test has a tolerance of half a voxel, so that many views do not eat the silhouette away.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit
from numpy.typing import NDArray

from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.types import Views

__all__ = ["DepthLimits", "InsideTest", "carve", "solid_share"]

InsideTest = Callable[[NDArray[np.float64]], NDArray[np.bool_]]
"""Whether points [P, 3] (input axes) lie inside the object, [P]."""

_MASK_ALPHA = 0.5
_CHUNK = 65536


@njit(cache=True, nogil=True, error_model="numpy")
def _behind_all(points, viewmats, intrinsics, limits, tolerance, solid):  # pragma: no cover - compiled
    height, width = limits.shape[1:]
    for p in range(len(points)):
        x, y, z = points[p]
        solid[p] = True
        for k in range(len(limits)):
            m, i = viewmats[k], intrinsics[k]
            depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
            if depth <= 0:
                continue
            u = math.floor(i[0, 0] * (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / depth + i[0, 2])
            v = math.floor(i[1, 1] * (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / depth + i[1, 2])
            if 0 <= u < width and 0 <= v < height and depth < limits[k, v, u] - tolerance:
                solid[p] = False
                break


class DepthLimits:
    """For every view, the depth from which on a pixel may hold something solid; infinite where it shows nothing.

    Dilated by one pixel, the depth is the least over 3 x 3: a pixel that shows nothing has no surface in front, so
    its neighbours' depth decides inside the dilated rim. Sharp, single pixels through which one sees deeper than all
    around are closed: a noisy capture has many, and all views together would eat its surface away.
    """

    def __init__(self, views: Views, *, dilate: bool, chosen: NDArray[np.bool_] | None = None) -> None:
        """Prepare all views or the chosen ones, dilated by one pixel or sharp."""
        number = np.arange(len(views)) if chosen is None else np.flatnonzero(chosen)
        self._viewmats = np.stack([views.cameras[k].viewmat for k in number])
        self._intrinsics = np.stack([views.cameras[k].K for k in number])
        shown = (np.where(views.alpha[k] > _MASK_ALPHA, views.depth[k], np.float32(np.inf)) for k in number)
        self._limits = np.stack([_least(limit) if dilate else _greatest(_least(limit)) for limit in shown])

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Points [P, 3] (input axes) that no view sees through or in front of, to a pixel's accuracy, [P]."""
        return self.behind_all(points, tolerance=0.0)

    def behind_all(self, points: NDArray[np.float64], *, tolerance: float) -> NDArray[np.bool_]:
        """Points [P, 3] (input axes) that no view sees through or in front of the surface, [P].

        A view does not judge what lies outside of its picture or behind its camera.
        """
        solid = np.zeros(len(points), bool)
        with ThreadPoolExecutor() as pool:  # every point stands alone: the chunks do not change the result
            for chunk in range(0, len(points), _CHUNK):
                some = slice(chunk, chunk + _CHUNK)
                views = self._viewmats, self._intrinsics, self._limits
                pool.submit(_behind_all, points[some], *views, tolerance, solid[some])
        return solid


def _least(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """The least of each pixel's neighbourhood of 3 x 3; SciPy's filter of any size takes many times as long."""
    return _along_rows(np.minimum, _along_rows(np.minimum, image).T).T


def _greatest(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return _along_rows(np.maximum, _along_rows(np.maximum, image).T).T


def _along_rows(extreme: np.ufunc, image: NDArray[np.float32]) -> NDArray[np.float32]:
    """The extreme of each pixel and its neighbours above and below."""
    result = image.copy("K")  # a transposed image stays one: NumPy goes through memory in order
    extreme(result[1:], image[:-1], out=result[1:])
    extreme(result[:-1], image[1:], out=result[:-1])
    return result


def carve(grid: VoxelGrid, limits: DepthLimits, rotation: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Voxels that lie inside the mask and behind the depth of every view that sees them.

    Args:
        grid: voxels in upright axes.
        limits: of the rendered views, dilated.
        rotation: input axes -> upright axes, [3, 3].

    Returns:
        Boolean array of ``grid.shape``.
    """
    return limits.behind_all(grid.all_centers() @ rotation, tolerance=0.5 * grid.side).reshape(grid.shape)


def solid_share(
    grid: VoxelGrid, index: NDArray[np.int64], inside: InsideTest, rotation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Share of each voxel's volume that lies inside, from 3 x 3 x 3 points, [V].

    The tolerance that keeps carving robust makes a body half a voxel fatter; this is the correction for its volume.
    The test must be sharp: one pixel more on all sides is a quarter of a voxel, which a wall of a few voxels feels.
    """
    steps = (np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), -1).reshape(-1, 3)) / 3
    points = grid.centers(index)[:, None] + steps * grid.side
    return inside(points.reshape(-1, 3) @ rotation).reshape(len(index), len(steps)).mean(1)
