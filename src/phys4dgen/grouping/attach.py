"""From parts of patches to one part for every Gaussian, faint, buried and stray ones included."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.grouping.lighting import LAB_OFFSET
from phys4dgen.grouping.supervoxels import LIGHTNESS_WEIGHT
from phys4dgen.types import Frame, Gaussians
from phys4dgen.types.color import srgb_to_lab

__all__ = ["attach", "number_from_the_ground"]

_NEIGHBOURS = 12
_SMOOTHING_ROUNDS = 2
_VOTE_COLOR_SCALE = 8.0
"""Difference of rendered colour at which a neighbour's vote is worth little: a patch ends where its colour does."""
_NEAREST = 4
"""How many Gaussians of a part say how far away it is."""
_AROUND = 16
"""How many Gaussians of a part say what colour it has there: the colour of a single one is mostly noise."""
_DISTANCE_FLOOR = 0.03
"""Of the object's radius: parts nearer than this are equally near."""
_LEAST_WEIGHT = 0.02
"""Added to opacity, by which Gaussians count in that colour."""
_COLOR_SCALE = 16.0
"""Difference of colour, light aside, at which a Gaussian belongs to a part much less."""
_LIGHT_WEIGHT = 0.25
"""How much of a difference that more or less light explains counts."""


def attach(
    gaussians: Gaussians,
    patch: NDArray[np.int32],
    part_of_patch: NDArray[np.int64],
    *,
    color: NDArray[np.float32],
    radius: float,
) -> NDArray[np.int64]:
    """Part of every Gaussian, shape [N].

    The visible surface takes its patch's part, corrected by a vote among neighbours of its colour; all others follow
    the parts around them, near ones and those of like colour, light aside, first.

    Args:
        gaussians: N static Gaussians.
        patch: patch of every visible Gaussian, -1 elsewhere, shape [N].
        part_of_patch: -1 where it is not known, shape [S].
        color: what each visible Gaussian shows (half the lightness, a, b), shape [N, 3].
        radius: half the object's diagonal, input units.
    """
    known = (patch >= 0) & (part_of_patch[patch] >= 0)
    core = np.flatnonzero(known)
    label = part_of_patch[patch[core]]
    part_count = int(part_of_patch.max()) + 1
    tree = KDTree(gaussians.means[core])
    neighbours = tree.query(gaussians.means[core], min(_NEIGHBOURS + 1, len(core)), workers=-1)[1]
    neighbours = neighbours.reshape(len(core), -1)
    shown = color[core].astype(np.float64)
    difference = ((shown[neighbours] - shown[:, None]) ** 2).sum(2)
    votes = np.exp(-difference / _VOTE_COLOR_SCALE**2)  # its own, as its first neighbour, counts 1
    for _ in range(_SMOOTHING_ROUNDS):
        label = _majority(label[neighbours], votes, part_count)
    out = np.zeros(len(gaussians), np.int64)
    out[core] = label
    rest = np.flatnonzero(~known)
    if len(rest):
        out[rest] = _follow(gaussians, core, label, rest, radius)
    return out


def _follow(
    gaussians: Gaussians, core: NDArray[np.intp], label: NDArray[np.int64], rest: NDArray[np.intp], radius: float
) -> NDArray[np.int64]:
    """Part that is near and, where it is near, of like colour, for each Gaussian of ``rest``.

    Every part is asked, not only the few nearest Gaussians: a white Gaussian buried in the pot lies closer to the soil.
    """
    lab = srgb_to_lab(gaussians.base_colors) * [LIGHTNESS_WEIGHT, 1, 1]
    lab[:, 0] += LIGHTNESS_WEIGHT * LAB_OFFSET  # all three now shrink by one factor where there is less light
    opacities = gaussians.opacities.astype(np.float64) + _LEAST_WEIGHT
    best = np.full(len(rest), -1.0)
    part = np.zeros(len(rest), np.int64)
    for candidate in np.unique(label):
        members = core[label == candidate]
        distance, near = KDTree(gaussians.means[members]).query(
            gaussians.means[rest], min(_AROUND, len(members)), workers=-1
        )
        distance, near = distance.reshape(len(rest), -1), members[near.reshape(len(rest), -1)]
        weight = opacities[near] / (distance + _DISTANCE_FLOOR * radius)
        local = (weight[:, :, None] * lab[near]).sum(1) / weight.sum(1)[:, None]
        likeness = np.exp(-_difference_but_for_light(lab[rest], local) / _COLOR_SCALE)
        score = likeness / (distance[:, :_NEAREST].mean(1) + _DISTANCE_FLOOR * radius)
        part = np.where(score > best, candidate, part)
        best = np.maximum(score, best)
    return part


def _difference_but_for_light(shown: NDArray[np.float64], lit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Difference of colours (lightness from where light shrinks it to nothing, a, b), both [M, 3]; shape [M].

    What no camera of the views sees lies mostly in the shade, inside and between things. There all colours are nearly
    black, and the darkest part would win everything; hence less light than on ``lit`` is held against it but little.
    """
    square = (lit**2).sum(1)
    light = np.clip((shown * lit).sum(1) / square, 0, 1)
    residual = ((shown - light[:, None] * lit) ** 2).sum(1)
    return np.sqrt(residual + square * (_LIGHT_WEIGHT * (1 - light)) ** 2)


def number_from_the_ground(
    labels: NDArray[np.int64], gaussians: Gaussians, frame: Frame
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Number the parts by their opacity-weighted mean height.

    Returns:
        New labels 0 .. G-1, shape [N], and the old label of each new number, shape [G].
    """
    old, dense = np.unique(labels, return_inverse=True)
    weight = gaussians.opacities.astype(np.float64) + 1e-6
    height = gaussians.means.astype(np.float64) @ frame.up
    mean_height = np.bincount(dense, weight * height) / np.bincount(dense, weight)
    order = np.argsort(mean_height, kind="stable")
    return np.argsort(order)[dense].astype(np.int32), old[order]


def _majority(labels: NDArray[np.int64], weights: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Label with the largest sum of weights in each row; the lowest wins a tie. Shape [rows]."""
    cell = np.arange(len(labels))[:, None] * count + labels
    return np.bincount(cell.ravel(), weights.ravel(), len(labels) * count).reshape(-1, count).argmax(1)
