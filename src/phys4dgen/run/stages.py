"""The stages of a run as users meet them (``--until``), what each depends on and which files it makes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phys4dgen.errors import RunError, SceneError, did_you_mean
from phys4dgen.scene import Scene

__all__ = ["STAGES", "Stage", "file_digest", "stage_digests", "stages_until"]


@dataclass(frozen=True)
class Stage:
    """One stage.

    Attributes:
        name: as in ``--until``.
        settings: dotted keys of the scene that change its result, besides those of the stages before it.
        files: what it makes in the run folder (glob patterns).
    """

    name: str
    settings: tuple[str, ...]
    files: tuple[str, ...]


STAGES = (
    Stage("views", ("up", "height_m", "longest_m", "seed", "views"), ("gaussians.ply", "views/*", "views/*/*")),
    Stage("grouping", ("grouping",), ("groups.npz", "parts.png")),
    Stage("interior", ("interior", "parts", "simulation.grid"), ("continuum.npz",)),
    Stage("materials", ("materials",), ("materials.yaml",)),
    Stage("simulate", ("motion", "forces", "gravity", "simulation"), ("trajectory.npz", "motion.json")),
    Stage("render", ("output",), ("frames/*", "video.mp4", "video.webp", "preview.png", "contact_sheet.png")),
)
"""In the order in which they run."""

_WITHOUT_EFFECT = ("simulation.threads",)
"""Settings that change how fast a result comes, not the result."""


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
    """SHA-256 of a file's content.

    Raises:
        RunError: the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RunError(f"{path}: cannot read the file: {error.strerror or error}.") from error


def stage_digests(scene: Scene, *, version: str) -> dict[str, str]:
    """What each stage's result depends on, as one digest per stage: two runs of equal digest give equal files.

    Args:
        scene: the scene asked for; the files that it names are read.
        version: of phys4dgen.
    """
    tree = scene.model_dump(mode="json")
    files = {"input": scene.input, "labels": scene.grouping.labels_file, "materials": scene.materials.file}
    contents = {name: file_digest(path) for name, path in files.items() if path is not None}
    tree["grouping"]["labels_file"] = contents.get("labels")
    tree["materials"]["file"] = contents.get("materials")
    digest = hashlib.sha256(f"{version} {contents['input']}".encode())
    digests: dict[str, str] = {}
    for key in _WITHOUT_EFFECT:
        _pop(tree, key)
    for stage in STAGES:
        chosen = {key: _get(tree, key) for key in stage.settings}
        digest.update(json.dumps([stage.name, chosen], sort_keys=True).encode())
        digests[stage.name] = digest.copy().hexdigest()
    return digests


def _get(tree: Mapping[str, Any], dotted: str) -> Any:
    value: Any = tree
    for key in dotted.split("."):
        value = value[key]
    return value


def _pop(tree: dict[str, Any], dotted: str) -> None:
    *path, last = dotted.split(".")
    _get(tree, ".".join(path)).pop(last)
