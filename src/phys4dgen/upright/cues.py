"""What speaks for a direction as down: how it stands, its symmetry about the vertical, light from above, foliage.

Stability and symmetry as in H. Fu et al., *Upright orientation of man-made objects*, SIGGRAPH 2008. An axis is mostly
found by symmetry and by what touches the ground. Much does, but it is a rim, feet or an underside that no camera saw
rather than a closed face, it lies under the middle, and nothing reaches below it. Which end of the axis is up is told
by the light and, of plants, by the leaves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, KDTree, QhullError

from phys4dgen.types import Gaussians, rotation_from_quats
from phys4dgen.upright.contact import BAND, contact_below
from phys4dgen.upright.occupied import Occupied, visible_mass

__all__ = ["Cues", "Look", "Stand", "cues_of", "light_and_leaves", "stand_on"]

_PROBES = 200
_MIRRORS = 12
_TURNS_RAD = (1.0, np.pi / 2, 2.1, np.pi)
_FARTHEST = 0.1
_MOST_GAUSSIANS = 12_000
_BLOCKS = 10
_AROUND = 0.22
_LEAST_SPREAD = 0.02
_GREENER = 1.15
_FAR_APART = 0.2
_LOWEST = 0.02
_LIFTS = (-0.03, 0.12)
_TIPS_DEG = (-8.0, 12.0)
_CANNOT_STAND_DEG = -15.0
_NO_CONTACT = 0.5
_BLOCK_CELLS = 1.5


class Stand(NamedTuple):
    """How the object stands with one direction down.

    Attributes:
        tip_deg: by how much it can be tilted before it falls; negative where it cannot stand.
        support_share: of the footprint's hull that the hull of the contact covers.
        contact_share: of all points that touch the ground.
        filled_share: of the contact's hull in which something touches the ground; about 1 for a closed face.
        offset: distance across from the middle of the contact to the middle of the object, of the object's size.
        lift: height above the ground of the lowest fiftieth of all points, of the object's size; large for what keeps
            off the ground on feet, negative where much reaches below the ground.
        turn_misfit, mirror_misfit: mean distance between the object and itself turned about the vertical, or mirrored
            in the best plane through it, of the object's size.
    """

    tip_deg: float
    support_share: float
    contact_share: float
    filled_share: float
    offset: float
    lift: float
    turn_misfit: float
    mirror_misfit: float


class Look(NamedTuple):
    """What the colours say, whichever way is down.

    Attributes:
        light: gradient of the logarithm of the lightness along the outward normal, of Gaussians of like hue, [3].
        leaves: from the middle of all that is not green to the middle of the green, of the object's size, [3]; zero
            where there is nothing green, or nothing else.
    """

    light: NDArray[np.float64]
    leaves: NDArray[np.float64]


class Cues(NamedTuple):
    """Numbers that are added up with weights; the larger, the more a direction is down."""

    stability: float
    contact: float
    open_base: float
    centred: float
    lift: float
    turning: float
    mirror: float
    light: float
    leaves: float


def cues_of(stand: Stand, look: Look, down: NDArray[np.float64]) -> Cues:
    """The cues of one direction."""
    return Cues(
        stability=float(np.clip(stand.tip_deg, *_TIPS_DEG)),
        contact=float(np.log(stand.contact_share + 0.01)),
        open_base=-min(stand.filled_share, 1.0),
        centred=-stand.offset,
        lift=float(np.clip(stand.lift, *_LIFTS)),
        turning=-float(np.log(stand.turn_misfit + 0.01)),
        mirror=-float(np.log(stand.mirror_misfit + 0.01)),
        light=-float(look.light @ down),
        leaves=-float(np.tanh(look.leaves @ down / _FAR_APART)),
    )


def stand_on(cells: Occupied, down: NDArray[np.float64]) -> Stand:
    """How the object stands with ``down`` down."""
    points, size = cells.points, cells.size
    contact = contact_below(cells, down)
    across = np.linalg.svd(down[None])[2][1:]
    flat, along = points @ across.T, points @ down
    touching = (along > contact.height - BAND * size) & (along < contact.height + 0.2 * BAND * size)
    centre = cells.mass @ points / cells.mass.sum()
    tip_deg, area = _CANNOT_STAND_DEG, 0.0
    footprint = ConvexHull(flat)
    try:
        hull = ConvexHull(flat[touching])
    except (QhullError, ValueError):  # a point or a line
        pass
    else:
        inside = -float((hull.equations[:, :2] @ (across @ centre) + hull.equations[:, 2]).max())
        height = max(contact.height - float(down @ centre), 1e-3 * size)
        tip_deg, area = float(np.degrees(np.arctan2(inside, height))), float(hull.volume)
    turn, mirror = _misfits(cells, down, across)
    apart = flat[touching].mean(0) - flat.mean(0) if touching.any() else np.array([_NO_CONTACT * size, 0.0])
    return Stand(
        tip_deg=tip_deg,
        support_share=area / float(footprint.volume),
        contact_share=contact.points / len(points),
        filled_share=_filled_share(flat[touching], area, _BLOCK_CELLS * cells.cell),
        offset=float(np.linalg.norm(apart)) / size,
        lift=float(np.quantile(contact.height - along, _LOWEST)) / size,
        turn_misfit=turn,
        mirror_misfit=mirror,
    )


def _filled_share(flat: NDArray[np.float64], area: float, side: float) -> float:
    """Area of the squares in which there are points, of the area of their hull."""
    squares = np.unique(np.floor(flat / side).astype(np.int64), axis=0)
    return len(squares) * side**2 / max(area, side**2)


def _misfits(cells: Occupied, down: NDArray[np.float64], across: NDArray[np.float64]) -> tuple[float, float]:
    """Mean distance of turned, and of best mirrored, points from the object, of its size."""
    points, centre = cells.points, cells.points.mean(0)
    probes = np.random.default_rng(1).choice(len(points), min(_PROBES, len(points)), replace=False)
    offsets = points[probes] - centre
    moved = []
    for angle in np.arange(_MIRRORS) * np.pi / _MIRRORS:
        normal = np.cos(angle) * across[0] + np.sin(angle) * across[1]
        moved.append(offsets - 2 * (offsets @ normal)[:, None] * normal)
    for angle in _TURNS_RAD:
        cross = np.cross(down, offsets)
        upright = (offsets @ down)[:, None] * down
        moved.append(upright + np.cos(angle) * (offsets - upright) + np.sin(angle) * cross)
    farthest = _FARTHEST * cells.size
    distance, _ = KDTree(points).query(np.concatenate(moved) + centre, distance_upper_bound=farthest)
    misfit = np.minimum(distance, farthest).reshape(len(moved), -1).mean(1) / cells.size
    return float(misfit[_MIRRORS:].mean()), float(misfit[:_MIRRORS].min())


def light_and_leaves(gaussians: Gaussians, cells: Occupied) -> Look:
    """Where the light comes from, and where the green is."""
    index = cells.members
    if len(index) > _MOST_GAUSSIANS:
        index = np.random.default_rng(2).choice(index, _MOST_GAUSSIANS, replace=False)
    means = gaussians.means[index].astype(np.float64)
    weight = visible_mass(gaussians, index, cells.size)
    rgb = np.maximum(gaussians.base_colors[index].astype(np.float64), 0.01)
    normals, trust = _outward_normals(gaussians, index, means, weight, cells.size)
    lightness = np.log(rgb @ [0.299, 0.587, 0.114] + 0.05)
    hue = np.floor(24 * rgb[:, :2] / rgb.sum(1, keepdims=True)).astype(np.int64)
    _, like = np.unique(hue, axis=0, return_inverse=True)
    like = like.reshape(-1)
    weighted = weight * trust
    total = np.maximum(np.bincount(like, weighted), 1e-300)

    def beside_like(values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Difference from the mean of those of like hue."""
        return values - (np.bincount(like, weighted * values) / total)[like]

    turned = np.stack([beside_like(normals[:, axis]) for axis in range(3)], 1)
    brighter = np.clip(beside_like(lightness), -1, 1)
    share = weighted / max(float(weighted.sum()), 1e-300)
    spread = (turned * share[:, None]).T @ turned + _LEAST_SPREAD * np.eye(3)
    light = np.linalg.solve(spread, (turned.T * share) @ brighter)
    return Look(np.asarray(light, np.float64), _leaves(means, weight, rgb, cells.size))


