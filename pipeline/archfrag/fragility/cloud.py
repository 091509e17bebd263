"""Cloud analysis: curves from records at their own amplitude, with collapses as what they are.

Runs of a cloud are at as many intensities as there are records. The response of those that stood
is regressed on the intensity in logarithms; a run that collapsed has no response to regress, and
leaving it out would bias the line. Three remedies: the verdicts alone (`cloud_binary`), response
and verdict together by total probability (`cloud_modified`), and the response as a value that is
known to lie above a cap (`cloud_censored`).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import FitError, InputError
from archfrag.fragility.binomial_lines import binomial_lines
from archfrag.fragility.censored_lines import ABOVE, OBSERVED, censored_lines
from archfrag.fragility.cloud_curve import CloudCurve, make_curve
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.runs import Resampling, event_groups

__all__ = ["CloudCurve", "cloud_binary", "cloud_censored", "cloud_modified"]


def cloud_binary(
    im: ArrayLike,
    collapsed: ArrayLike,
    resampling: Resampling,
    *,
    link: str = "logistic",
    event: ArrayLike | None = None,
) -> CloudCurve:
    """Logistic or probit regression of collapse on ln im.

    Parameters
    ----------
    im : array_like, (n_run,)
        Intensity of each record, any unit, > 0.
    collapsed : array_like of bool, (n_run,)
        Runs without a verdict must be left out before.
    resampling : Resampling
    link : str
        ``"logistic"`` or ``"probit"``; the latter is the lognormal curve.
    event : array_like, (n_run,), optional
        Earthquake of each record; records of one event are resampled together.

    Raises
    ------
    InputError
        If an argument cannot be.
    FitError
        If the likelihood has no maximum with a curve that rises.

    Examples
    --------
    >>> from archfrag.fragility.cloud import cloud_binary
    >>> from archfrag.fragility.runs import Resampling
    >>> curve = cloud_binary(
    ...     [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0, 0, 1, 0, 1, 1], Resampling(seed=1)
    ... )
    >>> round(curve.theta, 3)
    0.327
    """
    x, fell = _checked(im, collapsed)
    if not fell.any() or fell.all():
        raise FitError(
            f"{'every' if fell.all() else 'no'} run of the cloud collapsed between "
            f"{np.exp(x.min()):g} and {np.exp(x.max()):g}, so theta lies "
            f"{'below' if fell.all() else 'above'} them; add "
            f"{'weaker' if fell.all() else 'stronger'} records"
        )
    weight = _weights(x.size, event, resampling)
    lines = binomial_lines(x, weight * fell, weight, link)
    if lines.degenerate[0]:
        raise FitError(
            "the runs of the cloud that collapsed and those that stood do not overlap in "
            f"intensity (perfect separation) near {np.sqrt(_border(x, fell)):g}, so beta tends "
            "to 0; add records near it"
            if lines.slope[0] > 0.0
            else "the fraction of collapses does not rise with intensity over the cloud; add "
            "records"
        )
    draws = np.stack([lines.intercept, lines.slope], axis=1)
    names = ["collapse_intercept", "collapse_slope"]
    return make_curve(link, names, draws, lines.degenerate, fell, resampling)


def cloud_modified(
    im: ArrayLike,
    response: ArrayLike,
    collapsed: ArrayLike,
    limit: float,
    resampling: Resampling,
    *,
    event: ArrayLike | None = None,
) -> CloudCurve:
    """Probability that the response exceeds a limit, from response and collapse together.

    P(exceeded | im) = P(response > limit | im, no collapse) (1 - P(collapse | im))
    + P(collapse | im): five parameters, of the line of ln response on ln im over the runs that
    did not collapse (its deviation with n - 2) and of the logistic line of collapse (Jalayer,
    Ebrahimian, Miano, Manfredi and Sezen 2017, EESD 46(15), 2639-2663). The band is from the
    bootstrap of records instead of their Bayesian sampling.

    Parameters
    ----------
    im : array_like, (n_run,)
        Intensity of each record, any unit, > 0.
    response : array_like, (n_run,)
        Peak response, any unit, > 0; any value where the run collapsed.
    collapsed : array_like of bool, (n_run,)
    limit : float
        Response at which the limit state begins, > 0.
    resampling : Resampling
    event : array_like, (n_run,), optional
        Earthquake of each record; records of one event are resampled together.

    Raises
    ------
    InputError
        If an argument cannot be.
    FitError
        If fewer than three runs stood, or the response does not rise with intensity.
    """
    x, fell = _checked(im, collapsed)
    y = _log_response(response, ~fell)
    _check_positive("limit", limit)
    weight = _weights(x.size, event, resampling)
    standing = weight * ~fell
    count = standing.sum(axis=1)
    if count[0] < 3:
        raise FitError(
            f"only {count[0]:g} of {x.size} runs did not collapse; a line of response on "
            "intensity needs 3; add weaker records"
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_x, mean_y = standing @ x / count, standing @ np.where(fell, 0.0, y) / count
        off_x, off_y = x - mean_x[:, None], np.where(fell, 0.0, y) - mean_y[:, None]
        square = (standing * off_x**2).sum(axis=1)
        slope = (standing * off_x * off_y).sum(axis=1) / square
        residual = off_y - slope[:, None] * off_x
        deviation = np.sqrt((standing * residual**2).sum(axis=1) / (count - 2))
    _require_rising(slope[0], deviation[0])
    lines = binomial_lines(x, weight * fell, weight, "logistic")
    notes = []
    if not fell.any():
        notes.append("no run collapsed: the curve is that of the regression alone")
    elif lines.degenerate[0]:
        notes.append(
            "collapses and standing runs do not overlap in intensity: P(collapse) is a step"
            if lines.slope[0] > 0.0
            else "collapses do not rise with intensity: P(collapse) is their fraction throughout"
        )
    draws = np.stack(
        [lines.intercept, lines.slope, mean_y - slope * mean_x, slope, deviation], axis=1
    )
    names = ["collapse_intercept", "collapse_slope"]
    return _with_response("modified", names, draws, limit, fell, notes, resampling)


def cloud_censored(
    im: ArrayLike,
    response: ArrayLike,
    cap: float,
    limit: float,
    resampling: Resampling,
    *,
    event: ArrayLike | None = None,
) -> CloudCurve:
    """Probability that the response exceeds a limit, collapses counted as 'above the cap'.

    Censored (Tobit) regression of ln response on ln im by maximum likelihood (Tobin 1958,
    Econometrica 26): one line and one deviation for all runs, of which those that reach the cap
    or collapse say only that they lie above it. It supposes that the line goes on beyond the
    cap; `cloud_modified` does not.

    Parameters
    ----------
    im : array_like, (n_run,)
        Intensity of each record, any unit, > 0.
    response : array_like, (n_run,)
        Peak response, any unit, > 0; at or above `cap`, inf included, where it was not followed.
    cap : float
        Largest response that means something, > 0.
    limit : float
        Response at which the limit state begins, > 0 and at most `cap`.
    resampling : Resampling
    event : array_like, (n_run,), optional
        Earthquake of each record; records of one event are resampled together.

    Raises
    ------
    InputError
        If an argument cannot be.
    FitError
        If fewer than three runs lie below the cap, or the response does not rise with intensity.
    """
    _check_positive("cap", cap)
    _check_positive("limit", limit)
    if limit > cap:
        raise InputError(f"limit is {limit:g}, above the cap of {cap:g}; it is at most the cap")
    reached = np.asarray(response, dtype=float) >= cap
    x, fell = _checked(im, reached)
    y = np.where(fell, np.log(cap), _log_response(response, ~fell))
    if np.count_nonzero(~fell) < 3:
        raise FitError(
            f"only {np.count_nonzero(~fell)} of {x.size} runs stayed below the cap of {cap:g}; "
            "a censored line needs 3; add weaker records"
        )
    weight = _weights(x.size, event, resampling)
    design = np.stack([np.ones_like(x), x], axis=1)
    side = np.where(fell, ABOVE, OBSERVED)
    coefficients, deviation, _ = censored_lines(design, y, side, weight)
    _require_rising(coefficients[0, 1], deviation[0])
    draws = np.concatenate([coefficients, deviation[:, None]], axis=1)
    return _with_response("censored", [], draws, limit, fell, [], resampling)


def _with_response(
    kind: str,
    names: list[str],
    draws: FloatArray,
    limit: float,
    fell: NDArray[np.bool_],
    notes: list[str],
    resampling: Resampling,
) -> CloudCurve:
    draws = np.concatenate([draws, np.full((len(draws), 1), np.log(limit))], axis=1)
    rises, deviation = draws[:, -3], draws[:, -2]
    lost = ~np.isfinite(draws).all(axis=1) | ~(rises > 0.0) | ~(deviation > 0.0)
    names = [*names, "response_intercept", "response_slope", "response_deviation", "log_limit"]
    return make_curve(kind, names, draws, lost, fell, resampling, tuple(notes))


def _weights(n_run: int, event: ArrayLike | None, resampling: Resampling) -> FloatArray:
    """How often each run counts: once in the first row, then as drawn, (1 + n_draw, n_run)."""
    group = event_groups(event, n_run)
    times = resampling.multiplicities(int(group.max()) + 1)
    return np.concatenate([np.ones((1, n_run)), times[:, group]])


def _checked(im: ArrayLike, collapsed: ArrayLike) -> tuple[FloatArray, NDArray[np.bool_]]:
    values, codes = np.asarray(im, dtype=float), np.asarray(collapsed)
    if values.ndim != 1 or values.shape != codes.shape or values.size == 0:
        raise InputError(f"im has shape {values.shape}, the runs {codes.shape}; (n_run,) each")
    bad = values[~((values > 0.0) & np.isfinite(values))]
    if bad.size:
        raise InputError(f"im holds {bad[0]:g}; intensities are positive finite numbers")
    if not np.isin(codes, (0, 1)).all():
        raise InputError("collapsed holds other values than 0 and 1; leave such runs out before")
    if np.ptp(values) == 0.0:
        raise FitError(
            f"all runs are at one intensity, {values[0]:g}, which gives no curve; add records"
        )
    return np.log(values), codes.astype(bool)


def _log_response(response: ArrayLike, used: NDArray[np.bool_]) -> FloatArray:
    values = np.asarray(response, dtype=float)
    if values.shape != used.shape:
        raise InputError(f"response has shape {values.shape}, the runs {used.shape}")
    bad = values[used & ~((values > 0.0) & np.isfinite(values))]
    if bad.size:
        raise InputError(
            f"response holds {bad[0]:g} for a run that did not collapse; a peak response is a "
            "positive finite number, and a run without motion does not belong to the regression"
        )
    return np.log(np.where(used, values, 1.0))


def _check_positive(name: str, value: float) -> None:
    if not 0.0 < value < np.inf:
        raise InputError(f"{name} is {value:g}; a positive finite number is needed")


def _require_rising(slope: float, deviation: float) -> None:
    if not (slope > 0.0 and deviation > 0.0):
        raise FitError(
            f"the response does not rise with intensity over the cloud (slope {slope:.3g}, "
            f"deviation {deviation:.3g}), so no curve follows; add records or another measure"
        )


def _border(x: FloatArray, fell: NDArray[np.bool_]) -> float:
    return float(np.exp(x[fell].min() + x[~fell].max()))
