"""Types and LLVM code of structs, kernels and numbers of several runs, for numba."""

import functools
import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import typeof, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    lower_builtin,
    lower_cast,
    lower_getattr_generic,
    models,
    register_model,
    type_callable,
)

from archfrag.physics.kernels import primitives, structs
from archfrag.physics.kernels.primitives import LANES
from archfrag.physics.kernels.structs import class_of, fields_of, name_of, words_of

_WORD = ir.IntType(64)
_DOUBLE = ir.DoubleType()
_INDEX = ir.IntType(32)


class _Several(types.Type):
    """Type of numbers or truth values of several runs; a plain value becomes equal ones."""

    item: ir.Type
    plain: Any

    def __init__(self, count: int) -> None:
        self.count = count
        self.vector = ir.VectorType(self.item, count)
        super().__init__(name=f"{type(self).__name__}{count}")

    def unify(self, typingctx, other):
        """Return this type if one path gives it and another one a plain value; else None."""
        return self if isinstance(other, self.plain) else None

    def can_convert_from(self, typingctx, other):
        """Return how safely a plain value converts: as an integer to a float.

        None for a value of another type.
        """
        safe = typingctx.can_convert(types.int32, types.float64)
        return safe if isinstance(other, self.plain) else None


class _Lanes(_Several):
    item = _DOUBLE
    plain = types.Float | types.Integer | types.IntEnumMember


class _Mask(_Several):
    item = ir.IntType(1)
    plain = types.Boolean


lanes = {count: _Lanes(count) for count in LANES}
masks = {count: _Mask(count) for count in LANES}


def _represent(kind: type[_Several], plain, of) -> None:
    @register_model(kind)
    class _Model(models.PrimitiveModel):
        def __init__(self, manager, of) -> None:
            super().__init__(manager, of, of.vector)

    @lower_cast(types.IntEnumMember, kind)
    @lower_cast(plain, kind)
    def broadcast(context, builder, given, to, value):
        nothing = ir.Constant(to.vector, ir.Undefined)
        zero = ir.Constant(_INDEX, 0)
        first = builder.insert_element(
            nothing, context.cast(builder, value, given, of), zero
        )
        everywhere = ir.Constant(ir.VectorType(_INDEX, to.count), [0] * to.count)
        return builder.shuffle_vector(first, nothing, everywhere)


@lower_cast(types.IntEnumMember, types.Float)
def _number_of(context, builder, of, to, value):
    return context.cast(builder, value, of.dtype, to)


_represent(_Lanes, types.Number, types.float64)
_represent(_Mask, types.Boolean, types.boolean)


def _define(function: Callable, choose: Callable) -> None:
    """Define `function` for kernels.

    `choose` takes the types of its arguments. It returns its signature and the function that emits
    its code, or None for types that it does not take.
    """

    @functools.wraps(choose)
    def signature_of(*args):
        found = choose(*args)
        return found and found[0]

    type_callable(function)(lambda context: signature_of)

    @lower_builtin(function, types.VarArg(types.Any))
    def lower(context, builder, sig, args):
        return choose(*sig.args)[1](builder, *args)


def _first(kind: type[_Several], *args):
    """Return the first of several types that is of a kind; None if none is."""
    return next((each for each in args if isinstance(each, kind)), None)


def _binary(kind: type[_Several], emit: Callable, result, x, y):
    of = _first(kind, x, y)
    if of is None or not all(a == of or isinstance(a, of.plain) for a in (x, y)):
        return None
    return (result[of.count] if result else of)(of, of), emit


def _unary(emit: Callable, x):
    return (x(x), emit) if isinstance(x, _Lanes) else None


def _intrinsic(name: str, builder, *args):
    kind = args[0].type
    suffix = ".f64" if kind == _DOUBLE else f".v{kind.count}f64"
    of = ir.FunctionType(kind, [kind] * len(args))
    return builder.call(builder.module.declare_intrinsic(name + suffix, (), of), args)


