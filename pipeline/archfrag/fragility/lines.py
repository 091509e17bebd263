"""Likeliest lines of many data sets at once: binomial ones, and normal ones with bounds.

All these losses are convex, so there is one least value or none, and Newton's method finds it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import erfcx, expit, log_ndtr, ndtri

from archfrag.fragility.curve import BoolArray, FloatArray, IntArray

Terms = tuple[FloatArray, FloatArray, FloatArray]
LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)
_STEEP, _CERTAIN = 1e6, 40.0
_ROUNDS, _HALVINGS, _CLOSE = 200, 60, 1e-11


class Lines(NamedTuple):
    """Lines intercept + slope x on the scale of the link, arrays of shape (n_fit,).

    A fit without a maximum has the line that its likelihood tends to: all 0, all 1, a step
    (slope 1e6), or level where the fraction of collapses does not rise.
    """

    intercept: FloatArray
    slope: FloatArray
    degenerate: BoolArray  #: no maximum with slope > 0
    loss: FloatArray  #: negative log-likelihood without binomial coefficients, at the line
    information: FloatArray  #: (n_fit, 2, 2), observed, in (intercept, slope); nan if degenerate


class NormalLines(NamedTuple):
    """Regressions y = design @ coefficients + error; nan or infinite without a maximum."""

    coefficients: FloatArray  #: (n_fit, q)
    deviation: FloatArray  #: (n_fit,), of the error
    loss: FloatArray  #: (n_fit,), negative log-likelihood
    information: FloatArray  #: (n_fit, q + 1, q + 1), observed, in (coefficients, 1) / deviation


def least(
    terms: Callable[[FloatArray, IntArray], Terms], start: FloatArray
) -> tuple[FloatArray, Terms]:
    """Parameters (n_fit, q) where each loss is least, and the terms there.

    `terms` takes parameters (m, q) and the numbers of their fits (m,), and gives loss (m,), inf
    where it is not defined, gradient and second derivatives. Newton's steps are halved until the
    loss does not grow.
    """
    p = np.array(start, dtype=float)
    active = np.arange(len(p))
    here = terms(p, active)
    for _ in range(_ROUNDS):
        now = tuple(term[active] for term in here)
        step = _solve(now[2], now[1])
        trial = p[active] - step
        there = terms(trial, active)
        allowed = now[0] + 1e-12 * (1.0 + np.abs(now[0]))
        for _ in range(_HALVINGS):
            worse = np.flatnonzero(~(there[0] <= allowed))
            if not worse.size:
                break
            step[worse] *= 0.5
            trial[worse] = p[active[worse]] - step[worse]
            for old, new in zip(there, terms(trial[worse], active[worse]), strict=True):
                old[worse] = new
        p[active] = trial
        for old, new in zip(here, there, strict=True):
            old[active] = new
        active = active[(np.abs(step) > _CLOSE * (1.0 + np.abs(trial))).any(axis=1)]
        if not active.size:
            break
    return p, here


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions of symmetric systems, (n, q); of two unknowns a flat direction is not followed."""
    if right.shape[1] != 2:
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0], dtype=np.float64)
    a, b, c = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    determinant = np.maximum(a * c - b * b, 1e-300)
    u, v = right.T
    return np.stack([c * u - b * v, a * v - b * u], axis=1) / determinant[:, None]


