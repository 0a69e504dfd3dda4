"""Parts by SAM2: rendered views -> masks with ids -> ids joined in 3D -> the vote of the views (Paper: Sec. 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

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

__all__ = [
    "FOREGROUND",
    "Segments",
    "compared_surface",
    "find_segments",
    "on_path",
    "parts_of_segments",
    "segments_of_tracks",
]

FOREGROUND = 0.5
"""Opacity above which a pixel shows the object."""
_COMPARED = 10_000
"""Gaussians that ids are compared by, evenly taken from all."""
_EXTENT = 3.0
"""As in ``lift``: standard deviations of a Gaussian within which its depth must agree."""
_MIN_PART = 0.002
"""A smaller share of the visible Gaussians is no part: they go where their other votes say."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Label maps of views: the thing that each pixel shows.

    Attributes:
        labels: things 0 .. T-1, -1 where nothing is claimed, shape [V, H, W], int32.
        id_count: ids before they were joined.
        claimed: share of the object's pixels that are claimed.
    """

    labels: NDArray[np.int32]
    id_count: int
    claimed: float

    @property
    def thing_count(self) -> int:
        """Number of things T."""
        return int(self.labels.max(initial=-1)) + 1


def on_path(views: Views, wanted: int | None = None, *, keep: int | None = None) -> Views:
    """The views in the order of a smooth path.

    Args:
        views: in any order.
        wanted: so many of them at most, evenly taken along the path; None for all.
        keep: number of a view that shall be among them; it takes the place of the nearest one on the path.
    """
    order = smooth_path(views.cameras)
    if wanted is not None and wanted < len(order):
        places = np.linspace(0, len(order) - 1, wanted).round().astype(np.intp)
        if keep is not None:
            place = int(np.flatnonzero(order == keep)[0])
            places[np.abs(places - place).argmin()] = place
        order = order[places]
    cameras = tuple(views.cameras[number] for number in order)
    return Views(cameras, views.rgb[order], views.alpha[order], views.depth[order])


def find_segments(
    gaussians: Gaussians, views: Views, segmenter: Segmenter, *, key_views: int = 8, progress: Progress = SILENT
) -> Segments:
    """Let a segmenter find things in the views and follow them, and join what is one thing in 3D.

    Args:
        gaussians: N static Gaussians.
        views: V views in the order of a smooth path (``on_path``).
        segmenter: of these views.
        key_views: views in which things are looked for, at most.
        progress: told about every view.

    Raises:
        StageError: the segmenter finds nothing.
    """
    foreground = views.alpha > FOREGROUND
    surface, samples = compared_surface(gaussians, views)
    keys = key_places(len(views), key_views)
    tracks = follow_things(segmenter, foreground, samples, keys=keys, progress=progress)
    if not tracks.claims:
        raise StageError(
            "grouping: SAM2 found no mask that it is sure of in any view; use grouping.backend 'appearance', or raise "
            "grouping.sam2.points_per_side."
        )
    return segments_of_tracks(tracks, joined_ids(tracks, surface), foreground)


def parts_of_segments(
    segments: Segments,
    gaussians: Gaussians,
    frame: Frame,
    views: Views,
    *,
    backend: str,
    occlusion_threshold_rel: float = OCCLUSION_THRESHOLD_REL,
) -> Parts:
    """Let the views vote on the part of every Gaussian.

    Args:
        segments: of the views.
        gaussians: N static Gaussians.
        frame: which way is up.
        views: V views that the segments belong to.
        backend: for the report.
        occlusion_threshold_rel: as for ``lift``.

    Returns:
        The parts, numbered from the ground up.

    Raises:
        StageError: no visible Gaussian falls on a claimed pixel.
    """

    def vote(labels: NDArray[np.int32]) -> Lifted:
        return lift(
            gaussians, Masks(labels), cameras=views.cameras, depth=views.depth,
            occlusion_threshold_rel=occlusion_threshold_rel,
        )  # fmt: skip

    lifted = vote(segments.labels)
    size = np.bincount(lifted.labels[lifted.visible], minlength=segments.thing_count)
    is_part = size >= _MIN_PART * lifted.visible.sum()
    if not is_part.all():
        kept = (segments.labels >= 0) & is_part[segments.labels]
        lifted = vote(np.where(kept, segments.labels, -1).astype(np.int32))
    numbered, old = number_from_the_ground(lifted.labels.astype(np.int64), gaussians, frame)
    return Parts(
        labels=numbered,
        names=tuple(f"part_{number}" for number in range(len(old))),
        backend=backend,
        votes=lifted.votes[:, old],
        visible=lifted.visible,
    )


def segments_of_tracks(tracks: Tracks, meaning: NDArray[np.int32], foreground: NDArray[np.bool_]) -> Segments:
    """Label maps with things, numbered without gaps, in the place of ids.

    Args:
        tracks: ids of V views.
        meaning: thing of each id in each view, -1 for none, shape [ids, V] (``joined_ids``).
        foreground: shape [V, H, W].
    """
    labels = np.full(tracks.labels.shape, -1, np.int32)
    for view, ids in enumerate(tracks.labels):
        known = ids >= 0
        labels[view][known] = meaning[ids[known], view]
    used = np.unique(labels[labels >= 0])
    labels = np.where(labels >= 0, np.searchsorted(used, labels), -1).astype(np.int32)
    return Segments(labels, len(tracks.claims), float((labels[foreground] >= 0).mean()))


def compared_surface(
    gaussians: Gaussians, views: Views
) -> tuple[Surface, list[tuple[NDArray[np.intp], NDArray[np.intp]]]]:
    """Gaussians evenly taken from all, and the pixels at which each view shows them."""
    few = gaussians.subset(np.arange(0, len(gaussians), max(1, len(gaussians) // _COMPARED)))
    lower, upper = gaussians.robust_bounds()
    bound = OCCLUSION_THRESHOLD_REL * float((upper - lower).max())
    tolerance = np.minimum(_EXTENT * few.scales.max(1).astype(np.float64), bound)
    seen, samples = [], []
    for camera, depth in zip(views.cameras, views.depth, strict=True):
        index, row, column, _ = visible_pixels(few.means, camera, depth, tolerance=tolerance)
        seen.append(index)
        samples.append((row, column))
    lab = srgb_to_lab(few.base_colors) * [LIGHTNESS_WEIGHT, 1, 1]
    return Surface(few.means.astype(np.float64), lab, seen), samples
