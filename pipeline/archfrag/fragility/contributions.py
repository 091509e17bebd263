"""The rate of collapse shared out: by mechanism, by magnitude, by distance, level by level.

The rate of each level (`archfrag.fragility.risk.rate_by_level`) goes to the categories as the
collapses seen there do: share of a category = sum over levels of rate(level) P(category |
collapse, level). By magnitude and distance this says which records of the set did it. It is
conditional on the set, and no deaggregation of the hazard, since records are run at levels that
their own earthquakes need not have reached.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.intervals import check_confidence

IntArray = NDArray[np.int64]
RESAMPLES = 1000
NOT_KNOWN = "not known"


@dataclass(frozen=True)
class Contributions:
    """The rate of collapse by category.

    Attributes
    ----------
    categories : tuple of str
    counts : ndarray of int, (n_category, n_level)
        Collapses.
    rate : ndarray, (n_category, n_level)
        Rate of collapse [1/year].
    unassigned : ndarray, (n_level,)
        Rate of levels at which the fitted curve expects collapses and none was seen [1/year].
    fraction, lower, upper : ndarray, (n_category,)
        Of the rate that is assigned [1], with its band from resampled records; nan if none is.
    confidence : float
        Two-sided.
    """

    categories: tuple[str, ...]
    counts: IntArray
    rate: FloatArray
    unassigned: FloatArray
    fraction: FloatArray
    lower: FloatArray
    upper: FloatArray
    confidence: float


def contributions(
    level_rate: ArrayLike,
    collapsed: ArrayLike,
    category: ArrayLike,
    categories: Sequence[str],
    *,
    seed: int = 1,
    confidence: float = 0.9,
) -> Contributions:
    """Share out the rate of collapse of each level to categories.

    The band is the percentile bootstrap of whole records, each with its collapses at all levels;
    a resample in which a level has no collapse leaves the rate of this level out.

    Parameters
    ----------
    level_rate : array_like, (n_level,)
        Rate of collapse by motions of each level [1/year].
    collapsed : array_like of bool, (n_record, n_level)
    category : array_like of int, (n_record, n_level)
        Position in `categories` of each run that collapsed; any number elsewhere.
    categories : sequence of str
    seed : int
        Of numpy's default generator.
    confidence : float
        Two-sided, between 0 and 1.

    Raises
    ------
    InputError
        If the shapes do not agree, a rate is negative, a run that collapsed has no category, or
        `confidence` is not between 0 and 1.

    Examples
    --------
    >>> from archfrag.fragility.contributions import contributions
    >>> found = contributions(
    ...     [3e-4, 1e-4], [[True, True], [False, True]], [[0, 0], [0, 1]], ["hinging", "sliding"]
    ... )
    >>> found.fraction.tolist()
    [0.875, 0.125]
    """
    rates = np.asarray(level_rate, dtype=float)
    fell, kind = np.asarray(collapsed, dtype=bool), np.asarray(category)
    if fell.ndim != 2 or kind.shape != fell.shape or rates.shape != fell.shape[1:]:
        raise InputError(
            f"level_rate has shape {rates.shape}, collapsed {fell.shape}, category {kind.shape}; "
            "they must be (n_level,) and twice (n_record, n_level)"
        )
    if not np.all(rates >= 0.0):
        raise InputError("level_rate holds a number that is no rate; rates are from 0 upwards")
    check_confidence(confidence)
    names = tuple(categories)
    foreign = kind[fell & ~np.isin(kind, np.arange(len(names)))]
    if foreign.size:
        raise InputError(
            f"category holds {foreign.flat[0]!s} for a run that collapsed; it must be from 0 to "
            f"{len(names) - 1}, a position in categories"
        )
    ways = np.stack([fell & (kind == i) for i in range(len(names))])  # (category, record, level)
    counts = ways.sum(axis=1)
    everything = counts.sum(axis=0)
    rate = rates * counts / np.maximum(everything, 1)
    unassigned = np.where(everything > 0, 0.0, rates)
    assigned = rate.sum()
    lower, upper = _resampled(rates, ways, seed, confidence)
    with np.errstate(invalid="ignore"):
        fraction = rate.sum(axis=1) / (assigned or np.nan)
    return Contributions(names, counts, rate, unassigned, fraction, lower, upper, confidence)


def _resampled(
    rates: FloatArray, ways: NDArray[np.bool_], seed: int, confidence: float
) -> tuple[FloatArray, FloatArray]:
    """Ends of the band of each category's fraction, (n_category,)."""
    n_category, n_record, _ = ways.shape
    generator = np.random.default_rng(seed)
    times = generator.multinomial(n_record, np.full(n_record, 1.0 / n_record), RESAMPLES)
    fractions = np.zeros((n_category, RESAMPLES))
    counts = [times @ way for way in ways]  # each (resample, level)
    everything = np.maximum(np.sum(counts, axis=0), 1)
    for i, count in enumerate(counts):
        fractions[i] = count / everything @ rates
    total = fractions.sum(axis=0)
    if not total.any():
        return np.full(n_category, np.nan), np.full(n_category, np.nan)
    known = fractions[:, total > 0.0] / total[total > 0.0]
    tail = 0.5 - 0.5 * confidence
    lower, upper = np.quantile(known, [tail, 1.0 - tail], axis=1)
    return lower, upper


