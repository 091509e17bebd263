"""Theta and beta from a cheap setting on all records and an expensive one on some."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError
from archfrag.fragility.curve import BoolArray, FloatArray, positive, shaped


@dataclass(frozen=True)
class TwoFidelity:
    """Curve of the expensive setting, estimated with the help of the cheap one."""

    theta: float  #: of the expensive setting, corrected for the bias below
    beta: float
    standard_errors: tuple[float, float]  #: of ln theta and beta, by the jackknife
    bias: tuple[float, float]  #: of ln theta and beta before correction, by the jackknife
    correlation: float  #: of the ln capacities by both settings, over the records with both
    n_fine: int  #: records with the expensive setting
    n_coarse: int  #: and with the cheap one


def estimate_two_fidelity(coarse: ArrayLike, fine: ArrayLike) -> TwoFidelity:
    """Median and dispersion of capacity by the expensive setting.

    With m records that have both capacities and x, y their logarithms by the cheap and the
    expensive setting,

        ln theta = mean y + c (mean of all x - mean of x of the m),
        beta^2 = var y + c^2 (var of all x - var of x of the m):

    c is the regression coefficient of y on x, which has the least variance (for normal values
    this is the likeliest estimate with values missing; Anderson 1957, J. Am. Stat. Assoc. 52).
    That c is estimated from the same records, and that a variance with divisor m is too small,
    makes a bias of order 1 / m: it is estimated by the jackknife of both groups of records and
    taken out.

    The records with the expensive setting must not be chosen by their capacities.

    Parameters
    ----------
    coarse : array_like, (n_record,)
        Capacities by the cheap setting, any unit, > 0.
    fine : array_like, (n_record,)
        Capacities by the expensive setting, nan where it was not run.

    Raises
    ------
    InputError, FitError
        If an argument cannot be; if fewer than four records have both capacities, or these do not
        vary.

    Examples
    --------
    >>> import numpy as np
    >>> from archfrag.fragility.control_variates import estimate_two_fidelity
    >>> generator = np.random.default_rng(1)
    >>> coarse = np.exp(generator.normal(0.0, 0.4, 200))
    >>> fine = 1.1 * coarse * np.exp(generator.normal(0.0, 0.05, 200))
    >>> fine[20:] = np.nan
    >>> found = estimate_two_fidelity(coarse, fine)
    >>> found.standard_errors[0] < 0.5 * found.beta / 20**0.5
    True
    """
    cheap = positive(coarse, "coarse")
    costly = shaped(positive(fine, "fine", unknown=True), (cheap.size,), "fine")
    both = ~np.isnan(costly)
    m = int(np.count_nonzero(both))
    if m < 4:
        raise FitError(f"{m} records have capacities by both settings; 4 are needed")
    if np.ptp(cheap[both]) == 0.0 or np.ptp(costly[both]) == 0.0:
        raise FitError("capacities by both settings do not vary, so nothing can be estimated")
    x, y = np.log(cheap), np.log(costly)
    estimates = _estimates(x, y, _leaving_one_out(both))
    square_error, bias = np.zeros(2), np.zeros(2)
    for without in (estimates[1:][both], estimates[1:][~both]):
        if len(without) > 1:
            off = without - without.mean(axis=0)
            square_error += (len(without) - 1) / len(without) * np.sum(off**2, axis=0)
            bias += (len(without) - 1) * (without.mean(axis=0) - estimates[0])
    log_theta, beta = estimates[0] - bias
    if not beta > 0.0:
        why = f"the two settings give no dispersion above 0 from {m} records with both"
        raise FitError(f"{why}; run the expensive one for more records")
    errors = np.sqrt(square_error)
    pairs = (float(errors[0]), float(errors[1])), (float(bias[0]), float(bias[1]))
    correlation = float(np.corrcoef(x[both], y[both])[0, 1])
    return TwoFidelity(float(np.exp(log_theta)), float(beta), *pairs, correlation, m, x.size)


def _leaving_one_out(both: BoolArray) -> FloatArray:
    """Weights of all records, then with one left out after the other, (1 + n_record, n_record).

    The others of its group (with both settings, or with the cheap one only) take over the weight
    of the record left out, so that no linear estimate has a bias.
    """
    weight = np.ones((both.size + 1, both.size))
    for index in (np.flatnonzero(both), np.flatnonzero(~both)):
        if index.size > 1:
            weight[np.ix_(index + 1, index)] = index.size / (index.size - 1)
            weight[index + 1, index] = 0.0
    return weight


def _estimates(x: FloatArray, y: FloatArray, weight: FloatArray) -> FloatArray:
    """ln theta and beta for each row of weights, (n_row, 2)."""
    both = ~np.isnan(y)
    x0 = x.mean()
    x, y = x - x0, np.where(both, y - x0, 0.0)
    n, m = x.size, np.count_nonzero(both)
    some = weight * both
    mean_x, mean_y, mean_all = some @ x / m, some @ y / m, weight @ x / n
    var_x, var_y = some @ (x * x) / m - mean_x**2, some @ (y * y) / m - mean_y**2
    var_all = weight @ (x * x) / n - mean_all**2
    c = (some @ (x * y) / m - mean_x * mean_y) / var_x
    square = var_y + c * c * (var_all - var_x)
    log_theta = x0 + mean_y + c * (mean_all - mean_x)
    return np.stack([log_theta, np.sqrt(np.maximum(square, 0.0))], axis=1)
