"""A small object for whole runs in seconds: three parts that differ in colour and shape."""

import numpy as np

from phys4dgen.formats import save_gaussians
from phys4dgen.scene import Scene
from phys4dgen.types import Gaussians


def lollipop():
    """A ball on a stick that stands in a block, 1,500 small Gaussians, z up, 0.2 m tall."""
    rng = np.random.default_rng(4)
    block = rng.uniform([-0.03, -0.03, 0], [0.03, 0.03, 0.04], (500, 3))
    stick = np.column_stack([rng.normal(0, 0.003, (500, 2)), rng.uniform(0.03, 0.15, 500)])
    ball = rng.normal(size=(500, 3))
    ball = [0, 0, 0.17] + 0.03 * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    colors = np.repeat([[0.6, 0.3, 0.2], [0.9, 0.9, 0.9], [0.9, 0.1, 0.2]], 500, axis=0)
    gaussians = Gaussians(
        means=np.concatenate([block, stick, ball]),
        quats_wxyz=np.tile([1, 0, 0, 0], (1500, 1)),
        scales=np.full((1500, 3), 0.004),
        opacities=np.full(1500, 0.95),
        sh=((colors - 0.5) / 0.28209479)[:, None],
    )
    return gaussians, np.repeat([0, 1, 2], 500).astype(np.int32)


def lollipop_scene(folder, **settings):
    """A coarse scene of it with its files in ``folder``; ``settings`` by key, with __ in the place of dots."""
    gaussians, labels = lollipop()
    save_gaussians(gaussians, folder / "lollipop.ply")
    np.savez(folder / "labels.npz", labels=labels, names=np.array(["block", "stick", "ball"]))
    return Scene(input=folder / "lollipop.ply").with_overrides(
        {
            "up": "z",
            "height_m": 0.2,
            "grouping.labels_file": folder / "labels.npz",
            "parts.block.hold": "fixed",
            "simulation.grid": 16,
            "simulation.duration_s": 0.25,
            "simulation.max_substeps": 60,
            "simulation.chunks": 1,
            "simulation.threads": 1,
            "views.size_px": 64,
            "output.video.width": 96,
            **{key.replace("__", "."): value for key, value in settings.items()},
        }
    )
