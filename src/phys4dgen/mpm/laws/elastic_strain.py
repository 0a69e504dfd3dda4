"""The elastic state of plastic laws: E = b - I, the elastic left Cauchy-Green tensor less the identity.

With F = F_E F_P and b = F_E F_E^T a substep is b <- (I + dt C) b (I + dt C)^T, so that with M = dt C (I + E)

    E <- E + M + M^T + M (dt C)^T,

six numbers instead of nine and no singular value decomposition: all laws here are isotropic, so stress and flow share
the axes of b. E, and not b, keeps the digits of small strains; its sum is compensated, because a slow load adds less
per substep than a float32 can hold.

In the axes of b, s_i^2 = 1 + E_i with s_i the elastic stretches, eps_i = ln s_i = log1p(E_i) / 2 (Hencky strain).

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

__all__ = [
    "STRAIN_STATE",
    "advanced",
    "deviator",
    "hencky_energy_pa",
    "hencky_strains",
    "hencky_stretches",
    "of_gradient",
    "principal_hencky",
    "principal_strains",
    "settled",
    "settled_strains",
    "strains_of_gradient",
    "tau_of_hencky",
]

STRAIN_STATE = tuple(f"{kind}_{ij}" for kind in ("strain", "rest") for ij in ("xx", "xy", "xz", "yy", "yz", "zz"))
"""The twelve state columns: E and what rounding took from it."""

_LOW, _HIGH = np.float32(0.05**2 - 1), np.float32(20.0**2 - 1)  # stretches count as 0.05 to 20
_SWEEPS = 4
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
    values, axes = symmetric_eigen(e, _SWEEPS)
    low, high = like(e[0], _LOW), like(e[0], _HIGH)
    return (
        minimum(maximum(values[0], low), high),
        minimum(maximum(values[1], low), high),
        minimum(maximum(values[2], low), high),
    ), axes


@inline
def principal_hencky(e):
    """(eps_i, axes): Hencky strains, three lanes, and eigenvectors, nine."""
    values, axes = principal_strains(e)
    half = _f(0.5)
    return (half * log1p(values[0]), half * log1p(values[1]), half * log1p(values[2])), axes


@inline
def deviator(eps):
    """(trace, deviator, its norm) of three principal values."""
    e0, e1, e2 = eps
    trace = e0 + e1 + e2
    mean = trace * _f(1 / 3)
    d0, d1, d2 = e0 - mean, e1 - mean, e2 - mean
    return trace, (d0, d1, d2), sqrt(d0 * d0 + d1 * d1 + d2 * d2)


@inline
def settled(changed, eps, axes, e, rest):
    """The twelve lanes of state: E from the Hencky strains where ``changed``, else as it was, to the last bit."""
    if any_lane(changed):
        strains = expm1(eps[0] + eps[0]), expm1(eps[1] + eps[1]), expm1(eps[2] + eps[2])
        return settled_strains(changed, strains, axes, e, rest)
    return e[0], e[1], e[2], e[3], e[4], e[5], rest[0], rest[1], rest[2], rest[3], rest[4], rest[5]


@inline
def settled_strains(changed, strains, axes, e, rest):
    """As ``settled``, from the principal values of E."""
    if any_lane(changed):
        n00, n01, n02, n11, n12, n22 = symmetric_from_eigen(strains, axes)
        zero = like(n00, _f(0))
        e = (
            where(changed, n00, e[0]),
            where(changed, n01, e[1]),
            where(changed, n02, e[2]),
            where(changed, n11, e[3]),
            where(changed, n12, e[4]),
            where(changed, n22, e[5]),
        )
        rest = (
            where(changed, zero, rest[0]),
            where(changed, zero, rest[1]),
            where(changed, zero, rest[2]),
            where(changed, zero, rest[3]),
            where(changed, zero, rest[4]),
            where(changed, zero, rest[5]),
        )
    return e[0], e[1], e[2], e[3], e[4], e[5], rest[0], rest[1], rest[2], rest[3], rest[4], rest[5]


@inline
def tau_of_hencky(eps, axes, mu, lam):
    """Kirchhoff stress tau_i = 2 mu eps_i + lam tr eps, six lanes."""
    e0, e1, e2 = eps
    volumetric = lam * (e0 + e1 + e2)
    double_mu = mu + mu
    return symmetric_from_eigen(
        (double_mu * e0 + volumetric, double_mu * e1 + volumetric, double_mu * e2 + volumetric), axes
    )


# ------------------------------------------------------------------------------------------- the same in NumPy


def strains_of_gradient(F: NDArray[Any]) -> NDArray[np.float64]:
    """Principal values of E = F F^T - I, [P, 3], of F [P, 3, 3]."""
    F = np.asarray(F, np.float64)
    return np.clip(np.linalg.eigvalsh(F @ np.swapaxes(F, -1, -2)) - 1, float(_LOW), float(_HIGH))


def hencky_strains(state: NDArray[Any]) -> NDArray[np.float64]:
    """Principal Hencky strains [P, 3] of the state columns [12 or more, P]."""
    six = np.asarray(state[:6], np.float64) + np.asarray(state[6:12], np.float64)
    strain = six[[0, 1, 2, 1, 3, 4, 2, 4, 5]].T.reshape(-1, 3, 3)
    return np.log1p(np.clip(np.linalg.eigvalsh(strain), float(_LOW), float(_HIGH))) / 2


def hencky_energy_pa(eps: NDArray[Any], mu: NDArray[Any], lam: NDArray[Any]) -> NDArray[np.float64]:
    """Psi = mu sum eps_i^2 + lam/2 (tr eps)^2 of Hencky strains [P, 3], J/m3, [P]."""
    return mu * (eps**2).sum(-1) + lam / 2 * eps.sum(-1) ** 2


def hencky_stretches(tau: NDArray[Any], mu: NDArray[Any], lam: NDArray[Any]) -> NDArray[np.float64]:
    """Principal stretches [P, 3] under tau_i = 2 mu eps_i + lam tr eps [P, 3]; see ``Law.stretches``."""
    trace = tau.sum(1) / (3 * lam + 2 * mu)
    eps = (tau - (lam * trace)[:, None]) / (2 * mu)[:, None]
    return np.exp(np.clip(eps, *np.log1p([float(_LOW), float(_HIGH)]) / 2))