def level_edges(levels: ArrayLike) -> FloatArray:
    """Edges between levels, at their geometric means, (n_level - 1,).

    Raises
    ------
    InputError
        If the levels are not positive and increasing.
    """
    levels = np.asarray(levels, dtype=float)
    if levels.ndim != 1 or not np.all(levels > 0.0) or not np.all(np.diff(levels) > 0.0):
        raise InputError("levels must be a list of positive intensities that increase")
    return np.sqrt(levels[1:] * levels[:-1])


def implied_collapses(
    collapsed: ArrayLike, simulated: ArrayLike, category: ArrayLike
) -> tuple[NDArray[np.bool_], NDArray]:
    """Collapses that runs left out by a bisection would have shown, capacity being one number.

    A level that was not simulated counts as collapsed if its record collapsed at the nearest lower
    level that was, in the way it did there.

    Parameters
    ----------
    collapsed, simulated : array_like of bool, (n_record, n_level)
    category : array_like, (n_record, n_level)

    Returns
    -------
    (ndarray, ndarray), each (n_record, n_level)
        `collapsed` and `category` with the gaps filled.

    Examples
    --------
    >>> from archfrag.fragility.contributions import implied_collapses
    >>> fell, way = implied_collapses([[0, 0, 1, 0]], [[1, 0, 1, 0]], [[-1, -1, 2, -1]])
    >>> fell.tolist(), way.tolist()
    ([[False, False, True, True]], [[-1, -1, 2, 2]])
    """
    fell, known = np.asarray(collapsed, dtype=bool), np.asarray(simulated, dtype=bool)
    kind = np.asarray(category)
    place = np.where(known, np.arange(fell.shape[1]), -1)
    source = np.maximum.accumulate(place, axis=1)
    row = np.arange(fell.shape[0])[:, None]
    filled = (source >= 0) & fell[row, np.maximum(source, 0)]
    return filled, np.where(filled, kind[row, np.maximum(source, 0)], kind)


def value_bins(
    values: ArrayLike, edges: ArrayLike, unit: str = ""
) -> tuple[IntArray, tuple[str, ...]]:
    """Bin of each value and the names of the bins; nan has a bin of its own.

    Parameters
    ----------
    values : array_like, (n,)
    edges : array_like, (n_edge,)
        Increasing; the bins are below the first, between them, and from the last on.
    unit : str
        Written after the numbers.

    Returns
    -------
    (ndarray of int, tuple of str)
        (n,), positions in the names.

    Examples
    --------
    >>> from archfrag.fragility.contributions import value_bins
    >>> place, names = value_bins([5.9, 7.4, float("nan")], [6.0, 7.0])
    >>> place.tolist(), names
    ([0, 2, 3], ('below 6', '6 to 7', '7 and more', 'not known'))
    """
    values, edges = np.asarray(values, dtype=float), np.asarray(edges, dtype=float)
    if edges.ndim != 1 or edges.size == 0 or not np.all(np.diff(edges) > 0.0):
        raise InputError("edges of bins must be a list of at least one number that increases")
    unit = f" {unit}" if unit else ""
    names = (
        f"below {edges[0]:g}{unit}",
        *(f"{a:g} to {b:g}{unit}" for a, b in pairwise(edges)),
        f"{edges[-1]:g}{unit} and more",
        NOT_KNOWN,
    )
    place = np.where(np.isnan(values), edges.size + 1, np.searchsorted(edges, values, "right"))
    return place.astype(np.int64), names
