"""Regions: patches of one look that pass into each other without a fold, joined while little speaks against it.

Between two patches colour and crease are mostly noise; along the whole border of two regions the noise averages out. So
touching patches are joined, cheapest pair first, by what lies along their common border (as contours are weighed by
Arbelaez, Maire, Fowlkes and Malik, "Contour Detection and Hierarchical Image Segmentation", IEEE PAMI 33(5), 2011).
Once regions are wide enough, creases are measured anew: from the normals of all patches on either side that lie near,
those of one patch being blurred where it straddles the fold.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from itertools import chain
from math import dist, hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import KDTree

from phys4dgen.grouping.patch_graph import CREASE_FREE, PatchGraph

__all__ = ["Regions", "describe_regions", "folds_between", "join_order", "regions_at"]

_CREASE = 40.0
"""Difference that a full concave crease is worth, in units of colour."""
_SMALL = 0.002
"""Share of the surface up to which a region joins more easily the smaller it is ..."""
_SIZE_POWER = 0.2
"""... by this power of its size ..."""
_SIZES = (1e-3, 25.0)
"""... between these multiples of the small size."""
_MEASURED_ANEW = 200
"""Number of regions at which creases are measured again from the regions."""
_REACH = 2.0
"""Distance up to which patches say how the surface lies beside a border, in widths of a patch."""
_THICKNESS = 5
"""Column of the look that says how thick the object is. It counts less the sharper a convex edge is: a slab is thin
below its top and wide behind its rim, and one thing. Parts meet in concave creases (D. Hoffman and W. Richards, "Parts
of Recognition", Cognition 18, 1984)."""
_CONVEX = (-0.18, -0.33)
"""Creases from which an edge is convex, and up to which it is not yet wholly sharp."""
_SAME_SIDE = 0.3
"""Patches whose normals lie further than a right angle, and by this cosine, from that of the border say nothing."""


class Regions(NamedTuple):
    """K regions and the B pairs of them that touch.

    Attributes:
        area: share of the surface, shape [K].
        look: mean of the look of the patches, shape [K, D].
        touching: pairs of regions, shape [B, 2].
        length: of their common border, shape [B].
        contrast: difference of look along it, shape [B].
        difference: of the two regions' mean look, shape [B].
        crease: how much the surface folds inwards there, between patches, in [-0.5, 1], shape [B].
        fold: the same measured from all that lies near on both sides, shape [B].
    """

    area: NDArray[np.float64]
    look: NDArray[np.float64]
    touching: NDArray[np.int64]
    length: NDArray[np.float64]
    contrast: NDArray[np.float64]
    difference: NDArray[np.float64]
    crease: NDArray[np.float64]
    fold: NDArray[np.float64]


def describe_regions(
    graph: PatchGraph, region: NDArray[np.int64], look: NDArray[np.float64], *, folds: NDArray[np.float64] | None = None
) -> Regions:
    """Regions in numbers.

    Args:
        graph: S patches.
        region: region of each, 0 .. K-1, shape [S].
        look: of each, smoothed, shape [S, D].
        folds: of each touching pair of patches, shape [E]; measured from all that lies near unless given.
    """
    count = int(region.max()) + 1
    i, j = graph.touching.T
    between = np.flatnonzero(region[i] != region[j])
    lower, upper = np.sort(region[graph.touching[between]], axis=1).T
    pair, border_of = np.unique(lower * count + upper, return_inverse=True)
    length = np.bincount(border_of, graph.border[between], len(pair)).astype(np.float64)

    def along(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(border_of, graph.border[between] * values, len(pair)) / length

    area = np.bincount(region, graph.area, count).astype(np.float64)
    means = np.stack([np.bincount(region, graph.area * column, count) for column in look.T], 1) / area[:, None]
    crease = along(graph.crease[between])
    convex = np.clip((crease - _CONVEX[0]) / (_CONVEX[1] - _CONVEX[0]), 0, 1)
    counted = np.ones((len(pair), look.shape[1]))
    counted[:, _THICKNESS:] -= convex[:, None]
    return Regions(
        area=area,
        look=means,
        touching=np.stack([pair // count, pair % count], 1),
        length=length,
        contrast=along(np.linalg.norm((look[i[between]] - look[j[between]]) * counted[border_of], axis=1)),
        difference=np.linalg.norm((means[pair // count] - means[pair % count]) * counted, axis=1),
        crease=crease,
        fold=along(folds_between(graph, region, between) if folds is None else folds[between]),
    )


def join_order(graph: PatchGraph, look: NDArray[np.float64], *, along_border: float = 0.7) -> list[tuple[int, int]]:
    """In which order touching patches join: the number that goes on to name both, and the one no longer used.

    Args:
        graph: S patches.
        look: of each, smoothed, shape [S, D].
        along_border: share of the contrast along the border in the difference; the rest is that of the means.
    """
    patches = describe_regions(graph, np.arange(len(graph)), look, folds=graph.crease)
    order = _join(patches, along_border)[: max(len(graph) - _MEASURED_ANEW, 0)]
    name = _names(len(graph), order)
    names, region = np.unique(name, return_inverse=True)
    regions = describe_regions(graph, region, look)
    return order + [(int(names[kept]), int(names[absorbed])) for kept, absorbed in _join(regions, along_border)]


def regions_at(order: list[tuple[int, int]], seeds: NDArray[np.intp], count: int) -> NDArray[np.int64]:
    """Region of each patch when about ``count`` are left; those with clicks of several parts stay divided. Shape [S].

    Args:
        order: from ``join_order``.
        seeds: part of each patch that is known, -1 elsewhere, shape [S].
        count: number of regions aimed at.
    """
    left = len(seeds)
    part = [int(seed) for seed in seeds]
    divided = [False] * len(seeds)
    joined = []
    for kept, absorbed in order:
        if left <= count:
            break
        contested = part[kept] >= 0 and part[absorbed] >= 0 and part[kept] != part[absorbed]
        if contested or divided[kept] or divided[absorbed]:
            divided[kept] = True
            continue
        joined.append((kept, absorbed))
        part[kept] = max(part[kept], part[absorbed])
        left -= 1
    return np.unique(_names(len(seeds), joined), return_inverse=True)[1]


def _names(count: int, order: list[tuple[int, int]]) -> NDArray[np.int64]:
    """Patch that names the region of each of ``count`` patches after some have joined, shape [count]."""
    name = np.arange(count)
    for kept, absorbed in reversed(order):  # whoever absorbed it has its last name already
        name[absorbed] = name[kept]
    return name


def _join(regions: Regions, along_border: float) -> list[tuple[int, int]]:
    """Order in which touching regions join, cheapest pair first; what lies along their borders is averaged."""
    area = regions.area.tolist()
    look: list[tuple[float, ...]] = list(map(tuple, regions.look.tolist()))
    touching = regions.touching.tolist()
    border: list[dict[int, tuple[float, float, float]]] = [{} for _ in area]  # length; contrast and fold times length
    sums = regions.length[:, None] * np.stack([np.ones(len(touching)), regions.contrast, regions.fold], 1)
    for (i, j), along in zip(touching, map(tuple, sums.tolist()), strict=True):
        border[i][j] = border[j][i] = along
    version = [0] * len(area)

    def offer(i: int, j: int) -> tuple[float, int, int, int, int]:
        length, contrast, fold = border[i][j]
        color = along_border * contrast / length + (1 - along_border) * dist(look[i], look[j])
        size = min(max(min(area[i], area[j]) / _SMALL, _SIZES[0]), _SIZES[1]) ** _SIZE_POWER
        i, j = min(i, j), max(i, j)
        return hypot(color, _CREASE * max(fold / length, 0.0)) * size, i, j, version[i], version[j]

    offers = [offer(i, j) for i, j in touching]
    heapify(offers)
    order = []
    while offers:
        _, i, j, version_i, version_j = heappop(offers)
        if (version[i], version[j]) != (version_i, version_j):
            continue  # one of them has grown or gone since
        kept, absorbed = (i, j) if len(border[i]) >= len(border[j]) else (j, i)
        order.append((kept, absorbed))
        share = area[absorbed] / (area[kept] + area[absorbed])
        look[kept] = tuple((1 - share) * a + share * b for a, b in zip(look[kept], look[absorbed], strict=True))
        area[kept] += area[absorbed]
        del border[kept][absorbed]
        for other, (length, contrast, fold) in border[absorbed].items():
            if other != kept:
                del border[other][absorbed]
                more = border[kept].get(other, (0.0, 0.0, 0.0))
                border[kept][other] = border[other][kept] = (more[0] + length, more[1] + contrast, more[2] + fold)
        border[absorbed] = {}
        version[kept] += 1
        version[absorbed] = -1
        for other in border[kept]:
            heappush(offers, offer(kept, other))
    return order


def folds_between(graph: PatchGraph, region: NDArray[np.int64], between: NDArray[np.intp]) -> NDArray[np.float64]:
    """Creases between touching patches of different regions, from all patches of the two regions that lie near.

    Args:
        graph: S patches.
        region: of each, shape [S].
        between: which of the touching pairs to measure, shape [B].

    Returns:
        How much the surface folds inwards, in [-0.5, 1], shape [B].
    """
    if not len(between):
        return np.zeros(0)
    i, j = graph.touching[between].T
    apart = graph.centre[graph.touching[:, 0]] - graph.centre[graph.touching[:, 1]]
    centre = graph.centre / max(float(np.median(np.linalg.norm(apart, axis=1))), 1e-12)
    middle = (centre[i] + centre[j]) / 2
    found = KDTree(centre).query_ball_point(middle, 2 * _REACH, return_sorted=True)
    ends = np.cumsum([0, *map(len, found)])
    near = np.fromiter(chain.from_iterable(found), np.int64, ends[-1])
    border = np.repeat(np.arange(len(between)), np.diff(ends))
    distance = ((centre[near] - middle[border]) ** 2).sum(1)
    weight = (graph.area * graph.flatness**2 + 1e-9)[near] * np.exp(-distance / _REACH**2)

    def beside(patch: NDArray[np.int32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean normal and place of what lies near each border in the region of ``patch``."""
        facing = (graph.normal[near] * graph.normal[patch][border]).sum(1)
        counted = weight * (region[near] == region[patch][border]) * np.clip(facing + _SAME_SIDE, 0, 1)
        weights = csr_matrix((counted, near, ends), (len(between), len(graph)))
        total = np.maximum(np.asarray(weights.sum(1)).reshape(-1, 1), 1e-12)
        return weights @ graph.normal / total, weights @ centre / total

    normal_i, place_i = beside(i)
    normal_j, place_j = beside(j)
    direction = place_j - place_i
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9)
    return np.clip(((normal_i - normal_j) * direction).sum(1) - CREASE_FREE, -0.5, 1)
