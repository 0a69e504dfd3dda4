"""Calls of the particle pass of each law through its address.

A kernel that calls another one is compiled together with it: the substep loop would be compiled anew for every set of
laws, and the large particle pass several times within it. Through an address each law's pass is compiled once, cached
on disk, and shared by all scenes.
"""

from __future__ import annotations

from typing import Any

import numba.extending
from numba.core import types

from phys4dgen.mpm.kernels.particle_pass import particle_pass
from phys4dgen.mpm.laws.law import Law, LawType

__all__ = ["address_of_pass", "call_pass"]

intrinsic: Any = numba.extending.intrinsic  # to a type checker, opaque: it changes the signature

_FLOATS = types.Array(types.float32, 1, "C")
_ARGUMENTS = (
    types.int64,  # stage
    types.int64,  # first
    types.int64,  # last
    _FLOATS,  # particles
    types.int64,  # stride
    _FLOATS,  # velocity
    _FLOATS,  # momentum
    types.UniTuple(types.int64, 5),  # grid
    types.Array(types.int32, 1, "C"),  # bounds
    types.float32,  # inverse_dx
    types.float32,  # dt
    types.Array(types.float32, 2, "C"),  # kicks
)


def address_of_pass(law: Law) -> int:
    """Address of ``particle_pass`` for a law; compiled or taken from Numba's cache at the first call."""
    signature = types.none(LawType(law.name), *_ARGUMENTS)
    particle_pass.compile(signature)
    compiled = particle_pass.overloads[signature.args]
    return compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)


@intrinsic
def call_pass(
    typing_context,
    address,
    stage,
    first,
    last,
    particles,
    stride,
    velocity,
    momentum,
    grid,
    bounds,
    inverse_dx,
    dt,
    kicks,
):
    """Call ``particle_pass`` of the law whose pass lies at ``address`` (int64), with the other arguments of it."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        law = LawType("any")  # laws carry no data: all look the same to the processor
        argument_types = (law, *_ARGUMENTS)
        function_type = context.call_conv.get_function_type(types.none, argument_types)
        function = builder.inttoptr(args[0], function_type.as_pointer())
        values = [context.get_dummy_value(), *args[1:]]
        context.call_conv.call_function(builder, function, types.none, argument_types, values)
        return context.get_dummy_value()

    return types.none(types.int64, *_ARGUMENTS), emit
