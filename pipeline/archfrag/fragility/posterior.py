"""Posterior of a lognormal curve under a proper, objective prior: ten runs give a band too.

The prior of runs rests on Jeffreys', the square root of the determinant of the Fisher
information of the design, which is proper for a probit line at two levels or more, and so leaves
the posterior proper where the likelihood has no maximum (Ibrahim and Laud 1991, Journal of the
American Statistical Association 86; Chen, Ibrahim and Kim 2008, the same 103). For fragility
curves see Van Biesbroeck, Gauchy, Feau and Garnier (arXiv 2302.06935 and 2503.07343).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr

from archfrag.errors import FitError, InputError
from archfrag.fragility.brackets import checked_brackets
from archfrag.fragility.counts import checked_stripes
from archfrag.fragility.curve import Band, FloatArray, Fragility, log_intensity, tails
from archfrag.fragility.fit import likeliest_curve
from archfrag.fragility.grid import LineGrid, line_grid
from archfrag.fragility.lines import log_between

Terms = tuple[FloatArray, FloatArray]
_HALF = np.array([0.5])
_SCATTERS = 16  # standard deviations that are tried
_ONE_SIGMA = np.array([0.15865525393145707, 0.8413447460685429])


@dataclass(frozen=True)
class Posterior:
    """What is known of a curve after the runs."""

    #: Of kind ``"posterior"``: medians of theta and beta; the covariance of (ln theta, beta) is
    #: from half the width of their central 68 %, as their tails are not normal; the log-likelihood
    #: is that of the medians, without binomial coefficients.
    fragility: Fragility
    grid: LineGrid  #: distribution of the probit line in (ln im - centre) / width
    centre: float
    width: float
    #: Standard deviation of ln capacity between single runs of a record, which beta includes.
    scatter: float = 0.0

    def theta_interval(self, confidence: float = 0.9) -> tuple[float, float]:
        """Central credible interval of the median capacity, unit of the levels."""
        ends = self.centre + self.width * self.grid.log_medians(np.array(tails(confidence)))
        low, high = np.exp(ends)
        return float(low), float(high)

    def beta_interval(self, confidence: float = 0.9) -> tuple[float, float]:
        """Central credible interval of the dispersion."""
        high, low = self.width / self.grid.slopes(np.array(tails(confidence)))
        return float(low), float(high)

    def band(self, im: ArrayLike, confidence: float = 0.9) -> Band:
        """Central credible interval of the probability of collapse at each `im`, >= 0."""
        logs = log_intensity(im)
        x = (np.atleast_1d(logs).ravel() - self.centre) / self.width
        inside = np.isfinite(x)
        found = np.zeros((2, x.size))
        found[:, np.isposinf(x)] = 1.0
        found[:, inside] = ndtr(self.grid.probits(x[inside], np.array(tails(confidence))))
        lower, upper = found.reshape(2, *logs.shape)
        return Band(lower, upper, confidence)


def fit_posterior(im: ArrayLike, collapses: ArrayLike, n: ArrayLike) -> Posterior:
    """Posterior of the curve of runs that are independent, each with a motion of its own.

    Prior: Jeffreys' for the levels and numbers of runs that were made, restricted to rising
    curves (beta > 0), times 1 / (1 / beta + 1 / r), where r is ln of the highest over the lowest
    level. Jeffreys' alone lets 90 % bands hold the truth in 78 to 86 % at 10 runs, as it makes
    beta too small; the factor cures this as the right Haar measure does for capacities, and
    stops growing where beta exceeds what the levels span, so that the prior stays proper. It
    assumes nothing of the arch but that levels were chosen to span the curve; it depends on the
    design, so that it moves a little when runs are added. Arguments as for `fit_stripes`; all
    runs may have collapsed, or none, but they must be at two levels or more (else FitError).
    """
    im, collapses, n = checked_stripes(im, collapses, n)
    levels, place = np.unique(im[n > 0], return_inverse=True)
    _require_two(levels)
    k: FloatArray = np.bincount(place, collapses[n > 0]).astype(float)
    m: FloatArray = np.bincount(place, n[n > 0]).astype(float)
    x, centre, width = _scaled(np.log(levels))

    def terms(a: FloatArray, b: FloatArray) -> Terms:
        z = a[..., None] + b[:, None, None] * x
        small = log_ndtr(-np.abs(z))
        large = np.log1p(-np.exp(small))
        likelihood = np.where(z > 0.0, large, small) @ k
        likelihood += np.where(z > 0.0, small, large) @ (m - k)
        weight = m * np.exp(-z * z - small - large)
        total, first, second = weight.sum(axis=-1), weight @ x, weight @ (x * x)
        tilt = np.log(b / (b + 1.0 / (x[-1] - x[0])))
        determinant = np.maximum(total * second - first**2, 1e-250)
        return likelihood, 0.5 * np.log(determinant) + tilt[:, None]

    slopes = _known_slopes(np.exp(x), k, m)
    return _summed(terms, x, (centre, width), int(m.sum()), slopes)


def fit_capacity_posterior(
    lower: ArrayLike, upper: ArrayLike, n_effective: float | None = None
) -> Posterior:
    """Posterior of the curve of records whose capacities lie in brackets, lower < upper.

    Prior: the right Haar measure 1 / beta of (ln theta, beta), under which the intervals of a
    normal sample are exact (Student's t for theta, chi-square for beta, the non-central t for
    the curve), times beta^2 / (beta^2 + d^2 / 12) with d the median width of the brackets in
    ln im, so that it stays proper where one capacity would agree with all records, and times
    1 / (1 + (beta / r)^2) with r that of all their ends, so that it does where hardly a record is
    bracketed from both sides. Assumes lognormal, independent capacities, and a beta between
    what the levels resolve and what they span. The likelihood is raised to the power
    `n_effective` / n where records are worth fewer independent ones.
    """
    lower, upper = checked_brackets(lower, upper)
    if np.any(lower == upper):
        raise InputError(
            f"the capacity {lower[lower == upper][0]:g} is exact; brackets of some width are "
            "needed (for exact capacities see capacity_band)"
        )
    why = "nothing bounds theta from"
    if not lower.any():
        raise FitError(f"{why} below: add levels below {{}}, the lowest tried", upper.min())
    if np.isposinf(upper).all():
        raise FitError(f"{why} above: add levels above {{}}, the highest tried", lower.max())
    ends = np.unique(np.concatenate([lower[lower > 0.0], upper[np.isfinite(upper)]]))
    _require_two(ends)
    x, centre, width = _scaled(np.log(ends))
    pairs, number = np.unique(np.stack([lower, upper]), axis=1, return_counts=True)
    power = number * (1.0 if n_effective is None else n_effective / lower.size)
    with np.errstate(divide="ignore"):
        low, high = (np.log(pairs) - centre) / width
    closed = np.isfinite(high - low)
    resolved = np.median(np.repeat((high - low)[closed], number[closed])) if closed.any() else 0.0
    resolved = max(float(resolved), float(np.diff(x).min()))
    span = float(x[-1] - x[0])

    def terms(a: FloatArray, b: FloatArray) -> Terms:
        z_low, z_high = (a[..., None] + b[:, None, None] * end for end in (low, high))
        prior = np.log1p((b * resolved) ** 2 / 12.0) + np.log1p((b * span) ** -2.0) + np.log(b)
        return log_between(z_low, z_high) @ power, -prior[:, None]

    n = lower.size if n_effective is None else max(1, round(n_effective))
    return _summed(terms, x, (centre, width), n)


def fit_scattered_posterior(
    levels: ArrayLike, fell: ArrayLike, stood: ArrayLike, borders: tuple[float, float],
    n_effective: float | None = None,
) -> Posterior:  # fmt: skip
    """Posterior of the curve of records that are not all monotone.

    Probit with a record effect: ln capacity of a run is that of its record, normal about
    ln theta, and an error of the run, normal with the standard deviation `scatter`; beta^2 is the
    sum of both variances, as P(collapse | im) is that of a single run. The scatter is estimated
    first, and its error widens what is known of beta. Prior and `n_effective` are those of
    `fit_capacity_posterior`, which this equals where the scatter is 0.

    Parameters
    ----------
    levels : array_like, (n_level,)
        Increasing, > 0.
    fell, stood : array_like of bool, (n_record, n_level)
        Runs that collapsed, and that stood; at least one record stands above a level at which it
        collapsed. Cells that were not run are neither.
    borders : (float, float)
        Median and standard deviation of the records' ln capacities, for the scatter alone.
    n_effective : float, optional
    """
    logs = np.log(np.asarray(levels, dtype=float))
    _require_two(logs)
    runs, number = np.unique(np.stack([fell, stood], axis=1), axis=0, return_counts=True)
    fallen, standing = runs[:, 0].astype(float), runs[:, 1].astype(float)
    scatter, error = _scatter_of_runs(logs, fallen, standing, number, borders)
    ends, chance = _chances(logs, fallen, standing, scatter)
    x, centre, width = _scaled(logs)
    ends = (ends - centre) / width
    power = number * (1.0 if n_effective is None else n_effective / number.sum())
    resolved, span = float(np.median(np.diff(x))), float(x[-1] - x[0])

    def terms(a: FloatArray, b: FloatArray) -> Terms:
        mass = np.diff(ndtr(a[..., None] + b[:, None, None] * ends), axis=-1)
        prior = np.log1p((b * resolved) ** 2 / 12.0) + np.log1p((b * span) ** -2.0) + np.log(b)
        return np.log(np.maximum(mass @ chance.T, 1e-300)) @ power, -prior[:, None]

    n = int(number.sum()) if n_effective is None else max(1, round(n_effective))
    known = _summed(terms, x, (centre, width), n)
    fit = known.fragility
    beta = float(np.hypot(fit.beta, scatter))
    # The variances of both squares add up.
    stretch = float(np.hypot(1.0, error / (2.0 * fit.beta * fit.standard_errors[1])))
    scale = np.array([1.0, stretch * fit.beta / beta])
    curve = replace(fit, beta=beta, covariance=fit.covariance * np.outer(scale, scale))
    grid = known.grid.flatter((scatter / width) ** 2, width / beta, stretch)
    return Posterior(curve, grid, centre, width, scatter)


def _scatter_of_runs(
    logs: FloatArray, fell: FloatArray, stood: FloatArray, number: NDArray,
    borders: tuple[float, float],
) -> tuple[float, float]:  # fmt: skip
    """Standard deviation between runs of a record, and the standard error of its square.

    ln capacities of records are taken as normal with the median and deviation of `borders`.
    """
    median, deviation = borders
    tried = np.geomspace(0.2 * min(np.diff(logs).min(), deviation), deviation, _SCATTERS)
    found = []
    for scatter in tried:
        ends, chance = _chances(logs, fell, stood, scatter)
        mass = np.diff(ndtr((ends - median) / deviation))
        found.append(np.log(np.maximum(chance @ mass, 1e-300)) @ number)
    weight = np.exp(np.array(found) - max(found))
    weight /= weight.sum()
    error = np.sqrt(weight @ tried**4 - (weight @ tried**2) ** 2)
    return float(np.exp(weight @ np.log(tried))), float(error)


def _chances(
    logs: FloatArray, fell: FloatArray, stood: FloatArray, scatter: float
) -> tuple[FloatArray, FloatArray]:
    """Ends of cells of a record's ln capacity (n_cell + 1,), and the probability of the runs of
    each record where it lies in each cell, (n_record, n_cell).
    """
    gaps = np.diff(logs)
    parts = np.ceil(gaps / (0.5 * scatter)).astype(int)
    within = [first + gap * np.arange(n) / n for first, gap, n in zip(logs, gaps, parts)]
    beyond = scatter * np.arange(0.5, 3.1, 0.5)
    ends = np.concatenate([logs[0] - beyond[::-1], *within, logs[-1:], logs[-1] + beyond])
    step = 0.25 * scatter
    middle = np.concatenate([[ends[0] - step], 0.5 * (ends[1:] + ends[:-1]), [ends[-1] + step]])
    z = (logs[:, None] - middle) / scatter
    chance = np.exp(fell @ log_ndtr(z) + stood @ log_ndtr(-z))
    return np.concatenate([[-np.inf], ends, [np.inf]]), chance


def _known_slopes(levels: FloatArray, k: FloatArray, m: FloatArray) -> tuple[float, float] | None:
    """Slopes beyond which there is nothing, where runs are many and the likelihood narrow."""
    curve = likeliest_curve(levels, k, m)
    if curve is None or not curve.standard_errors[1] < 0.2 * curve.beta:
        return None
    reach = np.exp(9.0 * curve.standard_errors[1] / curve.beta)
    return 1.0 / (curve.beta * reach), reach / curve.beta


def _require_two(levels: FloatArray) -> None:
    if levels.size < 2:
        raise FitError("runs that collapsed or stood are at 1 level; a posterior needs two")


def _scaled(logs: FloatArray) -> tuple[FloatArray, float, float]:
    centre, width = float(logs.mean()), float(logs.std())
    return (logs - centre) / width, centre, width


def _summed(
    terms: Callable[[FloatArray, FloatArray], Terms], x: FloatArray, scale: tuple[float, float],
    n: int, slopes: tuple[float, float] | None = None,
) -> Posterior:  # fmt: skip
    """The posterior of a log-likelihood and log-prior, with its medians."""
    centre, width = scale
    grid = line_grid(lambda a, b: np.add(*terms(a, b)), x, slopes)
    low, high = width * grid.log_medians(_ONE_SIGMA)
    beta_high, beta_low = width / grid.slopes(_ONE_SIGMA)
    errors = np.array([0.5 * (high - low), 0.5 * (beta_high - beta_low)])
    together = grid.correlation()
    correlation = np.array([[1.0, together], [together, 1.0]])
    middle, slope = grid.log_medians(_HALF), grid.slopes(_HALF)
    theta, beta = float(np.exp(centre + width * middle[0])), float(width / slope[0])
    likelihood = float(terms(-slope[:, None] * middle, slope)[0][0, 0])
    covariance = correlation * np.outer(errors, errors)
    curve = Fragility(theta, beta, covariance, likelihood, x.size, n, "posterior")
    return Posterior(curve, grid, centre, width)
