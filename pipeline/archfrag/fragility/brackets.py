"""Capacities of records that were run at several levels: between which two each lies."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import BoolArray, FloatArray, IntArray, positive, shaped

MOST_LEVELS = 500  # of runs by intensity


@dataclass(frozen=True)
class Brackets:
    """The two levels between which the capacity of each record lies, and the runs that show it."""

    lower: FloatArray  #: (n_record,), highest level below the capacity; 0 if there is none
    upper: FloatArray  #: (n_record,), lowest level above the capacity; inf if there is none
    contradictions: IntArray  #: (n_record,), verdicts on the wrong side of the border
    levels: FloatArray  #: (n_record, n_level), rising in each row
    verdict: IntArray  #: (n_record, n_level), codes of `Verdict` in the order of `levels`

    @property
    def collapsed(self) -> BoolArray:
        """Runs that collapsed, (n_record, n_level)."""
        return self.verdict == Verdict.COLLAPSED

    @property
    def survived(self) -> BoolArray:
        """Runs that survived, (n_record, n_level)."""
        return self.verdict == Verdict.STANDING

    @property
    def decided(self) -> IntArray:
        """Runs that collapsed or survived, (n_record,); with 0 the bracket is (0, inf)."""
        return np.count_nonzero(self.collapsed | self.survived, axis=1)

    @property
    def bracketed(self) -> BoolArray:
        """Whether both ends are known, (n_record,)."""
        return (self.lower > 0.0) & np.isfinite(self.upper)

    @property
    def middle(self) -> FloatArray:
        """Geometric mean of the ends; nan where one is not known, (n_record,)."""
        low, high = np.where(self.bracketed, (self.lower, self.upper), np.nan)
        return np.sqrt(low * high)

    @property
    def filled(self) -> IntArray:
        """Verdicts, and where there is none what the brackets imply, (n_record, n_level)."""
        unknown = ~(self.collapsed | self.survived)
        filled = self.verdict.copy()
        filled[unknown & (self.levels < self.lower[:, None])] = Verdict.STANDING
        filled[unknown & (self.levels > self.upper[:, None])] = Verdict.COLLAPSED
        return filled

    def at_levels(self, filled: bool = False) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Runs by intensity, with those that the brackets imply if `filled`.

        A search leaves out cells that are decided in all but name: without them the collapses
        that remain would be a biased choice. More than 500 distinct intensities are gathered into
        500 groups of neighbours, each at its geometric mean. Returns distinct levels (n_level,),
        rising; 1 where a run collapsed, and where it is decided, (n_record, n_level) each.
        """
        codes = self.filled if filled else self.verdict
        row, column = np.nonzero(np.isin(codes, (Verdict.COLLAPSED, Verdict.STANDING)))
        if not row.size:
            raise FitError("no run collapsed or stood, so there is nothing to fit")
        levels, place = np.unique(self.levels[row, column], return_inverse=True)
        if levels.size > MOST_LEVELS:
            near = np.arange(levels.size) * MOST_LEVELS // levels.size
            levels = np.exp(np.bincount(near, np.log(levels)) / np.bincount(near))
            place = near[place]
        collapses, n = np.zeros((2, len(codes), levels.size))
        n[row, place] = 1.0
        collapses[row, place] = codes[row, column] == Verdict.COLLAPSED
        return levels, collapses, n

    def rows(self, keep: BoolArray) -> "Brackets":
        """The same of some records only."""
        return Brackets(*(getattr(self, field.name)[keep] for field in fields(self)))

    def known(self) -> "Brackets":
        """The same of those records that have a decided run; FitError if there is none."""
        if not self.decided.any():
            raise FitError("no run collapsed or stood, so there is nothing to fit")
        return self.rows(self.decided > 0)


def find_brackets(verdict: ArrayLike, levels: ArrayLike) -> Brackets:
    """Find the border between survival and collapse of each record.

    A record that survives above a level at which it collapsed has no single capacity. Its border
    is the one that the fewest verdicts contradict, the lowest of several.

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level)
        Codes of `Verdict`; all but survived and collapsed decide nothing.
    levels : array_like, (n_level,) or (n_record, n_level)
        Intensity or scale factor, > 0, in any order.
    """
    codes, level = np.asarray(verdict), positive(levels, "levels")
    if codes.ndim != 2 or codes.size == 0:
        raise InputError(f"verdict has shape {codes.shape}; (n_record, n_level) is needed")
    count_verdicts(codes)
    if level.shape != codes.shape:
        level = np.broadcast_to(shaped(level, codes.shape[1:], "levels"), codes.shape)
    order = np.argsort(level, axis=1, kind="stable")
    codes, level = (np.take_along_axis(each, order, 1) for each in (codes, level))
    collapsed, survived = codes == Verdict.COLLAPSED, codes == Verdict.STANDING
    decided = collapsed | survived
    change = np.cumsum(collapsed.astype(int) - survived, axis=1)
    wrong = np.pad(change, ((0, 0), (1, 0)))  # verdicts against each border, but for a constant
    below = decided & (np.arange(codes.shape[1]) < wrong.argmin(axis=1)[:, None])
    above = decided & ~below
    return Brackets(
        np.where(below, level, 0.0).max(axis=1),
        np.where(above, level, np.inf).min(axis=1),
        np.count_nonzero((below & collapsed) | (above & survived), axis=1),
        level,
        codes.astype(np.int64),
    )


def checked_brackets(lower: ArrayLike, upper: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Ends of brackets as arrays of shape (n_record,); InputError if they are not valid."""
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if lower.ndim != 1 or lower.size == 0 or lower.shape != upper.shape:
        shapes = f"lower has shape {lower.shape}, upper {upper.shape}"
        raise InputError(f"{shapes}; one number per record is needed")
    good = (lower >= 0.0) & (lower <= upper) & np.isfinite(lower) & (upper > 0.0)
    good &= (lower > 0.0) | (upper < np.inf)
    for low, high in zip(lower[~good], upper[~good]):
        raise InputError(
            f"the bracket from {low:g} to {high:g} cannot be; 0 <= lower <= upper are needed, "
            "lower finite, upper > 0, and not from 0 to inf"
        )
    return lower, upper
