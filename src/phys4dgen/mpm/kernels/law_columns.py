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


def advance_gradient(law: Any, particles: Any, batch: Any, stride: Any, h: Any, g: Any, is_last: Any) -> Any:
    """Inside kernels: nine lanes of H after a substep with g = dt C, stored too.

    Args:
        law: whose particles they are; see ``Gradient``.
        particles: columns, flat.
        batch: first particle.
        stride: length of a column.
        h: H before the substep.
        g: dt C.
        is_last: this is the last substep of a segment.
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


@inline
def _orthogonal(r):
    """One step of Newton's polar iteration, R <- R (3 - R^T R) / 2."""
    t0, t1, t2, t3, t4, t5, t6, t7, t8 = r
    s00 = _f(1.5) - _f(0.5) * (t0 * t0 + t3 * t3 + t6 * t6)
    s11 = _f(1.5) - _f(0.5) * (t1 * t1 + t4 * t4 + t7 * t7)
    s22 = _f(1.5) - _f(0.5) * (t2 * t2 + t5 * t5 + t8 * t8)
    s01 = _f(-0.5) * (t0 * t1 + t3 * t4 + t6 * t7)
    s02 = _f(-0.5) * (t0 * t2 + t3 * t5 + t6 * t8)
    s12 = _f(-0.5) * (t1 * t2 + t4 * t5 + t7 * t8)
    return matmul(r, (s00, s01, s02, s01, s11, s12, s02, s12, s22))


@inline
def _advance_rotation(particles, batch, stride, h, g, is_last):
    """The spin (g - g^T) / 2 turns R; at the end of a segment R is made a rotation again."""
    _, g01, g02, g10, _, g12, g20, g21, _ = g
    x, y, z = _f(0.5) * (g21 - g12), _f(0.5) * (g02 - g20), _f(0.5) * (g10 - g01)
    h0, h1, h2, h3, h4, h5, h6, h7, h8 = h
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = h0 + _f(1), h1, h2, h3, h4 + _f(1), h5, h6, h7, h8 + _f(1)
    h = _sum9(
        h,
        (
            y * r6 - z * r3, y * r7 - z * r4, y * r8 - z * r5,
            z * r0 - x * r6, z * r1 - x * r7, z * r2 - x * r8,
            x * r3 - y * r0, x * r4 - y * r1, x * r5 - y * r2,
        ),
    )  # fmt: skip
    if is_last:
        h0, h1, h2, h3, h4, h5, h6, h7, h8 = h
        r = _orthogonal((h0 + _f(1), h1, h2, h3, h4 + _f(1), h5, h6, h7, h8 + _f(1)))
        r0, r1, r2, r3, r4, r5, r6, r7, r8 = r
        h = (r0 - _f(1), r1, r2, r3, r4 - _f(1), r5, r6, r7, r8 - _f(1))
    store_columns(particles, DISPLACEMENT_GRADIENT * stride + batch, stride, h)
    return h


@overload(advance_gradient, jit_options=INLINE)
def _advance_gradient(law, particles, batch, stride, h, g, is_last):
    kind = law_named(law.law_name).gradient
    if kind is Gradient.TOTAL:
        return lambda law, particles, batch, stride, h, g, is_last: _advance_total(particles, batch, stride, h, g)
    if kind is Gradient.ROTATION:
        return lambda law, particles, batch, stride, h, g, is_last: _advance_rotation(
            particles, batch, stride, h, g, is_last
        )
    rest_column = LAW_COLUMNS + len(law_named(law.law_name).parameters) + len(law_named(law.law_name).state)

    def advance_elastic(law, particles, batch, stride, h, g, is_last):
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
