"""Checks of what users give: each returns floats or raises one clear message."""

import reprlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import GeometryError
from archfrag.properties import LARGEST, MOST_VOUSSOIRS, PROPERTIES

FloatArray = NDArray[np.float64]


def _floats(
    name: str,
    value,
    allowed: str,
    fits: Callable[[Any], Any],
    shape_fits: Callable[[tuple[int, ...]], bool] = lambda shape: shape == (),
) -> FloatArray:
    """Return a value as an array of floats, or raise `GeometryError`.

    Text, booleans and ragged lists are refused. `shape_fits` tells whether a shape is allowed,
    `fits` which entries are; `allowed` says so in the message.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # rows of unequal length
        array = np.array(None)
    if array.dtype.kind not in "iuf":
        wrong = f"{name} = {reprlib.repr(value)}"
    elif not shape_fits(array.shape):
        wrong = f"{name} of shape {array.shape}"
    else:
        bad = np.argwhere(~np.asarray(fits(array)))
        if not len(bad):
            return array.astype(np.float64)
        place = bad[0].tolist()
        wrong = f"{name}{place or ''} = {array[tuple(place)]}"
    raise GeometryError(f"{wrong} is impossible; it must be {allowed}")


def number(
    key: str,
    value,
    *,
    least: float = 0.0,
    most: float = np.inf,
    closed: bool = True,
    meaning: str = "",
    name: str = "",
) -> float:
    """Return one number within the bounds of its key in `PROPERTIES`.

    `least` and `most` may narrow the bounds. The bounds themselves are allowed only if `closed`.
    `meaning` explains them in the message, which shows `name` in the place of the key if given.
    """
    about = PROPERTIES[key]
    ends = max(least, about.least), min(most, about.most)
    words = ("at least", "at most") if closed else ("greater than", "less than")
    limits = [
        f"{word} {bound:.9g} {about.unit}".rstrip() for word, bound in zip(words, ends)
    ]
    allowed = f"a number {' and '.join(limits)}{f' ({meaning})' if meaning else ''}"

    def fits(x) -> bool:
        within = ends[0] < x < ends[1] or (closed and x in ends)
        return within or (x == np.inf and bool(about.infinite))

    return float(_floats(name or key, value, allowed, fits))


def count(name: str, value) -> int:
    """Return a number of voussoirs: an integer from 2 to `MOST_VOUSSOIRS`."""
    allowed = f"an integer from 2 to {MOST_VOUSSOIRS} (a single body is a Block)"
    numbers = range(2, MOST_VOUSSOIRS + 1)
    return int(_floats(name, value, allowed, numbers.__contains__))


def flag(name: str, value: object) -> bool:
    """Return True or False; `GeometryError` for anything but a boolean."""
    if not isinstance(value, bool | np.bool_):
        raise GeometryError(
            f"{name} = {reprlib.repr(value)} is impossible; it must be a boolean"
        )
    return bool(value)


def shared_or_each(key: str, value, size: int, each: str) -> FloatArray:
    """Return an array ``(size,)`` from one number for all, or one for each.

    All must be within the bounds of `key` in `PROPERTIES`. `each` is the noun in the message, such
    as joint.
    """
    about = PROPERTIES[key]
    most = f"at most {about.most:g} {about.unit}".rstrip()
    allowed = (
        f"one number or one for each of the {size} {each}s, all at least {about.least:g} "
        f"{about.unit} and {most if np.isfinite(about.most) else 'finite'}"
        f"{f' (inf: {about.infinite})' if about.infinite else ''}"
    ).replace("  ", " ")

    def fits(x: FloatArray):
        within = (x >= about.least) & (x <= about.most) & np.isfinite(x)
        return within | (x == np.inf) & bool(about.infinite)

    array = _floats(key, value, allowed, fits, lambda shape: shape in ((), (size,)))
    return np.broadcast_to(array, size).copy()


def joint_positions(
    value: ArrayLike | None, voussoirs: int, end: float, unit: str
) -> FloatArray:
    """Return the positions of joints, counted from the middle of the ring.

    They run from -`end` / 2 at the left springing to `end` / 2 at the right one. The user's
    `value` runs from 0 to `end` instead; with None all distances are equal.
    """
    if value is None:
        # Integer numerators make mirrored joints equal to the last bit.
        index = np.arange(voussoirs + 1, dtype=float)
        return end * ((2.0 * index - voussoirs) / (2.0 * voussoirs))
    allowed = (
        f"one of {voussoirs + 1} numbers that increase from 0 at the left springing "
        f"to {end:.9g} {unit} at the right one"
    )

    def fits(x: FloatArray) -> NDArray[np.bool_]:
        good = np.append(True, x[1:] > x[:-1])
        good[[0, -1]] &= np.abs(x[[0, -1]] - [0.0, end]) <= 1e-9 * end
        return good

    array = _floats(
        "joint_positions",
        value,
        allowed,
        fits,
        lambda shape: shape == (voussoirs + 1,),
    )
    position = array - 0.5 * end
    position[0] = -0.5 * end
    position[-1] = 0.5 * end
    return position


def points(name: str, value, least: int, why: str, widest: int = 2) -> FloatArray:
    """Check a table of points [m] and return it as floats.

    It has 2 to `widest` columns and at least `least` rows; `why` explains the latter in the
    message.
    """
    allowed = f"an (n, 2) table of coordinates within {LARGEST:g} m, n at least {least} ({why})"
    return _floats(
        name,
        value,
        allowed,
        lambda x: np.abs(x) <= LARGEST,
        lambda shape: len(shape) == 2 and shape[0] >= least and 2 <= shape[1] <= widest,
    )
