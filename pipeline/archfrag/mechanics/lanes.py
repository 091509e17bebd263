"""The number type of four runs side by side.

numba types an element of a `LaneArray` as a vector of the processor, and the operators below give
every lane the bits that a float would get; `archfrag.mechanics.numbers` has what else kernels do
with such numbers.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_cast, models, overload, register_model, typeof_impl

LANES = 4
VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)
_ALIGNMENT = 64


class _Four(types.Type):
    """Numbers or truths of four runs; a `plain` value is given to each of them."""

    plain: Any

    def __init__(self) -> None:
        super().__init__(name=f"{type(self).__name__.strip('_').removesuffix('Type')}{LANES}")

    def unify(self, typingctx: Any, other: Any) -> Any:
        """A variable that is plain on one path and of four on another is of four."""
        return self if isinstance(other, self.plain) else None

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """Return how safe a conversion is; None if it is impossible."""
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


_register(_LanesType, VECTOR)
_register(_MaskType, _BITS)


class LaneArray(np.ndarray):
    """Array of numbers of four runs, for kernels; see `lane_array` and `runs_of`."""


@typeof_impl.register(LaneArray)
def _type_of_lane_array(value: LaneArray, context: Any) -> types.Array:
    return types.Array(lanes_type, value.ndim, "C", aligned=True)


def lane_array(shape: tuple[int, ...]) -> LaneArray:
    """Zeros for four runs, of the shape of one run's array."""
    size = 8 * LANES * math.prod(shape)
    memory = np.zeros(size + _ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % _ALIGNMENT
    record = memory[start : start + size].view(np.dtype((np.void, 8 * LANES)))
    return record.reshape(shape).view(LaneArray)


def runs_of(array: np.ndarray) -> np.ndarray:
    """View a `LaneArray` as floats, with the lane as last dimension."""
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
    return _broadcast(builder, context.cast(builder, value, of, types.float64), VECTOR)


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
_COMPARED = ("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "=="), ("ne", "!=")
for _name, _sign in _COMPARED:
    _operator(
        getattr(operator, _name),
        # A number is unequal to none.
        lambda b, x, y, sign=_sign: (b.fcmp_unordered if sign == "!=" else b.fcmp_ordered)(
            sign, x, y
        ),
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
            kind = ir.FunctionType(VECTOR, [VECTOR])
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
