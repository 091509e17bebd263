"""Curves updated by damage that was seen after earthquakes.

Draws of theta and beta are weighted by the likelihood of the damage. Several limit states have one
beta (Bodenmann, Baker and Stojadinovic 2024, doi 10.1177/87552930241261486).
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy  # whose parts are loaded when they are used
from scipy.special import softmax

from archfrag.errors import FitError, InputError
from archfrag.files import counted
from archfrag.fragility.curve import Curve, FloatArray, IntArray, Pair
from archfrag.fragility.damage import smoothed
from archfrag.fragility.evidence import evidence
from archfrag.fragility.observed import Damage, Observed, damage_of
from archfrag.fragility.several import crossing_words

_DRAWS = 20_000  # of theta and beta, for each state
_FIRST = 300  # of them, from which the likelihood of all is interpolated
_FALL = 40.0  # of the log-likelihood below its greatest value, at most
_ATTEMPTS = 5
_USED = 500  # draws, chosen by the interpolated likelihood
_STRATA = 20  # of beta
_BLOCK = 500  # draws of neighbouring beta, within which thetas of several states are independent
_FEWEST = 100.0  # effective number of draws
_UNMOVED = 0.98  # effective share of the draws
_LEAST_OWN = 0.05  # dispersion of an arch's own, over beta
_THETA = 1e-9, 1e9  # draws beyond are moved there
_NARROW = 1e-4  # scatter of ln beta that is added, for a beta that is known


def updated(
    curve: Curve, observed: Observed, beta_model: float | None = None, **given
) -> Curve:
    """Return the curve after damage that was seen; see `Curve.update`."""
    own = _own_share(curve, beta_model)
    damage, states = damage_of(curve, observed, **given)
    log_theta, beta = _drawn(states)

    def of_all(log_theta: FloatArray, beta: FloatArray) -> FloatArray:
        return np.sum([evidence(each, log_theta, beta, own) for each in damage], axis=0)

    drawn = beta.size
    kept, weight, number = _weighed(of_all, log_theta, beta)
    log_theta = log_theta[kept]
    beta = beta[kept]
    arches = sum(each.state.size for each in damage)
    _warn(states[-1], damage, number, drawn)
    seen = f"{counted(arches, 'arch')} in {counted(len(damage), 'earthquake')}"
    top = max(curve.im, default=float(curve.quantile(0.99)))
    grid = curve.im or np.linspace(0.0, top, 120).tolist()
    found = []
    for column, state in zip(log_theta.T, states):
        points = np.stack([np.log(beta), column])
        known = smoothed(points, weight, (len(damage), arches))
        found.append(
            replace(
                known.with_band(grid, curve.confidence),
                **{name: getattr(state, name) for name in _KEPT},
                n_independent=number,
                method=f"updated by damage of {seen}; before: {curve.method or 'a curve'}",
                assumptions=f"{curve.assumptions} {_ASSUMED.format(own)}".strip(),
            )
        )
    *lighter, last = found
    if lighter:
        last = replace(last, states=(*found,), crossings=crossing_words(found))
    return last


_KEPT = "name", "state", "meaning", "measure", "unit", "si", "levels"
_ASSUMED = (
    "Damage updated it: {:.0%} of the variance of ln capacity is an arch's own; the rest, and "
    "what is not known of the shaking, is shared within an earthquake."
)


def _own_share(curve: Curve, beta_model: float | None) -> float:
    """Return the fraction of beta^2 that is an arch's own."""
    if not curve.fitted:
        raise FitError(f"there is no curve to update: {curve.reason}")
    parts = curve.dispersion or {}
    if beta_model is None:
        if "beta_model" not in parts:
            raise InputError(
                "beta_model must be given: the part of beta that differs from arch to arch, "
                f"from 0 to beta, which is {curve.beta:.3g}; the rest is from record to record, "
                "which arches of one earthquake share (a class of several arches knows it)"
            )
        square = np.square([parts["beta_model"], parts["beta_record_to_record"]])
        return float(max(square[0] / square.sum(), _LEAST_OWN**2))
    if not 0.0 <= beta_model <= 1.001 * curve.beta:
        raise InputError(
            f"beta_model is {beta_model:g}; it lies between 0 and beta, {curve.beta:.3g}"
        )
    return float(np.clip(beta_model / curve.beta, _LEAST_OWN, 1.0) ** 2)


