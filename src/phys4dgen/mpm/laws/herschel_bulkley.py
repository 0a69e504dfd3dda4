"""Ketchup, cream, mud: beyond the yield stress a power-law fluid after Herschel and Bulkley.

As ``viscoplastic``, but the stress s' after the flow solves

    s - s' = 2 mu' dt ((s' - sqrt(2/3) sY) / R)^(1/n),   R = 2^((n + 1)/2) K

| symbol  | meaning                                                         | unit   | material number  |
|---------|-----------------------------------------------------------------|--------|------------------|
| sY      | uniaxial yield stress (in shear it yields at sY / sqrt 3)       | Pa     | yield_stress_pa  |
| K       | consistency                                                     | Pa s^n | consistency_pasn |
| n       | flow exponent; below 1 it thins with the shear rate             | 1      | flow_exponent    |
| mu'     | mu tr b / 3                                                     | Pa     |                  |

In steady shear the stress is sY / sqrt 3 + K rate^n, as rheometers give it; n = 1 is ``viscoplastic`` with eta = K,
only slower to compute.

With x = s' - sqrt(2/3) sY, y = s - sqrt(2/3) sY, m = 1/n and A = 2 mu' dt / R^m the equation is x + A x^m = y. Newton's
method on ln x for ln(x + A x^m) = ln y has a slope between 1 and m everywhere; from min(y, (y/A)^n), which is never
below the root nor above it by more than a factor of two in either term, four steps reach float32 accuracy.

Source: Y. Yue et al., *Continuum foam: a material point method for shear-dependent flows*, ACM TOG 34(5), 2015, sec. 4.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.elastic_strain import STRAIN_STATE, hencky_stretches
from phys4dgen.mpm.laws.law import Gradient, Law, LawId, register
from phys4dgen.mpm.laws.viscous_flow import energy_density_pa, relaxed, trial
from phys4dgen.vector.lanes import any_lane, like, maximum, minimum, where
from phys4dgen.vector.math import exp, inline, log

__all__ = ["HERSCHEL_BULKLEY", "response"]

_STEPS = 4
_f = np.float32


@inline
def _excess_after(excess, log_slope, m):
    """X of x + exp(log_slope) x^m = excess, for positive ``excess``."""
    log_excess = log(excess)
    u = minimum(log_excess, (log_excess - log_slope) / m)
    for _ in range(_STEPS):
        x, power = exp(u), exp(log_slope + m * u)
        total = x + power
        u = u - (log(total) - log_excess) * total / (x + m * power)
    return exp(u)


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``. Parameters mu, lam, sqrt(2/3) sY, ln R / n, 1/n; state E and its rest."""
    mu, lam, radius, log_resistance, m = parameters
    stress, compliance, before = trial(mu, c, dt, state)
    excess = stress - radius
    one, tiny = like(mu, _f(1)), like(mu, _f(1e-20))
    keep = one
    flows = (excess > _f(0)) & (like(mu, dt) > _f(0))
    if any_lane(flows):
        sane = where(flows, excess, one)
        after = _excess_after(sane, log(maximum(compliance, tiny)) - log_resistance, m)
        keep = where(flows, (radius + minimum(after, sane)) / maximum(stress, tiny), one)
    return relaxed(flows, keep, before, mu, lam)


def _prepare(material: Any) -> tuple[NDArray[np.float64], ...]:
    n = material["flow_exponent"]
    resistance = 2 ** ((n + 1) / 2) * material["consistency_pasn"]
    return (
        material["lame_mu_pa"],
        material["lame_lambda_pa"],
        np.sqrt(2 / 3) * material["yield_stress_pa"],
        np.log(resistance) / n,
        1 / n,
    )


HERSCHEL_BULKLEY = register(
    Law(
        LawId.HERSCHEL_BULKLEY,
        ("lame_mu_pa", "lame_lambda_pa", "radius_pa", "log_resistance", "inverse_exponent"),
        _prepare,
        response,
        energy_density_pa,
        state=STRAIN_STATE,
        gradient=Gradient.TOTAL,
        stretches=hencky_stretches,
    )
)
