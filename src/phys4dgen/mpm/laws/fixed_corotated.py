"""Fixed corotated solid, the elastic law of PhysGaussian's "jelly" and of Taichi's MPM examples.

Energy per rest volume and Kirchhoff stress, in the principal axes of b = F F^T:

    Psi   = mu sum (s_i - 1)^2 + lam/2 (J - 1)^2
    tau_i = 2 mu (s_i - 1) s_i + lam J (J - 1)

| symbol  | meaning                                             | unit |
|---------|-----------------------------------------------------|------|
| F       | deformation gradient                                | 1    |
| H       | F - I, displacement gradient                        | 1    |
| s_i     | singular values of F (square roots of those of b)   | 1    |
| J       | det F                                               | 1    |
| mu, lam | Lame parameters                                     | Pa   |
| tau_i   | principal Kirchhoff stresses                        | Pa   |

No singular value decomposition is needed: the law is isotropic, so tau shares the eigenvectors of b, and with the left
stretch V = sqrt(b)

    tau = 2 mu (b - V) + lam J (J - 1) I,   J = sqrt(det b).

Where b - I is small in all particles of a batch, V comes from a rational function of b (``root1p_near_zero``), else
from eigenvectors; stretches then count as 0.05 to 20.

Source: A. Stomakhin et al., *Energetically consistent invertible elasticity*, SCA 2012, eq. 5-6. Paper: Sec. C.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.elastic_strain import NEAR_ZERO, of_gradient, principal_strains, strains_of_gradient
from phys4dgen.mpm.laws.law import Law, LawId, register
from phys4dgen.vector.lanes import any_lane, like, sqrt
from phys4dgen.vector.math import inline
from phys4dgen.vector.matrix import symmetric_from_eigen
from phys4dgen.vector.matrix_functions import powers, root1p_near_zero, squared_norm

__all__ = ["FIXED_COROTATED", "corotated_energy_pa", "corotated_stress", "energy_density_pa", "response", "stretches"]

_1 = np.float32(1)
_LEAST_J, _GREATEST_J, _HALVINGS = 0.5, 8.0, 40


@inline
def corotated_stress(strains, axes, mu, lam):
    """Kirchhoff stress, six lanes, of the principal values E_i of b - I and their axes, nine lanes."""
    e0, e1, e2 = strains
    s0, s1, s2 = sqrt(_1 + e0), sqrt(_1 + e1), sqrt(_1 + e2)
    d0, d1, d2 = e0 / (_1 + s0), e1 / (_1 + s1), e2 / (_1 + s2)  # s_i - 1 with all its digits
    growth = d0 + d1 + d2 + d0 * d1 + d0 * d2 + d1 * d2 + d0 * d1 * d2  # J - 1
    volumetric = lam * (_1 + growth) * growth
    double_mu = mu + mu
    principal = (
        double_mu * d0 * s0 + volumetric,
        double_mu * d1 * s1 + volumetric,
        double_mu * d2 * s2 + volumetric,
    )
    return symmetric_from_eigen(principal, axes)


@inline
def response(h, c, dt, parameters, state):
    """(tau, state); see ``Law.response``. Parameters mu, lam; no state."""
    mu, lam = parameters
    e = of_gradient(h)
    if any_lane(squared_norm(e) > like(e[0], NEAR_ZERO * NEAR_ZERO)):
        strains, axes = principal_strains(e)
        tau = corotated_stress(strains, axes, mu, lam)
    else:
        squared, invariants = powers(e)
        first, second, third = invariants
        grown = first + second + third  # det b - 1
        growth = grown / (_1 + sqrt(_1 + grown))  # J - 1
        volumetric = lam * (_1 + growth) * growth
        x, xy, xz, y, yz, z = e
        dx, dxy, dxz, dy, dyz, dz = root1p_near_zero(e, squared, invariants)  # V - I
        m = mu + mu
        tau = (
            m * (x - dx) + volumetric,
            m * (xy - dxy),
            m * (xz - dxz),
            m * (y - dy) + volumetric,
            m * (yz - dyz),
            m * (z - dz) + volumetric,
        )
    return tau, state


def corotated_energy_pa(strains: NDArray[Any], mu: NDArray[Any], lam: NDArray[Any]) -> NDArray[np.float64]:
    """Psi of the principal values of b - I, [P, 3], J/m3, [P]."""
    s = np.sqrt(1 + strains)
    return mu * ((s - 1) ** 2).sum(-1) + lam / 2 * (s.prod(-1) - 1) ** 2


def energy_density_pa(
    F: NDArray[Any], parameters: NDArray[np.float64], state: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3; see ``Law.energy_density_pa``."""
    mu, lam = parameters
    return corotated_energy_pa(strains_of_gradient(F), mu, lam)


def stretches(tau: NDArray[Any], mu: NDArray[Any], lam: NDArray[Any]) -> NDArray[np.float64]:
    """Principal stretches [P, 3] under principal stresses [P, 3]; see ``Law.stretches``.

    With q = lam J (J - 1) each is the larger root of 2 mu s (s - 1) = tau_i - q, and prod s_i - J falls with J: halved
    40 times. Below a stress of -mu / 2 there is no root, for the law gives way; s = 1/2 comes nearest.
    """
    low, high = np.full(len(tau), _LEAST_J), np.full(len(tau), _GREATEST_J)
    found = np.ones_like(tau)
    for _ in range(_HALVINGS):
        j = (low + high) / 2
        found = (1 + np.sqrt(np.maximum(1 + 2 * (tau - (lam * j * (j - 1))[:, None]) / mu[:, None], 0))) / 2
        too_low = found.prod(1) > j
        low, high = np.where(too_low, j, low), np.where(too_low, high, j)
    return found


FIXED_COROTATED = register(
    Law(
        LawId.FIXED_COROTATED,
        ("lame_mu_pa", "lame_lambda_pa"),
        lambda material: (material["lame_mu_pa"], material["lame_lambda_pa"]),
        response,
        energy_density_pa,
        stretches=stretches,
    )
)
