"""Confidence bands of a fitted curve, from the covariance of its parameters."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, ndtr, ndtri, stdtrit

from archfrag.errors import InputError
from archfrag.fragility.curve import Band, Fragility, log_intensity, tails

_OF_CAPACITIES = ("ida", "ida_truncated", "brackets")


def confidence_band(fit: Fragility, im: ArrayLike, confidence: float = 0.9) -> Band:
    """Pointwise band of a curve from the covariance of its parameters.

    The delta method on the probit scale, z = (ln im - ln theta) / beta, where the fitted curve
    is a straight line in ln im and its estimate is closest to normal: var z = g C g with
    g = -(1, z) / beta. The band is Phi(z -+ q sqrt(var z)) and stays within [0, 1].

    Parameters
    ----------
    fit : Fragility
    im : array_like
        Intensities, any shape, unit of ``fit.theta``, >= 0.
    confidence : float
        Two-sided, between 0 and 1.

    Raises
    ------
    InputError
        If an intensity is negative or `confidence` is not between 0 and 1.

    Examples
    --------
    >>> import archfrag as af
    >>> from archfrag.fragility.bands import confidence_band
    >>> band = confidence_band(af.fit_ida([0.5, 0.7, 0.9, 1.3]), 0.8)
    >>> round(float(band.lower), 2), round(float(band.upper), 2)
    (0.21, 0.79)
    """
    quantile = ndtri(tails(confidence)[1])
    z = (log_intensity(im) - np.log(fit.theta)) / fit.beta
    (var_theta, cov), (_, var_beta) = fit.covariance
    with np.errstate(invalid="ignore"):
        reach = quantile * np.sqrt(var_theta + 2.0 * cov * z + var_beta * z * z) / fit.beta
        lower, upper = ndtr(z - reach), ndtr(z + reach)
    at_zero = np.isneginf(z)
    return Band(np.where(at_zero, 0.0, lower), np.where(at_zero, 0.0, upper), confidence)


def capacity_band(fit: Fragility, im: ArrayLike, confidence: float = 0.9) -> Band:
    """Pointwise band of a curve of `fit_ida` or `fit_brackets`, by Student's t; rises with `im`.

    The band of ln IM at the quantile z of capacity is m + z s -+ t sqrt(g C g) with g = (1, z),
    which for complete capacities is m + z s -+ t s sqrt(1 / n + z^2 / (2 (n - 1))) and t has
    n - 1 degrees of freedom. It is inverted to probabilities at given intensities. Assumes that
    capacities are lognormal and independent. For censored ones the degrees of freedom are those
    that the variance of beta is worth, beta^2 / (2 var beta) (Satterthwaite 1946, Biometrics
    Bulletin 2), less one for the median, and beta is raised as by n / (n - 1). From 0 to 1
    everywhere if the sample is too small to bound beta.

    >>> import archfrag as af
    >>> from archfrag.fragility.bands import capacity_band
    >>> band = capacity_band(af.fit_ida([0.5, 0.6, 0.7, 0.8, 0.9, 1.3]), 0.8, 0.8)
    >>> bool(0.2 < band.lower < 0.5 < band.upper < 0.9)
    True
    """
    if fit.kind not in _OF_CAPACITIES:
        kinds = " or ".join(map(repr, _OF_CAPACITIES))
        raise InputError(f"the fit is of kind {fit.kind!r}; Student's t needs one of {kinds}")
    freedom, stretch = _freedom(fit)
    t = float(stdtrit(freedom, tails(confidence)[1]))
    beta = fit.beta * stretch
    c, d = fit.covariance[0] * (t * stretch) ** 2
    e = (t * beta) ** 2 / (2.0 * freedom)
    x = log_intensity(im)
    away = np.log(fit.theta) - np.where(np.isfinite(x), x, 0.0)
    leading = beta * beta - e
    ends = np.zeros(x.shape), np.ones(x.shape)
    if leading > 0.0:
        linear = beta * away - d
        root = np.sqrt(np.maximum(linear**2 - leading * (away**2 - c), 0.0))
        ends = ndtr((-linear - root) / leading), ndtr((-linear + root) / leading)
    lower, upper = (np.where(np.isfinite(x), end, np.where(x > 0.0, 1.0, 0.0)) for end in ends)
    return Band(lower[()], upper[()], confidence)


def theta_interval(fit: Fragility, confidence: float = 0.9) -> tuple[float, float]:
    """Confidence interval of the median, symmetric in its logarithm, unit of ``fit.theta``.

    Normal for runs; for capacities Student's t, as in `capacity_band`.
    """
    probability = tails(confidence)[1]
    quantile = float(ndtri(probability))
    if fit.kind in _OF_CAPACITIES:
        freedom, stretch = _freedom(fit)
        quantile = stretch * float(stdtrit(freedom, probability))
    reach = quantile * float(fit.standard_errors[0])
    return fit.theta * np.exp(-reach), fit.theta * np.exp(reach)


def beta_interval(fit: Fragility, confidence: float = 0.9) -> tuple[float, float]:
    """Confidence interval of the dispersion, which stays > 0.

    Normal in ln beta for runs; for capacities of chi-square with the degrees of freedom of
    `capacity_band`.
    """
    ends = tails(confidence)
    if fit.kind in _OF_CAPACITIES:
        freedom, stretch = _freedom(fit)
        low, high = (float(np.sqrt(freedom / chdtri(freedom, tail))) for tail in ends)
        return fit.beta * stretch * low, fit.beta * stretch * high
    reach = float(ndtri(ends[1]) * fit.standard_errors[1] / fit.beta)
    return fit.beta * np.exp(-reach), fit.beta * np.exp(reach)


def _freedom(fit: Fragility) -> tuple[float, float]:
    """Degrees of freedom of beta, and the factor that corrects a beta by maximum likelihood."""
    freedom = float(fit.beta**2 / (2.0 * fit.covariance[1, 1]))
    if fit.kind == "ida":
        return freedom, 1.0
    freedom = max(freedom - 1.0, 0.5)
    return freedom, float(np.sqrt((freedom + 1.0) / freedom))
