"""Verdicts of runs, counted; intervals of the fractions that collapsed; resampling of records."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import scipy
from numpy.typing import ArrayLike

from archfrag.errors import InputError
from archfrag.fragility.curve import FloatArray, IntArray, positive, shaped, tails


class Verdict(IntEnum):
    """What one run shows of collapse; only the first two decide anything."""

    STANDING = 0
    COLLAPSED = 1
    UNFINISHED = 2
    SOLVER_FAILURE = 3
    NOT_SIMULATED = 4  # a cell for which the design of the study asked for no run


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
    """Count the verdicts at each level of `verdict`, (..., n_level), codes of `Verdict`."""
    codes = np.asarray(verdict)
    if codes.ndim == 0:
        raise InputError("verdict is a single value; an array with levels last is needed")
    foreign = codes[~np.isin(codes, [int(v) for v in Verdict])]
    if foreign.size:
        raise InputError(
            f"verdict holds {foreign.flat[0]!s}, which is not one of "
            + ", ".join(f"{v.value} ({v.name.lower()})" for v in Verdict)
        )
    codes = codes.reshape(-1, codes.shape[-1])
    made = [v for v in Verdict if v != Verdict.NOT_SIMULATED]
    return VerdictCounts(*(np.count_nonzero(codes == v, axis=0).astype(np.int64) for v in made))


def checked_stripes(
    im: ArrayLike, collapses: ArrayLike, n: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Levels, collapses and runs as arrays of shape (n_level,); InputError if not valid."""
    levels, k, m = (np.asarray(values, dtype=float) for values in (im, collapses, n))
    if levels.ndim != 1 or levels.size == 0:
        raise InputError(f"im has shape {levels.shape}; a list of one intensity per level")
    m = np.full(levels.shape, m) if m.ndim == 0 else m
    for name, values in (("collapses", k), ("n", m)):
        shaped(values, levels.shape, name)
        bad = values[~((values >= 0.0) & (values == np.floor(values)) & np.isfinite(values))]
        if bad.size:
            raise InputError(f"{name} holds {bad[0]:g}; counts are integers from 0 upwards")
    positive(levels, "im")
    for i in np.flatnonzero(k > m)[:1]:
        raise InputError(
            f"collapses is {k[i]:g} at im = {levels[i]:g}, more than the n = {m[i]:g} runs"
        )
    return levels, k, m


def clopper_pearson(
    collapses: ArrayLike, n: ArrayLike, confidence: float = 0.9
) -> tuple[FloatArray, FloatArray]:
    """Exact interval of each fraction `collapses` / `n`, (n_level,); nan where n = 0.

    Clopper and Pearson 1934, Biometrika 26.
    """
    low, high = tails(confidence)
    given = np.atleast_1d(np.asarray(collapses, dtype=float))
    _, k, m = checked_stripes(np.ones(given.shape), given, n)
    lower = np.where(k > 0, scipy.special.betaincinv(np.maximum(k, 1), m - k + 1, low), 0.0)
    upper = np.where(k < m, scipy.special.betaincinv(k + 1, np.maximum(m - k, 1), high), 1.0)
    return np.where(m > 0, lower, np.nan), np.where(m > 0, upper, np.nan)


def wilson(k: ArrayLike, n: ArrayLike, confidence: float = 0.9) -> tuple[FloatArray, FloatArray]:
    """Score interval of k among n, which need not be integers (Wilson 1927); nan where n = 0."""
    z = scipy.special.ndtri(tails(confidence)[1])
    k = np.asarray(k, dtype=float)
    n = np.where(np.asarray(n) > 0, n, np.nan).astype(float)
    centre = (k + 0.5 * z * z) / (n + z * z)
    reach = z / (n + z * z) * np.sqrt(np.maximum(k * (n - k) / n, 0.0) + 0.25 * z * z)
    # At k = 0 and k = n the ends are 0 and 1 but for rounding.
    lower = np.where(k > 0.0, np.maximum(centre - reach, 0.0), 0.0 * n)
    upper = np.where(k < n, np.minimum(centre + reach, 1.0), 1.0 + 0.0 * n)
    return lower, upper


def draws_of_records(
    event: ArrayLike | None, n_record: int, seed: int, resamples: int
) -> IntArray:
    """How often a bootstrap draws each record, with all of its event, (resamples, n_record)."""
    if resamples < 100:
        raise InputError(f"resamples is {resamples}; quantiles need at least 100")
    group = event_groups(event, n_record)
    n = int(group.max()) + 1
    generator = np.random.default_rng(seed)
    return generator.multinomial(n, np.full(n, 1.0 / n), resamples)[:, group]


def event_groups(event: ArrayLike | None, n_record: int) -> IntArray:
    """A number for each record, the same for those of one event; its own where `event` is None."""
    if event is None:
        return np.arange(n_record)
    return np.unique(shaped(event, (n_record,), "event"), return_inverse=True)[1]
