"""The solid voxels of an object: what its maker knows, or what carving or the winding number fills.

To the last two comes what is dense: thin things that both lose.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from phys4dgen.interior.carve import DepthLimits, InsideTest, carve, solid_share
from phys4dgen.interior.density import accumulated_opacity, density_threshold
from phys4dgen.interior.normals import oriented_points
from phys4dgen.interior.open_bottom import views_that_judge
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.interior.winding import winding_number
from phys4dgen.types import Gaussians, Views

__all__ = ["Method", "SolidReading", "find_solid", "known_solid"]

Method = Literal["ipsd", "winding", "both", "none"]

_LEAST_SHARE = 0.15
"""Of a voxel that must lie inside a known solid: less is not worth a particle."""


@dataclass(frozen=True, eq=False)
class SolidReading:
    """Which voxels are solid.

    Attributes:
        solid: filled or dense voxels.
        inside: sharp test of points, for shares of voxels.
        agreement: IoU of the carved solid with the wound one if that was made, else with the dense one; NaN where the
            solid was known.
        density_threshold: that was used on the accumulated opacity; NaN likewise.
        backend: what told the inside, for the report.
    """

    solid: NDArray[np.bool_]
    inside: InsideTest
    agreement: float = field(default=np.nan)
    density_threshold: float = field(default=np.nan)
    backend: str = "exact, known from the reconstruction"


def known_solid(
    gaussians: Gaussians, inside: InsideTest, *, grid: VoxelGrid, rotation: NDArray[np.float64]
) -> SolidReading:
    """The voxels of an object whose inside is known exactly.

    Args:
        gaussians: the object's surface.
        inside: whether points lie inside.
        grid: voxels in upright axes.
        rotation: input axes -> upright axes, [3, 3].
    """
    solid = inside(grid.all_centers() @ rotation).reshape(grid.shape)
    skin = np.zeros(grid.shape, bool)
    means = gaussians.means.astype(np.float64) @ rotation.T
    skin[tuple(grid.index_of(means[grid.contains(means)]).T)] = True
    skin = np.asarray(binary_dilation(skin, np.ones((3, 3, 3), bool)), bool)
    solid[skin] = solid_share(grid, np.argwhere(skin), inside, rotation) >= _LEAST_SHARE
    return SolidReading(solid, inside)


def find_solid(
    gaussians: Gaussians, views: Views, *, grid: VoxelGrid, rotation: NDArray[np.float64], method: Method
) -> SolidReading:
    """Fill the object by the chosen method, and add what is dense.

    Args:
        gaussians: the object.
        views: rendered views with alpha and median depth.
        grid: voxels in upright axes.
        rotation: input axes -> upright axes, [3, 3].
        method: see ``discover_interior``.
    """
    judges = views_that_judge(gaussians, views, rotation=rotation, tolerance=grid.side)
    sharp = DepthLimits(views, dilate=False, chosen=judges)
    carved = carve(grid, DepthLimits(views, dilate=True, chosen=judges), rotation)
    threshold = density_threshold(gaussians, grid, rotation)
    dense = accumulated_opacity(gaussians, grid, rotation) > threshold
    if not judges.all():  # nothing that is left looks under the ground
        ground = gaussians.robust_bounds(rotation=rotation)[0][2]
        carved[:, :, grid.lower[2] + (np.arange(grid.shape[2]) + 0.5) * grid.side < ground] = False
    if method in ("ipsd", "none"):
        agreement = _overlap(carved, dense)
        return SolidReading(carved | dense, sharp.contains, agreement, threshold, "carving and density")
    points = oriented_points(gaussians, views, rotation=rotation, tolerance=grid.side)
    wound = winding_number(points, grid) > 0.5
    filled = wound if method == "winding" else carved & wound
    backend = "winding number and density" if method == "winding" else "carving, winding number and density"
    return SolidReading(filled | dense, sharp.contains, _overlap(carved, wound), threshold, backend)


def _overlap(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """Intersection over union."""
    return float((one & other).sum() / max((one | other).sum(), 1))
