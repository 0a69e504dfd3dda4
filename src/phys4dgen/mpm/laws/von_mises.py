"""Plastic solid with the yield surface of von Mises (J2), linear hardening or softening, and breaking.

Elastic response: StVK-Hencky (``stvk_hencky``) of the elastic strains eps. Return map of a substep, with
eps_hat = eps - (sum eps)/3 the deviator:

    y  = 2 mu |eps_hat| - sqrt(2/3) sY(a),   sY(a) = max(sY0 + H a, sY_res)
    if y > 0:   eps <- eps - dg eps_hat / |eps_hat|,   a <- a + sqrt(2/3) dg,
                dg such that the new eps lies on the new surface: y / (2 mu + 2 H / 3) while sY moves with H

| symbol  | meaning                                                        | unit | material number          |
|---------|----------------------------------------------------------------|------|--------------------------|
| eps_i   | principal elastic Hencky strains                               | 1    |                          |
| mu, lam | Lame parameters                                                | Pa   |                          |
| sY0     | uniaxial yield stress: a pulled bar yields at exactly this     | Pa   | yield_stress_pa          |
| H       | hardening modulus d sY / d a, negative for softening           | Pa   | hardening_modulus_pa     |
| sY_res  | yield stress below which softening does not go                 | Pa   | residual_yield_stress_pa |
| a       | accumulated equivalent plastic strain                          | 1    |                          |

Breaking: where softening has brought sY to zero (so only with H < 0 and sY_res = 0) a particle is broken for good. It
then carries no shear and no tension; under compression it keeps its bulk modulus, once the gap that has opened is
closed again (``opening``, the log-volume of the gap).

With the factor sqrt(2/3) the number sY0 is that of a tensile test; codes that compare |dev tau| with sY yield 1.22
times later. Softening has no length scale: how far a crack spreads depends on the grid.

Sources: J. C. Simo, T. J. R. Hughes, *Computational Inelasticity*, 1998, box 3.1 (radial return, linear hardening);
G. Klar et al. 2016, sec. 6 (in Hencky strain).
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
    hencky_stretches,
    opened,
    recomposed,
    settled,
    tau_of_hencky,
)
from phys4dgen.mpm.laws.law import Gradient, Law, LawId, register
from phys4dgen.vector.lanes import like, maximum, minimum, where
from phys4dgen.vector.math import inline

__all__ = ["VON_MISES", "energy_density_pa", "response"]

_f = np.float32


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``.

    Parameters mu, lam, radius sqrt(2/3) sY0, its rise 2H/3 with the flow, its least value sqrt(2/3) sY_res; state E,
    its rest, the flow sum dg, the opening.
    """
    mu, lam, radius, rise, least = parameters
    e, rest = advanced(state[0:12], c, dt)
    flow, opening = state[12], state[13]
    trace, deviators, norm = deviator(opened(hencky(e), opening))
    zero = like(mu, _f(0))
    double_mu = mu + mu
    stress = double_mu * norm
    # the surface is the outer one of a moving and a fixed cylinder, so the flow is the smaller of the two
    step = minimum((stress - radius - rise * flow) / (double_mu + rise), (stress - least) / double_mu)
    flows = step > _f(0)
    step = maximum(step, zero)
    flow = flow + step
    broken = (radius + rise * flow <= least) & (least <= _f(0))
    torn = broken & (trace > _f(0))
    keep = where(torn, zero, _f(1) - step / maximum(norm, like(norm, _f(1e-20))))
    mean = where(torn, zero, trace * _f(1 / 3))
    was_open = opening > _f(0)
    opening = where(torn, trace, zero)
    eps = recomposed(mean, keep, deviators)
    kept = settled(flows | torn | was_open, eps, e, rest)
    return tau_of_hencky(eps, mu, lam), (*kept, flow, opening)


def energy_density_pa(
    F: NDArray[Any], parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3; see ``Law.energy_density_pa``."""
    return hencky_energy_pa(hencky_strains(state), parameters[0], parameters[1])


def _prepare(material: Any) -> tuple[NDArray[np.float64], ...]:
    factor = np.sqrt(2 / 3)
    return (
        material["lame_mu_pa"],
        material["lame_lambda_pa"],
        factor * material["yield_stress_pa"],
        2 / 3 * material["hardening_modulus_pa"],
        factor * material["residual_yield_stress_pa"],
    )


VON_MISES = register(
    Law(
        LawId.VON_MISES,
        ("lame_mu_pa", "lame_lambda_pa", "radius_pa", "rise_pa", "least_radius_pa"),
        _prepare,
        response,
        energy_density_pa,
        state=(*STRAIN_STATE, "flow", "opening"),
        gradient=Gradient.TOTAL,
        stretches=hencky_stretches,
    )
)
