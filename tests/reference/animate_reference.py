"""Skinning, covariance and rotation of Gaussians in plain float64 NumPy: slow, obvious, written apart from the product.

Equations as in docs/design: x = sum w (x_p + F_p (X - X_p)), F = sum w F_p, Sigma' = F_c Sigma F_c^T with the singular
values of F limited, R the rotation of the polar decomposition.
"""

import numpy as np


def blend(means, particles, weights, rest, now, gradients):
    """Positions [N, 3] and deformation gradients [N, 3, 3], one Gaussian and one particle at a time."""
    positions = np.zeros((len(means), 3))
    deformation = np.zeros((len(means), 3, 3))
    for i, mean in enumerate(np.asarray(means, np.float64)):
        for p, w in zip(particles[i], weights[i].astype(np.float64), strict=True):
            positions[i] += w * (now[p] + gradients[p] @ (mean - rest[p]))
            deformation[i] += w * gradients[p]
    return positions, deformation


def polar_rotation(deformation):
    """The proper rotation nearest to each F (Kabsch: the smallest singular direction takes the reflection)."""
    u, _, vt = np.linalg.svd(np.asarray(deformation, np.float64))
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return u @ vt


def limited(deformation, lower=0.5, upper=2.0):
    """F with singular values (the smallest negative where det F < 0) that are at least ``lower``.

    The largest is at most ``upper`` times the second one, which counts as 1 at least and ``upper`` at most there.
    """
    u, s, vt = np.linalg.svd(np.asarray(deformation, np.float64))
    sign = np.sign(np.linalg.det(u @ vt))
    u[..., :, 2] *= sign[..., None]
    s[..., 2] *= sign
    shown = []
    for first, second, third in s.reshape(-1, 3):
        most = upper * min(max(second, 1), upper)
        shown.append([min(max(value, lower), most) for value in (first, second, third)])
    return (u * np.array(shown).reshape(s.shape)[..., None, :]) @ vt


def deformed_covariance(deformation, covariance):
    """Sigma' = F_c Sigma F_c^T, shape [N, 3, 3]."""
    f = limited(deformation)
    return f @ covariance @ np.swapaxes(f, -1, -2)


def unpack6(packed):
    """xx xy xz yy yz zz -> symmetric [N, 3, 3]."""
    packed = np.asarray(packed, np.float64)
    return packed[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
