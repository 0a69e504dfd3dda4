"""How the kernels see the motion of a rigid group, and the algebra of vectors and rotations that they share."""

from __future__ import annotations

import math

from phys4dgen.mpm.kernels.layout import strict_kernel

__all__ = [
    "CENTRE",
    "FITTED_SPIN",
    "FITTED_VELOCITY",
    "LAST_ROTATION",
    "MOTION_COUNT",
    "ROTATION",
    "SPIN",
    "SUM_COUNT",
    "VELOCITY_OF_CENTRE",
    "cross",
    "rotated",
    "three",
    "times",
    "turn",
    "world_inverse_inertia",
]

CENTRE = 0  # 3 columns of a group's motion, m from the origin
VELOCITY_OF_CENTRE = 3  # 3 columns, m/s
SPIN = 6  # 3 columns, rad/s
ROTATION = 9  # 9 columns, row by row
FITTED_VELOCITY = 18  # 3 columns, m/s, and
FITTED_SPIN = 21  # 3 columns, rad/s: the rigid motion closest to the velocities gathered last, without C
LAST_ROTATION = 24  # 9 columns: the rotation when they were gathered
MOTION_COUNT = 33
SUM_COUNT = 9  # P of a group, the share of L in the velocities, that in C


@strict_kernel
def three(values, at):
    """Three values from a place on."""
    return values[at], values[at + 1], values[at + 2]


@strict_kernel
def cross(a, b):
    """Cross product of two triples."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@strict_kernel
def rotated(motion, at, x):
    """The rotation in columns ``at`` of a group's motion, times a vector."""
    return (
        motion[at] * x[0] + motion[at + 1] * x[1] + motion[at + 2] * x[2],
        motion[at + 3] * x[0] + motion[at + 4] * x[1] + motion[at + 5] * x[2],
        motion[at + 6] * x[0] + motion[at + 7] * x[1] + motion[at + 8] * x[2],
    )


@strict_kernel
def times(matrix, x, y, z):
    """A matrix [3, 3] times a vector."""
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@strict_kernel
def turn(rotation, wx, wy, wz, result):
    """``result`` = exp([w]x) ``rotation``, re-orthonormalised; w in radians, both [9]."""
    angle = math.sqrt(wx * wx + wy * wy + wz * wz)
    s = math.sin(angle) / angle if angle > 1e-12 else 1.0
    half = math.sin(angle / 2) / (angle / 2) if angle > 1e-12 else 1.0
    k = half * half / 2
    cosine = math.cos(angle)
    e = (
        cosine + k * wx * wx, k * wx * wy - s * wz, k * wx * wz + s * wy,
        k * wx * wy + s * wz, cosine + k * wy * wy, k * wy * wz - s * wx,
        k * wx * wz - s * wy, k * wy * wz + s * wx, cosine + k * wz * wz,
    )  # fmt: skip
    for i in range(3):
        for j in range(3):
            result[3 * i + j] = e[3 * i] * rotation[j] + e[3 * i + 1] * rotation[3 + j] + e[3 * i + 2] * rotation[6 + j]
    # rows: unit first row, second made orthogonal to it, third their cross product
    a, b, c = result[0], result[1], result[2]
    n = 1 / math.sqrt(a * a + b * b + c * c)
    a, b, c = a * n, b * n, c * n
    along = a * result[3] + b * result[4] + c * result[5]
    d, f, h = result[3] - along * a, result[4] - along * b, result[5] - along * c
    n = 1 / math.sqrt(d * d + f * f + h * h)
    d, f, h = d * n, f * n, h * n
    result[0], result[1], result[2] = a, b, c
    result[3], result[4], result[5] = d, f, h
    result[6], result[7], result[8] = b * h - c * f, c * d - a * h, a * f - b * d


@strict_kernel
def world_inverse_inertia(rotation, inverse_inertia, result):
    """``result`` = R I^-1 R^T, float64 [3, 3]."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                for m in range(3):
                    total += rotation[3 * i + k] * inverse_inertia[k, m] * rotation[3 * j + m]
            result[i, j] = total
