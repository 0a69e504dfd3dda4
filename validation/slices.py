"""Slices of fluid or sand that can move in the x-z plane only, on a ground and beside a wall at x = 0."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm import Ground, HalfSpace, Obstacle
from validation.states import Moment

__all__ = ["ground_at_zero", "moment", "plane_walls", "slice_of"]


def slice_of(width: float, height: float, dx: float, *, top: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Particles of a slice two cells thick, x and z from 0, at half a cell from each other, [P, 3].

    Args:
        width: of the rectangle that is filled, m.
        height: of it, m.
        dx: cell, m.
        top: corners (x, z) of a surface above which nothing is kept, [K, 2].
    """
    h = dx / 2
    axes = [(np.arange(round(length / h)) + 0.5) * h for length in (width, 2 * dx, height)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    if top is not None:
        x = x[x[:, 2] < np.interp(x[:, 0], top[:, 0], top[:, 1])]
    return x


def plane_walls(dx: float) -> tuple[Obstacle, ...]:
    """A slip wall so deep that every node of a slice is inside it, and one at x = 0 that pushes without friction."""
    aside = Obstacle(HalfSpace((0.0, 3.6 * dx, 0.0), (0.0, 1.0, 0.0)), contact="slip")
    wall = Obstacle(HalfSpace((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), friction=0.0)
    return aside, wall


def ground_at_zero(contact: Literal["separate", "sticky"], friction: float = 0.0) -> Ground:
    """The ground z = 0."""
    return Ground(0.0, contact, friction)


def moment(
    title: str,
    x: NDArray[np.float64],
    start: NDArray[np.float64],
    *,
    lines: tuple[NDArray[np.float64], ...] = (),
) -> Moment:
    """One layer of a slice [P, 3], shaded in bands by the height at which its particles started."""
    layer = np.isclose(start[:, 1], start[:, 1].min())
    height = start[layer, 2] / start[:, 2].max()
    bands = np.floor(height * 8) % 2 * 0.55 + 0.3 * height
    return Moment(title, x[layer][:, [0, 2]], bands, lines)
