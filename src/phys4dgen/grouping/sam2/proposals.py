"""Automatic masks of one view: where to prompt, which masks to keep, and what to do where they lie in each other.

The filter is that of Segment Anything's automatic mask generator (Kirillov et al. 2023, Sec. 5): estimated IoU,
stability, suppression of duplicates; duplicates are found by masks instead of boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.grouping.sam2.segmenter import Proposal

__all__ = ["DEFAULT_CHOICE", "Choice", "chosen_proposals", "disjoint_parts"]

_SMALL_SIDE_PX = 128
"""Masks are compared at about this size."""
_MOSTLY_NEW = 0.5
_SEAM = 0.1
"""Less than this share of a mask is no part of its own once the masks inside it are taken out."""


@dataclass(frozen=True)
class Choice:
    """Which masks of a network are taken.

    Attributes:
        points_per_side: of the grid of prompts over the whole picture.
        min_quality: least estimated IoU.
        min_stability: least IoU of the mask at a higher and a lower threshold.
        max_overlap: two masks with a larger IoU are one.
        min_area: least share of the region.
    """

    points_per_side: int = 16
    min_quality: float = 0.8
    min_stability: float = 0.9
    max_overlap: float = 0.7
    min_area: float = 0.004

    def grid(self, region: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Points of the grid that fall into a region [H, W]; x and y in pixels, shape [P, 2]."""
        height, width = region.shape
        steps = (np.arange(self.points_per_side) + 0.5) / self.points_per_side
        y, x = (axis.ravel() for axis in np.meshgrid(steps * height, steps * width, indexing="ij"))
        return np.stack([x, y], 1)[region[y.astype(np.intp), x.astype(np.intp)]]


DEFAULT_CHOICE = Choice()


def chosen_proposals(
    masks: Sequence[NDArray[np.bool_]], quality: Sequence[float], region: NDArray[np.bool_], *, choice: Choice
) -> list[Proposal]:
    """The masks that are large enough, best first, without duplicates.

    Args:
        masks: of shape [H, W]; cut to the region, because nothing else is asked for.
        quality: estimated IoU of each.
        region: that was prompted, shape [H, W].
        choice: what is enough.
    """
    step = max(1, max(region.shape) // _SMALL_SIDE_PX)
    kept: list[tuple[Proposal, NDArray[np.bool_]]] = []
    for number in np.argsort(-np.asarray(quality), kind="stable"):
        mask = masks[number] & region
        if mask.sum() < choice.min_area * region.sum():
            continue
        small = mask[::step, ::step]
        if all(_iou(small, other) <= choice.max_overlap for _, other in kept):
            kept.append((Proposal(mask, float(quality[number])), small))
    return [proposal for proposal, _ in kept]


def disjoint_parts(proposals: Sequence[Proposal], free: NDArray[np.bool_], *, min_px: float) -> list[NDArray[np.bool_]]:
    """Masks that do not overlap: of those that lie in each other the smaller ones win, the larger keep the rest.

    A whole object is a good mask as well, but what is asked for are parts.

    Args:
        proposals: in any order.
        free: pixels that nothing has claimed yet, shape [H, W].
        min_px: a mask of which less is left is dropped; so is one that is mostly claimed already, and a seam.
    """
    left = free.copy()
    parts = []
    for proposal in sorted(proposals, key=lambda proposal: (int(proposal.mask.sum()), -proposal.quality)):
        rest = proposal.mask & left
        whole, new = proposal.mask.sum(), (proposal.mask & free).sum()
        if rest.sum() >= max(min_px, _SEAM * whole) and new >= _MOSTLY_NEW * whole:
            parts.append(rest)
            left &= ~rest
    return parts


def _iou(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return float((a & b).sum() / max((a | b).sum(), 1))
