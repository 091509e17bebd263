"""Lognormal fragility curves by maximum likelihood, from stripes and from capacities.

A curve is P(collapse | im) = Phi((ln im - ln theta) / beta). On the probit scale it is the
straight line Phi^-1(P) = intercept + slope ln im with slope = 1 / beta, in which the binomial
likelihood is concave: it has one maximum, and none exactly where the data are separated.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaln

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import FloatArray, Fragility
from archfrag.fragility.likelihood import binomial_loss, censored_normal, probit_line

__all__ = ["Fragility", "checked_stripes", "fit_ida", "fit_stripes"]

_FLAT_SLOPE = 1e-9
_LARGEST_LOG = 600.0


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
        If the likelihood has no maximum with beta > 0; the sentence says what is known instead.

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
    log_im = np.log(im)
    centre, width = log_im.mean(), log_im.std()
    line, information = probit_line((log_im - centre) / width, collapses, n - collapses)
    if line[1] <= max(_FLAT_SLOPE, width * abs(line[0]) / _LARGEST_LOG):
        raise _not_rising(im)
    scale = width / line[1]
    jacobian = np.array([[-scale, scale * line[0] / line[1]], [0.0, -scale / line[1]]])
    theta = np.exp(centre - scale * line[0])
    coefficients = gammaln(n + 1) - gammaln(collapses + 1) - gammaln(n - collapses + 1)
    z = line[0] + line[1] * (log_im - centre) / width
    return Fragility(
        theta=float(theta),
        beta=float(scale),
        covariance=jacobian @ np.linalg.inv(information) @ jacobian.T,
        log_likelihood=float(np.sum(coefficients) - binomial_loss(z, collapses, n - collapses)),
        n_levels=int(np.unique(im).size),
        n_total=int(n.sum()),
        kind="stripes",
    )


def fit_ida(capacities: ArrayLike, truncate_at: float | None = None) -> Fragility:
    """Fit a lognormal curve to the intensities at which records cause collapse.

    Complete data: mean and standard deviation of the logarithms (Baker 2015), the latter with
    n - 1, as is usual for IDA: dividing by n, as maximum likelihood would, makes beta too small
    by about 1 / (2 n) of itself, and the lower tail unsafe. Truncated data: maximum likelihood
    with the records above `truncate_at` censored.

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
    >>> round(curve.theta, 3)
    0.8
    """
    capacities = np.asarray(capacities, dtype=float)
    if capacities.ndim != 1 or capacities.size == 0:
        raise InputError(
            f"capacities has shape {capacities.shape}; a list of one number per record is needed"
        )
    if truncate_at is not None and not 0.0 < truncate_at < np.inf:
        raise InputError(f"truncate_at is {truncate_at:g}; a positive finite number is needed")
    allowed = capacities > 0.0
    if truncate_at is None:
        allowed &= np.isfinite(capacities)
    if not allowed.all():
        raise InputError(
            f"capacities holds {capacities[~allowed][0]:g}; they are positive numbers"
            + (", and infinite only where truncate_at is given" if truncate_at is None else "")
        )
    if truncate_at is None or np.all(capacities <= truncate_at):
        return _fit_complete(np.log(capacities))
    return _fit_censored(np.log(capacities), float(np.log(truncate_at)))


def checked_stripes(
    im: ArrayLike, collapses: ArrayLike, n: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Arguments of `fit_stripes` as arrays of shape (n_level,).

    Raises
    ------
    InputError
        If a shape or a value cannot be.
    """
    im = np.asarray(im, dtype=float)
    collapses = np.asarray(collapses, dtype=float)
    n = np.asarray(n, dtype=float)
    if im.ndim != 1 or im.size == 0:
        raise InputError(f"im has shape {im.shape}; a list of one intensity per level is needed")
    if n.ndim == 0:
        n = np.full(im.shape, n)
    for name, values in (("collapses", collapses), ("n", n)):
        if values.shape != im.shape:
            raise InputError(
                f"{name} has shape {values.shape}, im {im.shape}; one number per level is needed"
            )
        bad = values[~((values >= 0.0) & (values == np.floor(values)) & np.isfinite(values))]
        if bad.size:
            raise InputError(f"{name} holds {bad[0]:g}; counts are whole numbers from 0 upwards")
    bad = im[~((im > 0.0) & np.isfinite(im))]
    if bad.size:
        raise InputError(f"im holds {bad[0]:g}; intensities are positive finite numbers")
    if np.any(collapses > n):
        i = int(np.argmax(collapses > n))
        raise InputError(
            f"collapses is {collapses[i]:g} at im = {im[i]:g}, more than the n = {n[i]:g} runs"
        )
    return im, collapses, n


