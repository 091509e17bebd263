"""Checks of what a run is asked for: one message that names the argument."""

import importlib.util
import math
from collections.abc import Mapping
from typing import Any

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.physics.kernels.kernel import COMPILED
from archfrag.physics.methods.registry import (
    AUTO,
    METHODS,
    OF_FACES,
    MethodInfo,
    Parameter,
    known_methods,
)

LOSS_LIMIT = 0.5  # gap at both corners of a joint, over its length, that ends a run [1]
# Parameters of methods that are arguments of `simulate`.
COMMON = ("dt", "rtol", "follow")


def method_names() -> tuple[str, ...]:
    """Return the names of the methods that a study may use."""
    return tuple(dict.fromkeys([AUTO, *METHODS]))


def default_of(info: MethodInfo, name: str) -> float:
    """Return default of a setting; that of time stepping, or of auto, for a method without it."""
    methods = (METHODS[AUTO], METHODS["time_stepping"], info)
    return {p.name: p.default for method in methods for p in method.parameters}[name]


def is_available(info: MethodInfo) -> bool:
    """Return whether the package that a method needs, if any, is installed."""
    return info.needs is None or importlib.util.find_spec(info.needs) is not None


def available_methods() -> tuple[str, ...]:
    """Return the names of the methods that can run here, in the registry's order."""
    return tuple(name for name, info in known_methods().items() if is_available(info))


def check_method(name: Any) -> MethodInfo:
    """Return method of a name; `InputError` if there is none, or its package is not installed."""
    info = known_methods().get(name) if isinstance(name, str) else None
    if info is None:
        raise InputError(f"method is {name!r}; allowed are {', '.join(method_names())}")
    if not is_available(info):
        raise InputError(
            f"method {name} needs the package {info.needs}: pip install {info.needs}"
        )
    return info


def check_compiled(plain: bool) -> None:
    """See that kernels are compiled, unless a run is `plain`: by itself, and by time steps."""
    if not (plain or COMPILED):
        raise InputError(
            "NUMBA_DISABLE_JIT is set, so kernels are not compiled; without them there are single "
            "simulations by method time_stepping only; unset NUMBA_DISABLE_JIT"
        )


def own_parameters(info: MethodInfo) -> dict[str, Parameter]:
    """Return the parameters of a method that no argument of `simulate` gives."""
    return {p.name: p for p in info.parameters if p.name not in COMMON}


def check_taken(info: MethodInfo, **given: Any) -> None:
    """See that a method uses each of `COMMON` that is given; None stands for not given."""
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
    """See that the joints of an arch are rigid, which something needs."""
    if arch.chain.joint is not None:
        raise InputError(
            f"{what} needs rigid joints; give them joints.model inset, not face"
        )


def check_can_run(arch: Arch, info: MethodInfo, far: Any) -> None:
    """See that a method takes the joints of an arch, and that a motion `far`, of its right
    springing, meets one.
    """
    if info.name not in OF_FACES:
        check_rigid(arch, f"method {info.name}")
    if far is not None and arch.free_end:
        raise InputError(
            "far, method.delay in a study file, is given, but the arch has no right springing; "
            "leave it out, or give arches with a free end a study of their own"
        )


def check_settings(info: MethodInfo, settings: Any) -> dict[str, float]:
    """Return a method's own parameters: those given, if allowed, and defaults of the others."""
    own = own_parameters(info)
    if not isinstance(settings, Mapping | None):
        raise InputError(
            f"settings is {type(settings).__name__}; it must map names to numbers"
        )
    for name, value in (settings or {}).items():
        if name not in own:
            allowed = ", ".join(own) or "none"
            raise InputError(
                f"settings has {name!r}; allowed for method {info.name}: {allowed}"
            )
        check_number(
            f"settings.{name}", value, own[name].least, own[name].most, own[name].unit
        )
    given = {name: float(value) for name, value in (settings or {}).items()}
    return {name: parameter.default for name, parameter in own.items()} | given


def check_number(
    name: str, value: Any, least: float, most: float, unit: str = "1"
) -> None:
    """See that a value is a finite number between bounds, which are allowed themselves."""
    try:
        good = (
            not isinstance(value, bool)
            and math.isfinite(value)
            and least <= value <= most
        )
    except TypeError:
        good = False
    if not good:
        between = "" if math.isinf(least) else f" from {least:g} to {most:g} [{unit}]"
        raise InputError(f"{name} is {value!r}; it must be a finite number{between}")
