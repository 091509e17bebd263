"""Arithmetic of kernels on numbers of one run, or of four side by side.

A kernel written for a float runs for four runs at once where its arrays hold `LANES` numbers in
each element (`archfrag.mechanics.lanes`): every lane gets the bits that a float would get. Nothing
may branch on such a number: `select` takes the place of ``if``, and what a lane must not do is
masked. ``some(mask)`` is whether any lane asks for a piece of work, so that it can be left out
where none does.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array

from archfrag.mechanics.compile import inlined
from archfrag.mechanics.lanes import LANES, VECTOR, lanes_type, mask_type


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
    kind, vector = (lanes_type, VECTOR) if of_lanes else (types.float64, ir.DoubleType())

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        name = f"llvm.fmuladd.v{LANES}f64" if of_lanes else "llvm.fmuladd.f64"
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector] * 3), name
        )
        return builder.call(function, args)

    return kind(kind, kind, kind), lower


def fused(x, y, z):
    """Return `x` times `y` plus `z`, rounded once if the processor can."""
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
    """Return a named tuple of C-contiguous arrays with shapes that the compiler knows.

    `shapes`, a constant, has those of each entry behind its first dimension; empty for what stays.
    """
    return arrays


@overload(shaped)
def _shaped_arrays(arrays, shapes):
    return lambda arrays, shapes: _shaped(arrays, shapes)


def _for_four(of_four):
    """Overload a function for a first argument of four runs."""

    def decorate(function):
        def choose(first, *others):
            return of_four if first in (lanes_type, mask_type) else function

        overload(function, strict=False)(choose)
        return function

    return decorate


def select(mask, x, y):
    """`x` where `mask` holds, else `y`; both are evaluated."""
    return x if mask else y


@overload(select)
def _select(mask, x, y):
    return lambda mask, x, y: _select_number(mask, x, y)


@_for_four(lambda mask: _is_some(mask))  # type: ignore[call-arg]
def some(mask):
    """Whether `mask` holds in any run."""
    return mask


@_for_four(lambda mask: mask ^ True)
def opposite(mask):
    """Where `mask` does not hold."""
    return not mask


@_for_four(lambda x: LANES)
def width(x):
    """How many runs a number or mask is of."""
    return 1


@_for_four(lambda x, number: _lane_of(x, number))  # type: ignore[call-arg]
def lane(x, number):
    """A number or truth of one run."""
    return x


@_for_four(lambda x, number, value: _with_lane_of(x, number, value))  # type: ignore[call-arg]
def with_lane(x, number, value):
    """`x` with another value in one run."""
    return value


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
