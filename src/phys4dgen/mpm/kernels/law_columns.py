"""What a law's particles do with their own columns: carry the deformation gradient, read parameters, keep state.

How the gradient is carried and how many columns there are is known when a pass is compiled, so it costs nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.extending import overload

from phys4dgen.mpm.kernels.layout import DISPLACEMENT_GRADIENT, LAW_COLUMNS
from phys4dgen.mpm.laws.law import INLINE, Gradient, law_named, respond
from phys4dgen.vector.lanes import add_compensated
from phys4dgen.vector.math import inline
from phys4dgen.vector.matrix import matmul
from phys4dgen.vector.memory import load_columns32, store_columns

__all__ = ["advance_gradient", "stress"]

_f = np.float32


def advance_gradient(law: Any, particles: Any, batch: Any, stride: Any, h: Any, g: Any) -> Any:
    """Inside kernels: nine lanes of H after a substep with g = dt C, stored too.

    Args:
        law: whose particles they are; see ``Gradient``.
        particles: columns, flat.
        batch: first particle.
        stride: length of a column.
        h: H before the substep.
        g: dt C.
    """
    raise NotImplementedError("advance_gradient works inside compiled kernels only.")


@inline
def _step(h, g):
    """F <- (I + g) F: the increment g + g H of H."""
    p0, p1, p2, p3, p4, p5, p6, p7, p8 = matmul(g, h)
    g0, g1, g2, g3, g4, g5, g6, g7, g8 = g
    return g0 + p0, g1 + p1, g2 + p2, g3 + p3, g4 + p4, g5 + p5, g6 + p6, g7 + p7, g8 + p8


@inline
def _sum9(h, d):
    h0, h1, h2, h3, h4, h5, h6, h7, h8 = h
    d0, d1, d2, d3, d4, d5, d6, d7, d8 = d
    return h0 + d0, h1 + d1, h2 + d2, h3 + d3, h4 + d4, h5 + d5, h6 + d6, h7 + d7, h8 + d8


@inline
def _advance_total(particles, batch, stride, h, g):
    h = _sum9(h, _step(h, g))
    store_columns(particles, DISPLACEMENT_GRADIENT * stride + batch, stride, h)
    return h


@overload(advance_gradient, jit_options=INLINE)
def _advance_gradient(law, particles, batch, stride, h, g):
    if law_named(law.law_name).gradient is Gradient.TOTAL:
        return lambda law, particles, batch, stride, h, g: _advance_total(particles, batch, stride, h, g)
    rest_column = LAW_COLUMNS + len(law_named(law.law_name).parameters) + len(law_named(law.law_name).state)

    def advance_elastic(law, particles, batch, stride, h, g):
        rest_at = rest_column * stride + batch
        h0, h1, h2, h3, h4, h5, h6, h7, h8 = h
        r0, r1, r2, r3, r4, r5, r6, r7, r8 = load_columns32(particles, rest_at, stride, 9)
        d0, d1, d2, d3, d4, d5, d6, d7, d8 = _step(h, g)
        h0, r0 = add_compensated(h0, r0, d0)
        h1, r1 = add_compensated(h1, r1, d1)
        h2, r2 = add_compensated(h2, r2, d2)
        h3, r3 = add_compensated(h3, r3, d3)
        h4, r4 = add_compensated(h4, r4, d4)
        h5, r5 = add_compensated(h5, r5, d5)
        h6, r6 = add_compensated(h6, r6, d6)
        h7, r7 = add_compensated(h7, r7, d7)
        h8, r8 = add_compensated(h8, r8, d8)
        h = (h0, h1, h2, h3, h4, h5, h6, h7, h8)
        store_columns(particles, DISPLACEMENT_GRADIENT * stride + batch, stride, h)
        store_columns(particles, rest_at, stride, (r0, r1, r2, r3, r4, r5, r6, r7, r8))
        return h

    return advance_elastic


def stress(law: Any, particles: Any, batch: Any, stride: Any, h: Any, c: Any, dt: Any) -> Any:
    """Inside kernels: six lanes of Kirchhoff stress in Pa; advances the law's state by dt and stores it.

    Args:
        law: whose particles they are.
        particles: columns, flat.
        batch: first particle.
        stride: length of a column.
        h: nine lanes of H after the substep.
        c: nine lanes of velocity gradient, 1/s.
        dt: the substep, s; 0 where the state has been advanced already.
    """
    raise NotImplementedError("stress works inside compiled kernels only.")


@overload(stress, jit_options=INLINE)
def _stress(law, particles, batch, stride, h, c, dt):
    parameter_count = len(law_named(law.law_name).parameters)
    state_count = len(law_named(law.law_name).state)

    def call(law, particles, batch, stride, h, c, dt):
        at = LAW_COLUMNS * stride + batch
        parameters = load_columns32(particles, at, stride, parameter_count)
        state = load_columns32(particles, at + parameter_count * stride, stride, state_count)
        tau, state = respond(law, h, c, dt, parameters, state)
        store_columns(particles, at + parameter_count * stride, stride, state)
        return tau

    return call
