"""Held parts: grid nodes that clamp what has grown together with them and stop what only touches them.

A node is held where more than half of the mass around it, at rest, belongs to held particles. Held particles
themselves are not simulated, but for a skin of those that share a free node with the moving body: without them there
would be no material between the last held node and the first moving particle, a hinge instead of a clamp.

Where no particle that is bonded to the held part touches a node at rest, the node is not held but an obstacle: nothing
moves into it along its normal, and everything may leave it. Such a node has at least half of the held volume of the
fullest node next to it, so that the obstacle ends where the held part ends, and its normal points down the gradient of
the held volume.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.spatial import KDTree

from phys4dgen.mpm.body import Body
from phys4dgen.mpm.contacts import Entries
from phys4dgen.mpm.kernels.contact import SEPARATE

__all__ = ["HeldNodes", "spline_weights", "with_simulated_skin"]

_HELD_SHARE = 0.5
_SKIN_CELLS = 2.5  # particles farther apart share no node
_OBSTACLE_SHARE = 0.5  # of the held volume at the fullest neighbour
_LEAST_SHARE = 0.01  # of a cell; less held material than this is no obstacle
_LEAST_SLOPE = 0.02  # change of the held share between the two neighbours, deep inside there is none
_MATERIAL = ("density_kgm3", "youngs_modulus_pa", "poisson_ratio", "law")


def spline_weights(places: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Lowest node [P, 3] and quadratic B-spline weights [3 nodes, P, 3 axes] of places in cells [P, 3]."""
    lowest = np.floor(places - 0.5).astype(np.int64)
    offset = places - lowest - 1
    weights = np.stack([0.5 * (0.5 - offset) ** 2, 0.75 - offset**2, 0.5 * (0.5 + offset) ** 2])
    return lowest, weights


@dataclass(frozen=True, eq=False)
class HeldNodes:
    """Which nodes are held and which are obstacles.

    Attributes:
        first: world node of ``mask[0, 0, 0]``, int64 [3].
        mask: True where held, bool [nx, ny, nz].
        obstacles: places in ``mask`` of the nodes that stop without holding, int64 [K, 3].
        normals: their outward unit normals, float32 [K, 3].
        friction: Coulomb's coefficient on them.
    """

    first: NDArray[np.int64]
    mask: NDArray[np.bool_]
    obstacles: NDArray[np.int64]
    normals: NDArray[np.float32]
    friction: float

    @classmethod
    def from_body(cls, body: Body, places: NDArray[Any], *, dx_m: float, friction: float) -> HeldNodes:
        """From a body whose particles rest at ``places`` in cells [P, 3]."""
        held, bonded = body.held, body.bonded_to_held
        assert bonded is not None
        none, flat = np.zeros((0, 3), np.int64), np.zeros((0, 3), np.float32)
        if not held.any():
            return cls(np.zeros(3, np.int64), np.zeros((0, 0, 0), np.bool_), none, flat, friction)
        lowest, weights = spline_weights(places)
        first = lowest[held].min(0) - 1
        shape = tuple(int(n) for n in lowest[held].max(0) - first + 4)
        near = ((lowest >= first - 2) & (lowest < first + shape)).all(1)
        lowest, weights = lowest[near] - first, weights[:, near]

        def sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
            """Values of the particles near, summed at the nodes with their weights."""
            total = np.zeros(np.prod(shape))
            for i, j, k in product(range(3), repeat=3):
                node = lowest + np.array([i, j, k])
                inside = ((node >= 0) & (node < shape)).all(1)
                share = values * weights[i, :, 0] * weights[j, :, 1] * weights[k, :, 2]
                total += np.bincount(np.ravel_multi_index(tuple(node[inside].T), shape), share[inside], len(total))
            return total.reshape(shape)

        mask = sums((np.where(held, 1 - _HELD_SHARE, -_HELD_SHARE) * body.mass_kg)[near]) > 0
        if bonded[~held].all():
            return cls(first, mask, none, flat, friction)
        rooted = sums(np.where(bonded & ~held, 1.0, 0.0)[near]) > 0
        share = sums(np.where(held, body.volume_m3, 0.0)[near] / dx_m**3)
        full = share >= np.maximum(_OBSTACLE_SHARE * maximum_filter(share, 3, mode="constant"), _LEAST_SHARE)
        rise: Any = np.gradient(np.pad(share, 1))
        slope = -np.stack(rise, -1)[1:-1, 1:-1, 1:-1]
        steep = np.linalg.norm(slope, axis=-1)
        obstacle = full & ~rooted & (steep > _LEAST_SLOPE)
        normals = (slope[obstacle] / steep[obstacle][:, None]).astype(np.float32)
        clamped = (mask & rooted) | (full & ~rooted & ~obstacle)
        return cls(first, clamped, np.argwhere(obstacle), normals, friction)

    def contacts(self) -> Entries:
        """The obstacles, for ``contacts.contact_arrays``."""
        count = len(self.obstacles)
        kinds = np.tile(np.array([SEPARATE, 0, -1, -1], np.int32), (count, 1))
        planes = np.column_stack([self.normals, np.full(count, self.friction), np.zeros((count, 3))])
        return self.obstacles + self.first, kinds, planes.astype(np.float32)

    def write_to(self, free: NDArray[np.float32], shift: NDArray[np.int64]) -> None:
        """Set ``free`` [nx, ny, nz], whose first node is the world node ``shift``, to 0 where held."""
        low = np.maximum(self.first, shift)
        high = np.minimum(self.first + self.mask.shape, shift + free.shape)
        if (high <= low).any():
            return
        there = tuple(slice(a, b) for a, b in zip(low - shift, high - shift, strict=True))
        here = tuple(slice(a, b) for a, b in zip(low - self.first, high - self.first, strict=True))
        free[there][self.mask[here]] = 0

    def touches_free(self, places: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether any of the 27 nodes around each place in cells [P, 3] is free."""
        lowest = np.floor(places - 0.5).astype(np.int64) - self.first
        result = np.zeros(len(places), np.bool_)
        for offset in product(range(3), repeat=3):
            node = lowest + offset
            inside = ((node >= 0) & (node < self.mask.shape)).all(1)
            held = np.zeros(len(places), np.bool_)
            held[inside] = self.mask[tuple(node[inside].T)]
            result |= ~held
        return result


def with_simulated_skin(body: Body, held: HeldNodes, places: NDArray[Any]) -> Body:
    """The body as it is simulated: held particles that share a free node with moving ones are not left out.

    They take the material of the nearest soft particle that is bonded to them, so that a stiff pot does not shorten the
    time step; held nodes keep them in place. Frames report them at rest.

    Args:
        body: as given.
        held: its held nodes.
        places: rest places in cells, [P, 3].
    """
    assert body.bonded_to_held is not None
    still = np.flatnonzero(body.held)
    moving = np.flatnonzero(body.is_soft & body.bonded_to_held)
    if len(still) == 0 or len(moving) == 0:
        return body
    distance, near = KDTree(places[moving]).query(places[still], distance_upper_bound=_SKIN_CELLS)
    skin = np.isfinite(distance) & held.touches_free(places[still])
    chosen, donor = still[skin], moving[np.asarray(near)[skin]]
    simulated = {name: getattr(body, name).copy() for name in _MATERIAL}
    numbers = {name: values.copy() for name, values in (body.law_numbers or {}).items()}
    for values in (*simulated.values(), *numbers.values()):
        values[chosen] = values[donor]
    frozen = body.held.copy()
    frozen[chosen] = False
    return replace(body, held=frozen, law_numbers=numbers, **simulated)
