"""From a thousand patches to a few parts: a merge tree that can be cut at any number of parts.

First neighbouring patches are joined by Ward's criterion (J. Ward, "Hierarchical Grouping to Optimize an Objective
Function", 1963) until a few hundred are left; then any two regions may join, cheapest pair first. The cost of a pair
grows with the difference of colour and of texture, with the contrast along the common border, with a concave crease and
a narrow neck there, and slowly with the size of the smaller one. It shrinks where two regions are interlaced, as the
stripes of a scarf are, and where the surface passes smoothly from one to the other: that is paint, or a shadow, and not
the end of a thing. Regions that do not touch may join too: the petals of a flower, the two halves of a bun; but not
easily where only creases part what is of one colour (``detour``).

The order of the merges says what to part first when a number of parts is asked for. Without one, what touches and has
one colour is one part whatever the crease, as the head of a statue on its body: every merge therefore also bears what
it would cost without that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from phys4dgen.errors import StageError
from phys4dgen.grouping.detour import crease_detours
from phys4dgen.grouping.patch_graph import PatchGraph

__all__ = ["CostWeights", "MergeTree", "merge_tree", "tree_from_arrays"]

_WARD_REGIONS = 300
_FLAT = -0.2
"""Crease (``PatchGraph``) of a surface that passes smoothly over the border of two patches: solids are convex."""
_SMOOTH_BEND = (0.08, 0.22)
"""Mean difference from that along a border up to which it is smooth, and from which it is not. Along borders of paint
it was .05 to .2, where two parts meet .25 to .6."""
_SHEET = 8.0
"""Weighted thinness of a leaf or a petal: their edges are not folded anyway."""


class CostWeights(NamedTuple):
    """What makes two regions unlike one part.

    Attributes:
        texture: weight of the difference of spreads, squared, beside that of the means.
        border: share of the contrast along the common border in the distance of touching regions.
        crease: how much a full concave crease adds to the distance.
        fold: colour difference that a full concave crease is worth by itself.
        neck: colour difference that touching in a single point is worth by itself, for large regions.
        neck_width: contact, over the side of the smaller region, from which there is no neck.
        neck_area: share of the surface from which a region is large.
        interlaced: power by which a border longer than a compact region has makes two regions one.
        apart: factor for regions that do not touch.
        unequal: how much regions of unequal size that do not touch are less one part, by the logarithm of the ratio.
        area_reference: share of the surface at which the size of the pair neither hinders nor helps.
        area_power: how slowly the cost grows with the size of the pair.
        area_factor_max: largest factor for size.
        smooth: share of the distance that is taken off where the surface passes smoothly over the border.
        detour: colour difference that creases between regions of one colour that do not touch are worth, per unit of
            ``crease_detours``.
        one_color: cost of colour and texture alone up to which regions that touch look like one.
    """

    texture: float = 0.25
    border: float = 0.4
    crease: float = 0.5
    fold: float = 20.0
    neck: float = 10.0
    neck_width: float = 0.35
    neck_area: float = 0.02
    interlaced: float = 1.0
    apart: float = 1.1
    unequal: float = 0.05
    area_reference: float = 0.05
    area_power: float = 0.18
    area_factor_max: float = 1.5
    smooth: float = 0.7
    detour: float = 120.0
    one_color: float = 7.0


_MERGE_ARRAYS = ("kept", "absorbed", "cost", "look_cost")


@dataclass(frozen=True, eq=False)
class MergeTree:
    """How the patches join, one pair at a time, into one.

    Attributes:
        graph: the S patches.
        kept: patch number that goes on to name the joined region, shape [S - 1].
        absorbed: patch number that is not used any more, shape [S - 1].
        cost: of each merge, 0 for those by Ward's criterion, shape [S - 1].
        look_cost: the same without detours, and 0 where the two touch and have one colour, shape [S - 1].
    """

    graph: PatchGraph
    kept: NDArray[np.int32]
    absorbed: NDArray[np.int32]
    cost: NDArray[np.float64]
    look_cost: NDArray[np.float64]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All numbers by name, for ``groups_tree.npz``; ``tree_from_arrays`` is the way back."""
        return {**vars(self.graph), **{name: getattr(self, name) for name in _MERGE_ARRAYS}}


