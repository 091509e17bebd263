"""Capacities of records that were run at several levels: between which two each lies."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import BoolArray, FloatArray, IntArray, positive, shaped

RULES = ("count", "fewest", "first")


@dataclass(frozen=True)
class Brackets:
    """Between which of its levels the capacity of each record lies, arrays (n_record,)."""

    lower: FloatArray  #: highest level taken to stand; 0 where the record collapses at its lowest
    upper: FloatArray  #: lowest level taken to collapse; inf where it never does
    contradictions: IntArray  #: verdicts on the wrong side of the border: islands
    decided: IntArray  #: runs that collapsed or stood; with 0 the bracket is (0, inf)

    @property
    def bracketed(self) -> BoolArray:
        """Whether both ends are known, (n_record,)."""
        return (self.lower > 0.0) & np.isfinite(self.upper)

    @property
    def middle(self) -> FloatArray:
        """Geometric mean of the ends; nan where one is not known, (n_record,)."""
        known = self.bracketed
        product = np.where(known, self.lower, 1.0) * np.where(known, self.upper, 1.0)
        return np.where(known, np.sqrt(product), np.nan)

    def rows(self, keep: BoolArray) -> "Brackets":
        """The same of some records only."""
        return Brackets(*(getattr(self, field.name)[keep] for field in fields(self)))

    def known(self) -> "Brackets":
        """The same of those records that have a decided run; FitError if there is none."""
        if not self.decided.any():
            raise FitError("no run collapsed or stood, so there is nothing to fit")
        return self.rows(self.decided > 0)


def find_brackets(verdict: ArrayLike, levels: ArrayLike, rule: str = "fewest") -> Brackets:
    """Border between standing and collapse of each record.

    Where a record stands again above a level at which it collapsed there is no capacity in the
    strict sense, and a rule must define what is meant.

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level)
        Codes of `Verdict`; all but standing and collapsed decide nothing.
    levels : array_like, (n_level,) or (n_record, n_level)
        Intensity or scale factor, > 0, in any order.
    rule : str
        ``"count"``: the border that leaves a record its number of collapses. On a full grid this
        leaves the area under the observed fractions as it is, and so the mean of the
        logarithms, whatever the islands. ``"fewest"``: the border that the fewest verdicts
        contradict, the lowest of several. ``"first"``: the least level at which it collapsed,
        which is the capacity of incremental dynamic analysis (Vamvatsikos and Cornell 2002,
        Earthquake Engineering and Structural Dynamics 31(3)) and the one for bisected levels;
        with islands it is the lowest of the three.

    Raises
    ------
    InputError
        If shapes or values cannot be, or the rule is unknown.

    Examples
    --------
    The second record has an island of collapse at its second level.

    >>> from archfrag.fragility.brackets import find_brackets
    >>> verdict = [[0, 0, 0, 1, 1], [0, 1, 0, 0, 1]]
    >>> found = find_brackets(verdict, [0.1, 0.2, 0.3, 0.4, 0.5])
    >>> found.lower.tolist(), found.upper.tolist(), found.contradictions.tolist()
    ([0.3, 0.4], [0.4, 0.5], [0, 1])
    """
    codes, factor = _checked_grid(verdict, levels)
    fell, stood = codes == Verdict.COLLAPSED, codes == Verdict.STANDING
    decided = fell | stood
    below = decided & _below(fell, stood, rule)
    above = decided & ~below
    return Brackets(
        np.where(below, factor, 0.0).max(axis=1),
        np.where(above, factor, np.inf).min(axis=1),
        np.count_nonzero((below & fell) | (above & stood), axis=1),
        np.count_nonzero(decided, axis=1),
    )


def fill_verdicts(verdict: ArrayLike, rule: str = "fewest") -> IntArray:
    """Verdicts of a bisected grid, with those cells decided that the bracket implies.

    A cell that was not run stands below the bracket of its record and collapses above it; all
    others stay as they are. Arguments and errors are those of `find_brackets`.

    Examples
    --------
    >>> from archfrag.fragility.brackets import fill_verdicts
    >>> fill_verdicts([[4, 0, 4, 1, 4]]).tolist()
    [[0, 0, 4, 1, 1]]
    """
    codes = np.asarray(verdict)
    position = np.arange(1.0, np.shape(codes)[-1] + 1.0)
    found = find_brackets(codes, position, rule)
    run = (codes == Verdict.STANDING) | (codes == Verdict.COLLAPSED)
    filled = codes.astype(np.int64)
    filled[~run & (position < found.lower[:, None])] = Verdict.STANDING
    filled[~run & (position > found.upper[:, None])] = Verdict.COLLAPSED
    return filled


def checked_brackets(lower: ArrayLike, upper: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Ends of brackets as arrays of shape (n_record,); InputError if they cannot be."""
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if lower.ndim != 1 or lower.size == 0 or lower.shape != upper.shape:
        shapes = f"lower has shape {lower.shape}, upper {upper.shape}"
        raise InputError(f"{shapes}; one number per record is needed")
    good = (lower >= 0.0) & (lower <= upper) & np.isfinite(lower) & (upper > 0.0)
    good &= (lower > 0.0) | (upper < np.inf)
    if not good.all():
        low, high = lower[~good][0], upper[~good][0]
        raise InputError(
            f"the bracket from {low:g} to {high:g} cannot be; 0 <= lower <= upper are needed, "
            "lower finite, upper > 0, and not from 0 to inf"
        )
    return lower, upper


def _below(fell: BoolArray, stood: BoolArray, rule: str) -> BoolArray:
    """Whether each cell lies below the border of its record, (n_record, n_level)."""
    if rule == "first":
        return np.cumsum(fell, axis=1) == 0
    if rule == "count":
        return np.cumsum(fell | stood, axis=1) <= stood.sum(axis=1, keepdims=True)
    if rule != "fewest":
        raise InputError(f"rule is {rule!r}; it is one of {', '.join(RULES)}")
    change = np.cumsum(fell.astype(int) - stood, axis=1)
    wrong = np.concatenate([np.zeros((len(fell), 1), int), change], axis=1)
    return np.arange(fell.shape[1]) < wrong.argmin(axis=1)[:, None]


def _checked_grid(verdict: ArrayLike, levels: ArrayLike) -> tuple[IntArray, FloatArray]:
    """Verdicts and levels, (n_record, n_level) each, with levels that rise."""
    codes, factor = np.asarray(verdict), positive(levels, "levels")
    if codes.ndim != 2 or codes.size == 0:
        raise InputError(f"verdict has shape {codes.shape}; (n_record, n_level) is needed")
    count_verdicts(codes)
    if factor.shape != codes.shape:
        factor = np.broadcast_to(shaped(factor, codes.shape[1:], "levels"), codes.shape)
    order = np.argsort(factor, axis=1, kind="stable")
    return np.take_along_axis(codes, order, 1), np.take_along_axis(factor, order, 1)
