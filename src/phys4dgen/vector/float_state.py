"""Flush-to-zero: denormal numbers, which slow x86 arithmetic several times, count as zero inside kernels.

On x86 the mode lives in the MXCSR register of each thread, so a kernel sets it where its thread works and restores
it before it returns. On other processors both functions do nothing: their vector units have no such penalty.
"""

from __future__ import annotations

import platform
from typing import Any

import numba.extending
from llvmlite import ir
from numba.core import cgutils, types

__all__ = ["begin_flush_to_zero", "restore_float_state"]

intrinsic: Any = numba.extending.intrinsic  # to a type checker, opaque: it changes the signature

_IS_X86 = platform.machine().lower() in ("x86_64", "amd64", "i386", "i686")
_FLUSH_TO_ZERO = 0x9FC0  # default rounding and masks, plus flush-to-zero and denormals-are-zero
_I32 = ir.IntType(32)


def _mxcsr_call(builder: Any, name: str, pointer: Any) -> None:
    byte_pointer = ir.IntType(8).as_pointer()
    function_type = ir.FunctionType(ir.VoidType(), [byte_pointer])
    function = cgutils.get_or_insert_function(builder.module, function_type, f"llvm.x86.sse.{name}")
    builder.call(function, [builder.bitcast(pointer, byte_pointer)])


@intrinsic
def begin_flush_to_zero(typing_context):
    """Switch this thread to flush-to-zero; returns the state (int32) for ``restore_float_state``."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not _IS_X86:
            return ir.Constant(_I32, 0)
        before = cgutils.alloca_once(builder, _I32)
        _mxcsr_call(builder, "stmxcsr", before)
        wanted = cgutils.alloca_once(builder, _I32)
        builder.store(ir.Constant(_I32, _FLUSH_TO_ZERO), wanted)
        _mxcsr_call(builder, "ldmxcsr", wanted)
        return builder.load(before)

    return types.int32(), emit


@intrinsic
def restore_float_state(typing_context, state):
    """Give this thread the state back that ``begin_flush_to_zero`` returned."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if _IS_X86:
            pointer = cgutils.alloca_once(builder, _I32)
            builder.store(args[0], pointer)
            _mxcsr_call(builder, "ldmxcsr", pointer)
        return context.get_dummy_value()

    return types.none(types.int32), emit
