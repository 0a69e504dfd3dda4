"""What the laws that flow beyond a yield stress share (``viscoplastic``, ``herschel_bulkley``): all but the flow rule.

Elastic response: StVK-Hencky of the elastic strains eps. With eps_hat their deviator, the stress before the flow is
s = 2 mu |eps_hat|, beyond the yield surface by s - sqrt(2/3) sY. The compliance of a substep is 2 mu' dt with
mu' = mu tr b / 3. A flow rule says which share of s is left; the deviator shrinks by it and the volume stays.

Source: Y. Yue et al., *Continuum foam: a material point method for shear-dependent flows*, ACM TOG 34(5), 2015, sec. 4.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.elastic_strain import (
    advanced,
    deviator,
    hencky,
    hencky_energy_pa,
    hencky_strains,
    recomposed,
    settled,
    tau_of_hencky,
)
from phys4dgen.vector.math import inline

__all__ = ["energy_density_pa", "relaxed", "trial"]

_f = np.float32


@inline
def trial(mu, c, dt, state):
    """(stress, compliance, trial state) before the flow: lanes s and 2 mu' dt, and what ``relaxed`` needs."""
    e, rest = advanced(state, c, dt)
    trace, deviators, norm = deviator(hencky(e))
    # tr b = 3 + tr E
    compliance = _f(2 / 3) * mu * dt * (_f(3) + e[0] + e[3] + e[5])
    return (mu + mu) * norm, compliance, (e, rest, trace, deviators)


@inline
def relaxed(flows, keep, before, mu, lam):
    """(tau, state) after a flow that keeps a share of the deviator where ``flows``."""
    e, rest, trace, deviators = before
    eps = recomposed(trace * _f(1 / 3), keep, deviators)
    return tau_of_hencky(eps, mu, lam), settled(flows, eps, e, rest)


def energy_density_pa(
    F: NDArray[Any], parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3; see ``Law.energy_density_pa``."""
    return hencky_energy_pa(hencky_strains(state), parameters[0], parameters[1])