def binomial_lines(
    x: FloatArray, collapses: FloatArray, n: FloatArray, link: str = "probit"
) -> Lines:
    """Likeliest lines of weighted counts 0 <= collapses <= n, (n_fit, n_point), which need not be
    integers, at x, (n_point,) or (n_fit, n_point).

    `link` is "probit" or "logistic"; the loss is convex for both (Pratt 1981, J. Am. Stat. Assoc.
    76).
    """
    k, n = np.atleast_2d(collapses), np.atleast_2d(n)
    x = np.broadcast_to(x, k.shape)
    intercept, slope, degenerate = _without_maximum(x, k, n, link)
    information = np.full((len(k), 2, 2), np.nan)
    todo = np.flatnonzero(~degenerate)
    if todo.size:
        points, fallen, runs = x[todo], k[todo], n[todo]
        total = runs.sum(axis=1)
        centre = (runs * points).sum(axis=1) / total
        points = points - centre[:, None]
        width = np.sqrt((runs * points**2).sum(axis=1) / total)
        points /= width[:, None]

        def terms(p: FloatArray, fit: IntArray) -> Terms:
            return _binomial_terms(p, points[fit], fallen[fit], runs[fit], link)

        line, (_, _, found) = least(terms, np.zeros((todo.size, 2)))
        slope[todo] = line[:, 1] / width
        intercept[todo] = line[:, 0] - slope[todo] * centre
        # (a, b) of the scaled line are linear in those of the line itself.
        scaling = np.zeros((todo.size, 2, 2))
        scaling[:, 0, 0], scaling[:, 0, 1], scaling[:, 1, 1] = 1.0, centre, width
        information[todo] = scaling.transpose(0, 2, 1) @ found @ scaling
        flat = todo[line[:, 1] <= 1e-9]
        slope[flat] = 0.0
        intercept[flat] = _level(k[flat].sum(axis=1), n[flat].sum(axis=1), link)
        degenerate[flat] = True
        information[flat] = np.nan
    loss = _binomial_loss(intercept[:, None] + slope[:, None] * x, k, n, link)
    return Lines(intercept, slope, degenerate, loss, information)


def inverse_mills(z: FloatArray) -> FloatArray:
    """phi(z) / Phi(z), also far in the lower tail."""
    return np.sqrt(2.0 / np.pi) / erfcx(-z / np.sqrt(2.0))


def _binomial_loss(z: FloatArray, k: FloatArray, n: FloatArray, link: str) -> FloatArray:
    if link == "probit":
        return -np.sum(k * log_ndtr(z) + (n - k) * log_ndtr(-z), axis=1)
    return np.sum(k * np.logaddexp(0.0, -z) + (n - k) * np.logaddexp(0.0, z), axis=1)


def _binomial_terms(
    p: FloatArray, x: FloatArray, k: FloatArray, n: FloatArray, link: str
) -> Terms:
    """Loss of lines `p` (n_fit, 2), and its derivatives in them."""
    z = p[:, :1] + p[:, 1:] * x
    if link == "probit":
        up, down = inverse_mills(z), inverse_mills(-z)
        first = (n - k) * down - k * up
        second = k * up * (z + up) + (n - k) * down * (down - z)
    else:
        chance = expit(z)
        first, second = n * chance - k, n * chance * (1.0 - chance)
    a, b, c = second.sum(1), (second * x).sum(1), (second * x * x).sum(1)
    gradient = np.stack([first.sum(1), (first * x).sum(1)], axis=1)
    hessian = np.stack([a, b, b, c], axis=1).reshape(-1, 2, 2)
    return _binomial_loss(z, k, n, link), gradient, hessian


def _level(k: FloatArray, n: FloatArray, link: str) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        p = np.where(n > 0, k / np.where(n > 0, n, 1.0), 0.5)
        z = ndtri(p) if link == "probit" else np.log(p) - np.log1p(-p)
    return np.clip(z, -_CERTAIN, _CERTAIN)


