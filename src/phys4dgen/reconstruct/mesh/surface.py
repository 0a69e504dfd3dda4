"""What a mesh file is reduced to: triangles that carry colour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Surface"]


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one material; the colour of a point is the texture there times the colour of the corners.

    Attributes:
        triangles: corners, file units, shape [F, 3, 3], float64.
        corner_rgba: linear RGB and opacity in [0, 1], shape [F, 3, 4], float32.
        uv: texture coordinates of the corners, origin at the lower left of the texture, shape [F, 3, 2]; or None.
        texture: sRGB and opacity in [0, 1], shape [H, W, 4], float32; None without ``uv``.
        alpha_cutoff: points of less opacity are holes and the others opaque; None: opacity as it is.
    """

    triangles: NDArray[np.float64]
    corner_rgba: NDArray[np.float32]
    uv: NDArray[Any] | None = None
    texture: NDArray[np.float32] | None = None
    alpha_cutoff: float | None = None

    @property
    def is_plain(self) -> bool:
        """Whether it has one colour throughout."""
        return self.texture is None and bool((self.corner_rgba == self.corner_rgba[0, 0]).all())