def _compare(sign: str, builder, x, y):
    # Nan is unequal to every number.
    compare = builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered
    return compare(sign, x, y)


for _name, _of, _emit in (
    ("add", _Lanes, ir.IRBuilder.fadd),
    ("sub", _Lanes, ir.IRBuilder.fsub),
    ("mul", _Lanes, ir.IRBuilder.fmul),
    ("truediv", _Lanes, ir.IRBuilder.fdiv),
    ("and_", _Mask, ir.IRBuilder.and_),
    ("or_", _Mask, ir.IRBuilder.or_),
    ("xor", _Mask, ir.IRBuilder.xor),
):
    for _form in (_name, f"i{_name.strip('_')}"):
        _define(getattr(operator, _form), functools.partial(_binary, _of, _emit, None))
for _name, _sign in zip(
    ("lt", "le", "gt", "ge", "eq", "ne"), ("<", "<=", ">", ">=", "==", "!=")
):
    _emit = functools.partial(_compare, _sign)
    _define(getattr(operator, _name), functools.partial(_binary, _Lanes, _emit, masks))
for _function, _emit in (
    (operator.neg, ir.IRBuilder.fneg),
    (math.sqrt, functools.partial(_intrinsic, "llvm.sqrt")),
    (abs, functools.partial(_intrinsic, "llvm.fabs")),
):
    _define(_function, functools.partial(_unary, _emit))


def _fused(x, y, z):
    kind = _first(_Lanes, x, y, z) or types.float64
    return kind(kind, kind, kind), functools.partial(_intrinsic, "llvm.fmuladd")


def _select(condition, x, y):
    several = isinstance(condition, _Mask)
    kind = lanes[condition.count] if several else types.float64
    return kind(condition, kind, kind), ir.IRBuilder.select


def _some(x):
    if not isinstance(x, _Mask):
        return types.boolean(types.boolean), lambda b, value: value
    whole = ir.IntType(x.count)
    none = ir.Constant(whole, 0)
    return types.boolean(x), lambda b, x: b.icmp_unsigned(
        "!=", b.bitcast(x, whole), none
    )


def _opposite(x):
    kind = x if isinstance(x, _Mask) else types.boolean
    return kind(kind), ir.IRBuilder.not_


def _width(x):
    return types.intp(x), lambda b, x: ir.Constant(_WORD, getattr(x.type, "count", 1))


def _lane(x, number):
    if not isinstance(x, _Several):
        return x(x, types.intp), lambda b, value, at: value
    kind = types.float64 if isinstance(x, _Lanes) else types.boolean
    return kind(x, types.intp), ir.IRBuilder.extract_element


def _with_lane(x, number, value):
    if not isinstance(x, _Several):
        return value(x, types.intp, value), lambda b, old, at, new: new
    kind = types.float64 if isinstance(x, _Lanes) else types.boolean
    return x(x, types.intp, kind), lambda b, old, at, new: b.insert_element(
        old, new, at
    )


def _struct_at(tables, row, like):
    def emit(builder, array, row, given):
        start = builder.extract_value(array, 4)
        stride = builder.extract_value(array, (6, 0))
        at = builder.add(builder.ptrtoint(start, _WORD), builder.mul(row, stride))
        return builder.inttoptr(at, given.type)

    return like(tables, types.intp, like), emit


_functions: Any = (
    (primitives.fused, _fused),
    (primitives.select, _select),
    (primitives.some, _some),
    (primitives.opposite, _opposite),
    (primitives.width, _width),
    (primitives.lane, _lane),
    (primitives.with_lane, _with_lane),
    (structs.struct_at, _struct_at),
)
for _function, _choose in _functions:
    _define(_function, _choose)