def _require_overlap(im: FloatArray, collapses: FloatArray, n: FloatArray) -> None:
    """Raise FitError unless the likelihood has a maximum (Albert and Anderson 1984)."""
    if im.size == 0:
        raise FitError("no level has a run that collapsed or stood, so there is nothing to fit")
    if not collapses.any():
        raise FitError(
            f"no run collapsed at any level: theta lies above {im.max():g}, the highest level "
            "tried; add higher levels"
        )
    if np.array_equal(collapses, n):
        raise FitError(
            f"every run collapsed at every level: theta lies below {im.min():g}, the lowest "
            "level tried; add lower levels"
        )
    if np.all(im == im[0]):
        raise FitError(
            f"all runs are at one level, im = {im[0]:g}, which cannot tell theta from beta; "
            "add levels"
        )
    first_collapse = im[collapses > 0].min()
    last_standing = im[collapses < n].max()
    if first_collapse > last_standing:
        raise FitError(
            f"all runs stand up to {last_standing:g} and all collapse from {first_collapse:g} "
            "(perfect separation), so beta tends to 0: theta lies between "
            f"{last_standing:g} and {first_collapse:g}; add levels between them"
        )
    if first_collapse == last_standing:
        raise FitError(
            f"only the level {first_collapse:g} has both collapses and standing runs (perfect "
            f"separation), so beta tends to 0 and theta to {first_collapse:g}; add levels close "
            "to it"
        )
    if im[collapses > 0].max() <= im[collapses < n].min():
        raise _not_rising(im)


def _not_rising(im: FloatArray) -> FitError:
    return FitError(
        f"the share of collapses does not rise with intensity over the levels from "
        f"{im.min():g} to {im.max():g}, so no lognormal curve fits; add levels or records"
    )


def _fit_complete(logs: FloatArray) -> Fragility:
    if np.all(logs == logs[0]):
        raise FitError(
            f"all {logs.size} capacities are {np.exp(logs[0]):g}, so beta tends to 0 and no "
            "dispersion can be estimated; add records"
        )
    n = logs.size
    mean, deviation = float(logs.mean()), float(logs.std(ddof=1))
    z = (logs - mean) / deviation
    return Fragility(
        theta=float(np.exp(mean)),
        beta=deviation,
        covariance=deviation**2 * np.diag([1.0 / n, 0.5 / (n - 1)]),
        log_likelihood=float(
            -0.5 * np.sum(z * z) - n * np.log(deviation) - 0.5 * n * np.log(2.0 * np.pi)
        ),
        n_levels=int(np.unique(logs).size),
        n_total=n,
        kind="ida",
    )


def _fit_censored(logs: FloatArray, limit: float) -> Fragility:
    observed = logs[logs <= limit]
    if observed.size == 0:
        raise FitError(
            f"no capacity lies at or below truncate_at = {np.exp(limit):g}: theta lies above "
            "it; try higher intensities"
        )
    if np.all(observed == limit):
        raise FitError(
            f"all observed capacities equal truncate_at = {np.exp(limit):g}, so beta tends to "
            "0; resolve the capacities more finely"
        )

    scale = float(np.sqrt(np.mean((observed - limit) ** 2)))
    (ratio, inverse), information, log_likelihood = censored_normal(
        (observed - limit) / scale, logs.size - observed.size
    )
    deviation = float(scale / inverse)
    jacobian = deviation * np.array([[1.0, -ratio / inverse], [0.0, -1.0 / inverse]])
    return Fragility(
        theta=float(np.exp(limit + deviation * ratio)),
        beta=deviation,
        covariance=jacobian @ np.linalg.inv(information) @ jacobian.T,
        log_likelihood=float(log_likelihood - observed.size * np.log(scale)),
        n_levels=int(np.unique(observed).size),
        n_total=logs.size,
        kind="ida_truncated",
    )
