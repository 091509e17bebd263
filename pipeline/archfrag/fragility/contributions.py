"""Collapses divided by category, level by level, and the rate of collapse divided as they are.

By magnitude and distance the rate shows which records of the set cause it. This is no
deaggregation of the hazard: records are run at levels that their earthquakes did not reach.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict, draws_of_records, wilson
from archfrag.fragility.curve import BoolArray, FloatArray, IntArray, rising, shaped, tails

RESAMPLES = 1000
LEAST_ASSIGNED = 0.05  # fraction of a rate that is divided by category
NOT_KNOWN = "not known"


@dataclass(frozen=True)
class Contributions:
    """The rate of collapse, or the number of collapses, by category."""

    categories: tuple[str, ...]
    counts: IntArray  #: (n_category, n_level), collapses
    rate: FloatArray  #: (n_category, n_level), of collapse [1/year], or `counts`
    unassigned: FloatArray  #: (n_level,), rate of levels with no collapse seen [1/year]
    fraction: FloatArray  #: (n_category,), of the rate that is assigned [1]; nan if none is
    lower: FloatArray  #: (n_category,), of the interval of `fraction`
    upper: FloatArray
    n_effective: float = np.nan  #: independent collapses that the interval supposes, if known

    @property
    def shown(self) -> BoolArray:
        """Categories with a part of the rate, (n_category,); none if hardly any is assigned."""
        assigned = float(self.rate.sum())
        enough = np.bool_(assigned > LEAST_ASSIGNED * (assigned + float(self.unassigned.sum())))
        return np.logical_and(self.rate.any(axis=1), enough)


def deaggregate(
    verdict: ArrayLike, category: ArrayLike, categories: Sequence[str], *, confidence: float = 0.9
) -> Contributions:
    """Divide the collapses at each level by category, as `contributions` divides the rate.

    The same records collapse at several levels, so that Wilson's interval of the fractions counts
    ``(sum m)^2 / sum m^2`` collapses, where m are those of the records (Kish 1965, *Survey
    Sampling*). `verdict`, (n_record, n_level), holds codes of `Verdict`.
    """
    collapsed = np.asarray(verdict) == Verdict.COLLAPSED
    counts = _by_category(collapsed, category, len(categories)).sum(axis=1)
    of_record = collapsed.sum(axis=1).astype(float)
    total = float(of_record.sum())
    effective = total**2 / float(of_record @ of_record) if total else 0.0
    fraction = counts.sum(axis=1) / (total or np.nan)
    ends = wilson(fraction * effective, np.full(len(counts), effective), confidence)
    rate, unassigned = counts.astype(float), np.zeros(counts.shape[1])
    return Contributions(tuple(categories), counts, rate, unassigned, fraction, *ends, effective)


def contributions(
    level_rate: ArrayLike, collapsed: ArrayLike, category: ArrayLike, categories: Sequence[str], *,
    event: ArrayLike | None = None, seed: int = 1, confidence: float = 0.9,
) -> Contributions:  # fmt: skip
    """Divide the rate of collapse of each level by category.

    Rate of a category = sum over levels of rate(level) P(category | collapse, level). The band is
    the percentile bootstrap of earthquakes, each with its records and their collapses at all
    levels; a resample in which a level has no collapse leaves the rate of this level out. A
    category of fewer than two collapses has none.

    `level_rate`, (n_level,), is that of collapse by motions of each level [1/year], from
    `rate_by_level`; `collapsed` and `category`, (n_record, n_level), whether a run collapsed and
    its position in `categories` (else InputError); `event`, (n_record,), the earthquake of each
    record, its own if not given.
    """
    collapse = np.asarray(collapsed, dtype=bool)
    rates = shaped(level_rate, collapse.shape[1:], "level_rate").astype(float)
    if not np.all(rates >= 0.0):
        raise InputError(f"level_rate holds {rates.min():g}; a rate is a number from 0 upwards")
    masks = _by_category(collapse, category, len(categories))
    counts = masks.sum(axis=1)

    def divided(counts: IntArray) -> FloatArray:  # (n_category, ..., n_level)
        return rates * counts / np.maximum(counts.sum(axis=0), 1)

    rate = divided(counts)
    unassigned = np.where(counts.sum(axis=0) > 0, 0.0, rates)
    times = draws_of_records(event, len(collapse), seed, RESAMPLES)
    drawn = divided(times @ masks).sum(axis=-1)  # (category, resample)
    total = drawn.sum(axis=0)
    ends = np.full((2, len(counts)), np.nan)
    if total.any():
        known = drawn[:, total > 0.0] / total[total > 0.0]
        ends = np.quantile(known, tails(confidence), axis=1)
    ends = np.where(counts.sum(axis=1) < 2, np.nan, ends)
    with np.errstate(invalid="ignore"):
        fraction = rate.sum(axis=1) / (rate.sum() or np.nan)
    return Contributions(tuple(categories), counts, rate, unassigned, fraction, *ends)


def _by_category(collapse: BoolArray, category: ArrayLike, n_category: int) -> BoolArray:
    """Collapses of each category, (n_category, n_record, n_level); InputError if one has none."""
    kind = shaped(category, collapse.shape, "category")
    foreign = kind[collapse & ~np.isin(kind, np.arange(n_category))]
    if foreign.size:
        raise InputError(
            f"category holds {foreign.flat[0]!s} for a run that collapsed; it must be from 0 to "
            f"{n_category - 1}, a position in categories"
        )
    return collapse & (kind == np.arange(n_category)[:, None, None])


def level_edges(levels: ArrayLike) -> FloatArray:
    """Edges between levels that increase, at their geometric means, (n_level - 1,)."""
    given = rising(levels, "levels")
    return np.sqrt(given[1:] * given[:-1])


def implied_collapses(
    collapsed: ArrayLike, simulated: ArrayLike, category: ArrayLike
) -> tuple[BoolArray, NDArray]:
    """Fill the gaps of a bisection in `collapsed` and `category`, (n_record, n_level): each level
    is as the nearest lower one of its record that was simulated.
    """
    collapse, kind = np.asarray(collapsed, dtype=bool), np.asarray(category)
    source = np.where(np.asarray(simulated, dtype=bool), np.arange(collapse.shape[1]), -1)
    source = np.maximum.accumulate(source, axis=1)
    row = np.arange(collapse.shape[0])[:, None]
    filled = (source >= 0) & collapse[row, source]
    return filled, np.where(filled, kind[row, source], kind)


def value_bins(
    values: ArrayLike, edges: Sequence[float], unit: str = ""
) -> tuple[IntArray, tuple[str, ...]]:
    """Bin of each value, (n,), below, between or from the last of the rising edges on, and the
    names of the bins; nan has a bin of its own.
    """
    values, unit = np.asarray(values, dtype=float), f" {unit}" if unit else ""
    between = (f"{a:g} to {b:g}{unit}" for a, b in pairwise(edges))
    names = f"below {edges[0]:g}{unit}", *between, f"{edges[-1]:g}{unit} and more", NOT_KNOWN
    place = np.where(np.isnan(values), len(edges) + 1, np.searchsorted(edges, values, "right"))
    return place.astype(np.int64), names
