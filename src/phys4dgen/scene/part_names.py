"""Parts that a scene speaks of, checked against the parts that there are."""

from __future__ import annotations

import re
from collections.abc import Sequence

from phys4dgen.errors import SceneError, did_you_mean
from phys4dgen.scene.model import Scene
from phys4dgen.scene.sections import ALL_PARTS

__all__ = ["DEFAULT_NAME", "check_part_names", "refuse_impossible_part_names"]

DEFAULT_NAME = re.compile(r"part_\d+")
"""What parts are called before anybody names them."""


def check_part_names(scene: Scene, names: Sequence[str]) -> None:
    """Refuse options, forces and names for parts that the object does not have.

    Args:
        scene: what was asked for.
        names: the parts of the object, in the order of their numbers.

    Raises:
        SceneError: names the key, the part, and the parts that there are.
    """
    for place, name in _mentioned(scene).items():
        if name not in names:
            raise SceneError(
                f"{place}: there is no part '{name}'; the parts of this object are {', '.join(names)}."
                f"{did_you_mean(name, names)}"
            )
    for number in scene.grouping.names:
        if number >= len(names) and not scene.grouping.edits:  # which change the numbers afterwards
            raise SceneError(
                f"grouping.names: there is no part number {number}; this object has the parts 0 to {len(names) - 1}."
            )


def refuse_impossible_part_names(scene: Scene) -> None:
    """Refuse names that no part can get, before the minutes that it takes to find the parts.

    Without a labels file parts are called ``part_0``, ``part_1`` ... or as ``grouping.names`` says.

    Raises:
        SceneError: names the key and the part, and how to name parts.
    """
    if scene.grouping.labels_file is not None:
        return
    given = list(scene.grouping.names.values())
    if scene.grouping.named_picture is not None:
        given += scene.grouping.named_picture.names.values()
    for edit in scene.grouping.edits:
        given += [edit.to] if edit.to is not None else edit.pieces_of
    for place, name in _mentioned(scene).items():
        if name not in given and not DEFAULT_NAME.fullmatch(name):
            raise SceneError(
                f"{place}: there is no part '{name}'; parts are called {', '.join([*given, 'part_0', 'part_1'])} "
                f"and so on until --part-name names them.{did_you_mean(name, [*given, 'part_0'])}"
            )


def _mentioned(scene: Scene) -> dict[str, str]:
    """Names of parts by the key that mentions them."""
    places = {f"parts.{name}": name for name in scene.parts}
    if scene.motion.part is not None:
        places["motion.part"] = scene.motion.part
    for section, entries in (("forces", scene.forces), ("boundaries", scene.boundaries), ("changes", scene.changes)):
        for i, entry in enumerate(entries):
            part = getattr(entry, "part", ALL_PARTS)
            if part != ALL_PARTS:
                places[f"{section}.{i}.part"] = part
    return places
