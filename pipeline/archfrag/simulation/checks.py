"""Refusals: one sentence that names the argument."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.methods.registry import AUTO, METHODS, MethodInfo, resolve


def method_names() -> tuple[str, ...]:
    """What a user may name as the method, from the registry."""
    return tuple(dict.fromkeys([AUTO, *METHODS]))


def step_of(info: MethodInfo) -> float:
    """Time step [s] of a method, or that of time stepping, to which the others hand over."""
    own = [p.default for p in info.parameters if p.name == "dt"]
    return own[0] if own else step_of(METHODS["time_stepping"])


def check_arch(arch: Any) -> None:
    """See that it is an `Arch`.

    Raises
    ------
    InputError
    """
    if not isinstance(arch, Arch):
        raise InputError(f"arch is {type(arch).__name__}; it must be an archfrag Arch or Block")


def check_method(name: Any) -> MethodInfo:
    """The method of a name.

    Raises
    ------
    InputError
        With the names that are allowed.
    """
    info = resolve(name) if isinstance(name, str) else None
    if info is None:
        raise InputError(f"method is {name!r}; allowed are {', '.join(method_names())}")
    return info


def check_number(name: str, value: Any, allowed: str, fits: Callable[[float], bool]) -> None:
    """See that a value is a number that `fits`; `allowed` says in words what that means.

    Raises
    ------
    InputError
    """
    try:
        good = not isinstance(value, bool) and fits(float(value))
    except (TypeError, ValueError):
        good = False
    if not good:
        raise InputError(f"{name} is {value!r}; it must be a number, {allowed}")


def check_initial(initial: Any, n_voussoir: int) -> tuple[NDArray, NDArray]:
    """Displacement and velocity as arrays, each (n_voussoir, 3).

    Raises
    ------
    InputError
        If they have another shape or hold anything that is not finite.
    """
    try:
        shift, velocity = (np.array(part, float) for part in initial)
    except (TypeError, ValueError) as error:
        raise InputError("initial must be a pair of arrays: position and velocity") from error
    for name, part in (("position", shift), ("velocity", velocity)):
        if part.shape != (n_voussoir, 3) or not np.isfinite(part).all():
            raise InputError(
                f"initial {name} has shape {part.shape}; it must be ({n_voussoir}, 3) and finite"
            )
    return shift, velocity
