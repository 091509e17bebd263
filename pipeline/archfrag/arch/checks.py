"""Checks of what users give: each returns floats or raises one clear message."""

import math
import reprlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import GeometryError

FloatArray = NDArray[np.float64]
# Lengths [m] between which nothing overflows; beyond them units were mistaken.
SMALLEST = 1e-6
LARGEST = 1e6
MOST = {"m": LARGEST, "Pa/m": 1e15}  # by unit
ROUGH = "the limit of large friction"
# Of an arch: beyond it even the onset takes longer than a check of a study should.
MOST_VOUSSOIRS = 2000


def _floats(
    name: str,
    value: Any,
    allowed: str,
    fits: Callable[[Any], Any],
    shape_fits: Callable[[tuple[int, ...]], bool] = lambda shape: shape == (),
) -> FloatArray:
    """Return an array of floats whose shape and entries fit; neither text, booleans nor ragged
    lists.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # rows of unequal length
        array = np.array(None)
    if array.dtype.kind not in "iuf":
        wrong = f"{name} = {reprlib.repr(value)}"
    elif not shape_fits(array.shape):
        wrong = f"{name} of shape {array.shape}"
    elif not (good := np.asarray(fits(array))).all():
        place = np.argwhere(~good)[0].tolist()
        wrong = f"{name}{place or ''} = {array[tuple(place)]}"
    else:
        return array.astype(np.float64)
    raise GeometryError(f"{wrong} is impossible; it must be {allowed}")


def number(
    name: str,
    value: Any,
    unit: str = "m",
    *,
    least: float = 0.0,
    most: float = math.inf,
    closed: bool = True,
    meaning: str = "",
) -> float:
    """Return one number between bounds, which are allowed if `closed`; lengths have bounds
    anyway.
    """
    if unit == "m":
        least = max(least, SMALLEST)
        most = min(most, LARGEST)
    words = ("at least", "at most") if closed else ("greater than", "less than")
    limits = [
        f"{word} {bound:.9g} {unit}".rstrip()
        for word, bound in zip(words, (least, most))
    ]
    allowed = f"a number {' and '.join(limits)}" + (f" ({meaning})" if meaning else "")
    ends = (least, most) if closed else ()
    return float(_floats(name, value, allowed, lambda x: least < x < most or x in ends))


def count(name: str, value: Any) -> int:
    """Number of voussoirs of an arch: an integer from 2 to `MOST_VOUSSOIRS`."""
    allowed = f"an integer from 2 to {MOST_VOUSSOIRS} (a single body is a Block)"
    return int(
        _floats(name, value, allowed, lambda x: x in range(2, MOST_VOUSSOIRS + 1))
    )


def flag(name: str, value: object) -> bool:
    """Return True or False; nothing else is taken."""
    if not isinstance(value, bool | np.bool_):
        raise GeometryError(
            f"{name} = {reprlib.repr(value)} is impossible; it must be a boolean"
        )
    return bool(value)


def shared_or_each(
    name: str,
    value: Any,
    size: int,
    each: str,
    unit: str = "",
    *,
    infinite: str = "",
    least: float = 0.0,
) -> FloatArray:
    """Return one number for all, or one for each; none below `least`, and all within the bounds
    of their unit. `infinite` is what inf stands for; it is not allowed if that is empty.
    """
    most = MOST.get(unit, math.inf)
    allowed = f"one number or one for each of the {size} {each}s, all at least {least:g} {unit}"
    end = (
        f" and at most {most:g} {unit}"
        if unit in MOST
        else ""
        if infinite
        else " and finite"
    )
    end += f" (inf: {infinite})" if infinite else ""
    array = _floats(
        name,
        value,
        allowed.rstrip() + end,
        lambda x: (
            (x >= least)
            & ((x <= most) & np.isfinite(x) | (x == math.inf) & bool(infinite))
        ),
        lambda shape: shape in ((), (size,)),
    )
    return np.broadcast_to(array, size).copy()


def joint_positions(
    value: ArrayLike | None, voussoirs: int, end: float, unit: str
) -> FloatArray:
    """Return positions of joints from the middle of the ring, from minus to plus half `end`."""
    if value is None:
        # Integer numerators make mirrored joints equal to the last bit.
        index = np.arange(voussoirs + 1, dtype=np.float64)
        return end * ((2.0 * index - voussoirs) / (2.0 * voussoirs))
    ends = f"from 0 at the left springing to {end:.9g} {unit} at the right one"
    allowed = f"one of {voussoirs + 1} numbers that increase {ends}"

    def fits(x: FloatArray) -> NDArray[np.bool_]:
        good = np.append(True, x[1:] > x[:-1])
        good[[0, -1]] &= np.abs(x[[0, -1]] - [0.0, end]) <= 1e-9 * end
        return good

    array = _floats(
        "joints", value, allowed, fits, lambda shape: shape == (voussoirs + 1,)
    )
    position = array - 0.5 * end
    position[0] = -0.5 * end
    position[-1] = 0.5 * end
    return position


def points(name: str, value: Any, least: int, why: str, widest: int = 2) -> FloatArray:
    """Return the corners ``(n, 2)`` to ``(n, widest)`` [m] ``n >= least``; `why`: where `least` is
    from.
    """
    allowed = f"an (n, 2) table of coordinates within {LARGEST:g} m, n at least {least} ({why})"
    return _floats(
        name,
        value,
        allowed,
        lambda x: np.abs(x) <= LARGEST,
        lambda shape: len(shape) == 2 and shape[0] >= least and 2 <= shape[1] <= widest,
    )
