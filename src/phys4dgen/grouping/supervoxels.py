"""Supervoxels: about a thousand small compact surface patches of one colour each.

Simple Non-Iterative Clustering (Achanta and Suesstrunk, "Superpixels and Polygons using Simple Non-Iterative
Clustering", CVPR 2017) on the nearest-neighbour graph of the Gaussians that are the visible surface. Patches follow
colour edges, so that everything after works on a thousand patches instead of a hundred thousand noisy Gaussians.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.grouping.surface_color import SurfaceColor
from phys4dgen.types import Gaussians
from phys4dgen.types.color import srgb_to_lab

__all__ = ["LIGHTNESS_WEIGHT", "Supervoxels", "core_gaussians", "object_radius", "supervoxels"]

LIGHTNESS_WEIGHT = 0.5
"""Lightness counts half in every colour distance: light and shade change L more than a and b."""

_NEIGHBOURS = 12
_COLOR_SCALE = 10.0
"""Colour difference that weighs as much as one patch width in the growing of patches."""


@dataclass(frozen=True, eq=False)
class Supervoxels:
    """S patches of the visible surface.

    Attributes:
        core: indices of the Gaussians that are the visible surface, shape [C].
        patch: patch of each core Gaussian, shape [C].
        color: rendered colour of each (LIGHTNESS_WEIGHT * L, a, b), shape [C, 3].
        neighbours: nearest core neighbours of each core Gaussian (positions in ``core``), shape [C, 12].
        mean: mean colour (LIGHTNESS_WEIGHT * L, a, b), shape [S, 3].
        spread: standard deviation of the colour, shape [S, 3].
        area: share of the visible surface, sums to 1, shape [S].
        centre: mean position, input units, shape [S, 3].
        normal: unit normal, turned towards the cameras, shape [S, 3].
        flatness: 1 for a plane, 0 for a ball or a rod, shape [S].
        thinness: 1 where cameras on opposite sides see the same patch (a leaf, a stalk), 0 on solids, shape [S].
        openness: share of the views that see it: little in crevices, shape [S].
        border: number of neighbour pairs that cross from one patch to another, symmetric, shape [S, S].
    """

    core: NDArray[np.intp]
    patch: NDArray[np.intp]
    color: NDArray[np.float64]
    neighbours: NDArray[np.int32]
    mean: NDArray[np.float64]
    spread: NDArray[np.float64]
    area: NDArray[np.float64]
    centre: NDArray[np.float64]
    normal: NDArray[np.float64]
    flatness: NDArray[np.float64]
    thinness: NDArray[np.float64]
    openness: NDArray[np.float64]
    border: NDArray[np.float64]


def object_radius(gaussians: Gaussians) -> float:
    """Half the diagonal of the box that holds 1 to 99 % of the reasonably opaque Gaussians, input units."""
    lower, upper = gaussians.robust_bounds(min_opacity=0.2, tail_percent=1.0)
    return float(np.linalg.norm(upper - lower) / 2)


def core_gaussians(gaussians: Gaussians, surface: SurfaceColor, radius: float) -> NDArray[np.intp]:
    """Indices of the Gaussians that make the visible surface: seen, not faint, not huge, not stray."""
    longest = gaussians.scales.max(1)
    core = np.flatnonzero(surface.seen.any(1) & (longest < 0.08 * radius))
    if len(core) <= 8:
        return core
    distance = KDTree(gaussians.means[core]).query(gaussians.means[core], 9, workers=-1)[0][:, 8]
    return core[distance <= 4 * np.median(distance)]


def supervoxels(
    gaussians: Gaussians, surface: SurfaceColor, core: NDArray[np.intp], *, radius: float, count: int = 1200
) -> Supervoxels:
    """Divide the visible surface into about ``count`` patches.

    Args:
        gaussians: N static Gaussians.
        surface: their rendered colours.
        core: the Gaussians to divide, from ``core_gaussians``.
        radius: from ``object_radius``, input units.
        count: number of patches aimed at.
    """
    points = gaussians.means[core].astype(np.float64)
    k = min(_NEIGHBOURS, len(core) - 1)
    # A lone Gaussian is its own neighbour.
    found = KDTree(points).query(points, k + 1, workers=-1)[1].reshape(len(core), -1)
    neighbours = np.ascontiguousarray(found[:, 1:] if k else found, np.int32)
    raw = srgb_to_lab(surface.rgb[core]) * [LIGHTNESS_WEIGHT, 1, 1]
    smooth = _neighbourhood_median(raw, neighbours, gaussians.opacities[core] + 0.02)
    seeds, width = _seeds(points, radius, count)
    patch = _grow_patches(neighbours, points, smooth, seeds, 1 / width**2, 1 / _COLOR_SCALE**2)
    reached = patch >= 0
    if not reached.all():  # a clump without a seed, apart from all others in the graph
        patch[~reached] = patch[reached][KDTree(points[reached]).query(points[~reached])[1]]
    patch = np.unique(patch, return_inverse=True)[1]
    return _describe(core, patch, neighbours, points, smooth, raw, surface, radius)


def _neighbourhood_median(
    values: NDArray[np.float64], neighbours: NDArray[np.int32], weights: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Weighted median of each channel over the neighbours: takes outliers away, keeps edges. Shape [C, 3]."""
    out = np.zeros_like(values)
    neighbour_weights = weights[neighbours].astype(np.float64)
    for channel in range(values.shape[1]):
        near = values[neighbours, channel]
        order = np.argsort(near, axis=1, kind="stable")
        cumulative = np.cumsum(np.take_along_axis(neighbour_weights, order, 1), axis=1)
        middle = (cumulative < cumulative[:, -1:] / 2).sum(1)
        chosen = np.take_along_axis(order, middle[:, None], 1)
        out[:, channel] = np.take_along_axis(near, chosen, 1)[:, 0]
    return out


