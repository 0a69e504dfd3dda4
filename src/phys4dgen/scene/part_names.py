"""Parts that a scene speaks of, checked against the parts that there are.

Where there are several objects a part is called ``object/part``, and the object's name alone means all of its parts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from phys4dgen.errors import SceneError, did_you_mean
from phys4dgen.scene.model import Scene
from phys4dgen.scene.sections import ALL_PARTS, Grouping, PartOptions

__all__ = [
    "DEFAULT_NAME",
    "SEPARATOR",
    "check_part_names",
    "joined_options",
    "object_of",
    "options_by_part",
    "parts_meant",
    "refuse_impossible_part_names",
]

DEFAULT_NAME = re.compile(r"part_\d+")
"""What parts are called before anybody names them."""

SEPARATOR = "/"
"""Between the name of an object and that of its part."""


def object_of(name: str) -> str:
    """The object that a part belongs to, by the part's name; empty where there is one object alone."""
    owner, separator, _ = name.partition(SEPARATOR)
    return owner if separator else ""


def parts_meant(name: str, names: Sequence[str]) -> tuple[str, ...]:
    """The parts that a name means: the part of that name, all of an object, or all; none where there are none."""
    if name == ALL_PARTS:
        return tuple(names)
    return (name,) if name in names else tuple(part for part in names if object_of(part) == name)


def options_by_part(scene: Scene, names: Sequence[str]) -> dict[str, PartOptions]:
    """What a scene says of each part, by name; what it says of an object or of all parts holds where it says no more.

    Args:
        scene: what was asked for.
        names: the parts that there are.
    """
    found = {part: joined_options(scene, (ALL_PARTS, object_of(part), part)) for part in names}
    return {part: options for part, options in found.items() if options is not None}


def joined_options(scene: Scene, names: Sequence[str]) -> PartOptions | None:
    """What a scene says under these names, the last of which wins; None where it says nothing."""
    default = PartOptions()
    said = [scene.parts[name] for name in names if name in scene.parts]
    told = {key: value for options in said for key, value in options if value != getattr(default, key)}
    return default.model_copy(update=told) if said else None


def check_part_names(scene: Scene, names: Sequence[str]) -> None:
    """Refuse options, forces and names for parts that the object does not have.

    Args:
        scene: what was asked for.
        names: the parts of the object, in the order of their numbers.

    Raises:
        SceneError: names the key, the part, and the parts that there are.
    """
    whose = "these objects" if scene.objects else "this object"
    for place, name in _mentioned(scene).items():
        if not parts_meant(name, names):
            raise SceneError(
                f"{place}: there is no part '{name}'; the parts of {whose} are {', '.join(names)}."
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
    groupings = {name: placed.grouping or scene.grouping for name, placed in scene.objects.items()}
    for place, name in _mentioned(scene).items():
        if not scene.objects:
            _refuse_impossible(place, name, name, scene.grouping)
        elif name not in scene.objects:
            _refuse_impossible_of_object(place, name, groupings)


def _refuse_impossible_of_object(place: str, name: str, groupings: Mapping[str, Grouping]) -> None:
    owner, _, own_name = name.partition(SEPARATOR)
    if owner not in groupings:
        raise SceneError(
            f"{place}: there is no object '{owner}'; the objects are {', '.join(groupings)}, and a part is called "
            f"{next(iter(groupings))}{SEPARATOR}PART.{did_you_mean(owner, list(groupings))}"
        )
    _refuse_impossible(place, name, own_name, groupings[owner])


def _refuse_impossible(place: str, name: str, own_name: str, grouping: Grouping) -> None:
    """Refuse a part that is called ``own_name`` within its object, and can never be."""
    if grouping.labels_file is not None:
        return
    given = list(grouping.names.values())
    if grouping.named_picture is not None:
        given += grouping.named_picture.names.values()
    for edit in grouping.edits:
        given += [edit.to] if edit.to is not None else edit.pieces_of
    if own_name not in given and not DEFAULT_NAME.fullmatch(own_name):
        raise SceneError(
            f"{place}: there is no part '{name}'; parts are called {', '.join([*given, 'part_0', 'part_1'])} "
            f"and so on until --part-name names them.{did_you_mean(own_name, [*given, 'part_0'])}"
        )


def _mentioned(scene: Scene) -> dict[str, str]:
    """Names of parts or objects by the key that mentions them."""
    places = {f"parts.{name}": name for name in scene.parts}
    places |= {f"interior.hollow.{name}": name for name in scene.interior.hollow if scene.objects}
    if scene.motion.part is not None:
        places["motion.part"] = scene.motion.part
    for section, entries in (("forces", scene.forces), ("boundaries", scene.boundaries), ("changes", scene.changes)):
        for i, entry in enumerate(entries):
            part = getattr(entry, "part", ALL_PARTS)
            places[f"{section}.{i}.part"] = part
    return {place: name for place, name in places.items() if name != ALL_PARTS}
