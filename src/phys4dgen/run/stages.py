"""The stages of a run as users meet them (``--until``): what each depends on and which files it makes.

A stage is made again when one of its needs has changed: a setting that it reads, a product of an earlier stage that
it takes, or its own code. Products are compared by content, so an edit that changes nothing costs nothing further
down (docs/decisions/0010-reuse-by-content.md).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

from phys4dgen.errors import RunError, SceneError, did_you_mean
from phys4dgen.run.code_stamp import code_stamp
from phys4dgen.scene import PlacedObject, Scene

__all__ = ["MERGE_TREE", "STAGES", "Needs", "Stage", "file_digest", "scene_settings", "stage_named", "stages_until"]


@dataclass(frozen=True)
class Stage:
    """One stage.

    Attributes:
        name: as in ``--until``.
        settings: keys of the scene, with all below them, that change its result.
        ignores: patterns of keys below them that do not.
        takes: products of earlier stages that it reads.
        makes: products that later stages read.
        code: files and folders of this package that it runs.
        files: what it leaves in the run folder (glob patterns).
        joins: where there are several objects, products of their own runs that it reads.
    """

    name: str
    settings: tuple[str, ...]
    ignores: tuple[str, ...]
    takes: tuple[str, ...]
    makes: tuple[str, ...]
    code: tuple[str, ...]
    files: tuple[str, ...]
    joins: tuple[str, ...] = ()


_SOURCE = ("input", "objects", "select", "reconstruct")
_ASSET = (*_SOURCE, "up", "height_m", "longest_m", "simulation.scale")
_SOURCE_CODE = ("types", "formats", "render", "vector", "reconstruct", "stages/reconstruct.py", "stages/selection.py")
_GROUPING_STAGES = ("stages/grouping.py", "stages/segmentation.py", "stages/naming.py")
_SHARED_CODE = (*_SOURCE_CODE, "upright", "stages/asset.py", "stages/resolution.py", "stages/views.py")
_SEVERAL_CODE = ("stages/several.py", "stages/overlap.py")
_UNMOVED = ("objects.*.velocity_ms", "objects.*.spin_deg_s")
"""How objects start; concerns the simulation alone."""
_UNPARTED = (*_UNMOVED, "objects.*.grouping*")
"""What of objects is not seen before they have parts."""

STAGES = (
    Stage(
        "reconstruct",
        settings=_SOURCE,
        ignores=_UNPARTED,
        takes=(),
        makes=(),
        code=(*_SOURCE_CODE, *_SEVERAL_CODE),
        files=("gaussians.ply", "reconstruct/*"),
    ),
    Stage(
        "views",
        settings=(*_ASSET, "views"),
        ignores=_UNPARTED,
        takes=(),
        makes=("views",),
        code=_SHARED_CODE,
        files=("views/*.png", "views/cameras.json"),
    ),
    Stage(
        "grouping",
        settings=(*_ASSET, "seed", "grouping", "clip"),
        ignores=_UNMOVED,
        takes=("views",),
        makes=("parts", "part names"),
        code=(*_SHARED_CODE, *_SEVERAL_CODE, "grouping", "clip", "weights.py", *_GROUPING_STAGES),
        files=("groups.npz", "groups_tree.npz", "parts.png", "segments/*"),
        joins=("objects' parts",),
    ),
    Stage(
        "interior",
        settings=(*_ASSET, "seed", "interior", "parts", "simulation.grid", "simulation.cell_m"),
        ignores=(*_UNPARTED, "parts.*.hold", "parts.*.material", "parts.*.interior_material"),
        takes=("parts",),
        makes=("particles",),
        code=(*_SHARED_CODE, *_SEVERAL_CODE, "interior", "stages/interior.py"),
        files=("continuum.npz",),
        joins=("objects' particles",),
    ),
    Stage(
        "materials",
        settings=(*_ASSET, "seed", "materials", "parts", "clip"),
        ignores=(*_UNPARTED, "parts.*.hold", "materials.offline", "materials.max_*"),
        takes=("parts", "part names", "particles"),
        makes=("materials",),
        code=(*_SHARED_CODE, *_SEVERAL_CODE, "materials", "clip", "weights.py", "programs.py", "stages/materials.py"),
        files=("materials.yaml", ".identified.yaml"),
        joins=("objects' materials",),
    ),
    Stage(
        "simulate",
        settings=(
            *_ASSET,
            "parts",
            "motion",
            "forces",
            "gravity",
            "prestress",
            "gravity_ms2",
            "boundaries",
            "changes",
            "simulation",
        ),
        ignores=("objects.*.grouping*", "parts.*.material", "parts.*.interior_material", "simulation.threads"),
        takes=("parts", "part names", "particles", "materials"),
        makes=("motion",),
        code=(
            *_SHARED_CODE,
            *("mpm", "body.py", "joints.py", "motion.py", "animate"),
            *(
                "stages/motion.py",
                "stages/motion_body.py",
                "stages/motion_plan.py",
                "stages/motion_facts.py",
                "stages/motion_loads.py",
            ),
            *("stages/motion_changes.py", "stages/motion_obstacles.py", "stages/motion_presets.py"),
            *("stages/apart.py", "stages/simulation.py", "stages/prestress.py"),
        ),
        files=("trajectory.npz", "motion.json"),
    ),
    Stage(
        "render",
        settings=(*_SOURCE, "up", "output", "simulation.fps", "simulation.scale"),
        ignores=_UNPARTED,
        takes=("motion",),
        makes=(),
        code=(*_SHARED_CODE, "animate", "export", "stages/film.py", "stages/backdrop.py"),
        files=("frames/frame_*.ply", "video.mp4", "video.webp", "preview.png", "contact_sheet.png"),
    ),
)
"""In the order in which they run."""

MERGE_TREE = Stage(
    "merge tree",
    settings=_ASSET,
    ignores=(),
    takes=("views",),
    makes=(),
    code=(*_SHARED_CODE, "grouping", "stages/grouping.py"),
    files=("groups_tree.npz",),
)
"""A part of ``grouping`` that all its settings share, so that other parts cost no new search."""

_LISTED = {key.split(".")[0] for stage in STAGES for key in stage.settings}


@dataclass(frozen=True)
class Needs:
    """Everything that the result of one stage follows from.

    Attributes:
        settings: value by dotted key of the scene; of files that it names the digest of the content.
        products: digest by name of product taken.
        code: stamp of the stage's code.
    """

    settings: Mapping[str, Any]
    products: Mapping[str, str]
    code: str

    @classmethod
    def of(cls, stage: Stage, settings: Mapping[str, Any], products: Mapping[str, str]) -> Needs:
        """What ``stage`` needs.

        Args:
            stage: the stage.
            settings: of the whole scene, from ``scene_settings``.
            products: digests of what the earlier stages made.
        """
        return cls(
            {key: value for key, value in settings.items() if _concerns(stage, key)},
            {name: products[name] for name in stage.takes}
            | {name: products[name] for name in stage.joins if name in products},
            code_stamp(stage.code),
        )

    def changed_settings(self, before: Needs) -> list[str]:
        """Keys of the scene that differ from ``before``, each with both values.

        A key that an older version of phys4dgen did not have stood at its default.
        """
        keys = dict.fromkeys((*self.settings, *before.settings))
        absent = "not given"
        earlier = {**_default_settings(), **before.settings}
        pairs = {key: (earlier.get(key, absent), self.settings.get(key, absent)) for key in keys}
        return [_said(key, *values) for key, values in pairs.items() if values[0] != values[1]]

    def changes(self, before: Needs) -> list[str]:
        """Why a result made from ``before`` does not hold any more, one phrase each; empty where it does."""
        products = [
            f"the {name} changed" for name, digest in self.products.items() if before.products.get(name) != digest
        ]
        code = ["phys4dgen itself changed"] if self.code != before.code else []
        return [*self.changed_settings(before), *products, *code]


def stage_named(name: str) -> Stage:
    """The stage of that name."""
    return next(stage for stage in STAGES if stage.name == name)


def stages_until(name: str | None) -> tuple[str, ...]:
    """Names of the stages up to and with ``name``; all of them for None.

    Raises:
        SceneError: there is no such stage.
    """
    names = tuple(stage.name for stage in STAGES)
    if name is None:
        return names
    if name not in names:
        raise SceneError(f"--until: expected one of {', '.join(names)}, got '{name}'.{did_you_mean(name, names)}")
    return names[: names.index(name) + 1]


def file_digest(path: Path) -> str:
    """SHA-256 of a file's content, or of the names and contents of the files of a folder.

    Raises:
        RunError: the file cannot be read.
    """
    if path.is_dir():
        files = [file for file in sorted(path.iterdir()) if file.is_file()]
        return hashlib.sha256("".join(f"{file.name} {file_digest(file)}\n" for file in files).encode()).hexdigest()
    if path.exists() and not path.is_file():
        raise RunError(f"{path}: expected a file, got a device; name the file itself.")
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RunError(f"{path}: cannot read the file: {error.strerror or error}.") from error


def scene_settings(scene: Scene) -> dict[str, Any]:
    """Every leaf of the scene by its dotted key; the files that it names are read and stand as their digests.

    Raises:
        RunError: one of the files cannot be read.
    """
    leaves = dict(_leaves(scene.model_dump(mode="json")))
    leaves |= _file_leaves(scene, "")
    if scene.materials.file is not None:
        leaves["materials.file"] = file_digest(scene.materials.file)
    for name, placed in scene.objects.items():
        leaves |= _file_leaves(placed, f"objects.{name}.")
    if scene.objects:
        leaves["objects.grid"] = scene.simulation.cell_m or scene.simulation.grid  # they share one from the first
    return leaves


def _file_leaves(told: Scene | PlacedObject, prefix: str) -> dict[str, Any]:
    """Digests of the files that are named of one object, by key."""
    made, grouping = told.reconstruct, told.grouping
    named = None if grouping is None else grouping.named_picture
    files = {
        "input": told.input,
        "reconstruct.mask": None if made is None else made.mask,
        "reconstruct.matte_model": None if made is None else made.matte_model,
        "reconstruct.checkpoint": None if made is None else made.checkpoint,
        "select.labels_file": told.select.labels_file,
        "grouping.labels_file": None if grouping is None else grouping.labels_file,
        "grouping.named_picture.picture": None if named is None else named.picture,
        "grouping.named_picture.segments": None if named is None else named.segments,
    }
    leaves: dict[str, Any] = {f"{prefix}{key}": file_digest(path) for key, path in files.items() if path is not None}
    if made is not None and made.views:
        leaves[f"{prefix}reconstruct.views"] = [file_digest(path) for path in made.views]
    return leaves


@cache
def _default_settings() -> dict[str, Any]:
    """Every leaf of a scene of which nothing is said."""
    return dict(_leaves(Scene(input=Path("-")).model_dump(mode="json")))


def _leaves(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, child in value.items():
            yield from _leaves(child, (*path, str(key)))
    else:
        yield ".".join(path), value


def _concerns(stage: Stage, key: str) -> bool:
    """Whether a stage reads a key; one that no stage lists is taken to concern all."""
    if key.split(".")[0] not in _LISTED:
        return True
    listed = any(key == prefix or key.startswith(f"{prefix}.") for prefix in stage.settings)
    return listed and not any(fnmatchcase(key, pattern) for pattern in stage.ignores)


_FILES = (
    *("input", "reconstruct.mask", "reconstruct.matte_model", "reconstruct.checkpoint", "reconstruct.views"),
    "select.labels_file",
    *("grouping.labels_file", "grouping.named_picture.picture", "grouping.named_picture.segments", "materials.file"),
)
"""Keys whose values are files, compared by content."""


def _said(key: str, before: Any, now: Any) -> str:
    if (key.split(".", 2)[-1] if key.startswith("objects.") else key) in _FILES:
        return f"the file of {key} changed"
    return f"{key} is {_short(now)} and was {_short(before)}"


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
