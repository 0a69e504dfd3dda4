"""Compressible Neo-Hookean solid, the default of elastic parts.

Energy per rest volume and Kirchhoff stress:

    Psi = mu/2 (tr b - 3) - mu ln J + lam/2 (ln J)^2
    tau = mu (b - I) + lam ln J I

| symbol  | meaning                                  | unit |
|---------|------------------------------------------|------|
| F       | deformation gradient                     | 1    |
| H       | F - I, displacement gradient             | 1    |
| b       | F F^T, left Cauchy-Green tensor          | 1    |
| J       | det F                                    | 1    |
| mu, lam | Lame parameters                          | Pa   |
| tau     | Kirchhoff stress, J times Cauchy stress  | Pa   |

The energy grows without bound as J -> 0, so the solid cannot turn inside out.

Source: J. Bonet, R. D. Wood, *Nonlinear Continuum Mechanics for Finite Element Analysis*, 2nd ed. 2008, eq. 6.27-6.29.
Paper: Sec. C.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.elastic_strain import of_gradient
from phys4dgen.mpm.laws.law import Law, LawId, register
from phys4dgen.vector.lanes import like, maximum
from phys4dgen.vector.math import inline, log1p
from phys4dgen.vector.matrix import volume_growth

__all__ = ["NEO_HOOKEAN", "energy_density_pa", "response", "stretches"]

_LEAST_SQUARE, _STEPS = 0.04, 30
_SMALLEST_J = np.float32(1e-6)  # keeps the logarithm finite in a simulation that is about to fail


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``. Parameters mu, lam; no state."""
    mu, lam = parameters
    e00, e01, e02, e11, e12, e22 = of_gradient(h)  # b - I
    growth = volume_growth(h)
    pressure = lam * log1p(maximum(growth, like(growth, _SMALLEST_J - np.float32(1))))
    return (mu * e00 + pressure, mu * e01, mu * e02, mu * e11 + pressure, mu * e12, mu * e22 + pressure), state


def energy_density_pa(
    F: NDArray[Any], parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3; see ``Law.energy_density_pa``."""
    mu, lam = parameters
    F = np.asarray(F, np.float64)
    log_j = np.log(np.maximum(np.linalg.det(F), float(_SMALLEST_J)))
    trace_b = np.einsum("pij,pij->p", F, F)
    return mu / 2 * (trace_b - 3) - mu * log_j + lam / 2 * log_j**2


def stretches(tau: NDArray[Any], mu: NDArray[Any], lam: NDArray[Any]) -> NDArray[np.float64]:
    """Principal stretches [P, 3] under principal stresses [P, 3]; see ``Law.stretches``.

    With L = ln J each is s_i^2 = 1 + (tau_i - lam L) / mu; Newton's method on sum ln s_i = L, from where all are real.
    """
    ratio = (lam / mu)[:, None]
    load = 1 + tau / mu[:, None]
    log_j = np.minimum(tau.sum(1) / (3 * lam + 2 * mu), (load.min(1) - _LEAST_SQUARE) / np.maximum(ratio[:, 0], 1e-12))
    for _ in range(_STEPS):
        squares = np.maximum(load - ratio * log_j[:, None], _LEAST_SQUARE)
        missing = np.log(squares).sum(1) / 2 - log_j
        log_j = log_j + missing / (1 + (ratio / squares).sum(1) / 2)
    return np.sqrt(np.maximum(load - ratio * log_j[:, None], _LEAST_SQUARE))


NEO_HOOKEAN = register(
    Law(
        LawId.NEO_HOOKEAN,
        ("lame_mu_pa", "lame_lambda_pa"),
        lambda material: (material["lame_mu_pa"], material["lame_lambda_pa"]),
        response,
        energy_density_pa,
        stretches=stretches,
    )
)
