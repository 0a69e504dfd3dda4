"""``group RUN``: parts of a run merged, renamed or found anew; what was said of them in the scene goes with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from phys4dgen.errors import RunError, SceneError, did_you_mean
from phys4dgen.grouping.edits import edited_parts
from phys4dgen.materials import read_materials, write_materials
from phys4dgen.progress import SILENT, Progress
from phys4dgen.run.artefacts import read_groups
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.generate import Run, continue_run, scene_of_run
from phys4dgen.run.state import finished_stages
from phys4dgen.scene import PartEdit, Scene
from phys4dgen.types import MaterialBook, Parts

__all__ = ["regroup"]


def regroup(
    folder: Path | str,
    edits: Sequence[tuple[str, str]] = (),
    *,
    undo: bool = False,
    parts: Any = None,
    progress: Progress = SILENT,
) -> Run:
    """Edit the parts of a run, and make its grouping again; later stages follow at the next ``continue_run``.

    Args:
        folder: the run folder.
        edits: ("merge", "a,b") or ("rename", "old=new") in order; a part stands by its name or, as in parts.png, by
            its number.
        undo: take the last edit back instead.
        parts: find so many parts anew instead ("auto" or a number); names and edits of the old ones go.
        progress: told what happens.

    Raises:
        Phys4DGenError: no run, no such part, or nothing to take back.
    """
    scene, renamed = scene_of_run(folder), {}
    if undo:
        scene, renamed = without_last_edit(scene)
    elif parts is not None:
        scene = with_parts_anew(scene, parts)
    else:
        names = part_names_of_run(folder)
        for kind, text in edits:
            edit = edit_named(kind, text, names)
            scene = with_edit(scene, edit)
            if edit.rename is not None and edit.to is not None:
                before = next((old for old, new in renamed.items() if new == edit.rename), edit.rename)
                renamed[before] = edit.to
            marks = Parts(np.arange(len(names), dtype=np.int32), names, "")
            names = edited_parts(marks, edit).names
    if renamed:
        with RunFolder(folder).claim() as run:
            rename_in_materials(run, renamed)
    return continue_run(folder, scene, since="grouping", until="grouping", progress=progress)


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


def edit_named(kind: str, text: str, names: Sequence[str]) -> PartEdit:
    """The edit of a flag.

    Args:
        kind: "merge" or "rename".
        text: ``a,b,c`` or ``old=new``; a part stands by its name or, as in parts.png, by its number.
        names: of the parts before the edit.

    Raises:
        SceneError: the text is not of this form, or there is no such part.
    """
    if kind == "merge":
        merged = [_part(word.strip(), names, "--merge") for word in text.split(",")]
        if len(set(merged)) < 2:
            raise SceneError(f"--merge: expected two or more parts such as leaves,stem, got '{text}'.")
        return PartEdit(merge=tuple(dict.fromkeys(merged)))
    old, equals, new = (word.strip() for word in text.partition("="))
    if not (old and equals and new):
        raise SceneError(f"--rename: expected OLD=NEW such as 0=pot, got '{text}'.")
    name = _part(old, names, "--rename")
    if new in names and new != name:
        raise SceneError(f"--rename: '{name}' cannot be called '{new}', which another part is called already.")
    return PartEdit.model_validate({"rename": name, "to": new})


def with_edit(scene: Scene, edit: PartEdit) -> Scene:
    """The scene with one more edit; options and forces follow the part that they were meant for."""
    edits = [*scene.model_dump()["grouping"]["edits"], edit.model_dump()]
    tree = scene.model_dump()
    parts: dict[str, Any] = tree["parts"]
    if edit.rename is not None and edit.to is not None:
        moved = {edit.rename: edit.to}
    else:
        moved = dict.fromkeys(edit.merge[1:], edit.merge[0])
    options: dict[str, Any] = {}
    for name, own in parts.items():
        options.setdefault(moved.get(name, name), own)  # what the first part of a merge says wins
    if edit.merge and edit.merge[0] in parts:
        options[edit.merge[0]] = parts[edit.merge[0]]
    forces = tuple({**force, "part": moved.get(force["part"], force["part"])} for force in tree["forces"])
    return scene.with_overrides({"grouping.edits": tuple(edits), "parts": options, "forces": forces})


def without_last_edit(scene: Scene) -> tuple[Scene, dict[str, str]]:
    """The scene before its last edit, and what is called otherwise now (old name to new).

    Raises:
        SceneError: there is no edit to take back.
    """
    if not scene.grouping.edits:
        raise SceneError("--undo: the parts have not been edited.")
    *earlier, last = scene.grouping.edits
    renamed = {}
    if last.rename is not None and last.to is not None:
        renamed = {last.to: last.rename}
        scene = with_edit(scene, PartEdit(rename=last.to, to=last.rename))
    return scene.with_overrides({"grouping.edits": tuple(edit.model_dump() for edit in earlier)}), renamed


def with_parts_anew(scene: Scene, count: Any) -> Scene:
    """The scene with another number of parts; names and edits were of the old ones and go."""
    return scene.with_overrides(
        {"grouping.parts": count, "grouping.edits": (), "grouping.names": {}}, sources={"grouping.parts": "--parts"}
    )


def rename_in_materials(run: RunFolder, names: Mapping[str, str]) -> None:
    """Let what a person wrote into materials.yaml follow parts that get another name."""
    for path in (run.materials_yaml, run.identified_yaml):
        if path.is_file():
            book = read_materials(path)
            write_materials(path, MaterialBook({names.get(name, name): entry for name, entry in book.items()}))


def _part(word: str, names: Sequence[str], flag: str) -> str:
    if word.isdecimal() and int(word) < len(names):
        return names[int(word)]
    if word not in names:
        listed = ", ".join(f"{number} {name}" for number, name in enumerate(names))
        raise SceneError(f"{flag}: there is no part '{word}'; the parts are {listed}.{did_you_mean(word, names)}")
    return word
