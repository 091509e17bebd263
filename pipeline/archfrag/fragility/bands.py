"""Confidence bands of a fitted curve from the covariance of its parameters."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri, ndtr, ndtri, stdtrit

from archfrag.errors import InputError
from archfrag.fragility.bootstrap import bootstrap_band, record_bootstrap_band
from archfrag.fragility.curve import Fragility, log_intensity
from archfrag.fragility.intervals import Band, RecordBand, check_confidence, clopper_pearson, tails

__all__ = [
    "Band",
    "RecordBand",
    "beta_interval",
    "bootstrap_band",
    "capacity_band",
    "clopper_pearson",
    "confidence_band",
    "record_bootstrap_band",
    "theta_interval",
]

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
    """
    check_confidence(confidence)
    z = (log_intensity(im) - np.log(fit.theta)) / fit.beta
    quantile = ndtri(0.5 + 0.5 * confidence)
    (var_theta, cov), (_, var_beta) = fit.covariance
    with np.errstate(invalid="ignore"):
        spread = quantile * np.sqrt(var_theta + 2.0 * cov * z + var_beta * z * z) / fit.beta
        lower, upper = ndtr(z - spread), ndtr(z + spread)
    at_zero = np.isneginf(z)
    return Band(np.where(at_zero, 0.0, lower), np.where(at_zero, 0.0, upper), confidence)


def capacity_band(fit: Fragility, im: ArrayLike, confidence: float = 0.9) -> Band:
    """Pointwise band of a curve fitted to capacities, by Student's t.

    The band of ln IM at the quantile z of capacity is m + z s -+ t sqrt(g C g) with g = (1, z),
    which for complete capacities is m + z s -+ t s sqrt(1 / n + z^2 / (2 (n - 1))) and t has
    n - 1 degrees of freedom. It is inverted to probabilities at given intensities. Assumes that
    capacities are lognormal and independent. For censored ones the degrees of freedom are those
    that the variance of beta is worth, beta^2 / (2 var beta) (Satterthwaite 1946, Biometrics
    Bulletin 2), less one for the median, and beta is raised as by n / (n - 1).

    Parameters
    ----------
    fit : Fragility
        From `fit_ida`, `fit_moments` or `fit_brackets`.
    im : array_like
        Intensities, any shape, unit of ``fit.theta``, >= 0.
    confidence : float
        Two-sided, between 0 and 1.

    Returns
    -------
    Band
        Rising with `im`; from 0 to 1 everywhere if the sample is too small to bound beta.

    Raises
    ------
    InputError
        If an argument cannot be, or `fit` does not come from capacities.
    """
    check_confidence(confidence)
    if fit.kind not in _OF_CAPACITIES:
        raise InputError(
            f"the fit is of kind {fit.kind!r}; Student's t needs capacities, of kind "
            + " or ".join(repr(kind) for kind in _OF_CAPACITIES)
        )
    freedom, stretch = _freedom(fit)
    t = float(stdtrit(freedom, 0.5 + 0.5 * confidence))
    beta = fit.beta * stretch
    c, d = fit.covariance[0] * (t * stretch) ** 2
    e = (t * beta) ** 2 / (2.0 * freedom)
    x = log_intensity(im)
    away = np.log(fit.theta) - np.where(np.isfinite(x), x, 0.0)
    leading = beta * beta - e
    if leading <= 0.0:
        lower, upper = np.zeros(x.shape), np.ones(x.shape)
    else:
        linear = beta * away - d
        root = np.sqrt(np.maximum(linear**2 - leading * (away**2 - c), 0.0))
        lower, upper = ndtr((-linear - root) / leading), ndtr((-linear + root) / leading)
    for end in (lower, upper):
        end[np.isneginf(x)], end[np.isposinf(x)] = 0.0, 1.0
    return Band(lower[()], upper[()], confidence)


def theta_interval(fit: Fragility, confidence: float = 0.9) -> tuple[float, float]:
    """Confidence interval of the median, symmetric in its logarithm, unit of ``fit.theta``.

    Normal for runs; for capacities Student's t, as in `capacity_band`.
    """
    check_confidence(confidence)
    quantile = float(ndtri(0.5 + 0.5 * confidence))
    if fit.kind in _OF_CAPACITIES:
        freedom, stretch = _freedom(fit)
        quantile = stretch * float(stdtrit(freedom, 0.5 + 0.5 * confidence))
    reach = quantile * float(fit.standard_errors[0])
    return fit.theta * np.exp(-reach), fit.theta * np.exp(reach)


def beta_interval(fit: Fragility, confidence: float = 0.9) -> tuple[float, float]:
    """Confidence interval of the dispersion, which stays > 0.

    Normal in ln beta for runs; for capacities of chi-square with the degrees of freedom of
    `capacity_band`.
    """
    check_confidence(confidence)
    if fit.kind in _OF_CAPACITIES:
        freedom, stretch = _freedom(fit)
        low, high = (
            fit.beta * stretch * float(np.sqrt(freedom / chdtri(freedom, tail)))
            for tail in tails(confidence)
        )
        return low, high
    reach = float(ndtri(0.5 + 0.5 * confidence) * fit.standard_errors[1] / fit.beta)
    return fit.beta * np.exp(-reach), fit.beta * np.exp(reach)


def _freedom(fit: Fragility) -> tuple[float, float]:
    """Degrees of freedom of beta, and the factor that corrects a beta by maximum likelihood."""
    freedom = float(fit.beta**2 / (2.0 * fit.covariance[1, 1]))
    if fit.kind == "ida":
        return freedom, 1.0
    freedom = max(freedom - 1.0, 0.5)
    return freedom, float(np.sqrt((freedom + 1.0) / freedom))
