"""Named tuples that kernels get as one pointer, and descriptions of all that kernels get.

numba passes a named tuple by value: five numbers and two for each dimension of every array, some
hundreds for a chain's state and workspace, in each call. A class decorated by `struct` is passed
as the address of a table instead, from which a kernel loads what it uses: the data pointer of an
array, and those of its sizes that are not constants of the class.
"""

import functools
import importlib
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from archfrag.physics.kernels.primitives import LaneArray

_SCALARS = {float: "f8", int: "i8", bool: "b1"}
_NAMES = {"float": float, "int": int, "bool": bool}


class Source:
    """A Python function that numba compiles; if `inline`, into every caller."""

    def __init__(self, py_func: Callable, inline: bool) -> None:
        self.py_func = py_func
        self.inline = inline
        self.name = f"{py_func.__module__}:{py_func.__qualname__}"


def struct(**shapes: tuple[int, ...]) -> Callable[[type], Any]:
    """Decorate a class of named tuples whose fields are arrays, numbers, structs, or tuples.

    A tuple may hold arrays or kernels. `shapes` are the sizes of arrays behind their first
    dimension, where the class determines them. Entries may not be replaced, and a kernel may not
    be given other sizes later. A struct equals only itself, so that `functools.lru_cache` keeps
    what follows from it.
    """

    def decorate(given):
        members = {"__module__": given.__module__, "__qualname__": given.__qualname__}
        members |= {"__doc__": given.__doc__, "shapes": shapes}
        members["numbers"] = tuple(
            _SCALARS.get(_NAMES.get(of, of)) for of in given.__annotations__.values()
        )
        members["description"] = functools.cached_property(_describe_struct)
        members["table"] = functools.cached_property(_table)
        members["address"] = property(lambda self: int(self.table.ctypes.data))
        members |= {"__eq__": object.__eq__, "__hash__": object.__hash__}
        members["__getstate__"] = lambda self: None  # addresses are of this process
        return type(given.__name__, (given,), members)

    return decorate


def describe(value):
    """Return a description of the type of a kernel's argument: a string or a tuple.

    A tuple holds strings, numbers and other descriptions. Raise TypeError if kernels do not take
    the value.
    """
    kind = type(value)
    if hasattr(kind, "shapes"):
        return value.description
    if isinstance(value, np.ndarray):
        lanes = isinstance(value, LaneArray)
        of = f"lanes{value.itemsize // 8}" if lanes else value.dtype.str[1:]
        return ("array", of, value.ndim, "C" if value.flags.c_contiguous else "A")
    if isinstance(value, Source):
        return ("kernel", value.name)
    if isinstance(value, tuple):
        return ("tuple", name_of(kind), *map(describe, value))
    if value is None:
        return "none"
    if isinstance(value, bool | np.bool_):
        return "b1"
    if isinstance(value, int | np.integer):
        return "i8"
    if isinstance(value, float | np.floating):
        return "f8"
    raise TypeError(f"a kernel cannot be given {kind.__name__}: {value!r}")


def name_of(kind: type) -> str:
    """Return the name by which `class_of` finds a class of tuples; empty for plain tuples."""
    return "" if kind is tuple else f"{kind.__module__}:{kind.__qualname__}"


@functools.cache
def class_of(name: str):
    """Return the class or kernel of a name: its module, a colon, and its name there."""
    module, _, names = name.partition(":")
    return functools.reduce(getattr, names.split("."), importlib.import_module(module))


def words_of(description, shape: tuple[int, ...] = ()) -> int:
    """Return the number of words that a field takes in a struct's table.

    An array takes one for its data pointer and one for each size that is not fixed; `shape` has
    the sizes that its class fixes. A tuple takes the sum of its entries, anything else one word.
    """
    if description[0] == "array":
        return 1 + int(description[2]) - len(shape)
    if description[0] == "tuple":
        return sum(words_of(each, shape) for each in description[2:])
    return 1


def fields_of(description) -> list[tuple[str, Any, tuple[int, ...], int]]:
    """Return the fields of a struct: name, description, known shape, and first word in its table.

    The known shape has the sizes of an array that the class determines.
    """
    kind = class_of(description[1])
    place = 0
    found = []
    for name, each in zip(kind._fields, description[2:], strict=True):
        shape = kind.shapes.get(name, ())
        found.append((name, each, shape, place))
        place += words_of(each, shape)
    return found


def place_of(value, name: str) -> int:
    """Return the first word of field `name` in a struct's table.

    It is an array's data pointer, and sizes follow it.
    """
    return next(
        place for each, _, _, place in fields_of(value.description) if each == name
    )


def struct_at(tables, row: int, like):
    """Return the struct whose table begins row `row` of `tables`, of the type of `like`.

    Only compiled kernels can do so; Python raises TypeError.
    """
    raise TypeError("only compiled kernels find a struct by its table")


def _describe_struct(value):
    entries = zip(value, value.numbers, strict=True)
    return (
        "struct",
        name_of(type(value)),
        *(known or describe(each) for each, known in entries),
    )


def _table(value):
    """Return the table of a struct; it is made once and kept with the struct."""
    fields = fields_of(value.description)
    _refuse_shared(value)
    _, last, shape, place = fields[-1]
    table = np.zeros(place + words_of(last, shape), np.int64)
    for (_, of, shape, place), entry in zip(fields, value, strict=True):
        _fill(table, place, of, shape, entry)
    return table


def _refuse_shared(value) -> None:
    """Raise ValueError if two arrays of a struct share memory; LLVM takes them as separate."""
    ends = sorted(
        (np.lib.array_utils.byte_bounds(entry), name)
        for name, entry in zip(value._fields, value)
        if isinstance(entry, np.ndarray) and entry.size
    )
    for ((_, end), one), ((start, _), other) in itertools.pairwise(ends):
        if start < end:
            raise ValueError(
                f"{one} and {other} of a {type(value).__name__} share memory"
            )


def _fill(table, place: int, of, shape: tuple[int, ...], entry) -> None:
    if of[0] == "array":
        free = entry.ndim - len(shape)
        if entry.shape[free:] != shape or not entry.flags.c_contiguous:
            raise ValueError(
                f"an array of a struct has shape {entry.shape}, or has gaps"
            )
        table[place] = entry.ctypes.data
        table[place + 1 : place + 1 + free] = entry.shape[:free]
    elif of[0] == "tuple":
        for part, each in zip(entry, of[2:], strict=True):
            _fill(table, place, each, shape, part)
            place += words_of(each, shape)
    elif of[0] == "struct":
        table[place] = entry.address
    elif of == "f8":
        table.view(np.float64)[place] = entry
    elif of[0] != "kernel" and entry is not None:
        table[place] = int(entry)
