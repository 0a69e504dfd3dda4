"""Kelvin-Voigt damping: a viscous stress beside that of a solid.

    tau <- tau + J 2 eta_d D,   D = (C + C^T) / 2,   eta_d = E t_d

| symbol | meaning                                              | unit | material number |
|--------|------------------------------------------------------|------|-----------------|
| C      | velocity gradient                                    | 1/s  |                 |
| D      | rate of strain                                       | 1/s  |                 |
| J      | det F                                                | 1    |                 |
| eta_d  | viscosity                                            | Pa s |                 |
| E      | Young's modulus                                      | Pa   |                 |
| t_d    | relaxation time                                      | s    | damping_time_s  |

Shear waves of frequency f are damped with the ratio pi f eta_d / mu = 2 pi (1 + nu) f t_d: the fast ones most. The time
step must stay below rho dx^2 / (6 eta_d), so sway at 1 Hz is better damped in proportion to mass.

A damped law is another law to the kernels, compiled only where it is used; undamped particles pay nothing for it.

Source: M. E. Gurtin, E. Fried, L. Anand, *The Mechanics and Thermodynamics of Continua*, 2010, ch. 85.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from phys4dgen.mpm.laws.law import Law, register
from phys4dgen.vector.math import inline
from phys4dgen.vector.matrix import determinant, identity_plus

__all__ = ["damped"]

_half = np.float32(0.5)


@cache
def damped(law: Law) -> Law:
    """The law of a solid with Kelvin-Voigt viscosity, its last parameter."""
    undamped = law.response
    prepare = law.prepare
    count = len(law.parameters)

    @inline
    def response(h, c, dt, parameters, state):
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = c
        (t00, t01, t02, t11, t12, t22), state = undamped(h, c, dt, parameters[0:count], state)
        twice = parameters[count] * determinant(identity_plus(h))
        twice = twice + twice
        once = _half * twice
        tau = (
            t00 + twice * c00,
            t01 + once * (c01 + c10),
            t02 + once * (c02 + c20),
            t11 + twice * c11,
            t12 + once * (c12 + c21),
            t22 + twice * c22,
        )
        return tau, state

    return register(
        replace(
            law,
            parameters=(*law.parameters, "viscosity_pas"),
            prepare=lambda material: (
                *prepare(material),
                material["youngs_modulus_pa"] * material["damping_time_s"],
            ),
            response=response,
            damped=True,
        )
    )
