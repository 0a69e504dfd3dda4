"""Weakly compressible viscous fluid: pressure from the volume ratio J alone, Newtonian viscosity.

    J   <- J (1 + dt tr C)
    p   =  K / gamma (J^-gamma - 1), gamma = 7
    tau = -J p I + J eta (C + C^T - 2/3 tr C I)

| symbol | meaning                                                    | unit | material number                       |
|--------|------------------------------------------------------------|------|---------------------------------------|
| J      | volume over rest volume                                    | 1    |                                       |
| p      | pressure (Tait's equation of state)                        | Pa   |                                       |
| K      | bulk modulus at rest                                       | Pa   | E / (3 (1 - 2 nu)), as of a solid     |
| eta    | dynamic viscosity                                          | Pa s | viscosity_pas                         |
| C      | velocity gradient                                          | 1/s  |                                       |
| tau    | Kirchhoff stress                                           | Pa   |                                       |

K is chosen for a speed of sound c0 = sqrt(K / rho) about ten times the fastest flow, so that density varies by a
percent; the true one (2.2 GPa in water) would only cost time steps. Fluid does not pull: where J would exceed 1 it is
set back to 1, with p = 0. J - 1 is kept, with compensated rounding, because pressure is in its last digits. There is no
surface tension. The shear modulus of the material is not used.

Sources: J. J. Monaghan, *Simulating free surface flows with SPH*, J. Comput. Phys. 110 (1994) 399-406 (equation of
state, choice of c0); X. Li et al., *PAC-NeRF*, ICLR 2023 (in MPM).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.law import Gradient, Law, LawId, register
from phys4dgen.vector.lanes import add_compensated, like, maximum, where
from phys4dgen.vector.math import expm1, inline, log1p

__all__ = ["FLUID", "energy_density_pa", "response"]

_GAMMA = 7
_LEAST = np.float32(-0.5)  # J counts as at least 0.5: a pressure of 18 K
_f = np.float32


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``. Parameters K / gamma and eta; state J - 1 and its rest."""
    stiffness, eta = parameters
    growth, rest = state
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = c
    rate = c00 + c11 + c22
    growth, rest = add_compensated(growth, rest, dt * rate * (_f(1) + growth))
    least, zero = like(growth, _LEAST), like(growth, _f(0))
    out_of_range = (growth > zero) | (growth < least)
    rest = where(out_of_range, zero, rest)
    growth = where(growth > zero, zero, maximum(growth, least))
    j = _f(1) + growth
    pressure = stiffness * expm1(_f(-_GAMMA) * log1p(growth))
    viscous = j * eta
    isotropic = -j * pressure - viscous * rate * _f(2 / 3)
    tau = (
        isotropic + viscous * (c00 + c00),
        viscous * (c01 + c10),
        viscous * (c02 + c20),
        isotropic + viscous * (c11 + c11),
        viscous * (c12 + c21),
        isotropic + viscous * (c22 + c22),
    )
    return tau, (growth, rest)


def energy_density_pa(
    F: NDArray[Any], parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3: -integral of p dJ; see ``Law.energy_density_pa``."""
    j = 1 + state[0] + state[1]
    return parameters[0] * ((j ** (1 - _GAMMA) - 1) / (_GAMMA - 1) + j - 1)


def _stiffening(parameters: NDArray[np.float64], state: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rho c^2 over K: J^-gamma (with the density rho / J) times J for the current density."""
    return (1 + state[0]) ** (1 - _GAMMA)


def _prepare(material: Any) -> tuple[NDArray[np.float64], ...]:
    bulk = material["lame_lambda_pa"] + 2 / 3 * material["lame_mu_pa"]
    return bulk / _GAMMA, material["viscosity_pas"]


FLUID = register(
    Law(
        LawId.FLUID,
        ("tait_pa", "viscosity_pas"),
        _prepare,
        response,
        energy_density_pa,
        state=("growth", "growth_rest"),
        gradient=Gradient.TOTAL,
        stiffening=_stiffening,
    )
)
