"""From parts of patches to one part for every Gaussian, faint, buried and stray ones included."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from phys4dgen.grouping.hidden import follow
from phys4dgen.types import Frame, Gaussians

__all__ = ["attach", "number_from_the_ground"]

_NEIGHBOURS = 36
_SMOOTHING_ROUNDS = 2
_ROWS_AT_ONCE = 1 << 16
"""Gaussians whose votes are counted together, for the memory."""
_VOTE_COLOR_SCALE = 8.0
"""Difference of rendered colour at which a neighbour's vote is worth little: a patch ends where its colour does."""
_TYPICAL_SCALE = 8.0
"""Difference from its patch's mean colour at which a Gaussian's vote is worth little: a patch lies mostly, not wholly,
in its part, and what looks unlike it may well belong to the next one."""


def attach(
    gaussians: Gaussians,
    patch: NDArray[np.int32],
    part_of_patch: NDArray[np.int64],
    *,
    color: NDArray[np.float32],
    radius: float,
) -> NDArray[np.int64]:
    """Part of every Gaussian, shape [N].

    The visible surface takes its patch's part, corrected by a vote among neighbours of its colour that look as their
    patches do; all others follow the parts around them, near ones and those of like colour, light aside, first.

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
    neighbours = neighbours.reshape(len(core), -1).astype(np.int32)
    shown = color[core]
    difference = np.zeros(neighbours.shape)
    for channel in shown.T:  # one at a time, for the memory
        difference += (channel[neighbours] - channel[:, None]) ** 2
    votes = np.exp(-difference / _VOTE_COLOR_SCALE**2)  # the first neighbour is itself
    votes *= _typical(shown, patch[core])[neighbours]
    for _ in range(_SMOOTHING_ROUNDS):
        label = _majority(label, neighbours, votes, part_count)
    out = np.zeros(len(gaussians), np.int64)
    out[core] = label
    rest = np.flatnonzero(~known)
    if len(rest):
        out[rest] = follow(gaussians, core, label, rest, radius=radius)
    return out


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


def _typical(shown: NDArray[np.float32], patch: NDArray[np.int32]) -> NDArray[np.float64]:
    """How much each Gaussian looks as its patch does in the mean, 1 at most, shape [K]."""
    size = np.maximum(np.bincount(patch), 1)
    mean = np.stack([np.bincount(patch, column) / size for column in shown.T], 1)
    return np.exp(-((shown - mean[patch]) ** 2).sum(1) / _TYPICAL_SCALE**2)


def _majority(
    label: NDArray[np.int64], neighbours: NDArray[np.int32], votes: NDArray[np.float64], count: int
) -> NDArray[np.int64]:
    """Label with the largest sum of votes among the neighbours of each; the lowest wins a tie. Shape [K]."""
    out = np.empty_like(label)
    for start in range(0, len(label), _ROWS_AT_ONCE):
        rows = slice(start, start + _ROWS_AT_ONCE)
        size = len(label[rows])
        cell = np.arange(size)[:, None] * count + label[neighbours[rows]]
        out[rows] = np.bincount(cell.ravel(), votes[rows].ravel(), size * count).reshape(-1, count).argmax(1)
    return out
