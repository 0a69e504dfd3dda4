"""Snow: crushes beyond a critical compression and hardens, falls apart beyond a critical stretch and softens.

    s_i <- clamp(s_i, 1 - theta_c, 1 + theta_s)
    J_P <- J_P prod(s_i before / s_i after)
    tau  = h tau_fixed_corotated(s_i),   h = min(exp(xi (1 - J_P)), 10)

| symbol  | meaning                                                       | unit | material number       |
|---------|---------------------------------------------------------------|------|-----------------------|
| s_i     | elastic stretches                                             | 1    |                       |
| theta_c | critical compression                                          | 1    | critical_compression  |
| theta_s | critical stretch                                              | 1    | critical_stretch      |
| J_P     | plastic volume ratio, 0.6 to 20                               | 1    |                       |
| xi      | hardening coefficient                                         | 1    | hardening_coefficient |
| h       | by how much the Lame parameters have grown                    | 1    |                       |

h is limited because waves grow faster with its root, and with them the number of substeps.

Source: A. Stomakhin et al., *A material point method for snow simulation*, SIGGRAPH 2013, sec. 5 and table 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.elastic_strain import (
    STRAIN_STATE,
    advanced,
    hencky_strains,
    principal_strains,
    settled_principal,
)
from phys4dgen.mpm.laws.fixed_corotated import corotated_energy_pa, corotated_stress
from phys4dgen.mpm.laws.law import Gradient, Law, LawId, register
from phys4dgen.vector.lanes import any_lane, like, maximum, minimum, sqrt, where
from phys4dgen.vector.math import exp, inline

__all__ = ["SNOW", "energy_density_pa", "response"]

_HARDEST = 10.0
_LOW, _HIGH = np.float32(0.6 - 1), np.float32(20.0 - 1)  # of J_P - 1
_1 = np.float32(1)


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``.

    Parameters mu, lam, least and greatest E_i = s_i^2 - 1, xi; state E, its rest, J_P - 1.
    """
    mu, lam, least, greatest, xi = parameters
    e, rest = advanced(state[0:12], c, dt)
    plastic = state[12]
    (e0, e1, e2), axes = principal_strains(e)
    n0, n1, n2 = (
        minimum(maximum(e0, least), greatest),
        minimum(maximum(e1, least), greatest),
        minimum(maximum(e2, least), greatest),
    )
    yields = (e0 < least) | (e0 > greatest) | (e1 < least) | (e1 > greatest) | (e2 < least) | (e2 > greatest)
    if any_lane(yields):
        ratio = sqrt((_1 + e0) * (_1 + e1) * (_1 + e2) / ((_1 + n0) * (_1 + n1) * (_1 + n2)))
        grown = (_1 + plastic) * ratio - _1
        plastic = where(yields, minimum(maximum(grown, like(grown, _LOW)), like(grown, _HIGH)), plastic)
    hardness = minimum(exp(-xi * plastic), like(plastic, np.float32(_HARDEST)))
    tau = corotated_stress((n0, n1, n2), axes, hardness * mu, hardness * lam)
    return tau, (*settled_principal(yields, (n0, n1, n2), axes, e, rest), plastic)


def _hardness(parameters: NDArray[np.float64], state: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.minimum(np.exp(-parameters[4] * state[12]), _HARDEST)


def energy_density_pa(
    F: NDArray[Any], parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3; see ``Law.energy_density_pa``."""
    strains = np.expm1(2 * hencky_strains(state))
    return _hardness(parameters, state) * corotated_energy_pa(strains, parameters[0], parameters[1])


def _prepare(material: Any) -> tuple[NDArray[np.float64], ...]:
    return (
        material["lame_mu_pa"],
        material["lame_lambda_pa"],
        (1 - material["critical_compression"]) ** 2 - 1,
        (1 + material["critical_stretch"]) ** 2 - 1,
        material["hardening_coefficient"],
    )


SNOW = register(
    Law(
        LawId.SNOW,
        ("lame_mu_pa", "lame_lambda_pa", "least_strain", "greatest_strain", "hardening_coefficient"),
        _prepare,
        response,
        energy_density_pa,
        state=(*STRAIN_STATE, "plastic_growth"),
        gradient=Gradient.TOTAL,
        stiffening=lambda parameters, state: np.maximum(_hardness(parameters, state), 1.0),
    )
)
