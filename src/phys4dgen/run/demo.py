"""The demo: a bundled object becomes an input like any other, as files in the run folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from phys4dgen.formats import save_gaussians
from phys4dgen.run.folder import RunFolder
from phys4dgen.scene import Scene
from phys4dgen.zoo.potted_flower import potted_flower

__all__ = ["prepare_demo"]


def prepare_demo(out: Path | str, *, seed: int = 0) -> Scene:
    """Write the potted flower and its labels into ``out``/input and return the scene that animates it.

    Raises:
        RunError: ``out`` holds other files, or cannot be written.
    """
    folder = RunFolder(out)
    folder.refuse_foreign_files()
    flower = potted_flower(seed=seed)
    splat, labels = folder.input / "potted_flower.ply", folder.input / "potted_flower_labels.npz"
    save_gaussians(flower.gaussians, splat)
    folder.write_npz(labels, {"labels": flower.labels, "names": np.array(flower.part_names)})
    scene = Scene.model_validate({"input": splat, **flower.default_scene})
    return scene.with_overrides({"grouping.labels_file": labels})
