"""Springings that have moved before a record, and springings with motions of their own.

An arch follows a slow movement of a springing in equilibrium, or falls.
"""

import math
from typing import NamedTuple

import numpy as np

from archfrag.arch import Arch
from archfrag.arch.checks import FloatArray
from archfrag.arch.quasi_static import HOLDS, STEP, SlowArch
from archfrag.errors import InputError, StabilityError
from archfrag.motions.motion import Motion
from archfrag.simulation.arguments import check_number
from archfrag.simulation.rest import onset
from archfrag.simulation.standing import check_stands

# motion of the right springing, or how much later it is [s]
Far = Motion | float | None
LATEST = 60.0  # [s]


class Ground(NamedTuple):
    """A ground motion for kernels."""

    horizontal: FloatArray  # (n,) acceleration of the left springing [m/s2]
    vertical: FloatArray | None  # (n,) upwards
    dt: float  # [s]
    # (n, 2) x, y: acceleration of the right springing less that of the left one; None if alike
    apart: FloatArray | None = None
    noted: float = 0.0  # when a run notes whether the arch still moves; 0: never [s]


class SpringingPath(NamedTuple):
    """What `springing_path` finds of an arch while one of its springings moves."""

    part: FloatArray  # (n,) of the movement, from 0 to 1
    plus: FloatArray  # (n,) onset with the ground accelerating towards +x [g]
    minus: FloatArray  # (n,) onset with the ground accelerating towards -x [g]
    arch: Arch | None  # at the end; None if it falls before
    limit: float  # part of the movement at which it falls; inf if it does not


def springing_path(
    arch: Arch,
    spread: float = 0.0,
    settlement: float = 0.0,
    rotation: float = 0.0,
    springing: str = "right",
) -> SpringingPath:
    """Follow an arch in equilibrium while a springing moves slowly.

    Hinges open, and joints slide where friction is limited, as in the contact problem of the
    chain without inertia. The arch falls where no reactions hold it at rest any more (static
    theorem, in its geometry of that moment).

    Parameters
    ----------
    arch : Arch
    spread : float
        Movement away from the other springing [m]; negative towards it.
    settlement : float
        Movement downwards [m].
    rotation : float
        About the middle of the springing joint, positive if its extrados goes down [degrees].
    springing : str
        Which one moves: "left" or "right"; of an arch on piers the base of that pier.

    Returns
    -------
    SpringingPath
        part (n,), of the movement; plus and minus (n,), onset on the way [g]; arch, at rest at the
        end, None if it falls before; limit, part at which it falls, inf if it does not fall.

    Raises
    ------
    InputError, StabilityError
        If a movement is larger than the arch, or the arch does not stand before.

    Examples
    --------
    >>> import archfrag as af
    >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
    >>> path = af.springing_path(arch, spread=0.3)
    >>> path.limit, bool(path.plus[-1] < path.plus[0])
    (inf, True)
    """
    right = springing == "right"
    if springing not in ("left", "right") or (right and arch.free_end):
        raise InputError(
            f"springing = {springing!r} must be left{'' if arch.free_end else ' or right'}"
        )
    size = arch.extent.max()
    check_number("spread", spread, -size, size, "m")
    check_number("settlement", settlement, -size, size, "m")
    check_number("rotation", rotation, -45.0, 45.0, "degrees")
    check_stands(arch)
    slow = SlowArch(arch)
    outwards = 1.0 if right else -1.0
    move = np.array([outwards * spread, -settlement])
    turn = -outwards * math.radians(rotation)
    steps = max(np.abs(move).max() / slow.length, abs(turn)) / STEP
    parts = np.linspace(0.0, 1.0, max(2, math.ceil(steps)) + 1)
    ranges = [slow.rest_range()]
    limit = math.inf
    for part in parts[1:]:
        slow.place(right, part * move, part * turn)
        made, _ = slow.step()
        now = slow.rest_range()
        stands = made and min(now) >= 0.0
        # Between two equilibria a hinge may just be on its way from joint to joint.
        if not stands and not (made and slow.settle(0.0)):
            limit = _crossing(parts[len(ranges) - 1], part, min(ranges[-1]), min(now))
            break
        ranges.append(now if stands else slow.rest_range())
    if math.isinf(limit) and not slow.settle(math.inf):
        limit = 1.0
    plus, minus = np.array(ranges).T
    end = slow.arch() if math.isinf(limit) else None
    # A tie is all that holds it, in a mechanism.
    if end and not onset(end).stands:
        held = np.flatnonzero(np.minimum(plus, minus)[:-1] > HOLDS)
        end = None
        limit = float(parts[held.max(initial=-1) + 1])
    return SpringingPath(parts[: len(ranges)], plus, minus, end, limit)


