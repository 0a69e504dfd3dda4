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

from phys4dgen.mpm.laws.elastic_strain import STRAIN_STATE, hencky_stretches
from phys4dgen.mpm.laws.law import Gradient, Law, LawId, register
from phys4dgen.mpm.laws.viscous_flow import energy_density_pa, relaxed, trial
from phys4dgen.vector.lanes import like, maximum, where
from phys4dgen.vector.math import inline

__all__ = ["VISCOPLASTIC", "response"]

_f = np.float32


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``. Parameters mu, lam, sqrt(2/3) sY, 2 eta; state E and its rest."""
    mu, lam, radius, resistance = parameters
    stress, compliance, before = trial(mu, c, dt, state)
    excess = stress - radius
    flows = excess > _f(0)
    tiny = like(mu, _f(1e-20))
    given_way = excess * compliance / maximum(compliance + resistance, tiny)  # nothing where dt = 0
    keep = where(flows, _f(1) - given_way / maximum(stress, tiny), like(mu, _f(1)))
    return relaxed(flows, keep, before, mu, lam)


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
        stretches=hencky_stretches,
    )
)
