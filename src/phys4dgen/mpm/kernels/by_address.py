"""Calls of kernels through their addresses.

A kernel that calls another one is compiled together with it: the substep loop would be compiled anew for every set of
laws, and with it the large particle pass, once for each law and several times within each kernel on the way. Through
its address each kernel is compiled once, cached on disk, and shared by all scenes; what a scene does not use is not
compiled.
"""

from __future__ import annotations

from typing import Any

import numba.extending
from numba.core import cgutils, types

__all__ = ["FLOATS", "address_of", "caller_of"]

intrinsic: Any = numba.extending.intrinsic  # to a type checker, opaque: it changes the signature

FLOATS = types.Array(types.float32, 1, "C")


def address_of(kernel: Any, arguments: tuple[types.Type, ...]) -> int:
    """Address of a kernel for arguments of these types; compiled or taken from Numba's cache at the first call."""
    kernel.compile(types.none(*arguments))
    compiled = kernel.overloads[arguments]
    return compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)


def caller_of(arguments: tuple[types.Type, ...]) -> Any:
    """Make a function for use in kernels that takes an address (int64) and arguments and calls the kernel there.

    The kernel must have been compiled for just these types; numbers that are passed are converted to them. Arguments
    of opaque types carry no data and are left out.
    """
    passed = types.StarArgTuple(tuple(kind for kind in arguments if not isinstance(kind, types.Opaque)))

    @intrinsic
    def call(typing_context, address, *given):
        def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            function_type = context.call_conv.get_function_type(types.none, arguments)
            function = builder.inttoptr(args[0], function_type.as_pointer())
            nothing = context.get_dummy_value()
            rest = iter(cgutils.unpack_tuple(builder, args[1]))
            values = [nothing if isinstance(argument, types.Opaque) else next(rest) for argument in arguments]
            context.call_conv.call_function(builder, function, types.none, arguments, values)
            return nothing

        return types.none(types.int64, passed), emit

    return call
