"""Explicit SIMD for Numba: value types of 16 lanes or as many as a ``batch`` has, lowered to LLVM vector instructions.

Numba vectorises simple loops but not the particle mathematics of this package. Here a value such as ``float32x16``
*is* an LLVM ``<16 x float>``: operators act lane by lane, LLVM splits the lanes over the registers of the machine
(AVX-512, AVX2, SSE, NEON), and no C++ compiler is needed. The names work only inside ``numba.njit`` functions.

A lane type has a kind (float32, int32 or bool) and a number of lanes. Python numbers mix with lanes and are
broadcast. Comparisons give bool lanes for ``where`` and ``any_lane``. Arithmetic is fast-math: NaN and infinity may
appear but are never relied on.

``memory`` loads and stores lanes, ``shuffles`` moves numbers between them.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

import numba.extending
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing import templates
from numba.core.typing.templates import AbstractTemplate, signature
from numba.extending import lower_builtin, lower_cast, models, register_model

from phys4dgen.vector.batch import BATCH_LANES

__all__ = [
    "FAST_MATH",
    "Lanes",
    "absolute",
    "add_compensated",
    "any_lane",
    "as_float_bits",
    "as_int_bits",
    "constant16",
    "float32_batch",
    "float32x16",
    "floor",
    "int32x16",
    "like",
    "maximum",
    "minimum",
    "root_and_inverse",
    "shuffled",
    "splat16",
    "sqrt",
    "to_float",
    "to_int",
    "where",
]

# Numba's decorators change the signature of what they decorate; to a type checker they are opaque.
intrinsic: Any = numba.extending.intrinsic
infer_global: Any = templates.infer_global

_I32 = ir.IntType(32)
_ELEMENTS = {"float32": ir.FloatType(), "int32": _I32, "bool": ir.IntType(1)}
FAST_MATH = ("nsz", "arcp", "contract", "reassoc", "afn", "ninf", "nnan")
"""Flags of floating-point instructions, for intrinsics."""


class Lanes(types.Type):
    """The Numba type of ``count`` lanes of ``kind`` ("float32", "int32" or "bool")."""

    def __init__(self, kind: str, count: int) -> None:
        self.kind = kind
        self.count = count
        super().__init__(name=f"{kind}x{count}")

    @property
    def llvm(self) -> ir.VectorType:
        """The LLVM vector type."""
        return ir.VectorType(_ELEMENTS[self.kind], self.count)

    def of(self, kind: str) -> Lanes:
        """As many lanes of another kind."""
        return Lanes(kind, self.count)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, lanes: Lanes) -> None:
        super().__init__(manager, lanes, lanes.llvm)


float32x16 = Lanes("float32", 16)
float32_batch = Lanes("float32", BATCH_LANES)
int32x16 = Lanes("int32", 16)


def _broadcast(builder: Any, value: Any, vector: ir.VectorType) -> Any:
    undefined = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(_I32, 0))
    zeros = ir.Constant(ir.VectorType(_I32, vector.count), [0] * vector.count)
    return builder.shuffle_vector(first, undefined, zeros)


def shuffled(builder: Any, a: Any, b: Any, order: Sequence[int]) -> Any:
    """For intrinsics: the lanes ``order`` of a followed by b."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_I32, len(order)), list(order)))


@lower_cast(types.Number, Lanes)
def _number_to_lanes(context: Any, builder: Any, source: Any, target: Lanes, value: Any) -> Any:
    element = types.float32 if target.kind == "float32" else types.int32
    return _broadcast(builder, context.cast(builder, value, source, element), target.llvm)


# ---------------------------------------------------------------------------------------------------- operators

_BINARY: dict[Any, dict[str, tuple[Callable[[Any, Any, Any], Any], str]]] = {}
"""By operator and kind of its operands: how to emit it, and the kind of its result."""

_TRIED_FIRST = {"target": "cpu"}
"""Numba tries templates of the target before generic ones, of which there are dozens per operator, at a cost each."""


