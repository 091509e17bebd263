"""Curves of several limit states from the same runs, ordered at every intensity."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import FloatArray, Fragility, IntArray, positive, shaped
from archfrag.fragility.fit import fit_stripes
from archfrag.fragility.lines import LOG_ROOT_TWO_PI, Terms, least, log_between
from archfrag.fragility.posterior import fit_posterior

_FAR = 40.0
_FLAT = 1e-6


@dataclass(frozen=True)
class LimitState:
    """One limit state and its curve."""

    name: str
    #: Kind "stripes" if fitted by itself, "ordered" if together with the others, "posterior" if
    #: the state has no likeliest curve.
    fit: Fragility | None
    none: FitError | None = None  #: why there is no likeliest curve


@dataclass(frozen=True)
class LimitStates:
    """Curves of limit states, from the least to the most severe."""

    states: tuple[LimitState, ...]
    common_beta: bool  #: whether the curves have one beta, because they would have crossed
    message: str


def fit_limit_states(exceeded: ArrayLike, im: ArrayLike, names: Sequence[str]) -> LimitStates:
    """Fit a lognormal curve to each of several ordered limit states.

    A state counts as exceeded where it or a more severe one is, so the fractions are ordered by
    construction. Curves fitted one by one cross somewhere unless their betas are equal; if two
    cross within the range of the levels, the curves with a fit of their own are replaced by an
    ordered probit model with one beta and a theta each (McCullagh 1980, J. R. Stat. Soc. B 42),
    fitted to all states at once, in which they cannot cross; states that no run separates have
    one theta in it. Runs count as independent, as in `fit_stripes`.

    A state whose exceedances are separated in intensity from its other runs has no likeliest
    curve; it is given the medians of `fit_posterior`. One that all runs exceed, or none, has no
    curve.

    Parameters
    ----------
    exceeded : array_like of int, (n_record, n_level, n_state)
        1 exceeded, 0 not, any other number not decided; states from the least severe to the most.
    im : array_like, (n_level,) or (n_record, n_level)
        Intensity of each run, any unit, > 0.
    names : sequence of str, (n_state,)

    Raises
    ------
    InputError
        If shapes or values cannot be.

    Examples
    --------
    >>> from archfrag.fragility.limit_states import fit_limit_states
    >>> rocks = [[0, 1, 1, 1], [0, 0, 1, 1], [1, 0, 1, 1]]
    >>> falls = [[0, 0, 1, 1], [0, 0, 0, 1], [1, 0, 0, 1]]
    >>> exceeded = [[list(cell) for cell in zip(*rows)] for rows in zip(rocks, falls)]
    >>> found = fit_limit_states(exceeded, [0.1, 0.2, 0.3, 0.4], ["motion", "collapse"])
    >>> [state.fit.theta < 0.3 for state in found.states]
    [True, True]
    """
    codes, intensity = _checked(exceeded, im)
    n_state = codes.shape[2]
    labels = shaped(list(names), (n_state,), "names").tolist()
    flat = nest_exceedance(codes).reshape(-1, n_state)
    levels, column = np.unique(intensity.ravel(), return_inverse=True)
    states = [_single(levels, column, *each) for each in zip(flat.T, labels)]
    known = {i: fit for i, state in enumerate(states) if (fit := state.fit) is not None}
    crossing = _crossing(states, levels)
    message = "The curves of all limit states are ordered at the levels that were run."
    if crossing:
        fits = _ordered(np.log(intensity.ravel()), flat[:, list(known)], list(known.values()))
        for i, fit in zip(known, fits, strict=True):
            none = None if fit.kind == "ordered" else states[i].none
            states[i] = replace(states[i], fit=fit, none=none)
        message = (
            f"Fitted one by one, the curves of {crossing} cross within the levels that were "
            f"run; all have one beta of {fits[0].beta:.3g} instead."
        )
    return LimitStates(tuple(states), bool(crossing), message)


def nest_exceedance(codes: IntArray) -> IntArray:
    """Exceedance (..., n_state) in which each state is exceeded if a more severe one is.

    1, 0, and -1 for not decided; a state that is not decided is 0 where a less severe one is not
    exceeded.
    """
    yes = np.flip(np.logical_or.accumulate(np.flip(codes == 1, axis=-1), axis=-1), axis=-1)
    no = np.logical_or.accumulate((codes == 0) & ~yes, axis=-1)
    return np.where(yes, 1, np.where(no, 0, -1)).astype(np.int64)


def _single(levels: FloatArray, column: IntArray, codes: IntArray, name: str) -> LimitState:
    n = np.bincount(column, codes >= 0, levels.size)
    collapses = np.bincount(column, codes == 1, levels.size)
    try:
        return LimitState(name, fit_stripes(levels, collapses, n))
    except FitError as error:
        why, at = f"(to collapse means to exceed it): {error.message}", error.levels
    fell, stood = levels[collapses > 0], levels[collapses < n]
    known = fell.size and stood.size and np.count_nonzero(n) > 1
    start = f"limit state {name!r} has no"
    if not known or fell.min() < stood.max():
        return LimitState(name, None, FitError(f"{start} curve {why}", *at))
    fit = fit_posterior(levels, collapses, n).fragility
    text = f"{start} likeliest curve {why}; its curve is the median of the posterior"
    return LimitState(name, fit, FitError(text, *at))


def _crossing(states: list[LimitState], levels: FloatArray) -> str:
    """Names of a pair of neighbours that cross within the levels, or nothing."""
    ends = levels[[0, -1]]
    known = [(s.name, s.fit) for s in states if s.fit is not None]
    z = [(name, np.log(ends / fit.theta) / fit.beta) for name, fit in known]
    for (milder, upper), (worse, lower) in pairwise(z):
        if np.any(lower > upper + 1e-9):
            return f"{milder} and {worse}"
    return ""


def _ordered(x: FloatArray, nested: IntArray, alone: Sequence[Fragility]) -> list[Fragility]:
    """Curves with one beta and ordered thetas, of states whose curves `alone` would cross."""
    group, merged = _separated(nested)
    fits = None
    # A state with a maximum of its own gives the joint likelihood one.
    if any(fit.kind == "stripes" for fit in alone):
        fits = _ordered_probit(x, merged)
    if fits is None:
        beta = float(np.sqrt(np.mean([fit.beta**2 for fit in alone])))
        theta = np.maximum.accumulate([fit.theta for fit in alone])
        return [replace(f, theta=float(t), beta=beta) for f, t in zip(alone, theta, strict=True)]
    return [
        replace(fits[place], n_total=int(np.count_nonzero(nested[:, i] >= 0)))
        for i, place in enumerate(group)
    ]


def _separated(nested: IntArray) -> tuple[list[int], IntArray]:
    """Group of each state, and the codes of the groups, (n_run, n_group).

    States belong to one group if no run exceeds the milder and spares the more severe one: the
    likelihood of different thetas has no maximum then.
    """
    group, columns = [0], [nested[:, 0]]
    for codes in nested.T[1:]:
        if np.any((columns[-1] == 1) & (codes == 0)):
            columns.append(codes)
        else:
            columns[-1] = np.where(columns[-1] < 0, codes, columns[-1])
        group.append(len(columns) - 1)
    return group, np.stack(columns, axis=1)


def _ordered_probit(x: FloatArray, nested: IntArray) -> list[Fragility] | None:
    """Ordered probit with one slope, P(state i exceeded) = Phi(a_i + b x); None if it falls."""
    n_state = nested.shape[1]
    used = (nested >= 0).any(axis=1)
    x, nested = x[used], nested[used]
    centre, width = x.mean(), x.std()
    reached = (nested == 1).sum(axis=1)
    spared = n_state - (nested == 0).sum(axis=1)
    cells, count = np.unique(np.stack([x, reached, spared]), axis=1, return_counts=True)
    u = (cells[0] - centre) / width
    reached, spared = cells[1].astype(np.int64), cells[2].astype(np.int64)
    fractions = np.clip((nested == 1).mean(axis=0), 0.01, 0.99)
    start = np.append(ndtri(np.maximum.accumulate(fractions[::-1])[::-1]), 1.0)
    start[:-1] -= 1e-3 * np.arange(n_state)

    def terms(p: FloatArray, _: IntArray) -> Terms:
        loss, *derivatives = _derivatives(p[0], u, reached, spared, count)
        return np.array([loss]), derivatives[0][None], derivatives[1][None]

    found, (losses, _, hessians) = least(terms, start[None])
    p, loss, hessian = found[0], float(losses[0]), hessians[0]
    slope = p[-1]
    if not (slope > _FLAT and np.isfinite(loss)):
        return None
    inverse = np.linalg.inv(hessian)
    fits = []
    for a, codes, unit in zip(p, nested.T, np.eye(n_state + 1)):
        # ln theta = centre - width a / slope, beta = width / slope.
        jacobian = np.outer([-width / slope, 0.0], unit)
        jacobian[:, -1] = width * a / slope**2, -width / slope**2
        theta, beta = float(np.exp(centre - width * a / slope)), float(width / slope)
        covariance = jacobian @ inverse @ jacobian.T
        sizes = int(np.unique(x).size), int(np.count_nonzero(codes >= 0))
        fits.append(Fragility(theta, beta, covariance, -loss, *sizes, "ordered"))
    return fits


def _derivatives(
    p: FloatArray, u: FloatArray, reached: IntArray, spared: IntArray, count: IntArray
) -> tuple[float, FloatArray, FloatArray]:
    """Loss, gradient and Hessian of -sum count ln(Phi(upper) - Phi(lower)), which is convex
    (Pratt 1981, J. Am. Stat. Assoc. 76).

    A run that reached `reached` states and is known to be spared from state `spared` on lies
    between the two thresholds; where one of them is none, Phi is 1 or 0.
    """
    n_state = p.size - 1
    a = np.concatenate([[_FAR], p[:-1], [-_FAR]])
    top, bottom = reached == 0, spared == n_state
    upper = a[reached] + np.where(top, 0.0, p[-1] * u)
    lower = a[spared + 1] + np.where(bottom, 0.0, p[-1] * u)
    if np.any(upper <= lower):
        return np.inf, np.zeros_like(p), np.eye(p.size)
    log_p = log_between(lower, upper)
    f = np.where(top, 0.0, np.exp(-0.5 * upper**2 - LOG_ROOT_TWO_PI - log_p))
    g = np.where(bottom, 0.0, np.exp(-0.5 * lower**2 - LOG_ROOT_TWO_PI - log_p))
    by_upper, by_lower = np.zeros((u.size, p.size)), np.zeros((u.size, p.size))
    rows = np.arange(u.size)
    by_upper[rows[~top], reached[~top] - 1] = 1.0
    by_lower[rows[~bottom], spared[~bottom]] = 1.0
    by_upper[:, -1], by_lower[:, -1] = np.where(top, 0.0, u), np.where(bottom, 0.0, u)
    first = f[:, None] * by_upper - g[:, None] * by_lower
    hessian = (first * count[:, None]).T @ first
    hessian += (by_upper * (count * f * upper)[:, None]).T @ by_upper
    hessian -= (by_lower * (count * g * lower)[:, None]).T @ by_lower
    return float(-count @ log_p), -(count @ first), hessian


def _checked(exceeded: ArrayLike, im: ArrayLike) -> tuple[IntArray, FloatArray]:
    codes, intensity = np.asarray(exceeded), positive(im, "im")
    if codes.ndim != 3 or codes.size == 0:
        raise InputError(f"exceeded has shape {codes.shape}; (n_record, n_level, n_state)")
    shape = codes.shape[:2]
    return codes, np.broadcast_to(shaped(intensity, shape[2 - intensity.ndim :], "im"), shape)
