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

No singular value decomposition is needed: the law is isotropic, so tau shares the eigenvectors of b.

Source: A. Stomakhin et al., *Energetically consistent invertible elasticity*, SCA 2012, eq. 5-6. Paper: Sec. C.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phys4dgen.mpm.laws.law import Law, LawId, register
from phys4dgen.vector.lanes import like, maximum, sqrt
from phys4dgen.vector.math import inline
from phys4dgen.vector.matrix import identity_plus, left_cauchy_green, symmetric_eigen, symmetric_from_eigen

__all__ = ["FIXED_COROTATED", "energy_density_pa", "response"]

_SMALLEST_SQUARE = np.float32(1e-8)  # singular values below 1e-4 count as 1e-4
_SWEEPS = 4
_1 = np.float32(1)


@inline
def response(h, mu, lam):
    """(H, tau) for nine lanes of H = F - I; mu and lam in Pa."""
    values, axes = symmetric_eigen(left_cauchy_green(identity_plus(h)), _SWEEPS)
    least = like(mu, _SMALLEST_SQUARE)
    s0 = sqrt(maximum(values[0], least))
    s1 = sqrt(maximum(values[1], least))
    s2 = sqrt(maximum(values[2], least))
    j = s0 * s1 * s2
    volumetric = lam * j * (j - _1)
    double_mu = mu + mu
    principal = (
        double_mu * (s0 - _1) * s0 + volumetric,
        double_mu * (s1 - _1) * s1 + volumetric,
        double_mu * (s2 - _1) * s2 + volumetric,
    )
    return h, symmetric_from_eigen(principal, axes)


def energy_density_pa(F: NDArray[Any], mu: NDArray[np.float64], lam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stored energy per rest volume [P] in J/m3, of F [P, 3, 3]; mu, lam [P] in Pa."""
    F = np.asarray(F, np.float64)
    squares = np.linalg.eigvalsh(F @ np.swapaxes(F, -1, -2))
    s = np.sqrt(np.maximum(squares, float(_SMALLEST_SQUARE)))
    return mu * ((s - 1) ** 2).sum(-1) + lam / 2 * (s.prod(-1) - 1) ** 2


FIXED_COROTATED = register(Law(LawId.FIXED_COROTATED, response, energy_density_pa))
