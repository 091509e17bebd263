"""Cloud analysis: curves from records at their own amplitude, with collapses as what they are.

Runs of a cloud are at as many intensities as there are records. The response of those that stood
is regressed on the intensity in logarithms; a run that collapsed has no response to regress, and
leaving it out would bias the line. Two remedies: the verdicts alone (`cloud_binary`), and response
and verdict together by total probability (`cloud_modified`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit, ndtr

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import BoolArray, FloatArray, log_intensity, positive, shaped
from archfrag.fragility.grid import root
from archfrag.fragility.lines import binomial_lines
from archfrag.fragility.runs import Resampling

_QUANTILES = ndtr([-1.0, 0.0, 1.0])
_BISECTIONS = 60


@dataclass(frozen=True)
class CloudCurve:
    """A fragility curve from a cloud, with intervals from the bootstrap of records.

    `theta` and `beta` are the equivalents of a lognormal curve: the 50 % point, and
    ln(84 % point / 16 % point) / 2.
    """

    #: Of P(collapse) = expit(a + b ln im); where there is a response also intercept, slope and
    #: deviation of its line and ln of the limit.
    parameters: FloatArray
    theta: float
    beta: float
    theta_interval: tuple[float, float]  #: quantiles over the resamples
    beta_interval: tuple[float, float]
    notes: tuple[str, ...]  #: what a reader must know of this fit

    def probability(self, im: ArrayLike) -> FloatArray:
        """Probability at intensities >= 0, (n,)."""
        return _curves(self.parameters[None], log_intensity(im))[0]


def cloud_binary(
    im: ArrayLike, collapsed: ArrayLike, resampling: Resampling, *, event: ArrayLike | None = None
) -> CloudCurve:
    """Logistic regression of collapse on ln im.

    Parameters
    ----------
    im : array_like, (n_run,)
        Intensity of each record, any unit, > 0.
    collapsed : array_like of bool, (n_run,)
        Runs without a verdict must be left out before.
    resampling : Resampling
    event : array_like, (n_run,), optional
        Earthquake of each record; records of one event are resampled together.

    Raises
    ------
    InputError, FitError
        If an argument cannot be; if the likelihood has no maximum with a curve that rises.

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
        many, side, what = "no", "above", "stronger"
        if fell.all():
            many, side, what = "every", "below", "weaker"
        raise FitError(
            f"{many} run of the cloud collapsed between {{}} and {{}}, so theta lies {side} "
            f"them; add {what} records",
            *np.exp([x.min(), x.max()]),
        )
    # Each run once, then as drawn.
    weight = np.vstack([np.ones(x.size), resampling.draws(event, x.size)])
    lines = binomial_lines(x, weight * fell, weight, "logistic")
    if lines.degenerate[0]:
        near = np.exp(0.5 * (x[fell].min() + x[~fell].max()))
        raise FitError(
            "the runs of the cloud that collapsed and those that stood do not overlap in "
            "intensity (perfect separation) near {}, so beta tends to 0; add records there"
            if lines.slope[0] > 0.0
            else "the fraction of collapses does not rise with intensity over the cloud; add "
            "records", near,
        )  # fmt: skip
    return _curve(np.stack(lines[:2], axis=1), lines.degenerate, resampling)


