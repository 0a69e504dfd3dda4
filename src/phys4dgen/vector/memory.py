"""Loads and stores of lanes, for use inside ``numba.njit`` functions.

They take a one-dimensional contiguous float32 array (int32 for int lanes) and an element index; they check no bounds
and need no alignment.
"""

from __future__ import annotations

from typing import Any

import numba.extending
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import impl_ret_borrowed
from numba.np.arrayobj import populate_array

from phys4dgen.vector.batch import BATCH_LANES
from phys4dgen.vector.lanes import Lanes, float32_batch

__all__ = [
    "element_pointer",
    "flat",
    "load16",
    "load_batch",
    "load_columns",
    "load_vector",
    "prefetch_columns",
    "store",
    "store_columns",
]

_CACHE_LINE = 16  # numbers of 4 bytes

intrinsic: Any = numba.extending.intrinsic  # to a type checker, opaque: it changes the signature


def element_pointer(context: Any, builder: Any, array_type: Any, array: Any, index_type: Any, index: Any) -> Any:
    """For intrinsics: the address of array[index]."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [context.cast(builder, index, index_type, types.intp)])


def load_vector(context: Any, builder: Any, sig: Any, args: Any, vector: ir.VectorType) -> Any:
    """For intrinsics of (array, index): an LLVM vector from array[index] on."""
    pointer = element_pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1])
    value = builder.load(builder.bitcast(pointer, vector.as_pointer()))
    value.align = 4
    return value


def _array_kind(array: Any) -> str:
    return "int32" if array.dtype == types.int32 else "float32"


@intrinsic
def flat(typing_context, array):
    """A contiguous array as one of one dimension: ``ndarray.ravel``, which takes far longer to compile."""
    result = types.Array(array.dtype, 1, "C")

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        given = context.make_array(array)(context, builder, args[0])
        made = context.make_array(result)(context, builder)
        populate_array(
            made, data=given.data, shape=[given.nitems], strides=[given.itemsize], itemsize=given.itemsize,
            meminfo=given.meminfo, parent=given.parent,
        )  # fmt: skip
        return impl_ret_borrowed(context, builder, result, made._getvalue())

    return result(array), emit


@intrinsic
def load16(typing_context, array, index):
    """16 lanes from array[index], [index + 1], ..."""
    lanes = Lanes(_array_kind(array), 16)
    return lanes(array, index), lambda c, b, sig, args: load_vector(c, b, sig, args, lanes.llvm)


@intrinsic
def load_batch(typing_context, array, index):
    """A batch of lanes from array[index], [index + 1], ..."""
    lanes = Lanes(_array_kind(array), BATCH_LANES)
    return lanes(array, index), lambda c, b, sig, args: load_vector(c, b, sig, args, lanes.llvm)


@intrinsic
def store(typing_context, array, index, lanes):
    """Write all lanes to array[index], [index + 1], ..."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = element_pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        builder.store(args[2], builder.bitcast(pointer, lanes.llvm.as_pointer())).align = 4
        return context.get_dummy_value()

    return types.none(array, index, lanes), emit


@intrinsic(prefer_literal=True)
def load_columns(typing_context, array, index, stride, count):
    """A batch of lanes from array[index], array[index + stride], ...: a tuple of ``count``, a constant."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    total = count.literal_value
    # not UniTuple: Numba cannot type an empty one
    result = types.Tuple([float32_batch] * total)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        at = context.cast(builder, args[1], sig.args[1], types.intp)
        step = context.cast(builder, args[2], sig.args[2], types.intp)
        columns = []
        for _ in range(total):
            pointer = element_pointer(context, builder, sig.args[0], args[0], types.intp, at)
            value = builder.load(builder.bitcast(pointer, float32_batch.llvm.as_pointer()))
            value.align = 4
            columns.append(value)
            at = builder.add(at, step)
        return context.make_tuple(builder, sig.return_type, columns)

    return result(array, index, stride, count), emit


@intrinsic(prefer_literal=True)
def prefetch_columns(typing_context, array, index, stride, count):
    """Have the processor bring what ``load_columns`` will read into its cache; the place may be outside the array."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    total = count.literal_value

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        at = context.cast(builder, args[1], sig.args[1], types.intp)
        step = context.cast(builder, args[2], sig.args[2], types.intp)
        address, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        prefetch = builder.module.declare_intrinsic(
            "llvm.prefetch", [address], ir.FunctionType(ir.VoidType(), [address, number, number, number])
        )
        for _ in range(total):
            for line in range(0, BATCH_LANES, _CACHE_LINE):
                place = builder.add(at, at.type(line))
                pointer = element_pointer(context, builder, sig.args[0], args[0], types.intp, place)
                # to be read, kept near, data
                builder.call(prefetch, [builder.bitcast(pointer, address), number(0), number(3), number(1)])
            at = builder.add(at, step)
        return context.get_dummy_value()

    return types.none(array, index, stride, count), emit


@intrinsic
def store_columns(typing_context, array, index, stride, columns):
    """Write each lanes value of the tuple ``columns``: to array[index], array[index + stride], ..."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        at = context.cast(builder, args[1], sig.args[1], types.intp)
        step = context.cast(builder, args[2], sig.args[2], types.intp)
        for value in cgutils.unpack_tuple(builder, args[3], len(columns)):
            pointer = element_pointer(context, builder, sig.args[0], args[0], types.intp, at)
            builder.store(value, builder.bitcast(pointer, value.type.as_pointer())).align = 4
            at = builder.add(at, step)
        return context.get_dummy_value()

    return types.none(array, index, stride, columns), emit
