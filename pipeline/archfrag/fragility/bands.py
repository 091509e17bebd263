"""Confidence bands of a fitted curve, and exact intervals of its data points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv, ndtr, ndtri

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import FloatArray, Fragility, log_intensity
from archfrag.fragility.fit import checked_stripes, fit_stripes


@dataclass(frozen=True)
class Band:
    """Pointwise confidence band of a curve.

    Attributes
    ----------
    lower, upper : ndarray, shape of the intensities asked for
        Probabilities of collapse.
    confidence : float
        Two-sided confidence at each intensity, e.g. 0.9.
    n_degenerate : int
        Bootstrap only: resamples without a lognormal curve (see `bootstrap_band`).
    """

    lower: FloatArray
    upper: FloatArray
    confidence: float
    n_degenerate: int = 0


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
    _check_confidence(confidence)
    z = (log_intensity(im) - np.log(fit.theta)) / fit.beta
    quantile = ndtri(0.5 + 0.5 * confidence)
    (var_theta, cov), (_, var_beta) = fit.covariance
    with np.errstate(invalid="ignore"):
        spread = quantile * np.sqrt(var_theta + 2.0 * cov * z + var_beta * z * z) / fit.beta
        lower, upper = ndtr(z - spread), ndtr(z + spread)
    at_zero = np.isneginf(z)
    return Band(np.where(at_zero, 0.0, lower), np.where(at_zero, 0.0, upper), confidence)


def theta_interval(fit: Fragility, confidence: float = 0.9) -> tuple[float, float]:
    """Confidence interval of the median, symmetric in its logarithm, unit of ``fit.theta``."""
    _check_confidence(confidence)
    reach = float(ndtri(0.5 + 0.5 * confidence) * fit.standard_errors[0])
    return fit.theta * np.exp(-reach), fit.theta * np.exp(reach)


def beta_interval(fit: Fragility, confidence: float = 0.9) -> tuple[float, float]:
    """Confidence interval of the dispersion, symmetric in its logarithm so that it stays > 0."""
    _check_confidence(confidence)
    reach = float(ndtri(0.5 + 0.5 * confidence) * fit.standard_errors[1] / fit.beta)
    return fit.beta * np.exp(-reach), fit.beta * np.exp(reach)


def bootstrap_band(
    fit: Fragility,
    im: ArrayLike,
    levels: ArrayLike,
    n: ArrayLike,
    *,
    seed: int,
    resamples: int = 1000,
    confidence: float = 0.9,
) -> Band:
    """Pointwise band of a curve fitted to stripes, from a parametric bootstrap.

    Collapses are drawn anew at each level from the fitted curve, the curve is fitted to each
    draw, and the band runs between the quantiles of the curves (percentile method). A draw whose
    likelihood has no maximum is not thrown away, for that would narrow the band: it enters with
    the curve that its likelihood tends to (all 0, all 1, a step, or constant) and is counted.

    Parameters
    ----------
    fit : Fragility
        From `fit_stripes`.
    im : array_like
        Intensities, any shape, unit of ``fit.theta``, >= 0.
    levels, n : array_like, (n_level,)
        As given to `fit_stripes`.
    seed : int
        Of numpy's default generator; the same seed gives the same band.
    resamples : int
        Number of draws, at least 100.
    confidence : float
        Two-sided, between 0 and 1.

    Raises
    ------
    InputError
        If an argument cannot be, or `fit` does not come from stripes.
    """
    _check_confidence(confidence)
    if fit.kind != "stripes":
        raise InputError(f"the fit is of kind {fit.kind!r}; the bootstrap redraws 'stripes' only")
    if resamples < 100:
        raise InputError(f"resamples is {resamples}; at least 100 are needed for quantiles")
    levels, _, n = checked_stripes(levels, np.zeros(np.shape(levels)), n)
    im = np.asarray(im, dtype=float)
    log_intensity(im)
    generator = np.random.default_rng(seed)
    draws = generator.binomial(n.astype(np.int64), fit.probability(levels), (resamples, n.size))
    distinct, copies = np.unique(draws, axis=0, return_counts=True)
    curves = np.empty((len(distinct), *im.shape))
    degenerate = np.zeros(len(distinct), dtype=bool)
    for i, collapses in enumerate(distinct):
        try:
            curves[i] = fit_stripes(levels, collapses, n).probability(im)
        except FitError:
            curves[i] = _limiting_curve(levels, collapses, n, im)
            degenerate[i] = True
    tail = 0.5 - 0.5 * confidence
    lower, upper = np.quantile(np.repeat(curves, copies, axis=0), [tail, 1.0 - tail], axis=0)
    return Band(lower, upper, confidence, int(copies[degenerate].sum()))


def clopper_pearson(
    collapses: ArrayLike, n: ArrayLike, confidence: float = 0.9
) -> tuple[FloatArray, FloatArray]:
    """Exact interval of each binomial fraction (Clopper and Pearson 1934, Biometrika 26).

    Parameters
    ----------
    collapses, n : array_like of int, (n_level,)
        Collapses among n runs; `n` may be one number for all levels.
    confidence : float
        Two-sided, between 0 and 1; each side holds at least half of it.

    Returns
    -------
    (ndarray, ndarray)
        Lower and upper end, (n_level,); nan where n = 0.

    Raises
    ------
    InputError
        If a count is negative, not whole, or collapses exceed n.
    """
    _check_confidence(confidence)
    collapses = np.atleast_1d(np.asarray(collapses, dtype=float))
    _, k, n = checked_stripes(np.ones(collapses.shape), collapses, n)
    tail = 0.5 - 0.5 * confidence
    lower = np.where(k > 0, betaincinv(np.maximum(k, 1), n - k + 1, tail), 0.0)
    upper = np.where(k < n, betaincinv(k + 1, np.maximum(n - k, 1), 1.0 - tail), 1.0)
    return np.where(n > 0, lower, np.nan), np.where(n > 0, upper, np.nan)


def _check_confidence(confidence: float) -> None:
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence is {confidence:g}; it lies between 0 and 1, such as 0.9")


def _limiting_curve(
    levels: FloatArray, collapses: FloatArray, n: FloatArray, im: FloatArray
) -> FloatArray:
    """Curve that the likelihood of `collapses` tends to where it has no maximum."""
    used = n > 0
    levels, collapses, n = levels[used], collapses[used], n[used]
    fraction = collapses.sum() / n.sum()
    if fraction in (0.0, 1.0):
        return np.full(im.shape, fraction)
    first_collapse = levels[collapses > 0].min()
    last_standing = levels[collapses < n].max()
    if first_collapse >= last_standing:
        step = np.sqrt(first_collapse * last_standing)
        return np.where(im == step, 0.5, (im > step).astype(float))
    return np.full(im.shape, fraction)
