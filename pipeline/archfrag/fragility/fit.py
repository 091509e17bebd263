"""Lognormal curves by maximum likelihood: from stripes, from capacities, from brackets of them.

On the probit scale P(collapse | im) = Phi((ln im - ln theta) / beta) is a straight line in ln im
with slope 1 / beta, in which all likelihoods are concave: there is one maximum, or none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaln, logit, ndtr

from archfrag.errors import FitError, InputError
from archfrag.files import Named
from archfrag.fragility.curve import Curve, FloatArray, log_intensity, positive, tails
from archfrag.fragility.probit import LOG_ROOT_TWO_PI, binomial_lines, normal_lines
from archfrag.fragility.verdicts import checked_stripes, draws_of_records

_LARGEST_LOG = 600.0
_LEVEL = (
    "the fraction of collapses does not rise with intensity over the levels from {} to {}, so no "
    "curve fits; add levels or records"
)


def fit_stripes(im: ArrayLike, collapses: ArrayLike, n: ArrayLike) -> Curve:
    """Fit a lognormal curve to collapse counts at several intensity levels.

    Binomial maximum likelihood (Baker 2015, Earthquake Spectra 31(1), 579-599); runs at one level
    count as independent. `im`, (n_level,), is the intensity of each level, any unit, > 0;
    `collapses`, (n_level,), the number of runs that collapsed; `n`, int or (n_level,), the number
    of runs that collapsed or survived. FitError if the likelihood has no maximum with beta > 0.

    Examples
    --------
    >>> import archfrag as af
    >>> im = [0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0]
    >>> curve = af.fit_stripes(im, [0, 0, 0, 4, 6, 13, 12, 16], 40)
    >>> round(curve.theta, 4), round(curve.beta, 4)
    (1.0761, 0.4292)
    """
    im, collapses, n = checked_stripes(im, collapses, n)
    im, collapses, n = (part[n > 0] for part in (im, collapses, n))
    _require_overlap(im, collapses, n)
    (a,), (b,), (loss,), (information,) = binomial_lines(np.log(im), collapses, n)
    # A line that is nearly level has its median beyond all numbers.
    if not b > np.abs(a) / _LARGEST_LOG:
        raise FitError(_LEVEL, im.min(), im.max())
    coefficients = gammaln(n + 1) - gammaln(collapses + 1) - gammaln(n - collapses + 1)
    likelihood = float(coefficients.sum() - loss)
    known = _parameters(a, b, information)
    return Curve(*known, likelihood, int(np.unique(im).size), int(n.sum()), "stripes")


def _parameters(
    a: float, b: float, information: FloatArray
) -> tuple[float, float, FloatArray]:
    """Return theta, beta and covariance of (ln theta, beta) of the line a + b ln im."""
    beta = 1.0 / b
    jacobian = np.array([[-beta, beta * a / b], [0.0, -beta / b]])
    covariance = jacobian @ np.linalg.inv(information) @ jacobian.T
    return float(np.exp(-beta * a)), float(beta), covariance


def fit_ida(capacities: ArrayLike, truncate_at: float | None = None) -> Curve:
    """Fit a lognormal curve to the intensities at which records cause collapse.

    `capacities`, (n_record,), are the least intensities at which each record causes collapse, any
    unit, > 0, inf where no collapse was seen. The curve has the mean and the standard deviation
    (with n - 1) of their logarithms (Baker 2015). If capacities lie above `truncate_at`, the
    highest intensity that was tried, the curve is by maximum likelihood, with these records
    censored. FitError if no beta > 0 follows.

    Examples
    --------
    >>> import archfrag as af
    >>> curve = af.fit_ida([0.5, 0.7, 0.9, 1.3], truncate_at=None)
    >>> round(curve.theta, 3), round(curve.beta, 3)
    (0.8, 0.403)
    """
    values = np.asarray(capacities, float)
    if values.ndim != 1 or values.size == 0:
        raise InputError(
            f"capacities has shape {values.shape}; a list of one number per record"
        )
    if truncate_at is None:
        return _fit_moments(positive(values, "capacities"))
    limit = positive(truncate_at, "truncate_at")
    positive(np.where(values == np.inf, limit, values), "capacities")
    known = values <= limit
    if known.all():
        return _fit_moments(values)
    fit = fit_brackets(np.where(known, values, limit), np.where(known, values, np.inf))
    return replace(
        fit, n_levels=int(np.unique(values[known]).size), kind="ida_truncated"
    )


def _fit_moments(values: FloatArray) -> Curve:
    """Fit a curve by the mean and the standard deviation of ln capacity."""
    logs = np.log(values)
    n = values.size
    distinct = int(np.unique(logs).size)
    if distinct < 2:
        raise FitError(
            f"all {n} capacities are {values[0]:g}, so beta tends to 0; add records"
        )
    mean = float(logs.mean())
    deviation = float(logs.std(ddof=1))
    z = (logs - mean) / deviation
    covariance = deviation**2 * np.diag([1.0 / n, 0.5 / (n - 1)])
    likelihood = float(-0.5 * z @ z - n * (np.log(deviation) + LOG_ROOT_TWO_PI))
    return Curve(
        float(np.exp(mean)), deviation, covariance, likelihood, distinct, n, "ida"
    )


def fit_brackets(lower: ArrayLike, upper: ArrayLike) -> Curve:
    """Fit a lognormal curve to capacities that each lie in (lower, upper], (n_record,).

    Maximum likelihood of interval-censored data. One end may be unknown, 0 in `lower` or inf in
    `upper`; two equal ends are a capacity known exactly. FitError if there is no maximum with beta
    > 0.
    """
    lower = np.asarray(lower, float)
    upper = np.asarray(upper, float)
    last = lower.max()
    first = upper.min()
    if last <= first:
        raise FitError(
            f"one capacity between {{}} and {{}} agrees with all {lower.size} brackets, so beta "
            "tends to 0; add levels there, or records",
            last,
            first,
        )
    if not np.any((lower > 0.0) & np.isfinite(upper)):
        raise FitError(
            "no capacity is bracketed from both sides, which does not separate theta from beta; "
            "add levels below and above"
        )
    ends = log_intensity([lower, upper])
    mean, deviation, loss, information = normal_lines(np.ones((lower.size, 1)), *ends)
    a, b = np.array([-mean[0, 0], 1.0]) / deviation[0]
    # The intercept is minus the first parameter.
    known = _parameters(a, b, information[0] * [[1.0, -1.0], [-1.0, 1.0]])
    n_ends = np.unique(ends[np.isfinite(ends)]).size
    return Curve(*known, -float(loss[0]), n_ends, lower.size, "brackets")


def _require_overlap(im: FloatArray, collapses: FloatArray, n: FloatArray) -> None:
    """Raise FitError, with what to add, unless the likelihood has a maximum."""
    if im.size == 0:
        raise FitError(
            "no level has a run that collapsed or survived, so there is nothing to fit"
        )
    low = im.min()
    collapsed = im[collapses > 0]
    survived = im[collapses < n]
    first = collapsed.min(initial=np.inf)
    last = survived.max(initial=0.0)
    if not collapsed.size:
        raise FitError(
            "no run collapsed at any level: theta lies above {}; add higher levels",
            im.max(),
        )
    if not survived.size:
        raise FitError(
            "every run collapsed at every level: theta lies below {}; add lower levels",
            low,
        )
    if low == im.max():
        raise FitError(
            "all runs are at one level, im = {}, which cannot separate theta from beta; "
            "add levels",
            low,
        )
    if first > last:
        raise FitError(
            "all runs survive up to {0} and all collapse from {1} (perfect separation), so beta "
            "tends to 0: theta lies between {0} and {1}; add levels between them",
            last,
            first,
        )
    if first == last:
        raise FitError(
            "only the level {0} has collapses and survivals (perfect separation), so beta tends "
            "to 0 and theta to {0}; add levels close to it",
            first,
        )


def fit_cloud(
    im: ArrayLike,
    collapsed: ArrayLike,
    event: ArrayLike | None = None,
    confidence: float = 0.9,
) -> Named:
    """Fit collapse by logistic regression on ln im, with one run for each record (a cloud).

    `im` is the intensity of each record, any unit, > 0, `collapsed` 1 or 0, `event` its
    earthquake, whose records are resampled together; (n_run,) each. Returns ``intercept`` and
    ``slope`` of logit P; ``theta``, the 50 % point, and ``beta``, ln(84 % point / 16 % point) / 2,
    with their intervals by the bootstrap. FitError if the likeliest curve does not rise with
    intensity.
    """
    values = positive(im, "im")
    codes = np.asarray(collapsed, float)
    _require_overlap(values, codes, np.ones(values.size))
    # Each run once, then as drawn.
    times = draws_of_records(event, values.size)
    weight = np.vstack([np.ones(values.size), times])
    a, b, *_ = binomial_lines(np.log(values), weight * codes, weight, "logistic")
    kept = ~np.isnan(b)
    if not kept[0]:
        raise FitError(_LEVEL, values.min(), values.max())
    if kept.sum() < 2:
        raise FitError("no resample of the cloud determines a curve; add records")
    found: Named = {"intercept": float(a[0]), "slope": float(b[0])}
    points = {"theta": np.exp(-a / b), "beta": logit(ndtr(1.0)) / b}
    found |= {name: float(each[0]) for name, each in points.items()}
    for name, each in points.items():
        drawn = each[1:][kept[1:]]
        ends = np.quantile(drawn, tails(confidence), method="inverted_cdf")
        found[f"{name}_interval"] = tuple(ends.tolist())
    return found
