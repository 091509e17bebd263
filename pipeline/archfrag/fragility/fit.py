"""Lognormal fragility curves by maximum likelihood, from stripes and from capacities.

A curve is P(collapse | im) = Phi((ln im - ln theta) / beta). On the probit scale it is the
straight line Phi^-1(P) = intercept + slope ln im with slope = 1 / beta, in which the binomial
likelihood is concave: it has one maximum, and none exactly where the data are separated.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from archfrag.errors import FitError, InputError
from archfrag.fragility.binomial_lines import Lines, binomial_lines
from archfrag.fragility.capacities import curve_of_line, fit_moments, fit_truncated
from archfrag.fragility.curve import FloatArray, Fragility

__all__ = ["FitMany", "Fragility", "checked_stripes", "fit_ida", "fit_many", "fit_stripes"]

_LARGEST_LOG = 600.0


@dataclass(frozen=True)
class FitMany:
    """Curves of many draws; nan where the likelihood of a draw has no maximum.

    Attributes
    ----------
    theta, beta : ndarray, (n_draw,)
        Median, in the unit of the levels, and dispersion.
    covariance : ndarray, (n_draw, 2, 2)
        Of (ln theta, beta).
    log_likelihood : ndarray, (n_draw,)
        With the binomial coefficients.
    fitted : ndarray of bool, (n_draw,)
        Where there is a curve.
    """

    theta: FloatArray
    beta: FloatArray
    covariance: FloatArray
    log_likelihood: FloatArray
    fitted: NDArray[np.bool_]


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
    many = fit_many(im, collapses[None], n)
    if not many.fitted[0]:
        raise _not_rising(im)
    return Fragility(
        theta=float(many.theta[0]),
        beta=float(many.beta[0]),
        covariance=many.covariance[0],
        log_likelihood=float(many.log_likelihood[0]),
        n_levels=int(np.unique(im).size),
        n_total=int(n.sum()),
        kind="stripes",
    )


def fit_many(levels: ArrayLike, collapses: ArrayLike, n: ArrayLike) -> FitMany:
    """Fit a curve to each of many draws of collapse counts, all at once.

    The estimates are those of `fit_stripes`.

    Parameters
    ----------
    levels : array_like, (n_level,)
        Intensities, > 0.
    collapses : array_like, (n_draw, n_level)
        Runs that collapsed, 0 to `n`; weights that are not whole are allowed.
    n : array_like, (n_draw, n_level) or what broadcasts to it
        Runs that collapsed or stood.

    Raises
    ------
    InputError
        If a shape or a value cannot be.

    Examples
    --------
    >>> from archfrag.fragility.fit import fit_many
    >>> many = fit_many([0.2, 0.4, 0.8], [[1, 5, 9], [0, 0, 10]], 10)
    >>> many.theta.round(3), many.fitted
    (array([0.4, nan]), array([ True, False]))
    """
    levels, collapses = np.asarray(levels, dtype=float), np.asarray(collapses, dtype=float)
    if collapses.ndim != 2 or levels.shape != collapses.shape[1:] or not levels.size:
        raise InputError(
            f"collapses has shape {collapses.shape}, levels {levels.shape}; draws by levels are "
            "needed"
        )
    n = np.broadcast_to(np.asarray(n, dtype=float), collapses.shape)
    if not np.all((collapses >= 0.0) & (collapses <= n) & np.isfinite(n)):
        raise InputError("collapses holds a value that is not between 0 and n")
    if not np.all((levels > 0.0) & np.isfinite(levels)):
        raise InputError("levels holds a value that is not a positive finite number")
    return curves_of_lines(binomial_lines(np.log(levels), collapses, n), collapses, n)


def curves_of_lines(lines: Lines, collapses: FloatArray, n: FloatArray) -> FitMany:
    """Curves of probit lines in ln im, (n_draw,), of draws (n_draw, n_level)."""
    theta, beta, log_likelihood = (np.full(len(n), np.nan) for _ in range(3))
    covariance = np.full((len(n), 2, 2), np.nan)
    # Where the line is as good as level the median lies beyond all numbers.
    fitted = ~lines.degenerate & (lines.slope > np.abs(lines.intercept) / _LARGEST_LOG)
    draws = np.flatnonzero(fitted)
    if draws.size:
        both = np.stack([lines.intercept, lines.slope], axis=1)[draws]
        theta[draws], beta[draws], covariance[draws] = curve_of_line(
            both, lines.information[draws], 0.0, 1.0
        )
        k, m = collapses[draws], n[draws]
        coefficients = gammaln(m + 1) - gammaln(k + 1) - gammaln(m - k + 1)
        log_likelihood[draws] = coefficients.sum(axis=1) - lines.loss[draws]
    return FitMany(theta, beta, covariance, log_likelihood, fitted)


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
    if truncate_at is None:
        return fit_moments(capacities)
    return fit_truncated(capacities, truncate_at)


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
