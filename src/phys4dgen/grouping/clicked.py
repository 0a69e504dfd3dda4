"""One click per part: which part every patch of the surface belongs to.

A random walk (Grady, "Random Walks for Image Segmentation", IEEE PAMI 28(11), 2006): from a patch a walker steps to
patches that touch, the rather the more alike they are, hardly ever over an edge of colour or a concave crease, until it
comes to a click. The patch belongs to the part whose click it reaches most often. All ways count, so that one leak in a
border hardly matters, which cheapest-first merging or shortest paths fall for.

Some patches cannot be reached so: the second half of a bun, the other petals. From there, and the rather the more
surely nothing is reached on foot, the walker may leap to the patches that look most alike, wherever they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from phys4dgen.grouping.patch_graph import PatchGraph

__all__ = ["parts_by_random_walk"]

_EDGE_SCALE = 5.0
"""Difference between touching patches, in units of colour, at which a step becomes unlikely."""
_CREASE = 40.0
"""Difference that a full concave crease is worth."""
_OVER_ANY_EDGE = 1e-4
"""Least weight of a step between touching patches, where 1 is one within a material."""
_GIVE_UP = 1e-3
"""Weight of a walker's giving up at each step: what it does not reach by then counts as out of reach on foot."""
_LEAP = 1.0
"""Weight of a leap to a patch of the very same look from where no click can be reached on foot."""
_KIN = 10
"""Number of patches that a walker may leap to."""
_SMOOTHING_ROUNDS = 6
_SMOOTHING_SCALE = 6.0
"""Patches that differ by much more do not lend each other their look."""


def parts_by_random_walk(graph: PatchGraph, seeds: NDArray[np.intp]) -> NDArray[np.int64]:
    """Part of every patch where some are known, shape [S].

    Args:
        graph: S patches.
        seeds: part of each patch that is known, 0 .. G-1, every one of them used; -1 elsewhere, shape [S].
    """
    known = seeds >= 0
    walking = np.flatnonzero(~known)
    part = seeds.astype(np.int64)
    if not len(walking):
        return part
    look = _smoothed(graph)
    steps = _steps(graph, look)
    arrivals = steps[np.ix_(walking, np.flatnonzero(known))]
    staying = np.diag(steps.sum(1) + _GIVE_UP) - steps
    reached = np.linalg.solve(staying[np.ix_(walking, walking)], arrivals.sum(1))
    lost = np.zeros(len(graph))
    lost[walking] = 1 - np.clip(reached, 0, 1)
    ways = steps + _leaps(look, steps > 0, lost)
    # Round-off alone would make the system singular where a patch neither touches nor resembles another.
    laplacian = np.diag(ways.sum(1) + 1e-9) - ways
    clicked = np.eye(int(seeds.max()) + 1)[seeds[known]]
    arrivals = ways[np.ix_(walking, np.flatnonzero(known))] @ clicked
    share = np.linalg.solve(laplacian[np.ix_(walking, walking)], arrivals)
    part[walking] = share.round(12).argmax(1)  # the first part wins a tie, whatever the round-off
    return part


def _smoothed(graph: PatchGraph) -> NDArray[np.float64]:
    """Features of the patches with those of like neighbours mixed in, a bilateral filter on the graph; shape [S, 5]."""
    i, j = graph.touching.T
    look = graph.feature
    for _ in range(_SMOOTHING_ROUNDS):
        alike = graph.border * np.exp(-((look[i] - look[j]) ** 2).sum(1) / (2 * _SMOOTHING_SCALE**2))
        weight = _symmetric(len(graph), i, j, alike)
        total = weight.sum(1)
        own = np.maximum(total, 1)
        look = (own[:, None] * look + weight @ look) / (own + total)[:, None]
    return look


def _steps(graph: PatchGraph, look: NDArray[np.float64]) -> NDArray[np.float64]:
    """How readily a walker steps between two patches, 0 where they do not touch; symmetric, shape [S, S]."""
    i, j = graph.touching.T
    difference = ((look[i] - look[j]) ** 2).sum(1) + (_CREASE * np.clip(graph.crease, 0, 1)) ** 2
    ease = np.exp(-difference / (2 * _EDGE_SCALE**2)) + _OVER_ANY_EDGE
    length = graph.border / np.median(graph.border) if len(graph.border) else graph.border
    return _symmetric(len(graph), i, j, length * ease)


def _leaps(look: NDArray[np.float64], touching: NDArray[np.bool_], lost: NDArray[np.float64]) -> NDArray[np.float64]:
    """How readily a walker leaps from each patch (row) to those most like it elsewhere (column); shape [S, S]."""
    difference = ((look[:, None] - look[None]) ** 2).sum(2)
    difference[touching] = np.inf
    np.fill_diagonal(difference, np.inf)
    kin = np.argsort(difference, axis=1, kind="stable")[:, :_KIN]
    alike = np.exp(-np.take_along_axis(difference, kin, 1) / (2 * _EDGE_SCALE**2))
    out = np.zeros_like(difference)
    np.put_along_axis(out, kin, _LEAP * lost[:, None] ** 2 * alike, 1)
    return out


def _symmetric(
    count: int, i: NDArray[np.integer], j: NDArray[np.integer], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    out = np.zeros((count, count))
    out[i, j] = out[j, i] = values
    return out
