"""Posterior of a lognormal curve under a proper, objective prior: ten runs give a band too.

Each posterior is summed on one plain grid of ln beta and u = (ln theta - m) / root(beta^2 + d^2)
with m and d the middle and the width of where runs begin to collapse: given beta, the scatter of
ln theta grows with beta. For such priors of fragility curves see Van Biesbroeck, Gauchy, Feau and
Garnier (arXiv 2302.06935 and 2503.07343).
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, logsumexp, ndtr, softmax

from archfrag.errors import FitError
from archfrag.fragility.curve import Curve, FloatArray, Pair, credible_band, tails
from archfrag.fragility.density import Density
from archfrag.fragility.fit import fit_brackets
from archfrag.fragility.verdicts import Brackets, checked_stripes
from archfrag.system import available_cores

# Log-likelihood and log-prior, in (ln theta, ln beta), of ln theta (n, m) and beta (n, 1).
Terms = Callable[[FloatArray, FloatArray], Pair]
# Cells of ln capacity, chances of the runs of some records in each, and weights of the records.
Chances = tuple[slice, FloatArray, FloatArray]

_ROWS = 72  # of the grid: values of beta, and of ln theta for each
_NODES = 96
_SEARCH = 25  # of the grids that find where the posterior is, each way
_DEPTH = 14.0  # of the log-density below its greatest value, at the ends of the grid
# Over the span of ln levels, as from 5 to 95 % a curve spans 3.3 beta; but at least a usual beta:
# levels close together do not show that beta is small.
_LIKELY_BETA = 0.3
_LEAST_LIKELY = 0.35
_MOST_LEVELS = 150  # of runs that each have a level of their own
# Standard deviations between runs: tried at the likeliest curve, and summed over; the fall of the
# log-likelihood below its greatest value at the first and last of the latter.
_TRIED = 16
_SCATTERS = 8
_FALL = 8.0
# Of more records, so many at a time are summed over the cells alone that their runs allow.
_MANY = 1000
_THREADED = 100  # records, from which threads gain
_BLOCK = 200
_LEAST_CHANCE = 1e-90  # over the greatest of a record
ONE_LEVEL = "runs that collapsed or survived are at 1 level; a posterior needs two"
# Quantiles: of cuts, of one standard deviation each way, and the median.
_LEVELS = (0.01, 0.15865525393145707, 0.5, 0.8413447460685429, 0.99)


@dataclass(frozen=True, eq=False)
class Posterior(Density):
    """Posterior of a curve, given the runs."""

    #: Of kind ``"posterior"``: medians of theta and beta, and the log-likelihood there; standard
    #: errors are half the widths of their central 68 %, as their tails are not normal.
    curve: Curve
    #: Standard deviation of ln capacity between single runs of a record, which beta includes.
    scatter: float = 0.0

    def with_band(self, im: ArrayLike, confidence: float = 0.9) -> Curve:
        """Return the curve with central credible intervals, and its band at `im`, (n,)."""
        ends = tails(confidence)
        theta = np.exp(self.log_thetas(ends)).tolist()
        lower, upper = self.band(im, confidence)
        return replace(
            self.curve,
            intervals=(tuple(theta), tuple(self.betas(ends).tolist())),
            im=np.asarray(im).tolist(),
            lower=lower.tolist(),
            upper=upper.tolist(),
            confidence=confidence,
        )

    def band(self, im: ArrayLike, confidence: float = 0.9) -> Pair:
        """Return the central credible interval of the probability of collapse at each `im`."""
        return credible_band(self, im, confidence)


def likely_beta(span: float) -> float:
    """Return the beta at which the prior of single runs is greatest.

    `span` is that of the ln levels.
    """
    return max(_LIKELY_BETA * span, _LEAST_LIKELY)


def fit_posterior(
    im: ArrayLike,
    collapses: ArrayLike,
    n: ArrayLike,
    *,
    one_sided: bool = False,
    share: float = 1.0,
) -> Posterior:
    """Return the posterior of the curve of independent runs, each with a motion of its own.

    Prior: Jeffreys' for the runs that were made, proper at two levels or more (Ibrahim and Laud
    1991, J. Am. Stat. Assoc. 86; Chen, Ibrahim and Kim 2008, the same 103), of beta > 0, times 1 /
    (1 / beta + beta / b^2), which is greatest at beta = b. Here b is `likely_beta` of ln of the
    highest over the lowest level. Jeffreys' alone makes beta too small: at 10 runs 90 % bands hold
    the truth in 78 to 86 %. The second term keeps ten runs with one collapse from making beta and
    theta too large; docs/evidence.md compares them. The likelihood is raised to the power `share`,
    the effective number of runs over the actual one. Arguments as for `fit_stripes`. FitError
    unless the runs are at two levels or more. FitError too if all collapsed or none did, unless
    `one_sided`: then there is a posterior, but it shows the prior.
    """
    im, collapses, n = checked_stripes(im, collapses, n)
    if not one_sided:
        _require_both_sides(im[collapses < n], im[collapses > 0])
    x, place = np.unique(np.log(im[n > 0]), return_inverse=True)
    if x.size > _MOST_LEVELS:  # neighbours together, at their mean
        group = np.arange(x.size) * _MOST_LEVELS // x.size
        x = np.bincount(group, x) / np.bincount(group)
        place = group[place]
    if x.size < 2:
        raise FitError(ONE_LEVEL)
    k, m = (share * np.bincount(place, part[n > 0], x.size) for part in (collapses, n))
    span = x[-1] - x[0]
    likely = likely_beta(span)
    borders = np.append(x[k > 0][:1], x[k < m][-1:])  # first collapse, last survival
    start = borders.mean(), np.clip(0.25 * np.ptp(borders), np.diff(x).min(), span)

    def terms(log_theta: FloatArray, beta: FloatArray) -> Pair:
        z = (x - log_theta[..., None]) / beta[..., None]
        small = log_ndtr(-np.abs(z))
        large = np.log1p(-np.exp(small))
        collapse, survival = np.where(z > 0.0, (large, small), (small, large))
        likelihood = collapse @ k + survival @ (m - k)
        weight = m * np.exp(-z * z - small - large)
        total = weight.sum(axis=-1)
        first = weight @ x
        second = weight @ (x * x)
        determinant = np.maximum(total * second - first**2, 1e-250)
        rare = np.log(beta + beta * (beta / likely) ** 2)
        return likelihood, 0.5 * np.log(determinant) - rare

    return _summed(terms, x, start, m.sum())


def fit_capacity_posterior(
    brackets: Brackets, n_effective: float | None = None
) -> Posterior:
    """Return the posterior of the curve of records that have independent capacities.

    Prior: the right Haar measure 1 / beta of (ln theta, beta), under which the intervals of a
    normal sample are exact, times beta^2 / (beta^2 + d^2 / 12) with d the median width of the
    brackets in ln im, and times 1 / (1 + (beta / r)^2) with r the span of all their ends in ln im,
    so that it stays proper. The likelihood is raised to the power `n_effective` / n. FitError if
    nothing bounds theta from below, or nothing from above. If each record has a single run, the
    posterior is that of `fit_posterior`.

    If some records survive above a level at which they collapsed, ln capacity of a run is that of
    its record, normal about ln theta, and an error of the run, normal with standard deviation s:
    beta^2 is the sum of both variances, and s / beta is uniform from 0 to 1.
    """
    low = brackets.lower
    high = brackets.upper
    _require_both_sides(low[low > 0.0], high[high < np.inf])
    share = float(n_effective or low.size) / low.size
    if brackets.single:
        return fit_posterior(
            np.where(low > 0.0, low, high), high < np.inf, 1, share=share
        )
    if brackets.contradictions.any():
        return _with_scatter(brackets, share)
    pairs, number = np.unique(brackets.logs, axis=1, return_counts=True)
    low, high = pairs
    x = np.unique(pairs[np.isfinite(pairs)])
    if x.size < 2:
        raise FitError(ONE_LEVEL)
    ends = np.r_[-np.inf, x, np.inf]
    chance = ((ends[:-1] >= low[:, None]) & (ends[1:] <= high[:, None])).astype(float)
    width = np.repeat(high - low, number)
    width = width[np.isfinite(width)]
    resolved = max(np.median(width) if width.size else 0.0, np.diff(x).min())
    power = share * number.astype(float)

    def terms(log_theta: FloatArray, beta: FloatArray) -> Pair:
        prior = capacity_prior(beta, resolved, x)
        return _of_cells(ends, [(slice(None), chance, power)], log_theta, beta), prior

    return _summed(terms, x, (np.median(x), resolved), power.sum())


def _require_both_sides(below: FloatArray, above: FloatArray) -> None:
    """Raise FitError unless some levels are below a capacity, and some above one."""
    if above.size and not below.size:
        raise FitError(
            "nothing bounds theta from below: add levels below {}, the lowest tried (a smaller "
            "factor of a cloud)",
            above.min(),
        )
    if below.size and not above.size:
        raise FitError(
            "nothing bounds theta from above: add levels above {}, the highest tried (a larger "
            "factor of a cloud)",
            below.max(),
        )


def _with_scatter(brackets: Brackets, share: float) -> Posterior:
    """Return the posterior for verdicts that contradict each other, summed over scatter s."""
    levels, collapses, n = brackets.at_levels()
    x = np.log(levels)
    if x.size < 2:
        raise FitError(ONE_LEVEL)
    runs, number = np.unique(
        np.stack([collapses, n - collapses]), axis=1, return_counts=True
    )
    power = share * number.astype(float)
    try:
        line = fit_brackets(brackets.lower, brackets.upper)
    except FitError:  # the brackets, without what contradicts them, agree with beta = 0
        line = fit_capacity_posterior(brackets.without_scatter()).curve
    middle = np.nanmedian(brackets.middle) if brackets.bracketed.any() else line.theta
    start = np.log(middle), np.median(np.diff(x))
    tried = np.geomspace(
        0.2 * min(np.diff(x).min(), line.beta), 1.5 * line.beta, _TRIED
    )
    at = np.array([[np.log(line.theta)]]), np.array([[line.beta]])
    blocks = [(runs[:, some], power[some]) for some in _neighbours(runs)]
    fits = np.array([_of_cells(*_chances(x, blocks, s), *at)[0, 0] for s in tried])
    good = np.flatnonzero(fits > fits.max() - _FALL)
    ends = tried[max(good[0] - 1, 0)], tried[min(good[-1] + 1, _TRIED - 1)]
    scatter = np.geomspace(*ends, _SCATTERS)
    step = np.log(scatter[1] / scatter[0])  # s is summed over in equal steps of ln s
    cells = [_chances(x, blocks, s) for s in scatter]

    def by_scatter(log_theta: FloatArray, beta: FloatArray) -> FloatArray:
        def at(s: float, own: tuple[FloatArray, list[Chances]]) -> FloatArray:
            each = np.full(log_theta.shape, -np.inf)
            some = beta[:, 0] > s
            of_records = np.sqrt(np.maximum(beta[some] ** 2 - s**2, (1e-6 * s) ** 2))
            each[some] = _of_cells(*own, log_theta[some], of_records)
            each[some] += np.log(step * s / beta[some])
            return each

        side_by_side = _threads().map if runs.shape[1] >= _THREADED else map
        return np.array([*side_by_side(at, scatter, cells)])

    def terms(log_theta: FloatArray, beta: FloatArray) -> Pair:
        likelihood = logsumexp(by_scatter(log_theta, beta), axis=0)
        return likelihood, capacity_prior(beta, start[1], x)

    known = _summed(terms, x, start, power.sum())
    curve = known.curve
    logs = by_scatter(np.log([[curve.theta]]), np.array([[curve.beta]]))
    weight = softmax(logs[:, 0, 0])
    return replace(known, scatter=float(np.exp(weight @ np.log(scatter))))


@cache
def _threads() -> ThreadPoolExecutor:
    """Return the threads for values of scatter side by side."""
    return ThreadPoolExecutor(min(available_cores(), _SCATTERS))


def _neighbours(runs: FloatArray) -> list[Any]:
    """Return indices of records: all in one, or, of many, those with borders near each other.

    `runs`, (2, n_record, n_level), are collapses and survivals at rising levels.
    """
    n = runs.shape[1]
    if n < _MANY:
        return [slice(None)]
    border = (runs[0] - runs[1]).cumsum(axis=1).argmin(axis=1)
    return np.array_split(border.argsort(kind="stable"), n // _BLOCK)


def _chances(
    x: FloatArray, blocks: Sequence[Pair], scatter: float
) -> tuple[FloatArray, list[Chances]]:
    """Return the ends of cells of ln capacity, and the probabilities of the runs of records.

    The ends are (n_cell + 1,). `blocks` have runs and weights of some records each; the runs,
    (2, n_record, n_level), are collapses and survivals at the ln levels `x`. Probabilities,
    (n_record, n), are those if the capacity of the record lies in the cell.
    """
    parts = np.ceil(np.diff(x) / (0.5 * scatter)).astype(int)
    within = map(partial(np.linspace, endpoint=False), x[:-1], x[1:], parts)
    beyond = scatter * np.arange(0.5, 3.1, 0.5)
    ends = np.concatenate([x[0] - beyond[::-1], *within, x[-1:], x[-1] + beyond])
    step = 0.25 * scatter
    middle = np.r_[ends[0] - step, 0.5 * (ends[1:] + ends[:-1]), ends[-1] + step]
    z = (x[:, None] - middle) / scatter
    above, below = log_ndtr(z), log_ndtr(-z)
    found = list[Chances]()
    for runs, power in blocks:
        chance = np.exp(runs[0] @ above + runs[1] @ below)
        cells = slice(None)
        if len(blocks) > 1:
            least = _LEAST_CHANCE * chance.max(axis=1, keepdims=True)
            at = np.flatnonzero((chance > least).any(axis=0))
            cells = slice(at[0], at[-1] + 1) if at.size else slice(0)
        found.append((cells, chance[:, cells].copy(), power))
    return np.r_[-np.inf, ends, np.inf], found


def _of_cells(
    ends: FloatArray,
    chances: Sequence[Chances],
    log_theta: FloatArray,
    beta: FloatArray,
) -> FloatArray:
    """Return the log-likelihood of records, of the shape of `log_theta`.

    `ends` and `chances` are those of `_chances`.
    """
    logs = np.zeros(log_theta.shape)
    # One beta at a time stays in the cache.
    for row, t, b in zip(logs, log_theta, beta):
        mass = np.diff(ndtr((ends - t[:, None]) / b), axis=1)
        for cells, chance, power in chances:
            likelihood = mass[:, cells] @ chance.T
            np.log(np.maximum(likelihood, 1e-300, out=likelihood), out=likelihood)
            row += likelihood @ power
    return logs


def capacity_prior(beta: FloatArray, resolved: float, x: FloatArray) -> FloatArray:
    """Return the log-prior of capacities in (ln theta, ln beta), for ln levels `x`.

    `resolved` is the median width of the brackets in ln im.
    """
    wide = np.log1p((beta / (x[-1] - x[0])) ** 2)
    return -np.log1p((resolved / beta) ** 2 / 12.0) - wide


def _summed(
    terms: Terms, x: FloatArray, start: tuple[float, float], n: float
) -> Posterior:
    """Return a posterior that is summed on a grid about the ln levels `x`, with its medians.

    `terms` gives likelihood and prior; `start` are the middle m and the width d of the grid; `n`
    is the number of runs or records.
    """
    middle, width = start
    span = x[-1] - x[0]

    def density(log_beta: FloatArray, u: FloatArray) -> tuple[FloatArray, ...]:
        beta = np.exp(log_beta)[:, None]
        scale = np.hypot(beta, width)
        log_theta = middle + u * scale
        value = np.add(*terms(log_theta, beta)) + np.log(scale)
        return beta[:, 0], log_theta, value - value.max()

    reach = 9.0 + span / width
    box = [(np.log(0.05 * np.diff(x).min()), np.log(1e4 * span)), (-reach, reach)]
    for _ in range(20):
        axes = [np.linspace(*ends, _SEARCH) for ends in box]
        kept = density(*axes)[2] > -_DEPTH
        held = [np.flatnonzero(kept.any(axis=1 - axis)) for axis in (0, 1)]
        wider = [(max(at[0] - 1, 0), min(at[-1] + 1, _SEARCH - 1)) for at in held]
        box = [(axis[first], axis[last]) for axis, (first, last) in zip(axes, wider)]
        if min(at.size for at in held) > _SEARCH // 2:
            break
    beta, log_theta, value = density(*map(np.linspace, *zip(*box), (_ROWS, _NODES)))
    known = gridded(beta, log_theta, np.exp(value), (x.size, max(1, round(n))))
    likelihood, _ = terms(known.log_thetas([[0.5]]), known.betas([0.5])[:, None])
    curve = replace(known.curve, log_likelihood=float(likelihood[0, 0]))
    return replace(known, curve=curve)


def gridded(
    beta: FloatArray, log_theta: FloatArray, weight: FloatArray, sizes: tuple[int, int]
) -> Posterior:
    """Return the posterior of a density on a grid, with the curve of its medians.

    `weight`, (n_row, n_node), is the density, which need not be normalised; `sizes` are the
    curve's `n_levels` and `n_total`.
    """
    weight = weight / (weight.sum(axis=1) - 0.5 * (weight[:, 0] + weight[:, -1])).sum()
    known = Density(beta, log_theta, weight)
    t = known.log_thetas(_LEVELS)
    b = known.betas(_LEVELS)
    # The correlation is of values cut at their 1 and 99 % quantiles.
    pair = (
        np.clip(log_theta, t[0], t[4]),
        np.clip(beta, b[0], b[4])[:, None] + 0.0 * log_theta,
    )
    errors = 0.5 * np.array([t[3] - t[1], b[3] - b[1]])
    covariance = np.cov(np.reshape(pair, (2, -1)), aweights=weight.ravel())
    scale = errors / np.sqrt(np.diag(covariance))
    covariance *= np.outer(scale, scale)
    found = float(np.exp(t[2])), float(b[2]), covariance, np.nan, *sizes, "posterior"
    curve = Curve(*found, density=known.compact())
    return Posterior(beta, log_theta, weight, curve)