def _define_binary(op: Any, kind: str, emit: Callable[[Any, Any, Any], Any], result_kind: str | None = None) -> None:
    """Define ``op`` between lanes of one kind, or between lanes and a number."""
    if op not in _BINARY:
        _define_typing_and_lowering(op)
    _BINARY.setdefault(op, {})[kind] = emit, result_kind or kind


def _define_typing_and_lowering(op: Any) -> None:
    @infer_global(op)
    class _Template(AbstractTemplate):
        metadata = _TRIED_FIRST

        def generic(self, args: Any, kws: Any) -> Any:
            lanes = next((arg for arg in args if isinstance(arg, Lanes)), None)
            if len(args) != 2 or lanes is None or lanes.kind not in _BINARY[op]:
                return None
            if not all(arg == lanes if isinstance(arg, Lanes) else isinstance(arg, types.Number) for arg in args):
                return None
            return signature(lanes.of(_BINARY[op][lanes.kind][1]), lanes, lanes)

    @lower_builtin(op, Lanes, Lanes)
    def _lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _BINARY[op][sig.args[0].kind][0](builder, *args)


def _fast(method: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, a, b: getattr(builder, method)(a, b, flags=FAST_MATH)


def _plain(method: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, a, b: getattr(builder, method)(a, b)


def _compare(method: str, symbol: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, a, b: getattr(builder, method)(symbol, a, b)


for _method, _ops in {
    "fadd": (operator.add, operator.iadd),
    "fsub": (operator.sub, operator.isub),
    "fmul": (operator.mul, operator.imul),
    "fdiv": (operator.truediv, operator.itruediv),
}.items():
    for _op in _ops:
        _define_binary(_op, "float32", _fast(_method))
for _method, _op in {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "and_": operator.and_,
    "or_": operator.or_,
    "shl": operator.lshift,
    "ashr": operator.rshift,
}.items():
    _define_binary(_op, "int32", _plain(_method))
for _symbol, _op in {">": operator.gt, "<": operator.lt, ">=": operator.ge, "<=": operator.le}.items():
    _define_binary(_op, "float32", _compare("fcmp_ordered", _symbol), "bool")
    _define_binary(_op, "int32", _compare("icmp_signed", _symbol), "bool")
_define_binary(operator.and_, "bool", _plain("and_"))
_define_binary(operator.or_, "bool", _plain("or_"))


@infer_global(operator.neg)
class _Negative(AbstractTemplate):
    metadata = _TRIED_FIRST

    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], Lanes) and args[0].kind == "float32":
            return signature(args[0], args[0])
        return None


@lower_builtin(operator.neg, Lanes)
def _lower_negative(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0], flags=FAST_MATH)


# ---------------------------------------------------------------------------------------------------- functions


def _llvm_float_call(name: str, count: int) -> Any:
    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = sig.args[0].llvm
        function_type = ir.FunctionType(vector, [vector] * count)
        full_name = f"llvm.{name}.v{vector.count}f32"
        return builder.call(
            cgutils.get_or_insert_function(builder.module, function_type, full_name), args, fastmath=FAST_MATH
        )

    return emit


@intrinsic
def sqrt(typing_context, x):
    """Square root of float lanes."""
    return x(x), _llvm_float_call("sqrt", 1)


@intrinsic
def root_and_inverse(typing_context, x):
    """(sqrt(x), 1 / sqrt(x)) of positive float lanes, for little more than the inverse.

    Processors estimate the inverse root fast. A plain x * (1 / sqrt(x)) would be simplified to the slow sqrt(x), so the
    product carries no flag that allows that.
    """
    call = _llvm_float_call("sqrt", 1)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        one = ir.Constant(args[0].type, [1.0] * args[0].type.count)
        inverse = builder.fdiv(one, call(context, builder, x(x), args), flags=FAST_MATH)
        root = builder.fmul(args[0], inverse, flags=("nsz", "contract"))
        return context.make_tuple(builder, sig.return_type, (root, inverse))

    return types.UniTuple(x, 2)(x), emit