def _without_maximum(
    x: FloatArray, k: FloatArray, n: FloatArray, link: str
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Limits of those fits whose data are separated (Albert and Anderson 1984)."""
    fell, stood = k > 0, n > k
    first = np.where(fell, x, np.inf).min(axis=1)
    last = np.where(stood, x, -np.inf).max(axis=1)
    step = (first >= last) & fell.any(axis=1) & stood.any(axis=1)
    falls = np.where(fell, x, -np.inf).max(axis=1) <= np.where(stood, x, np.inf).min(axis=1)
    slope = np.where(step, _STEEP, 0.0)
    middle = np.where(step, 0.5 * (np.where(step, first, 0.0) + np.where(step, last, 0.0)), 0.0)
    intercept = np.where(step, -_STEEP * middle, _level(k.sum(axis=1), n.sum(axis=1), link))
    return intercept, slope, step | falls


def normal_lines(
    design: FloatArray, lower: FloatArray, upper: FloatArray, weight: FloatArray
) -> NormalLines:
    """Likeliest regressions of values that are known to lie between bounds (Tobit).

    `lower` and `upper`, (n_point,) or (n_fit, n_point), are equal where a value is known exactly,
    -inf or inf where there is no bound; the first column of `design`, (n_point, q), is 1;
    `weight`, (n_fit or 1, n_point), is how often each point counts. In
    (coefficients, 1) / deviation the loss is convex (Olsen 1978, Econometrica 46; Burridge 1981,
    J. R. Stat. Soc. B 43).
    """
    n_fit = max(len(weight), np.atleast_2d(lower).shape[0])
    low, high, weight = (
        np.broadcast_to(part, (n_fit, len(design))) for part in (lower, upper, weight)
    )
    known = np.where(np.isfinite(low), low, high)
    known = 0.5 * (known + np.where(np.isfinite(high), high, low))
    centre, scale = known.mean(axis=1, keepdims=True), known.std(axis=1, keepdims=True)
    scale = np.where(scale > 0.0, scale, 1.0)
    low, high = (low - centre) / scale, (high - centre) / scale

    def terms(p: FloatArray, fit: IntArray) -> Terms:
        return _normal_terms(p, design, low[fit], high[fit], weight[fit])

    q = design.shape[1]
    p, (loss, _, found) = least(terms, np.tile(np.append(np.zeros(q), 1.0), (n_fit, 1)))
    coefficients = p[:, :-1] / p[:, -1:] * scale
    coefficients[:, :1] += centre
    exact = (weight * (low == high)).sum(axis=1)
    back = np.tile(np.eye(q + 1), (n_fit, 1, 1))
    back[:, 0, q], back[:, q, q] = -centre[:, 0], scale[:, 0]
    return NormalLines(
        coefficients, scale[:, 0] / p[:, -1], loss + exact * np.log(scale[:, 0]),
        back.transpose(0, 2, 1) @ found @ back,
    )  # fmt: skip


def _normal_terms(
    p: FloatArray, design: FloatArray, low: FloatArray, high: FloatArray, weight: FloatArray
) -> Terms:
    """Loss of p = (coefficients, 1) / deviation, (n_fit, q + 1), and its derivatives."""
    inverse, q = p[:, -1:], design.shape[1]
    exact, centre = low == high, p[:, :-1] @ design.T
    x = np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0)
    below, above = (inverse * end - centre for end in x)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        log_mass = log_between(
            np.where(np.isfinite(low), below, low), np.where(np.isfinite(high), above, high)
        )
        density = 0.5 * above**2 - np.log(inverse) + LOG_ROOT_TWO_PI
        loss = (weight * np.where(exact, density, -log_mass)).sum(axis=1)
        down, up = (np.exp(-0.5 * z * z - LOG_ROOT_TWO_PI - log_mass) for z in (below, above))
    down = np.where(exact | np.isinf(low), 0.0, down)
    up = np.where(exact, -above, np.where(np.isinf(high), 0.0, up))
    # Second derivatives in both ends; an exact value is one end, of curvature 1.
    uu = weight * np.where(exact, 1.0, up * (above + up))
    dd, ud = weight * down * (down - below), -weight * np.where(exact, 0.0, up * down)
    count = (weight * exact).sum(axis=1)
    hessian = np.empty((len(p), q + 1, q + 1))
    products = (design[:, :, None] * design[:, None, :]).reshape(len(design), q * q)
    hessian[:, :q, :q] = ((uu + 2.0 * ud + dd) @ products).reshape(-1, q, q)
    cross = uu * x[1] + ud * (x[0] + x[1]) + dd * x[0]
    hessian[:, :q, q] = hessian[:, q, :q] = -cross @ design
    square = uu * x[1] ** 2 + 2.0 * ud * x[0] * x[1] + dd * x[0] ** 2
    hessian[:, q, q] = square.sum(axis=1) + count / inverse[:, 0] ** 2
    by_inverse = (weight * (down * x[0] - up * x[1])).sum(axis=1) - count / inverse[:, 0]
    gradient = np.column_stack([(weight * (up - down)) @ design, by_inverse])
    return np.where(inverse[:, 0] > 0.0, loss, np.inf), gradient, hessian


def log_between(low: FloatArray, high: FloatArray) -> FloatArray:
    """ln(Phi(high) - Phi(low)), precise in both tails; -inf unless low < high."""
    flip = low + high > 0.0
    near, far = np.where(flip, -low, high), np.where(flip, -high, low)
    top = log_ndtr(near)
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = top + np.log(-np.expm1(log_ndtr(far) - top))
    return np.where((high > low) & np.isfinite(top), inside, -np.inf)
