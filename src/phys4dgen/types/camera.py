"""A pinhole camera in OpenCV convention (x right, y down, z forward)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types.checks import checked_array

__all__ = ["Camera"]


@dataclass(frozen=True, eq=False)
class Camera:
    """One view of the object, in the input's coordinates.

    Attributes:
        viewmat: input coordinates -> camera, shape [4, 4], float64 (gsplat's ``viewmats`` entry).
        K: intrinsics in pixels, shape [3, 3], float64; pixel centres lie at +0.5.
        width: pixels.
        height: pixels.
    """

    viewmat: NDArray[np.float64]
    K: NDArray[np.float64]
    width: int
    height: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "viewmat", checked_array(self.viewmat, "viewmat", (4, 4), np.float64))
        object.__setattr__(self, "K", checked_array(self.K, "K", (3, 3), np.float64))
        if not (0 < self.width <= 16384 and 0 < self.height <= 16384):
            raise ValueError(f"width, height: expected 1 to 16384 pixels, got {self.width} x {self.height}.")

    @property
    def position(self) -> NDArray[np.float64]:
        """Camera centre in input coordinates, shape [3]."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]

    def resized(self, width: int, height: int) -> Camera:
        """The camera whose picture shows the same section in other pixels."""
        K = np.diag([width / self.width, height / self.height, 1]) @ self.K
        return Camera(viewmat=self.viewmat, K=K, width=width, height=height)

    def project(self, points: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixel coordinates [N, 2] and depth along the optical axis [N] of points [N, 3]."""
        camera_points = np.asarray(points, np.float64) @ self.viewmat[:3, :3].T + self.viewmat[:3, 3]
        depth = camera_points[:, 2]
        safe = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
        u = self.K[0, 0] * camera_points[:, 0] / safe + self.K[0, 2]
        v = self.K[1, 1] * camera_points[:, 1] / safe + self.K[1, 2]
        return np.stack([u, v], 1), depth
