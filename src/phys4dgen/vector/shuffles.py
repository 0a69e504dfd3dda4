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


def _groups(*numbers: int) -> list[int]:
    """Lanes of whole groups, 0 to 3 of a first vector, 4 to 7 of a second."""
    return [4 * number + lane for number in numbers for lane in range(4)]


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

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        p, q, r, s = args
        low_pq, low_rs = (shuffled(builder, a, b, _groups(0, 1, 4, 5)) for a, b in ((p, q), (r, s)))
        high_pq, high_rs = (shuffled(builder, a, b, _groups(2, 3, 6, 7)) for a, b in ((p, q), (r, s)))
        first = shuffled(builder, low_pq, low_rs, _groups(0, 2, 4, 6))
        second = shuffled(builder, low_pq, low_rs, _groups(1, 3, 5, 7))
        third = shuffled(builder, high_pq, high_rs, _groups(0, 2, 4, 6))
        return builder.fadd(builder.fadd(first, second, flags=FAST_MATH), third, flags=FAST_MATH)

    return float32x16(p, q, r, s), emit


# transposition: rows of 16 floats <-> columns in lanes


def _transpose16(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """16 x 16 transposition in registers: within groups of four rows and lanes, then of the groups.

    Each step is one instruction that needs no table of lanes in a register, on x86 and elsewhere.
    """

    def lanes_of_each_group(*lanes: int) -> list[int]:
        return [4 * group + (lane if lane < 4 else 12 + lane) for group in range(4) for lane in lanes]

    def interleaved(a: Any, b: Any, low: list[int], high: list[int]) -> list[Any]:
        return [shuffled(builder, a, b, low), shuffled(builder, a, b, high)]

    singles = lanes_of_each_group(0, 4, 1, 5), lanes_of_each_group(2, 6, 3, 7)
    pairs = lanes_of_each_group(0, 1, 4, 5), lanes_of_each_group(2, 3, 6, 7)
    halves = _groups(0, 2, 4, 6), _groups(1, 3, 5, 7)
    columns = []  # [group of rows][lane within its group]: that lane of each group of lanes
    for first in range(0, 16, 4):
        a, b, c, d = rows[first : first + 4]
        (low_ab, high_ab), (low_cd, high_cd) = interleaved(a, b, *singles), interleaved(c, d, *singles)
        columns.append(interleaved(low_ab, low_cd, *pairs) + interleaved(high_ab, high_cd, *pairs))
    out: list[Any] = [None] * 16
    for lane, (a, b, c, d) in enumerate(zip(*columns, strict=True)):
        (even_ab, odd_ab), (even_cd, odd_cd) = interleaved(a, b, *halves), interleaved(c, d, *halves)
        out[lane], out[lane + 8] = interleaved(even_ab, even_cd, *halves)
        out[lane + 4], out[lane + 12] = interleaved(odd_ab, odd_cd, *halves)
    return out


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
