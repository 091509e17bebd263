"""Lognormal curves by maximum likelihood: from stripes, from capacities, from brackets of them.

A curve is P(collapse | im) = Phi((ln im - ln theta) / beta). On the probit scale it is the
straight line Phi^-1(P) = intercept + slope ln im with slope = 1 / beta, in which all likelihoods
are concave: there is one maximum, and none exactly where the data are separated.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaln

from archfrag.errors import FitError, InputError
from archfrag.fragility.brackets import checked_brackets
from archfrag.fragility.counts import checked_stripes
from archfrag.fragility.curve import FloatArray, Fragility, positive
from archfrag.fragility.lines import LOG_ROOT_TWO_PI, binomial_lines, normal_lines

__all__ = ["Fragility", "fit_brackets", "fit_ida", "fit_stripes"]

_LARGEST_LOG = 600.0
_EXACT = 1e-7  # width of a bracket, in deviations of all ends, below which it is one value


def fit_stripes(im: ArrayLike, collapses: ArrayLike, n: ArrayLike) -> Fragility:
    """Fit a lognormal curve to collapse counts at several intensity levels.

    Binomial maximum likelihood (Baker 2015, Earthquake Spectra 31(1), 579-599); runs at
    one level count as independent. The covariance is the inverse of the observed information.

    Parameters
    ----------
    im : array_like, (n_level,)
        Intensity of each level, any unit, > 0.
    collapses : array_like of int, (n_level,)
        Runs that collapsed.
    n : int or array_like of int, (n_level,)
        Runs that collapsed or stood. Unfinished runs and solver failures belong to neither.
        Levels with n = 0 are left out.

    Raises
    ------
    InputError
        If an argument has the wrong shape or a value that cannot be.
    FitError
        If the likelihood has no maximum with beta > 0; the message states what is known instead.

    Examples
    --------
    >>> import archfrag as af
    >>> im = [0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0]
    >>> curve = af.fit_stripes(im, [0, 0, 0, 4, 6, 13, 12, 16], 40)
    >>> round(curve.theta, 4), round(curve.beta, 4)
    (1.0761, 0.4292)
    """
    im, collapses, n = checked_stripes(im, collapses, n)
    used = n > 0
    im, collapses, n = im[used], collapses[used], n[used]
    _require_overlap(im, collapses, n)
    curve = likeliest_curve(im, collapses, n)
    if curve is None:
        raise FitError(
            "the fraction of collapses does not rise with intensity over the levels from {} to "
            "{}, so no lognormal curve fits; add levels or records",
            im.min(),
            im.max(),
        )
    return curve


def likeliest_curve(im: FloatArray, collapses: FloatArray, n: FloatArray) -> Fragility | None:
    """Curve of counts (n_level,) as of `fit_stripes`, not checked; None without a maximum."""
    line = binomial_lines(np.log(im), collapses, n)
    # Where the line is as good as level the median lies beyond all numbers.
    if line.degenerate[0] or line.slope[0] <= np.abs(line.intercept[0]) / _LARGEST_LOG:
        return None
    coefficients = gammaln(n + 1) - gammaln(collapses + 1) - gammaln(n - collapses + 1)
    likelihood = float(coefficients.sum() - line.loss[0])
    known = _parameters(line.intercept[0], line.slope[0], line.information[0])
    return Fragility(*known, likelihood, int(np.unique(im).size), int(n.sum()), "stripes")


def _parameters(a: float, b: float, information: FloatArray) -> tuple[float, float, FloatArray]:
    """Theta, beta and covariance of (ln theta, beta) of the line a + b ln im."""
    beta = 1.0 / b
    jacobian = np.array([[-beta, beta * a / b], [0.0, -beta / b]])
    covariance = jacobian @ np.linalg.inv(information) @ jacobian.T
    return float(np.exp(-beta * a)), float(beta), covariance


def fit_ida(capacities: ArrayLike, truncate_at: float | None = None) -> Fragility:
    """Fit a lognormal curve to the intensities at which records cause collapse.

    Complete data: mean and standard deviation of the logarithms (Baker 2015), the latter with
    n - 1, as is usual for IDA: dividing by n, as maximum likelihood would, makes beta too small
    by about 1 / (2 n) of itself, and the lower tail unsafe; the covariance is
    beta^2 diag(1 / n, 1 / (2 (n - 1))). Truncated data: maximum likelihood with the records above
    `truncate_at` censored.

    Parameters
    ----------
    capacities : array_like, (n_record,)
        Least intensity at which each record causes collapse, any unit, > 0. With `truncate_at`
        it may be inf where no collapse was seen.
    truncate_at : float, optional
        Highest intensity that was tried. A capacity above it counts as 'higher than this', one
        equal to it as a collapse.

    Raises
    ------
    InputError
        If a capacity or the limit is not a positive number.
    FitError
        If the data do not determine a dispersion > 0.

    Examples
    --------
    >>> import archfrag as af
    >>> curve = af.fit_ida([0.5, 0.7, 0.9, 1.3], truncate_at=None)
    >>> round(curve.theta, 3), round(curve.beta, 3)
    (0.8, 0.403)
    """
    values = np.asarray(capacities, dtype=float)
    if values.ndim != 1 or values.size == 0:
        raise InputError(f"capacities has shape {values.shape}; a list of one number per record")
    if truncate_at is None:
        return _fit_moments(positive(values, "capacities"))
    limit = float(positive(truncate_at, "truncate_at"))
    positive(np.where(values == np.inf, limit, values), "capacities")
    known = values <= limit
    if known.all():
        return _fit_moments(values)
    if not known.any():
        why = f"no capacity lies at or below truncate_at = {limit:g}: theta lies above it"
        raise FitError(f"{why}; try higher intensities")
    if np.all(values[known] == limit):
        why = f"all observed capacities equal truncate_at = {limit:g}, so beta tends to 0"
        raise FitError(f"{why}; resolve the capacities more finely")
    fit = _fit(np.where(known, values, limit), np.where(known, values, np.inf), "ida_truncated")
    return replace(fit, n_levels=int(np.unique(values[known]).size))


def _fit_moments(values: FloatArray) -> Fragility:
    """Curve from the mean and standard deviation of ln capacity."""
    logs, n = np.log(values), values.size
    if np.all(logs == logs[0]):
        raise FitError(
            f"all {n} capacities are {np.exp(logs[0]):g}, so beta tends to 0 and no "
            "dispersion can be estimated; add records"
        )
    mean, deviation = float(logs.mean()), float(logs.std(ddof=1))
    z = (logs - mean) / deviation
    covariance = deviation**2 * np.diag([1.0 / n, 0.5 / (n - 1)])
    likelihood = float(-0.5 * z @ z - n * (np.log(deviation) + LOG_ROOT_TWO_PI))
    sizes = int(np.unique(logs).size), n
    return Fragility(float(np.exp(mean)), deviation, covariance, likelihood, *sizes, "ida")


def fit_brackets(lower: ArrayLike, upper: ArrayLike) -> Fragility:
    """Lognormal curve of capacities of which each is known to lie between two intensities.

    Maximum likelihood of interval-censored data: the capacity of a record lies in
    (lower, upper]. The covariance is the inverse of the observed information.

    Parameters
    ----------
    lower, upper : array_like, (n_record,)
        Any unit, 0 <= lower <= upper, not both 0 or infinite; `lower` may be 0 (collapse at the
        lowest level tried), `upper` inf (none up to the highest). Equal values are a capacity
        known exactly.

    Returns
    -------
    Fragility
        Of kind ``"brackets"``; ``n_total`` counts records, ``n_levels`` distinct ends.

    Raises
    ------
    InputError, FitError
        If an argument cannot be; if the likelihood has no maximum with beta > 0.

    Examples
    --------
    >>> from archfrag.fragility.fit import fit_brackets
    >>> curve = fit_brackets([0.0, 0.2, 0.3, 0.4, 0.4], [0.2, 0.3, 0.4, 0.5, float("inf")])
    >>> round(curve.theta, 3), round(curve.beta, 3)
    (0.317, 0.467)
    """
    return _fit(*checked_brackets(lower, upper), kind="brackets")


def _fit(lower: FloatArray, upper: FloatArray, kind: str) -> Fragility:
    last, first = lower.max(), upper.min()
    if last <= first:
        raise FitError(
            f"one capacity between {{}} and {{}} would agree with all {lower.size} records, so "
            "beta tends to 0 and no dispersion can be estimated; add levels there, or records",
            last,
            first,
        )
    if not np.any((lower > 0.0) & np.isfinite(upper)):
        raise FitError(
            "no capacity is bracketed from both sides, which does not separate theta from beta; "
            "add levels below and above"
        )
    with np.errstate(divide="ignore"):
        low, high = np.log(lower), np.log(upper)
    ends = np.concatenate([low[np.isfinite(low)], high[np.isfinite(high)]])
    # A bracket of almost no width is taken as its middle, with the density times the width.
    narrow = (high > low) & (high - low < _EXACT * ends.std())
    constant = float(np.log((high - low)[narrow]).sum())
    low[narrow] = high[narrow] = 0.5 * (low + high)[narrow]
    pairs, number = np.unique(np.stack([low, high]), axis=1, return_counts=True)
    ones = np.ones((pairs.shape[1], 1))
    found = normal_lines(ones, pairs[0], pairs[1], number[None].astype(float))
    a, b = np.array([-found.coefficients[0, 0], 1.0]) / found.deviation[0]
    sign = np.array([[1.0, -1.0], [-1.0, 1.0]])  # the intercept is minus the first parameter
    known = _parameters(a, b, found.information[0] * sign)
    likelihood = constant - float(found.loss[0])
    return Fragility(*known, likelihood, int(np.unique(ends).size), lower.size, kind)


def _require_overlap(im: FloatArray, collapses: FloatArray, n: FloatArray) -> None:
    """Raise FitError where the data are separated (Albert and Anderson 1984)."""
    if im.size == 0:
        raise FitError("no level has a run that collapsed or stood, so there is nothing to fit")
    low, high, fell, stood = im.min(), im.max(), im[collapses > 0], im[collapses < n]
    if not fell.size:
        why = "no run collapsed at any level: theta lies above {}, the highest level tried"
        raise FitError(f"{why}; add higher levels", high)
    if not stood.size:
        why = "every run collapsed at every level: theta lies below {}, the lowest level"
        raise FitError(f"{why} tried; add lower levels", low)
    if low == high:
        why = "all runs are at one level, im = {}, which cannot separate theta from beta"
        raise FitError(f"{why}; add levels", low)
    first, last = fell.min(), stood.max()
    if first > last:
        raise FitError(
            "all runs stand up to {0} and all collapse from {1} (perfect separation), so beta "
            "tends to 0: theta lies between {0} and {1}; add levels between them",
            last,
            first,
        )
    if first == last:
        raise FitError(
            "only the level {0} has both collapses and standing runs (perfect separation), so "
            "beta tends to 0 and theta to {0}; add levels close to it",
            first,
        )
