"""Parts by SAM2: rendered views -> masks with ids -> ids joined in 3D -> the vote of the views (Paper: Sec. 3.2)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import StageError
from phys4dgen.grouping.attach import number_from_the_ground
from phys4dgen.grouping.lift import OCCLUSION_THRESHOLD_REL, Lifted, lift
from phys4dgen.grouping.sam2.merging import Surface, joined_ids
from phys4dgen.grouping.sam2.segmenter import Segmenter
from phys4dgen.grouping.sam2.tracks import Tracks, follow_things
from phys4dgen.grouping.sam2.view_path import key_places, smooth_path
from phys4dgen.grouping.supervoxels import LIGHTNESS_WEIGHT
from phys4dgen.grouping.visibility import visible_pixels
from phys4dgen.progress import SILENT, Progress
from phys4dgen.types import Frame, Gaussians, Masks, Parts, Views
from phys4dgen.types.color import srgb_to_lab

__all__ = ["group_by_masks", "on_path"]

_COMPARED = 20_000
"""Gaussians that ids are compared by, evenly taken from all."""
_MIN_PART = 0.002
"""A smaller share of the visible Gaussians is no part: they go where their other votes say."""
_OPAQUE = 0.5


def on_path(views: Views, wanted: int | None = None) -> Views:
    """The views in the order of a smooth path, at most ``wanted`` of them, evenly taken along it."""
    order = smooth_path(views.cameras)
    if wanted is not None and wanted < len(order):
        order = order[np.linspace(0, len(order) - 1, wanted).round().astype(np.intp)]
    cameras = tuple(views.cameras[number] for number in order)
    return Views(cameras, views.rgb[order], views.alpha[order], views.depth[order])


def group_by_masks(
    gaussians: Gaussians,
    frame: Frame,
    views: Views,
    make_segmenter: Callable[[NDArray[np.uint8]], Segmenter],
    *,
    key_views: int = 8,
    occlusion_threshold_rel: float = OCCLUSION_THRESHOLD_REL,
    progress: Progress = SILENT,
) -> tuple[Parts, Masks]:
    """Divide an object into the things that a segmenter finds in its views.

    Args:
        gaussians: N static Gaussians.
        frame: which way is up.
        views: V views in the order of a smooth path (``on_path``).
        make_segmenter: makes a segmenter of the V pictures, uint8, shape [V, H, W, 3].
        key_views: views in which parts are looked for, at most.
        occlusion_threshold_rel: as for ``lift``.
        progress: told about every view.

    Returns:
        The parts, numbered from the ground up, and the label maps that voted for them, in which labels are part
        numbers and -1 abstains.

    Raises:
        StageError: the segmenter finds nothing.
    """
    foreground = views.alpha > _OPAQUE
    if not foreground.any():
        raise StageError("grouping: expected views that show the object, got empty ones.")
    surface, samples = _surface(gaussians, views)
    segmenter = make_segmenter(np.rint(np.clip(views.rgb, 0, 1) * 255).astype(np.uint8))
    tracks = follow_things(segmenter, foreground, samples, keys=key_places(len(views), key_views), progress=progress)
    if not tracks.claims:
        raise StageError(
            "grouping: the segmenter found no mask that it is sure of in any view; use grouping.backend 'appearance'."
        )
    labels = _meant(tracks, joined_ids(tracks, surface))

    def vote(labels: NDArray[np.int32]) -> Lifted:
        return lift(
            gaussians, Masks(labels), cameras=views.cameras, depth=views.depth,
            occlusion_threshold_rel=occlusion_threshold_rel,
        )  # fmt: skip

    lifted = vote(labels)
    count = int(labels.max()) + 1
    size = np.bincount(lifted.labels[lifted.visible], minlength=count)
    is_part = size >= _MIN_PART * lifted.visible.sum()
    if not is_part.all():
        labels = np.where((labels >= 0) & is_part[labels], labels, -1).astype(np.int32)
        lifted = vote(labels)
    numbered, old = number_from_the_ground(lifted.labels.astype(np.int64), gaussians, frame)
    parts = Parts(
        labels=numbered,
        names=tuple(f"part_{number}" for number in range(len(old))),
        backend="sam2",
        votes=lifted.votes[:, old],
        visible=lifted.visible,
    )
    new = np.full(count, -1, np.int32)
    new[old] = np.arange(len(old))
    return parts, Masks(np.where(labels >= 0, new[labels], -1).astype(np.int32))


def _meant(tracks: Tracks, meaning: NDArray[np.int32]) -> NDArray[np.int32]:
    """Label maps with things in the place of ids."""
    labels = np.full(tracks.labels.shape, -1, np.int32)
    for view, ids in enumerate(tracks.labels):
        known = ids >= 0
        labels[view][known] = meaning[ids[known], view]
    return labels


def _surface(gaussians: Gaussians, views: Views) -> tuple[Surface, list[tuple[NDArray[np.intp], NDArray[np.intp]]]]:
    """Gaussians evenly taken from all, and the pixels at which each view shows them."""
    few = np.arange(0, len(gaussians), max(1, len(gaussians) // _COMPARED))
    few_gaussians = gaussians.subset(few)
    lower, upper = gaussians.robust_bounds()
    tolerance = np.minimum(
        3.0 * few_gaussians.scales.max(1), OCCLUSION_THRESHOLD_REL * float((upper - lower).max())
    ).astype(np.float64)
    seen, samples = [], []
    for camera, depth in zip(views.cameras, views.depth, strict=True):
        index, row, column, _ = visible_pixels(few_gaussians.means, camera, depth, tolerance=tolerance)
        seen.append(index)
        samples.append((row, column))
    lab = srgb_to_lab(few_gaussians.base_colors) * [LIGHTNESS_WEIGHT, 1, 1]
    return Surface(few_gaussians.means.astype(np.float64), lab, seen), samples
