"""Moving numbers between lanes, inside ``numba.njit`` functions: groups of four lanes, and transpositions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba.extending
from llvmlite import ir
from numba.core import cgutils, types

from phys4dgen.vector.batch import BATCH_LANES
from phys4dgen.vector.lanes import FAST_MATH, float32_batch, float32x16, shuffled
from phys4dgen.vector.math import inline
from phys4dgen.vector.memory import element_pointer, load_vector

__all__ = [
    "group_last",
    "load_group_each",
    "load_group_moments",
    "load_group_repeated",
    "load_transposed16",
    "place_of_four",
    "store_in_fours",
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


# transposition: rows of 16 floats <-> columns in lanes


def _lanes_of_each_group(*lanes: int) -> list[int]:
    """The same lanes of each group, 0 to 3 of a first vector, 4 to 7 of a second."""
    return [4 * group + (lane if lane < 4 else 12 + lane) for group in range(4) for lane in lanes]


_SINGLES = _lanes_of_each_group(0, 4, 1, 5), _lanes_of_each_group(2, 6, 3, 7)
_PAIRS = _lanes_of_each_group(0, 1, 4, 5), _lanes_of_each_group(2, 3, 6, 7)
_HALVES = _groups(0, 2, 4, 6), _groups(1, 3, 5, 7)


def _interleaved(builder: Any, a: Any, b: Any, orders: tuple[list[int], list[int]]) -> list[Any]:
    return [shuffled(builder, a, b, order) for order in orders]


def _transpose_groups(builder: Any, a: Any, b: Any, c: Any, d: Any) -> list[Any]:
    """4 x 4 transpositions within each group: of lane k of each group, the numbers of a, b, c and d."""
    low_ab, high_ab = _interleaved(builder, a, b, _SINGLES)
    low_cd, high_cd = _interleaved(builder, c, d, _SINGLES)
    return _interleaved(builder, low_ab, low_cd, _PAIRS) + _interleaved(builder, high_ab, high_cd, _PAIRS)


def _transpose16(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """16 x 16 transposition in registers: within groups of four rows and lanes, then of the groups.

    Each step is one instruction that needs no table of lanes in a register, on x86 and elsewhere.
    """
    columns = [_transpose_groups(builder, *rows[first : first + 4]) for first in range(0, 16, 4)]
    out: list[Any] = [None] * 16
    for lane, (a, b, c, d) in enumerate(zip(*columns, strict=True)):
        even_ab, odd_ab = _interleaved(builder, a, b, _HALVES)
        even_cd, odd_cd = _interleaved(builder, c, d, _HALVES)
        out[lane], out[lane + 8] = _interleaved(builder, even_ab, even_cd, _HALVES)
        out[lane + 4], out[lane + 12] = _interleaved(builder, odd_ab, odd_cd, _HALVES)
    return out


def _row_pointer(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pointer = element_pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1])
    return builder.bitcast(pointer, float32x16.llvm.as_pointer())


def _load_rows(builder: Any, pointer: Any, start: int) -> list[Any]:
    rows = [builder.load(builder.gep(pointer, [ir.Constant(_I32, start + k)])) for k in range(16)]
    for row in rows:
        row.align = 4
    return rows


@intrinsic
def load_transposed16(typing_context, array, index):
    """16 rows of 16 floats from array[index] on -> the 16 columns, each 16 lanes (lane = row)."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        rows = _load_rows(builder, _row_pointer(context, builder, sig, args), 0)
        return context.make_tuple(builder, sig.return_type, _transpose16(builder, rows))

    return types.UniTuple(float32x16, 16)(array, index), emit


@intrinsic
def store_transposed(typing_context, array, index, columns):
    """Write 16 columns of 16 lanes as 16 rows of 16 floats, from array[index] on."""
    if tuple(columns.types) != (float32x16,) * 16:
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _row_pointer(context, builder, sig, args)
        for k, row in enumerate(_transpose16(builder, cgutils.unpack_tuple(builder, args[2], 16))):
            builder.store(row, builder.gep(pointer, [ir.Constant(_I32, k)])).align = 4
        return context.get_dummy_value()

    return types.none(array, index, columns), emit


# a batch of particles: groups of lanes <-> columns


def _group_moments(builder: Any, rows: Sequence[Any]) -> list[Any]:
    """Of 16 rows, the columns of their first three groups' sum, then those of the third group less the first."""
    sums, differences = [], []
    for k in range(4):
        a, b, c, d = rows[k::4]  # lane k of each group after the transposition below
        low_ab, low_cd = (shuffled(builder, x, y, _groups(0, 1, 4, 5)) for x, y in ((a, b), (c, d)))
        high_ab, high_cd = (shuffled(builder, x, y, _groups(2, 3, 6, 7)) for x, y in ((a, b), (c, d)))
        first = shuffled(builder, low_ab, low_cd, _groups(0, 2, 4, 6))
        second = shuffled(builder, low_ab, low_cd, _groups(1, 3, 5, 7))
        third = shuffled(builder, high_ab, high_cd, _groups(0, 2, 4, 6))
        sums.append(builder.fadd(builder.fadd(first, third, flags=FAST_MATH), second, flags=FAST_MATH))
        differences.append(builder.fsub(third, first, flags=FAST_MATH))
    return _transpose_groups(builder, *sums) + _transpose_groups(builder, *differences)


@intrinsic
def load_group_moments(typing_context, array, index):
    """Moments of rows of 16 floats, as many as a batch has lanes, from array[index] on, over their first three groups.

    Result, lane = row: four columns of their sum, one for each lane of a group, and four of the third group less the
    first, the moment about the second. What is not used costs nothing.
    """

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _row_pointer(context, builder, sig, args)
        blocks = [_group_moments(builder, _load_rows(builder, pointer, at)) for at in range(0, BATCH_LANES, 16)]
        columns = blocks[0]
        if len(blocks) == 2:
            columns = [shuffled(builder, low, high, range(32)) for low, high in zip(*blocks, strict=True)]
        return context.make_tuple(builder, sig.return_type, columns)

    return types.UniTuple(float32_batch, 8)(array, index), emit


@intrinsic
def store_in_fours(typing_context, array, index, columns):
    """Write four columns of a batch as fours of floats, that of a lane at array[index + ``place_of_four(lane)``].

    Half of the shuffles of a transposition, which would put them in order.
    """
    if tuple(columns.types) != (float32_batch,) * 4:
        return None

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _row_pointer(context, builder, sig, args)
        lanes = cgutils.unpack_tuple(builder, args[2], 4)
        for start in range(0, BATCH_LANES, 16):
            rows = _transpose_groups(builder, *(shuffled(builder, x, x, range(start, start + 16)) for x in lanes))
            for k, row in enumerate(rows):
                builder.store(row, builder.gep(pointer, [ir.Constant(_I32, start // 4 + k)])).align = 4
        return context.get_dummy_value()

    return types.none(array, index, columns), emit


@inline
def place_of_four(lane):
    """Where ``store_in_fours`` puts the four floats of a lane of the batch."""
    return (lane >> 4 << 6) + ((lane & 3) << 4) + (lane >> 2 & 3) * 4
