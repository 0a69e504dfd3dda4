"""Masks of all views with one id per thing that was followed, before ids are joined in 3D.

Masks are looked for in a first view and followed through all others. Where later views show foreground that no id
claims, masks are looked for there and get new ids. Paper: Sec. 3.2 tracks SAM2's masks over the views and is silent on
what turns up late.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.grouping.sam2.proposals import disjoint_parts
from phys4dgen.grouping.sam2.segmenter import Segmenter
from phys4dgen.progress import Progress

__all__ = ["PixelSamples", "Tracks", "follow_things"]

_MIN_UNCLAIMED = 0.05
"""Of a view's foreground: less is not worth a search."""
_MIN_NEW = 0.004
"""Of a view's foreground: a smaller mask starts no id."""

PixelSamples = Sequence[tuple[NDArray[np.intp], NDArray[np.intp]]]
"""Per view, rows and columns of the pixels that visible Gaussians fall on."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """What a segmenter says about V views.

    Attributes:
        labels: id of every pixel, the one with the highest logit; -1 where none claims it, shape [V, H, W], int16.
        claims: per id, the samples of each view that lie inside its mask, whether or not another id claims them more;
            ``claims[id][view]`` is None where the id is not seen, else bool of shape [M_view].
    """

    labels: NDArray[np.int16]
    claims: list[list[NDArray[np.bool_] | None]]


def follow_things(
    segmenter: Segmenter,
    foreground: NDArray[np.bool_],
    samples: PixelSamples,
    *,
    keys: Sequence[int],
    progress: Progress,
) -> Tracks:
    """Find things in the key views and follow each through all views.

    Args:
        segmenter: of V views along a smooth path.
        foreground: shape [V, H, W].
        samples: pixels whose membership is remembered for every id, V entries.
        keys: views in which things are looked for, in this order.
        progress: told about every view.
    """
    view_count = len(foreground)
    labels = np.full(foreground.shape, -1, np.int16)
    best = np.zeros(foreground.shape, np.float32)
    claims: list[list[NDArray[np.bool_] | None]] = []
    for place, key in enumerate(keys):
        shown = int(foreground[key].sum())
        free = foreground[key] & (labels[key] < 0)
        if free.sum() <= _MIN_UNCLAIMED * shown:
            continue
        progress.update(place, len(keys), "key views searched for parts")
        masks = disjoint_parts(segmenter.propose(key, free), free, min_px=_MIN_NEW * shown)
        if not masks:
            continue
        first = len(claims)
        for _ in masks:
            claims.append([None] * view_count)
        what = f"views followed for {len(masks)} {'parts' if len(masks) > 1 else 'part'}"
        progress.update(0, view_count, what)
        for done, (view, logits) in enumerate(segmenter.track(key, masks), start=1):
            row, column = samples[view]
            for number, logit in enumerate(logits):
                inside = (logit > 0) & foreground[view]
                if not inside.any():
                    continue
                claims[first + number][view] = inside[row, column]
                wins = inside & (logit > best[view])
                labels[view][wins] = first + number
                best[view][wins] = logit[wins]
            progress.update(done, view_count, what)
    return Tracks(labels, claims)
