"""The Scene: everything that a run is told, in one frozen and validated tree (scene.yaml, Python, or flags).

Lengths, times and stresses carry their unit in the key; directions are in the input's axes (docs/conventions.md).
The docstring of a key is its documentation: it stands in scene.yaml and in ``--help``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic_core import PydanticCustomError

from phys4dgen.errors import SceneError
from phys4dgen.scene.address import checked_address
from phys4dgen.scene.errors import explain
from phys4dgen.yaml12 import YamlPath

__all__ = [
    "ALL_PARTS",
    "AccelerationForce",
    "Ground",
    "Grouping",
    "Interior",
    "Materials",
    "Motion",
    "Output",
    "PartEdit",
    "PartOptions",
    "Scene",
    "Simulation",
    "Video",
    "ViewSet",
    "validated_scene",
]

ALL_PARTS = "all"
"""In a force: every part that is not held."""


def _vector(value: Any) -> Any:
    """Three numbers, given as a list, a tuple or text as in a flag (``"1,0,0"``)."""
    words = value.split(",") if isinstance(value, str) else value
    try:
        if not isinstance(words, (list, tuple)) or len(words) != 3 or any(isinstance(word, bool) for word in words):
            raise ValueError
        return tuple(float(word) for word in words)
    except (ValueError, TypeError):
        raise PydanticCustomError("vector", "three numbers such as [1, 0, 0]") from None


def _nonzero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*vector) < 1e-9:
        raise ValueError("expected a direction, got a vector of length 0")
    return vector


def _tuple(value: Any) -> Any:
    """YAML has lists only; in strict mode pydantic wants the tuple."""
    return tuple(value) if isinstance(value, list) else value


Vector = Annotated[tuple[float, float, float], BeforeValidator(_vector)]
Direction = Annotated[tuple[float, float, float], BeforeValidator(_vector), AfterValidator(_nonzero)]
FilePath = Annotated[
    Path,
    BeforeValidator(lambda value: Path(value) if isinstance(value, str) and value else value),
    PlainSerializer(lambda value: value.as_posix(), return_type=str),
]
PartName = Annotated[str, Field(pattern=r"^[^\W\d][\w -]{0,63}$")]
SeedPoints = Annotated[tuple[Vector, ...], BeforeValidator(_tuple), Field(min_length=1, max_length=100)]
Auto = Literal["auto"]
AxisName = Literal["auto", "x", "+x", "-x", "y", "+y", "-y", "z", "+z", "-z"]
Positive = Annotated[float, Field(gt=0, le=1e6)]


class _Section(BaseModel):
    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


class Reconstruct(_Section):
    """How a picture becomes Gaussians (Paper: Sec. 3.1); of no effect on a splat."""

    backend: Literal["auto", "inflate", "command"] = "auto"
    """inflate: from the outline (stand-in for LGM); command: the program argv; auto: inflate"""
    argv: Annotated[tuple[str, ...], BeforeValidator(lambda v: tuple(v) if isinstance(v, list) else v)] = ()
    """of command: program and arguments, {image} for the RGBA picture, {out} for the .ply to write; no shell"""
    timeout_s: Annotated[float, Field(gt=0, le=86_400)] = 1800.0
    """of command: it is ended after this time"""
    mask: FilePath | None = None
    """picture of the same section, white where the object is"""
    matte_model: FilePath | None = None
    """ONNX file of U2-Net or IS-Net that finds the object; null: alpha channel, a model of rembg, or border colour"""
    front_gaussians: Annotated[int, Field(ge=2000, le=200_000)] = 40_000
    """Gaussians towards the camera; all together are some three times as many"""
    thickness_rel: Annotated[float, Field(ge=0.1, le=3)] = 1.0
    """depth of the object relative to what its outline says"""

    @model_validator(mode="after")
    def _one_way_to_find_the_object(self) -> Reconstruct:
        if self.mask is not None and self.matte_model is not None:
            raise ValueError("mask and matte_model both say where the object is; keep one of them")
        return self

    @model_validator(mode="after")
    def _command_has_its_words(self) -> Reconstruct:
        if self.backend == "command" and not any("{out}" in word for word in self.argv[1:]):
            raise ValueError("backend 'command' needs argv, a program and its arguments with {image} and {out}")
        if self.backend != "command" and self.argv:
            raise ValueError(f"argv is given but backend is '{self.backend}'; choose 'command'")
        return self


class ViewSet(_Section):
    """Which views of the object are rendered into ``views/`` for parts and for people."""

    preset: Literal["object", "carve", "scene"] = "object"
    """object: 29 views, carve: 49, scene: 120; the table is in docs/conventions.md"""
    size_px: Annotated[int, Field(ge=64, le=4096)] = 512
    """width and height of a view"""


class PartEdit(_Section):
    """One correction of the parts; edits are made in their order.

    Either ``merge``, or ``rename`` with ``to``, or ``split`` with ``pieces`` or ``seeds``, or ``seeds`` alone.
    """

    merge: Annotated[tuple[PartName, ...], BeforeValidator(_tuple)] = ()
    """names of parts that become one, which keeps the first name"""
    rename: PartName | None = None
    """name of a part that gets another one"""
    to: PartName | None = None
    """its new name"""
    split: PartName | None = None
    """name of a part that is divided"""
    pieces: Annotated[int, Field(ge=2, le=20)] | None = None
    """into so many, called NAME_1, NAME_2 ... from the ground up"""
    seeds: dict[PartName, SeedPoints] = Field(default_factory=dict)
    """points on the surface in the input's coordinates, by the name of the part or piece; without split all parts are
    found anew from them"""

    @model_validator(mode="after")
    def _one_kind(self) -> PartEdit:
        kinds = (bool(self.merge), self.rename is not None, self.split is not None or bool(self.seeds))
        whole = (self.rename is None) == (self.to is None) and (self.pieces is None or self.split is not None)
        if sum(kinds) != 1 or not whole:
            raise ValueError(
                "an edit is one of {merge: [a, b]}, {rename: a, to: b}, {split: a, pieces: 2}, "
                "{split: a, seeds: {b: [[x, y, z]]}} and {seeds: {a: [[x, y, z]], b: [[x, y, z]]}}"
            )
        if self.merge and len(set(self.merge)) < max(2, len(self.merge)):
            raise ValueError(f"merge needs two or more different parts, got {list(self.merge)}")
        if self.split is not None and (self.pieces is None) == (not self.seeds):
            raise ValueError(f"split of '{self.split}' needs either pieces, how many, or seeds, points on each")
        if self.split is None and len(self.seeds) == 1:
            raise ValueError("seeds need points on two or more parts, or split, the part that a single one is part of")
        if self.split is not None and list(self.seeds) == [self.split]:
            raise ValueError(f"split of '{self.split}' needs another name for the piece that is pointed at")
        return self

    @model_serializer(mode="wrap")
    def _what_is_said(self, whole: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Its kind alone, without the keys of the others."""
        return {key: value for key, value in whole(self).items() if value}

    @property
    def pieces_of(self) -> tuple[str, ...]:
        """Names of the parts that stand in the place of ``split``; of all parts where only ``seeds`` are given."""
        if self.pieces is not None:
            return tuple(f"{self.split}_{number}" for number in range(1, self.pieces + 1))
        remainder = () if self.split is None or len(self.seeds) > 1 else (self.split,)
        return tuple(dict.fromkeys((*self.seeds, *remainder)))