class StructType(types.Type):
    """Type of a struct.

    `fields` has description, type, known shape and first word of each field.
    """

    def __init__(self, description) -> None:
        self.fields = {}
        found = fields_of(description)
        arrays = tuple(name for name, of, *_ in found if of[0] == "array")
        for name, of, shape, place in found:
            kind = type_of(of)
            if name in arrays:
                kind = FieldType(kind, description[1], name, arrays)
            self.fields[name] = of, kind, shape, place
        super().__init__(name=repr(description))


_TYPES: dict[Any, Any] = {
    "f8": types.float64,
    "i8": types.int64,
    "b1": types.boolean,
    "none": types.none,
    "i4": types.int32,
    "i1": types.int8,
    "c16": types.complex128,
    **{f"lanes{count}": kind for count, kind in lanes.items()},
}


def type_of(description):
    """Return numba's type of what `structs.describe` has described."""
    found = _TYPES.get(description)
    if found is None:
        kind, name, *others = description
        if kind == "array":
            found = types.Array(_TYPES[name], others[0], others[1], aligned=True)
        elif kind == "struct":
            found = StructType(description)
        elif kind == "kernel":
            found = typeof(class_of(name))
        else:
            parts = [type_of(each) for each in others]
            of = {True: types.NamedUniTuple, False: types.NamedTuple}[
                len(set(parts)) == 1
            ]
            given = (parts[0], len(parts)) if of is types.NamedUniTuple else (parts,)
            found = of(*given, class_of(name)) if name else types.Tuple(parts)
        _TYPES[description] = found
    return found


def _parts(of) -> tuple[Any, ...]:
    return tuple(of)


def description_of(of):
    """Describe a type that a kernel returns."""
    if isinstance(of, types.BaseTuple):
        kind = getattr(of, "instance_class", tuple)
        return ("tuple", name_of(kind), *map(description_of, _parts(of)))
    of = types.int64 if isinstance(of, types.Integer) else of
    found = {
        "f8": types.float64,
        "i8": types.int64,
        "b1": types.boolean,
        "none": types.none,
    }
    for name, each in found.items():
        if each == of:
            return name
    raise NotImplementedError(f"kernels cannot return {of} to Python")


class FieldType(types.Array):
    """Type of an array that is a field of a struct; LLVM learns that fields share no memory."""

    def __init__(
        self, of: types.Array, struct: str, name: str, siblings: tuple[str, ...]
    ) -> None:
        self.plain = of
        self.scope = (struct, name)
        self.siblings = siblings
        super().__init__(of.dtype, of.ndim, "C", name=f"{of} {struct}.{name}")

    @property
    def key(self):
        """Return what tells this type from others."""
        return self.plain.key, self.scope


def plain(of):
    """Return the type with which a value is passed on to another kernel or to numba's code."""
    return of.plain if isinstance(of, FieldType) else types.unliteral(of)


register_model(FieldType)(models.ArrayModel)
lower_cast(FieldType, types.Array)(lambda context, builder, of, to, value: value)


def _item(context, builder, of: FieldType, array, index, given):
    """Return the address of an item of a field, and its metadata.

    The address is None unless `index` is an integer for each dimension.
    """
    several = isinstance(index, types.BaseTuple)
    kinds = index.types if several else (index,)
    if len(kinds) != of.ndim or not all(
        isinstance(each, types.Integer) for each in kinds
    ):
        return None, ()
    at: Any = ir.Constant(_WORD, 0)
    for k, kind in enumerate(kinds):
        size = builder.extract_value(array, (5, k))
        value = builder.extract_value(given, k) if several else given
        value = context.cast(builder, value, kind, types.intp)
        if kind.signed:  # counted from the end
            below = builder.icmp_signed("<", value, ir.Constant(_WORD, 0))
            value = builder.select(below, builder.add(value, size), value)
        at = builder.add(builder.mul(at, size), value)
    pointer = builder.gep(builder.extract_value(array, 4), [at], inbounds=True)
    struct, name = of.scope
    node = builder.module.add_metadata
    domain = builder.module.add_metadata([struct])
    scopes = {each: node([f"{struct}.{each}", domain]) for each in of.siblings}
    others = node([scope for each, scope in scopes.items() if each != name])
    return pointer, (("alias.scope", node([scopes[name]])), ("noalias", others))


