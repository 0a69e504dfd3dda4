"""What a law does with a batch of its particles: carry the deformation gradient, advance its state, give the stress.

This is all of the particle pass that differs between laws, so a scene compiles it once for each of its laws and the
rest of the pass once for all. How the gradient is carried and how many columns there are is known when it is compiled.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.core import types
from numba.extending import overload

from phys4dgen.mpm.kernels.by_address import FLOATS, address_of, caller_of
from phys4dgen.mpm.kernels.layout import DISPLACEMENT_GRADIENT, LANES, LAW_COLUMNS, inner_kernel
from phys4dgen.mpm.laws.law import INLINE, Gradient, Law, LawType, law_named
from phys4dgen.vector.lanes import add_compensated
from phys4dgen.vector.math import inline
from phys4dgen.vector.matrix import matmul
from phys4dgen.vector.memory import load_columns32, store_columns

__all__ = ["STRESS", "VELOCITY_GRADIENT", "address_of_law", "advance_law", "call_law"]

_f = np.float32

VELOCITY_GRADIENT = 0  # 9 rows of LANES numbers
STRESS = 9 * LANES  # 6 rows


@inline
def _step(h, c, dt):
    """F <- (I + dt C) F: the increment g + g H of H, g = dt C."""
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = c
    g0, g1, g2, g3, g4, g5, g6, g7, g8 = dt * c0, dt * c1, dt * c2, dt * c3, dt * c4, dt * c5, dt * c6, dt * c7, dt * c8
    p0, p1, p2, p3, p4, p5, p6, p7, p8 = matmul((g0, g1, g2, g3, g4, g5, g6, g7, g8), h)
    return g0 + p0, g1 + p1, g2 + p2, g3 + p3, g4 + p4, g5 + p5, g6 + p6, g7 + p7, g8 + p8


@inline
def _advance_total(particles, at, rest_at, stride, h, c, dt):
    """H after a substep, stored too; see ``Gradient.TOTAL``."""
    h0, h1, h2, h3, h4, h5, h6, h7, h8 = h
    d0, d1, d2, d3, d4, d5, d6, d7, d8 = _step(h, c, dt)
    h = h0 + d0, h1 + d1, h2 + d2, h3 + d3, h4 + d4, h5 + d5, h6 + d6, h7 + d7, h8 + d8
    store_columns(particles, at, stride, h)
    return h


@inline
def _advance_elastic(particles, at, rest_at, stride, h, c, dt):
    """H after a substep, stored too with what rounding took from it; see ``Gradient.ELASTIC``."""
    h0, h1, h2, h3, h4, h5, h6, h7, h8 = h
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = load_columns32(particles, rest_at, stride, 9)
    d0, d1, d2, d3, d4, d5, d6, d7, d8 = _step(h, c, dt)
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
    store_columns(particles, at, stride, h)
    store_columns(particles, rest_at, stride, (r0, r1, r2, r3, r4, r5, r6, r7, r8))
    return h


def advance_law(law: Any, particles: Any, batch: Any, stride: Any, rows: Any, dt: Any) -> Any:
    """Inside kernels: advance LANES particles of one law and write their Kirchhoff stress.

    Args:
        law: whose particles they are.
        particles: columns of ``layout``, flat.
        batch: first particle.
        stride: length of a column.
        rows: nine rows of velocity gradient from ``VELOCITY_GRADIENT`` on, 1/s; result, six of stress in Pa from
            ``STRESS`` on; float32 [15 LANES] or longer.
        dt: the substep, s; 0 where all has been advanced already and only the stress is asked for.
    """
    raise NotImplementedError("advance_law works inside compiled kernels only.")


@overload(advance_law, jit_options=INLINE)
def _advance_law(law, particles, batch, stride, rows, dt):
    definition = law_named(law.law_name)
    response = definition.response
    advance = _advance_elastic if definition.gradient is Gradient.ELASTIC else _advance_total
    parameter_count, state_count = len(definition.parameters), len(definition.state)
    state_column = LAW_COLUMNS + parameter_count
    rest_column = state_column + state_count

    def advance_one(law, particles, batch, stride, rows, dt):
        c = load_columns32(rows, VELOCITY_GRADIENT, LANES, 9)
        at = DISPLACEMENT_GRADIENT * stride + batch
        h = load_columns32(particles, at, stride, 9)
        if dt > 0:
            h = advance(particles, at, rest_column * stride + batch, stride, h, c, dt)
        state_at = state_column * stride + batch
        parameters = load_columns32(particles, LAW_COLUMNS * stride + batch, stride, parameter_count)
        state = load_columns32(particles, state_at, stride, state_count)
        tau, state = response(h, c, dt, parameters, state)
        store_columns(particles, state_at, stride, state)
        store_columns(rows, STRESS, LANES, tau)

    return advance_one


@inner_kernel
def _law_step(law, particles, batch, stride, rows, dt):
    """``advance_law`` as a kernel."""
    advance_law(law, particles, batch, stride, rows, dt)


_ARGUMENTS = (FLOATS, types.int64, types.int64, FLOATS, types.float32)  # of ``advance_law`` after the law

call_law = caller_of((LawType("any"), *_ARGUMENTS))
"""Inside kernels: ``advance_law`` of the law at an address, with the arguments after the law."""


def address_of_law(law: Law) -> int:
    """Address of ``advance_law`` for a law; compiled or taken from Numba's cache at the first call."""
    return address_of(_law_step, (LawType(law.name), *_ARGUMENTS))