def tree_from_arrays(arrays: Mapping[str, NDArray[Any]], gaussian_count: int) -> MergeTree:
    """The tree that ``MergeTree.arrays`` wrote, for the same Gaussians.

    Raises:
        StageError: an array is missing, or they do not make a tree of ``gaussian_count`` Gaussians.
    """
    graph_names = [field.name for field in fields(PatchGraph)]
    missing = [name for name in (*graph_names, *_MERGE_ARRAYS) if name not in arrays]
    if missing:
        raise StageError(f"groups_tree.npz: expected an array called {missing[0]}, got none; run grouping again.")
    graph = PatchGraph(**{name: arrays[name] for name in graph_names})
    tree = MergeTree(graph, **{name: arrays[name] for name in _MERGE_ARRAYS})
    count = len(graph)
    numbers_fit = (
        graph.patch.shape == graph.visible.shape == (gaussian_count,)
        and graph.color.shape == (gaussian_count, 3)
        and graph.visible.dtype == np.bool_
        and graph.feature.shape == (count, 5)
        and graph.spread.shape == graph.centre.shape == graph.normal.shape == (count, 3)
        and graph.flatness.shape == (count,)
        and graph.diameter.shape == (count,)
        and graph.touching.ndim == 2
        and all(len(array) == len(graph.touching) for array in (graph.border, graph.crease))
        and all(len(array) == count - 1 for array in (tree.kept, tree.absorbed, tree.cost, tree.look_cost))
        and all(
            array.dtype.kind in "iu" and array.max(initial=0) < count and array.min(initial=0) >= -1
            for array in (graph.patch, graph.touching, tree.kept, tree.absorbed)
        )
    )
    if not numbers_fit:
        raise StageError(
            f"groups_tree.npz: expected the merge tree of these {gaussian_count} Gaussians, got one of "
            f"{len(graph.patch)}; run grouping again."
        )
    return tree


class _Merge(NamedTuple):
    """One merge: the patches that name the two regions, and what it cost (``MergeTree``)."""

    kept: int
    absorbed: int
    cost: float = 0.0
    look_cost: float = 0.0


def merge_tree(graph: PatchGraph, *, weights: CostWeights = CostWeights()) -> MergeTree:
    """Join all patches, cheapest pair first, and remember the order."""
    merges: list[_Merge] = []
    regions = _Regions(graph, weights)
    _agglomerate(regions, merges, ward=True, until=min(_WARD_REGIONS, len(graph)))
    regions.measure_detours(graph, merges)
    _agglomerate(regions, merges, ward=False, until=1)
    return MergeTree(
        graph=graph,
        kept=np.array([merge.kept for merge in merges], np.int32),
        absorbed=np.array([merge.absorbed for merge in merges], np.int32),
        cost=np.array([merge.cost for merge in merges], np.float64),
        look_cost=np.array([merge.look_cost for merge in merges], np.float64),
    )


