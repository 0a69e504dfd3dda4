"""Sand and soil: elastic grains that slide where friction is overcome, after Drucker and Prager, with cohesion.

Elastic response: StVK-Hencky (``stvk_hencky``) of the elastic strains. With eps = ln s + v/3 the strains as if the gap
v were closed, eps' = eps - e_c, tr = sum eps', eps_hat the deviator of eps and n its norm:

    tr > 0                                          torn: eps <- 0, v <- sum eps
    dg = n + alpha (3 lam + 2 mu)/(2 mu) tr <= 0    elastic, v <- 0
    else                                            slides: eps <- eps - dg eps_hat / n, v <- 0

    alpha = sqrt(2/3) 2 sin(phi) / (3 - sin(phi)),   e_c = c cot(phi) / (3 kappa) where v = 0, else 0

| symbol       | meaning                                                     | unit | material number    |
|--------------|-------------------------------------------------------------|------|--------------------|
| s_i, eps_i   | elastic stretches and Hencky strains                        | 1    |                    |
| mu, lam      | Lame parameters                                             | Pa   |                    |
| kappa        | bulk modulus lam + 2 mu / 3                                 | Pa   |                    |
| phi          | friction angle, of triaxial compression                     | deg  | friction_angle_deg |
| c            | cohesion                                                    | Pa   | cohesion_pa        |
| v            | volume correction: log-volume of the gap that has opened    | 1    |                    |

phi makes the principal stresses in triaxial compression those of Mohr-Coulomb, s1/s3 = (1 + sin phi)/(1 - sin phi); in
plane strain the same alpha is steeper. Sliding keeps the volume (no dilatancy). What has been torn open has lost its
cohesion, until it is pressed together again: damp sand crumbles instead of drawing threads.

The strains must contain v/3 before their deviator is taken; several public codes subtract it afterwards, which leaves a
deviator with a trace.

Sources: G. Klar et al., *Drucker-Prager elastoplasticity for sand animation*, SIGGRAPH 2016, sec. 7;
A. P. Tampubolon et al., *Multi-species simulation of porous sand and water mixtures*, SIGGRAPH 2017, sec. 4.3
(cohesion, volume correction).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.elastic_strain import (
    STRAIN_STATE,
    advanced,
    deviator,
    hencky,
    hencky_energy_pa,
    hencky_strains,
    opened,
    recomposed,
    settled,
    tau_of_hencky,
)
from phys4dgen.mpm.laws.law import Gradient, Law, LawId, register
from phys4dgen.vector.lanes import like, maximum, where
from phys4dgen.vector.math import inline

__all__ = ["DRUCKER_PRAGER", "energy_density_pa", "response"]

_f = np.float32


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``.

    Parameters mu, lam, slope alpha (3 lam + 2 mu) / (2 mu), 3 e_c; state E, its rest, the gap v.
    """
    mu, lam, slope, cohesion = parameters
    e, rest = advanced(state[0:12], c, dt)
    gap = state[12]
    trace, deviators, norm = deviator(opened(hencky(e), gap))
    zero, one = like(mu, _f(0)), like(mu, _f(1))
    was_open = gap > zero
    shifted = trace - where(was_open, zero, cohesion)
    torn = shifted > zero
    excess = norm + slope * shifted
    slides = excess > zero
    keep = where(torn, zero, where(slides, one - excess / maximum(norm, like(norm, _f(1e-20))), one))
    mean = where(torn, zero, trace * _f(1 / 3))
    eps = recomposed(mean, keep, deviators)
    kept = settled(torn | slides | was_open, eps, e, rest)
    return tau_of_hencky(eps, mu, lam), (*kept, where(torn, trace, zero))


def energy_density_pa(
    F: NDArray[Any], parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3; see ``Law.energy_density_pa``."""
    return hencky_energy_pa(hencky_strains(state), parameters[0], parameters[1])


def _prepare(material: Any) -> tuple[NDArray[np.float64], ...]:
    mu, lam = material["lame_mu_pa"], material["lame_lambda_pa"]
    phi = np.radians(material["friction_angle_deg"])
    alpha = np.sqrt(2 / 3) * 2 * np.sin(phi) / (3 - np.sin(phi))
    bulk = lam + 2 / 3 * mu
    return mu, lam, alpha * (3 * lam + 2 * mu) / (2 * mu), material["cohesion_pa"] / np.tan(phi) / bulk


DRUCKER_PRAGER = register(
    Law(
        LawId.DRUCKER_PRAGER,
        ("lame_mu_pa", "lame_lambda_pa", "slope", "cohesion_strain"),
        _prepare,
        response,
        energy_density_pa,
        state=(*STRAIN_STATE, "gap"),
        gradient=Gradient.TOTAL,
    )
)
