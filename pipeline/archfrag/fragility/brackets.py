"""Capacities of records that were run at several levels: between which two each lies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import FloatArray


@dataclass(frozen=True)
class Brackets:
    """Intensities between which the capacity of each record lies.

    Attributes
    ----------
    lower, upper : ndarray, (n_record,)
        Unit of the levels; `lower` is 0 where no run stood, `upper` inf where none collapsed.
    record : ndarray of int, (n_record,)
        Rows of the table they come from: records without a decided run are left out.
    n_islands : int
        Decided runs against the bracket of their record, whose verdicts do not only rise.
    """

    lower: FloatArray
    upper: FloatArray
    record: np.ndarray
    n_islands: int


def brackets_of(verdict: ArrayLike, levels: ArrayLike, rule: str = "count") -> Brackets:
    """Brackets of the capacities of records that were run at several levels.

    Where a record stands again above a level at which it collapsed there is no capacity in the
    strict sense, and a rule must say what is meant.

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level)
        Codes of `Verdict`; only runs that collapsed or stood are used.
    levels : array_like, (n_level,)
        Intensities, > 0, in any order.
    rule : {"count", "first"}
        ``"count"``: the border that leaves a record its number of collapses. On a full grid this
        leaves the area under the observed fractions as it is, and so the mean of the
        logarithms, whatever the islands. ``"first"``: the least level at which it collapsed,
        which is the capacity of incremental dynamic analysis (Vamvatsikos and Cornell 2002,
        Earthquake Engineering and Structural Dynamics 31(3)) and the one for bisected levels;
        with islands it is the lower of the two.

    Raises
    ------
    InputError
        If an argument cannot be, or no run is decided.
    """
    if rule not in ("count", "first"):
        raise InputError(f"rule is {rule!r}; it is 'count' or 'first'")
    count_verdicts(verdict)
    codes, levels = np.asarray(verdict), np.asarray(levels, dtype=float)
    if codes.ndim != 2 or levels.shape != codes.shape[1:]:
        raise InputError(
            f"verdict has shape {codes.shape}, levels {levels.shape}; records by all levels "
            "are needed"
        )
    if not np.all((levels > 0.0) & np.isfinite(levels)):
        raise InputError("levels holds a value that is not a positive finite number")
    order = np.argsort(levels)
    codes, levels = codes[:, order], levels[order]
    fell, stood = codes == Verdict.COLLAPSED, codes == Verdict.STANDING
    decided = fell | stood
    record = np.flatnonzero(decided.any(axis=1))
    if not record.size:
        raise InputError("verdict holds no run that collapsed or stood")
    fell, stood, decided = fell[record], stood[record], decided[record]
    if rule == "count":
        below = decided & (np.cumsum(decided, axis=1) <= stood.sum(axis=1, keepdims=True))
    else:
        below = stood & (np.cumsum(fell, axis=1) == 0)
    above = decided & ~below
    lower = np.where(below, levels, 0.0).max(axis=1)
    upper = np.where(above, levels, np.inf).min(axis=1)
    return Brackets(lower, upper, record, int((below & fell).sum() + (above & stood).sum()))


def midpoints(lower: ArrayLike, upper: ArrayLike) -> FloatArray:
    """Geometric means of brackets that are closed on both sides, (n_closed,).

    Open brackets are left out, which biases the moments: `capacities.fit_brackets` uses them.
    """
    lower, upper = checked_brackets(lower, upper)
    closed = (lower > 0.0) & np.isfinite(upper)
    return np.sqrt(lower[closed] * upper[closed])


def checked_brackets(lower: ArrayLike, upper: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Ends of brackets as arrays of shape (n_record,).

    Raises
    ------
    InputError
        If a shape or a value cannot be.
    """
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if lower.ndim != 1 or lower.size == 0 or lower.shape != upper.shape:
        raise InputError(
            f"lower has shape {lower.shape}, upper {upper.shape}; one number per record is needed"
        )
    bad = ~((lower >= 0.0) & (lower <= upper) & np.isfinite(lower) & (upper > 0.0))
    bad |= (lower == 0.0) & np.isposinf(upper)
    if bad.any():
        i = int(np.argmax(bad))
        raise InputError(
            f"the bracket from {lower[i]:g} to {upper[i]:g} cannot be; 0 <= lower <= upper "
            "are needed, lower finite, upper > 0, and not from 0 to inf"
        )
    return lower, upper
