"""What a band is, and exact intervals of fractions."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv

from archfrag.errors import InputError
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.fit import checked_stripes


@dataclass(frozen=True)
class Band:
    """Pointwise confidence band of a curve.

    Attributes
    ----------
    lower, upper : ndarray, shape of the intensities asked for
        Probabilities of collapse.
    confidence : float
        Two-sided confidence at each intensity, e.g. 0.9.
    n_degenerate : int
        Bootstrap only: resamples without a lognormal curve (see `bootstrap_band`).
    """

    lower: FloatArray
    upper: FloatArray
    confidence: float
    n_degenerate: int = 0


@dataclass(frozen=True)
class RecordBand(Band):
    """Band from resampled records, with the intervals of the parameters.

    Attributes
    ----------
    theta, beta : (float, float)
        Quantiles over the resamples that have a lognormal curve; nan if none has.
    """

    theta: tuple[float, float] = (np.nan, np.nan)
    beta: tuple[float, float] = (np.nan, np.nan)


def check_confidence(confidence: float) -> None:
    """Raise InputError unless a confidence is a probability."""
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence is {confidence:g}; it lies between 0 and 1, such as 0.9")


def tails(confidence: float) -> list[float]:
    """Probabilities below the two ends of a central interval."""
    return [0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence]


def clopper_pearson(
    collapses: ArrayLike, n: ArrayLike, confidence: float = 0.9
) -> tuple[FloatArray, FloatArray]:
    """Exact interval of each binomial fraction (Clopper and Pearson 1934, Biometrika 26).

    Parameters
    ----------
    collapses, n : array_like of int, (n_level,)
        Collapses among n runs; `n` may be one number for all levels.
    confidence : float
        Two-sided, between 0 and 1; each side holds at least half of it.

    Returns
    -------
    (ndarray, ndarray)
        Lower and upper end, (n_level,); nan where n = 0.

    Raises
    ------
    InputError
        If a count is negative, not whole, or collapses exceed n.
    """
    check_confidence(confidence)
    collapses = np.atleast_1d(np.asarray(collapses, dtype=float))
    _, k, n = checked_stripes(np.ones(collapses.shape), collapses, n)
    tail = 0.5 - 0.5 * confidence
    lower = np.where(k > 0, betaincinv(np.maximum(k, 1), n - k + 1, tail), 0.0)
    upper = np.where(k < n, betaincinv(k + 1, np.maximum(n - k, 1), 1.0 - tail), 1.0)
    return np.where(n > 0, lower, np.nan), np.where(n > 0, upper, np.nan)
