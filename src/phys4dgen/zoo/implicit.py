"""Solids given by a signed distance, sampled evenly by surface nets.

A lattice is laid only through the blocks that the surface may cross; one vertex per crossed cell (Gibson 1998,
"Constrained elastic surface nets") is moved onto the surface by Newton steps along the gradient. So every sample lies
on the surface to rounding, whatever the shape, and whoever can write a distance can make a solid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from phys4dgen.zoo.patch import Array, Patch

__all__ = ["Distance", "Implicit"]

Distance = Callable[[Array], Array]
"""Points [N, 3] in metres -> signed distance [N] in metres, negative inside; near the surface right to first order."""

OVERLAP = 0.66
"""Standard deviation of a Gaussian in units of the spacing."""
BLOCK = 4
"""Cells along the side of a block of the lattice."""
REACH = 1.3
"""A block is searched if its middle is nearer to the surface than this many half diagonals: distances are estimates."""
CHUNK = 8192
"""Points whose distance is asked for at once: few enough for the processor's cache."""
OFF_LATTICE = np.array([0.137, 0.291, 0.419])
"""Shift of the lattice in cells, so that flat faces do not fall onto its points."""
VOLUME_CELLS = 72
"""Cells along the longest side when the volume is measured."""
CORNERS = np.argwhere(np.ones((2, 2, 2)))
EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(CORNERS[a] - CORNERS[b]).sum() == 1]
TETRAHEDRON = np.array([[1, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]]) / np.sqrt(3)


@dataclass(frozen=True, eq=False)
class Implicit:
    """The points whose signed distance is negative; hollow if ``wall_m`` is given.

    Attributes:
        distance: see ``Distance``.
        lower: corner of a box around the solid, metres, shape [3].
        upper: the opposite corner, shape [3].
        wall_m: thickness of the wall of a closed shell whose inside is empty; None is solid throughout.
    """

    distance: Distance
    lower: Array
    upper: Array
    wall_m: float | None = None

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether each point [N, 3] lies in the material."""
        value = self.signed_distance(points)
        return value < 0 if self.wall_m is None else (value < 0) & (value > -self.wall_m)

    def signed_distance(self, points: Array) -> Array:
        """``distance`` of any number of points [N, 3]."""
        chunks = [self.distance(points[start : start + CHUNK]) for start in range(0, len(points), CHUNK)]
        return np.concatenate(chunks) if chunks else np.zeros(0)

    @property
    def volume_m3(self) -> float:
        """Volume of the material."""
        return self._filled_m3 - self.cavity_m3

    @cached_property
    def cavity_m3(self) -> float:
        """Volume of the empty inside, 0 where solid."""
        wall = self.wall_m
        if wall is None:
            return 0.0
        return replace(self, distance=lambda points: self.distance(points) + wall, wall_m=None).volume_m3

    @cached_property
    def _filled_m3(self) -> float:
        """Sum over lattice points of their share inside: a ramp one cell wide across the surface (second order)."""
        step = float((self.upper - self.lower).max()) / VOLUME_CELLS
        corner, full_m3 = self._blocks(step)
        points = (corner[:, None] + np.argwhere(np.ones((BLOCK,) * 3)) * step).reshape(-1, 3)
        value = self.signed_distance(points)
        share = (value < 0).astype(np.float64)
        edge = np.flatnonzero(np.abs(value) < step)
        _, _, steepness = self._slope(points[edge], 0.05 * step)
        share[edge] = np.clip(0.5 - value[edge] / (steepness * step), 0, 1)
        return full_m3 + float(share.sum()) * step**3

    def sample(self, spacing_m: float, rng: np.random.Generator) -> Patch:
        """Samples of the outer surface; ``coords`` = (0, 0, 1).

        Args:
            spacing_m: side of a lattice cell: roughly the distance between neighbours.
            rng: for the jitter that hides the lattice.
        """
        corner, _ = self._blocks(spacing_m)
        values = self._lattice(corner, spacing_m)
        points = self._onto_surface(_net_vertices(corner, values, spacing_m), spacing_m)[0]
        points = points + rng.uniform(-0.3, 0.3, points.shape) * spacing_m
        points = self._onto_surface(points, spacing_m)[0]
        points, normals = self._onto_surface(points, spacing_m)
        side = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
        tangents = np.cross(normals, side)
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        n = len(points)
        return Patch(
            points=points,
            normals=normals,
            tangents=tangents,
            sigmas=np.tile(np.array([OVERLAP, OVERLAP, 0.12]) * spacing_m, (n, 1)),
            coords=np.tile([0.0, 0.0, 1.0], (n, 1)),
        )

    def _blocks(self, step_m: float) -> tuple[Array, float]:
        """Lower corners [B, 3] of the blocks that the surface may cross, and the volume of those wholly inside."""
        size = BLOCK * step_m
        counts = np.ceil((self.upper - self.lower) / size).astype(int) + 1
        origin = (self.lower + self.upper - counts * size) / 2 + OFF_LATTICE * step_m
        corner = origin + np.argwhere(np.ones(counts)) * size
        middle = self.signed_distance(corner + size / 2)
        reach = REACH * size * np.sqrt(3) / 2
        return corner[np.abs(middle) < reach], float(np.count_nonzero(middle <= -reach)) * size**3

    def _lattice(self, corner: Array, step_m: float) -> Array:
        """Distances at the lattice points of blocks with these lower corners [B, 3], shape [B, 5, 5, 5]."""
        offsets = np.argwhere(np.ones((BLOCK + 1,) * 3)) * step_m
        points = (corner[:, None] + offsets).reshape(-1, 3)
        return self.signed_distance(points).reshape(-1, *(BLOCK + 1,) * 3)

    def _onto_surface(self, points: Array, spacing_m: float) -> tuple[Array, Array]:
        """One Newton step towards the surface and the unit normals there; two arrays [N, 3]."""
        value, normals, steepness = self._slope(points, 0.05 * spacing_m)
        step = np.clip(value / steepness, -spacing_m, spacing_m)
        return points - step[:, None] * normals, normals

    def _slope(self, points: Array, reach_m: float) -> tuple[Array, Array, Array]:
        """Distance [N], direction [N, 3] and length [N] of its gradient, from the corners of small tetrahedra."""
        values = np.stack([self.signed_distance(points + reach_m * corner) for corner in TETRAHEDRON], 1)
        gradient = 0.75 / reach_m * values @ TETRAHEDRON
        steepness = np.maximum(np.linalg.norm(gradient, axis=1), 1e-3)
        return values.mean(1), gradient / steepness[:, None], steepness


def _net_vertices(corner: Array, values: Array, step_m: float) -> Array:
    """The mean of the edge crossings of every cell that the surface crosses, shape [M, 3]."""
    at = [values[:, i : i + BLOCK, j : j + BLOCK, k : k + BLOCK] for i, j, k in CORNERS]
    inside = np.sum([value < 0 for value in at], axis=0)
    block, *cell = np.nonzero((inside > 0) & (inside < 8))
    at = np.stack([value[block, cell[0], cell[1], cell[2]] for value in at], 1)
    total, count = np.zeros((len(block), 3)), np.zeros((len(block), 1))
    for a, b in EDGES:
        crosses = (at[:, a] < 0) != (at[:, b] < 0)
        share = np.where(crosses, at[:, a] / np.where(crosses, at[:, a] - at[:, b], 1.0), 0.0)[:, None]
        total += crosses[:, None] * (CORNERS[a] + share * (CORNERS[b] - CORNERS[a]))
        count += crosses[:, None]
    return corner[block] + step_m * (np.stack(cell, 1) + total / count)
