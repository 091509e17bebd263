"""Curves in many intensity measures at once, for the comparison in `measures`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, stdtr

from archfrag.fragility.binomial_lines import binomial_lines, inverse_mills
from archfrag.fragility.brackets import Brackets
from archfrag.fragility.censored_lines import ABOVE, BELOW, OBSERVED, censored_lines
from archfrag.fragility.curve import FloatArray


@dataclass(frozen=True)
class MeasureFits:
    """Fits in each measure, arrays of shape (n_measure,); nan where there is none.

    `slopes` and `p_values` are (n_measure, n_covariate): slope of ln capacity on the covariate,
    and the probability of so large a one by chance.
    """

    log_theta: FloatArray
    beta: FloatArray
    log_likelihood: FloatArray
    slopes: FloatArray
    p_values: FloatArray


@dataclass(frozen=True)
class LogCapacities:
    """ln capacities of records in each measure, some known as bounds only.

    Attributes
    ----------
    values : ndarray, (n_measure, n_record)
        The middle of each record's bracket, or the one end that is known.
    side : ndarray of int, (n_record,)
    rounding : ndarray, (n_measure, n_record)
        Variance that the bracket's width adds: its square over 12; 0 for a bound.
    """

    values: FloatArray
    side: NDArray[np.int64]
    rounding: FloatArray

    def only(self, measure: int) -> "LogCapacities":
        """The same in one measure."""
        part = slice(measure, measure + 1)
        return LogCapacities(self.values[part], self.side, self.rounding[part])


def log_capacities(found: Brackets, log_value: FloatArray, exponent: FloatArray) -> LogCapacities:
    """Capacities of records in measures, from brackets of their scale factor.

    Parameters
    ----------
    found : Brackets
        Of the scale factor; every record decided, (n_record,).
    log_value : ndarray, (n_measure, n_record)
        ln of the measures of the unscaled motion.
    exponent : ndarray, (n_measure,)
        Power of the scale factor in each measure.
    """
    known = found.bracketed
    above = ~np.isfinite(found.upper)
    side = np.where(known, OBSERVED, np.where(above, ABOVE, BELOW))
    end = np.where(above, found.lower, found.upper)
    log_factor = np.log(np.where(known, found.middle, end))
    width = np.where(known, np.log(np.where(known, found.upper, 1.0)), 0.0)
    width -= np.where(known, np.log(np.where(known, found.lower, 1.0)), 0.0)
    return LogCapacities(
        log_value + exponent[:, None] * log_factor,
        side,
        (exponent[:, None] * width) ** 2 / 12.0,
    )


def fit_capacities(known: LogCapacities, covariates: FloatArray) -> MeasureFits:
    """Normal distribution of ln capacity in each measure, and its regression on covariates.

    Parameters
    ----------
    known : LogCapacities
    covariates : ndarray, (n_covariate, n_record)
        One regression each; nan where not known.
    """
    n_measure, n_record = known.values.shape
    log_theta, beta = weighted_normal(known, np.ones((1, n_record)))
    slopes = np.full((n_measure, len(covariates)), np.nan)
    p_values = slopes.copy()
    for j, covariate in enumerate(covariates):
        used = np.isfinite(covariate)
        if np.count_nonzero(used) < 5 or np.ptp(covariate[used]) == 0.0:
            continue
        part = LogCapacities(known.values[:, used], known.side[used], known.rounding[:, used])
        slopes[:, j], p_values[:, j] = _regressions(part, covariate[used])
    return MeasureFits(log_theta, beta, np.full(n_measure, np.nan), slopes, p_values)


def weighted_normal(known: LogCapacities, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and deviation of ln capacity for each row of weights or of capacities, (n_fit,) each.

    Without bounds they are the moments, with n - 1; with bounds the likeliest values, with the
    same factor. The variance that the brackets' width adds is taken out (Sheppard's correction)
    unless nothing would be left.

    Parameters
    ----------
    known : LogCapacities
        Of n_fit measures and one row of weights, or of one measure and n_fit rows.
    weight : ndarray, (n_fit or 1, n_record)
    """
    y, observed = known.values, known.side == OBSERVED
    total = weight.sum(axis=1)
    if observed.all():
        mean = (weight * y).sum(axis=1) / total
        square = (weight * (y - mean[:, None]) ** 2).sum(axis=1) / total
    elif observed.any():
        design = np.ones((y.shape[1], 1))
        coefficients, deviation, _ = censored_lines(design, y, known.side, weight)
        mean, square = coefficients[:, 0], deviation**2
    else:
        mean = np.full(max(len(weight), len(y)), np.nan)
        square = mean.copy()
    with np.errstate(divide="ignore", invalid="ignore"):
        square = square * total / (total - 1.0)
        rounding = (weight * known.rounding).sum(axis=1) / (weight * observed).sum(axis=1)
        square = np.where(square > rounding, square - rounding, square)
    return mean, np.where(square > 0.0, np.sqrt(np.maximum(square, 0.0)), np.nan)