def cloud_modified(
    im: ArrayLike, response: ArrayLike, collapsed: ArrayLike, limit: float,
    resampling: Resampling, *, event: ArrayLike | None = None,
) -> CloudCurve:  # fmt: skip
    """Probability that the response exceeds a limit, from response and collapse together.

    P(exceeded | im) = P(response > limit | im, no collapse) (1 - P(collapse | im))
    + P(collapse | im): five parameters, of the line of ln response on ln im over the runs that
    did not collapse (its deviation with n - 2) and of the logistic line of collapse (Jalayer,
    Ebrahimian, Miano, Manfredi and Sezen 2017, EESD 46(15), 2639-2663). The intervals are from
    the bootstrap of records instead of their Bayesian sampling.

    Parameters
    ----------
    im, collapsed, resampling, event
        As of `cloud_binary`.
    response : array_like, (n_run,)
        Peak response, any unit, > 0; any value where the run collapsed.
    limit : float
        Response at which the limit state begins, > 0.

    Raises
    ------
    InputError
        If an argument cannot be.
    FitError
        If fewer than three runs stood, or the response does not rise with intensity.

    Examples
    --------
    >>> from archfrag.fragility.cloud import cloud_modified
    >>> from archfrag.fragility.runs import Resampling
    >>> im, response = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0.01, 0.02, 0.04, 0.04, 0.06, 0.0]
    >>> curve = cloud_modified(im, response, [0, 0, 0, 0, 0, 1], 0.03, Resampling(seed=1))
    >>> round(curve.theta, 3)
    0.272
    """
    x, fell = _checked(im, collapsed)
    given = shaped(response, fell.shape, "response")
    positive(limit, "limit")
    y = np.log(positive(np.where(fell, 1.0, given), "response of runs that did not collapse"))
    # Each run once, then as drawn.
    weight = np.vstack([np.ones(x.size), resampling.draws(event, x.size)])
    standing = weight * ~fell
    count = standing.sum(axis=1)
    if count[0] < 3:
        raise FitError(
            f"only {count[0]:g} of {x.size} runs did not collapse; a line of response on "
            "intensity needs 3; add weaker records"
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_x, mean_y = standing @ x / count, standing @ y / count
        off_x, off_y = x - mean_x[:, None], y - mean_y[:, None]
        slope = (standing * off_x * off_y).sum(axis=1) / (standing * off_x**2).sum(axis=1)
        residual = off_y - slope[:, None] * off_x
        deviation = np.sqrt((standing * residual**2).sum(axis=1) / (count - 2))
    if not (slope[0] > 0.0 and deviation[0] > 0.0):
        raise FitError(
            f"the response does not rise with intensity over the cloud (slope {slope[0]:.3g}, "
            f"deviation {deviation[0]:.3g}), so no curve follows; add records or another measure"
        )
    lines = binomial_lines(x, weight * fell, weight, "logistic")
    columns = [lines.intercept, lines.slope, mean_y - slope * mean_x, slope, deviation]
    draws = np.stack([*columns, np.full_like(slope, np.log(limit))], axis=1)
    lost = ~np.isfinite(draws).all(axis=1) | ~(slope > 0.0) | ~(deviation > 0.0)
    note = "collapses do not rise with intensity: P(collapse) is their fraction throughout"
    if not fell.any():
        note = "no run collapsed: the curve is that of the regression alone"
    elif lines.slope[0] > 0.0:
        note = "collapses and standing runs do not overlap in intensity: P(collapse) is a step"
    return _curve(draws, lost, resampling, (note,) if lines.degenerate[0] else ())


def _checked(im: ArrayLike, collapsed: ArrayLike) -> tuple[FloatArray, BoolArray]:
    values = positive(im, "im")
    codes = shaped(collapsed, (values.size,), "collapsed")
    if not np.isin(codes, (0, 1)).all():
        raise InputError("collapsed holds other values than 0 and 1; leave such runs out before")
    if not values.size:
        raise FitError("no run of the cloud collapsed or stood, so there is nothing to fit")
    if np.ptp(values) == 0.0:
        raise FitError(
            "all runs are at one intensity, {}, which gives no curve; add records", values[0]
        )
    return np.log(values), codes.astype(bool)


def _curve(
    draws: FloatArray, lost: BoolArray, resampling: Resampling, notes: tuple[str, ...] = ()
) -> CloudCurve:
    """The first row of `draws` is the estimate, the others are resamples, some of them lost."""
    kept = draws[1:][~lost[1:]]
    if not len(kept):
        raise FitError("no resample of the cloud determines a curve; add records")
    points = _points(np.concatenate([draws[:1], kept]))
    with np.errstate(invalid="ignore"):
        betas = 0.5 * (points[:, 2] - points[:, 0])
    drawn = np.stack([points[1:, 1], np.nan_to_num(betas[1:], nan=np.inf)])
    theta, beta = np.quantile(drawn, resampling.tails, axis=1, method="inverted_cdf").T
    ends = (float(np.exp(theta[0])), float(np.exp(theta[1]))), (float(beta[0]), float(beta[1]))
    return CloudCurve(draws[0], float(np.exp(points[0, 1])), float(betas[0]), *ends, notes)


def _curves(parameters: FloatArray, x: FloatArray) -> FloatArray:
    """Curve of each row of parameters at ln im `x`, (1 or n_draw, n_point)."""
    first, rise, *response = parameters.T[..., None]
    with np.errstate(invalid="ignore"):
        fell = expit(first + rise * x)
        if response:
            intercept, slope, deviation, log_limit = response
            exceeded = ndtr((intercept + slope * x - log_limit) / deviation)
            fell = exceeded + (1.0 - exceeded) * fell
    return np.where(np.isneginf(x), 0.0, fell)


def _points(draws: FloatArray) -> FloatArray:
    """ln im at 16, 50 and 84 % of each curve, (n_draw, 3); infinite where never reached."""
    low = np.full((len(draws), 3), -50.0)
    high = low + 100.0
    below = _curves(draws, low) >= _QUANTILES
    above = _curves(draws, high) < _QUANTILES
    found = root(lambda x: _curves(draws, x) - _QUANTILES, low, high, _BISECTIONS)
    return np.where(below, -np.inf, np.where(above, np.inf, found))
