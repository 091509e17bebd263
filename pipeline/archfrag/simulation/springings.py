"""Bases that have moved before a record, and bases with motions of their own.

An arch follows a slow movement of a base in equilibrium, or falls.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from archfrag.arch import Arch
from archfrag.arch.checks import FloatArray
from archfrag.arch.quasi_static import HOLDS, STEP, SlowArch
from archfrag.errors import InputError, StabilityError
from archfrag.motions.motion import Motion
from archfrag.simulation.arguments import base_positions, check_number
from archfrag.simulation.rest import onset
from archfrag.simulation.standing import check_stands

# own motions of bases by name, or how much later they have that of the left one [s]
Bases = Mapping[str, Motion | float]


class Ground(NamedTuple):
    """A ground motion for kernels."""

    horizontal: FloatArray  # (n,) acceleration of the left base [m/s2]
    vertical: FloatArray | None  # (n,) upwards
    dt: float  # [s]
    # (n, n_base, 2) x, y: accelerations of the other bases less that of the left one; None if all
    # move alike
    apart: FloatArray | None
    motion: Motion  # of the left base


class SpringingPath(NamedTuple):
    """What `springing_path` finds of an arch while one of its bases moves."""

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
        Movement of the left base towards -x, of any other towards +x [m]: of an end away from the
        other one.
    settlement : float
        Movement downwards [m].
    rotation : float
        About the middle of the base's joint, of the left base anticlockwise, of any other
        clockwise [degrees]: positive if the extrados of a springing goes down.
    springing : str
        Name of the base that moves: "left", "pier 1" and so on, "right".

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
    names = list(arch.bases)
    if springing not in names:
        raise InputError(f"springing = {springing!r} must be {' or '.join(names)}")
    base = names.index(springing)
    size = arch.extent.max()
    check_number("spread", spread, -size, size, "m")
    check_number("settlement", settlement, -size, size, "m")
    check_number("rotation", rotation, -45.0, 45.0, "degrees")
    check_stands(arch)
    slow = SlowArch(arch)
    outwards = 1.0 if base else -1.0
    move = np.array([outwards * spread, -settlement])
    turn = -outwards * math.radians(rotation)
    steps = max(np.abs(move).max() / slow.length, abs(turn)) / STEP
    parts = np.linspace(0.0, 1.0, max(2, math.ceil(steps)) + 1)
    ranges = [slow.rest_range()]
    limit = math.inf
    for part in parts[1:]:
        slow.place(base, part * move, part * turn)
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


def own_motions(
    arch: Arch, wave_speed: float | None = None, bases: Bases | None = None
) -> dict[str, Motion | float]:
    """Return the motion of each base, or its delay behind the left one [s], by its name.

    `wave_speed` and `bases` are those of `simulate`.
    """
    places = base_positions(arch)
    if wave_speed is None:
        return {name: (bases or {}).get(name, 0.0) for name in places}
    return {name: (x - places["left"]) / wave_speed for name, x in places.items()}


def ground_of(
    motion: Motion,
    arch: Arch,
    wave_speed: float | None = None,
    bases: Bases | None = None,
) -> Ground:
    """Return a ground motion of an arch for kernels; the arguments are those of `simulate`.

    A delayed acceleration is interpolated linearly at the samples of `motion`, so that it is exact
    there. If a base moves before the left one, all motions begin later, by whole samples of zeros.
    InputError if the motion of a base has another time step.
    """
    dt = motion.dt
    own = own_motions(arch, wave_speed, bases)
    delays = [given for given in own.values() if not isinstance(given, Motion)]
    lead = math.ceil(-min(delays, default=0.0) / dt)
    moved = []
    for name, given in own.items():
        late, delay = (given, 0.0) if isinstance(given, Motion) else (motion, given)
        if late.dt != dt:
            raise InputError(
                f"bases: the motion of {name} has a time step of {late.dt:g} s and the motion of "
                f"the left base one of {dt:g} s; they must be equal"
            )
        moved.append(_later(late, lead, delay))
    left = moved[0]
    table = np.zeros((len(moved), 2, max(each.acceleration.size for each in moved)))
    for row, each in zip(table, moved):
        for wave, to in ((each.acceleration, row[0]), (each.vertical, row[1])):
            to[: each.acceleration.size] = 0.0 if wave is None else wave
    apart = table[1:] - table[0]
    if not apart.any():  # motions that are equal are one
        return Ground(left.acceleration, left.vertical, dt, None, left)
    flat = all(each.vertical is None for each in moved)
    vertical = None if flat else table[0, 1]
    return Ground(table[0, 0], vertical, dt, np.moveaxis(apart, 2, 0), left)


def _later(motion: Motion, lead: int, delay: float) -> Motion:
    """Return a motion that comes `lead` samples and `delay` [s] later."""
    if not lead and not delay:
        return motion
    later = lead * motion.dt + delay

    def moved(wave: FloatArray) -> FloatArray:
        if not delay:
            return np.pad(wave, (lead, 0))
        size = len(wave) + math.ceil(later / motion.dt)
        time = motion.dt * np.arange(size) - later
        return np.interp(time, motion.time, wave, 0.0, 0.0)

    start = motion.record_start
    done = f"Begins {later:g} s later."
    return motion.changed(moved, done, record_start=start and start + later)
