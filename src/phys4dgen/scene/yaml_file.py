"""scene.yaml in and out: ``load_scene`` and ``dump_scene`` are inverse, a dumped scene reads back equal."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from phys4dgen.errors import FormatError, SceneError
from phys4dgen.scene.model import Scene, validated_scene
from phys4dgen.yaml12 import YamlPath, format_yaml, read_yaml

__all__ = ["dump_scene", "load_scene", "read_scene_tree", "scene_keys"]


def load_scene(path: Path | str) -> Scene:
    """Read scene.yaml; relative paths in it are taken from the folder that it lies in.

    Raises:
        SceneError: the file is not YAML, has an unknown key or a bad value; names file, line, key and the way out.
    """
    path = Path(path)
    tree, places = read_scene_tree(path)
    return validated_scene(tree, source=str(path), places=places).with_paths_from(path.absolute().parent)


def read_scene_tree(path: Path) -> tuple[dict[str, Any], dict[YamlPath, str]]:
    """Keys and values of a scene file as they stand there, and the file and line of each; not validated.

    Raises:
        SceneError: the file is not YAML with keys.
    """
    try:
        document = read_yaml(path)
    except FormatError as error:
        raise SceneError(str(error)) from error
    if not isinstance(document.value, dict):
        raise SceneError(f"{path}: expected keys such as 'input: plant.splat', got {document.value!r}.")
    return document.value, {key: f"{path} line {line}" for key, line in document.lines.items()}


def dump_scene(scene: Scene) -> str:
    """The whole scene as YAML, with every default filled in and what each key means."""
    return format_yaml(scene.model_dump(), comments={path: text for path, _, text in scene_keys(Scene)})


def scene_keys(section: type[BaseModel], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any, str]]:
    """Every key below ``section``: its path from the root, its default and what it means."""
    for name, field in section.model_fields.items():
        here = (*path, name)
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from scene_keys(field.annotation, here)
        else:
            default = None if field.is_required() else field.get_default(call_default_factory=True)
            yield here, default, " ".join((field.description or "").split())
