"""Balls for scenes of several objects in seconds: two parts, an upper and a lower half, each of its own colour."""

import numpy as np

from phys4dgen.formats import save_gaussians
from phys4dgen.scene import Scene
from phys4dgen.types import Gaussians

RADIUS_M = 0.05


def ball(*, sh_degree=0, up=2, seed=0):
    """600 Gaussians in the surface of a ball of radius 2.5 input units, and the half that each belongs to."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(600, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    labels = (normals[:, up] > 0).astype(np.int32)
    sh = rng.normal(0, 0.05, (600, (sh_degree + 1) ** 2, 3))
    sh[:, 0] = (np.array([[0.2, 0.5, 0.8], [0.9, 0.3, 0.2]])[labels] - 0.5) / 0.28209479
    quats = rng.normal(size=(600, 4))
    gaussians = Gaussians(
        means=2.5 * normals + [7, -3, 11],
        quats_wxyz=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        scales=rng.uniform(0.12, 0.3, (600, 3)),
        opacities=np.full(600, 0.95),
        sh=sh,
    )
    return gaussians, labels


def write_ball(folder, name="ball", **shape):
    """Its files in ``folder``, and what a scene says of it."""
    gaussians, labels = ball(**shape)
    splat, labels_file = folder / f"{name}.ply", folder / f"{name}_labels.npz"
    save_gaussians(gaussians, splat)
    np.savez(labels_file, labels=labels, names=np.array(["lower", "upper"]))
    return {
        "input": splat.as_posix(),
        "up": "xyz"[shape.get("up", 2)],
        "height_m": 2 * RADIUS_M,
        "grouping": {"labels_file": labels_file.as_posix()},
    }


def two_balls_tree(folder, *, left=None, right=None, **settings):
    """Keys and values of a coarse scene of a ball on the left and a ball on the right; the former along z, the latter
    with y up and with colours of degree 1."""
    folder.mkdir(exist_ok=True)
    return {
        "objects": {
            "left": {**write_ball(folder, "left"), "position_m": [-0.08, 0, 0.02], **(left or {})},
            "right": {
                **write_ball(folder, "right", up=1, sh_degree=1, seed=1),
                "position_m": [0.08, 0, 0.02],
                **(right or {}),
            },
        },
        "parts": {"all": {"material": "natural_rubber"}},
        "simulation": {"grid": 12, "duration_s": 0.125, "max_substeps": 60, "chunks": 1, "threads": 1},
        "views": {"size_px": 64},
        "output": {"video": {"width": 96}},
        **settings,
    }


def two_balls(folder, **told):
    """The scene of ``two_balls_tree``."""
    return Scene.model_validate(two_balls_tree(folder, **told))