def _voxel_keys(points: NDArray[np.float64], width: float) -> NDArray[np.int64]:
    """One integer per point that names its voxel; 20 bits an axis."""
    cell = np.minimum(np.floor((points - points.min(0)) / width), 2**20 - 1).astype(np.int64)
    return (cell[:, 0] << 40) | (cell[:, 1] << 20) | cell[:, 2]


def _seeds(points: NDArray[np.float64], radius: float, count: int) -> tuple[NDArray[np.int64], float]:
    """Per occupied voxel the point nearest its centre; the voxel width gives about ``count`` of them."""
    low, high = 0.005 * radius, radius
    width = high
    for _ in range(18):  # bisection in the logarithm
        width = (low * high) ** 0.5
        if len(np.unique(_voxel_keys(points, width))) > count:
            low = width
        else:
            high = width
    cell = np.floor((points - points.min(0)) / width)
    to_centre = ((points - points.min(0) - (cell + 0.5) * width) ** 2).sum(1)
    key = _voxel_keys(points, width)
    order = np.lexsort((np.arange(len(points)), to_centre, key))
    first = np.diff(key[order], prepend=-1) != 0
    return order[first].astype(np.int64), width


@njit(cache=True)
def _grow_patches(neighbours, points, colors, seeds, space_weight, color_weight):  # pyright: ignore
    """SNIC: always the point nearest to a patch's running mean (in space and colour) joins that patch next."""
    n, k = neighbours.shape
    patch = np.full(n, -1, np.int64)
    position_sum = np.zeros((len(seeds), 3))
    color_sum = np.zeros((len(seeds), 3))
    size = np.zeros(len(seeds))
    queue = [(0.0, seeds[s], s) for s in range(len(seeds))]
    heapq.heapify(queue)
    while len(queue) > 0:
        _, i, s = heapq.heappop(queue)
        if patch[i] >= 0:
            continue
        patch[i] = s
        size[s] += 1
        for axis in range(3):
            position_sum[s, axis] += points[i, axis]
            color_sum[s, axis] += colors[i, axis]
        for q in range(k):
            j = np.int64(neighbours[i, q])
            if patch[j] < 0:
                space, color = 0.0, 0.0
                for axis in range(3):
                    space += (points[j, axis] - position_sum[s, axis] / size[s]) ** 2
                    color += (colors[j, axis] - color_sum[s, axis] / size[s]) ** 2
                heapq.heappush(queue, (space * space_weight + color * color_weight, j, s))
    return patch


def _describe(
    core: NDArray[np.intp],
    patch: NDArray[np.intp],
    neighbours: NDArray[np.int32],
    points: NDArray[np.float64],
    smooth: NDArray[np.float64],
    raw: NDArray[np.float64],
    surface: SurfaceColor,
    radius: float,
) -> Supervoxels:
    """Colour, area, normal and borders of every patch."""
    count = int(patch.max()) + 1
    size = np.bincount(patch, minlength=count).astype(np.float64)

    def mean_of(values: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = [np.bincount(patch, column, count) for column in values.T]
        return np.stack(sums, 1) / size[:, None]

    raw_mean = mean_of(raw)
    spread = np.sqrt(np.maximum(mean_of(raw**2) - raw_mean**2, 0))

    # Area = occupied fine voxels, because the density of Gaussians says nothing about area.
    pairs = np.unique(np.stack([patch, _voxel_keys(points, radius / 60)], 1), axis=0)
    area = np.bincount(pairs[:, 0], minlength=count).astype(np.float64)

    source = np.repeat(patch, neighbours.shape[1])
    target = patch[neighbours.ravel()]
    border = np.bincount(source * count + target, minlength=count * count).reshape(count, count).astype(np.float64)
    border = border + border.T
    np.fill_diagonal(border, 0)

    centre = mean_of(points)
    offset = points - centre[patch]
    products = mean_of((offset[:, :, None] * offset[:, None, :]).reshape(-1, 9)).reshape(-1, 3, 3)
    variances, axes = np.linalg.eigh(products)
    normal = axes[:, :, 0]
    outward, thinness = _sidedness(patch, centre, surface.seen[core], surface.eyes)
    normal = np.where((normal * outward).sum(1, keepdims=True) < 0, -normal, normal)
    flatness = 1 - variances[:, 0] / np.maximum(variances[:, 1], 1e-12 * radius**2)
    return Supervoxels(
        core=core,
        patch=patch,
        color=raw,
        neighbours=neighbours,
        mean=mean_of(smooth),
        spread=spread,
        area=area / area.sum(),
        centre=centre,
        normal=normal,
        flatness=np.clip(flatness, 0, 1),
        thinness=thinness,
        openness=np.bincount(patch, surface.seen[core].mean(1), count) / size,
        border=border,
    )


def _sidedness(
    patch: NDArray[np.int64], centre: NDArray[np.float64], seen: NDArray[np.bool_], eyes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean direction to the cameras that see a patch, and how many of them look from behind it.

    Returns:
        Unit direction (0 where undecided), shape [S, 3], and thinness: twice the share of sightings from the far side
        of the plane across that direction, in [0, 1], shape [S].
    """
    sightings = np.stack([np.bincount(patch, view, len(centre)) for view in seen.T], 1)
    direction = eyes[None] - centre[:, None]
    direction = direction / np.linalg.norm(direction, axis=2, keepdims=True)
    outward = (sightings[:, :, None] * direction).sum(1)
    outward = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    behind = (direction * outward[:, None]).sum(2) < 0
    thinness = 2 * (sightings * behind).sum(1) / np.maximum(sightings.sum(1), 1)
    return outward, np.minimum(thinness, 1)
