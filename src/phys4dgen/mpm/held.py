"""Held parts: grid nodes whose velocity stays zero.

A node is held where more than half of the mass around it, at rest, belongs to held particles. Held particles
themselves are not simulated, but for a skin of those that share a free node with the moving body: without them there
would be no material between the last held node and the first moving particle, a hinge instead of a clamp.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.mpm.body import Body

__all__ = ["HeldNodes", "spline_weights", "with_simulated_skin"]

_HELD_SHARE = 0.5
_SKIN_CELLS = 2.5  # particles farther apart share no node
_MATERIAL = ("density_kgm3", "youngs_modulus_pa", "poisson_ratio", "law")


def spline_weights(places: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Lowest node [P, 3] and quadratic B-spline weights [3 nodes, P, 3 axes] of places in cells [P, 3]."""
    lowest = np.floor(places - 0.5).astype(np.int64)
    offset = places - lowest - 1
    weights = np.stack([0.5 * (0.5 - offset) ** 2, 0.75 - offset**2, 0.5 * (0.5 + offset) ** 2])
    return lowest, weights


@dataclass(frozen=True, eq=False)
class HeldNodes:
    """Which nodes are held.

    Attributes:
        first: world node of ``mask[0, 0, 0]``, int64 [3].
        mask: True where held, bool [nx, ny, nz].
    """

    first: NDArray[np.int64]
    mask: NDArray[np.bool_]

    @classmethod
    def from_particles(cls, places: NDArray[Any], mass: NDArray[Any], held: NDArray[np.bool_]) -> HeldNodes:
        """From rest places in cells [P, 3], masses [P] and who is held [P]."""
        if not held.any():
            return cls(np.zeros(3, np.int64), np.zeros((0, 0, 0), np.bool_))
        lowest, weights = spline_weights(places)
        first = lowest[held].min(0)
        shape = tuple(int(n) for n in lowest[held].max(0) - first + 3)
        near = ((lowest >= first - 2) & (lowest < first + shape)).all(1)
        balance = np.zeros(np.prod(shape))
        signed = np.where(held, 1 - _HELD_SHARE, -_HELD_SHARE) * mass
        for i, j, k in product(range(3), repeat=3):
            node = lowest[near] - first + (i, j, k)
            inside = ((node >= 0) & (node < shape)).all(1)
            share = signed[near] * weights[i, near, 0] * weights[j, near, 1] * weights[k, near, 2]
            flat = np.ravel_multi_index(tuple(node[inside].T), shape)
            balance += np.bincount(flat, share[inside], len(balance))
        return cls(first, balance.reshape(shape) > 0)

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

    They take the material of the nearest moving particle, so that a stiff pot does not shorten the time step; held
    nodes keep them in place. Frames report them at rest.

    Args:
        body: as given.
        held: its held nodes.
        places: rest places in cells, [P, 3].
    """
    still = np.flatnonzero(body.held)
    moving = np.flatnonzero(~body.held)
    if len(still) == 0 or len(moving) == 0:
        return body
    distance, near = KDTree(places[moving]).query(places[still], distance_upper_bound=_SKIN_CELLS)
    skin = np.isfinite(distance) & held.touches_free(places[still])
    chosen, donor = still[skin], moving[np.asarray(near)[skin]]
    simulated = {name: getattr(body, name).copy() for name in _MATERIAL}
    for values in simulated.values():
        values[chosen] = values[donor]
    frozen = body.held.copy()
    frozen[chosen] = False
    return replace(body, held=frozen, **simulated)
