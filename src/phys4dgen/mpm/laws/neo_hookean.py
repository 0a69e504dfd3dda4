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

from phys4dgen.mpm.laws.law import Law, LawId, register
from phys4dgen.vector.lanes import like, maximum
from phys4dgen.vector.math import inline, log
from phys4dgen.vector.matrix import determinant, identity_plus, left_cauchy_green

__all__ = ["NEO_HOOKEAN", "energy_density_pa", "response"]

_SMALLEST_J = np.float32(1e-6)  # keeps the logarithm finite in a simulation that is about to fail


@inline
def response(h, mu, lam):
    """(H, tau) for nine lanes of H = F - I; mu and lam in Pa."""
    h00, h01, h02, h10, h11, h12, h20, h21, h22 = h
    q00, q01, q02, q11, q12, q22 = left_cauchy_green(h)  # b - I = H + H^T + H H^T
    j = determinant(identity_plus(h))
    pressure = lam * log(maximum(j, like(j, _SMALLEST_J)))
    tau = (
        mu * (h00 + h00 + q00) + pressure,
        mu * (h01 + h10 + q01),
        mu * (h02 + h20 + q02),
        mu * (h11 + h11 + q11) + pressure,
        mu * (h12 + h21 + q12),
        mu * (h22 + h22 + q22) + pressure,
    )
    return h, tau


def energy_density_pa(F: NDArray[Any], mu: NDArray[np.float64], lam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3, of F [P, 3, 3]; mu, lam [P] in Pa."""
    F = np.asarray(F, np.float64)
    log_j = np.log(np.maximum(np.linalg.det(F), float(_SMALLEST_J)))
    trace_b = np.einsum("pij,pij->p", F, F)
    return mu / 2 * (trace_b - 3) - mu * log_j + lam / 2 * log_j**2


NEO_HOOKEAN = register(Law(LawId.NEO_HOOKEAN, response, energy_density_pa))
