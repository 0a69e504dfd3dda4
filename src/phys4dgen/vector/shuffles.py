"""Moving numbers between lanes, inside ``numba.njit`` functions: groups of four lanes, and 16 x 16 transpositions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba.extending
from llvmlite import ir
from numba.core import cgutils, types

from phys4dgen.vector.batch import BATCH_LANES
from phys4dgen.vector.lanes import FAST_MATH, float32_batch, float32x16, shuffled
from phys4dgen.vector.memory import element_pointer, load_vector

__all__ = [
    "group_last",
    "group_sums",
    "load_group_each",
    "load_group_repeated",
    "load_transposed16",
    "load_transposed_batch",
    "store_transposed",
]

intrinsic: Any = numba.extending.intrinsic  # to a type checker, opaque: it changes the signature

_I32 = ir.IntType(32)

# 16 lanes as four groups of four lanes


@intrinsic
def load_group_repeated(typing_context, array, index):
    """The four floats a b c d at array[index] in every group: abcd abcd abcd abcd."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        four = load_vector(context, builder, sig, args, ir.VectorType(ir.FloatType(), 4))
        return shuffled(builder, four, four, [lane % 4 for lane in range(16)])

    return float32x16(array, index), emit


@intrinsic
def load_group_each(typing_context, array, index):
    """The four floats a b c d at array[index], one per group: aaaa bbbb cccc dddd."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        four = load_vector(context, builder, sig, args, ir.VectorType(ir.FloatType(), 4))
        return shuffled(builder, four, four, [lane // 4 for lane in range(16)])

    return float32x16(array, index), emit


@intrinsic
def group_last(typing_context, x):
    """The last lane of each group in all four lanes of the group."""
    order = [lane // 4 * 4 + 3 for lane in range(16)]
    return float32x16(float32x16), lambda context, builder, sig, args: shuffled(builder, args[0], args[0], order)


@intrinsic
def group_sums(typing_context, p, q, r, s):
    """Sum of the first three groups of each argument: [sum of p | sum of q | sum of r | sum of s]."""

    def pair(i: int, j: int) -> list[int]:
        return [4 * i + lane for lane in range(4)] + [4 * j + lane for lane in range(4)]

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        p, q, r, s = args
        low_pq, low_rs = (shuffled(builder, a, b, pair(0, 4) + pair(1, 5)) for a, b in ((p, q), (r, s)))
        high_pq, high_rs = (shuffled(builder, a, b, pair(2, 6) + pair(3, 7)) for a, b in ((p, q), (r, s)))
        first = shuffled(builder, low_pq, low_rs, pair(0, 1) + pair(4, 5))
        second = shuffled(builder, low_pq, low_rs, pair(2, 3) + pair(6, 7))
        third = shuffled(builder, high_pq, high_rs, pair(0, 1) + pair(4, 5))
        return builder.fadd(builder.fadd(first, second, flags=FAST_MATH), third, flags=FAST_MATH)

    return float32x16(p, q, r, s), emit


# transposition: rows of 16 floats <-> columns in lanes


def _transpose16(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """16 x 16 transposition in registers: swap off-diagonal blocks of side 8, 4, 2, 1."""
    rows = list(rows)
    for side in (8, 4, 2, 1):
        for i in range(16):
            if not i & side:
                a, b = rows[i], rows[i + side]
                rows[i] = shuffled(builder, a, b, [k + 16 - side if k & side else k for k in range(16)])
                rows[i + side] = shuffled(builder, a, b, [k + 16 if k & side else k + side for k in range(16)])
    return rows


def _row_pointer(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pointer = element_pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1])
    return builder.bitcast(pointer, float32x16.llvm.as_pointer())


def _emit_load_transposed(count: int) -> Any:
    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _row_pointer(context, builder, sig, args)
        blocks = []
        for start in range(0, count, 16):
            rows = [builder.load(builder.gep(pointer, [ir.Constant(_I32, start + k)])) for k in range(16)]
            for row in rows:
                row.align = 4
            blocks.append(_transpose16(builder, rows))
        columns = blocks[0]
        if count == 32:
            columns = [shuffled(builder, low, high, range(32)) for low, high in zip(*blocks, strict=True)]
        return context.make_tuple(builder, sig.return_type, columns)

    return emit


@intrinsic
def load_transposed16(typing_context, array, index):
    """16 rows of 16 floats from array[index] on -> the 16 columns, each 16 lanes (lane = row)."""
    return types.UniTuple(float32x16, 16)(array, index), _emit_load_transposed(16)


@intrinsic
def load_transposed_batch(typing_context, array, index):
    """As many rows of 16 floats as a batch has lanes, from array[index] on -> the 16 columns (lane = row)."""
    return types.UniTuple(float32_batch, 16)(array, index), _emit_load_transposed(BATCH_LANES)


@intrinsic
def store_transposed(typing_context, array, index, columns):
    """Write 16 columns of 16 or 32 lanes as that many rows of 16 floats, from array[index] on."""
    count = columns.dtype.count

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _row_pointer(context, builder, sig, args)
        lanes = cgutils.unpack_tuple(builder, args[2], 16)
        for start in range(0, count, 16):
            rows = _transpose16(builder, [shuffled(builder, x, x, range(start, start + 16)) for x in lanes])
            for k, row in enumerate(rows):
                builder.store(row, builder.gep(pointer, [ir.Constant(_I32, start + k)])).align = 4
        return context.get_dummy_value()

    return types.none(array, index, columns), emit