def _leaves(
    means: NDArray[np.float64], weight: NDArray[np.float64], rgb: NDArray[np.float64], size: float
) -> NDArray[np.float64]:
    green = (rgb[:, 1] > _GREENER * rgb[:, 0]) & (rgb[:, 1] > _GREENER * rgb[:, 2])
    if not 0.05 < float(weight[green].sum() / weight.sum()) < 0.95:
        return np.zeros(3)
    middle = [weight[mask] @ means[mask] / weight[mask].sum() for mask in (green, ~green)]
    return (middle[0] - middle[1]) / size


def _outward_normals(
    gaussians: Gaussians,
    index: NDArray[np.int64],
    means: NDArray[np.float64],
    weight: NDArray[np.float64],
    size: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shortest axes turned away from the middle of what is around, [K, 3], and how far they can be trusted, [K]."""
    axes = rotation_from_quats(gaussians.quats_wxyz[index])
    normals = axes[np.arange(len(index)), :, gaussians.scales[index].argmin(1)]
    places = np.floor((means - means.min(0)) * (_BLOCKS / size)).astype(np.int64)
    _, block = np.unique(places, axis=0, return_inverse=True)
    block = block.reshape(-1)
    total = np.maximum(np.bincount(block, weight), 1e-300)
    middles = np.stack([np.bincount(block, weight * means[:, axis]) for axis in range(3)], 1) / total[:, None]
    around = KDTree(middles).query_ball_point(middles, _AROUND * size)
    middles = np.array([np.average(middles[near], axis=0, weights=total[near]) for near in around])
    arm = means - middles[block]
    height = (arm * normals).sum(1)
    length = np.linalg.norm(arm, axis=1)
    trust = np.abs(height) / np.maximum(length, 1e-12 * size) * np.clip(length / (0.05 * size), 0, 1)
    return normals * np.where(height < 0, -1.0, 1.0)[:, None], trust
