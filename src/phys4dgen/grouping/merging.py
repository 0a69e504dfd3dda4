"""From a thousand patches to a few parts: a merge tree that can be cut at any number of parts.

First neighbouring patches are joined by Ward's criterion (J. Ward, "Hierarchical Grouping to Optimize an Objective
Function", 1963) until a few hundred are left; then any two regions may join, cheapest pair first. The cost of a pair
grows with the difference of colour and of texture, with the contrast along the common border and with a concave crease
there, and slowly with the size of the smaller one. Regions that do not touch may join too: the petals of a flower, the
two halves of a bun.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from phys4dgen.grouping.supervoxels import Supervoxels

__all__ = ["MAX_PARTS", "CostWeights", "MergeTree", "cut_tree", "merge_tree"]

MAX_PARTS = 60
"""No cut gives more parts than this."""

_WARD_REGIONS = 300
_LEVEL = 20.0
"""Merges within a part cost less than this, merges of two parts cost more."""
_MIN_AREA = 0.004
"""A region smaller than this share of the surface is a crumb and joins the part nearest in colour."""
_CRUMB_APART_FACTOR = 2.0
"""How much less welcome a crumb is in a part that it does not touch."""

_FLECK_AREA = 0.01
"""Largest share of the surface of an island that may be a fleck on another part."""
_FLECK_SHARE = 0.05
"""A fleck is smaller than this share of its part's largest connected piece."""
_FLECK_THINNESS = 11.0
"""Largest difference of weighted thinness between a fleck and the part it lies in."""
_CREASE_FREE = 0.15
"""Concavity that curved surfaces have anyway."""
_NEVER = 1e30


class CostWeights(NamedTuple):
    """What makes two regions unlike one part.

    Attributes:
        thinness: units of colour that a leaf and a solid of one colour lie apart.
        texture: weight of the difference of spreads, squared, beside that of the means.
        border: share of the contrast along the common border in the distance of touching regions.
        crease: how much a full concave crease adds to the distance.
        apart: factor for regions that do not touch.
        area_reference: share of the surface at which the size of the pair neither hinders nor helps.
        area_power: how slowly the cost grows with the size of the pair.
        area_factor_max: largest factor for size.
    """

    thinness: float = 22.0
    texture: float = 0.25
    border: float = 0.4
    crease: float = 0.5
    apart: float = 1.1
    area_reference: float = 0.05
    area_power: float = 0.25
    area_factor_max: float = 1.5


@dataclass(frozen=True, eq=False)
class MergeTree:
    """How S patches join, one pair at a time, into one; plain arrays, so that it can be kept in a file.

    Attributes:
        patch: patch of every Gaussian that is visible surface, -1 elsewhere, shape [N].
        kept: patch number that goes on to name the joined region, shape [S - 1].
        absorbed: patch number that is not used any more, shape [S - 1].
        cost: of each merge, 0 for those by Ward's criterion, shape [S - 1].
        area: share of the surface of each patch, shape [S].
        feature: mean colour (weighted L, a, b) and weighted thinness of each patch, shape [S, 4].
        touching: pairs of patches with a common border, shape [E, 2].
        border: length of that border in neighbour pairs, shape [E].
    """

    patch: NDArray[np.int32]
    kept: NDArray[np.int32]
    absorbed: NDArray[np.int32]
    cost: NDArray[np.float64]
    area: NDArray[np.float64]
    feature: NDArray[np.float64]
    touching: NDArray[np.int32]
    border: NDArray[np.float64]

    def arrays(self) -> dict[str, NDArray[np.int32] | NDArray[np.float64]]:
        """All fields by name, for ``numpy.savez``; ``MergeTree(**arrays)`` is the way back."""
        return dict(vars(self))


def merge_tree(patches: Supervoxels, gaussian_count: int, *, weights: CostWeights = CostWeights()) -> MergeTree:
    """Join all patches, cheapest pair first, and remember the order."""
    i, j = np.nonzero(patches.border)
    weight = patches.border[i, j]
    feature = np.concatenate([patches.mean, weights.thinness * patches.thinness[:, None]], 1)
    contrast, crease = np.zeros_like(patches.border), np.zeros_like(patches.border)
    contrast[i, j] = weight * np.linalg.norm(feature[i] - feature[j], axis=1)
    crease[i, j] = weight * _crease(patches, i, j)
    kept, absorbed, cost = _agglomerate(
        feature.copy(), patches.spread.copy(), patches.area.copy(), patches.border.copy(), contrast, crease, weights
    )
    patch_of_gaussian = np.full(gaussian_count, -1, np.int32)
    patch_of_gaussian[patches.core] = patches.patch
    upper = i < j
    return MergeTree(
        patch=patch_of_gaussian,
        kept=kept.astype(np.int32),
        absorbed=absorbed.astype(np.int32),
        cost=cost,
        area=patches.area,
        feature=feature,
        touching=np.stack([i[upper], j[upper]], 1).astype(np.int32),
        border=weight[upper],
    )


