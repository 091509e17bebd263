"""Checks of the arguments of a run. Each raises InputError, which names the argument."""

import math

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.physics.kernels.kernel import COMPILED
from archfrag.physics.methods.registry import (
    AUTO,
    METHODS,
    BY_STEPS,
    MethodInfo,
    known_methods,
)

LOSS_LIMIT = 0.5  # gap at both corners of a joint, over its length, that ends a run [1]


def method_names() -> tuple[str, ...]:
    """Return the names of the methods that a study may use."""
    return tuple(dict.fromkeys([AUTO, *METHODS]))


def default_of(info: MethodInfo, name: str) -> float:
    """Return the default of a setting of a method.

    If the method does not have it, it is that of time stepping, or else that of auto.
    """
    methods = (METHODS[AUTO], METHODS["time_stepping"], info)
    return {p.name: p.default for method in methods for p in method.parameters}[name]


def check_method(name) -> MethodInfo:
    """Return the method with this name; `InputError` if there is none.

    A `MethodInfo`, as `archbench` gives for a method that it has changed, is returned as it is.
    """
    info = name if isinstance(name, MethodInfo) else known_methods().get(str(name))
    if info is None:
        raise InputError(f"method is {name!r}; allowed are {', '.join(method_names())}")
    return info


def check_compiled(plain: bool) -> None:
    """Raise InputError if kernels are not compiled, unless a run is `plain`.

    A plain run is a single one by time stepping.
    """
    if not (plain or COMPILED):
        raise InputError(
            "NUMBA_DISABLE_JIT is set, so kernels are not compiled; without them there are single "
            "simulations by method time_stepping only; unset NUMBA_DISABLE_JIT"
        )


def check_taken(info: MethodInfo, **given) -> None:
    """Raise InputError unless a method uses each setting that is given; None is not given.

    Time stepping takes either rtol or dt, not both.
    """
    if info.name == "time_stepping" and None not in given.values():
        raise InputError(
            f"rtol is {given['rtol']!r} and dt is {given['dt']!r}; method time_stepping takes one "
            "of them: dt for fixed steps, rtol for steps that follow a tolerance"
        )
    for name, value in given.items():
        methods = known_methods().values()
        takers = [m.name for m in methods if any(p.name == name for p in m.parameters)]
        if value is not None and info.name not in takers:
            raise InputError(
                f"{name} is {value!r}, but method {info.name} does not use it; leave it out, or "
                f"use {', '.join(takers)}"
            )


def check_rigid(arch: Arch, what: str) -> None:
    """Raise InputError unless the joints of an arch are rigid; `what` is what needs them."""
    if arch.chain.joint is not None:
        raise InputError(
            f"{what} needs rigid joints; give them joints.model inset, not face"
        )


def check_can_run(arch: Arch, info: MethodInfo, far) -> None:
    """Raise InputError if a method cannot run an arch.

    It must take elastic joints if the arch has them. `far` is the motion of the right springing,
    which must be None if the arch has a free end.
    """
    if info.name not in BY_STEPS:
        check_rigid(arch, f"method {info.name}")
        if len(arch.spans) > 1:
            raise InputError(
                f"method is {info.name}, which takes one span, but the bridge has "
                f"{len(arch.spans)}; use {' or '.join(BY_STEPS)}"
            )
    if far is not None and arch.free_end:
        raise InputError(
            "far, method.delay in a study file, is given, but the arch has no right springing; "
            "leave it out, or give arches with a free end a study of their own"
        )


def check_number(name: str, value, least: float, most: float, unit: str = "1") -> None:
    """Raise InputError unless a value is a finite number from `least` to `most`."""
    try:
        good = (
            not isinstance(value, bool)
            and math.isfinite(value)
            and least <= value <= most
        )
    except TypeError:
        good = False
    if not good:
        raise InputError(
            f"{name} is {value!r}; it must be a finite number"
            f"{'' if math.isinf(least) else f' from {least:g} to {most:g} [{unit}]'}"
        )
