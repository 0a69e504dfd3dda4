"""Parts: which Gaussians belong together (Paper: Sec. 3.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from phys4dgen.grouping.appearance import appearance_tree, parts_from_tree
from phys4dgen.grouping.doubt import reason_to_doubt
from phys4dgen.grouping.edits import edited_parts
from phys4dgen.grouping.from_file import parts_from_file, rename_parts, single_part
from phys4dgen.grouping.label_maps import holds_label_maps, read_label_maps
from phys4dgen.grouping.lift import lift, parts_from_maps
from phys4dgen.grouping.merging import MergeTree
from phys4dgen.progress import Progress
from phys4dgen.render.views import render_views
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.stages.naming import names_from_picture
from phys4dgen.stages.segmentation import decide, part_pointed_at, parts_by_sam2
from phys4dgen.stages.views import rendered
from phys4dgen.types import Parts, Views

__all__ = ["find_tree", "group"]

_CURE = (
    "See parts.png; where it is wrong, give the number of parts (--parts N), click on them ('phys4dgen group RUN "
    "--seed NAME@VIEW,X,Y'), use SAM2 (--grouping.backend sam2), or bring label maps (--grouping.labels-file)."
)


def find_tree(scene: Scene, asset: Asset, views: Views, progress: Progress) -> MergeTree:
    """How the object's surface joins into parts by colour and shape; the number of parts is not yet decided."""
    seen = _object_views(scene, asset, views, progress)
    return appearance_tree(asset.evenly_lit, asset.frame, views=seen, progress=progress)


def group(
    scene: Scene, asset: Asset, views: Views, tree: Callable[[], MergeTree], kept: Path, progress: Progress
) -> Parts:
    """Divide the Gaussians into parts (Paper: Sec. 3.2).

    Args:
        scene: how, and what is corrected.
        asset: the object.
        views: of it.
        tree: returns what ``find_tree`` made.
        kept: folder in which masks of a network are kept and looked for.
        progress: told what is found.
    """
    wanted = scene.grouping
    gaussians, frame = asset.evenly_lit, asset.frame
    if wanted.labels_file is not None and holds_label_maps(wanted.labels_file):
        parts = _lifted(scene, wanted.labels_file, asset, views)
    elif wanted.labels_file is not None:
        rows = None if asset.surroundings is None else asset.surroundings.object_rows
        parts = parts_from_file(wanted.labels_file, len(asset.whole), rows=rows)
    elif wanted.backend == "none":
        parts = single_part(len(gaussians))
    else:
        parts = _found(scene, asset, views, tree, kept, progress)
    names = wanted.names
    if wanted.named_picture is not None:
        by_picture = names_from_picture(scene, asset, views, parts, progress)
        names = {number: name for number, name in by_picture.items() if name not in names.values()} | names
    parts = rename_parts(parts, names)
    for edit in wanted.edits:
        if edit.by == "sam2":
            parts = part_pointed_at(scene, asset, views, parts, edit, progress)
        else:
            parts = edited_parts(parts, edit, gaussians=gaussians, frame=frame, tree=tree)
    progress.note(f"{parts.count} parts by {parts.backend}: {', '.join(parts.names)}.")
    return parts


def _found(
    scene: Scene, asset: Asset, views: Views, tree: Callable[[], MergeTree], kept: Path, progress: Progress
) -> Parts:
    """Parts by SAM2, or by its stand-in; says which and why."""
    wanted = scene.grouping
    if wanted.backend != "appearance":
        decision = decide(scene, len(views))
        if decision.folder is not None:
            progress.note(f"Parts by SAM2: {decision.why}.")
            return parts_by_sam2(scene, asset, views, decision, kept, progress)
        progress.note(f"Parts by appearance and not by SAM2: {decision.why}.")
    count = None if isinstance(wanted.parts, str) else wanted.parts
    parts = parts_from_tree(tree(), asset.evenly_lit, asset.frame, parts=count)
    doubt = reason_to_doubt(tree(), parts.count, wanted=count)
    if doubt is not None and not wanted.edits:  # whoever edits parts has looked at them
        progress.warn(f"The parts are uncertain: {doubt}. {_CURE}")
    return parts


def _lifted(scene: Scene, path: Path, asset: Asset, views: Views) -> Parts:
    """Parts from label maps that the user brings; depth is rendered again where their cameras are not the run's."""
    maps = read_label_maps(path, cameras=views.cameras)
    same = len(maps.cameras) == len(views) and all(
        (a.width, a.height) == (b.width, b.height) and np.array_equal(a.viewmat, b.viewmat) and np.array_equal(a.K, b.K)
        for a, b in zip(maps.cameras, views.cameras, strict=True)
    )
    lifted = lift(
        asset.gaussians,
        maps.masks,
        cameras=maps.cameras,
        depth=views.depth if same else render_views(asset.gaussians, maps.cameras).depth,
        occlusion_threshold_rel=scene.grouping.occlusion_threshold_rel,
    )
    return parts_from_maps(maps, lifted)


def _object_views(scene: Scene, asset: Asset, views: Views, progress: Progress) -> Views:
    """Parts are read from the ``object`` table, evenly lit, whatever views the user wants to look at."""
    if asset.even_colors is not None:
        return rendered(replace(asset, gaussians=asset.evenly_lit), "object", 256, progress)
    return views if scene.views.preset == "object" else rendered(asset, "object", 256, progress)
