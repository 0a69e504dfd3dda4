"""Rotation and limited stretch of the deformation gradient F = R S.

A torn or inverted neighbourhood would draw needles across the picture, so the singular values of F are limited for
rendering and for files. What spreads in two directions, as water on a floor does, is no needle: it may grow in both by
the square of the limit, or its film would have holes. Good motion of solids stays well inside the limits (MOTION.md,
Technique 9): the kernel only tests for them, and the few Gaussians beyond are decomposed exactly here, in float64.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.animate.kernels import polar_slice
from phys4dgen.animate.slices import run_slices
from phys4dgen.errors import StageError
from phys4dgen.types.checks import frozen

__all__ = ["STRETCH_LIMITS", "checked_limits", "polar_and_limited"]

STRETCH_LIMITS = (0.5, 2.0)
"""Least singular value of F that is shown, and how many times the second one (at least 1) the greatest may be."""

_EXTREME_LIMITS = (0.1, 10.0)  # to which the polar iteration converges


def checked_limits(stretch_limits: tuple[float, float]) -> tuple[np.float32, np.float32]:
    """The limits as float32.

    Raises:
        StageError: not 0.1 <= least <= 1 <= greatest <= 10.
    """
    lower, upper = stretch_limits
    if not _EXTREME_LIMITS[0] <= lower <= 1 <= upper <= _EXTREME_LIMITS[1]:
        raise StageError(f"stretch_limits: expected 0.1 <= least <= 1 <= greatest <= 10, got {lower} and {upper}.")
    return np.float32(lower), np.float32(upper)


def polar_and_limited(
    deformation: NDArray[Any], count: int, *, limits: tuple[np.float32, np.float32], threads: int | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Proper rotations nearest to F, and F with singular values within the limits.

    Where det F < 0 the least singular value counts as negative, so the limited F is never turned inside out. The
    greatest singular value is limited to ``greatest`` times the second one, which is taken as no less than 1 and no
    more than ``greatest`` for that.

    Args:
        deformation: F, shape [count, 3, 3].
        count: number of Gaussians.
        limits: see ``checked_limits``.
        threads: of the kernel.

    Returns:
        R and limited F, both [count, 9], float32, the latter read-only; F itself where it lies inside the limits.

    Raises:
        StageError: ``deformation`` has another shape.
    """
    if np.shape(deformation) != (count, 3, 3):
        raise StageError(f"deformation: expected shape ({count}, 3, 3), got {np.shape(deformation)}.")
    # Read-only, whatever the caller's array is: Numba compiles one specialisation, not one per writeability.
    matrices = frozen(np.ascontiguousarray(deformation, np.float32).reshape(count, 9))
    rotations = np.zeros((count, 9), np.float32)
    overstretched = np.zeros(count, np.bool_)
    run_slices(polar_slice, matrices, *limits, rotations, overstretched, threads=threads)
    rows = np.flatnonzero(overstretched)
    if len(rows):
        left, values, right = np.linalg.svd(matrices[rows].reshape(-1, 3, 3).astype(np.float64))
        orientation = np.where(np.linalg.det(left) * np.linalg.det(right) < 0, -1.0, 1.0)
        left[:, :, 2] *= orientation[:, None]
        values[:, 2] *= orientation
        limited = matrices.copy()
        limited[rows] = ((left * _limited(values, *limits)[:, None, :]) @ right).reshape(-1, 9)
        matrices = frozen(limited)
        rotations[rows] = (left @ right).reshape(-1, 9)
    return rotations, matrices


def _limited(values: NDArray[np.float64], least: np.float32, greatest: np.float32) -> NDArray[np.float64]:
    """Singular values in descending order, [n, 3], within the limits."""
    across = np.clip(values[:, 1], 1, greatest)
    limited = np.maximum(values, least)
    limited[:, 0] = np.minimum(limited[:, 0], greatest * across)
    limited[:, 1:] = np.minimum(limited[:, 1:], limited[:, :1])
    return limited
