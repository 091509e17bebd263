"""Collapses divided by category, level by level, and the rate of collapse divided as they are.

By magnitude and distance the rate shows which records of the set cause it. This is no
deaggregation of the hazard: records are run at levels that their earthquakes did not reach.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from archfrag.fragility.counts import Verdict, wilson
from archfrag.fragility.curve import BoolArray, FloatArray, IntArray, rising

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
    #: (n_category,), of the interval of `fraction`, of collapses only
    lower: FloatArray = field(default_factory=lambda: np.empty(0))
    upper: FloatArray = field(default_factory=lambda: np.empty(0))
    n_effective: float = np.nan  #: independent collapses that the interval supposes

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
    of_record = collapsed.sum(axis=1).astype(float)
    found = contributions(collapsed.sum(axis=0), collapsed, category, categories)
    effective = float(of_record.sum() ** 2 / max(of_record @ of_record, 1.0))
    size = np.full(len(categories), effective)
    lower, upper = wilson(found.fraction * effective, size, confidence)
    return replace(found, lower=lower, upper=upper, n_effective=effective)


def contributions(
    level_rate: ArrayLike, collapsed: ArrayLike, category: ArrayLike, categories: Sequence[str]
) -> Contributions:
    """Divide the rate of collapse of each level by category.

    Rate of a category = sum over levels of rate(level) P(category | collapse, level).

    `level_rate`, (n_level,), is that of collapse by motions of each level [1/year], from
    `rate_by_level`; `collapsed` and `category`, (n_record, n_level), whether a run collapsed and
    its position in `categories`.
    """
    collapse, kind = np.asarray(collapsed, dtype=bool), np.asarray(category)
    rates = np.asarray(level_rate, dtype=float)
    counts = np.array([(collapse & (kind == i)).sum(axis=0) for i in range(len(categories))])
    total = counts.sum(axis=0)
    rate = rates * counts / np.maximum(total, 1)
    unassigned = np.where(total > 0, 0.0, rates)
    fraction = rate.sum(axis=1) / (rate.sum() or np.nan)
    return Contributions(tuple(categories), counts, rate, unassigned, fraction)


def level_edges(levels: ArrayLike) -> FloatArray:
    """Edges between levels that increase, at their geometric means, (n_level - 1,)."""
    given = rising(levels, "levels")
    return np.sqrt(given[1:] * given[:-1])


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
