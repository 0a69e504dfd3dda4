"""The motion of all Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phys4dgen.types.checks import checked_array

__all__ = ["Trajectory"]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Centres and total deformation gradients per frame, in the input's coordinates and axes.

    Attributes:
        times_s: shape [T], float64; frame 0 is the rest pose at t = 0.
        positions: shape [T, N, 3], float32, input units.
        deformation_gradients: total F, shape [T, N, 3, 3], float32, dimensionless.
    """

    times_s: NDArray[np.float64]
    positions: NDArray[np.float32]
    deformation_gradients: NDArray[np.float32]

    def __post_init__(self) -> None:
        times = checked_array(self.times_s, "times_s", (None,), np.float64)
        t = len(times)
        positions = checked_array(self.positions, "positions", (t, None, 3), np.float32)
        n = positions.shape[1]
        gradients = checked_array(self.deformation_gradients, "deformation_gradients", (t, n, 3, 3), np.float32)
        object.__setattr__(self, "times_s", times)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "deformation_gradients", gradients)

    @property
    def frame_count(self) -> int:
        """Number of frames T."""
        return len(self.times_s)
