"""The solid voxels of an object: what carving or the winding number fills, and the thin things that both lose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from phys4dgen.interior.carve import DepthLimits, carve
from phys4dgen.interior.density import accumulated_opacity, density_threshold
from phys4dgen.interior.normals import oriented_points
from phys4dgen.interior.open_bottom import views_that_judge
from phys4dgen.interior.voxels import VoxelGrid
from phys4dgen.interior.winding import winding_number
from phys4dgen.types import Gaussians, Views

__all__ = ["Method", "SolidReading", "find_solid"]

Method = Literal["ipsd", "winding", "both", "none"]


@dataclass(frozen=True, eq=False)
class SolidReading:
    """Which voxels are solid.

    Attributes:
        solid: filled or dense voxels.
        judges: views that carving used, [V].
        agreement: IoU of the carved solid with the wound one if that was made, else with the dense one.
        density_threshold: that was used on the accumulated opacity.
    """

    solid: NDArray[np.bool_]
    judges: NDArray[np.bool_]
    agreement: float
    density_threshold: float


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
    carved = carve(grid, DepthLimits(views, dilate=True, chosen=judges), rotation)
    threshold = density_threshold(gaussians, grid, rotation)
    dense = accumulated_opacity(gaussians, grid, rotation) > threshold
    if not judges.all():  # nothing that is left looks under the ground
        ground = gaussians.robust_bounds(rotation=rotation)[0][2]
        carved[:, :, grid.lower[2] + (np.arange(grid.shape[2]) + 0.5) * grid.side < ground] = False
    if method in ("ipsd", "none"):
        return SolidReading(carved | dense, judges, _overlap(carved, dense), threshold)
    points = oriented_points(gaussians, views, rotation=rotation, tolerance=grid.side)
    wound = winding_number(points, grid) > 0.5
    filled = wound if method == "winding" else carved & wound
    return SolidReading(filled | dense, judges, _overlap(carved, wound), threshold)


def _overlap(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """Intersection over union."""
    return float((one & other).sum() / max((one | other).sum(), 1))