def fit_verdicts(log_im: FloatArray, fell: FloatArray, covariates: FloatArray) -> MeasureFits:
    """Probit lines of verdicts on ln im in each measure, and score tests of covariates.

    The score test asks whether a covariate, added to the line, would raise the likelihood (Rao
    1948, Proc. Camb. Phil. Soc. 44); its first Newton step is the slope that is given.

    Parameters
    ----------
    log_im : ndarray, (n_measure, n_run)
    fell : ndarray, (n_run,)
        1 where the run collapsed, 0 where it stood.
    covariates : ndarray, (n_covariate, n_run)
        nan where not known.
    """
    n_measure, n_run = log_im.shape
    fallen, once = np.broadcast_to(fell, log_im.shape), np.ones((n_measure, n_run))
    lines = binomial_lines(log_im, fallen, once)
    sound = ~lines.degenerate
    with np.errstate(divide="ignore", invalid="ignore"):
        beta = np.where(sound, 1.0 / lines.slope, np.nan)
        log_theta = np.where(sound, -lines.intercept / lines.slope, np.nan)
    slopes = np.full((n_measure, len(covariates)), np.nan)
    p_values = slopes.copy()
    for j, covariate in enumerate(covariates):
        used = np.isfinite(covariate)
        if np.count_nonzero(used) < 5 or np.ptp(covariate[used]) == 0.0:
            continue
        x, k = log_im[:, used], fell[used]
        part = binomial_lines(x, np.broadcast_to(k, x.shape), np.ones(x.shape))
        score, information = _score(part.intercept, part.slope, x, k, covariate[used])
        keep = ~part.degenerate & (information > 0.0) & sound
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes[keep, j] = (-score / information / part.slope)[keep]
            p_values[keep, j] = chdtrc(1, score**2 / information)[keep]
    log_likelihood = np.where(sound, -lines.loss, np.nan)
    return MeasureFits(log_theta, beta, log_likelihood, slopes, p_values)


def _score(
    intercept: FloatArray, slope: FloatArray, x: FloatArray, fell: FloatArray, extra: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Score of an added covariate, and its information given the line, (n_measure,) each."""
    z = intercept[:, None] + slope[:, None] * x
    up, down = inverse_mills(z), inverse_mills(-z)
    first = fell * up - (1.0 - fell) * down
    weight = up * down
    extra = extra - extra.mean()
    a, b, c = weight.sum(1), (weight * x).sum(1), (weight * x * x).sum(1)
    u, v = weight @ extra, (weight * x) @ extra
    determinant = a * c - b * b
    taken = (c * u * u - 2.0 * b * u * v + a * v * v) / np.where(
        determinant > 0.0, determinant, np.inf
    )
    return first @ extra, weight @ (extra * extra) - taken


def _regressions(known: LogCapacities, covariate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope of ln capacity on a covariate, and p-value, in each measure."""
    off = covariate - covariate.mean()
    if np.all(known.side == OBSERVED):
        y = known.values - known.values.mean(axis=1, keepdims=True)
        slope = y @ off / (off @ off)
        freedom = off.size - 2
        residual = ((y - slope[:, None] * off) ** 2).sum(axis=1) / freedom
        with np.errstate(divide="ignore", invalid="ignore"):
            statistic = np.abs(slope) / np.sqrt(residual / (off @ off))
        return slope, 2.0 * stdtr(freedom, -statistic)
    once = np.ones((1, off.size))
    nothing = np.full(len(known.values), np.nan)
    if np.count_nonzero(known.side == OBSERVED) < 4:
        return nothing, nothing
    once, constant = np.ones((1, off.size)), np.ones((off.size, 1))
    without = censored_lines(constant, known.values, known.side, once)[2]
    design = np.column_stack([constant, off])
    coefficients, _, loss = censored_lines(design, known.values, known.side, once)
    return coefficients[:, 1], chdtrc(1, np.maximum(2.0 * (without - loss), 0.0))
