"""The demo: a bundled object becomes an input like any other, as files in the run folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from phys4dgen.formats import save_gaussians
from phys4dgen.run.folder import RunFolder
from phys4dgen.scene import Scene
from phys4dgen.zoo import bundled

__all__ = ["DEFAULT_SCENE", "prepare_demo"]

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
    folder = RunFolder(out)
    folder.refuse_foreign_files()
    it = bundled(name, seed=seed)
    splat, labels = folder.input / f"{name}.ply", folder.input / f"{name}_labels.npz"
    save_gaussians(it.gaussians, splat)
    folder.write_npz(labels, {"labels": it.labels, "names": np.array(it.part_names)})
    scene = Scene.model_validate({"input": splat, **it.default_scene})
    return scene.with_overrides({"grouping.labels_file": labels, "motion.preset": it.motion})
