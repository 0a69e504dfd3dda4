"""What a law does with a batch of its particles: carry the deformation gradient, advance its state, give the stress.

This is all of the particle pass that differs between laws, so a scene compiles it once for each of its laws and the
rest of the pass once for all. How the gradient is carried and how many columns there are is known when it is compiled.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.core import types
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr

from phys4dgen.mpm.kernels.by_address import FLOATS, address_of, caller_of
from phys4dgen.mpm.kernels.layout import AHEAD, DISPLACEMENT_GRADIENT, LANES, LAW_COLUMNS, inner_kernel
from phys4dgen.mpm.laws.law import Gradient, Law, LawType, law_named
from phys4dgen.vector.lanes import add_compensated
from phys4dgen.vector.math import inline
from phys4dgen.vector.matrix import matmul
from phys4dgen.vector.memory import load_columns, prefetch_columns, store_columns

__all__ = ["STRESS", "VELOCITY_GRADIENT", "address_of_law", "call_law", "law_step"]

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
def _advance_total(particles, batch, rest_at, stride, h, c, dt):
    """H after a substep, stored too; see ``Gradient.TOTAL``."""
    h0, h1, h2, h3, h4, h5, h6, h7, h8 = h
    d0, d1, d2, d3, d4, d5, d6, d7, d8 = _step(h, c, dt)
    h = h0 + d0, h1 + d1, h2 + d2, h3 + d3, h4 + d4, h5 + d5, h6 + d6, h7 + d7, h8 + d8
    store_columns(particles, DISPLACEMENT_GRADIENT * stride + batch, stride, h)
    return h


@inline
def _advance_elastic(particles, batch, rest_at, stride, h, c, dt):
    """H after a substep, stored too with what rounding took from it; see ``Gradient.ELASTIC``."""
    h0, h1, h2, h3, h4, h5, h6, h7, h8 = h
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = load_columns(particles, rest_at, stride, 9)
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
    store_columns(particles, DISPLACEMENT_GRADIENT * stride + batch, stride, h)
    store_columns(particles, rest_at, stride, (r0, r1, r2, r3, r4, r5, r6, r7, r8))
    return h


@infer_getattr
class _LawAttributes(AttributeTemplate):
    """What kernels can ask of a law; all is known when they are compiled, so it costs nothing."""

    key = LawType

    def resolve_parameter_count(self, law: LawType) -> types.Type:
        return types.literal(len(law_named(law.law_name).parameters))

    def resolve_state_count(self, law: LawType) -> types.Type:
        return types.literal(len(law_named(law.law_name).state))

    def resolve_column_count(self, law: LawType) -> types.Type:
        return types.literal(law_named(law.law_name).column_count)

    def resolve_advanced_gradient(self, law: LawType) -> types.Type:
        is_elastic = law_named(law.law_name).gradient is Gradient.ELASTIC
        return types.Dispatcher(_advance_elastic if is_elastic else _advance_total)

    def resolve_response(self, law: LawType) -> types.Type:
        return types.Dispatcher(law_named(law.law_name).response)


@lower_getattr_generic(LawType)
def _law_attribute(context: Any, builder: Any, law: LawType, value: Any, name: str) -> Any:
    kind = context.typing_context.resolve_getattr(law, name)
    if isinstance(kind, types.IntegerLiteral):
        return context.get_constant(types.intp, kind.literal_value)
    return context.get_dummy_value()  # the type of a function says all


@inner_kernel
def law_step(law, particles, batch, stride, rows, dt):
    """Advance LANES particles of one law and write their Kirchhoff stress.

    Args:
        law: whose particles they are; the kernel is compiled for it.
        particles: columns of ``layout``, flat, float32.
        batch: first particle.
        stride: length of a column.
        rows: nine rows of velocity gradient from ``VELOCITY_GRADIENT`` on, 1/s; result, six of stress in Pa from
            ``STRESS`` on; float32 [15 LANES] or longer.
        dt: the substep, s; 0 where all has been advanced already and only the stress is asked for.
    """
    prefetch_columns(particles, LAW_COLUMNS * stride + batch + AHEAD, stride, law.column_count)
    state_at = (LAW_COLUMNS + law.parameter_count) * stride + batch
    c = load_columns(rows, VELOCITY_GRADIENT, LANES, 9)
    h = load_columns(particles, DISPLACEMENT_GRADIENT * stride + batch, stride, 9)
    if dt > 0:
        h = law.advanced_gradient(particles, batch, state_at + law.state_count * stride, stride, h, c, dt)
    parameters = load_columns(particles, LAW_COLUMNS * stride + batch, stride, law.parameter_count)
    state = load_columns(particles, state_at, stride, law.state_count)
    tau, state = law.response(h, c, dt, parameters, state)
    store_columns(particles, state_at, stride, state)
    store_columns(rows, STRESS, LANES, tau)


_ARGUMENTS = (FLOATS, types.int64, types.int64, FLOATS, types.float32)  # of ``law_step`` after the law

call_law = caller_of((LawType("any"), *_ARGUMENTS))
"""Inside kernels: ``law_step`` of the law at an address, with the arguments after the law."""


def address_of_law(law: Law) -> int:
    """Address of ``law_step`` for a law; compiled or taken from Numba's cache at the first call."""
    return address_of(law_step, (LawType(law.name), *_ARGUMENTS))
