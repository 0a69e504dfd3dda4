"""Where the grid's nodes lie, so that the ground's highest ones are at the right depth below it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import SimulationError
from phys4dgen.mpm.body import Body
from phys4dgen.mpm.contacts import GROUND_GAP_CELLS
from phys4dgen.mpm.settings import Settings

__all__ = ["origin_and_ground_node"]


def origin_and_ground_node(body: Body, settings: Settings) -> tuple[NDArray[np.float64], int]:
    """Place of the world node 0 in metres [3] and the ground's highest node along z.

    The body's lowest corner, lowered until the ground's highest node is a node of the grid; 0 without ground.

    Raises:
        SimulationError: something that moves starts below the ground.
    """
    ground, dx_m = settings.ground, settings.dx_m
    origin_m = body.positions_m.min(0)
    if ground is None:
        return origin_m, 0
    heights = np.where(body.held, np.inf, body.positions_m[:, 2])
    lowest = int(heights.argmin())
    if heights[lowest] < ground.height_m - 0.5 * dx_m:
        raise SimulationError(
            f"Part '{body.part_names[body.part[lowest]]}' starts {ground.height_m - heights[lowest]:.3g} m below "
            f"the ground at z = {ground.height_m:.4g} m; lower the ground or raise the body."
        )
    plane_m = ground.height_m - GROUND_GAP_CELLS * dx_m
    origin_m[2] -= (origin_m[2] - plane_m) % dx_m
    return origin_m, round((plane_m - origin_m[2]) / dx_m)
