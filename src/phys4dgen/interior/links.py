"""Rods that join what the voxels join but the sites do not.

Where a petiole meets its stem, a slice of voxels holds both and becomes one site in the stem's middle; the petiole's
own sites begin a few voxels away. The solid is connected there, so the particles must be.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.interior.groups import point_groups
from phys4dgen.interior.sites import Sites

__all__ = ["link_groups"]


def link_groups(
    position: NDArray[np.float64], width: NDArray[np.float64], body: NDArray[np.int32], *, apart: float, reach: float
) -> tuple[Sites, NDArray[np.float64]]:
    """Join groups of sites to the largest one by straight rods, nearest first, until nothing more is in reach.

    Args:
        position: sites of all kinds, voxels, [S, 3].
        width: diameter that a rod starting at the site would have, voxels, [S].
        body: connected body of solid voxels that the site is an outermost one of, -1 for none, [S].
        apart: sites within this distance hang together, voxels.
        reach: longest rod, voxels.

    Returns:
        Rod sites one voxel apart, and their diameters.
    """
    position, width = position.copy(), width.copy()
    added: list[tuple[NDArray[np.float64], NDArray[np.float64], float, float]] = []
    while len(position) > 1:
        group = point_groups(position, apart, body=body)
        main = group == np.bincount(group).argmax()
        if main.all():
            break
        rest = np.flatnonzero(~main)
        joined = np.flatnonzero(main)
        found = KDTree(position[joined]).query(position[rest], distance_upper_bound=reach)
        distance, near = np.asarray(found[0]), np.asarray(found[1])
        order = np.argsort(distance, kind="stable")
        order = order[np.isfinite(distance[order])]
        if len(order) == 0:
            break
        _, first = np.unique(group[rest[order]], return_index=True)
        for link in order[first]:
            start, end = position[rest[link]], position[joined[near[link]]]
            steps = max(int(np.ceil(distance[link])), 2)
            points = start + np.linspace(0, 1, steps + 1)[1:-1, None] * (end - start)
            thick = float(min(width[rest[link]], width[joined[near[link]]]))
            # What lies inside the body that the link ends in is there already.
            outside = np.clip(1 - 0.5 * width[joined[near[link]]] / distance[link], 0.2, 1)
            added.append((points, (end - start) / distance[link], float(outside * distance[link]) / steps, thick))
            position = np.concatenate([position, points])
            width = np.concatenate([width, np.full(len(points), thick)])
            body = np.concatenate([body, np.full(len(points), -1, np.int32)])
    counts = [len(points) for points, *_ in added]
    zero = np.zeros((sum(counts), 3))
    sites = Sites(
        np.concatenate([points for points, *_ in added]) if added else zero,
        np.repeat([axis for _, axis, *_ in added], counts, axis=0) if added else zero,
        np.repeat([length for *_, length, _ in added], counts),
        zero,
        zero,
        np.ones(sum(counts), bool),
        np.zeros(sum(counts), bool),
    )
    return sites, np.repeat([thick for *_, thick in added], counts)