@lower_builtin(operator.getitem, FieldType, types.Integer)
@lower_builtin(operator.getitem, FieldType, types.SliceType)
@lower_builtin(operator.getitem, FieldType, types.BaseTuple)
def _get_item(context, builder, sig, args):
    of, index = sig.args
    pointer, metadata = _item(context, builder, of, args[0], index, args[1])
    if pointer is None:
        plain = sig.return_type(of.plain, index)
        return context.get_function(operator.getitem, plain)(builder, args)
    loaded = builder.load(pointer)
    for kind, node in metadata:
        loaded.set_metadata(kind, node)
    return context.get_data_as_value(builder, of.dtype, loaded)


@lower_builtin(operator.setitem, FieldType, types.Any, types.Any)
def _set_item(context, builder, sig, args):
    of, index, kind = sig.args
    pointer, metadata = _item(context, builder, of, args[0], index, args[1])
    if pointer is None:
        plain = types.none(of.plain, index, kind)
        return context.get_function(operator.setitem, plain)(builder, args)
    value = context.cast(builder, args[2], kind, of.dtype)
    stored = builder.store(context.get_value_as_data(builder, of.dtype, value), pointer)
    for name, node in metadata:
        stored.set_metadata(name, node)
    return context.get_dummy_value()


register_model(StructType)(models.OpaqueModel)


@infer_getattr
class _Fields(AttributeTemplate):
    key = StructType

    def generic_resolve(self, of, name: str):  # type: ignore[override]
        return of.fields[name][1] if name in of.fields else None


@lower_getattr_generic(StructType)
def _field(context, builder, of, value, name: str):
    description, kind, shape, place = of.fields[name]
    table = builder.bitcast(value, _WORD.as_pointer())
    if not isinstance(kind, types.BaseTuple):
        return _loaded(context, builder, table, place, kind, shape)
    parts = []
    for each, part in zip(description[2:], _parts(kind), strict=True):
        parts.append(_loaded(context, builder, table, place, part, shape))
        place += words_of(each, shape)
    return context.make_tuple(builder, kind, parts)


def _word(builder, table, place: int, kind=_WORD):
    at = builder.gep(table, [ir.Constant(_WORD, place)], inbounds=True)
    loaded = builder.load(builder.bitcast(at, kind.as_pointer()))
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded


def _loaded(context, builder, table, place: int, of, shape):
    """Load a number, a struct or an array from word `place` of a struct's table.

    Sizes of an array are loaded from the words behind it; the last ones are those in `shape`.
    """
    if of == types.boolean:
        return builder.trunc(_word(builder, table, place), ir.IntType(1))
    if not isinstance(of, types.Array):
        return _word(builder, table, place, context.get_value_type(of))
    item = context.get_data_type(of.dtype)
    size = ir.Constant(_WORD, context.get_abi_sizeof(item))
    sizes = [_word(builder, table, place + 1 + k) for k in range(of.ndim - len(shape))]
    sizes += [ir.Constant(_WORD, n) for n in shape]
    strides = [size]
    count = ir.Constant(_WORD, 1)
    for k in range(of.ndim - 1, 0, -1):
        strides.insert(0, builder.mul(strides[0], sizes[k]))
    for n in sizes:
        count = builder.mul(count, n)
    array = context.make_array(of)(context, builder)
    array.data = _word(builder, table, place, item.as_pointer())
    array.nitems = count
    array.itemsize = size
    packed = ir.Constant(ir.ArrayType(_WORD, of.ndim), ir.Undefined)
    for name, values in (("shape", sizes), ("strides", strides)):
        whole = packed
        for k, value in enumerate(values):
            whole = builder.insert_value(whole, value, k)
        setattr(array, name, whole)
    return array._getvalue()