def cut_tree(tree: MergeTree, parts: int | None = None) -> NDArray[np.int64]:
    """Part of every patch, numbered 0 .. G-1 in no particular order; shape [S].

    Args:
        tree: from ``merge_tree``.
        parts: number of parts wished for (fewer where the tree holds fewer); None decides by cost.
    """
    patch_count = len(tree.area)
    if parts is None:
        running = np.maximum.accumulate(tree.cost)
        regions = min(patch_count - int(np.searchsorted(running, _LEVEL)), MAX_PARTS)
    else:
        regions = min(max(parts, 1), patch_count)
        while regions < min(MAX_PARTS, patch_count) and _large_regions(tree, regions) < parts:
            regions += 1
    return _join_flecks(tree, _join_crumbs(tree, _regions_at(tree, regions), parts))


def _regions_at(tree: MergeTree, regions: int) -> NDArray[np.int64]:
    """Region of every patch when ``regions`` are left, 0 .. regions-1."""
    label = np.arange(len(tree.area))
    for step in range(len(tree.area) - regions):
        label[label == tree.absorbed[step]] = tree.kept[step]
    return np.unique(label, return_inverse=True)[1]


def _large_regions(tree: MergeTree, regions: int) -> int:
    """How many of the regions at that level are no crumbs."""
    return int((np.bincount(_regions_at(tree, regions), tree.area) >= _MIN_AREA).sum())


def _join_crumbs(tree: MergeTree, label: NDArray[np.int64], parts: int | None) -> NDArray[np.int64]:
    """Give the smallest region to the one nearest in colour until none is a crumb and the number is right."""
    while True:
        area = np.bincount(label, tree.area)
        smallest = int(area.argmin())
        if len(area) == 1 or (area[smallest] >= _MIN_AREA and (parts is None or len(area) <= parts)):
            return label
        mean = np.stack([np.bincount(label, tree.area * channel) for channel in tree.feature.T], 1) / area[:, None]
        distance = np.linalg.norm(mean - mean[smallest], axis=1)
        sides = label[tree.touching]
        neighbours = np.concatenate([sides[sides[:, 0] == smallest, 1], sides[sides[:, 1] == smallest, 0]])
        distance[np.setdiff1d(np.arange(len(area)), neighbours)] *= _CRUMB_APART_FACTOR
        distance[smallest] = np.inf
        label = np.unique(np.where(label == smallest, int(distance.argmin()), label), return_inverse=True)[1]


