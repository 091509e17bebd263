"""What the dispersion of a fragility curve is made of, from verdicts of runs made again.

A run collapses where ln level exceeds ln theta + beta Z with Z standard normal: the curve's own
law. Z is a sum of what the record brings, what changes from level to level of one record but
comes back in every repetition, and what comes back in none. Two runs that share a part have a
correlation of that part's share of beta squared, and it is seen in how often their verdicts
agree: the tetrachoric correlation (Pearson 1900, Phil. Trans. R. Soc. A 195, 1-47).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import ndtr

from archfrag.errors import FitError
from archfrag.fragility.fit import fit_stripes

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_LEAST = 1e-6
_NO_CHANCE = 1e-14


def both_below(first: Array, second: Array, correlation: float) -> Array:
    """Probability that two standard normal variables lie below two bounds.

    Plackett's integral over the correlation, with its sine as variable (Genz 2004, Statistics
    and Computing 14, 251-260).

    Parameters
    ----------
    first, second : ndarray, (n,)
        Bounds.
    correlation : float
        From -1 to 1.

    Examples
    --------
    >>> import numpy as np
    >>> from archfrag.evidence.fragility.partition import both_below
    >>> both_below(np.zeros(1), np.zeros(1), 0.5).round(12).tolist()
    [0.333333333333]
    """
    end = np.arcsin(correlation)
    angle = 0.5 * end * (_NODES + 1.0)
    cosine = np.maximum(np.cos(angle) ** 2, 1e-300)
    a, b = first[:, None], second[:, None]
    height = np.exp(-0.5 * (a * a - 2.0 * a * b * np.sin(angle) + b * b) / cosine)
    chance = ndtr(first) * ndtr(second) + height @ _WEIGHTS * end / (4.0 * np.pi)
    return np.clip(chance, 0.0, 1.0)


@dataclass(frozen=True)
class Pairs:
    """Pairs of runs at two bounds each, counted by their verdicts; all (n_pair,).

    Attributes
    ----------
    first, second : ndarray
        The bounds: (ln level - ln theta) / beta.
    both, one, other, none : ndarray
        Pairs of which both fell, only the first, only the second, none.
    """

    first: Array
    second: Array
    both: Array
    one: Array
    other: Array
    none: Array

    def correlation(self) -> float:
        """Likeliest correlation, from 0 to 1: 1 where no pair disagrees."""
        if not np.any((self.one > 0.0) & (self.first <= self.second)) and not np.any(
            (self.other > 0.0) & (self.second <= self.first)
        ):
            return 1.0
        below_first, below_second = ndtr(self.first), ndtr(self.second)

        def loss(log_rest: float) -> float:
            both = both_below(self.first, self.second, 1.0 - np.exp(log_rest))
            cells = (
                (self.both, both),
                (self.one, below_first - both),
                (self.other, below_second - both),
                (self.none, 1.0 - below_first - below_second + both),
            )
            return -sum(
                float(count @ np.log(np.maximum(chance, _NO_CHANCE))) for count, chance in cells
            )

        found = minimize_scalar(
            loss, bounds=(np.log(_LEAST), 0.0), method="bounded", options={"xatol": 1e-3}
        )
        return float(1.0 - np.exp(found.x))


def repeated(fallen: Array, stood: Array, bound: Array) -> Pairs:
    """Pairs of repetitions of one run: the same record at the same level.

    Parameters
    ----------
    fallen, stood : ndarray, (n_record, n_level)
        Repetitions by their verdict.
    bound : ndarray, (n_level,)
    """
    half = 0.5 * np.sum(fallen * stood, axis=0)
    return Pairs(
        bound,
        bound,
        np.sum(0.5 * fallen * (fallen - 1.0), axis=0),
        half,
        half,
        np.sum(0.5 * stood * (stood - 1.0), axis=0),
    )


def across_levels(fallen: Array, stood: Array, bound: Array) -> Pairs:
    """Pairs of runs of one record at two levels; arguments as of `repeated`."""
    low, high = np.triu_indices(bound.size, 1)
    fell, held = _shares(fallen, stood)
    return _crossed(bound[low], bound[high], fell[:, low], held[:, low], fell[:, high],
                    held[:, high])  # fmt: skip


def between_ways(first: tuple[Array, Array, Array], second: tuple[Array, Array, Array]) -> Pairs:
    """Pairs of runs of one record at one level by two ways: fallen, stood and bound of each."""
    fell, held = _shares(*first[:2])
    fell_too, held_too = _shares(*second[:2])
    return _crossed(first[2], second[2], fell, held, fell_too, held_too)


def _shares(fallen: Array, stood: Array) -> tuple[Array, Array]:
    runs = np.maximum(fallen + stood, 1.0)
    return fallen / runs, stood / runs


def _crossed(first, second, fell, held, fell_too, held_too) -> Pairs:
    def count(a: Array, b: Array) -> Array:
        return np.sum(a * b, axis=0)

    return Pairs(
        first,
        second,
        count(fell, fell_too),
        count(fell, held_too),
        count(held, fell_too),
        count(held, held_too),
    )


def bounds(levels: Array, fallen: Array, stood: Array) -> tuple[Array, float]:
    """Levels on the scale of the curve fitted to all runs, (n_level,), and the curve's beta.

    Raises
    ------
    FitError
        If there is no curve.
    """
    fit = fit_stripes(levels, fallen.sum(axis=0), (fallen + stood).sum(axis=0))
    return np.log(levels / fit.theta) / fit.beta, fit.beta


@dataclass(frozen=True)
class Parts:
    """Shares of beta squared; they add up to 1.

    Attributes
    ----------
    numerical : float
        Comes back in no repetition: the integration's own.
    level : float
        Comes back, but differs from level to level of a record.
    record : float
        From record to record.
    beta : float
        Of the curve of all repetitions.
    """

    numerical: float
    level: float
    record: float
    beta: float


def parts_of(levels: Array, fallen: Array, stood: Array) -> Parts:
    """Shares of beta squared of one study made several times.

    Parameters
    ----------
    levels : ndarray, (n_level,)
    fallen, stood : ndarray, (n_record, n_level)
        Repetitions of each run by their verdict.

    Raises
    ------
    FitError
        If there is no curve.
    """
    bound, beta = bounds(levels, fallen, stood)
    same = repeated(fallen, stood, bound).correlation()
    record = min(same, across_levels(fallen, stood, bound).correlation())
    return Parts(1.0 - same, same - record, record, beta)


def resampled_parts(
    levels: Array, fallen: Array, stood: Array, resamples: int, seed: int
) -> Array:
    """`parts_of` for records drawn with replacement, (n, 4): draws without a curve are left out.

    Parameters
    ----------
    levels, fallen, stood
        As of `parts_of`.
    resamples, seed : int
    """
    found = []
    for drawn in draws(fallen.shape[0], resamples, seed):
        try:
            parts = parts_of(levels, fallen[drawn], stood[drawn])
        except FitError:
            continue
        found.append((parts.numerical, parts.level, parts.record, parts.beta))
    return np.array(found).reshape(-1, 4)


def draws(n_record: int, resamples: int, seed: int) -> NDArray[np.int64]:
    """Records drawn with replacement, (resamples, n_record); the same for the same arguments."""
    return np.random.default_rng(seed).integers(0, n_record, (resamples, n_record))