@intrinsic
def absolute(typing_context, x):
    """Absolute value of float lanes."""
    return x(x), _llvm_float_call("fabs", 1)


@intrinsic
def floor(typing_context, x):
    """Largest whole number not above each float lane, as float lanes."""
    return x(x), _llvm_float_call("floor", 1)


def _least_or_greatest(float_name: str, symbol: str) -> Any:
    call = _llvm_float_call(float_name, 2)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if sig.args[0].kind == "float32":
            return call(context, builder, sig, args)
        return builder.select(builder.icmp_signed(symbol, args[0], args[1]), args[0], args[1])

    return emit


@intrinsic
def minimum(typing_context, x, y):
    """The smaller of two float or int lanes; y may be a number."""
    return x(x, x), _least_or_greatest("minnum", "<")


@intrinsic
def maximum(typing_context, x, y):
    """The larger of two float or int lanes; y may be a number."""
    return x(x, x), _least_or_greatest("maxnum", ">")


@intrinsic
def add_compensated(typing_context, high, low, step):
    """Add ``step`` to the unevaluated sum high + low: ``low`` keeps what rounding ``high`` lost.

    W. Kahan, *Further remarks on reducing truncation errors*, 1965. The compiler may not reorder these operations.
    """
    # Numba gives its fast-math flags to every operation that has none; "no signed zeros" alone allows no reordering.
    exact = ("nsz",)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        high, low, step = args
        change = builder.fadd(step, low, flags=exact)
        total = builder.fadd(high, change, flags=exact)
        taken = builder.fsub(total, high, flags=exact)
        return context.make_tuple(builder, sig.return_type, (total, builder.fsub(change, taken, flags=exact)))

    return types.UniTuple(high, 2)(high, high, high), emit


@intrinsic
def where(typing_context, mask, x, y):
    """Lanes of x where mask, else of y (lanes or a number)."""
    return x(mask, x, x), lambda context, builder, sig, args: builder.select(*args)


@intrinsic
def any_lane(typing_context, mask):
    """True if any lane of a bool vector is true."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = sig.args[0].llvm
        function_type = ir.FunctionType(ir.IntType(1), [vector])
        name = f"llvm.vector.reduce.or.v{vector.count}i1"
        return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), args)

    return types.boolean(mask), emit


@intrinsic
def to_int(typing_context, x):
    """Float lanes to int32 lanes, towards zero."""
    return x.of("int32")(x), lambda context, builder, sig, args: builder.fptosi(args[0], sig.return_type.llvm)


@intrinsic
def to_float(typing_context, x):
    """Int32 lanes to float32 lanes."""
    return x.of("float32")(x), lambda context, builder, sig, args: builder.sitofp(args[0], sig.return_type.llvm)


@intrinsic
def as_int_bits(typing_context, x):
    """The bits of float32 lanes as int32 lanes."""
    return x.of("int32")(x), lambda context, builder, sig, args: builder.bitcast(args[0], sig.return_type.llvm)


@intrinsic
def as_float_bits(typing_context, x):
    """The bits of int32 lanes as float32 lanes."""
    return x.of("float32")(x), lambda context, builder, sig, args: builder.bitcast(args[0], sig.return_type.llvm)


@intrinsic
def splat16(typing_context, x):
    """The number x in 16 float32 lanes."""
    return float32x16(types.float32), lambda context, builder, sig, args: _broadcast(builder, args[0], float32x16.llvm)


@intrinsic
def like(typing_context, lanes, x):
    """The number x in float32 lanes, as many as ``lanes`` has."""
    result = lanes.of("float32")
    return result(lanes, types.float32), lambda context, builder, sig, args: _broadcast(builder, args[1], result.llvm)


def constant16(values: Sequence[float]) -> Any:
    """Make a function of no arguments, for use in kernels, that gives these 16 constants as float32 lanes."""
    constants = [float(value) for value in values]

    @intrinsic
    def constant(typing_context):
        return float32x16(), lambda context, builder, sig, args: ir.Constant(float32x16.llvm, constants)

    return constant