class Grouping(_Section):
    """How the Gaussians are divided into parts (Paper: Sec. 3.2)."""

    backend: Literal["auto", "appearance", "file", "none"] = "auto"
    """auto: file where labels_file is given, else appearance (stand-in for SAM2); none: one part"""
    parts: Auto | Annotated[int, Field(ge=1, le=256)] = "auto"
    """number of parts for appearance; auto: as many as the colours say"""
    labels_file: FilePath | None = None
    """.npy or .npz with one whole number per Gaussian, in the input's order; or label maps of views: .npz or folder"""
    occlusion_threshold_rel: Annotated[float, Field(gt=0, le=1)] = 0.05
    """for label maps: how far a Gaussian may lie from the rendered depth and count as visible, of the longest side"""
    names: dict[Annotated[int, Field(ge=0, le=255)], PartName] = Field(default_factory=dict)
    """names by part number (numbered from the ground up), instead of part_0, part_1 ..."""
    edits: Annotated[tuple[PartEdit, ...], BeforeValidator(_tuple)] = ()
    """corrections made after that, as by 'phys4dgen group': [{merge: [a, b]}, {rename: a, to: c},
    {split: c, pieces: 2}, {split: d, seeds: {e: [[x, y, z]]}}]"""

    @model_validator(mode="after")
    def _backend_has_its_file(self) -> Grouping:
        if self.backend == "file" and self.labels_file is None:
            raise ValueError("backend 'file' needs labels_file; name the file, or choose backend 'auto'")
        if self.backend in ("appearance", "none") and self.labels_file is not None:
            raise ValueError(f"labels_file is given but backend is '{self.backend}'; choose 'auto' or 'file'")
        if self.parts != "auto" and (self.backend in ("file", "none") or self.labels_file is not None):
            raise ValueError("parts is a choice of the appearance backend; remove it, or the labels_file")
        if len(set(self.names.values())) != len(self.names):
            raise ValueError(f"names: every part needs its own name, got {list(self.names.values())}")
        return self


