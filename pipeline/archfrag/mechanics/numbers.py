"""The number type of the kernels: one run, or four side by side.

A kernel written for a float runs for four runs at once where its arrays hold `LANES` numbers in
each element: numba types such an element as a vector of the processor, and the operators below
give every lane the bits that a float would get. Nothing may branch on such a number: `select`
takes the place of ``if``, and what a lane must not do is masked. ``some(mask)`` is whether any
lane asks for a piece of work, so that it can be left out where none does.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    models,
    overload,
    register_model,
    typeof_impl,
)
from numba.np.arrayobj import make_array

from archfrag.mechanics.compile import inlined

LANES = 4
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)
_ALIGNMENT = 64


class _Four(types.Type):
    """Numbers, or truths, of four runs; `plain` stands where four are wanted: each gets it."""

    plain: Any

    def __init__(self) -> None:
        super().__init__(name=f"{type(self).__name__.strip('_').removesuffix('Type')}{LANES}")

    def unify(self, typingctx: Any, other: Any) -> Any:
        """A variable that is plain on one path and of four on another is of four."""
        return self if isinstance(other, self.plain) else None

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """How safe a conversion is; None if there is none."""
        return Conversion.safe if isinstance(other, self.plain) else None


class _LanesType(_Four):
    lanes, plain = True, types.Float | types.Integer


class _MaskType(_Four):
    plain = types.Boolean


lanes_type, mask_type = _LanesType(), _MaskType()


def _register(kind: type[_Four], vector: ir.Type) -> None:
    @register_model(kind)
    class _Model(models.PrimitiveModel):
        def __init__(self, manager: Any, of: Any) -> None:
            super().__init__(manager, of, vector)


_register(_LanesType, _VECTOR)
_register(_MaskType, _BITS)


class LaneArray(np.ndarray):
    """Array of numbers of four runs, for kernels; see `lane_array` and `runs_of`."""


@typeof_impl.register(LaneArray)
def _type_of_lane_array(value: LaneArray, context: Any) -> types.Array:
    return types.Array(lanes_type, value.ndim, "C", aligned=True)


def lane_array(shape: tuple[int, ...]) -> LaneArray:
    """Zeros for four runs.

    Parameters
    ----------
    shape : tuple of int
        Of one run's array.

    Examples
    --------
    >>> from archfrag.mechanics.numbers import lane_array, runs_of
    >>> runs_of(lane_array((7, 3))).shape
    (7, 3, 4)
    """
    size = 8 * LANES * math.prod(shape)
    memory = np.zeros(size + _ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % _ALIGNMENT
    record = memory[start : start + size].view(np.dtype((np.void, 8 * LANES)))
    return record.reshape(shape).view(LaneArray)


def runs_of(array: np.ndarray) -> np.ndarray:
    """The numbers of a `LaneArray` as floats, the lane last; changes are seen in both."""
    plain = array.view(np.ndarray).reshape(-1).view(np.float64)
    return plain.reshape((*array.shape, LANES))


def _broadcast(builder: Any, value: Any, kind: Any) -> Any:
    first = ir.Constant(ir.IntType(32), 0)
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    nothing = ir.Constant(kind, ir.Undefined)
    return builder.shuffle_vector(
        builder.insert_element(nothing, value, first), nothing, everywhere
    )


@lower_cast(types.Float, _LanesType)
@lower_cast(types.Integer, _LanesType)
def _float_to_lanes(context: Any, builder: Any, of: Any, to: Any, value: Any) -> Any:
    return _broadcast(builder, context.cast(builder, value, of, types.float64), _VECTOR)


@lower_cast(types.Boolean, _MaskType)
def _bool_to_mask(context: Any, builder: Any, of: Any, to: Any, value: Any) -> Any:
    return _broadcast(builder, context.cast(builder, value, of, types.boolean), _BITS)


def _operator(
    op: Callable, emit: Callable, of: types.Type, plain: Any, result: types.Type
) -> None:
    """Lower a binary operator of two vectors, or of a vector and a plain number."""

    @infer_global(op)
    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if (
                len(args) == 2
                and of in args
                and all(a == of or isinstance(a, plain) for a in args)
            ):
                return signature(result, of, of)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *args)

    lower_builtin(op, of, of)(lower)


_NUMBER, _TRUTH = (types.Float, types.Integer), (types.Boolean,)
_EMITTED = (
    ("add", "fadd", lanes_type, _NUMBER), ("sub", "fsub", lanes_type, _NUMBER),
    ("mul", "fmul", lanes_type, _NUMBER), ("truediv", "fdiv", lanes_type, _NUMBER),
    ("and_", "and_", mask_type, _TRUTH), ("or_", "or_", mask_type, _TRUTH),
    ("xor", "xor", mask_type, _TRUTH),
)  # fmt: skip
for _name, _call, _of, _plain in _EMITTED:
    for _form in (_name, f"i{_name.strip('_')}"):
        _operator(
            getattr(operator, _form),
            lambda b, x, y, call=_call: getattr(b, call)(x, y),
            _of, _plain, _of,
        )  # fmt: skip
for _name, _sign in (("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "==")):
    _operator(
        getattr(operator, _name),
        lambda b, x, y, sign=_sign: b.fcmp_ordered(sign, x, y),
        lanes_type, _NUMBER, mask_type,
    )  # fmt: skip
_operator(
    operator.ne,
    lambda b, x, y: b.fcmp_unordered("!=", x, y),
    lanes_type, _NUMBER, mask_type,
)  # fmt: skip


@infer_global(operator.neg)
class _Negative(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(lanes_type, lanes_type) if args == (lanes_type,) else None


@lower_builtin(operator.neg, lanes_type)
def _negative(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.fneg(args[0])


def _of_lanes(name: str) -> Callable:
    @intrinsic
    def call(typingctx: Any, x: Any) -> Any:
        def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            kind = ir.FunctionType(_VECTOR, [_VECTOR])
            function = cgutils.get_or_insert_function(
                builder.module, kind, f"llvm.{name}.v{LANES}f64"
            )
            return builder.call(function, args)

        return (lanes_type(lanes_type), lower) if x == lanes_type else None

    return call


_root_of_lanes, _size_of_lanes = _of_lanes("sqrt"), _of_lanes("fabs")


@overload(math.sqrt)
def _root(x):
    return (lambda x: _root_of_lanes(x)) if x == lanes_type else None


@overload(abs)
def _size(x):
    return (lambda x: _size_of_lanes(x)) if x == lanes_type else None


@intrinsic
def _select_number(typingctx: Any, mask: Any, x: Any, y: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(*args)

    kind = lanes_type if mask == mask_type else types.float64
    return kind(mask, kind, kind), lower


@intrinsic
def _is_some(typingctx: Any, mask: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(mask_type), lower


@intrinsic
def _lane_of(typingctx: Any, x: Any, number: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.extract_element(*args)

    kind = {lanes_type: types.float64, mask_type: types.boolean}[x]
    return kind(x, types.intp), lower


@intrinsic
def _with_lane_of(typingctx: Any, x: Any, number: Any, value: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.insert_element(args[0], args[2], args[1])

    kind = {lanes_type: types.float64, mask_type: types.boolean}[x]
    return x(x, types.intp, kind), lower


@intrinsic
def _fused(typingctx: Any, x: Any, y: Any, z: Any) -> Any:
    of_lanes = lanes_type in (x, y, z)
    kind, vector = (lanes_type, _VECTOR) if of_lanes else (types.float64, ir.DoubleType())

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        name = f"llvm.fmuladd.v{LANES}f64" if of_lanes else "llvm.fmuladd.f64"
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector] * 3), name
        )
        return builder.call(function, args)

    return kind(kind, kind, kind), lower


def fused(x, y, z):
    """Product of `x` and `y` plus `z`, rounded once where the processor can, whatever the type."""
    return x * y + z


@overload(fused)
def _fused_number(x, y, z):
    return lambda x, y, z: _fused(x, y, z)


@intrinsic
def _shaped(typingctx: Any, arrays: Any, shapes: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        record, known = args
        for k, kind in enumerate(arrays):
            if not isinstance(kind, types.Array) or len(shapes[k]) == 0:
                continue
            array = make_array(kind)(context, builder, builder.extract_value(record, k))
            sizes = cgutils.unpack_tuple(builder, array.shape)[:1]
            sizes += cgutils.unpack_tuple(builder, builder.extract_value(known, k))
            item = context.get_abi_sizeof(context.get_data_type(kind.dtype))
            strides = [ir.Constant(ir.IntType(64), item)]
            for size in sizes[:0:-1]:
                strides.insert(0, builder.mul(strides[0], size))
            array.shape = cgutils.pack_array(builder, sizes)
            array.strides = cgutils.pack_array(builder, strides)
            record = builder.insert_value(record, array._getvalue(), k)
        return impl_ret_borrowed(context, builder, arrays, record)

    return arrays(arrays, shapes), lower


def shaped(arrays, shapes):
    """The same named tuple of C-contiguous arrays, with shapes that the compiler knows.

    `shapes`, a constant, has those of each entry behind its first dimension; empty for what stays.
    """
    return arrays


@overload(shaped)
def _shaped_arrays(arrays, shapes):
    return lambda arrays, shapes: _shaped(arrays, shapes)


def select(mask, x, y):
    """`x` where `mask` holds, else `y`; both are evaluated."""
    return x if mask else y


@overload(select)
def _select(mask, x, y):
    return lambda mask, x, y: _select_number(mask, x, y)


def some(mask):
    """Whether `mask` holds in any run."""
    return mask


@overload(some)
def _some(mask):
    if mask == mask_type:
        return lambda mask: _is_some(mask)
    return lambda mask: mask


def opposite(mask):
    """Where `mask` does not hold."""
    return not mask


@overload(opposite)
def _opposite(mask):
    if mask == mask_type:
        return lambda mask: mask ^ True
    return lambda mask: not mask


def width(x):
    """How many runs a number or mask is of."""
    return 1


@overload(width)
def _width(x):
    if x in (lanes_type, mask_type):
        return lambda x: LANES
    return lambda x: 1


def lane(x, number):
    """A number or truth of one run."""
    return x


@overload(lane)
def _lane(x, number):
    if x in (lanes_type, mask_type):
        return lambda x, number: _lane_of(x, number)
    return lambda x, number: x


def with_lane(x, number, value):
    """`x` with another value in one run."""
    return value


@overload(with_lane)
def _with_lane(x, number, value):
    if x in (lanes_type, mask_type):
        return lambda x, number, value: _with_lane_of(x, number, value)
    return lambda x, number, value: value


@inlined
def count_of(mask):
    """In how many runs `mask` holds."""
    count = 0
    for k in range(width(mask)):
        count += 1 if lane(mask, k) else 0
    return count


@inlined
def dot(a, b):
    """Scalar product of two vectors of three numbers."""
    return fused(a[0], b[0], fused(a[1], b[1], a[2] * b[2]))


@inlined
def larger(x, y):
    """The larger of two numbers; `y` where one is nan."""
    return select(x > y, x, y)


@inlined
def smaller(x, y):
    """The smaller of two numbers; `y` where one is nan."""
    return select(x < y, x, y)


@inlined
def flag(mask):
    """One where `mask` holds, else zero."""
    return select(mask, 1.0, 0.0)


# Nearest integers by adding what leaves no bits for a fraction.
_ROUNDER = 6755399441055744.0
_PER_QUARTER = 0.63661977236758134308
_QUARTER_HIGH = 1.57079632673412561417
_QUARTER_MIDDLE = 6.07710050630396597660e-11
_QUARTER_LOW = 2.02226624879595063154e-21


@inlined
def nearest(x):
    """Nearest integer, as a number."""
    return (x + _ROUNDER) - _ROUNDER


@inlined
def sine_cosine(angle):
    """Sine and cosine of angles up to some thousand revolutions, right to two units in the last
    place.

    Reduced by quarter revolutions in three parts; polynomials of Sun's fdlibm (1993), `k_sin.c`
    and `k_cos.c`.
    """
    quarters = nearest(angle * _PER_QUARTER)
    x = angle - quarters * _QUARTER_HIGH - quarters * _QUARTER_MIDDLE - quarters * _QUARTER_LOW
    z = x * x
    sine = -2.50507602534068634195e-8 + z * 1.58969099521155010221e-10
    sine = 2.75573137070700676789e-6 + z * sine
    sine = -1.98412698298579493134e-4 + z * sine
    sine = 8.33333333332248946124e-3 + z * sine
    sine = -1.66666666666666324348e-1 + z * sine
    sine = x + x * z * sine
    cosine = 2.08757232129817482790e-9 - z * 1.13596475577881948265e-11
    cosine = -2.75573143513906633035e-7 + z * cosine
    cosine = 2.48015872894767294178e-5 + z * cosine
    cosine = -1.38888888888741095749e-3 + z * cosine
    cosine = 4.16666666666666019037e-2 + z * cosine
    cosine = 1.0 - 0.5 * z + z * z * cosine
    # In which quarter: 0, 1, 2 or 3 of a revolution on.
    part = quarters * 0.25
    part = 4.0 * (part - nearest(part))
    crossed = abs(part) == 1.0
    first = select(crossed, cosine, sine)
    second = select(crossed, sine, cosine)
    negative_sine = (abs(part) == 2.0) | (part == -1.0)
    negative_cosine = (abs(part) == 2.0) | (part == 1.0)
    return select(negative_sine, -first, first), select(negative_cosine, -second, second)
