"""The elastic state of plastic laws: E = b - I, the elastic left Cauchy-Green tensor less the identity.

With F = F_E F_P and b = F_E F_E^T a substep is b <- (I + dt C) b (I + dt C)^T, so that with M = dt C (I + E)

    E <- E + M + M^T + M (dt C)^T,

six numbers instead of nine and no singular value decomposition: all laws here are isotropic, so stress and flow share
the axes of b. E, and not b, keeps the digits of small strains; its sum is compensated, because a slow load adds less
per substep than a float32 can hold.

In the axes of b, s_i^2 = 1 + E_i with s_i the elastic stretches, eps_i = ln s_i = log1p(E_i) / 2 (Hencky strain). Where
E is small in all particles of a batch, functions of it are rational ones of the matrix (``vector.matrix_functions``);
eigenvectors, which are dearer, are for larger strains.

Sources: J. C. Simo, *Algorithms for static and dynamic multiplicative plasticity*, Comput. Methods Appl. Mech. Eng. 99
(1992) 61-112 (b as the state); G. Klar et al., *Drucker-Prager elastoplasticity for sand animation*, SIGGRAPH 2016
(Hencky strain in MPM).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.vector.lanes import add_compensated, any_lane, like, maximum, minimum, sqrt, where
from phys4dgen.vector.math import expm1, inline, log1p
from phys4dgen.vector.matrix import left_cauchy_green, matmul, symmetric_eigen, symmetric_from_eigen
from phys4dgen.vector.matrix_functions import expm1_near_zero, half_log1p_near_zero, powers, squared_norm

__all__ = [
    "NEAR_ZERO",
    "STRAIN_STATE",
    "advanced",
    "deviator",
    "hencky",
    "hencky_energy_pa",
    "hencky_strains",
    "hencky_stretches",
    "of_gradient",
    "opened",
    "principal_strains",
    "principal_values",
    "recomposed",
    "settled",
    "settled_principal",
    "strains_of_gradient",
    "tau_of_hencky",
]

STRAIN_STATE = tuple(f"{kind}_{ij}" for kind in ("strain", "rest") for ij in ("xx", "xy", "xz", "yy", "yz", "zz"))
"""The twelve state columns: E and what rounding took from it."""

NEAR_ZERO = np.float32(0.4)
"""Frobenius norm of E up to which rational functions of the matrix are exact in float32."""

_NEAR_ZERO_EXPONENT = np.float32(0.5)
_LOW, _HIGH = np.float32(0.05**2 - 1), np.float32(20.0**2 - 1)  # stretches count as 0.05 to 20
_f = np.float32


@inline
def of_gradient(h):
    """E = H + H^T + H H^T of nine lanes of H = F - I: six lanes."""
    h00, h01, h02, h10, h11, h12, h20, h21, h22 = h
    q00, q01, q02, q11, q12, q22 = left_cauchy_green(h)
    return h00 + h00 + q00, h01 + h10 + q01, h02 + h20 + q02, h11 + h11 + q11, h12 + h21 + q12, h22 + h22 + q22


@inline
def advanced(state, c, dt):
    """(E, rest) after a substep dt with the velocity gradient C, six lanes each, from twelve of state."""
    e00, e01, e02, e11, e12, e22, r00, r01, r02, r11, r12, r22 = state
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = c
    g = (dt * c00, dt * c01, dt * c02, dt * c10, dt * c11, dt * c12, dt * c20, dt * c21, dt * c22)
    g00, g01, g02, g10, g11, g12, g20, g21, g22 = g
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = matmul(g, (e00, e01, e02, e01, e11, e12, e02, e12, e22))
    m00, m01, m02 = m00 + g00, m01 + g01, m02 + g02
    m10, m11, m12 = m10 + g10, m11 + g11, m12 + g12
    m20, m21, m22 = m20 + g20, m21 + g21, m22 + g22
    e00, r00 = add_compensated(e00, r00, m00 + m00 + m00 * g00 + m01 * g01 + m02 * g02)
    e01, r01 = add_compensated(e01, r01, m01 + m10 + m00 * g10 + m01 * g11 + m02 * g12)
    e02, r02 = add_compensated(e02, r02, m02 + m20 + m00 * g20 + m01 * g21 + m02 * g22)
    e11, r11 = add_compensated(e11, r11, m11 + m11 + m10 * g10 + m11 * g11 + m12 * g12)
    e12, r12 = add_compensated(e12, r12, m12 + m21 + m10 * g20 + m11 * g21 + m12 * g22)
    e22, r22 = add_compensated(e22, r22, m22 + m22 + m20 * g20 + m21 * g21 + m22 * g22)
    return (e00, e01, e02, e11, e12, e22), (r00, r01, r02, r11, r12, r22)


@inline
def principal_strains(e):
    """(E_i, axes): principal values of E within sane limits, three lanes, and eigenvectors, nine."""
    values, axes = symmetric_eigen(e)
    low, high = like(e[0], _LOW), like(e[0], _HIGH)
    return (
        minimum(maximum(values[0], low), high),
        minimum(maximum(values[1], low), high),
        minimum(maximum(values[2], low), high),
    ), axes


@inline
def hencky(e):
    """Eps = ln(I + E) / 2, the Hencky strain: six lanes."""
    if any_lane(squared_norm(e) > like(e[0], NEAR_ZERO * NEAR_ZERO)):
        (e0, e1, e2), axes = principal_strains(e)
        half = _f(0.5)
        return symmetric_from_eigen((half * log1p(e0), half * log1p(e1), half * log1p(e2)), axes)
    squared, invariants = powers(e)
    return half_log1p_near_zero(e, squared, invariants)


@inline
def deviator(eps):
    """(trace, deviator, its norm) of six lanes."""
    x, xy, xz, y, yz, z = eps
    trace = x + y + z
    mean = trace * _f(1 / 3)
    parts = x - mean, xy, xz, y - mean, yz, z - mean
    return trace, parts, sqrt(squared_norm(parts))


@inline
def opened(eps, gap):
    """Six lanes with the volume strain ``gap`` added."""
    third = gap * _f(1 / 3)
    x, xy, xz, y, yz, z = eps
    return x + third, xy, xz, y + third, yz, z + third


@inline
def recomposed(mean, keep, deviators):
    """Six lanes of a mean and a share of a deviator."""
    x, xy, xz, y, yz, z = deviators
    return mean + keep * x, keep * xy, keep * xz, mean + keep * y, keep * yz, mean + keep * z


@inline
def _strain_of_hencky(eps):
    """E = exp(2 eps) - I, six lanes."""
    x, xy, xz, y, yz, z = eps
    twice = x + x, xy + xy, xz + xz, y + y, yz + yz, z + z
    if any_lane(squared_norm(twice) > like(x, _NEAR_ZERO_EXPONENT * _NEAR_ZERO_EXPONENT)):
        (t0, t1, t2), axes = symmetric_eigen(twice)
        return symmetric_from_eigen((expm1(t0), expm1(t1), expm1(t2)), axes)
    return expm1_near_zero(twice)


@inline
def settled(changed, eps, e, rest):
    """The twelve lanes of state: E from the Hencky strain where ``changed``, else as it was, to the last bit."""
    if any_lane(changed):
        return _with_strain(changed, _strain_of_hencky(eps), e, rest)
    return e[0], e[1], e[2], e[3], e[4], e[5], rest[0], rest[1], rest[2], rest[3], rest[4], rest[5]


@inline
def settled_principal(changed, values, axes, e, rest):
    """As ``settled``, from the principal values of E, three lanes, and their axes, nine."""
    if any_lane(changed):
        return _with_strain(changed, symmetric_from_eigen(values, axes), e, rest)
    return e[0], e[1], e[2], e[3], e[4], e[5], rest[0], rest[1], rest[2], rest[3], rest[4], rest[5]


@inline
def _with_strain(changed, new, e, rest):
    """The twelve lanes of state: E of the six lanes ``new`` where ``changed``, with nothing lost to rounding."""
    zero = like(e[0], _f(0))
    return (
        where(changed, new[0], e[0]),
        where(changed, new[1], e[1]),
        where(changed, new[2], e[2]),
        where(changed, new[3], e[3]),
        where(changed, new[4], e[4]),
        where(changed, new[5], e[5]),
        where(changed, zero, rest[0]),
        where(changed, zero, rest[1]),
        where(changed, zero, rest[2]),
        where(changed, zero, rest[3]),
        where(changed, zero, rest[4]),
        where(changed, zero, rest[5]),
    )


@inline
def tau_of_hencky(eps, mu, lam):
    """Kirchhoff stress tau = 2 mu eps + lam tr eps I, six lanes."""
    x, xy, xz, y, yz, z = eps
    volumetric = lam * (x + y + z)
    m = mu + mu
    return m * x + volumetric, m * xy, m * xz, m * y + volumetric, m * yz, m * z + volumetric


# ------------------------------------------------------------------------------------------- the same in NumPy


def principal_values(six: NDArray[Any] | tuple[NDArray[Any], ...]) -> NDArray[np.float64]:
    """Eigenvalues [P, 3], largest first, of symmetric matrices given as six columns of P numbers each.

    In closed form, twenty times as fast as LAPACK for many small matrices. Where two of them agree they are off by
    1e-8 of the deviator's size, in opposite directions, so that smooth functions of all three keep more digits.

    Source: O. K. Smith, *Eigenvalues of a symmetric 3 x 3 matrix*, Commun. ACM 4 (1961) 168.
    """
    a00, a01, a02, a11, a12, a22 = (np.asarray(column, np.float64) for column in six)
    mean = (a00 + a11 + a22) / 3
    d0, d1, d2 = a00 - mean, a11 - mean, a22 - mean
    x, y, z = a01 * a01, a02 * a02, a12 * a12
    size = np.sqrt((d0 * d0 + d1 * d1 + d2 * d2 + 2 * (x + y + z)) / 6)
    half_det = (d0 * (d1 * d2 - z) - d2 * x - d1 * y) / 2 + a01 * a12 * a02
    angle = np.arccos(np.clip(half_det / np.maximum(size**3, 1e-300), -1, 1)) / 3
    first, last = 2 * size * np.cos(angle), 2 * size * np.cos(angle + 2 * np.pi / 3)
    return np.stack([mean + first, mean - first - last, mean + last], -1)


def strains_of_gradient(F: NDArray[Any]) -> NDArray[np.float64]:
    """Principal values of E = F F^T - I, [P, 3], of F [P, 3, 3]."""
    H = np.asarray(F, np.float64) - np.eye(3)
    E = H + np.swapaxes(H, -1, -2) + H @ np.swapaxes(H, -1, -2)
    six = E[:, 0, 0], E[:, 0, 1], E[:, 0, 2], E[:, 1, 1], E[:, 1, 2], E[:, 2, 2]
    return np.clip(principal_values(six), float(_LOW), float(_HIGH))


def hencky_strains(state: NDArray[Any]) -> NDArray[np.float64]:
    """Principal Hencky strains [P, 3] of the state columns [12 or more, P]."""
    six = np.asarray(state[:6], np.float64) + np.asarray(state[6:12], np.float64)
    return np.log1p(np.clip(principal_values(six), float(_LOW), float(_HIGH))) / 2


def hencky_energy_pa(eps: NDArray[Any], mu: NDArray[Any], lam: NDArray[Any]) -> NDArray[np.float64]:
    """Psi = mu sum eps_i^2 + lam/2 (tr eps)^2 of Hencky strains [P, 3], J/m3, [P]."""
    return mu * (eps**2).sum(-1) + lam / 2 * eps.sum(-1) ** 2


def hencky_stretches(tau: NDArray[Any], mu: NDArray[Any], lam: NDArray[Any]) -> NDArray[np.float64]:
    """Principal stretches [P, 3] under tau_i = 2 mu eps_i + lam tr eps [P, 3]; see ``Law.stretches``."""
    trace = tau.sum(1) / (3 * lam + 2 * mu)
    eps = (tau - (lam * trace)[:, None]) / (2 * mu)[:, None]
    return np.exp(np.clip(eps, *np.log1p([float(_LOW), float(_HIGH)]) / 2))
