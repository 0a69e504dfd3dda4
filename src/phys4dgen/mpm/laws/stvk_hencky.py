"""Elastic solid of Saint Venant-Kirchhoff type in Hencky strain, the base of the plastic laws.

Energy per rest volume and Kirchhoff stress, in the principal axes of b = F F^T:

    Psi   = mu sum eps_i^2 + lam/2 (sum eps_i)^2
    tau_i = 2 mu eps_i + lam sum eps_i

| symbol  | meaning                                          | unit |
|---------|--------------------------------------------------|------|
| F       | deformation gradient                             | 1    |
| H       | F - I, displacement gradient                     | 1    |
| s_i     | singular values of F                             | 1    |
| eps_i   | ln s_i, principal Hencky strains                 | 1    |
| mu, lam | Lame parameters                                  | Pa   |
| tau_i   | principal Kirchhoff stresses                     | Pa   |

The energy stays finite as s_i -> 0, so the solid softens in strong compression; stretches count as 0.05 to 20.

Source: G. Klar et al., *Drucker-Prager elastoplasticity for sand animation*, SIGGRAPH 2016, sec. 6.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.elastic_strain import (
    hencky,
    hencky_energy_pa,
    hencky_stretches,
    of_gradient,
    strains_of_gradient,
    tau_of_hencky,
)
from phys4dgen.mpm.laws.law import Law, LawId, register
from phys4dgen.vector.math import inline

__all__ = ["STVK_HENCKY", "energy_density_pa", "response"]


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``. Parameters mu, lam; no state."""
    mu, lam = parameters
    return tau_of_hencky(hencky(of_gradient(h)), mu, lam), state


def energy_density_pa(
    F: NDArray[Any], parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3; see ``Law.energy_density_pa``."""
    mu, lam = parameters
    return hencky_energy_pa(np.log1p(strains_of_gradient(F)) / 2, mu, lam)


STVK_HENCKY = register(
    Law(
        LawId.STVK_HENCKY,
        ("lame_mu_pa", "lame_lambda_pa"),
        lambda material: (material["lame_mu_pa"], material["lame_lambda_pa"]),
        response,
        energy_density_pa,
        stretches=hencky_stretches,
    )
)
