"""Turning spherical-harmonic colours with the Gaussians that carry them.

A colour f(d) that turns with its Gaussian by R becomes f'(d) = f(R^T d). Rotations do not mix the bands l, so the new
coefficients of a band follow exactly from the values of f' at 2l + 1 or more directions s_i:
Y_l(s) c' = Y_l(R^T s) c, hence c' = pinv(Y_l(s)) Y_l(R^T s) c. The pseudo-inverses are constants. Order and signs of
the harmonics are those of INRIA's 3DGS: k = l^2 + l + m with the Condon-Shortley sign.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["rotate_sh"]

BLOCK_ROWS = 2048  # working arrays of a block stay in the second-level cache


def rotate_sh(sh: NDArray[Any], rotations: NDArray[Any]) -> NDArray[np.float32]:
    """Coefficients of the same colours after each Gaussian has turned.

    Args:
        sh: coefficients, shape [N, K, 3] with K = 1, 4, 9 or 16.
        rotations: proper rotation matrices R, turned = R @ original, shape [N, 3, 3].

    Returns:
        Coefficients, shape [N, K, 3], float32; error below 1e-5 of the largest coefficient.
    """
    n, count = len(sh), sh.shape[1]
    if count not in (1, 4, 9, 16) or sh.shape[2:] != (3,):
        raise ValueError(f"sh: expected shape [N, K, 3] with K = 1, 4, 9 or 16, got {sh.shape}.")
    if rotations.shape != (n, 3, 3):
        raise ValueError(f"rotations: expected shape {(n, 3, 3)}, got {rotations.shape}.")
    degree = math.isqrt(count) - 1
    turned = np.array(sh, np.float32)
    for start in range(0, n if degree else 0, BLOCK_ROWS):
        rows = slice(start, start + BLOCK_ROWS)
        matrices = np.asarray(rotations[rows], np.float32)
        x, y, z = (SAMPLES @ matrices[:, :, axis].T for axis in range(3))  # R^T s_i, each [S, n]
        coefficients = np.ascontiguousarray(turned[rows].transpose(1, 2, 0))  # [K, 3, n]
        for band in range(1, degree + 1):
            first, last = band * band, (band + 1) * (band + 1)
            basis = band_basis(band, x, y, z)
            values = basis[0][None] * coefficients[first][:, None]  # [3, S, n]
            for function, coefficient in zip(basis[1:], coefficients[first + 1 : last], strict=True):
                values += function[None] * coefficient[:, None]
            turned[rows, first:last] = (INVERSES[band] @ values).transpose(2, 1, 0)
    return turned


def band_basis(band: int, x: NDArray[Any], y: NDArray[Any], z: NDArray[Any]) -> list[NDArray[Any]]:
    """The 2 * band + 1 harmonics of unit directions (x, y, z), m = -band ... band; band 1, 2 or 3."""
    if band == 1:
        c = 0.4886025119029199
        return [-c * y, c * z, -c * x]
    xx, yy, zz = x * x, y * y, z * z
    if band == 2:
        c = 1.0925484305920792
        return [
            c * x * y,
            -c * y * z,
            0.31539156525252005 * (2 * zz - xx - yy),
            -c * x * z,
            0.5462742152960396 * (xx - yy),
        ]
    return [
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]


def sample_directions() -> NDArray[np.float64]:
    """Seven directions at which bands 1 to 3 are well conditioned (2.3 at most): the pole and two rings of three.

    The rings lie 60 and 90 degrees from the pole, turned by 30 degrees against each other.
    """
    directions = [(0.0, 0.0, 1.0)]
    for polar_deg, first_deg in ((60, 0), (90, 30)):
        for azimuth_deg in (first_deg, first_deg + 120, first_deg + 240):
            polar, azimuth = math.radians(polar_deg), math.radians(azimuth_deg)
            directions.append(
                (math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar))
            )
    return np.array(directions)


SAMPLES = sample_directions().astype(np.float32)  # [S, 3]
INVERSES = {
    band: np.linalg.pinv(np.stack(band_basis(band, *sample_directions().T), axis=1)).astype(np.float32)
    for band in (1, 2, 3)
}  # [2 * band + 1, S]
