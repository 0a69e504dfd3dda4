"""One click per part: which part every patch of the surface belongs to.

A random walk (Grady, "Random Walks for Image Segmentation", IEEE PAMI 28(11), 2006): from a patch a walker steps to
patches that touch, the rather the more alike they are, hardly ever over an edge of colour or a concave crease, until it
comes to a click. The patch belongs to the part whose click it reaches most often. All ways count, so that one leak in a
border hardly matters, which cheapest-first merging or shortest paths fall for.

Some patches cannot be reached so: the second half of a bun, the other petals, the foot of a cup in another glaze. From
there, and the rather the more surely nothing is reached on foot, the walker may leap to the patches that look most
alike and lie in like surroundings, wherever they are (a lump of coal on snow is not the hat). A large area that passes
without any crease into what a click does reach, however, is taken for paint on that, and the walker goes on over the
edge of the paint instead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

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
"""Weight of a leap to a patch of the very same look and surroundings from where no click can be reached on foot."""
_KIN = 10
"""Number of patches that a walker may leap to."""
_SURROUNDINGS_ROUNDS = 4
"""How many patches far the surroundings of a patch reach."""
_SMOOTH = (-0.3, -0.2)
"""Creases, negative ones being convex, between which a surface passes over an edge without a fold."""
_FOLD_SCALE = 40.0
"""How fast the fold of an edge makes it less likely one of mere paint."""
_PAINT_SCALE = 15.0
"""Difference between touching patches that one thing painted in two colours may well have."""
_PAINT_GIVE_UP = 0.01
_PAINT_AREA = 0.02
"""Share of the surface from which an area of one colour is paint rather than an eye, a button, a scrap."""
_ONE_COLOR = 0.3
"""Ease of a step, 1 within a material, up to which two patches lie in one area."""
_SHEET = 8.0
"""Weighted thinness of a leaf or a petal, whose edges are not folded anyway."""
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
    ease = _ease(graph, look)
    steps = _weighted(graph, ease + _OVER_ANY_EDGE)
    arrivals = steps[np.ix_(walking, np.flatnonzero(known))]
    staying = np.diag(steps.sum(1) + _GIVE_UP) - steps
    reached = np.linalg.solve(staying[np.ix_(walking, walking)], arrivals.sum(1))
    lost = np.zeros(len(graph))
    lost[walking] = 1 - np.clip(reached, 0, 1)
    paint_steps = _paint_steps(graph, look)
    painted = _painted(graph, ease, paint_steps, lost=lost)
    ways = steps + (lost**2 * painted)[:, None] * paint_steps + _leaps(graph, look, lost**2 * (1 - painted))
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


def _ease(graph: PatchGraph, look: NDArray[np.float64]) -> NDArray[np.float64]:
    """How readily a walker steps between two touching patches: 1 within a material, 0 over a clear edge; shape [E]."""
    i, j = graph.touching.T
    difference = ((look[i] - look[j]) ** 2).sum(1) + (_CREASE * np.clip(graph.crease, 0, 1)) ** 2
    return np.exp(-difference / (2 * _EDGE_SCALE**2))


def _weighted(graph: PatchGraph, ease: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steps by their ease and by the length of the border, 0 where patches do not touch; symmetric, shape [S, S]."""
    i, j = graph.touching.T
    length = graph.border / np.median(graph.border) if len(graph.border) else graph.border
    return _symmetric(len(graph), i, j, length * ease)


def _paint_steps(graph: PatchGraph, look: NDArray[np.float64]) -> NDArray[np.float64]:
    """How readily a walker steps over what may be the edge of mere paint: no fold, no extreme contrast; [S, S]."""
    i, j = graph.touching.T
    contrast = ((look[i] - look[j]) ** 2).sum(1) / (2 * _PAINT_SCALE**2)
    fold = np.abs(graph.crease - np.clip(graph.crease, *_SMOOTH))
    return _weighted(graph, np.exp(-_FOLD_SCALE * fold - contrast))


def _painted(
    graph: PatchGraph, ease: NDArray[np.float64], paint_steps: NDArray[np.float64], *, lost: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How surely each patch is part of a large painted area of what a click does reach, 0 to 1; shape [S]."""
    found = (1 - lost) ** 4
    passing = np.diag(paint_steps.sum(1) + found + _PAINT_GIVE_UP) - paint_steps
    smoothly_reached = np.clip(np.linalg.solve(passing, found), 0, 1)
    i, j = graph.touching[ease > _ONE_COLOR].T
    links = coo_matrix((np.ones(len(i)), (i, j)), (len(graph), len(graph)))
    area_of_color = connected_components(links, directed=False)[1]
    share = np.bincount(area_of_color, graph.area)[area_of_color]
    solid = np.clip(1 - graph.feature[:, 3] / _SHEET, 0, 1)
    return smoothly_reached * solid * np.minimum(share / _PAINT_AREA, 1) ** 2


def _leaps(graph: PatchGraph, look: NDArray[np.float64], readiness: NDArray[np.float64]) -> NDArray[np.float64]:
    """How readily a walker leaps from each patch (row) to those most like it elsewhere (column); shape [S, S]."""
    around = _surroundings(graph, look)
    difference = ((look[:, None] - look[None]) ** 2).sum(2) + ((around[:, None] - around[None]) ** 2).sum(2)
    difference[graph.touching[:, 0], graph.touching[:, 1]] = np.inf
    difference[graph.touching[:, 1], graph.touching[:, 0]] = np.inf
    np.fill_diagonal(difference, np.inf)
    kin = np.argsort(difference, axis=1, kind="stable")[:, :_KIN]
    alike = np.exp(-np.take_along_axis(difference, kin, 1) / (2 * _EDGE_SCALE**2))
    out = np.zeros_like(difference)
    np.put_along_axis(out, kin, _LEAP * readiness[:, None] * alike, 1)
    return out


def _surroundings(graph: PatchGraph, look: NDArray[np.float64]) -> NDArray[np.float64]:
    """Look of the patches blurred over all edges; shape [S, 5]."""
    i, j = graph.touching.T
    weight = _symmetric(len(graph), i, j, graph.border)
    total = weight.sum(1)
    own = np.maximum(total, 1)
    for _ in range(_SURROUNDINGS_ROUNDS):
        look = (own[:, None] * look + weight @ look) / (own + total)[:, None]
    return look


def _symmetric(
    count: int, i: NDArray[np.integer], j: NDArray[np.integer], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    out = np.zeros((count, count))
    out[i, j] = out[j, i] = values
    return out
