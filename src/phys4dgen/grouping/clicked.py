"""One click per part: which part every patch of the surface belongs to.

A random walk (Grady, "Random Walks for Image Segmentation", IEEE PAMI 28(11), 2006): from a region of the surface
(``regions``) a walker steps to regions that touch, the rather the more alike they are, hardly ever over an edge of
colour or a concave crease, until it comes to a region with a click. The region belongs to the part whose click it
reaches most often. All ways count, so that one leak in a border hardly matters, which cheapest-first merging or
shortest paths fall for. It walks over regions instead of patches because what lies along a border tells more on average
than patch by patch; the shares of coarse, fine and finer regions are added up.

Some regions cannot be reached so: the second half of a bun, the other petals, the foot of a cup in another glaze. From
there, and the rather the more surely nothing is reached on foot, the walker may leap to the regions that look most
alike, are of like size and lie in like surroundings, wherever they are (a lump of coal on snow is not the hat), but not
where a way of one colour leads there: only a crease can keep it from that way, and then it counts. A large region that
passes without any crease into what a click does reach, however, is taken for paint on that, and the walker goes on over
the edge of the paint instead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from phys4dgen.grouping.patch_graph import PatchGraph
from phys4dgen.grouping.regions import Regions, describe_regions, join_order, regions_at

__all__ = ["parts_by_random_walk"]

_WAYS = ((0.0, 0.9), (4.0, 0.7), (8.0, 0.5))
"""Walks whose shares are added up: differences of colour that e times the thickness is worth, shares of the contrast
along the border by which regions are joined, ..."""
_REGIONS = (40, 80, 160)
"""... numbers of regions, ..."""
_CREASES = (55.0, 120.0)
"""... and differences of colour that a full concave crease is worth to a walker."""
_EDGE_SCALE = 2.7
"""Difference between touching regions, in units of colour, at which a step becomes unlikely."""
_OVER_ANY_EDGE = 1e-6
"""Least weight of a step between touching regions, where 1 is one within a material."""
_GIVE_UP = 0.005
"""How readily a walker gives up, where 1 is stepping on: what it has not reached by then is out of reach on foot."""
_ROUND_OFF = 1e-9
"""Added to the diagonal, lest a region that neither touches nor resembles another make the system singular; differences
this close are a tie."""
_LEAP = 3.0
"""Weight of a leap to a region of the very same look and surroundings from where no click can be reached on foot."""
_KIN = 4
"""Number of regions that a walker may leap to."""
_KIN_SCALE = 3.5
"""Difference, in units of colour, at which a leap becomes unlikely."""
_SURROUNDINGS = 0.3
"""Weight of the surroundings beside a region's own look, squared."""
_SIZE = 2.0
"""Difference that a region e times as large is worth."""
_ONE_COLOR = 8.0
"""Greatest difference on the way between two regions up to which that way, not a leap, decides."""
_SURROUNDINGS_ROUNDS = 4
"""How many patches far the surroundings of a patch reach."""
_SMOOTH = (-0.3, -0.2)
"""Creases, negative ones being convex, between which a surface passes over an edge without a fold."""
_FOLD_SCALE = 80.0
"""How fast the fold of an edge makes it less likely one of mere paint."""
_PAINT_SCALE = 15.0
"""Difference between touching regions that one thing painted in two colours may well have."""
_PAINT_GIVE_UP = 0.03
_PAINT_AREA = 0.02
"""Share of the surface from which an area of one colour is paint rather than an eye, a button, a scrap."""
_PAINT_COLOR = 3.0
"""Greatest difference on the way between two regions at which they are hardly of one paint any more."""
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
    width = float(np.median(graph.border)) if len(graph.border) else 1.0
    share = np.zeros((len(graph), int(seeds.max()) + 1))
    for thickness, along_border in _WAYS:
        look = _smoothed(graph, np.concatenate([graph.feature, thickness * graph.diameter[:, None]], 1))
        around = _surroundings(graph, look)
        order = join_order(graph, look, along_border=along_border)
        for count in _REGIONS:
            region = regions_at(order, seeds, count)
            known = np.full(int(region.max()) + 1, -1, np.intp)
            known[region[seeds >= 0]] = seeds[seeds >= 0]
            regions = describe_regions(graph, region, look)
            surroundings = np.stack([np.bincount(region, graph.area * column) for column in around.T], 1)
            surroundings /= regions.area[:, None]
            for crease in _CREASES:
                share += _shares(regions, surroundings, known, width, crease)[region]
    return share.round(6).argmax(1)  # the first part wins a tie, whatever the round-off, and what no click can reach


def _shares(
    regions: Regions, surroundings: NDArray[np.float64], known: NDArray[np.intp], width: float, full_crease: float
) -> NDArray[np.float64]:
    """How many of the walkers from each region reach the click of each part, shape [K, G].

    Args:
        regions: K regions.
        surroundings: look of what lies around each, shape [K, 6].
        known: part of each region with a click, -1 elsewhere, shape [K].
        width: length of a usual border between patches.
        full_crease: difference of colour that a full concave crease is worth.
    """
    clicked, walking = np.flatnonzero(known >= 0), np.flatnonzero(known < 0)
    share = np.eye(int(known.max()) + 1)[known]  # rows of walking regions are overwritten
    if not len(walking):
        return share
    color = np.sqrt((regions.contrast**2 + regions.difference**2) / 2)
    crease = full_crease * np.clip(regions.fold, 0, 1)
    ease = np.exp(-np.hypot(color, crease) / _EDGE_SCALE) + _OVER_ANY_EDGE
    steps = _between(regions, ease * regions.length / width)
    giving_up = _GIVE_UP * _between(regions, regions.length / width).sum(1) + _ROUND_OFF
    staying = np.diag(steps.sum(1) + giving_up) - steps
    reached = np.linalg.solve(staying[np.ix_(walking, walking)], steps[np.ix_(walking, clicked)].sum(1))
    lost = np.zeros(len(known))
    lost[walking] = 1 - np.clip(reached, 0, 1)
    paint_steps = _paint_steps(regions, color, width)
    on_the_way = _greatest_on_the_way(regions, color)
    painted = _painted(regions, paint_steps, on_the_way, lost=lost)
    leaps = _leaps(regions, on_the_way, surroundings)
    ways = steps + (lost**2 * painted)[:, None] * paint_steps + (lost**2 * (1 - painted))[:, None] * leaps
    laplacian = np.diag(ways.sum(1) + _ROUND_OFF) - ways
    arrivals = ways[np.ix_(walking, clicked)] @ share[clicked]
    share[walking] = np.linalg.solve(laplacian[np.ix_(walking, walking)], arrivals)
    return share