def move_springing(
    arch: Arch,
    spread: float = 0.0,
    settlement: float = 0.0,
    rotation: float = 0.0,
    springing: str = "right",
) -> Arch:
    """Return an arch whose springing has moved, at rest with the hinges that this opened.

    Parameters and method as `springing_path`.

    Raises
    ------
    StabilityError
        If the arch falls before the springing has moved so far; it says how far it can move.

    Examples
    --------
    >>> import archfrag as af
    >>> arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
    >>> spread = af.move_springing(arch, spread=0.2)
    >>> af.onset(spread).plus < af.onset(arch).plus
    True
    """
    given = {"spread": spread, "settlement": settlement, "rotation": rotation}
    path = springing_path(arch, **given, springing=springing)
    if path.arch is None:
        units = {"rotation": "degrees"}
        far = [
            f"{name} {path.limit * value:.4g} {units.get(name, 'm')}"
            for name, value in given.items()
            if value
        ]
        falls = (
            f"{arch!r}: the arch falls at {', '.join(far)} of its {springing} springing"
        )
        if arch.pulled:
            falls += " with its ties; move the springing less, or first, and tie the arch then"
        raise StabilityError(falls)
    moved = {**given, "springing": springing}
    return path.arch.changed(parameters={**arch.parameters, "springings": moved})


def _crossing(before: float, after: float, held: float, margin: float) -> float:
    """Return the part of a movement at which the margin of rest vanishes.

    It is interpolated between `before`, where the margin is `held`, and `after`, where it is
    `margin` [g]; if that is not a negative number, it is `after`.
    """
    if not math.isfinite(margin) or margin >= 0.0:
        return after
    return before + (after - before) * held / (held - margin)


def ground_of(motion: Motion, far: Far) -> Ground:
    """Return the ground motion for kernels.

    `far` is the motion of the right springing, or its delay behind the left one [s]. InputError if
    its time step differs, or the delay is not from 0 to 60 s.
    """
    own = motion.acceleration, motion.vertical, motion.dt
    ground = Ground(*own, noted=motion.record_start)
    if far is None:
        return ground
    if not isinstance(far, Motion):
        check_number("far", far, 0.0, LATEST, "s")
        size = len(motion.acceleration) + math.ceil(far / motion.dt)
        time = motion.dt * np.arange(size) - far
        far = motion.changed(
            lambda wave: np.interp(time, motion.time, wave, 0.0, 0.0), "Delayed."
        )
    elif far.dt != motion.dt:
        raise InputError(
            f"far has a time step of {far.dt:g} s and the motion one of {motion.dt:g} s; they "
            "must be equal"
        )
    size = max(len(motion.acceleration), len(far.acceleration))

    def padded(wave: FloatArray | None) -> FloatArray:
        return np.zeros(size) if wave is None else np.pad(wave, (0, size - len(wave)))

    x = padded(motion.acceleration)
    y = padded(motion.vertical)
    apart = np.column_stack([padded(far.acceleration) - x, padded(far.vertical) - y])
    if not apart.any():  # motions that are equal are one
        return ground
    flat = motion.vertical is None and far.vertical is None
    return ground._replace(horizontal=x, vertical=None if flat else y, apart=apart)
