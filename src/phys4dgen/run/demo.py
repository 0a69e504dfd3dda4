"""The demo: a bundled object becomes an input like any other, as files in the run folder; scene files about one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from phys4dgen.errors import SceneError
from phys4dgen.formats import save_gaussians
from phys4dgen.run.folder import RunFolder
from phys4dgen.scene import SEPARATOR, Scene
from phys4dgen.scene.model import validated_scene
from phys4dgen.scene.yaml_file import read_scene_tree
from phys4dgen.zoo import bundled

__all__ = ["DEFAULT_SCENE", "prepare_demo", "prepare_example"]

DEFAULT_SCENE = "potted_flower"


def prepare_demo(out: Path | str, *, name: str = DEFAULT_SCENE, seed: int = 0) -> Scene:
    """Write a bundled object and its labels into ``out``/input and return the scene that animates it.

    Args:
        out: the run folder.
        name: a key of ``zoo.BUNDLED``.
        seed: of the object's small irregularities.

    Raises:
        SceneError: no bundled object has this name.
        RunError: ``out`` holds other files, or cannot be written.
    """
    return Scene.model_validate(_object_tree(out, name, seed))


def prepare_example(out: Path | str, path: Path) -> Scene:
    """As ``prepare_demo``, of a scene file that names bundled objects as its inputs; what it says wins.

    Args:
        out: the run folder.
        path: a scene file such as those in ``examples/``.

    Raises:
        SceneError: the file is no scene, or its input is no bundled object.
        RunError: ``out`` holds other files, or cannot be written.
    """
    tree, places = read_scene_tree(path)
    given = tree.get("seed", 0)
    seed = given if isinstance(given, int) else 0
    if "input" not in tree and isinstance(tree.get("objects"), dict):
        return validated_scene(_objects_tree(out, tree, seed), source=str(path), places=places)
    name = tree.get("input")
    if not isinstance(name, str):
        raise SceneError(f"{path}: expected the name of a bundled object as input, such as 'input: snowman'.")
    base = _object_tree(out, name, seed)
    merged = _merged(base, {key: value for key, value in tree.items() if key != "input"})
    return validated_scene(merged, source=str(path), places=places)


def _object_tree(out: Path | str, name: str, seed: int) -> dict[str, Any]:
    """Write the object and its labels; the keys and values of its scene."""
    folder = RunFolder(out)
    folder.refuse_foreign_files()
    it = bundled(name, seed=seed)
    splat, labels = folder.input / f"{name}.ply", folder.input / f"{name}_labels.npz"
    save_gaussians(it.gaussians, splat)
    folder.write_npz(labels, {"labels": it.labels, "names": np.array(it.part_names)})
    told = {"input": splat, "grouping": {"labels_file": labels}, "motion": {"preset": it.motion}}
    return _merged(it.default_scene, told)


def _objects_tree(out: Path | str, tree: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """The keys and values of a scene of several bundled objects, all of which are written."""
    objects, parts = {}, {}
    for name, told in tree["objects"].items():
        bundle = told.get("input") if isinstance(told, Mapping) else None
        if not isinstance(bundle, str):
            objects[name] = told  # which the scene refuses with the place where it stands
            continue
        own = _object_tree(out, bundle, seed)
        placed = {key: own[key] for key in ("input", "up", "height_m", "longest_m") if key in own}
        placed["grouping"] = {"labels_file": own["grouping"]["labels_file"]}
        objects[name] = _merged(placed, {key: value for key, value in told.items() if key != "input"})
        parts |= {f"{name}{SEPARATOR}{part}": {**options, "hold": "auto"} for part, options in own["parts"].items()}
    return _merged({"parts": parts}, {**tree, "objects": objects})


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Mappings joined key by key; everything else of ``over`` replaces what ``base`` has."""
    both = {key for key in over if isinstance(over[key], Mapping) and isinstance(base.get(key), Mapping)}
    return {**base, **over, **{key: _merged(base[key], over[key]) for key in both}}
