"""Capacity of each record between two levels of a grid, also where islands contradict it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import FloatArray

RULES = ("fewest", "first")


@dataclass(frozen=True)
class Brackets:
    """Between which of its levels each record fells the arch.

    Attributes
    ----------
    lower, upper : ndarray, (n_record,)
        Highest level that is taken to stand and lowest that is taken to collapse; 0 where the
        record collapses at its lowest level, inf where it never does.
    contradictions : ndarray of int, (n_record,)
        Verdicts on the wrong side of the border: islands of collapse or of standing.
    decided : ndarray of int, (n_record,)
        Runs that collapsed or stood; with 0 nothing is known and the bracket is (0, inf).
    """

    lower: FloatArray
    upper: FloatArray
    contradictions: NDArray[np.int64]
    decided: NDArray[np.int64]

    @property
    def bracketed(self) -> NDArray[np.bool_]:
        """Whether both ends are known, (n_record,)."""
        return (self.lower > 0.0) & np.isfinite(self.upper)

    @property
    def middle(self) -> FloatArray:
        """Geometric mean of the ends; nan where one is not known, (n_record,)."""
        known = self.bracketed
        product = np.where(known, self.lower, 1.0) * np.where(known, self.upper, 1.0)
        return np.where(known, np.sqrt(product), np.nan)


def find_brackets(verdict: ArrayLike, levels: ArrayLike, rule: str = "fewest") -> Brackets:
    """Border between standing and collapse of each record.

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level)
        Codes of `archfrag.fragility.counts.Verdict`; all but standing and collapsed decide
        nothing.
    levels : array_like, (n_level,) or (n_record, n_level)
        Intensity or scale factor, rising along each row, > 0.
    rule : str
        ``"fewest"``: the border that the fewest verdicts contradict, the lowest of several.
        ``"first"``: below the first collapse, as capacity is usually defined for incremental
        dynamic analysis (Vamvatsikos and Cornell 2002, EESD 31).

    Raises
    ------
    InputError
        If shapes or values cannot be, or the rule is unknown.

    Examples
    --------
    The second record has an island of collapse at its second level.

    >>> from archfrag.fragility.borders import find_brackets
    >>> verdict = [[0, 0, 0, 1, 1], [0, 1, 0, 0, 1]]
    >>> found = find_brackets(verdict, [0.1, 0.2, 0.3, 0.4, 0.5])
    >>> found.lower.tolist(), found.upper.tolist(), found.contradictions.tolist()
    ([0.3, 0.4], [0.4, 0.5], [0, 1])
    """
    codes, factor = checked_grid(verdict, levels)
    border = _border(codes, rule)
    n_level = codes.shape[1]
    position = np.arange(n_level)
    decided = (codes == Verdict.STANDING) | (codes == Verdict.COLLAPSED)
    below = decided & (position < border[:, None])
    above = decided & (position >= border[:, None])
    lower = np.where(below, factor, 0.0).max(axis=1)
    upper = np.where(above, factor, np.inf).min(axis=1)
    wrong = (below & (codes == Verdict.COLLAPSED)) | (above & (codes == Verdict.STANDING))
    return Brackets(
        lower, upper, np.count_nonzero(wrong, axis=1), np.count_nonzero(decided, axis=1)
    )


def fill_verdicts(verdict: ArrayLike, rule: str = "fewest") -> NDArray[np.int64]:
    """Verdicts of a bisected grid, with those cells decided that the bracket implies.

    A cell that was not run is taken to stand below the bracket of its record and to collapse
    above it. Runs that were made keep their verdict; cells inside the bracket stay as they are.

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level)
    rule : str
        As in `find_brackets`.

    Raises
    ------
    InputError
        If `verdict` is not two-dimensional, or the rule is unknown.

    Examples
    --------
    >>> from archfrag.fragility.borders import fill_verdicts
    >>> fill_verdicts([[4, 0, 4, 1, 4]]).tolist()
    [[0, 0, 4, 1, 1]]
    """
    codes = np.asarray(verdict)
    position = np.arange(1.0, (codes.shape[1] if codes.ndim == 2 else 0) + 1.0)
    found = find_brackets(codes, position, rule)
    run = (codes == Verdict.STANDING) | (codes == Verdict.COLLAPSED)
    filled = codes.astype(np.int64)
    filled[~run & (position < found.lower[:, None])] = Verdict.STANDING
    filled[~run & (position > found.upper[:, None])] = Verdict.COLLAPSED
    return filled


def checked_grid(verdict: ArrayLike, levels: ArrayLike) -> tuple[NDArray[np.int64], FloatArray]:
    """Verdicts and levels as arrays of shape (n_record, n_level).

    Raises
    ------
    InputError
        If shapes do not match or the levels do not rise.
    """
    codes = np.asarray(verdict)
    if codes.ndim != 2 or codes.size == 0:
        raise InputError(f"verdict has shape {codes.shape}; (n_record, n_level) is needed")
    factor = np.asarray(levels, dtype=float)
    if factor.shape not in (codes.shape, codes.shape[1:]):
        raise InputError(f"levels have shape {factor.shape}, verdict {codes.shape}")
    factor = np.broadcast_to(factor, codes.shape)
    if not np.all((factor > 0.0) & np.isfinite(factor)) or np.any(np.diff(factor, axis=1) <= 0.0):
        raise InputError("levels are positive finite numbers that rise along each record")
    return codes, factor


def _border(codes: NDArray[np.int64], rule: str) -> NDArray[np.int64]:
    """How many levels of each record lie below its border, (n_record,)."""
    fell, stood = codes == Verdict.COLLAPSED, codes == Verdict.STANDING
    if rule == "first":
        return np.where(fell.any(axis=1), fell.argmax(axis=1), codes.shape[1])
    if rule != "fewest":
        raise InputError(f"rule is {rule!r}; it is one of {', '.join(RULES)}")
    start = np.zeros((len(codes), 1), dtype=int)
    fell_below = np.concatenate([start, np.cumsum(fell, axis=1)], axis=1)
    stood_below = np.concatenate([start, np.cumsum(stood, axis=1)], axis=1)
    wrong = fell_below + stood_below[:, -1:] - stood_below
    return wrong.argmin(axis=1)
