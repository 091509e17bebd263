"""Lognormal curves from capacities: exact, bracketed between two levels, or censored."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.fragility.brackets import checked_brackets
from archfrag.fragility.curve import FloatArray, Fragility
from archfrag.fragility.likelihood import Observations, likeliest_line

_EXACT = 1e-7


def fit_moments(capacities: ArrayLike) -> Fragility:
    """Lognormal curve from the mean and standard deviation (n - 1) of ln capacity.

    Parameters
    ----------
    capacities : array_like, (n_record,)
        Any unit, > 0 and finite. For brackets see `brackets.midpoints`.

    Returns
    -------
    Fragility
        Of kind ``"ida"``; the covariance is s^2 diag(1 / n, 1 / (2 (n - 1))).

    Raises
    ------
    InputError
        If a capacity is not a positive finite number.
    FitError
        If all are equal.

    Examples
    --------
    >>> from archfrag.fragility.capacities import fit_moments
    >>> round(fit_moments([0.5, 0.7, 0.9, 1.3]).beta, 3)
    0.403
    """
    logs = np.log(_checked(capacities, "capacities", 0.0, np.inf))
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
    InputError
        If an argument cannot be.
    FitError
        If the likelihood has no maximum with beta > 0.

    Examples
    --------
    >>> from archfrag.fragility.capacities import fit_brackets
    >>> curve = fit_brackets([0.0, 0.2, 0.3, 0.4, 0.4], [0.2, 0.3, 0.4, 0.5, float("inf")])
    >>> round(curve.theta, 3), round(curve.beta, 3)
    (0.317, 0.467)
    """
    return _fit(*checked_brackets(lower, upper), kind="brackets")


def fit_truncated(capacities: ArrayLike, limit: float) -> Fragility:
    """As `fit_brackets`, of capacities known exactly up to a limit; see `fit.fit_ida`."""
    values = _checked(capacities, "capacities", 0.0, None)
    if not 0.0 < limit < np.inf:
        raise InputError(f"truncate_at is {limit:g}; a positive finite number is needed")
    known = values <= limit
    if known.all():
        return fit_moments(values)
    if not known.any():
        raise FitError(
            f"no capacity lies at or below truncate_at = {limit:g}: theta lies above it; try "
            "higher intensities"
        )
    if np.all(values[known] == limit):
        raise FitError(
            f"all observed capacities equal truncate_at = {limit:g}, so beta tends to 0; "
            "resolve the capacities more finely"
        )
    fit = _fit(np.where(known, values, limit), np.where(known, values, np.inf), "ida_truncated")
    return replace(fit, n_levels=int(np.unique(values[known]).size))


def _require_dispersion(lower: FloatArray, upper: FloatArray) -> None:
    """Raise FitError unless the likelihood of brackets has a maximum with beta > 0."""
    last, first = lower.max(), upper.min()
    if last <= first:
        raise FitError(
            f"one capacity between {last:g} and {first:g} would agree with all {lower.size} "
            "records, so beta tends to 0 and no dispersion can be estimated; add levels there, "
            "or records"
        )
    if not np.any((lower > 0.0) & np.isfinite(upper)):
        raise FitError(
            "no capacity is bracketed from both sides, so brackets cannot tell theta from beta; "
            "add levels below and above"
        )


def _checked(values: ArrayLike, name: str, above: float, below: float | None) -> FloatArray:
    values = np.asarray(values, dtype=float)
    if values.ndim != 1 or values.size == 0:
        raise InputError(
            f"{name} has shape {values.shape}; a list of one number per record is needed"
        )
    allowed = values > above
    if below is not None:
        allowed &= values < below
    if not allowed.all():
        raise InputError(
            f"{name} holds {values[~allowed][0]:g}; they are positive numbers"
            + ("" if below is None else ", and infinite only where truncate_at is given")
        )
    return values


def _fit(lower: FloatArray, upper: FloatArray, kind: str) -> Fragility:
    _require_dispersion(lower, upper)
    with np.errstate(divide="ignore"):
        low, high = np.log(lower), np.log(upper)
    ends = np.concatenate([low[np.isfinite(low)], high[np.isfinite(high)]])
    centre, width = ends.mean(), ends.std()
    seen, constant = _observations((low - centre) / width, (high - centre) / width)
    line, information, value = likeliest_line(seen)
    theta, beta, covariance = curve_of_line(line[None], information[None], centre, width)
    n_exact = np.count_nonzero(lower == upper)
    return Fragility(
        theta=float(theta[0]),
        beta=float(beta[0]),
        covariance=covariance[0],
        log_likelihood=float(value + constant - n_exact * np.log(width)),
        n_levels=int(np.unique(ends).size),
        n_total=lower.size,
        kind=kind,
    )


def _observations(low: FloatArray, high: FloatArray) -> tuple[Observations, float]:
    """Brackets of ln capacity sorted by what is known, and a constant of their log-likelihood.

    A bracket of almost no width is taken as its midpoint with the density times the width.
    """
    exact = high - low < _EXACT
    narrow = exact & (high > low)
    above, below = np.isposinf(high), np.isneginf(low)
    closed = ~(exact | above | below)
    one_sided = (above | below) & ~(above & below)
    middle = 0.5 * (low[exact] + high[exact])
    values, seen = np.unique(middle, return_counts=True)
    pairs, bracketed = np.unique(np.stack([low[closed], high[closed]]), axis=1, return_counts=True)
    level = np.unique(np.concatenate([low[one_sided & above], high[one_sided & below]]))
    collapsed = [(high[one_sided & below] == x).sum() for x in level]
    standing = [(low[one_sided & above] == x).sum() for x in level]
    return Observations(
        level, np.array(collapsed, float), np.array(standing, float),
        pairs[0], pairs[1], bracketed.astype(float), values, seen.astype(float),
    ), float(np.log((high - low)[narrow]).sum())  # fmt: skip


def curve_of_line(
    lines: FloatArray, information: FloatArray, centre: float, width: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Theta, beta (n,) and covariance of (ln theta, beta) (n, 2, 2) of lines in (x - c) / w."""
    a, b = lines.T
    beta = width / b
    jacobian = np.zeros((len(a), 2, 2))
    jacobian[:, 0, 0] = -beta
    jacobian[:, 0, 1] = beta * a / b
    jacobian[:, 1, 1] = -beta / b
    covariance = jacobian @ np.linalg.inv(information) @ jacobian.transpose(0, 2, 1)
    return np.exp(centre - beta * a), beta, covariance
