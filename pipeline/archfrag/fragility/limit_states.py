"""Curves of several limit states from the same runs, ordered at every intensity."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from archfrag.errors import FitError
from archfrag.fragility.curve import FloatArray, Fragility, IntArray, positive
from archfrag.fragility.fit import fit_stripes
from archfrag.fragility.posterior import fit_posterior
from archfrag.fragility.probit import interval_terms, least

_FLAT = 1e-6
MOST_CROSSING = 0.01  # probability by which curves of two limit states may cross
# A curve or none, and why there is no likeliest one.
State = tuple[Fragility | None, FitError | None]


def fit_limit_states(
    exceeded: ArrayLike, im: ArrayLike, names: Sequence[str]
) -> tuple[list[State], str]:
    """Fit a lognormal curve to each of several limit states, from the least severe to the most.

    A state counts as exceeded where it or a more severe one is; runs count as independent. If
    curves that are fitted one by one cross within the range of the levels, an ordered probit model
    with one beta and a theta each (McCullagh 1980, J. R. Stat. Soc. B 42) is fitted to all states
    at once. A state whose exceedances are separated in intensity from its other runs is given the
    medians of `fit_posterior`.

    `exceeded`, (n_record, n_level, n_state), holds 1 exceeded, 0 not, any other number not
    decided; `im`, (n_level,) or (n_record, n_level), intensities > 0. Returns the curve of each
    state, and why it has no likeliest one; and how the curves were ordered.
    """
    codes, intensity = np.asarray(exceeded), positive(im, "im")
    intensity, n_state = np.broadcast_to(intensity, codes.shape[:2]), codes.shape[2]
    flat = nest_exceedance(codes).reshape(-1, n_state)
    levels, column = np.unique(intensity.ravel(), return_inverse=True)
    states = [_single(levels, column, *each) for each in zip(flat.T, names)]
    known = [(i, fit) for i, (fit, _) in enumerate(states) if fit is not None]
    z = [np.log(levels[[0, -1]] / fit.theta) / fit.beta for _, fit in known]
    crossing = [
        f"{names[i]} and {names[j]}"
        for ((i, _), milder), ((j, _), worse) in pairwise(zip(known, z))
        if np.any(worse > milder + 1e-9)
    ]
    if not crossing:
        return states, "The curves of all limit states are ordered at the levels that were run."
    place, alone = zip(*known)
    fits = _ordered(np.log(intensity.ravel()), flat[:, place], alone)
    for i, fit in zip(place, fits):
        states[i] = fit, None if fit.kind == "ordered" else states[i][1]
    return states, (
        f"Fitted one by one, the curves of {crossing[0]} cross within the levels that were "
        f"run; all have one beta of {fits[0].beta:.3g} instead."
    )


def nest_exceedance(codes: IntArray) -> IntArray:
    """Exceedance (..., n_state), 1 or 0, of each state if a more severe one is exceeded; a state
    that is not decided is 0 where a less severe one is not exceeded, or else -1.
    """
    yes = np.flip(np.logical_or.accumulate(np.flip(codes == 1, axis=-1), axis=-1), axis=-1)
    no = np.logical_or.accumulate((codes == 0) & ~yes, axis=-1)
    return np.where(yes, 1, np.where(no, 0, -1)).astype(np.int64)


def _single(levels: FloatArray, column: IntArray, codes: IntArray, name: str) -> State:
    n = np.bincount(column, codes >= 0, levels.size)
    collapses = np.bincount(column, codes == 1, levels.size)
    try:
        return fit_stripes(levels, collapses, n), None
    except FitError as error:
        why, at = f"(to collapse means to exceed it): {error.message}", error.levels
    collapsed_at, survived_at = levels[collapses > 0], levels[collapses < n]
    known = collapsed_at.size and survived_at.size and np.count_nonzero(n) > 1
    start = f"limit state {name!r} has no"
    if not known or collapsed_at.min() < survived_at.max():
        return None, FitError(f"{start} curve {why}", *at)
    text = f"{start} likeliest curve {why}; its curve is the median of the posterior"
    return fit_posterior(levels, collapses, n).fragility, FitError(text, *at)


def _ordered(x: FloatArray, nested: IntArray, alone: Sequence[Fragility]) -> list[Fragility]:
    """Curves with one beta and ordered thetas, of states whose curves `alone` would cross."""
    # States are fitted as one if no run exceeds the milder and spares the more severe one.
    group, columns = [0], [nested[:, 0]]
    for codes in nested.T[1:]:
        if np.any((columns[-1] == 1) & (codes == 0)):
            columns.append(codes)
        else:
            columns[-1] = np.where(columns[-1] < 0, codes, columns[-1])
        group.append(len(columns) - 1)
    fits = None
    # A state with a maximum of its own gives the joint likelihood one.
    if any(fit.kind == "stripes" for fit in alone):
        fits = _ordered_probit(x, np.stack(columns, axis=1))
    if fits is None:
        beta = float(np.sqrt(np.mean([fit.beta**2 for fit in alone])))
        theta = np.maximum.accumulate([fit.theta for fit in alone])
        return [replace(f, theta=float(t), beta=beta) for f, t in zip(alone, theta, strict=True)]
    totals = np.count_nonzero(nested >= 0, axis=0).tolist()
    return [replace(fits[place], n_total=n) for place, n in zip(group, totals)]


def _ordered_probit(x: FloatArray, nested: IntArray) -> list[Fragility] | None:
    """Likeliest curves with one slope and an intercept each; None without a maximum."""
    n_state = nested.shape[1]
    decided = (nested >= 0).any(axis=1)
    x, nested = x[decided], nested[decided]
    kinds = np.stack([(nested == 1).sum(axis=1), n_state - (nested == 0).sum(axis=1)], axis=1)
    cells, count = np.unique(np.column_stack([x, kinds]), axis=0, return_counts=True)
    centre, width = x.mean(), x.std()
    u, (reached, spared) = (cells[:, 0] - centre) / width, cells[:, 1:].astype(int).T
    # Rows of bounds in (intercepts, slope): a run lies between the thresholds of the states that
    # it reached and was spared from, without one where no state, or each, is reached.
    states = np.vstack([np.eye(n_state), np.full(n_state, np.nan)])
    low, high = (np.column_stack([states[place], u]) for place in (spared, reached - 1))
    fractions = np.clip((nested == 1).mean(axis=0), 0.01, 0.99)
    start = np.append(ndtri(np.maximum.accumulate(fractions[::-1])[::-1]), 1.0)
    start[:-1] -= 1e-3 * np.arange(n_state)
    given = low[None], high[None], count[None].astype(float)
    found, (losses, _, hessians) = least(lambda p, _: interval_terms(p, *given), start[None])
    p, loss, slope = found[0], float(losses[0]), float(found[0, -1])
    if not (slope > _FLAT and np.isfinite(loss)):
        return None
    inverse, n_levels, fits = np.linalg.inv(hessians[0]), int(np.unique(x).size), []
    for i, n in enumerate(np.count_nonzero(nested >= 0, axis=0).tolist()):
        # ln theta = centre - width a / slope, beta = width / slope.
        jacobian = np.zeros((2, n_state + 1))
        jacobian[0, i] = -width / slope
        jacobian[:, -1] = width * p[i] / slope**2, -width / slope**2
        theta, beta = float(np.exp(centre - width * p[i] / slope)), float(width / slope)
        covariance = jacobian @ inverse @ jacobian.T
        fits.append(Fragility(theta, beta, covariance, -loss, n_levels, n, "ordered"))
    return fits


def above(mild: Fragility, severe: Fragility) -> Fragility:
    """The curve of a milder state, nowhere more than `MOST_CROSSING` below that of a severer one.

    Fits of two states can cross, by chance and because that of collapse is another estimate. If
    they do, the median is at most that of the severer state, and the dispersion is the nearest, on
    the way to that of the severer state, at which they do not.
    """
    if crossing(mild, severe) <= MOST_CROSSING:
        return mild
    theta = min(mild.theta, severe.theta)
    for beta in np.linspace(mild.beta, severe.beta, 101):
        found = replace(mild, theta=theta, beta=float(beta), kind="adjusted")
        if crossing(found, severe) <= MOST_CROSSING:
            return found
    return severe  # a mean of curves, which no lognormal one of this dispersion comes close to


def crossing(mild: Fragility, severe: Fragility) -> float:
    """Largest probability by which the curve of the severer state lies above that of the milder:
    other programs would take a negative one from between them.
    """
    ends = [fit.theta * np.exp(s * 4.0 * fit.beta) for fit in (mild, severe) for s in (-1, 1)]
    im = np.geomspace(min(ends), max(ends), 400)
    return float((severe.probability(im) - mild.probability(im)).max())
