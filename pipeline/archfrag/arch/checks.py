"""What a user may give: each check returns clean floats or raises one clear message."""

import math
import reprlib

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import GeometryError

# Lengths [m] between which nothing overflows; beyond them units were mistaken.
SMALLEST, LARGEST = 1e-6, 1e6
# Of an arch: beyond it even the onset takes longer than a check of a study should.
MOST_VOUSSOIRS = 2000


def _real_array(name: str, value: ArrayLike, allowed: str) -> NDArray[np.float64]:
    """Array of floats, refusing text, booleans, complex numbers and ragged lists."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise GeometryError(f"{name} has rows of unequal length; it must be {allowed}") from error
    if array.dtype.kind not in "iuf":
        raise GeometryError(f"{name} = {reprlib.repr(value)} is not numeric; it must be {allowed}")
    return array.astype(np.float64)


def number(
    name: str,
    value: ArrayLike,
    unit: str = "m",
    *,
    bounds: tuple[float, float] = (0.0, math.inf),
    closed: bool = False,
    note: str = "",
) -> float:
    """One finite number inside bounds, which are allowed themselves if `closed`."""
    words = ("at least", "at most") if closed else ("greater than", "less than")
    limits = [f"{word} {bound:.9g} {unit}".rstrip() for word, bound in zip(words, bounds)]
    allowed = "a finite number " + " and ".join(limits[: 1 + math.isfinite(bounds[1])])
    allowed += f" ({note})" if note else ""
    array = _real_array(name, value, allowed)
    if array.ndim != 0:
        shown = reprlib.repr(value)
        raise GeometryError(f"{name} = {shown} is not a single number; it must be {allowed}")
    given = float(array)
    inside = bounds[0] < given < bounds[1] or (closed and given in bounds)
    if not (inside and math.isfinite(given)):
        shown = f"{given} {unit}".rstrip()
        raise GeometryError(f"{name} = {shown} is impossible; it must be {allowed}")
    if unit == "m" and not SMALLEST <= given <= LARGEST:
        raise GeometryError(
            f"{name} = {given} m is no size of a structure; it must be between {SMALLEST:g} m and "
            f"{LARGEST:g} m"
        )
    return given


def count(name: str, value: ArrayLike) -> int:
    """Number of voussoirs of an arch: an integer from 2 to `MOST_VOUSSOIRS`."""
    allowed = f"an integer from 2 to {MOST_VOUSSOIRS} (a single body is a Block)"
    array = _real_array(name, value, allowed)
    if array.ndim != 0 or array != np.floor(array) or not 2 <= array <= MOST_VOUSSOIRS:
        raise GeometryError(f"{name} = {reprlib.repr(value)} is impossible; it must be {allowed}")
    return int(array)


def flag(name: str, value: object) -> bool:
    """True or False and nothing else."""
    if not isinstance(value, bool | np.bool_):
        given = reprlib.repr(value)
        raise GeometryError(f"{name} = {given} is not a choice; it must be True or False")
    return bool(value)


def shared_or_each(
    name: str, value: ArrayLike, size: int, each: str, unit: str = "", *, infinite: bool = False
) -> NDArray[np.float64]:
    """One non-negative number for all, or one for each."""
    space = f" {unit}" if unit else ""
    allowed = f"one number or one for each of the {size} {each}s, all at least 0{space}"
    allowed += " (inf: the limit of large friction)" if infinite else " and finite"
    array = _real_array(name, value, allowed)
    if array.ndim > 1 or (array.ndim == 1 and array.size != size):
        raise GeometryError(f"{name} has shape {array.shape}, not ({size},); it must be {allowed}")
    bad = ~(array >= 0.0) | (np.isinf(array) & (not infinite))
    if np.any(bad):
        where = f" at {each} {int(np.argmax(bad))}" if array.ndim else ""
        given = float(array[bad][0])
        raise GeometryError(f"{name} = {given}{space}{where} is impossible; it must be {allowed}")
    return np.ascontiguousarray(np.broadcast_to(array, (size,)), dtype=np.float64).copy()


def joint_positions(
    value: ArrayLike | None, voussoirs: int, end: float, unit: str
) -> NDArray[np.float64]:
    """Positions of joints from the middle of the ring, from minus to plus half `end`."""
    if value is None:
        # Integer numerators make mirrored joints equal to the last bit.
        index = np.arange(voussoirs + 1, dtype=np.float64)
        return end * ((2.0 * index - voussoirs) / (2.0 * voussoirs))
    allowed = (
        f"{voussoirs + 1} numbers that increase from 0 at the left springing to {end:.9g} {unit} "
        "at the right one"
    )
    array = _real_array("joints", value, allowed)
    good = array.shape == (voussoirs + 1,) and bool(np.isfinite(array).all())
    ends = good and max(abs(array[0]), abs(array[-1] - end)) <= 1e-9 * end
    if not ends or (np.diff(array) <= 0.0).any():
        raise GeometryError(f"joints = {reprlib.repr(value)} cannot be; it must be {allowed}")
    position: NDArray[np.float64] = array - 0.5 * end
    position[0], position[-1] = -0.5 * end, 0.5 * end
    return position


def points(
    name: str, value: ArrayLike, least: int, why: str, widest: int = 2
) -> NDArray[np.float64]:
    """Corners ``(n, 2)`` to ``(n, widest)`` [m] ``n >= least``; `why`: where `least` is from."""
    allowed = f"an (n, 2) table of finite coordinates in metres with n at least {least} ({why})"
    array = _real_array(name, value, allowed)
    if array.ndim != 2 or not 2 <= array.shape[1] <= widest or array.shape[0] < least:
        raise GeometryError(f"{name} has shape {array.shape}; it must be {allowed}")
    good = (np.abs(array) <= LARGEST).all(axis=1)
    if not good.all():
        place = int(np.argmin(good))
        raise GeometryError(
            f"{name}[{place}] = ({array[place, 0]}, {array[place, 1]}) is not finite or beyond "
            f"{LARGEST:g} m; it must be {allowed}"
        )
    return np.ascontiguousarray(array)
