"""Compressible Neo-Hookean solid, the default of elastic parts.

Energy per rest volume and Kirchhoff stress:

    Psi = mu/2 (tr b - 3) - mu ln J + lam/2 (ln J)^2
    tau = mu (b - I) + lam ln J I

| symbol  | meaning                                  | unit |
|---------|------------------------------------------|------|
| F       | deformation gradient                     | 1    |
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
from phys4dgen.vector.math import determinant, inline, left_cauchy_green, log

__all__ = ["NEO_HOOKEAN", "energy_density_pa", "response"]

_SMALLEST_J = np.float32(1e-6)  # keeps the logarithm finite in a simulation that is about to fail


@inline
def response(f, mu, lam):
    """(F, tau) for nine lanes of F; mu and lam in Pa."""
    b00, b01, b02, b11, b12, b22 = left_cauchy_green(f)
    j = determinant(f)
    pressure = lam * log(maximum(j, like(j, _SMALLEST_J))) - mu
    return f, (mu * b00 + pressure, mu * b01, mu * b02, mu * b11 + pressure, mu * b12, mu * b22 + pressure)


def energy_density_pa(F: NDArray[Any], mu: NDArray[np.float64], lam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3, of F [P, 3, 3]; mu, lam [P] in Pa."""
    F = np.asarray(F, np.float64)
    log_j = np.log(np.maximum(np.linalg.det(F), float(_SMALLEST_J)))
    trace_b = np.einsum("pij,pij->p", F, F)
    return mu / 2 * (trace_b - 3) - mu * log_j + lam / 2 * log_j**2


NEO_HOOKEAN = register(Law(LawId.NEO_HOOKEAN, response, energy_density_pa))
