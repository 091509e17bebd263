"""Lognormal curves from capacities: exact, bracketed between two levels, or censored."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import FloatArray, Fragility
from archfrag.fragility.likelihood import Observations, likeliest_lines

_EXACT = 1e-7


@dataclass(frozen=True)
class Brackets:
    """Intensities between which the capacity of each record lies.

    Attributes
    ----------
    lower, upper : ndarray, (n_record,)
        Unit of the levels; `lower` is 0 where no run stood, `upper` inf where none collapsed.
    record : ndarray of int, (n_record,)
        Rows of the table they come from: records without a decided run are left out.
    n_islands : int
        Decided runs against the bracket of their record, whose verdicts do not only rise.
    """

    lower: FloatArray
    upper: FloatArray
    record: np.ndarray
    n_islands: int


def brackets_of(verdict: ArrayLike, levels: ArrayLike, rule: str = "count") -> Brackets:
    """Brackets of the capacities of records that were run at several levels.

    Where a record stands again above a level at which it collapsed there is no capacity in the
    strict sense, and a rule must say what is meant.

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level)
        Codes of `Verdict`; only runs that collapsed or stood are used.
    levels : array_like, (n_level,)
        Intensities, > 0, in any order.
    rule : {"count", "first"}
        ``"count"``: the border that leaves a record its number of collapses. On a full grid this
        leaves the area under the observed fractions as it is, and so the mean of the
        logarithms, whatever the islands. ``"first"``: the least level at which it collapsed,
        which is the capacity of incremental dynamic analysis (Vamvatsikos and Cornell 2002,
        Earthquake Engineering and Structural Dynamics 31(3)) and the one for bisected levels;
        with islands it is the lower of the two.

    Raises
    ------
    InputError
        If an argument cannot be, or no run is decided.
    """
    if rule not in ("count", "first"):
        raise InputError(f"rule is {rule!r}; it is 'count' or 'first'")
    count_verdicts(verdict)
    codes, levels = np.asarray(verdict), np.asarray(levels, dtype=float)
    if codes.ndim != 2 or levels.shape != codes.shape[1:]:
        raise InputError(
            f"verdict has shape {codes.shape}, levels {levels.shape}; records by all levels "
            "are needed"
        )
    if not np.all((levels > 0.0) & np.isfinite(levels)):
        raise InputError("levels holds a value that is not a positive finite number")
    order = np.argsort(levels)
    codes, levels = codes[:, order], levels[order]
    fell, stood = codes == Verdict.COLLAPSED, codes == Verdict.STANDING
    decided = fell | stood
    record = np.flatnonzero(decided.any(axis=1))
    if not record.size:
        raise InputError("verdict holds no run that collapsed or stood")
    fell, stood, decided = fell[record], stood[record], decided[record]
    if rule == "count":
        below = decided & (np.cumsum(decided, axis=1) <= stood.sum(axis=1, keepdims=True))
    else:
        below = stood & (np.cumsum(fell, axis=1) == 0)
    above = decided & ~below
    lower = np.where(below, levels, 0.0).max(axis=1)
    upper = np.where(above, levels, np.inf).min(axis=1)
    return Brackets(lower, upper, record, int((below & fell).sum() + (above & stood).sum()))


def fit_moments(capacities: ArrayLike) -> Fragility:
    """Lognormal curve from the mean and standard deviation (n - 1) of ln capacity.

    Parameters
    ----------
    capacities : array_like, (n_record,)
        Any unit, > 0 and finite. For brackets see `midpoints`.

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


def midpoints(lower: ArrayLike, upper: ArrayLike) -> FloatArray:
    """Geometric means of brackets that are closed on both sides, (n_closed,).

    Open brackets are left out, which biases the moments: `fit_brackets` uses them.
    """
    lower, upper = checked_brackets(lower, upper)
    closed = (lower > 0.0) & np.isfinite(upper)
    return np.sqrt(lower[closed] * upper[closed])


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


def checked_brackets(lower: ArrayLike, upper: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Ends of brackets as arrays of shape (n_record,).

    Raises
    ------
    InputError
        If a shape or a value cannot be.
    """
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if lower.ndim != 1 or lower.size == 0 or lower.shape != upper.shape:
        raise InputError(
            f"lower has shape {lower.shape}, upper {upper.shape}; one number per record is needed"
        )
    bad = ~((lower >= 0.0) & (lower <= upper) & np.isfinite(lower) & (upper > 0.0))
    if bad.any():
        i = int(np.argmax(bad))
        raise InputError(
            f"the bracket from {lower[i]:g} to {upper[i]:g} cannot be; 0 <= lower <= upper, "
            "lower finite and upper > 0 are needed"
        )
    return lower, upper


def require_dispersion(lower: FloatArray, upper: FloatArray) -> None:
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
    require_dispersion(lower, upper)
    with np.errstate(divide="ignore"):
        low, high = np.log(lower), np.log(upper)
    ends = np.concatenate([low[np.isfinite(low)], high[np.isfinite(high)]])
    centre, width = ends.mean(), ends.std()
    seen, constant = observations((low - centre) / width, (high - centre) / width)
    line, information, value = likeliest_lines(seen, 1)
    theta, beta, covariance = curve_of_line(line, information, centre, width)
    n_exact = seen.exact.size and float(seen.seen.sum())
    return Fragility(
        theta=float(theta[0]),
        beta=float(beta[0]),
        covariance=covariance[0],
        log_likelihood=float(value[0] + constant - n_exact * np.log(width)),
        n_levels=int(np.unique(ends).size),
        n_total=lower.size,
        kind=kind,
    )


def observations(low: FloatArray, high: FloatArray) -> tuple[Observations, float]:
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
