"""Foam, dough, paste: an elastic solid that flows like a Bingham fluid beyond its yield stress.

Elastic response: StVK-Hencky (``stvk_hencky``) of the elastic strains eps. With eps_hat the deviator of eps, its stress
s = 2 mu |eps_hat| before the flow and b the elastic left Cauchy-Green tensor:

    y = s - sqrt(2/3) sY
    if y > 0:   s' = s - y / (1 + 2 eta / (2 mu' dt)),   mu' = mu tr b / 3,   eps <- tr/3 + eps_hat s'/s

| symbol  | meaning                                                         | unit | material number |
|---------|-----------------------------------------------------------------|------|-----------------|
| mu, lam | Lame parameters                                                 | Pa   |                 |
| sY      | uniaxial yield stress (in shear it yields at sY / sqrt 3)       | Pa   | yield_stress_pa |
| eta     | plastic viscosity, of d shear stress / d shear rate             | Pa s | viscosity_pas   |
| dt      | substep                                                         | s    |                 |

In steady flow |dev tau| = sqrt(2/3) sY + 2 eta |D|, D the rate of strain: shear stress = sY / sqrt 3 + eta times the
shear rate, the law of Bingham with the viscosity as rheometers give it (the source's eta is twice that). eta -> 0 is
von Mises plasticity, eta -> infinity an elastic solid. The flow is integrated implicitly and does not limit the time
step.

Source: Y. Yue et al., *Continuum foam: a material point method for shear-dependent flows*, ACM TOG 34(5), 2015, sec. 4.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.elastic_strain import (
    STRAIN_STATE,
    advanced,
    deviator,
    hencky_energy_pa,
    hencky_strains,
    principal_hencky,
    settled,
    tau_of_hencky,
)
from phys4dgen.mpm.laws.law import Gradient, Law, LawId, register
from phys4dgen.vector.lanes import like, maximum, where
from phys4dgen.vector.math import inline

__all__ = ["VISCOPLASTIC", "energy_density_pa", "response"]

_f = np.float32


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``. Parameters mu, lam, sqrt(2/3) sY, 2 eta; state E and its rest."""
    mu, lam, radius, resistance = parameters
    e, rest = advanced(state, c, dt)
    eps, axes = principal_hencky(e)
    trace, (d0, d1, d2), norm = deviator(eps)
    stress = (mu + mu) * norm
    excess = stress - radius
    flows = excess > _f(0)
    # 2 mu' dt with tr b = 3 + tr E; where dt = 0 nothing flows
    compliance = _f(2 / 3) * mu * dt * (_f(3) + e[0] + e[3] + e[5])
    tiny = like(mu, _f(1e-20))
    relaxed = excess * compliance / maximum(compliance + resistance, tiny)
    keep = where(flows, _f(1) - relaxed / maximum(stress, tiny), like(mu, _f(1)))
    mean = trace * _f(1 / 3)
    eps = (mean + keep * d0, mean + keep * d1, mean + keep * d2)
    return tau_of_hencky(eps, axes, mu, lam), settled(flows, eps, axes, e, rest)


def energy_density_pa(
    F: NDArray[Any], parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3; see ``Law.energy_density_pa``."""
    return hencky_energy_pa(hencky_strains(state), parameters[0], parameters[1])


def _prepare(material: Any) -> tuple[NDArray[np.float64], ...]:
    return (
        material["lame_mu_pa"],
        material["lame_lambda_pa"],
        np.sqrt(2 / 3) * material["yield_stress_pa"],
        2 * material["viscosity_pas"],
    )


VISCOPLASTIC = register(
    Law(
        LawId.VISCOPLASTIC,
        ("lame_mu_pa", "lame_lambda_pa", "radius_pa", "flow_resistance_pas"),
        _prepare,
        response,
        energy_density_pa,
        state=STRAIN_STATE,
        gradient=Gradient.TOTAL,
    )
)
