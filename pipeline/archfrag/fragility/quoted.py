"""The curve and band that a report quotes, the isotonic curve, and a test of the lognormal shape.

docs/evidence/data/bands_coverage.csv shows how often the band holds the truth.
"""

from dataclasses import replace
from functools import lru_cache
from itertools import combinations

import numpy as np
import scipy  # whose parts are loaded when they are used
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, xlogy

from archfrag.errors import FitError
from archfrag.fragility.curve import Curve, FloatArray, log_intensity, tails
from archfrag.fragility.posterior import Posterior, fit_capacity_posterior
from archfrag.fragility.probit import binomial_lines
from archfrag.fragility.verdicts import (
    RESAMPLES,
    Brackets,
    draws_of_records,
    independent_number,
    numbered,
)


def quoted_band(
    brackets: Brackets,
    im: ArrayLike,
    *,
    confidence: float = 0.9,
    groups: ArrayLike | None = None,
    unit: str = "event",
) -> Curve:
    """Return the curve of records that were run at several levels, with band and intervals.

    Rows with the same label in `groups`, (n_record,), such as their event, count as fewer, the
    more alike their capacities are; `unit` is the noun for a group. The band is at intensities
    `im` >= 0, (n,). FitError if there is one group only, or if nothing bounds theta from below, or
    nothing from above.
    """
    posterior, number = capacity_posterior(brackets, groups)
    method = "capacities, right Haar prior"
    what = "records and their capacities are independent"
    alike = "Capacities"
    rows = "rows of runs"
    if brackets.single:
        method = "independent runs, Jeffreys prior"
        what = "runs are independent, each with a motion of its own"
        alike = "Verdicts"
        rows = "single runs"
    if groups is not None:
        count = f"{brackets.run.sum()} {rows} count as {number:.3g}"
        what = f"{unit}s are independent. {alike} within {unit}s resemble each other, so {count}"
    if posterior.scatter:
        scatter = f"{posterior.scatter:.2g} in natural logarithms, which beta includes"
        what += f"; single runs of a record scatter about its capacity by {scatter}"
    return replace(
        posterior.with_band(im, confidence),
        method=f"posterior of {method}",
        assumptions=f"Capacity is lognormal, and {what}.",
        n_independent=number,
        n_non_monotone=int(brackets.contradictions.sum()),
    )


def capacity_posterior(
    brackets: Brackets, groups: ArrayLike | None = None
) -> tuple[Posterior, float]:
    """Return the posterior of a curve, and the effective number of records.

    `groups` are as for `quoted_band`.
    """
    known = brackets.of_records()
    size = float(known.lower.size)
    number = size
    if groups is not None:
        number = independent_records(known, np.asarray(groups)[..., brackets.run])
    if number == size:
        return _of_independent(brackets), number
    return fit_capacity_posterior(known, number), number


@lru_cache(maxsize=1)
def _of_independent(brackets: Brackets) -> Posterior:
    """Return the posterior of independent records.

    The last one is kept, since the band and the test of its shape both need it.
    """
    return fit_capacity_posterior(brackets.of_records())


def shared_events(event: ArrayLike) -> NDArray[np.str_] | None:
    """Return labels of groups from names of earthquakes, or None if no records share one.

    A record without a name is a group of its own. None is returned too if all records are of one
    earthquake.
    """
    names = np.asarray(event).astype(str)
    labels = np.where(names == "", [f"record {i}" for i in range(names.size)], names)
    number = np.unique(labels).size
    return labels if 1 < number < names.size else None


def independent_records(brackets: Brackets, groups: ArrayLike) -> float:
    """Return the effective number of records, some of which share an event.

    It is `independent_number` of standardised ln capacities, each of which is the mean within its
    bracket by the curve of all records. `groups` are (n_record,) labels. Groups that cross, as
    earthquakes and first shocks do, are (n_way, n_record), and count all at once.
    """
    labels = np.asarray(groups)
    if labels.ndim == 2:
        return _crossed_records(_standardised(brackets), labels)
    if np.unique(labels).size == labels.size:
        return float(labels.size)
    return independent_number(_standardised(brackets), labels)


def _standardised(brackets: Brackets) -> FloatArray:
    """Return the mean of standardised ln capacity in each bracket, by the curve of all records."""
    curve = fit_capacity_posterior(brackets.without_scatter()).curve
    ends = np.array([brackets.lower, brackets.upper])
    low, high = log_intensity(ends / curve.theta) / curve.beta
    mass = np.maximum(ndtr(high) - ndtr(low), 1e-12)
    first = np.exp(-0.5 * low**2) - np.exp(-0.5 * high**2)
    return np.clip(first / (np.sqrt(2.0 * np.pi) * mass), low, high)


def _crossed_records(values: FloatArray, groups: NDArray) -> float:
    """Return the effective number of `values`, (n,), with several labels each, (n_way, n).

    It is n / (1 + 2 sum N rho / n). The sum is over the kinds of pairs that share some labels; of
    each kind there are N pairs with the correlation rho. 1 - rho is the mean squared difference of
    these pairs over that of pairs that share no label; if the groups cross evenly, this is the
    analysis of variance with two factors (Searle, Casella and McCulloch 1992, *Variance
    Components*, chapter 4). Half the standard error is added to each rho.
    """
    labels = np.array([numbered(each) for each in groups])
    for name in groups[labels.max(axis=1) == 0, 0]:
        raise FitError(f"all rows belong to one group, {name!s}; two are needed")
    n = values.size
    alike = 0.0
    count_of = {}
    own = dict[tuple[int, ...], FloatArray]()
    for k in reversed(range(len(labels) + 1)):
        for shared in combinations(range(len(labels)), k):
            _, place, size = np.unique(
                labels[[*shared]].T, axis=0, return_inverse=True, return_counts=True
            )
            first, second = (np.bincount(place.ravel(), values**p) for p in (1, 2))
            pair = [size @ second - first @ first, size @ size - n]
            every = 0.5 * np.array(pair)
            count_of[shared] = every[1]
            more = (own[each] for each in own if {*shared} < {*each})
            own[shared] = every - sum(more)
    apart, number = own.pop(())
    if not number * apart:
        return 1.0
    for shared, (squares, pairs) in own.items():
        count = count_of[shared]
        rho = max(1.0 - squares / max(pairs, 1.0) * number / apart, 0.0)
        error = (1.0 - rho) * (1.0 + 2.0 * count / n * rho) / np.sqrt(max(count, 1.0))
        alike += pairs * min(rho + 0.5 * error, 1.0)
    return float(n / (1.0 + 2.0 * alike / n))


