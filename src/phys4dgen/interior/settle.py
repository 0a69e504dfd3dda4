"""Make single readings of thin parts agree with their neighbours, and drop sites that nothing was seen of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.interior.groups import graph_components
from phys4dgen.interior.measure import RodReading
from phys4dgen.interior.sites import Sites

__all__ = ["keep_connected", "settle_ribbons", "settle_thickness", "settle_width"]

_MIN_TRUSTED_SHARE = 0.3
_ROD_REACH = 8.0  # voxels along a rod within which its width is one


def settle_thickness(
    position: NDArray[np.float64],
    value: NDArray[np.float64],
    trusted: NDArray[np.bool_],
    fallback: float,
    *,
    sites: int,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Median of the trusted readings among the nearest ``sites``, and whether there were enough of them.

    Where too few neighbours can be trusted none is: a sparse capture's neighbourhoods cross from leaf to leaf.
    """
    if len(value) == 0:
        return value, np.zeros(0, bool)
    k = min(sites, len(value))
    _, near = KDTree(position).query(position, k=k)
    near = near.reshape(len(position), k)
    readings = np.where(trusted[near], value[near], np.nan)
    enough = trusted[near].mean(1) >= _MIN_TRUSTED_SHARE
    settled = np.full(len(value), float(fallback))
    settled[enough] = np.nanmedian(readings[enough], axis=1)
    return settled, enough


def settle_width(reading: RodReading) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Width of each rod from the sites up and down the same rod, and whether there was one to be read.

    Where a petiole leaves its stem a slice holds both and reads too wide; a low quantile along the rod does not.
    """
    sites = reading.sites
    width = np.ones(len(sites))
    measured = reading.trusted.copy()
    if len(sites) == 0:
        return width, measured
    near = KDTree(sites.position).query_ball_point(sites.position, _ROD_REACH)
    for site, others in enumerate(near):
        others = np.array(sorted(others))
        axis = sites.direction[site]
        apart = sites.position[others] - sites.position[site]
        across = np.linalg.norm(apart - (apart @ axis)[:, None] * axis, axis=1)
        same = (across < 1.5) & (np.abs(sites.direction[others] @ axis) > 0.85) & reading.trusted[others]
        if same.any():
            width[site] = np.quantile(reading.width[others[same]], 0.3)
            measured[site] = True
    return width, measured


def settle_ribbons(reading: RodReading) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether each rod site is a ribbon, and its wide direction, by its 12 nearest trusted neighbours.

    One long blade must not change from flat to round and back with every few Gaussians.
    """
    flat, across, sites = reading.is_ribbon, reading.across, reading.sites
    known = np.flatnonzero(reading.trusted)
    if len(known) == 0:
        return flat, across
    k = min(12, len(known))
    _, near = KDTree(sites.position[known]).query(sites.position, k=k)
    near = known[near.reshape(len(sites), k)]
    flat = flat[near].mean(1) > 0.4
    weight = reading.is_ribbon[near] + 1e-3
    dyads = np.einsum("sk,ska,skb->sab", weight, across[near], across[near])
    onto = np.eye(3) - sites.direction[:, :, None] * sites.direction[:, None, :]
    return flat, np.linalg.eigh(onto @ dyads @ onto)[1][:, :, 2]


def keep_connected(
    sites: Sites, seen: NDArray[np.bool_], *, solid: NDArray[np.int64], link: float
) -> NDArray[np.bool_]:
    """Sites to keep: the covered ones, and groups of uncovered ones without which covered ones would come apart.

    Args:
        sites: of sheets.
        seen: the Gaussians cover the site, [S].
        solid: solid voxels, which need no Gaussians, [V, 3].
        link: sites within this distance hang together, voxels.
    """
    keep = seen.copy()
    hidden = np.flatnonzero(~seen)
    if len(hidden) == 0:
        return keep
    tree = KDTree(sites.position)
    pairs = tree.query_pairs(link, output_type="ndarray")
    groups = graph_components(pairs[seen[pairs].all(1)], len(sites))
    hidden_groups = graph_components(pairs[(~seen[pairs]).all(1)], len(sites))
    mixed = pairs[seen[pairs[:, 0]] != seen[pairs[:, 1]]]
    hidden_end = np.where(seen[mixed[:, 0]], mixed[:, 1], mixed[:, 0])
    seen_end = np.where(seen[mixed[:, 0]], mixed[:, 0], mixed[:, 1])
    touches = np.unique(np.stack([hidden_groups[hidden_end], groups[seen_end]], 1), axis=0)
    if len(solid):
        distance, _ = KDTree(solid).query(sites.position[hidden], distance_upper_bound=link)
        at_solid = np.unique(hidden_groups[hidden[np.isfinite(distance)]])
        touches = np.concatenate([touches, np.stack([at_solid, np.full(len(at_solid), -1)], 1)])
    group, neighbors = np.unique(touches[:, 0], return_counts=True)
    needed = group[neighbors >= 2]
    keep[hidden] = np.isin(hidden_groups[hidden], needed) | sites.is_bridge[hidden]
    return keep