class Interior(_Section):
    """How the inside is found and filled with particles (Paper: Sec. 3.3)."""

    label_grid: Annotated[int, Field(ge=8, le=128)] = 32
    """cells along the longest side of the grid that labels the inside"""
    confidence: Annotated[float, Field(gt=0, lt=1)] = 0.95
    """of the chi-square test that a cell is covered by a Gaussian"""
    max_particles_per_gaussian: Annotated[int, Field(ge=1, le=100)] = 10
    """samples drawn from one Gaussian at most"""
    spacing: Auto | Annotated[float, Field(ge=0.2, le=1)] = "auto"
    """between simulated particles, in grid cells (dx); auto: 0.5"""
    method: Literal["ipsd", "winding", "both", "none"] = "ipsd"
    """ipsd: carve by masks and depths (the paper's); winding: fill by the winding number; both: what they agree on;
    none: nothing inside, a skin of one layer of particles (the paper's ablation)"""
    hollow: dict[PartName, bool | Annotated[float, Field(gt=0, lt=1)]] = Field(default_factory=dict)
    """parts of which only a wall is filled: its thickness in metres; true: as parts.NAME.thickness_m, else as usual
    for parts.NAME.material"""


class Materials(_Section):
    """Who names the materials (Paper: Sec. 3.4)."""

    backend: Literal["auto", "mllm", "rule", "library", "file"] = "auto"
    """auto: file where given, else mllm where allow_upload is true, else rule (stand-in for the language model);
    library: parts bear the names of materials"""
    file: FilePath | None = None
    """a materials.yaml; its entries win over backend, and parts.NAME.material over them"""
    model: Annotated[str, Field(min_length=1, max_length=128)] = "gpt-4o"
    """of mllm: id of a multimodal model (the paper's by default)"""
    base_url: Annotated[str, AfterValidator(checked_address)] = "https://api.openai.com/v1"
    """of mllm: address of an OpenAI-compatible endpoint; keys are environment variables (OPENAI_API_KEY,
    GEMINI_API_KEY, for other servers PHYS4DGEN_MLLM_KEY) and never stand here"""
    allow_upload: bool = False
    """of mllm: pictures of the object may leave this machine"""
    offline: bool = False
    """of mllm: use the answers in the run folder alone"""
    samples: Annotated[int, Field(ge=1, le=200)] = 5
    """of mllm: independent answers, from which a vote and medians are taken"""
    temperature: Annotated[float, Field(ge=0, le=2)] = 0.8
    """of mllm: how much the answers may differ"""
    trust: bool = False
    """of mllm: keep its values although the library or the rule table speaks against them"""
    origin: Literal["ask", "natural", "artificial"] = "ask"
    """of mllm: whether the object grew or was made, where you know it; decides between model and rule table"""
    max_tokens: Auto | Annotated[int, Field(ge=1000, le=100_000_000)] = "auto"
    """of mllm: bound on the tokens of all answers together; auto: 40,000 per sample"""
    max_requests: Auto | Annotated[int, Field(ge=1, le=10_000)] = "auto"
    """of mllm: bound on the requests, retries included; auto: 4 per sample"""
    max_wait_s: Annotated[float, Field(gt=0, le=3600)] = 180.0
    """of mllm: bound on the time of all answers together"""

    @model_validator(mode="after")
    def _backend_has_its_file(self) -> Materials:
        if self.backend == "file" and self.file is None:
            raise ValueError("backend 'file' needs file; name a materials.yaml, or choose backend 'auto'")
        return self