def isotonic_curve(
    brackets: Brackets,
    event: ArrayLike | None = None,
    resamples: int = RESAMPLES,
    confidence: float = 0.9,
) -> dict[str, FloatArray]:
    """Return the likeliest curve that never falls, and its band.

    The keys are im, probability, lower and upper, (n_level,) each. Pool adjacent violators gives
    the maximum of the binomial likelihood under that condition alone (Ayer, Brunk, Ewing, Reid and
    Silverman 1955, Ann. Math. Stat. 26). The band is by a bootstrap of records; if `event`,
    (n_record,), is given, whole earthquakes are drawn with all their records. It is somewhat too
    narrow: a nominal 90 % held a lognormal curve (beta 0.4, 15 levels, 24 records, 200 studies) at
    p = 0.1, 0.25, 0.5, 0.75, 0.9 in 86, 90, 88, 87, 79 %. FitError without two levels.
    """
    levels, collapses, n = brackets.at_levels(filled=True)
    if levels.size < 2:
        raise FitError(
            "all runs are at one level, {}, which gives no curve; add levels", levels[0]
        )
    times = draws_of_records(event, len(n), resamples=resamples).astype(float)
    draws = []
    for k, count in zip(times @ collapses, times @ n):
        at = np.flatnonzero(count)  # a level without runs lies between its neighbours
        if at.size:  # else no record that was drawn has a run
            pooled = _pooled(k[at], count[at])
            draws.append(np.interp(np.arange(levels.size), at, pooled))
    lower, upper = np.quantile(draws, tails(confidence), axis=0)
    value = _pooled(collapses.sum(axis=0), n.sum(axis=0))
    return {"im": levels, "probability": value, "lower": lower, "upper": upper}


def _pooled(collapses: FloatArray, n: FloatArray) -> FloatArray:
    """Return isotonic fractions of collapse, (n_level,); every level must have runs."""
    return np.clip(
        scipy.optimize.isotonic_regression(collapses / n, weights=n).x, 0.0, 1.0
    )


def check_lognormal(
    brackets: Brackets, *, seed: int = 1, resamples: int = RESAMPLES
) -> tuple[float, float]:
    """Test the lognormal curve against any curve that rises with intensity.

    The likelihood ratio of the isotonic and the lognormal curve is compared with its values in
    studies drawn from the fitted curve (parametric bootstrap; Davison and Hinkley 1997, section
    4.2). ln capacity of a run is ln theta + beta (sqrt(rho) a + sqrt(1 - rho) e), with a one
    normal number per record and e one per run. Returns the probability of a ratio at least as
    large if the lognormal curve is true, and rho. rho is 1 if no verdicts contradict each other,
    and nan if each record serves once. FitError if the runs have no lognormal curve.
    """
    levels, collapses, made = brackets.at_levels(filled=True)
    x = np.log(levels)
    total = collapses.sum(axis=0)
    n = made.sum(axis=0)
    (a,), (b,), loss, _ = binomial_lines(x, total, n)
    if np.isnan(b):
        raise FitError(
            "these runs have no lognormal curve, so there is nothing to test"
        )
    deviance = _deviances(loss, total[None], n)[0]
    generator = np.random.default_rng(seed)
    z = a + b * x
    rho = np.nan
    drawn = np.empty((resamples, x.size))
    if np.any(made.sum(axis=1) > 1.0):
        rho = 1.0
        if brackets.contradictions.any():
            rho = max(0.0, 1.0 - (_of_independent(brackets).scatter * b) ** 2)
        record, level = np.nonzero(made)
        for row in drawn:
            shared = generator.standard_normal(len(made))[record]
            own = generator.standard_normal(record.size)
            capacity = np.sqrt(rho) * shared + np.sqrt(1.0 - rho) * own
            row[:] = np.bincount(level, z[level] >= capacity, x.size)
    else:
        drawn[:] = generator.binomial(n.astype(int), ndtr(z), drawn.shape)
    _, slopes, losses, _ = binomial_lines(x, drawn, np.broadcast_to(n, drawn.shape))
    values = _deviances(losses, drawn, n)[~np.isnan(slopes)]
    p_value = (1.0 + np.count_nonzero(values >= deviance)) / (1.0 + values.size)
    return float(p_value), float(rho)


def _deviances(loss: FloatArray, collapses: FloatArray, n: FloatArray) -> FloatArray:
    """Return twice the gain in log-likelihood of isotonic over lognormal curves, (n_fit,).

    `loss` is the negative log-likelihood of the lognormal curves.
    """
    p = np.array([_pooled(k, n) for k in collapses])
    likelihood = xlogy(collapses, p) + xlogy(n - collapses, 1.0 - p)
    return 2.0 * (likelihood.sum(axis=1) + loss)