class _Regions:
    """The regions while they are joined; a row of a table is a region, joined ones keep the row of the one kept."""

    def __init__(self, graph: PatchGraph, weights: CostWeights) -> None:
        count = len(graph)
        self.weights = weights
        self.feature = graph.feature.copy()
        self.spread = graph.spread.copy()
        self.area = graph.area.copy()
        self.alive = np.ones(count, np.bool_)
        self.border, self.contrast, self.crease, self.bend = (np.zeros((count, count)) for _ in range(4))
        i, j = graph.touching.T
        contrast = np.linalg.norm(self.feature[i] - self.feature[j], axis=1)
        bend = np.abs(graph.crease - _FLAT)
        for table, values in (
            (self.border, 1), (self.contrast, contrast), (self.crease, graph.crease), (self.bend, bend),
        ):  # fmt: skip
            table[i, j] = table[j, i] = graph.border * values
        self.detour, self.look_cost = np.zeros((count, count)), np.zeros((count, count))
        # Neighbour pairs around a compact region whose area is the whole surface's.
        around = self.border.sum(1)
        self.side = float(np.median(around[around > 0]) / np.sqrt(np.median(graph.area))) if around.any() else 1.0

    def measure_detours(self, graph: PatchGraph, merges: list[_Merge]) -> None:
        """Look for creases on the ways between the regions of all patches after some merges.

        The table sums over pairs of patches by their areas; those within one region are on the diagonal.
        """
        row = np.arange(len(graph))
        for merge in merges:
            row[row == merge.absorbed] = merge.kept
        detours = crease_detours(graph, np.unique(row, return_inverse=True)[1])
        of_region = csr_matrix((graph.area, (row, np.arange(len(graph)))), (len(graph), len(graph)))
        self.detour = of_region @ (of_region @ detours).T

    def ward_cost(self, i: int) -> NDArray[np.float64]:
        """Growth of the variance within regions if one joins region i, touching ones only; shape [S]."""
        square = ((self.feature - self.feature[i]) ** 2).sum(1) + self._fold(i) ** 2
        cost = square * self.area[i] * self.area / (self.area[i] + self.area)
        return self._allowed(np.where(self.border[i] > 0, cost, np.inf), i)

    def part_cost(self, i: int) -> NDArray[np.float64]:
        """How unlike one part each region and region i are (module docstring); shape [S]."""
        w = self.weights
        color = ((self.feature - self.feature[i]) ** 2).sum(1)
        texture = ((self.spread - self.spread[i]) ** 2).sum(1)
        distance = np.sqrt(color + w.texture * texture)
        common = self.area[i] * self.area / (self.area[i] + self.area)
        size = np.minimum((common / w.area_reference) ** w.area_power, w.area_factor_max)
        touches = self.border[i] > 0
        touching = self._touching(i, distance)
        apart = w.apart * distance * (1 + w.unequal * np.abs(np.log(self.area / self.area[i])))
        one_color = touches & (distance * size < w.one_color)
        self.look_cost[i] = np.where(one_color, 0, np.where(touches, touching, apart) * size)
        self.look_cost[:, i] = self.look_cost[i]
        return self._allowed(np.where(touches, touching, np.hypot(apart, self._detour(i))) * size, i)

    def _touching(self, i: int, distance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance from region i of regions that touch it, by colour and by the common border; shape [S]."""
        w = self.weights
        length = self._length(i)
        touching = (1 - w.border) * distance + w.border * self.contrast[i] / length
        touching *= 1 + w.crease * self.crease[i] / length
        smaller = np.minimum(self.area[i], self.area)
        contact = self.border[i] / (self.side * np.sqrt(smaller))  # over the side of a compact region of that area
        wide = np.clip(contact / w.neck_width, 0, 1)
        full, none = _SMOOTH_BEND
        touching *= 1 - w.smooth * wide * np.clip((none - self.bend[i] / length) / (none - full), 0, 1) * self._solid(i)
        large = np.minimum(smaller / w.neck_area, 1)
        touching = np.sqrt(touching**2 + self._fold(i) ** 2 + large * (w.neck * (1 - wide)) ** 2)
        return touching / np.maximum(contact, 1) ** w.interlaced

    def _detour(self, i: int) -> NDArray[np.float64]:
        """What creases on the ways to region i are worth in units of colour, beyond those within; shape [S]."""
        between = self.detour[i] / (self.area[i] * self.area)
        within = np.diag(self.detour) / self.area**2
        beyond = np.clip(between - np.maximum(within, within[i]), 0, 1)
        return self.weights.detour * beyond * self._solid(i)

    def _solid(self, i: int) -> NDArray[np.float64]:
        """1 where neither region nor region i is a sheet, 0 where one is; shape [S]."""
        return np.clip(1 - np.maximum(self.feature[:, 3], self.feature[i, 3]) / _SHEET, 0, 1)

    def _length(self, i: int) -> NDArray[np.float64]:
        """Border with region i in neighbour pairs, 1 where there is none; shape [S]."""
        return np.maximum(self.border[i], 1)  # never between 0 and 1

    def _fold(self, i: int) -> NDArray[np.float64]:
        """What the concave crease on the border with region i is worth in units of colour; shape [S]."""
        return self.weights.fold * np.clip(self.crease[i] / self._length(i), 0, 1)

    def join(self, i: int, j: int) -> None:
        """Add region j to region i."""
        total = self.area[i] + self.area[j]
        share = self.area[j] / total
        self.feature[i] += share * (self.feature[j] - self.feature[i])
        self.spread[i] = np.sqrt((1 - share) * self.spread[i] ** 2 + share * self.spread[j] ** 2)
        self.area[i] = total
        self.alive[j] = False
        within = self.detour[i, i] + self.detour[j, j] + 2 * self.detour[i, j]
        for table in (self.border, self.contrast, self.crease, self.bend, self.detour):
            table[i] += table[j]
            table[i, i] = 0
            table[:, i] = table[i]
        self.detour[i, i] = within

    def _allowed(self, cost: NDArray[np.float64], i: int) -> NDArray[np.float64]:
        cost[~self.alive] = np.inf
        cost[i] = np.inf
        return cost


def _agglomerate(regions: _Regions, merges: list[_Merge], *, ward: bool, until: int) -> None:
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
    while alive.sum() > until:
        i = int(best.argmin())
        j = int(partner[i])
        if not np.isfinite(best[i]):  # by Ward's criterion: no touching regions are left
            return
        merges.append(_Merge(i, j) if ward else _Merge(i, j, float(best[i]), float(regions.look_cost[i, j])))
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