def _join_flecks(tree: MergeTree, label: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give small islands of a part to the part that they lie in, unless one is thin and the other is not.

    A dark stain or shadow on a pot has the colour of the soil and would be soil; a leaf that hangs in front of the pot
    touches nothing else either, and is told from a stain by being thin.
    """
    a, b = tree.touching.T
    inside = label[a] == label[b]
    graph = coo_matrix((np.ones(inside.sum()), (a[inside], b[inside])), (len(label), len(label)))
    island = connected_components(graph, directed=False)[1]
    area = np.bincount(island, tree.area)
    thinness = np.bincount(island, tree.area * tree.feature[:, 3]) / area
    part = np.zeros(len(area), np.int64)
    part[island] = label
    largest = np.zeros(int(label.max()) + 1)
    np.maximum.at(largest, part, area)
    part_area = np.bincount(label, tree.area)
    part_thinness = np.bincount(label, tree.area * tree.feature[:, 3]) / part_area
    border = np.zeros((len(area), len(largest)))
    np.add.at(border, (island[a], label[b]), tree.border * ~inside)
    np.add.at(border, (island[b], label[a]), tree.border * ~inside)
    around = border.argmax(1)
    fleck = (area < _FLECK_AREA) & (area < _FLECK_SHARE * largest[part]) & (border.max(1) > 0)
    alike = np.abs(thinness - part_thinness[around]) < _FLECK_THINNESS
    return np.where(fleck & alike, around, part)[island]


def _crease(patches: Supervoxels, i: NDArray[np.intp], j: NDArray[np.intp]) -> NDArray[np.float64]:
    """How much the surface folds inwards between touching flat patches, in [-0.5, 1]; negative on convex edges."""
    direction = patches.centre[j] - patches.centre[i]
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    concavity = ((patches.normal[i] - patches.normal[j]) * direction).sum(1)
    flatness = np.minimum(patches.flatness[i], patches.flatness[j])
    return np.clip(concavity - _CREASE_FREE, -0.5, 1) * flatness


@njit(cache=True)
def _ward_cost(i, j, feature, area, border):  # pyright: ignore
    """Growth of the within-region variance of colour, touching regions only."""
    if border[i, j] == 0:
        return _NEVER
    square = 0.0
    for q in range(feature.shape[1]):
        square += (feature[i, q] - feature[j, q]) ** 2
    return square * area[i] * area[j] / (area[i] + area[j])


@njit(cache=True)
def _part_cost(i, j, feature, spread, area, border, contrast, crease, weights):  # pyright: ignore
    """How unlike one part two regions are (module docstring)."""
    color, texture = 0.0, 0.0
    for q in range(feature.shape[1]):
        color += (feature[i, q] - feature[j, q]) ** 2
    for q in range(spread.shape[1]):
        texture += (spread[i, q] - spread[j, q]) ** 2
    distance = np.sqrt(color + weights.texture * texture)
    if border[i, j] > 0:
        distance = (1 - weights.border) * distance + weights.border * contrast[i, j] / border[i, j]
        distance *= 1 + weights.crease * crease[i, j] / border[i, j]
    else:
        distance *= weights.apart
    common = area[i] * area[j] / (area[i] + area[j])
    return distance * min((common / weights.area_reference) ** weights.area_power, weights.area_factor_max)


@njit(cache=True)
def _agglomerate(feature, spread, area, border, contrast, crease, weights):  # pyright: ignore
    """Join the cheapest pair until one region is left; overwrites its arguments.

    Every region remembers its cheapest partner, so that a merge looks again only at rows that knew one of the pair.
    """
    count = len(area)
    alive = np.ones(count, np.bool_)
    kept = np.zeros(max(count - 1, 0), np.int64)
    absorbed = np.zeros(max(count - 1, 0), np.int64)
    costs = np.zeros(max(count - 1, 0))
    table = np.full((count, count), _NEVER)
    partner = np.zeros(count, np.int64)
    step = 0
    for ward in (True, False):
        for i in range(count):
            for j in range(i):
                if alive[i] and alive[j]:
                    if ward:
                        table[i, j] = _ward_cost(i, j, feature, area, border)
                    else:
                        table[i, j] = _part_cost(i, j, feature, spread, area, border, contrast, crease, weights)
                    table[j, i] = table[i, j]
        for i in range(count):
            partner[i] = np.argmin(table[i])
        last = min(count - _WARD_REGIONS, count - 1) if ward else count - 1
        while step < last:
            i = 0
            for q in range(count):
                if table[q, partner[q]] < table[i, partner[i]]:
                    i = q
            j = partner[i]
            if table[i, j] >= _NEVER:  # Ward's phase: no touching regions are left
                break
            kept[step], absorbed[step] = i, j
            costs[step] = 0.0 if ward else table[i, j]
            step += 1
            total = area[i] + area[j]
            for q in range(feature.shape[1]):
                feature[i, q] = (area[i] * feature[i, q] + area[j] * feature[j, q]) / total
            for q in range(spread.shape[1]):
                spread[i, q] = np.sqrt((area[i] * spread[i, q] ** 2 + area[j] * spread[j, q] ** 2) / total)
            area[i] = total
            alive[j] = False
            for q in range(count):
                border[i, q] += border[j, q]
                contrast[i, q] += contrast[j, q]
                crease[i, q] += crease[j, q]
                border[q, i], contrast[q, i], crease[q, i] = border[i, q], contrast[i, q], crease[i, q]
                table[j, q] = _NEVER
                table[q, j] = _NEVER
            border[i, i], contrast[i, i], crease[i, i] = 0.0, 0.0, 0.0
            for q in range(count):
                if alive[q] and q != i:
                    if ward:
                        table[i, q] = _ward_cost(i, q, feature, area, border)
                    else:
                        table[i, q] = _part_cost(i, q, feature, spread, area, border, contrast, crease, weights)
                    table[q, i] = table[i, q]
            for q in range(count):
                if alive[q]:
                    if q == i or partner[q] == i or partner[q] == j:
                        partner[q] = np.argmin(table[q])
                    elif table[q, i] < table[q, partner[q]]:
                        partner[q] = i
    return kept, absorbed, costs
