"""From a merge tree to a number of parts: where to cut it, and what becomes of crumbs and flecks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from phys4dgen.grouping.merging import MergeTree
from phys4dgen.grouping.patch_graph import PatchGraph

__all__ = ["LEVEL", "MAX_PARTS", "cut_tree"]

MAX_PARTS = 60
"""No cut gives more parts than this."""
LEVEL = 12.0
"""Merges within a part cost less, merges of two parts more; docs/grouping.md says on which objects it was chosen."""
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


def cut_tree(tree: MergeTree, parts: int | None = None, *, level: float = LEVEL) -> NDArray[np.int64]:
    """Part of every patch, numbered 0 .. G-1 in no particular order, -1 where nothing tells; shape [S].

    Args:
        tree: from ``merge_tree``.
        parts: number of parts wished for (fewer where the tree holds fewer); None decides by cost.
        level: look cost up to which regions join, where no number is given.
    """
    patch_count = len(tree.graph)
    if parts is None:
        label = _join_crumbs(tree.graph, _regions_up_to(tree, level), None)
        if label.max() < MAX_PARTS:
            return _join_flecks(tree.graph, label)
        regions = MAX_PARTS
    else:
        regions = min(max(parts, 1), patch_count)
        while regions < min(MAX_PARTS, patch_count) and _large_regions(tree, regions) < parts:
            regions += 1
    return _join_flecks(tree.graph, _join_crumbs(tree.graph, _regions_at(tree, regions), parts))


def _regions_up_to(tree: MergeTree, level: float) -> NDArray[np.int64]:
    """Region of every patch when no merge with a look cost from ``level`` on is made, nor any of what it would give."""
    label = np.arange(len(tree.graph))
    whole = np.ones(len(label), np.bool_)
    for kept, absorbed, look_cost in zip(tree.kept, tree.absorbed, tree.look_cost, strict=True):
        if whole[kept] and whole[absorbed] and look_cost < level:
            label[label == absorbed] = kept
        else:
            whole[kept] = False
    return np.unique(label, return_inverse=True)[1]


def _regions_at(tree: MergeTree, regions: int) -> NDArray[np.int64]:
    """Region of every patch when ``regions`` are left, 0 .. regions-1."""
    label = np.arange(len(tree.graph))
    for step in range(len(tree.graph) - regions):
        label[label == tree.absorbed[step]] = tree.kept[step]
    return np.unique(label, return_inverse=True)[1]


def _large_regions(tree: MergeTree, regions: int) -> int:
    """How many of the regions at that level are no crumbs."""
    return int((np.bincount(_regions_at(tree, regions), tree.graph.area) >= _MIN_AREA).sum())


def _join_crumbs(graph: PatchGraph, label: NDArray[np.int64], parts: int | None) -> NDArray[np.int64]:
    """Give the smallest region to the one nearest in colour until none is a crumb and the number is right."""
    while True:
        area = np.bincount(label, graph.area)
        smallest = int(area.argmin())
        if len(area) == 1 or (area[smallest] >= _MIN_AREA and (parts is None or len(area) <= parts)):
            return label
        mean = np.stack([np.bincount(label, graph.area * channel) for channel in graph.feature.T], 1) / area[:, None]
        distance = np.linalg.norm(mean - mean[smallest], axis=1)
        sides = label[graph.touching]
        neighbours = np.concatenate([sides[sides[:, 0] == smallest, 1], sides[sides[:, 1] == smallest, 0]])
        distance[np.setdiff1d(np.arange(len(area)), neighbours)] *= _CRUMB_APART_FACTOR
        distance[smallest] = np.inf
        label = np.unique(np.where(label == smallest, int(distance.argmin()), label), return_inverse=True)[1]


def _join_flecks(graph: PatchGraph, label: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give small islands of a part to the part that they lie in, unless one is thin and the other is not.

    A dark stain or shadow on a pot has the colour of the soil and would be soil; a leaf that hangs in front of the pot
    touches nothing else either, and is told from a stain by being thin. A crumb that touches nothing at all, such as
    debris below a hollow pot, lies in no part: it gets -1 and is left to follow what is near it.
    """
    a, b = graph.touching.T
    inside = label[a] == label[b]
    links = coo_matrix((np.ones(inside.sum()), (a[inside], b[inside])), (len(label), len(label)))
    island = connected_components(links, directed=False)[1]
    area = np.bincount(island, graph.area)
    thinness = np.bincount(island, graph.area * graph.feature[:, 3]) / area
    part = np.zeros(len(area), np.int64)
    part[island] = label
    largest = np.zeros(int(label.max()) + 1)
    np.maximum.at(largest, part, area)
    part_area = np.bincount(label, graph.area)
    part_thinness = np.bincount(label, graph.area * graph.feature[:, 3]) / part_area
    border = np.zeros((len(area), len(largest)))
    np.add.at(border, (island[a], label[b]), graph.border * ~inside)
    np.add.at(border, (island[b], label[a]), graph.border * ~inside)
    around = border.argmax(1)
    small = area < _FLECK_SHARE * largest[part]
    touches = border.max(1) > 0
    part = np.where(small & ~touches & (area < _MIN_AREA), -1, part)
    fleck = (area < _FLECK_AREA) & small & touches
    alike = np.abs(thinness - part_thinness[around]) < _FLECK_THINNESS
    return np.where(fleck & alike, around, part)[island]
