"""Kernels: functions that are compiled, called from each other, and from Python as C functions."""

import ctypes
import functools
import inspect
import os
from collections.abc import Callable
from typing import Any

from archfrag.physics.kernels.structs import Source, class_of, describe

# Whether kernels are compiled; the variable makes them plain functions, to be debugged.
COMPILED = (os.environ.get("NUMBA_DISABLE_JIT") or "0") == "0"
_C = {
    "f8": ctypes.c_double,
    "i8": ctypes.c_int64,
    "b1": ctypes.c_uint8,
    "none": ctypes.c_void_p,
}


class Kernel(Source):
    """A compiled function; in a call from Python its arguments decide which version is made."""

    def __init__(self, py_func: Callable, inline: bool) -> None:
        super().__init__(py_func, inline)
        functools.update_wrapper(self, py_func)
        self._entries: dict[Any, Callable] = {}

    def __repr__(self) -> str:
        return f"<kernel {self.name}>"

    def __call__(self, *args, **named):
        """Call the kernel without Python's lock."""
        if named or len(args) < self.py_func.__code__.co_argcount:
            bound = inspect.signature(self.py_func).bind(*args, **named)
            bound.apply_defaults()
            args = bound.args
        key = tuple(map(describe, args))
        entry = self._entries.get(key)
        if entry is None:
            from archfrag.physics.kernels.load import load

            address, returned = load(self, key)
            entry = self._entries[key] = _entry(address, key, returned)
        return entry(args)


def kernel(py_func: Callable, inline: bool = False):
    """Decorate a function that numba compiles; if `inline`, into every caller."""
    return Kernel(py_func, inline) if COMPILED else py_func


# LLVM puts these into their callers whatever their size.
inlined = functools.partial(kernel, inline=True)


def _entry(address: int, descriptions, returned) -> Callable[[tuple], Any]:
    """Return a function that calls a kernel's machine code with a tuple of arguments.

    `descriptions` are those of the arguments, `returned` is that of the result. numba's code
    returns whether it failed, and takes the addresses of the result and of an exception before its
    arguments.
    """
    kinds: list[Any] = []
    takes = [_passed(each, kinds) for each in descriptions]
    of_result = _c_type(returned)
    call = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *kinds)(
        address
    )

    def enter(args: tuple):
        result = of_result()
        error = ctypes.c_void_p()
        values: list[Any] = []
        for take, value in zip(takes, args, strict=True):
            take(value, values)
        if call(ctypes.addressof(result), ctypes.addressof(error), *values):
            raise ZeroDivisionError("a kernel failed")
        return _read(result, returned)

    return enter


def _passed(of, kinds: list[Any]) -> Callable[[Any, list], None]:
    """Append the C types of an argument to `kinds`; return a function that appends its values.

    `of` is the description of the argument. The function takes the argument, and the list of
    values to which it appends.
    """
    if of[0] == "array":
        kinds += [ctypes.c_void_p] * 2 + [ctypes.c_int64] * 2 + [ctypes.c_void_p]
        kinds += [ctypes.c_int64] * (2 * of[2])

        def take_array(value, values: list) -> None:
            values += [None, None, value.size, value.itemsize, value.ctypes.data]
            values += [*value.shape, *value.strides]

        return take_array
    if of[0] == "tuple":
        takes = [_passed(each, kinds) for each in of[2:]]

        def take_tuple(value, values: list) -> None:
            for take, each in zip(takes, value, strict=True):
                take(each, values)

        return take_tuple
    if of[0] == "struct":
        kinds.append(ctypes.c_void_p)
        return lambda value, values: values.append(value.address)
    kinds.append(_C[of])
    return lambda value, values: values.append(value)


@functools.cache
def _c_type(of):
    if of[0] != "tuple":
        return _C[of]
    fields = [(f"f{k}", _c_type(each)) for k, each in enumerate(of[2:])]
    return type("Returned", (ctypes.Structure,), {"_fields_": fields})


def _read(result, of):
    if of[0] == "tuple":
        parts = [getattr(result, f"f{k}") for k in range(len(of) - 2)]
        read = [_read(part, each) for part, each in zip(parts, of[2:], strict=True)]
        return class_of(of[1])(*read) if of[1] else tuple(read)
    if of == "none":
        return None
    value = getattr(result, "value", result)
    return bool(value) if of == "b1" else value