class PartOptions(_Section):
    """What the user says about one part."""

    hold: Literal["auto", "fixed", "rigid", "free"] = "auto"
    """fixed: does not move; rigid: moves and never deforms; free: moves, and deforms if its stiffness can be afforded;
    auto: fixed or free, as the motion preset decides"""
    material: str | None = None
    """of the surface, by its name in the library; null: as identified"""
    interior_material: str | None = None
    """null: as the surface"""
    thickness_m: Annotated[float, Field(gt=0, lt=1)] | None = None
    """of a sheet, a rod or the wall of a vessel; null: measured, else the library's"""


class AccelerationForce(_Section):
    """An acceleration on every particle of a part during a time window."""

    kind: Literal["acceleration"] = "acceleration"
    """acceleration: metres per second squared on all of the part's mass"""
    part: PartName = ALL_PARTS
    """name of a part, or all"""
    value_ms2: Vector
    """in the input's axes"""
    from_s: Annotated[float, Field(ge=0)] = 0.0
    """start of the window"""
    to_s: Annotated[float, Field(gt=0)]
    """end of the window"""

    @model_validator(mode="after")
    def _window_is_ordered(self) -> AccelerationForce:
        if self.to_s <= self.from_s:
            raise ValueError(f"to_s must be later than from_s, got {self.from_s:g} to {self.to_s:g} s")
        return self


class Motion(_Section):
    """What happens to the object, besides the forces given."""

    preset: Literal["auto", "sway", "drop", "rest"] = "auto"
    """sway: a gust on what is not held; drop: falls on a ground; rest: nothing; auto: rest where forces are given, else
    sway if a gust of 3 g is enough for it and breaks nothing, else drop"""
    wind: Auto | Direction = "auto"
    """direction of the gust in the input's axes; auto: horizontal"""
    amplitude_rel: Annotated[float, Field(gt=0, le=0.5)] = 0.10
    """displacement aimed at (99th percentile of the free Gaussians), of the height"""
    acceleration_ms2: Auto | Positive = "auto"
    """strength of the gust; auto: from a short probe that aims at amplitude_rel"""
    duration_s: Annotated[float, Field(gt=0, le=60)] = 0.3
    """length of the gust"""
    drop_height_rel: Annotated[float, Field(ge=0, le=10)] = 0.4
    """of drop: from the lowest point to the ground, of the height"""


class Ground(_Section):
    """A level plane on which the object falls or stands."""

    kind: Literal["ground"] = "ground"
    """ground: nothing passes below it"""
    friction: Annotated[float, Field(ge=0, le=10)] = 0.4
    """Coulomb's coefficient"""
    contact: Literal["separate", "slip", "sticky"] = "separate"
    """separate: pushes, never pulls, and rubs; slip: holds down without friction; sticky: what touches it stays"""
    below_m: Auto | Annotated[float, Field(ge=0, le=1000)] = "auto"
    """from the object's lowest point down to the plane; auto: drop_height_rel where the preset is drop, else 0"""


class Simulation(_Section):
    """The Material Point Method (Paper: Sec. 3.5)."""

    grid: Auto | Annotated[int, Field(ge=8, le=512)] = "auto"
    """cells along the object's longest side; auto: 64, fewer where a massive object would take too many particles"""
    duration_s: Annotated[float, Field(gt=0, le=600)] = 2.0
    """of the film; frames = round(duration_s * fps)"""
    fps: Annotated[float, Field(ge=1, le=240)] = 24.0
    """frames of the film per second"""
    frame_time_s: Auto | Annotated[float, Field(gt=0, le=10)] = "auto"
    """simulated time between two frames; auto: 1 / fps (real time)"""
    cfl: Annotated[float, Field(gt=0, le=0.7)] = 0.6
    """time step as a share of the time in which a wave crosses a cell"""
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.08
    """of the lowest mode (mass-proportional)"""
    max_substeps: Annotated[int, Field(ge=10, le=1_000_000)] = 1500
    """per frame: thin parts are thickened until they need no more"""
    substep_limit: Annotated[int, Field(ge=10, le=10_000_000)] = 6000
    """per frame: a part that still needs more moves as a rigid body"""
    threads: Auto | Annotated[int, Field(ge=1, le=1024)] = "auto"
    """auto: all cores; at a given number of chunks the result does not depend on it"""
    chunks: Auto | Annotated[int, Field(ge=1, le=1024)] = "auto"
    """groups of particles that are summed apart, which fixes the order of summation; auto: the number of threads"""


