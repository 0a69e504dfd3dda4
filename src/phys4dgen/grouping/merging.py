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
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from phys4dgen.grouping.supervoxels import Supervoxels

__all__ = ["MAX_PARTS", "CostWeights", "MergeTree", "cut_tree", "merge_tree"]

MAX_PARTS = 60
"""No cut gives more parts than this."""

_WARD_REGIONS = 300
_LEVEL = 20.0
"""Merges within a part cost less, merges of two parts more; chosen on the objects of docs/decisions/0008."""
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
    regions = _Regions(patches, weights)
    start = regions.feature.copy()
    merges: list[tuple[int, int, float]] = []
    _agglomerate(regions, merges, ward=True, until=min(_WARD_REGIONS, len(patches.area)))
    _agglomerate(regions, merges, ward=False, until=1)
    patch_of_gaussian = np.full(gaussian_count, -1, np.int32)
    patch_of_gaussian[patches.core] = patches.patch
    first, second = np.nonzero(np.triu(patches.border))
    return MergeTree(
        patch=patch_of_gaussian,
        kept=np.array([kept for kept, _, _ in merges], np.int32),
        absorbed=np.array([absorbed for _, absorbed, _ in merges], np.int32),
        cost=np.array([cost for _, _, cost in merges], np.float64),
        area=patches.area,
        feature=start,
        touching=np.stack([first, second], 1).astype(np.int32),
        border=patches.border[first, second],
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


class _Regions:
    """The regions while they are joined; a row of a table is a region, joined ones keep the row of the one kept."""

    def __init__(self, patches: Supervoxels, weights: CostWeights) -> None:
        self.weights = weights
        self.feature = np.concatenate([patches.mean, weights.thinness * patches.thinness[:, None]], 1)
        self.spread = patches.spread.copy()
        self.area = patches.area.copy()
        self.alive = np.ones(len(patches.area), np.bool_)
        self.border = patches.border.copy()
        i, j = np.nonzero(patches.border)
        self.contrast, self.crease = np.zeros_like(self.border), np.zeros_like(self.border)
        self.contrast[i, j] = self.border[i, j] * np.linalg.norm(self.feature[i] - self.feature[j], axis=1)
        self.crease[i, j] = self.border[i, j] * _crease(patches, i, j)

    def ward_cost(self, i: int) -> NDArray[np.float64]:
        """Growth of the variance within regions if one joins region i, touching ones only; shape [S]."""
        square = ((self.feature - self.feature[i]) ** 2).sum(1)
        cost = square * self.area[i] * self.area / (self.area[i] + self.area)
        return self._allowed(np.where(self.border[i] > 0, cost, np.inf), i)

    def part_cost(self, i: int) -> NDArray[np.float64]:
        """How unlike one part each region and region i are (module docstring); shape [S]."""
        w = self.weights
        color = ((self.feature - self.feature[i]) ** 2).sum(1)
        texture = ((self.spread - self.spread[i]) ** 2).sum(1)
        distance = np.sqrt(color + w.texture * texture)
        length = np.maximum(self.border[i], 1)  # in neighbour pairs, so never between 0 and 1
        touching = (1 - w.border) * distance + w.border * self.contrast[i] / length
        touching *= 1 + w.crease * self.crease[i] / length
        distance = np.where(self.border[i] > 0, touching, w.apart * distance)
        common = self.area[i] * self.area / (self.area[i] + self.area)
        size = np.minimum((common / w.area_reference) ** w.area_power, w.area_factor_max)
        return self._allowed(distance * size, i)

    def join(self, i: int, j: int) -> None:
        """Add region j to region i."""
        total = self.area[i] + self.area[j]
        share = self.area[j] / total
        self.feature[i] += share * (self.feature[j] - self.feature[i])
        self.spread[i] = np.sqrt((1 - share) * self.spread[i] ** 2 + share * self.spread[j] ** 2)
        self.area[i] = total
        self.alive[j] = False
        for table in (self.border, self.contrast, self.crease):
            table[i] += table[j]
            table[i, i] = 0
            table[:, i] = table[i]

    def _allowed(self, cost: NDArray[np.float64], i: int) -> NDArray[np.float64]:
        cost[~self.alive] = np.inf
        cost[i] = np.inf
        return cost


def _agglomerate(regions: _Regions, merges: list[tuple[int, int, float]], *, ward: bool, until: int) -> None:
    """Join the cheapest pair until ``until`` regions are left or no pair may join; append every merge to ``merges``.

    Every region remembers its cheapest partner, so that a merge looks again only at rows that knew one of the pair.
    """
    row_cost = regions.ward_cost if ward else regions.part_cost
    alive = regions.alive
    table = np.full(regions.border.shape, np.inf)
    for i in np.flatnonzero(alive):
        table[i] = row_cost(int(i))
    partner = table.argmin(1)
    best = table.min(1)
    for _ in range(int(alive.sum()) - until):
        i = int(best.argmin())
        j = int(partner[i])
        if not np.isfinite(best[i]):  # by Ward's criterion: no touching regions are left
            return
        merges.append((i, j, 0.0 if ward else float(best[i])))
        regions.join(i, j)
        row = row_cost(i)
        table[j], table[:, j], best[j] = np.inf, np.inf, np.inf
        table[i], table[:, i] = row, row
        stale = alive & ((partner == i) | (partner == j))
        stale[i] = True
        rows = np.flatnonzero(stale)
        partner[rows] = table[rows].argmin(1)
        best[rows] = table[rows, partner[rows]]
        closer = alive & ~stale & (row < best)
        partner[closer], best[closer] = i, row[closer]
