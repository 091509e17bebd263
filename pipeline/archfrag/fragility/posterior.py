"""Posterior of a lognormal curve under a proper, objective prior: ten runs give a band too.

The prior of runs rests on Jeffreys', the square root of the determinant of the Fisher
information of the design, which is proper for a probit line at two levels or more, and so leaves
the posterior proper where the likelihood has no maximum (Ibrahim and Laud 1991, Journal of the
American Statistical Association 86; Chen, Ibrahim and Kim 2008, the same 103). For fragility
curves see Van Biesbroeck, Gauchy, Feau and Garnier (arXiv 2302.06935 and 2503.07343).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
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
