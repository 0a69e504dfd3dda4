"""How fine the simulation's grid is, where the user leaves it open."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_fill_holes, generate_binary_structure

from phys4dgen.types import Gaussians

__all__ = [
    "COARSE_GRID",
    "FINE_GRID",
    "MOST_PARTICLES",
    "MOST_PARTICLES_OF_A_GUESS",
    "automatic_grid",
    "estimated_particles",
]

FINE_GRID = 64
"""Cells along the longest side at which plants were judged (MOTION.md)."""

MOST_PARTICLES = 120_000
"""A drop of two seconds then takes a few minutes on two cores."""

MOST_PARTICLES_OF_A_GUESS = 30_000
"""The same in a minute: enough where the shape behind the picture is guessed from its outline."""

COARSE_GRID = 16
"""Cells along the longest side that are never too many."""

_ESTIMATE_CELLS = 48
_PARTICLES_PER_CELL = 8
_MARGIN_CELLS = 3
_LEAST_OPACITY = 0.1


def automatic_grid(gaussians: Gaussians, *, rotation: NDArray[np.float64], most_particles: int = MOST_PARTICLES) -> int:
    """Cells along the longest side: 64, or fewer where the object is so massive that it would be filled for ever.

    Args:
        gaussians: the object.
        rotation: input axes -> upright axes, [3, 3].
        most_particles: about how many are enough.
    """
    wanted = estimated_particles(gaussians, rotation=rotation, grid=FINE_GRID)
    if wanted <= most_particles:
        return FINE_GRID
    return max(COARSE_GRID, int(FINE_GRID * (most_particles / wanted) ** (1 / 3)))


def estimated_particles(gaussians: Gaussians, *, rotation: NDArray[np.float64], grid: int) -> float:
    """About how many particles interior discovery will seed, half a cell apart, at a grid of so many cells.

    Cells that hold Gaussians count half, the cells that they enclose in full; layer by layer, so that a shell that is
    open below is filled as well.
    """
    lower, upper = gaussians.robust_bounds(rotation=rotation)
    cell = float((upper - lower).max()) / _ESTIMATE_CELLS
    points = gaussians.means[gaussians.opacities > _LEAST_OPACITY] @ rotation.T
    # A little beyond the robust box, which cuts the poles of a ball off.
    places = np.floor((points - lower) / cell).astype(np.int64) + _MARGIN_CELLS
    shape = tuple(int(n) for n in np.ceil((upper - lower) / cell).astype(np.int64) + 2 * _MARGIN_CELLS)
    places = places[((places >= 0) & (places < shape)).all(1)]
    skin = np.zeros(shape, np.bool_)
    skin[tuple(places.T)] = True
    square = generate_binary_structure(2, 2)
    closed = np.zeros_like(skin)
    for k in range(shape[2]):
        closed[..., k] = binary_fill_holes(binary_closing(skin[..., k], square))
    cells = (closed & ~skin).sum() + 0.5 * skin.sum()
    return float(_PARTICLES_PER_CELL * cells * (grid / _ESTIMATE_CELLS) ** 3)
