"""``group RUN``: parts of a run edited or found anew; what was said of them in the scene goes with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from phys4dgen.errors import RunError, SceneError, StageError
from phys4dgen.materials import read_materials
from phys4dgen.progress import SILENT, Progress
from phys4dgen.run.artefacts import read_groups
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.generate import Run, continue_run, scene_of_run
from phys4dgen.run.material_edits import write_both
from phys4dgen.run.part_flags import Clicks, edits_of_flags
from phys4dgen.run.state import finished_stages
from phys4dgen.scene import ALL_PARTS, PartEdit, Scene
from phys4dgen.scene.part_names import DEFAULT_NAME
from phys4dgen.types import MaterialBook

__all__ = ["regroup"]

T = TypeVar("T")
Moves = Mapping[str, tuple[str, ...]]
"""Name of a part, and the names of those that stand in its place; none where it is gone."""


def regroup(
    folder: Path | str,
    edits: Sequence[tuple[str, str]] = (),
    *,
    undo: bool = False,
    parts: Any = None,
    progress: Progress = SILENT,
) -> Run:
    """Edit the parts of a run, and make its grouping again; later stages follow at the next ``continue_run``.

    What fails leaves the run as it was.

    Args:
        folder: the run folder.
        edits: ("merge", "a,b"), ("rename", "old=new"), ("split", "a=2") or ("seed", "a@view,x,y") in order, as
            ``part_flags`` says.
        undo: take the last edit back instead.
        parts: find so many parts anew instead ("auto" or a number); names and edits of the old ones go.
        progress: told what happens.

    Raises:
        Phys4DGenError: no run, no such part, view or place, no such pieces, or nothing to take back.
    """
    scene, moves = scene_of_run(folder), list[Moves]()
    if scene.objects:
        raise SceneError(
            f"{folder}: holds several objects; say in its scene.yaml how each is divided, below "
            f"objects.NAME.grouping.edits, and run 'phys4dgen simulate {folder}'."
        )
    if undo:
        if not scene.grouping.edits:
            raise SceneError("--undo: the parts have not been edited.")
        *earlier, last = scene.grouping.edits
        moves.append(_moves_back(scene, last, earlier=earlier))
        scene = with_moves(scene, moves[0], edits=earlier)
    elif parts is not None:
        moves.append({name: () for name in _mentioned(scene) if not DEFAULT_NAME.fullmatch(name)})
        scene = with_parts_anew(with_moves(scene, moves[0], edits=()), parts)
    else:
        run = RunFolder(folder)
        for edit in edits_of_flags(edits, part_names_of_run(folder), Clicks(run, scene)):
            moves.append(_moves(scene, edit))
            scene = with_moves(scene, moves[-1], edits=[*scene.grouping.edits, edit])
    for name in (name for move in moves for name, new in move.items() if not new):
        progress.warn(f"What the scene said of part '{name}' is dropped: there is no such part now.")
    made = _made(folder, scene, progress)
    with RunFolder(folder).claim() as run:
        for move in moves:
            move_in_materials(run, move)
    return made


def _made(folder: Path | str, scene: Scene, progress: Progress) -> Run:
    """The run with the parts of a scene; where they cannot be made, the scene and the report stay as they were."""
    run = RunFolder(folder)
    before = {path: path.read_text("utf-8") for path in (run.scene_yaml, run.report_json) if path.is_file()}
    try:
        return continue_run(folder, scene, since="grouping", until="grouping", progress=progress)
    except (SceneError, StageError):
        for path, text in before.items():
            run.write_text(path, text)
        raise


def part_names_of_run(folder: Path | str) -> tuple[str, ...]:
    """Names of the parts of a run as they are now.

    Raises:
        RunError: the run has no parts yet.
    """
    if "grouping" not in finished_stages(folder):
        raise RunError(
            f"{folder}: the parts are not found yet; 'phys4dgen simulate {folder} --until grouping' does it."
        )
    return read_groups(RunFolder(folder)).names


def with_moves(scene: Scene, moves: Moves, *, edits: Sequence[PartEdit]) -> Scene:
    """The scene with other edits; options and forces follow the parts that they were meant for."""
    tree = scene.model_dump()
    lists = {key: _followed_entries(tree[key], moves) for key in ("forces", "boundaries", "changes")}
    dumped = tuple(edit.model_dump() for edit in edits)
    options = _followed(tree["parts"], moves)
    return scene.with_overrides({"grouping.edits": dumped, "parts": options, **lists})


def _followed_entries(entries: Sequence[dict[str, Any]], moves: Moves) -> tuple[dict[str, Any], ...]:
    """Forces or boundaries that follow the parts that they were meant for; those of no part stay."""
    joined = {new for names in moves.values() for new in names}
    found: list[dict[str, Any]] = []
    for entry in entries:
        if "part" not in entry:
            found.append(entry)
            continue
        for new in moves.get(entry["part"], (entry["part"],)):
            follower = {**entry, "part": new}
            if new not in joined or follower not in found:  # the same push on parts that become one is one push
                found.append(follower)
    return tuple(found)


def with_parts_anew(scene: Scene, count: Any) -> Scene:
    """The scene with another number of parts; names were of the old ones and go."""
    return scene.with_overrides({"grouping.parts": count, "grouping.names": {}}, sources={"grouping.parts": "--parts"})


def move_in_materials(run: RunFolder, moves: Moves) -> None:
    """Let what a person wrote into materials.yaml follow parts that get other names."""
    files = run.materials_yaml, run.identified_yaml
    if all(path.is_file() for path in files):
        to = {name: new for name, new in moves.items() if new}
        book, identified = (MaterialBook(_followed(read_materials(path), to)) for path in files)
        write_both(*files, book=book, identified=identified)


def _followed(said: Mapping[str, T], moves: Moves) -> dict[str, T]:
    """What was said of parts, under the names of those that stand in their place.

    Where parts become one, what was said of the one that they join wins, then what was said first.
    """
    result = {name: own for name, own in said.items() if name not in moves}
    for name in moves:
        if name in said:
            for new in moves[name]:
                result.setdefault(new, said[name])
    return result


def _moves(scene: Scene, edit: PartEdit) -> Moves:
    """What becomes of the parts that a scene speaks of by one more edit."""
    if edit.rename is not None and edit.to is not None:
        return {edit.rename: (edit.to,)}
    if edit.merge:
        return dict.fromkeys(edit.merge[1:], (edit.merge[0],))
    if edit.split is not None:
        return {edit.split: edit.pieces_of}
    return {name: () for name in _mentioned(scene) if name not in edit.seeds}


def _moves_back(scene: Scene, edit: PartEdit, *, earlier: Sequence[PartEdit]) -> Moves:
    """What becomes of the parts that a scene speaks of when its last edit is taken back."""
    if edit.rename is not None and edit.to is not None:
        return {edit.to: (edit.rename,)}
    if edit.split is not None:
        return {name: (edit.split,) for name in edit.pieces_of if name != edit.split}
    known = {*scene.grouping.names.values(), *(edit.to for edit in earlier), *(n for e in earlier for n in e.pieces_of)}
    return {name: () for name in _mentioned(scene) if name in edit.seeds and name not in known}


def _mentioned(scene: Scene) -> list[str]:
    """Names of parts with options or forces of their own."""
    entries = [getattr(entry, "part", ALL_PARTS) for entry in (*scene.forces, *scene.boundaries, *scene.changes)]
    return [name for name in dict.fromkeys((*scene.parts, *entries)) if name != ALL_PARTS]
