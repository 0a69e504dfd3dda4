"""SAM2 for the stage that finds parts: whether it is used, what it finds, and its masks kept."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import FormatError, StageError
from phys4dgen.formats.atomic import atomic_path
from phys4dgen.grouping.npy_files import read_npz
from phys4dgen.grouping.sam2.cost import predicted_cost
from phys4dgen.grouping.sam2.group import Segments, find_segments, on_path, parts_of_segments
from phys4dgen.grouping.sam2.pointing import Pointing, cut_out_piece
from phys4dgen.grouping.sam2.proposals import Choice
from phys4dgen.grouping.sam2.segmenter import Segmenter
from phys4dgen.progress import Progress
from phys4dgen.scene import PartEdit, Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.types import Parts, Views
from phys4dgen.weights import chosen_device, weights_folder

__all__ = ["Decision", "decide", "part_pointed_at", "parts_by_sam2"]

AUTO_LIMIT_S = 180.0
"""``auto`` takes SAM2 where it is predicted to need no longer."""
_MAX_BYTES = 1 << 31


@dataclass(frozen=True)
class Decision:
    """Whether SAM2 finds the parts.

    Attributes:
        folder: with its weights; None where it does not.
        device: of PyTorch.
        seconds: predicted.
        why: reason in half a sentence.
    """

    folder: Path | None
    device: str
    seconds: float
    why: str


def decide(scene: Scene, view_count: int) -> Decision:
    """Whether the scene's parts, or edits of them, are asked of SAM2.

    Args:
        scene: what is asked for.
        view_count: views that there are.

    Raises:
        StageError: it is asked for by name and not ready; says what to do.
    """
    wanted = scene.grouping
    if wanted.backend == "auto" and wanted.parts != "auto":
        return Decision(None, "cpu", 0.0, "a number of parts is given, which SAM2 does not take")
    try:
        folder = weights_folder(wanted.sam2.weights, model="SAM2")
        device = chosen_device(wanted.sam2.device)
        views = view_count if isinstance(wanted.sam2.views, str) else min(wanted.sam2.views, view_count)
        seconds = predicted_cost(folder, device).total_s(views, wanted.sam2.points_per_side)
    except StageError as error:
        if wanted.backend == "sam2":
            raise
        return Decision(None, "cpu", 0.0, str(error).rstrip("."))
    if wanted.backend == "sam2":
        return Decision(folder, device, seconds, "it was asked for")
    if seconds > AUTO_LIMIT_S:
        why = f"it would take about {_minutes(seconds)} on this {device}; --grouping.backend sam2 asks for it"
        return Decision(None, device, seconds, why)
    return Decision(folder, device, seconds, f"its weights are here and about {_minutes(seconds)} are predicted")


def parts_by_sam2(
    scene: Scene, asset: Asset, views: Views, decision: Decision, folder: Path, progress: Progress
) -> Parts:
    """The parts that SAM2 finds; its masks are kept, so that an edit does not ask it again.

    Args:
        scene: how it is asked.
        asset: the object.
        views: of the run.
        decision: from ``decide``, with weights.
        folder: where masks are kept and looked for.
        progress: told about every view.
    """
    options = scene.grouping.sam2
    path = on_path(views, None if isinstance(options.views, str) else options.views)
    frames = _frames(path)
    settings = (options.weights, options.key_views, options.points_per_side, _weights_stamp(decision.folder))
    made_from = _digest(frames, asset.gaussians.means, repr(settings))
    segments = _kept(folder / "sam2.npz", made_from)
    if segments is None:
        progress.note(f"SAM2 ({options.weights}) on {decision.device}: about {_minutes(decision.seconds)}.")
        segmenter = _segmenter(scene, decision, frames, progress)
        segments = find_segments(asset.gaussians, path, segmenter, key_views=options.key_views, progress=progress)
        _keep(folder / "sam2.npz", segments, made_from)
    else:
        progress.note("The masks of SAM2 are those of the last time: nothing that they follow from has changed.")
    parts = parts_of_segments(
        segments, asset.gaussians, asset.frame, path,
        backend=f"sam2 ({options.weights}, {len(path)} views)",
        occlusion_threshold_rel=scene.grouping.occlusion_threshold_rel,
    )  # fmt: skip
    progress.note(
        f"SAM2 followed {segments.id_count} masks, {segments.thing_count} things after joining them in 3D; "
        f"{100 * segments.claimed:.0f} % of the object's pixels are claimed."
    )
    return parts


def part_pointed_at(
    scene: Scene, asset: Asset, views: Views, parts: Parts, edit: PartEdit, progress: Progress
) -> Parts:
    """One part divided by SAM2: what was clicked on or boxed becomes a part of its own.

    Raises:
        StageError: SAM2 is not ready, the view is gone, or the mask holds nothing or all of the part.
    """
    options = scene.grouping.sam2
    folder = weights_folder(options.weights, model="SAM2")
    decision = Decision(folder, chosen_device(options.device), 0.0, "it was asked for")
    wanted = None if isinstance(options.views, str) else options.views
    if edit.seeds:
        piece, points = next(iter(edit.seeds.items()))
        path = on_path(views, wanted)
        pointing = Pointing(points=np.array(points))
    else:
        piece, box = next(iter(edit.boxes.items()))
        number = _view_number(box.view, len(views), piece)
        path = on_path(views, wanted, keep=number)
        place = next(i for i, camera in enumerate(path.cameras) if camera is views.cameras[number])
        pointing = Pointing(view=place, box=np.array(box.corners))
    return cut_out_piece(
        parts, str(edit.split), piece, pointing,
        gaussians=asset.gaussians, frame=asset.frame, views=path,
        make_segmenter=lambda frames: _segmenter(scene, decision, frames, progress),
        occlusion_threshold_rel=scene.grouping.occlusion_threshold_rel, progress=progress,
    )  # fmt: skip


def _view_number(name: str, count: int, piece: str) -> int:
    """Number of the view of that name."""
    names = [f"view_{number:02d}" for number in range(count)]
    if name not in names:
        raise StageError(f"grouping.edits: the box for '{piece}' is in '{name}', and there is no such view now.")
    return names.index(name)


def _segmenter(scene: Scene, decision: Decision, frames: NDArray[np.uint8], progress: Progress) -> Segmenter:
    """The network with all views encoded."""
    from phys4dgen.grouping.sam2.network import Sam2Network, Sam2Segmenter

    assert decision.folder is not None
    network = Sam2Network(decision.folder, device=decision.device)
    return Sam2Segmenter(
        network,
        frames,
        choice=Choice(points_per_side=scene.grouping.sam2.points_per_side),
        on_view=lambda done: progress.update(done, len(frames), "views encoded"),
    )


def _frames(views: Views) -> NDArray[np.uint8]:
    return np.rint(np.clip(views.rgb, 0, 1) * 255).astype(np.uint8)


def _weights_stamp(folder: Path | None) -> list[tuple[str, int, int]]:
    """What tells one set of weights from another without reading them through."""
    files = [] if folder is None else sorted(folder.glob("*.safetensors"))
    return [(file.name, (stat := file.stat()).st_size, stat.st_mtime_ns) for file in files]


def _digest(frames: NDArray[np.uint8], means: NDArray[np.float32], settings: str) -> str:
    hasher = hashlib.sha256(settings.encode())
    for array in (frames, means):
        hasher.update(np.ascontiguousarray(array).data)
    return hasher.hexdigest()


def _keep(path: Path, segments: Segments, made_from: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            labels=segments.labels.astype(np.int16),
            id_count=np.array(segments.id_count),
            claimed=np.array(segments.claimed),
            made_from=np.array(made_from),
        )


def _kept(path: Path, made_from: str) -> Segments | None:
    """The masks of an earlier run, where they still hold."""
    if not path.is_file():
        return None
    with suppress(FormatError, KeyError):
        arrays = read_npz(path, "labels", {"labels": _MAX_BYTES, "id_count": 8, "claimed": 8, "made_from": 1024})
        if str(arrays["made_from"]) == made_from:
            return Segments(arrays["labels"].astype(np.int32), int(arrays["id_count"]), float(arrays["claimed"]))
    return None


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
