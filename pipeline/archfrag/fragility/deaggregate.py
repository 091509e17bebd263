"""Collapses shared out to categories: how, where, after what the chains fell, at each level."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.intervals import check_confidence

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Deaggregation:
    """Collapses of a study by category.

    Attributes
    ----------
    categories : tuple of str
    counts : ndarray of int, (n_category, n_level)
        Collapses of each category at each level.
    collapsed : ndarray of int, (n_level,)
        All collapses; the sum of `counts` over the categories.
    n : ndarray of int, (n_level,)
        Runs that collapsed or stood.
    fraction, lower, upper : ndarray, (n_category, n_level)
        Share of the collapses of a level [1], with the ends of its interval; nan where nothing
        collapsed.
    overall, overall_lower, overall_upper : ndarray, (n_category,)
        The same for the collapses of all levels together.
    n_effective : float
        Number of independent collapses that the interval of `overall` supposes.
    confidence : float
        Two-sided, of each interval by itself.
    """

    categories: tuple[str, ...]
    counts: IntArray
    collapsed: IntArray
    n: IntArray
    fraction: FloatArray
    lower: FloatArray
    upper: FloatArray
    overall: FloatArray
    overall_lower: FloatArray
    overall_upper: FloatArray
    n_effective: float
    confidence: float

    @property
    def probability(self) -> FloatArray:
        """Share of all runs that decide, (n_category, n_level); nan where none does.

        The categories add up to the observed fraction of collapses: the point of the fragility
        curve, split.
        """
        return self.counts / np.where(self.n > 0, self.n, np.nan)


def deaggregate(
    verdict: ArrayLike, category: ArrayLike, categories: Sequence[str], *, confidence: float = 0.9
) -> Deaggregation:
    """Share out the collapses at each level to categories.

    At one level every record is run once: the runs are taken to be independent, and each share
    has Wilson's score interval (Wilson 1927, J. Am. Stat. Assoc. 22, 209-212). Over all levels
    the same records collapse again and again, most often in the same way. The interval of the
    overall shares therefore counts no more than ``(sum m)^2 / sum m^2`` collapses, where m are
    the numbers of collapses of the records (Kish 1965, *Survey Sampling*, sections 5.4 and
    11.7): what is left if all collapses of a record tell the same.

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level)
        Codes of `archfrag.fragility.counts.Verdict`; unfinished runs and solver failures count
        as neither.
    category : array_like of int, (n_record, n_level)
        For each run that collapsed the position of its category in `categories`; any other
        number elsewhere.
    categories : sequence of str
        Names.
    confidence : float
        Two-sided, between 0 and 1.

    Returns
    -------
    Deaggregation

    Raises
    ------
    InputError
        If the shapes differ, a code is no verdict, a run that collapsed has no category, or
        `confidence` is not between 0 and 1.

    Examples
    --------
    Three records at two levels; the first two arches fall by hinging, the third by sliding.

    >>> from archfrag.fragility.deaggregate import deaggregate
    >>> verdict = [[0, 1], [1, 1], [0, 1]]
    >>> mode = [[-1, 0], [0, 0], [-1, 1]]
    >>> shares = deaggregate(verdict, mode, ["hinging", "sliding"])
    >>> shares.counts.tolist()
    [[1, 2], [0, 1]]
    >>> shares.overall.tolist()
    [0.75, 0.25]
    >>> [round(float(end), 3) for end in (shares.lower[1, 1], shares.upper[1, 1])]
    [0.078, 0.746]
    """
    counted = count_verdicts(verdict)
    codes, kind = np.asarray(verdict), np.asarray(category)
    if codes.ndim != 2 or kind.shape != codes.shape:
        raise InputError(
            f"verdict has shape {codes.shape}, category {kind.shape}; both must be (n_record, "
            "n_level)"
        )
    names = tuple(categories)
    fell = codes == Verdict.COLLAPSED
    foreign = kind[fell & ~np.isin(kind, np.arange(len(names)))]
    if foreign.size:
        raise InputError(
            f"category holds {foreign.flat[0]!s} for a run that collapsed; it must be from 0 to "
            f"{len(names) - 1}, a position in categories"
        )
    counts = np.array(
        [np.count_nonzero(fell & (kind == i), axis=0) for i in range(len(names))], dtype=np.int64
    ).reshape(len(names), codes.shape[1])
    collapsed = counted.collapsed
    lower, upper = wilson(counts, np.broadcast_to(collapsed, counts.shape), confidence)
    of_record = fell.sum(axis=1).astype(float)
    total = float(of_record.sum())
    effective = total**2 / float(of_record @ of_record) if total else 0.0
    with np.errstate(invalid="ignore"):
        fraction = counts / np.where(collapsed > 0, collapsed, np.nan)
        overall = counts.sum(axis=1) / (total or np.nan)
    low, high = wilson(overall * effective, np.full(len(names), effective), confidence)
    return Deaggregation(
        names, counts, collapsed, counted.n, fraction, lower, upper, overall, low, high,
        effective, confidence,
    )  # fmt: skip


def wilson(k: ArrayLike, n: ArrayLike, confidence: float = 0.9) -> tuple[FloatArray, FloatArray]:
    """Score interval of a binomial fraction (Wilson 1927).

    Parameters
    ----------
    k, n : array_like, same shape
        Successes among n; need not be whole, 0 <= k <= n.
    confidence : float
        Two-sided, between 0 and 1.

    Returns
    -------
    (ndarray, ndarray)
        Lower and upper end, shape of `k`; nan where n = 0.

    Raises
    ------
    InputError
        If `confidence` is not between 0 and 1.

    Examples
    --------
    >>> from archfrag.fragility.deaggregate import wilson
    >>> low, high = wilson([0.0, 5.0], [10.0, 10.0], confidence=0.95)
    >>> low.round(4).tolist(), high.round(4).tolist()
    ([0.0, 0.2366], [0.2775, 0.7634])
    """
    check_confidence(confidence)
    k = np.asarray(k, dtype=float)
    n = np.where(np.asarray(n) > 0, n, np.nan).astype(float)
    z = ndtri(0.5 + 0.5 * confidence)
    centre = (k + 0.5 * z * z) / (n + z * z)
    reach = z / (n + z * z) * np.sqrt(np.maximum(k * (n - k) / n, 0.0) + 0.25 * z * z)
    # At k = 0 and k = n the ends are 0 and 1 but for rounding.
    lower = np.where(k > 0.0, np.maximum(centre - reach, 0.0), 0.0 * n)
    upper = np.where(k < n, np.minimum(centre + reach, 1.0), 1.0 + 0.0 * n)
    return lower, upper