class Video(_Section):
    """The film of video.mp4, preview.png and contact_sheet.png."""

    width: Annotated[int, Field(ge=64, le=7680)] = 800
    """pixels"""
    height: Auto | Annotated[int, Field(ge=64, le=7680)] = "auto"
    """pixels; auto: from the object's shape"""
    orbit_deg: Annotated[float, Field(ge=-3600, le=3600)] = 60.0
    """how far the camera travels round the object during the film"""
    azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """where the middle of that path lies, counterclockwise seen from above; 0: the view from -y of the z-up axes"""
    elevation_deg: Annotated[float, Field(ge=-89, le=89)] = 12.0
    """of the camera above the horizon"""
    fps: Auto | Annotated[float, Field(ge=1, le=240)] = "auto"
    """auto: simulation.fps"""
    background: Literal["white", "black", "grey"] = "white"
    """behind the object"""


class Output(_Section):
    """Which files are written."""

    frames: Literal["ply", "none"] = "ply"
    """ply: one complete 3DGS PLY per frame"""
    video: Video = Field(default_factory=Video)


class Scene(_Section):
    """One object, how it is understood, what moves it and what is written."""

    input: FilePath
    """a splat or a picture; relative to this file"""
    up: AxisName | Direction = "auto"
    """auto, +-x +-y +-z or [x, y, z], in the input's axes"""
    height_m: Auto | Positive = "auto"
    """real extent along up; auto: 0.3 with a warning, unless longest_m is given"""
    longest_m: Positive | None = None
    """real extent of the longest side, instead of height_m"""
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] = 0
    """of everything that is drawn at random"""
    reconstruct: Reconstruct = Field(default_factory=Reconstruct)
    views: ViewSet = Field(default_factory=ViewSet)
    grouping: Grouping = Field(default_factory=Grouping)
    interior: Interior = Field(default_factory=Interior)
    materials: Materials = Field(default_factory=Materials)
    parts: dict[PartName, PartOptions] = Field(default_factory=dict)
    """options by part name"""
    motion: Motion = Field(default_factory=Motion)
    forces: tuple[AccelerationForce, ...] = ()
    """accelerations besides the motion's own"""
    gravity: Literal["auto", "rest", "on", "off"] = "auto"
    """rest: the shape given is at rest under its weight, which adds no second sag; on: weight acts on an unloaded
    shape; off: weightless; auto: on for drop, else rest"""
    boundaries: tuple[Ground, ...] = ()
    """what the object may not pass; drop adds a ground where none is given"""
    simulation: Simulation = Field(default_factory=Simulation)
    output: Output = Field(default_factory=Output)

    @model_validator(mode="before")
    @classmethod
    def _lists_to_tuples(cls, data: Any) -> Any:
        """YAML has lists only; in strict mode pydantic wants the tuple."""
        if isinstance(data, Mapping):
            lists = {key: tuple(data[key]) for key in ("forces", "boundaries") if isinstance(data.get(key), list)}
            return {**data, **lists}
        return data

    @model_validator(mode="after")
    def _one_size(self) -> Scene:
        if self.longest_m is not None and self.height_m != "auto":
            raise ValueError("height_m and longest_m both give the size; keep one of them")
        if ALL_PARTS in self.parts:
            raise ValueError(f"parts: '{ALL_PARTS}' means every part in a force and cannot name a part")
        if len(self.boundaries) > 1:
            raise ValueError(f"boundaries: one ground is enough, got {len(self.boundaries)}")
        return self

    @property
    def frame_count(self) -> int:
        """Frames of the film; frame 0 is the rest pose."""
        return max(1, round(self.simulation.duration_s * self.simulation.fps))

    @property
    def frame_time_s(self) -> float:
        """Simulated seconds between two frames."""
        chosen = self.simulation.frame_time_s
        return 1.0 / self.simulation.fps if isinstance(chosen, str) else chosen

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
        grouping, materials = self.grouping, self.materials
        if grouping.labels_file is not None:
            grouping = grouping.model_copy(update={"labels_file": folder / grouping.labels_file})
        if materials.file is not None:
            materials = materials.model_copy(update={"file": folder / materials.file})
        named = {name: getattr(self.reconstruct, name) for name in ("mask", "matte_model")}
        paths = {name: folder / path for name, path in named.items() if path is not None}
        sections = {"grouping": grouping, "materials": materials}
        sections["reconstruct"] = self.reconstruct.model_copy(update=paths)
        return self.model_copy(update={"input": folder / self.input, **sections})


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