def _drawn(states: Sequence[Curve]) -> Pair:
    """Draw ln theta of limit states, (n, n_state), and beta, (n,), that of the severest."""
    generator = np.random.default_rng(0)
    number = _DRAWS * len(states)
    columns = list[FloatArray]()
    for curve in states:
        theta, beta = curve.draws(len(columns), number)
        order = np.argsort(beta)
        if states[1:]:
            order = np.lexsort([generator.random(number), np.argsort(order) // _BLOCK])
        theta = theta[order]
        beta = beta[order] * np.exp(_NARROW * generator.standard_normal(number))
        columns.append(np.log(np.clip(theta, *_THETA)))
    log_theta = np.stack(columns, axis=1)
    kept = (np.diff(log_theta, axis=1) > 0.0).all(axis=1)
    if kept.sum() < _FEWEST:
        raise FitError(
            "the medians of the limit states are in the wrong order; they must rise"
        )
    log_theta = log_theta[kept]
    beta = beta[kept]
    # So ordered, every m-th draw is a stratified sample.
    rank = np.argsort(np.argsort(beta)) * _STRATA // beta.size
    order = np.lexsort([log_theta[:, -1], rank])
    return log_theta[order], beta[order]


def _weighed(
    function: Callable[[FloatArray, FloatArray], FloatArray],
    log_theta: FloatArray,
    beta: FloatArray,
) -> tuple[IntArray, FloatArray, float]:
    """Return draws of the curve by their likelihood, their weights, and their effective number.

    The log-likelihood is found at some of all draws and interpolated. By this some draws are
    chosen, and their weights make up for its error; if that is large, they improve it.
    """
    points = np.column_stack([np.log(beta), log_theta])
    points /= np.ptp(np.quantile(points, [0.25, 0.75], axis=0), axis=0)
    exact = np.full(beta.size, np.nan)
    tried = np.arange(0, beta.size, max(1, beta.size // _FIRST))
    exact[tried] = function(log_theta[tried], beta[tried])
    part = (np.arange(_USED) + 0.5) / _USED
    for _ in range(_ATTEMPTS):
        known = np.flatnonzero(~np.isnan(exact))
        logs = np.maximum(exact[known], exact[known].max() - _FALL)
        near = scipy.interpolate.RBFInterpolator(points[known], logs)(points)
        chance = softmax(near)
        kept = np.searchsorted(np.cumsum(chance), part)
        kept = np.minimum(kept, beta.size - 1)
        tried = np.setdiff1d(kept, known)
        if tried.size:
            exact[tried] = function(log_theta[tried], beta[tried])
        weight = softmax(exact[kept] - near[kept])
        if weight @ weight < 2.0 / _USED:
            break
    return kept, weight, float(1.0 / (chance @ chance))


def _warn(curve: Curve, damage: Sequence[Damage], number: float, drawn: int) -> None:
    """Warn if damage and curve contradict, if damage says nothing, or is beyond the levels."""
    most = max(np.exp(each.centre.max()) for each in damage)
    top = max(curve.levels, default=np.inf)
    found = {
        f"only {number:.0f} of {drawn} draws of the curve agree with the damage: it was very "
        "wide, or the damage contradicts it; check intensities and states": number
        < _FEWEST,
        "the damage tells hardly anything of the median and the dispersion, which are those of "
        "before": number > _UNMOVED * drawn,
        f"arches were shaken by up to {most:.3g} {curve.unit}, and the highest level of the study "
        f"is {top:.3g}: the curve is extrapolated there": most > top,
    }
    for words, true in found.items():
        if true:
            warnings.warn(words, stacklevel=5)
