"""Parts by colour and shape alone: a deterministic stand-in for SAM2 that needs no weights.

Paper: Sec. 3.2 (3D Material Grouping), with rendered colour in the place of a segmentation network's masks. Steps:
rendered colour of the visible surface -> supervoxels -> merge tree -> cut -> every Gaussian follows. What colour and
thinness cannot tell apart (a sunburst guitar, a printed box, a trunk from the pot it stands in) it gets wrong; a
number of parts, a file of labels or a real segmenter is the answer there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from phys4dgen.errors import StageError
from phys4dgen.grouping.attach import attach, number_from_the_ground
from phys4dgen.grouping.clicked import parts_by_random_walk
from phys4dgen.grouping.cutting import MAX_PARTS, cut_tree
from phys4dgen.grouping.merging import MergeTree, merge_tree
from phys4dgen.grouping.patch_graph import PatchGraph, patch_graph
from phys4dgen.grouping.seeds import seed_patches
from phys4dgen.grouping.supervoxels import core_gaussians, object_radius, supervoxels
from phys4dgen.grouping.surface_color import surface_color
from phys4dgen.progress import Progress, SilentProgress
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.views import render_views
from phys4dgen.types import Frame, Gaussians, Parts, Views

__all__ = ["APPEARANCE_BACKEND", "appearance_tree", "group_by_appearance", "parts_from_seeds", "parts_from_tree"]

APPEARANCE_BACKEND = "appearance (stand-in for SAM2)"

_VIEW_SIZE_PX = 256
_DEPTH_TOLERANCE = 0.02
"""Of the object's radius: a Gaussian nearer than this to the rendered depth is the visible surface."""
_MIN_CORE = 9
"""With fewer visible Gaussians there is nothing to divide."""


def group_by_appearance(
    gaussians: Gaussians,
    frame: Frame,
    *,
    parts: int | None = None,
    views: Views | None = None,
    progress: Progress | None = None,
) -> tuple[Parts, MergeTree]:
    """Divide an object into parts of one appearance, numbered from the ground up.

    Args:
        gaussians: N static Gaussians.
        frame: which way is up.
        parts: number of parts wished for, 1 to 60; None decides by colour and shape.
        views: as for ``appearance_tree``.
        progress: told about every view and step.

    Returns:
        The parts, and the tree that gives any other number of them by ``parts_from_tree`` without a new run.

    Raises:
        StageError: the number of parts is out of range, or nearly nothing of the object can be seen.
    """
    _check_count(parts)
    tree = appearance_tree(gaussians, frame, views=views, progress=progress)
    return parts_from_tree(tree, gaussians, frame, parts=parts), tree


def appearance_tree(
    gaussians: Gaussians, frame: Frame, *, views: Views | None = None, progress: Progress | None = None
) -> MergeTree:
    """How the visible surface of an object joins, patch by patch, into one.

    Args:
        gaussians: N static Gaussians.
        frame: which way is up.
        views: rendered over white from all around, depth included; None renders the ``object`` views.
        progress: told about every view and step.

    Raises:
        StageError: nearly nothing of the object can be seen.
    """
    progress = progress or SilentProgress()
    if views is None:
        lower, upper = gaussians.robust_bounds(rotation=frame.rotation)
        cameras = view_cameras("object", lower=lower, upper=upper, rotation=frame.rotation, size_px=_VIEW_SIZE_PX)
        steps = len(cameras) + 2
        views = render_views(gaussians, cameras, on_view=lambda done: progress.update(done, steps, "views and steps"))
    else:
        steps = 2
    radius = object_radius(gaussians)
    surface = surface_color(gaussians, views, tolerance=_DEPTH_TOLERANCE * radius)
    core = core_gaussians(gaussians, surface, radius)
    if len(core) < _MIN_CORE:
        raise StageError(
            f"grouping: expected an object that can be seen, but only {len(core)} of {len(gaussians)} Gaussians form a "
            "visible surface; check the input with 'phys4dgen inspect', or use grouping.backend 'none'."
        )
    patches = supervoxels(gaussians, surface, core, radius=radius)
    progress.update(steps - 1, steps, "views and steps")
    tree = merge_tree(patch_graph(patches, gaussians.means, surface.seen.max(1), radius=radius))
    progress.update(steps, steps, "views and steps")
    return tree


def parts_from_tree(tree: MergeTree, gaussians: Gaussians, frame: Frame, *, parts: int | None = None) -> Parts:
    """Cut a merge tree of the same Gaussians again, at another number of parts.

    Args:
        tree: from ``group_by_appearance``.
        gaussians: the Gaussians that it was made of.
        frame: which way is up.
        parts: number of parts wished for, 1 to 60; None decides by colour and shape. Fewer come back where the
            object does not hold as many parts of at least 0.4 % of its surface.

    Raises:
        StageError: the number of parts is out of range, or the tree belongs to other Gaussians.
    """
    _check_count(parts)
    _check_fit(tree.graph, gaussians)
    graph = tree.graph
    labels = attach(gaussians, graph.patch, cut_tree(tree, parts), color=graph.color, radius=object_radius(gaussians))
    numbered, old = number_from_the_ground(labels, gaussians, frame)
    names = tuple(f"part_{i}" for i in range(len(old)))
    return Parts(labels=numbered, names=names, backend=APPEARANCE_BACKEND, visible=graph.visible)


def parts_from_seeds(
    graph: PatchGraph, gaussians: Gaussians, frame: Frame, seeds: Mapping[str, Sequence[int]]
) -> Parts:
    """The parts that a person has pointed at, those and no others.

    Args:
        graph: ``graph`` of the merge tree of the same Gaussians.
        gaussians: N static Gaussians.
        frame: which way is up.
        seeds: by the name of each part, indices of one or more Gaussians of it (``seeds.gaussian_at``).

    Raises:
        StageError: two parts are pointed at in one place, one is too small, or the graph belongs to other Gaussians.
    """
    _check_fit(graph, gaussians)
    part_of_patch = parts_by_random_walk(graph, seed_patches(graph, gaussians, seeds))
    labels = attach(gaussians, graph.patch, part_of_patch, color=graph.color, radius=object_radius(gaussians))
    numbered, old = number_from_the_ground(labels, gaussians, frame)
    names = list(seeds)
    lost = [name for number, name in enumerate(names) if number not in old]
    if lost:
        raise StageError(
            f"grouping: what was clicked on as '{lost[0]}' is too small to be a part; click elsewhere on it."
        )
    return Parts(
        labels=numbered,
        names=tuple(names[number] for number in old),
        backend=APPEARANCE_BACKEND,
        visible=graph.visible,
    )


def _check_fit(graph: PatchGraph, gaussians: Gaussians) -> None:
    if len(graph.patch) != len(gaussians):
        raise StageError(
            f"grouping: expected the merge tree of these {len(gaussians)} Gaussians, got one of {len(graph.patch)}; "
            "run grouping again."
        )


def _check_count(parts: int | None) -> None:
    if parts is not None and not 1 <= parts <= MAX_PARTS:
        raise StageError(f"grouping.parts: expected 1 to {MAX_PARTS} parts, or auto, got {parts}.")
