"""Rendered pictures of the static object, with what lifting and carving need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types.camera import Camera
from phys4dgen.types.checks import checked_array

__all__ = ["Masks", "Views"]


@dataclass(frozen=True, eq=False)
class Views:
    """V rendered views of one size.

    Attributes:
        cameras: V cameras.
        rgb: colours composited over the background, shape [V, H, W, 3], float32 in [0, 1] or a little above.
        alpha: accumulated opacity, shape [V, H, W], float32.
        depth: median depth (where transmittance falls through 0.5), 0 where there is none, [V, H, W], input units.
    """

    cameras: tuple[Camera, ...]
    rgb: NDArray[np.float32]
    alpha: NDArray[np.float32]
    depth: NDArray[np.float32]

    def __post_init__(self) -> None:
        v = len(self.cameras)
        alpha = checked_array(self.alpha, "alpha", (v, None, None), np.float32)
        h, w = alpha.shape[1:]
        object.__setattr__(self, "alpha", alpha)
        object.__setattr__(self, "rgb", checked_array(self.rgb, "rgb", (v, h, w, 3), np.float32))
        object.__setattr__(self, "depth", checked_array(self.depth, "depth", (v, h, w), np.float32))

    def __len__(self) -> int:
        return len(self.cameras)


@dataclass(frozen=True, eq=False)
class Masks:
    """Label maps over views: which part each pixel shows.

    Attributes:
        labels: shape [V, H, W], int32; -1 abstains.
    """

    labels: NDArray[np.int32]

    def __post_init__(self) -> None:
        labels = checked_array(self.labels, "labels", (None, None, None), np.int32)
        if labels.size and labels.min() < -1:
            raise ValueError(f"labels: expected part numbers from 0, or -1 for none; got {int(labels.min())}.")
        object.__setattr__(self, "labels", labels)