def _paint_steps(regions: Regions, color: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """How readily a walker steps over what may be the edge of mere paint: no fold, no extreme contrast; [K, K]."""
    fold = np.abs(regions.crease - np.clip(regions.crease, *_SMOOTH))
    ease = np.exp(-_FOLD_SCALE * fold - color**2 / (2 * _PAINT_SCALE**2))
    return _between(regions, ease * regions.length / width)


def _painted(
    regions: Regions, paint_steps: NDArray[np.float64], on_the_way: NDArray[np.float64], *, lost: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How surely each region belongs to a large painted area of what a click does reach, 0 to 1; shape [K]."""
    found = (1 - lost) ** 4
    passing = np.diag(paint_steps.sum(1) + found + _PAINT_GIVE_UP) - paint_steps
    smoothly_reached = np.clip(np.linalg.solve(passing, found), 0, 1)
    solid = np.clip(1 - regions.look[:, 3] / _SHEET, 0, 1)
    area = np.exp(-((on_the_way / _PAINT_COLOR) ** 2)) @ regions.area
    return smoothly_reached * solid * np.minimum(area / _PAINT_AREA, 1) ** 2


def _leaps(regions: Regions, on_the_way: NDArray[np.float64], surroundings: NDArray[np.float64]) -> NDArray[np.float64]:
    """How readily a walker leaps from each region (row) to those most like it elsewhere (column); shape [K, K]."""
    look, size = regions.look, np.log(regions.area)
    difference = ((look[:, None] - look[None]) ** 2).sum(2)
    difference += _SURROUNDINGS * ((surroundings[:, None] - surroundings[None]) ** 2).sum(2)
    difference += _SIZE**2 * (size[:, None] - size[None]) ** 2
    i, j = regions.touching.T
    difference[i, j] = difference[j, i] = np.inf
    np.fill_diagonal(difference, np.inf)
    last = min(_KIN, len(size)) - 1
    farthest = np.partition(difference, last, axis=1)[:, last, None] + _ROUND_OFF
    alike = np.exp(-difference / (2 * _KIN_SCALE**2))
    leaps = np.where(difference <= farthest, _LEAP * alike, 0)  # all of a tie, whichever comes first
    return leaps * (1 - np.exp(-((on_the_way / _ONE_COLOR) ** 2)))


def _greatest_on_the_way(regions: Regions, color: NDArray[np.float64]) -> NDArray[np.float64]:
    """The least that the greatest difference of colour on any way between two regions can be; shape [K, K].

    Infinite where no way leads from one to the other.
    """
    count = len(regions.area)
    out = np.full((count, count), np.inf)
    np.fill_diagonal(out, 0)
    members = [[region] for region in range(count)]
    for edge in np.argsort(color, kind="stable"):  # as Kruskal's minimum spanning tree grows
        first, second = (members[region] for region in regions.touching[edge])
        if first is second:
            continue
        out[np.ix_(first, second)] = color[edge]
        out[np.ix_(second, first)] = color[edge]
        first.extend(second)
        for region in second:
            members[region] = first
    return out


def _smoothed(graph: PatchGraph, look: NDArray[np.float64]) -> NDArray[np.float64]:
    """Look of the patches with that of like neighbours mixed in, a bilateral filter on the graph; shape [S, 6]."""
    i, j = graph.touching.T
    for _ in range(_SMOOTHING_ROUNDS):
        alike = graph.border * np.exp(-((look[i] - look[j]) ** 2).sum(1) / (2 * _SMOOTHING_SCALE**2))
        look = _mixed(graph, look, alike)
    return look


def _surroundings(graph: PatchGraph, look: NDArray[np.float64]) -> NDArray[np.float64]:
    """Look of the patches blurred over all edges; shape [S, 6]."""
    for _ in range(_SURROUNDINGS_ROUNDS):
        look = _mixed(graph, look, graph.border)
    return look


def _mixed(graph: PatchGraph, look: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half of each patch's look and half of its neighbours', by the weights of the touching pairs; shape [S, 6]."""
    i, j = graph.touching.T
    neighbours = coo_matrix(
        (np.tile(weights, 2), (np.concatenate([i, j]), np.concatenate([j, i]))), (len(graph), len(graph))
    ).tocsr()
    total = np.asarray(neighbours.sum(1))
    own = np.maximum(total, 1)
    return (own * look + neighbours @ look) / (own + total)


def _between(regions: Regions, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of touching regions as a table, 0 where they do not touch; symmetric, shape [K, K]."""
    out = np.zeros((len(regions.area), len(regions.area)))
    i, j = regions.touching.T
    out[i, j] = out[j, i] = values
    return out
