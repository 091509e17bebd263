"""Checks of the arguments of a run. Each raises InputError, which names the argument."""

import math
import os
from collections.abc import Mapping

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.motions.motion import Motion
from archfrag.physics.kernels.kernel import COMPILED
from archfrag.physics.kernels.primitives import LANES
from archfrag.physics.methods.registry import (
    AUTO,
    BY_STEPS,
    METHODS,
    MethodInfo,
    known_methods,
)

LOSS_LIMIT = 0.5  # gap at both corners of a joint, over its length, that ends a run [1]
SLOWEST = 10.0  # wave [m/s]
FASTEST = 1e6
LATEST = 60.0  # motion of a base [s]


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

    A plain run is a single one by time stepping. InputError too if the environment asks for a
    number of runs side by side that there is not.
    """
    lanes = os.environ.get("ARCHFRAG_LANES", "")
    if lanes not in ("", *map(str, LANES)):
        raise InputError(
            f"ARCHFRAG_LANES is {lanes!r}; it must be 4 or 8, the number of runs side by side, or "
            "unset"
        )
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


def base_positions(arch: Arch) -> dict[str, float]:
    """Return the x of the middle of each base of an arch by its name, from left to right [m]."""
    faces = arch.chain.face_before, arch.chain.face_after
    return {
        name: float(faces[side][joint, :, 0].mean())
        for name, (joint, side) in arch.bases.items()
    }


def check_bases(arch: Arch, wave_speed, bases) -> None:
    """Raise InputError unless bases of an arch can move as given; see `simulate`."""
    if wave_speed is None and not bases:
        return
    if wave_speed is not None and bases:
        raise InputError(
            "wave_speed and bases are both given; give all bases a wave_speed, or some bases "
            "motions of their own"
        )
    key = "bases" if bases else "wave_speed"
    names = list(base_positions(arch))[1:]
    if not names:
        raise InputError(
            f"{key}, method.{key} in a study file, is given, but the arch has no right base; "
            "leave it out, or give arches with a free end a study of their own"
        )
    if not bases:
        check_number("wave_speed", wave_speed, -FASTEST, FASTEST, "m/s")
        check_number("size of wave_speed", abs(wave_speed), SLOWEST, FASTEST, "m/s")
        return
    if not isinstance(bases, Mapping):
        raise InputError(
            f"bases is {bases!r}; it must be a mapping of names to motions or delays [s]"
        )
    for name, given in bases.items():
        if name not in names:
            raise InputError(
                f"bases has {name!r}; allowed for this arch are {', '.join(names)}"
            )
        if not isinstance(given, Motion):
            check_number(f"bases.{name}", given, -LATEST, LATEST, "s")


def check_can_run(arch: Arch, info: MethodInfo, wave_speed=None, bases=None) -> None:
    """Raise InputError if a method cannot run an arch, or bases cannot move as given.

    A method must take elastic joints, or several spans, if the arch has them.
    """
    if info.name not in BY_STEPS:
        check_rigid(arch, f"method {info.name}")
        if len(arch.spans) > 1:
            raise InputError(
                f"method is {info.name}, which takes one span, but the bridge has "
                f"{len(arch.spans)}; use {' or '.join(BY_STEPS)}"
            )
    check_bases(arch, wave_speed, bases)


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
