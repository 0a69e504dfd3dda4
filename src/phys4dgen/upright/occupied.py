"""The cells of space that an object fills, without what floats about it: what all cues of uprightness look at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, generate_binary_structure, label

from phys4dgen.types import Gaussians

__all__ = ["Occupied", "occupied_cells"]

_CELLS = 56
"""Along the longest side of the robust box."""

_LEAST_OPACITY = 0.1
_LEAST_SUM = 0.5
"""A cell whose opacities sum up to less is taken for haze."""

_LEAST_PIECE = 0.02
"""Share of the mass below which a piece that hangs together with nothing is taken for a floater."""

_MARGIN = 0.05
_MOST_CELLS = 5000
_LARGEST_SCALE = 1 / 20


class Occupied(NamedTuple):
    """Filled cells.

    Attributes:
        points: centre of mass of the Gaussians of each cell, input units, shape [M, 3].
        mass: opacity times visible area of these Gaussians, which stands for mass, shape [M].
        size: longest side of the object's robust box, input units.
        cell: side of a cell, input units.
        members: numbers of the Gaussians in filled cells, shape [K].
    """

    points: NDArray[np.float64]
    mass: NDArray[np.float64]
    size: float
    cell: float
    members: NDArray[np.int64]


def occupied_cells(gaussians: Gaussians) -> Occupied | None:
    """The cells that the object fills, at most 5,000 of them drawn evenly; None where it has no size."""
    lower, upper = gaussians.robust_bounds()
    size = float((upper - lower).max())
    if size <= 0:
        return None
    means = gaussians.means.astype(np.float64)
    near = ((means > lower - _MARGIN * size) & (means < upper + _MARGIN * size)).all(1)
    seen = near & (gaussians.opacities > _LEAST_OPACITY)
    members = np.flatnonzero(seen if seen.any() else near)
    cell = size / _CELLS
    index = np.floor((means[members] - lower + _MARGIN * size) / cell).astype(np.int64)
    shape = tuple(int(n) for n in index.max(0) + 1)
    keys, cell_of = np.unique(np.ravel_multi_index(tuple(index.T), shape), return_inverse=True)
    weight = visible_mass(gaussians, members, size)
    mass = np.bincount(cell_of, weight).astype(np.float64)
    filled = np.bincount(cell_of, gaussians.opacities[members]) > _LEAST_SUM
    if not filled.any():
        filled[:] = True
    grid = np.zeros(shape, np.bool_)
    grid.ravel()[keys[filled]] = True
    pieces = np.zeros(shape, np.int32)
    label(binary_dilation(grid), generate_binary_structure(3, 3), output=pieces)
    piece = pieces.ravel()[keys]
    piece_mass = np.bincount(piece[filled], mass[filled])
    kept = np.flatnonzero(filled)
    kept = kept[piece_mass[piece[kept]] >= _LEAST_PIECE * piece_mass.sum()]
    sums = np.stack([np.bincount(cell_of, weight * means[members, axis]) for axis in range(3)], 1)
    points, mass = sums[kept] / mass[kept, None], mass[kept]
    if len(points) > _MOST_CELLS:
        drawn = np.random.default_rng(0).choice(len(points), _MOST_CELLS, replace=False)
        points, mass = points[drawn], mass[drawn]
    return Occupied(points, mass, size, cell, members[np.isin(cell_of, kept)])


def visible_mass(gaussians: Gaussians, index: NDArray[np.int64], size: float) -> NDArray[np.float64]:
    """Opacity times the product of the two larger axes; a few huge background Gaussians must not decide."""
    axes = np.sort(np.minimum(gaussians.scales[index].astype(np.float64), _LARGEST_SCALE * size), axis=1)
    return gaussians.opacities[index].astype(np.float64) * axes[:, 1] * axes[:, 2]
