"""A small object for whole runs in seconds: three parts that differ in colour and shape."""

import numpy as np

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
