"""Fragility of a class of arches: samples of one that is not known exactly, or a fleet."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from archfrag.errors import InputError
from archfrag.fragility.curve import log_intensity
from archfrag.fragility.dispersion import total_variance
from archfrag.fragility.intervals import check_confidence

FloatArray = NDArray[np.float64]
# Steps of bisection for a quantile of a mixture: to the last digit from any bracket.
_BISECTIONS = 200
_REACH = 9.0  # standard deviations within which a quantile is looked for


@dataclass(frozen=True)
class ClassCurve:
    """Mixture of the lognormal curves of a class's arches, and the one lognormal nearest to it.

    Attributes
    ----------
    thetas, betas : (n_arch,) ndarray
        Medians and dispersions of the arches' own curves.
    weights : (n_arch,) ndarray
        What part of the class each arch stands for; they sum to 1.
    theta : float
        Median of the lognormal equivalent: exponential of the mean logarithm of capacity.
    beta : float
        Dispersion of the lognormal equivalent: the parts combined.
    beta_record_to_record : float
        Within arches, from record to record: root of the mean of the squared dispersions.
    beta_model : float
        Between arches: standard deviation of the logarithms of the medians.
    median : float
        Intensity at which the mixture itself is 1/2.
    misfit : float
        Largest difference between the probabilities of the mixture and of its equivalent [1].

    Notes
    -----
    The parts are those of `dispersion.total_variance`. They hold the sampling error of the thetas,
    which `dispersion.split_curves` takes out.
    """

    thetas: FloatArray
    betas: FloatArray
    weights: FloatArray
    theta: float
    beta: float
    beta_record_to_record: float
    beta_model: float
    median: float
    misfit: float

    def probability(self, im: ArrayLike) -> FloatArray:
        """Probability of collapse of an arch of the class at intensity `im`, same shape.

        Raises
        ------
        InputError
            If an intensity is negative or not a number.
        """
        return _mixture(log_intensity(im), np.log(self.thetas), self.betas, self.weights)

    def equivalent(self, im: ArrayLike) -> FloatArray:
        """Probability by the lognormal equivalent at intensity `im`, same shape.

        Raises
        ------
        InputError
            If an intensity is negative or not a number.
        """
        return ndtr((log_intensity(im) - np.log(self.theta)) / self.beta)

    def members(self, im: ArrayLike) -> FloatArray:
        """Curves of the arches at intensities `im` (n_im,), (n_arch, n_im)."""
        logs = np.atleast_1d(log_intensity(im))
        return ndtr((logs - np.log(self.thetas)[:, None]) / self.betas[:, None])


def class_curve(theta: ArrayLike, beta: ArrayLike, weights: ArrayLike | None = None) -> ClassCurve:
    """Curve of a class from the lognormal curves of its arches.

    Parameters
    ----------
    theta, beta : (n_arch,) array_like
        Medians and dispersions; an arch of which either is nan (no curve) is left out.
    weights : (n_arch,) array_like, optional
        Such as numbers of bridges; equal if not given.

    Returns
    -------
    ClassCurve

    Raises
    ------
    InputError
        If the arrays do not fit, a value is not greater than 0, or no arch is left.

    Examples
    --------
    >>> from archfrag.fragility.classes import class_curve
    >>> fleet = class_curve([0.8, 1.25], [0.3, 0.3])
    >>> round(fleet.theta, 6), round(fleet.beta_model, 4), round(fleet.beta, 4)
    (1.0, 0.2231, 0.3739)
    """
    thetas: FloatArray = np.asarray(theta, dtype=float)
    betas: FloatArray = np.asarray(beta, dtype=float)
    if thetas.ndim != 1 or thetas.shape != betas.shape:
        raise InputError(
            f"theta and beta have shapes {thetas.shape} and {betas.shape}; they must be (n_arch,)"
        )
    share = _shares(weights, thetas.size)
    known = ~(np.isnan(thetas) | np.isnan(betas))
    for name, values in (("theta", thetas), ("beta", betas)):
        bad = values[known & ~((values > 0.0) & np.isfinite(values))]
        if bad.size:
            raise InputError(f"{name} holds {bad[0]:g}; it must be finite and greater than 0")
    thetas, betas, share = thetas[known], betas[known], share[known]
    if not share.sum() > 0.0:
        raise InputError("no arch of the class has a curve and a weight")
    share = share / share.sum()
    logs = np.log(thetas)
    centre, within, between = total_variance(logs, betas, share)
    total = np.sqrt(within + between)
    x = centre + total * np.linspace(-6.0, 6.0, 1201)
    mixture = _mixture(x, logs, betas, share)
    return ClassCurve(
        thetas=thetas,
        betas=betas,
        weights=share,
        theta=float(np.exp(centre)),
        beta=float(total),
        beta_record_to_record=float(np.sqrt(within)),
        beta_model=float(np.sqrt(between)),
        median=float(np.exp(_mixture_quantile(0.5, logs, betas, share))),
        misfit=float(np.abs(mixture - ndtr((x - centre) / total)).max()),
    )


def _mixture(
    logs: FloatArray, centres: FloatArray, betas: FloatArray, weights: FloatArray
) -> FloatArray:
    logs = np.asarray(logs, dtype=float)
    total = np.zeros(logs.shape)
    # One arch after the other: a class of thousands at thousands of intensities needs no table.
    for centre, beta, weight in zip(centres, betas, weights):
        total += weight * ndtr((logs - centre) / beta)
    return total


def _mixture_quantile(
    probability: float, centres: FloatArray, betas: FloatArray, weights: FloatArray
) -> float:
    low = float(np.min(centres - _REACH * betas))
    high = float(np.max(centres + _REACH * betas))
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if weights @ ndtr((middle - centres) / betas) < probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _shares(weights: ArrayLike | None, count: int) -> FloatArray:
    if weights is None:
        return np.ones(count)
    share = np.asarray(weights, dtype=float)
    if share.shape != (count,):
        raise InputError(f"weights has shape {share.shape}; it must be ({count},)")
    bad = share[~((share >= 0.0) & np.isfinite(share))]
    if bad.size:
        raise InputError(f"weights holds {bad[0]:g}; a weight is a finite number from 0 upwards")
    return share


def capacity_curves(capacities: ArrayLike, im: ArrayLike) -> FloatArray:
    """Empirical curves: of each arch the fraction of its records that collapse it.

    Parameters
    ----------
    capacities : (n_arch, n_record) array_like
        Least intensity of collapse; inf: none was found up to the largest level, which `im`
        must not exceed then; nan: the arch does not meet the record.
    im : (n_im,) array_like

    Returns
    -------
    (n_arch, n_im) ndarray
        nan for an arch that meets no record.
    """
    capacities, im = np.asarray(capacities, dtype=float), np.asarray(im, dtype=float)
    if capacities.ndim != 2 or im.ndim != 1:
        raise InputError(
            f"capacities and im have shapes {capacities.shape} and {im.shape}; they must be "
            "(n_arch, n_record) and (n_im,)"
        )
    met = np.isfinite(capacities) | np.isinf(capacities)
    collapsed = (capacities[:, :, None] <= im).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(met.any(axis=1)[:, None], collapsed / met.sum(axis=1)[:, None], np.nan)


def mean_curve(curves: ArrayLike, weights: ArrayLike | None = None) -> FloatArray:
    """Curve of a class from curves of any kind: their mean, (n_im,).

    Parameters
    ----------
    curves : (n_arch, n_im) array_like
        Probabilities; arches with nan are left out.
    weights : (n_arch,) array_like, optional
        Equal if not given.

    Raises
    ------
    InputError
        If the arrays do not fit or no curve is left.
    """
    known, share = _known(curves, weights)
    return share @ known / share.sum()


def quantile_curves(
    curves: ArrayLike, quantiles: ArrayLike, weights: ArrayLike | None = None
) -> FloatArray:
    """Quantiles over a class of the probability at each intensity.

    Parameters
    ----------
    curves, weights
        As in `mean_curve`.
    quantiles : (n_quantile,) array_like
        Such as [0.05, 0.5, 0.95].

    Returns
    -------
    (n_quantile, n_im) ndarray
        The least probability that at least this part of the class does not exceed.

    Raises
    ------
    InputError
        As in `mean_curve`, or if a quantile is not from 0 to 1.
    """
    wanted = np.atleast_1d(np.asarray(quantiles, dtype=float))
    bad = wanted[~((wanted >= 0.0) & (wanted <= 1.0))]
    if bad.size:
        raise InputError(f"quantiles holds {bad[0]:g}; it must be from 0 to 1")
    known, share = _known(curves, weights)
    order = np.argsort(known, axis=0, kind="stable")
    risen = np.cumsum(share[order], axis=0) / share.sum()
    ordered = np.take_along_axis(known, order, axis=0)
    # Rounding of the sums must not push a quantile to the next arch.
    place = (risen[None] < wanted[:, None, None] - 1e-12).sum(axis=1)
    return np.take_along_axis(ordered, np.minimum(place, len(known) - 1), axis=0)


def _known(curves: ArrayLike, weights: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
    curves = np.asarray(curves, dtype=float)
    if curves.ndim != 2:
        raise InputError(f"curves has shape {curves.shape}; it must be (n_arch, n_im)")
    share = _shares(weights, len(curves))
    known = ~np.isnan(curves).any(axis=1) & (share > 0.0)
    if not known.any():
        raise InputError("no arch of the class has a curve and a weight")
    return curves[known], share[known]


@dataclass(frozen=True)
class Sensitivity:
    """How the capacity of a class's arches goes with a parameter.

    Attributes
    ----------
    parameter : str
    correlation : float
        Spearman's rank correlation with theta; nan if either does not vary.
    lower, upper : float
        Interval of it; nan with fewer than 5 arches.
    n_arch : int
        Arches with both numbers.
    """

    parameter: str
    correlation: float
    lower: float
    upper: float
    n_arch: int


def sensitivities(
    theta: ArrayLike, parameters: Mapping[str, ArrayLike], confidence: float = 0.9
) -> list[Sensitivity]:
    """Rank correlation of theta with each parameter, the strongest first.

    Parameters
    ----------
    theta : (n_arch,) array_like
        Medians, or any other measure of capacity; nan: unknown.
    parameters : mapping of str to (n_arch,) array_like
        nan: the arch has no such parameter.
    confidence : float
        Of the interval: Fisher's z with the variance (1 + rho²/2)/(n - 3) (Bonett and Wright,
        Psychometrika 65, 2000), for independent arches.

    Returns
    -------
    list of Sensitivity

    Raises
    ------
    InputError
        If an array has another length than `theta`.

    Examples
    --------
    >>> from archfrag.fragility.classes import sensitivities
    >>> found = sensitivities([1.0, 1.1, 1.3, 1.2, 1.5], {"thickness": [1, 2, 3, 4, 5]})
    >>> round(found[0].correlation, 3)
    0.9
    """
    theta = np.asarray(theta, dtype=float)
    check_confidence(confidence)
    found = [_sensitivity(name, theta, values, confidence) for name, values in parameters.items()]
    return sorted(found, key=lambda s: -np.nan_to_num(abs(s.correlation), nan=-1.0))


def _sensitivity(
    name: str, theta: FloatArray, values: ArrayLike, confidence: float
) -> Sensitivity:
    from scipy.stats import spearmanr

    parameter = np.asarray(values, dtype=float)
    if parameter.shape != theta.shape:
        raise InputError(
            f"parameter {name} has shape {parameter.shape}; it must be {theta.shape} as theta"
        )
    known = np.isfinite(theta) & np.isfinite(parameter)
    x, y, n = theta[known], parameter[known], int(known.sum())
    if n < 2 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return Sensitivity(name, np.nan, np.nan, np.nan, n)
    rho = float(np.clip(spearmanr(x, y).statistic, -1.0, 1.0))
    if n < 5:
        return Sensitivity(name, rho, np.nan, np.nan, n)
    if abs(rho) > 1.0 - 1e-12:
        return Sensitivity(name, rho, rho, rho, n)
    half = ndtri(0.5 + 0.5 * confidence) * np.sqrt((1.0 + 0.5 * rho**2) / (n - 3))
    lower, upper = np.tanh(np.arctanh(rho) + np.array([-half, half]))
    return Sensitivity(name, rho, float(lower), float(upper), n)
