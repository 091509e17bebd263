"""Verdicts of many runs, counted; only runs that collapsed or stood say anything of a curve."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError

IntArray = NDArray[np.int64]


class Verdict(IntEnum):
    """What one run says about collapse; only the first two say anything.

    NOT_SIMULATED is a cell of the grid for which the design of the study asked for no run.
    """

    STANDING = 0
    COLLAPSED = 1
    UNFINISHED = 2
    SOLVER_FAILURE = 3
    NOT_SIMULATED = 4


@dataclass(frozen=True)
class VerdictCounts:
    """Runs of each verdict at each level, all arrays of shape (n_level,)."""

    standing: IntArray
    collapsed: IntArray
    unfinished: IntArray
    solver_failures: IntArray

    @property
    def n(self) -> IntArray:
        """Runs that decide: standing and collapsed only, (n_level,)."""
        return self.standing + self.collapsed

    @property
    def runs(self) -> IntArray:
        """All runs that were made, whatever their verdict, (n_level,)."""
        return self.n + self.unfinished + self.solver_failures


def count_verdicts(verdict: ArrayLike) -> VerdictCounts:
    """Count the verdicts of all records at each level.

    Parameters
    ----------
    verdict : array_like of int, (..., n_level)
        Codes of `Verdict`; all axes but the last are counted together.

    Raises
    ------
    InputError
        If there is a code that is no verdict: a run that is missing must be told, not counted.
    """
    codes = np.asarray(verdict)
    if codes.ndim == 0:
        raise InputError("verdict is a single value; an array with levels last is needed")
    foreign = codes[~np.isin(codes, [int(v) for v in Verdict])]
    if foreign.size:
        raise InputError(
            f"verdict holds {foreign.flat[0]!s}, which is none of "
            + ", ".join(f"{v.value} ({v.name.lower()})" for v in Verdict)
        )
    codes = codes.reshape(-1, codes.shape[-1])
    standing, collapsed, unfinished, failures = (
        np.count_nonzero(codes == v, axis=0).astype(np.int64)
        for v in Verdict
        if v != Verdict.NOT_SIMULATED
    )
    return VerdictCounts(standing, collapsed, unfinished, failures)
