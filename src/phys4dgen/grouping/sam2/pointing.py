"""What a person points at, by a click or a box, as a part of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import StageError, did_you_mean
from phys4dgen.grouping.lift import OCCLUSION_THRESHOLD_REL, lift
from phys4dgen.grouping.sam2.group import FOREGROUND
from phys4dgen.grouping.sam2.segmenter import Segmenter
from phys4dgen.grouping.split import with_pieces
from phys4dgen.progress import SILENT, Progress
from phys4dgen.types import Frame, Gaussians, Masks, Parts, Views

__all__ = ["Pointing", "cut_out_piece"]

_DEPTH_REL = 0.02
"""A clicked point is shown by a view if the rendered depth differs by less than this share of the object's size."""
_MARGIN = 0.05
"""Of the picture: a point nearer to its edge is not shown well."""


@dataclass(frozen=True, eq=False)
class Pointing:
    """Clicks or a box.

    Attributes:
        points: on the surface, input coordinates, shape [K, 3]; or None.
        view: number of the view that a box is drawn in.
        box: left, top, right and bottom in widths and heights of that view, shape [4]; or None.
    """

    points: NDArray[np.float64] | None = None
    view: int = 0
    box: NDArray[np.float64] | None = None


def cut_out_piece(
    parts: Parts,
    name: str,
    piece: str,
    pointing: Pointing,
    *,
    gaussians: Gaussians,
    frame: Frame,
    views: Views,
    make_segmenter: Callable[[NDArray[np.uint8]], Segmenter],
    occlusion_threshold_rel: float = OCCLUSION_THRESHOLD_REL,
    progress: Progress = SILENT,
) -> Parts:
    """Divide one part into what is pointed at and the rest, which keeps its name.

    Args:
        parts: before.
        name: of the part.
        piece: name of what is pointed at.
        pointing: the click or box.
        gaussians: N static Gaussians.
        frame: which way is up.
        views: V views in the order of a smooth path.
        make_segmenter: makes a segmenter of the V pictures, uint8, shape [V, H, W, 3].
        occlusion_threshold_rel: as for ``lift``.
        progress: told about every view.

    Raises:
        StageError: there is no such part or the name is taken, no view shows what was clicked on, or the mask holds
            nothing or all of the part.
    """
    if name not in parts.names:
        raise StageError(
            f"grouping.edits: there is no part '{name}' to split; the parts are {', '.join(parts.names)}."
            f"{did_you_mean(name, parts.names)}"
        )
    if piece in parts.names:
        raise StageError(f"grouping.edits: a piece of '{name}' cannot be called '{piece}': there is such a part.")
    view, pixels, box = _prompt(pointing, gaussians, views)
    segmenter = make_segmenter(np.rint(np.clip(views.rgb, 0, 1) * 255).astype(np.uint8))
    foreground = views.alpha > FOREGROUND
    mask = segmenter.segment(view, points=pixels, box=box).mask & foreground[view]
    labels = np.where(foreground, 1, -1).astype(np.int32)
    if mask.any():
        for done, (other, logits) in enumerate(segmenter.track(view, [mask]), start=1):
            labels[other][(logits[0] > 0) & foreground[other]] = 0
            progress.update(done, len(views), "views followed for the piece")
    rows = np.flatnonzero(parts.labels == parts.names.index(name))
    if not (labels == 0).any():
        raise StageError(f"grouping.edits: SAM2 sees nothing of its own where '{piece}' was pointed at; try a box.")
    lifted = lift(
        gaussians.subset(rows), Masks(labels), cameras=views.cameras, depth=views.depth,
        occlusion_threshold_rel=occlusion_threshold_rel,
    )  # fmt: skip
    share = float((lifted.labels == 0).mean())
    if not 0 < share < 1:
        raise StageError(
            f"grouping.edits: what SAM2 finds for '{piece}' holds {'all' if share else 'nothing'} of '{name}'; point "
            "at another place, or draw a box round the piece."
        )
    return with_pieces(parts, rows, lifted.labels, name=name, names=(piece, name), gaussians=gaussians, frame=frame)


def _prompt(
    pointing: Pointing, gaussians: Gaussians, views: Views
) -> tuple[int, NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """The view to point in, and the clicks or the box in its pixels."""
    if pointing.box is not None:
        camera = views.cameras[pointing.view]
        size = [camera.width, camera.height]
        return pointing.view, None, pointing.box * [*size, *size]
    assert pointing.points is not None
    lower, upper = gaussians.robust_bounds()
    tolerance = _DEPTH_REL * float((upper - lower).max())
    best: tuple[float, int, NDArray[np.float64]] | None = None
    for number, (camera, depth) in enumerate(zip(views.cameras, views.depth, strict=True)):
        pixels, z = camera.project(pointing.points)
        size = np.array([camera.width, camera.height])
        if ((pixels < _MARGIN * size) | (pixels > (1 - _MARGIN) * size) | (z[:, None] <= 0)).any():
            continue
        column, row = pixels.astype(np.intp).T
        difference = float(np.abs(depth[row, column] - z).max())
        if difference < tolerance and (best is None or difference < best[0]):
            best = difference, number, pixels
    if best is None:
        raise StageError("grouping.edits: no view shows what was clicked on; click on another place of it.")
    return best[1], best[2], None
