"""Theta and beta from a cheap setting on all records and an expensive one on some."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import FloatArray

METHODS = ("fine", "difference", "optimal")


@dataclass(frozen=True)
class TwoFidelity:
    """Curve of the expensive setting, estimated with the help of the cheap one.

    Attributes
    ----------
    method : str
        ``"fine"``, ``"difference"`` or ``"optimal"``.
    theta, beta : float
        Of the expensive setting, corrected for the bias below.
    standard_errors : (float, float)
        Of ln theta and beta, by the jackknife.
    bias : (float, float)
        Of ln theta and beta before correction, by the jackknife.
    coefficient : float
        Weight of the cheap setting: 0, 1, or estimated.
    correlation : float
        Of the ln capacities by both settings, over the records with both.
    n_fine, n_coarse : int
        Records with the expensive setting, and with the cheap one.
    """

    method: str
    theta: float
    beta: float
    standard_errors: tuple[float, float]
    bias: tuple[float, float]
    coefficient: float
    correlation: float
    n_fine: int
    n_coarse: int


@dataclass(frozen=True)
class Gain:
    """What control variates save.

    Attributes
    ----------
    factor : float
        Cost without divided by cost with them, at equal standard error of ln theta.
    fine_fraction : float
        Records of which the expensive setting is to be run too; 1 where it does not pay.
    pays : bool
        Whether the factor is above 1.
    message : str
    """

    factor: float
    fine_fraction: float
    pays: bool
    message: str


def estimate_two_fidelity(
    coarse: ArrayLike, fine: ArrayLike, method: str = "optimal"
) -> TwoFidelity:
    """Median and dispersion of capacity by the expensive setting.

    With m records that have both capacities and x, y their logarithms by the cheap and the
    expensive setting,

        ln theta = mean y + c (mean of all x - mean of x of the m),
        beta^2 = var y + c^2 (var of all x - var of x of the m):

    'difference' takes c = 1, which is unbiased in ln theta and good if the settings differ by
    scatter only; 'optimal' the regression coefficient of y on x, which has the least variance
    (for normal values this is the likeliest estimate with values missing; Anderson 1957, J. Am.
    Stat. Assoc. 52); 'fine' c = 0, the m records alone. That c is estimated from the same
    records, and that a variance with divisor m is too small, makes a bias of order 1 / m: it is
    estimated by the jackknife of both groups of records and taken out.

    The records with the expensive setting must not be chosen by their capacities.

    Parameters
    ----------
    coarse : array_like, (n_record,)
        Capacities by the cheap setting, any unit, > 0.
    fine : array_like, (n_record,)
        Capacities by the expensive setting, nan where it was not run.
    method : str
        ``"optimal"``, ``"difference"`` or ``"fine"``.

    Raises
    ------
    InputError
        If an argument cannot be.
    FitError
        If fewer than four records have both capacities, or these do not vary.

    Examples
    --------
    >>> import numpy as np
    >>> from archfrag.fragility.control_variates import estimate_two_fidelity
    >>> generator = np.random.default_rng(1)
    >>> coarse = np.exp(generator.normal(0.0, 0.4, 200))
    >>> fine = 1.1 * coarse * np.exp(generator.normal(0.0, 0.05, 200))
    >>> fine[20:] = np.nan
    >>> found = estimate_two_fidelity(coarse, fine)
    >>> alone = estimate_two_fidelity(coarse, fine, "fine")
    >>> found.standard_errors[0] < alone.standard_errors[0]
    True
    """
    x, y = _checked(coarse, fine, method)
    both = ~np.isnan(y)
    m = int(np.count_nonzero(both))
    estimates, coefficients = _estimates(x, y, _leaving_one_out(both), method)
    values, coefficient = estimates[0], coefficients[0]
    square_error, bias = np.zeros(2), np.zeros(2)
    for without in (estimates[1:][both], estimates[1:][~both]):
        if len(without) < 2:
            continue
        off = without - without.mean(axis=0)
        square_error += (len(without) - 1) / len(without) * np.sum(off**2, axis=0)
        bias += (len(without) - 1) * (without.mean(axis=0) - values)
    log_theta, beta = values - bias
    if not beta > 0.0:
        raise FitError(
            f"the two settings give no dispersion above 0 from {m} records with both; run the "
            "expensive one for more records"
        )
    errors = np.sqrt(square_error)
    return TwoFidelity(
        method=method,
        theta=float(np.exp(log_theta)),
        beta=float(beta),
        standard_errors=(float(errors[0]), float(errors[1])),
        bias=(float(bias[0]), float(bias[1])),
        coefficient=float(coefficient),
        correlation=float(np.corrcoef(x[both], y[both])[0, 1]),
        n_fine=m,
        n_coarse=x.size,
    )


def control_variate_gain(
    correlation: float, cost_ratio: float, n_pilot: int | None = None
) -> Gain:
    """Cost that control variates save, and whether they pay.

    Variance of ln theta from m expensive and n >= m cheap runs is beta^2 ((1 - r^2) / m + r^2 /
    n), its cost m + n / w. At the best n / m = r sqrt(w / (1 - r^2)) variance times cost is
    smaller than with expensive runs alone by 1 / (sqrt(1 - r^2) + sqrt(r^2 / w))^2 (the two-model
    case of Peherstorfer, Willcox and Gunzburger 2016, SIAM J. Sci. Comput. 38). With r^2 <= 1 /
    (1 + w) that n would be below m: nothing is gained.

    Parameters
    ----------
    correlation : float
        r, of ln capacities (or verdicts) by both settings, -1 to 1.
    cost_ratio : float
        w, cost of the expensive setting over that of the cheap one, > 1.
    n_pilot : int, optional
        Records that the correlation was estimated from, at least 4. Then `pays` asks whether it
        would pay at the lower end of the one-sided 95 % interval of the correlation too
        (Fisher's z).

    Raises
    ------
    InputError
        If an argument cannot be.

    Examples
    --------
    >>> from archfrag.fragility.control_variates import control_variate_gain
    >>> [round(control_variate_gain(r, 8.5).factor, 1) for r in (0.90, 0.95, 0.98)]
    [1.8, 2.5, 3.5]
    """
    if not -1.0 <= correlation <= 1.0:
        raise InputError(f"correlation is {correlation:g}; it lies between -1 and 1")
    if not 1.0 < cost_ratio < np.inf:
        raise InputError(f"cost_ratio is {cost_ratio:g}; a number above 1 is needed")
    if n_pilot is not None and n_pilot < 4:
        raise InputError(f"n_pilot is {n_pilot}; at least 4 records give an interval")
    factor, fraction = _gain(correlation, cost_ratio)
    pays, doubt = factor > 1.0, ""
    if n_pilot is not None and abs(correlation) < 1.0:
        low = float(np.tanh(np.arctanh(abs(correlation)) - 1.6449 / np.sqrt(n_pilot - 3)))
        least = _gain(max(low, 0.0), cost_ratio)[0]
        pays = pays and least > 1.0
        doubt = f" (at least {least:.2g} by the {n_pilot} records it was estimated from)"
    message = (
        f"correlation {correlation:.3g} at a cost ratio of {cost_ratio:.3g} saves a factor of "
        f"{factor:.2g}{doubt}: "
        + (
            f"run the expensive setting for {100.0 * fraction:.0f} % of the records"
            if pays
            else "control variates do not pay, run the expensive setting alone"
        )
    )
    return Gain(factor, fraction if pays else 1.0, bool(pays), message)


def _gain(correlation: float, cost_ratio: float) -> tuple[float, float]:
    square = correlation * correlation
    if square * (1.0 + cost_ratio) <= 1.0:
        return 1.0, 1.0
    factor = 1.0 / (np.sqrt(1.0 - square) + np.sqrt(square / cost_ratio)) ** 2
    fraction = np.sqrt((1.0 - square) / (cost_ratio * square))
    return (float(factor), float(fraction)) if factor > 1.0 else (1.0, 1.0)


def _leaving_one_out(both: NDArray[np.bool_]) -> FloatArray:
    """Weights of all records, then with each left out in turn, (1 + n_record, n_record).

    The others of its group (with both settings, or with the cheap one only) take over the weight
    of the record left out, so that means over all records keep their fractions of the groups and
    no linear estimate has a bias.
    """
    n = both.size
    weight = np.ones((n + 1, n))
    for group in (both, ~both):
        size = np.count_nonzero(group)
        if size > 1:
            index = np.flatnonzero(group)
            weight[np.ix_(index + 1, index)] = size / (size - 1)
            weight[index + 1, index] = 0.0
    return weight


def _estimates(
    x: FloatArray, y: FloatArray, weight: FloatArray, method: str
) -> tuple[FloatArray, FloatArray]:
    """ln theta and beta for each row of weights, (n_row, 2), and the coefficients."""
    both = ~np.isnan(y)
    x0 = x.mean()
    x, y = x - x0, np.where(both, y - x0, 0.0)
    n, m = x.size, np.count_nonzero(both)
    some = weight * both
    mean_x, mean_y, mean_all = some @ x / m, some @ y / m, weight @ x / n
    var_x, var_y = some @ (x * x) / m - mean_x**2, some @ (y * y) / m - mean_y**2
    var_all = weight @ (x * x) / n - mean_all**2
    if method == "optimal":
        c = (some @ (x * y) / m - mean_x * mean_y) / var_x
    else:
        c = np.full(len(weight), 1.0 if method == "difference" else 0.0)
    square = var_y + c * c * (var_all - var_x)
    log_theta = x0 + mean_y + c * (mean_all - mean_x)
    return np.stack([log_theta, np.sqrt(np.maximum(square, 0.0))], axis=1), c


def _checked(coarse: ArrayLike, fine: ArrayLike, method: str) -> tuple[FloatArray, FloatArray]:
    if method not in METHODS:
        raise InputError(f"method is {method!r}; it is one of {', '.join(METHODS)}")
    cheap, costly = np.asarray(coarse, dtype=float), np.asarray(fine, dtype=float)
    if cheap.ndim != 1 or cheap.shape != costly.shape:
        raise InputError(f"coarse has shape {cheap.shape}, fine {costly.shape}; (n_record,) each")
    for name, values in (("coarse", cheap), ("fine", costly[~np.isnan(costly)])):
        bad = values[~((values > 0.0) & np.isfinite(values))]
        if bad.size:
            raise InputError(f"{name} holds {bad[0]:g}; capacities are positive finite numbers")
    both = ~np.isnan(costly)
    if np.count_nonzero(both) < 4:
        raise FitError(
            f"{np.count_nonzero(both)} records have capacities by both settings; 4 are needed"
        )
    if np.ptp(cheap[both]) == 0.0 or np.ptp(costly[both]) == 0.0:
        raise FitError("capacities by both settings do not vary, so nothing can be estimated")
    return np.log(cheap), np.log(costly)
