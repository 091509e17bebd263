"""Curves of several limit states from the same runs, ordered at every intensity."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtri

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import FloatArray, Fragility
from archfrag.fragility.fit import fit_stripes

IntArray = NDArray[np.int64]

_ROUNDS = 100
_FAR = 40.0


@dataclass(frozen=True)
class LimitState:
    """One limit state and its curve.

    Attributes
    ----------
    name, meaning : str
        As given.
    fit : Fragility or None
        Kind ``"stripes"`` if fitted by itself, ``"ordered"`` if together with the others.
    none : str
        Why there is no curve; empty where there is.
    """

    name: str
    meaning: str
    fit: Fragility | None
    none: str = ""


@dataclass(frozen=True)
class LimitStates:
    """Curves of limit states, from the least to the most severe.

    Attributes
    ----------
    states : tuple of LimitState
    common_beta : bool
        Whether the curves were fitted together with one beta, because they would have crossed.
    n_contradictions : int
        Cells in which a state was given as not exceeded though a more severe one was.
    message : str
    """

    states: tuple[LimitState, ...]
    common_beta: bool
    n_contradictions: int
    message: str


def fit_limit_states(
    exceeded: ArrayLike, im: ArrayLike, names: Sequence[str], meanings: Sequence[str] = ()
) -> LimitStates:
    """Fit a lognormal curve to each of several ordered limit states.

    A state counts as exceeded where it or a more severe one is, so the fractions are ordered by
    construction. Curves fitted one by one cross somewhere unless their betas are equal; if two
    cross within the range of the levels, the curves with a fit of their own are replaced by an
    ordered probit model with one beta and a theta each (McCullagh 1980, J. R. Stat. Soc. B 42),
    fitted to all states at once, in which they cannot cross; states between which no run lies
    then have one curve. Runs count as independent, as in
    `fit_stripes`.

    Parameters
    ----------
    exceeded : array_like of int, (n_record, n_level, n_state)
        1 exceeded, 0 not, any other number not decided; states from the least severe to the most.
    im : array_like, (n_level,) or (n_record, n_level)
        Intensity of each run, any unit, > 0.
    names, meanings : sequence of str, (n_state,)
        Of the states.

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
    >>> found.n_contradictions
    0
    >>> [state.fit.theta < 0.3 for state in found.states]
    [True, True]
    """
    codes, intensity, labels, texts = _checked(exceeded, im, names, meanings)
    nested, contradictions = nest_exceedance(codes)
    flat = nested.reshape(-1, nested.shape[-1])
    levels, column = np.unique(intensity.ravel(), return_inverse=True)
    states = [_single(levels, column, flat[:, i], labels[i], texts[i]) for i in range(len(labels))]
    fitted = [i for i, state in enumerate(states) if state.fit is not None]
    crossing = _crossing(states, fitted, levels)
    message = "The curves of all limit states are ordered at the levels that were run."
    if crossing:
        distinct, place = _merge_alike(flat[:, fitted])
        message = f"Fitted one by one, the curves of {crossing} cross within the levels that were "
        try:
            merged = _ordered(np.log(intensity.ravel()), distinct)
        except np.linalg.LinAlgError:
            message += "run, and the runs determine no fit of all together."
            return LimitStates(tuple(states), False, contradictions, message)
        for i, number in zip(fitted, place, strict=True):
            states[i] = LimitState(labels[i], texts[i], merged[number])
        message += f"run; all are fitted together with one beta of {merged[0].beta:.3g} instead."
    return LimitStates(tuple(states), bool(crossing), contradictions, message)


def nest_exceedance(exceeded: ArrayLike) -> tuple[IntArray, int]:
    """Exceedance in which each state is exceeded if a more severe one is.

    Parameters
    ----------
    exceeded : array_like of int, (..., n_state)
        1 exceeded, 0 not, any other number not decided; from the least severe to the most.

    Returns
    -------
    (ndarray of int, int)
        The same with 1, 0, and -1 for not decided; a state that is not decided is 0 where a less
        severe one is not exceeded. And the number of states that were given as not exceeded
        though a more severe one was.
    """
    codes = np.asarray(exceeded)
    yes = np.flip(np.logical_or.accumulate(np.flip(codes == 1, axis=-1), axis=-1), axis=-1)
    no = np.logical_or.accumulate((codes == 0) & ~yes, axis=-1)
    nested = np.where(yes, 1, np.where(no, 0, -1)).astype(np.int64)
    return nested, int(np.count_nonzero((codes == 0) & yes))


def _single(
    levels: FloatArray, column: IntArray, codes: IntArray, name: str, meaning: str
) -> LimitState:
    n = np.bincount(column, codes >= 0, levels.size)
    collapses = np.bincount(column, codes == 1, levels.size)
    try:
        return LimitState(name, meaning, fit_stripes(levels, collapses, n))
    except FitError as error:
        return LimitState(
            name,
            meaning,
            None,
            f"limit state {name!r} has no curve (to collapse means to exceed it): {error}",
        )


def _crossing(states: list[LimitState], fitted: list[int], levels: FloatArray) -> str:
    """Names of a pair of neighbours that cross within the levels, or nothing."""
    ends = levels[[0, -1]]
    for i, j in pairwise(fitted):
        milder, worse = states[i].fit, states[j].fit
        assert milder is not None
        assert worse is not None
        z = [np.log(ends / fit.theta) / fit.beta for fit in (milder, worse)]
        if np.any(z[1] > z[0] + 1e-9):
            return f"{states[i].name} and {states[j].name}"
    return ""


def _merge_alike(nested: IntArray) -> tuple[IntArray, list[int]]:
    """States of which no run lies between one and the next as one, and which one each became.

    Nothing holds the thresholds of such states apart: the likelihood would have them cross.
    """
    distinct, place = [nested[:, 0]], [0]
    for state in nested.T[1:]:
        milder = distinct[-1]
        if np.any((milder == 1) & (state == 0)):
            distinct.append(state)
        else:
            distinct[-1] = np.where(milder == 1, 1, state)
        place.append(len(distinct) - 1)
    return np.stack(distinct, axis=1), place


def _ordered(x: FloatArray, nested: IntArray) -> list[Fragility]:
    """Ordered probit with one slope: P(state i exceeded) = Phi(a_i + b (x - centre))."""
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
    p, hessian, loss = _newton(start, u, reached, spared, count)
    slope = p[-1]
    covariance = np.linalg.inv(hessian)
    fits = []
    for i in range(n_state):
        # ln theta = centre - width a / slope, beta = width / slope.
        jacobian = np.zeros((2, n_state + 1))
        jacobian[0, i] = -width / slope
        jacobian[:, -1] = width * p[i] / slope**2, -width / slope**2
        fits.append(
            Fragility(
                theta=float(np.exp(centre - width * p[i] / slope)),
                beta=float(width / slope),
                covariance=jacobian @ covariance @ jacobian.T,
                log_likelihood=-loss,
                n_levels=int(np.unique(x).size),
                n_total=int(np.count_nonzero(nested[:, i] >= 0)),
                kind="ordered",
            )
        )
    return fits


def _newton(
    p: FloatArray, u: FloatArray, reached: IntArray, spared: IntArray, count: IntArray
) -> tuple[FloatArray, FloatArray, float]:
    """Least loss of the ordered model, which is convex (Pratt 1981, J. Am. Stat. Assoc. 76)."""
    loss, gradient, hessian = _derivatives(p, u, reached, spared, count)
    for _ in range(_ROUNDS):
        step = np.linalg.solve(hessian, gradient)
        for _halving in range(60):
            new = _derivatives(p - step, u, reached, spared, count)
            if new[0] <= loss + 1e-12 * abs(loss):
                break
            step = 0.5 * step
        p, (loss, gradient, hessian) = p - step, new
        if np.max(np.abs(step)) <= 1e-10 * (1.0 + np.max(np.abs(p))):
            break
    return p, hessian, loss


def _derivatives(
    p: FloatArray, u: FloatArray, reached: IntArray, spared: IntArray, count: IntArray
) -> tuple[float, FloatArray, FloatArray]:
    """Loss, gradient and Hessian of -sum count ln(Phi(upper) - Phi(lower)).

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
    # ln(Phi(upper) - Phi(lower)) by the tail in which both are small.
    flip = upper + lower > 0.0
    high, low = np.where(flip, -lower, upper), np.where(flip, -upper, lower)
    log_p = log_ndtr(high) + np.log1p(-np.exp(log_ndtr(low) - log_ndtr(high)))
    half_log = 0.5 * np.log(2.0 * np.pi)
    f = np.where(top, 0.0, np.exp(-0.5 * upper**2 - half_log - log_p))
    g = np.where(bottom, 0.0, np.exp(-0.5 * lower**2 - half_log - log_p))
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


def _checked(
    exceeded: ArrayLike, im: ArrayLike, names: Sequence[str], meanings: Sequence[str]
) -> tuple[NDArray[np.int64], FloatArray, list[str], list[str]]:
    codes, intensity = np.asarray(exceeded), np.asarray(im, dtype=float)
    if codes.ndim != 3 or codes.size == 0:
        raise InputError(f"exceeded has shape {codes.shape}; (n_record, n_level, n_state)")
    if intensity.shape not in (codes.shape[:2], codes.shape[1:2]):
        raise InputError(f"im has shape {intensity.shape}, exceeded {codes.shape}")
    bad = intensity[~((intensity > 0.0) & np.isfinite(intensity))]
    if bad.size:
        raise InputError(f"im holds {bad[0]:g}; intensities are positive finite numbers")
    labels, texts = list(names), list(meanings) or [""] * len(names)
    if len(labels) != codes.shape[2] or len(texts) != len(labels):
        raise InputError(
            f"exceeded has {codes.shape[2]} states, names {len(labels)} and meanings {len(texts)}"
        )
    return codes, np.broadcast_to(intensity, codes.shape[:2]), labels, texts
