"""Deformed Gaussians as files want them: scales and quaternions whose axes do not jump, and turned colours.

Sigma' has many decompositions R diag(s^2) R^T. Viewers that interpolate between frames, and formats that store
differences, need the one that continues the frame before: the same axis stays the same column, and q keeps its sign.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from phys4dgen.animate.axes_kernel import axes_slice
from phys4dgen.animate.kernels import blocked
from phys4dgen.animate.slices import run_slices
from phys4dgen.animate.stretch import STRETCH_LIMITS, checked_limits, polar_and_limited
from phys4dgen.types import Gaussians, rotation_from_quats

__all__ = ["AxisTracker"]

_LEAST_SCALE_RATIO = 1e-8
"""Thinner Gaussians count as this thin while they move: their axes must still have a direction in float32."""


class AxisTracker:
    """Scales and quaternions of N Gaussians, frame after frame.

    Frames must be given in order, the rest pose first; a Gaussian that has not moved keeps its quaternion and scales
    to the bit.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        *,
        stretch_limits: tuple[float, float] = STRETCH_LIMITS,
        threads: int | None = None,
    ) -> None:
        """Start from the rest pose; see ``Deformer`` for the arguments."""
        n = len(gaussians)
        self._limits = checked_limits(stretch_limits)
        self._threads = threads
        self._rest_quats = gaussians.quats_wxyz
        self._rest_scales = gaussians.scales
        largest = gaussians.scales.max(1, keepdims=True).astype(np.float64)
        relative = np.maximum(gaussians.scales / largest, _LEAST_SCALE_RATIO)
        axes = rotation_from_quats(gaussians.quats_wxyz) * relative[:, None, :]
        self._order, sorting, unsort = _longest_first(gaussians.scales)
        self._rest_axes = blocked(np.concatenate([(axes @ sorting).reshape(n, 9), largest], 1))
        self._unsort = blocked(unsort)
        self._turned = blocked(np.tile(np.eye(3).reshape(1, 9), (n, 1)))
        self._previous = blocked(gaussians.quats_wxyz)

    def advance(self, deformation: NDArray[Any]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Quaternions (w, x, y, z) [N, 4] and scales [N, 3] of the next frame, from its total F [N, 3, 3]."""
        n = len(self._rest_quats)
        _, limited = polar_and_limited(deformation, n, limits=self._limits, threads=self._threads)
        quats = np.zeros((n, 4), np.float32)
        scales = np.zeros((n, 3), np.float32)
        run_slices(
            axes_slice,
            limited,
            self._rest_axes,
            self._order,
            self._unsort,
            self._turned,
            self._previous,
            self._rest_quats,
            self._rest_scales,
            quats,
            scales,
            threads=self._threads,
        )
        return quats, scales


def _longest_first(
    scales: NDArray[np.float32],
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """How to sort the axes of each Gaussian by length.

    Returns:
        Number of the axis that comes first, second, third [N, 3]; the proper signed permutation that sorts columns
        [N, 3, 3]; the quaternion (w, x, y, z) of its inverse [N, 4].
    """
    order = np.argsort(-scales, axis=1, kind="stable")
    kinds, kind = np.unique(order, axis=0, return_inverse=True)  # at most six
    sorting = np.eye(3)[kinds].swapaxes(1, 2)
    sorting[:, :, 2] *= np.linalg.det(sorting)[:, None]
    unsort = Rotation.from_matrix(sorting.swapaxes(1, 2)).as_quat(scalar_first=True)
    kind = kind.reshape(-1)
    return order.astype(np.int32), sorting[kind], unsort[kind]
