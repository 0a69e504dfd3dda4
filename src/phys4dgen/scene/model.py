"""The Scene: everything that a run is told, in one frozen and validated tree (scene.yaml, Python, or flags).

Lengths, times and stresses carry their unit in the key; directions are in the input's axes (docs/conventions.md).
The docstring of a key is its documentation: it stands in scene.yaml and in ``--help``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from phys4dgen.errors import SceneError
from phys4dgen.scene.errors import explain
from phys4dgen.scene.paper_scale import PaperScale, paper_scale
from phys4dgen.scene.sections import (
    ALL_PARTS,
    Boundary,
    Force,
    Ground,
    Grouping,
    Interior,
    MaterialChange,
    Materials,
    Motion,
    Output,
    PartOptions,
    PlacedObject,
    Reconstruct,
    Select,
    Simulation,
    ViewSet,
)
from phys4dgen.scene.sections.models import Clip
from phys4dgen.scene.sections.values import (
    Auto,
    AxisName,
    Direction,
    FilePath,
    ObjectName,
    PartAddress,
    Positive,
    Section,
    Vector,
)
from phys4dgen.yaml12 import YamlPath

__all__ = ["Scene", "validated_scene"]

_FPS = 24.0

_OF_ONE_OBJECT = (
    *("up", "height_m", "longest_m", "select", "reconstruct.mask", "reconstruct.views"),
    *("grouping.labels_file", "grouping.names", "grouping.named_picture", "grouping.edits"),
)
"""Keys that make no sense for all objects alike."""


class Scene(Section):
    """One object or several, how they are understood, what moves them and what is written."""

    input: FilePath | None = None
    """a splat, a picture or a mesh; relative to this file; null: see objects"""
    objects: dict[ObjectName, PlacedObject] = Field(default_factory=dict)
    """several inputs by name, each with its pose, instead of input (docs/howto/several-objects.md)"""
    up: AxisName | Direction = "auto"
    """auto, +-x +-y +-z or [x, y, z], in the input's axes"""
    height_m: Auto | Positive = "auto"
    """real extent along up; auto: 0.3 with a warning, unless longest_m is given"""
    longest_m: Positive | None = None
    """real extent of the longest side, instead of height_m"""
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] = 0
    """of everything that is drawn at random"""
    reconstruct: Reconstruct = Field(default_factory=Reconstruct)
    select: Select = Field(default_factory=Select)
    views: ViewSet = Field(default_factory=ViewSet)
    grouping: Grouping = Field(default_factory=Grouping)
    interior: Interior = Field(default_factory=Interior)
    materials: Materials = Field(default_factory=Materials)
    clip: Clip = Field(default_factory=Clip)
    parts: dict[PartAddress, PartOptions] = Field(default_factory=dict)
    """options by part name; of several objects by object/part, or by object for all of its parts; all: every part"""
    motion: Motion = Field(default_factory=Motion)
    forces: tuple[Force, ...] = ()
    """what acts besides the motion's own, see docs/forces.md"""
    gravity: Literal["auto", "rest", "on", "off"] = "auto"
    """rest: the shape given is at rest under its weight, which is left out; on: weight acts, see prestress; off:
    weightless; auto: on for drop and melt, for press on a ground that does not hold, and where gravity_ms2 is given,
    else rest"""
    prestress: Literal["auto", "on", "off"] = "auto"
    """whether the shape given carries its weight from the start, up to ten times as stiff where it would sag by more
    than 3 % of the height; off: it sags, as an unloaded shape does; auto: on where gravity is on, something that is
    held carries what is elastic, and it can stand"""
    gravity_ms2: Auto | Vector = "auto"
    """acceleration of gravity in the input's axes; auto: 9.81 downwards"""
    boundaries: tuple[Boundary, ...] = ()
    """what the object may not pass, and what is pinned, see docs/forces.md; drop adds a ground where none is given"""
    changes: tuple[MaterialChange, ...] = ()
    """materials that change in time, see docs/forces.md"""
    simulation: Simulation = Field(default_factory=Simulation)
    output: Output = Field(default_factory=Output)

    @model_validator(mode="before")
    @classmethod
    def _lists_to_tuples(cls, data: Any) -> Any:
        """YAML has lists only; in strict mode pydantic wants the tuple."""
        if isinstance(data, Mapping):
            lists = {
                key: tuple(data[key]) for key in ("forces", "boundaries", "changes") if isinstance(data.get(key), list)
            }
            return {**data, **lists}
        return data

    @model_validator(mode="after")
    def _one_size(self) -> Scene:
        if self.longest_m is not None and self.height_m != "auto":
            raise ValueError("height_m and longest_m both give the size; keep one of them")
        if self.simulation.scale == "paper" and not (self.longest_m is None and self.height_m == "auto"):
            raise ValueError("simulation.scale: paper makes the longest side one; leave height_m and longest_m out")
        grounds = sum(isinstance(boundary, Ground) for boundary in self.boundaries)
        if grounds > 1:
            raise ValueError(f"boundaries: one ground is enough, got {grounds}")
        if self.gravity_ms2 != "auto" and self.gravity in ("rest", "off"):
            raise ValueError(f"gravity_ms2 says how strong gravity is, gravity: {self.gravity} that it does not act")
        if self.prestress == "on" and self.gravity in ("rest", "off"):
            raise ValueError(f"prestress: on balances a weight, gravity: {self.gravity} leaves it out; use gravity: on")
        return self

    @model_validator(mode="after")
    def _one_or_several(self) -> Scene:
        if self.input is None and not self.objects:
            raise ValueError("'input' is missing; add it, or objects for several")
        if not self.objects:
            return self
        if self.input is not None:
            raise ValueError("input and objects are both given; keep input for one object, objects for several")
        if ALL_PARTS in self.objects:
            raise ValueError(f"objects: '{ALL_PARTS}' means every part and cannot name an object")
        folded = [name.casefold() for name in self.objects]
        twice = next((name for name in self.objects if folded.count(name.casefold()) > 1), None)
        if twice is not None:
            raise ValueError(f"objects: '{twice}' is written twice, in large and in small letters; name one otherwise")
        for key in _OF_ONE_OBJECT:
            section, _, last = key.rpartition(".")
            holder = getattr(self, section) if section else self
            if getattr(holder, last) != type(holder).model_fields[last].get_default(call_default_factory=True):
                raise ValueError(f"{key} is of one object; say it below objects.NAME")
        if self.simulation.scale == "paper":
            raise ValueError("simulation.scale: paper is for one object; leave it out")
        if self.motion.preset == "twist" and self.motion.part is None:
            raise ValueError("motion.part: say which object, or which part of one, is turned")
        return self

    @property
    def single_input(self) -> Path:
        """The input of a scene of one object."""
        if self.input is None:
            raise SceneError(f"objects: expected a scene of one object, got {', '.join(self.objects)}.")
        return self.input

    @property
    def frame_count(self) -> int:
        """Frames of the film; frame 0 is the rest pose."""
        return max(1, round(self.simulation.duration_s * self.fps))

    @property
    def paper_scale(self) -> PaperScale | None:
        """The paper's numbers, where the scene asks for them."""
        return paper_scale(self.single_input) if self.simulation.scale == "paper" else None

    @property
    def fps(self) -> float:
        """Frames of the film per second."""
        chosen, paper = self.simulation.fps, self.paper_scale
        if not isinstance(chosen, str):
            return chosen
        return _FPS if paper is None else paper.fps

    @property
    def frame_time_s(self) -> float:
        """Simulated seconds between two frames."""
        chosen, paper = self.simulation.frame_time_s, self.paper_scale
        if not isinstance(chosen, str):
            return chosen
        return 1.0 / self.fps if paper is None else paper.frame_time_s

    def with_overrides(self, overrides: Mapping[str, Any], *, sources: Mapping[str, str] | None = None) -> Scene:
        """A validated copy with some values replaced.

        Args:
            overrides: dotted key -> value, for example ``{"simulation.grid": 96, "parts.pot.hold": "fixed"}``.
            sources: dotted key -> where its value comes from (a flag), for errors.

        Raises:
            SceneError: a key is unknown, or a value is of the wrong type or out of range.
        """
        sources = sources or {}
        tree = self.model_dump()
        places: dict[YamlPath, str] = {}
        for dotted, value in overrides.items():
            *path, last = [int(key) if key.isdecimal() else key for key in dotted.split(".")]
            node: Any = tree
            for key in path:
                node = node.setdefault(key, {}) if isinstance(node, dict) else None
            place = sources.get(dotted, "override")
            if not isinstance(node, dict):
                raise SceneError(
                    f"{place}: '{dotted}' is not a key of a scene; what stands before the dot is one value."
                )
            node[last] = value
            for length in range(len(path) + 1):
                places.setdefault((*path, last)[: length + 1], place)
        return validated_scene(tree, source="scene", places=places)

    def with_paths_from(self, folder: Path) -> Scene:
        """A copy whose relative paths are taken from ``folder``; absolute ones stay."""
        materials = self.materials
        if materials.file is not None:
            materials = materials.model_copy(update={"file": folder / materials.file})
        return self.model_copy(
            update={
                "input": None if self.input is None else folder / self.input,
                "objects": {name: placed.with_paths_from(folder) for name, placed in self.objects.items()},
                "reconstruct": self.reconstruct.with_paths_from(folder),
                "select": self.select.with_paths_from(folder),
                "grouping": self.grouping.with_paths_from(folder),
                "materials": materials,
                "clip": self.clip.with_paths_from(folder),
            }
        )


def validated_scene(tree: Any, *, source: str, places: Mapping[YamlPath, str]) -> Scene:
    """The scene of a tree of keys and values.

    Args:
        tree: nested mappings and lists.
        source: where the tree comes from, for errors.
        places: where single values come from (file and line, flag), by the keys from the root.

    Raises:
        SceneError: the first thing that is wrong, in one sentence.
    """
    try:
        return Scene.model_validate(tree)
    except ValidationError as error:
        raise SceneError(explain(error, Scene, source=source, places=places)) from error
