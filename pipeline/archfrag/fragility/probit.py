"""Likeliest lines of many data sets at once: of verdicts, and of values known within bounds.

All these losses are convex, so there is one least value or none, and Newton's method finds it.
"""

from collections.abc import Callable

import numpy as np
from scipy.special import erfcx, expit, log_ndtr

from archfrag.fragility.curve import FloatArray, IntArray, Triple

# Loss (n_fit,), gradient (n_fit, q) and second derivatives (n_fit, q, q).
Terms = Triple
LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)
_STEPS = 200
_HALVINGS = 60
_CLOSE = 1e-11
# Width, in deviations of all values, of the bounds about one known exactly.
_EXACT = 1e-5


def least(
    terms: Callable[[FloatArray, IntArray], Terms], start: FloatArray
) -> tuple[FloatArray, Terms]:
    """Find parameters (n_fit, q) where each loss is least, and the terms there.

    By Newton's method. `terms` takes parameters (m, q) and the numbers of their fits (m,); its
    loss may be inf.
    """
    p = np.array(start, float)
    active = np.arange(len(p))
    for _ in range(_STEPS):
        loss, gradient, hessian = terms(p[active], active)
        # A direction in which the loss is flat is not followed.
        ridge = 1e-14 * np.trace(hessian, axis1=1, axis2=2) + 1e-250
        hessian = hessian + ridge[:, None, None] * np.eye(p.shape[1])
        step = np.linalg.solve(hessian, gradient[..., None])[..., 0]
        allowed = loss + 1e-12 * (1.0 + np.abs(loss))
        for _ in range(_HALVINGS):
            worse = ~(terms(p[active] - step, active)[0] <= allowed)
            if not worse.any():
                break
            step[worse] *= 0.5
        p[active] -= step
        active = active[(np.abs(step) > _CLOSE * (1.0 + np.abs(p[active]))).any(axis=1)]
        if not active.size:
            break
    return p, terms(p, np.arange(len(p)))


def interval_terms(p: FloatArray, low: FloatArray, high: FloatArray) -> Terms:
    """Return the terms of -sum ln(Phi(high @ p) - Phi(low @ p)), convex in `p`, (n_fit, q).

    `low` and `high` are (n_fit, n_point, q), nan where there is no bound. Pratt 1981, J. Am. Stat.
    Assoc. 76.
    """
    z = []
    rows = []
    for side, none in ((low, -np.inf), (high, np.inf)):
        bounded = ~np.isnan(side[..., 0])
        rows.append(np.where(bounded[..., None], side, 0.0))
        z.append(np.where(bounded, (rows[-1] @ p[..., None])[..., 0], none))
    log_mass = log_between(*z)
    with np.errstate(invalid="ignore", over="ignore"):
        down, up = (np.exp(-0.5 * each**2 - LOG_ROOT_TWO_PI - log_mass) for each in z)
        below, above = (np.where(np.isfinite(each), each, 0.0) for each in z)
        first = up[..., None] * rows[1] - down[..., None] * rows[0]
        hessian = np.swapaxes(first, 1, 2) @ first
        for bound, factor in zip(rows, (-down * below, up * above)):
            hessian += np.swapaxes(bound * factor[..., None], 1, 2) @ bound
        return -log_mass.sum(axis=1), -first.sum(axis=1), hessian


def binomial_lines(
    x: FloatArray, collapses: FloatArray, n: FloatArray, link: str = "probit"
) -> tuple[FloatArray, ...]:
    """Find the likeliest lines of counts 0 <= collapses <= n, (n_fit, n_point).

    Counts may be fractions; they are at x, (n_point,) or (n_fit, n_point). `link` is "probit" or
    "logistic". Returned are intercept and slope on the scale of the link, negative log-likelihood
    without binomial coefficients, (n_fit,) each, and observed information, (n_fit, 2, 2); nan
    without a maximum with slope > 0.
    """
    k = np.atleast_2d(collapses)
    n = np.atleast_2d(n)
    x = np.broadcast_to(x, k.shape)
    # There is a maximum unless the data are separated (Albert and Anderson 1984).
    above, below = (np.where(k > 0, x, edge) for edge in (-np.inf, np.inf))
    under, over = (np.where(n > k, x, edge) for edge in (-np.inf, np.inf))
    overlap = below.min(axis=1) < under.max(axis=1)
    todo = np.flatnonzero(overlap & (above.max(axis=1) > over.min(axis=1)))
    lines = [np.full((len(k), *shape), np.nan) for shape in ((), (), (), (2, 2))]
    x, k, n = (each[todo] for each in (x, k, n))
    total = n.sum(axis=1)
    centre = (n * x).sum(axis=1) / total
    width = np.sqrt((n * (x - centre[:, None]) ** 2).sum(axis=1) / total)
    scaled = (x - centre[:, None]) / width[:, None]

    def terms(p: FloatArray, fit: IntArray) -> Terms:
        u = scaled[fit]
        collapsed = k[fit]
        survived = n[fit] - k[fit]
        z = p[:, :1] + p[:, 1:] * u
        if link == "probit":
            up = inverse_mills(z)
            down = inverse_mills(-z)
            first = survived * down - collapsed * up
            second = collapsed * up * (z + up) + survived * down * (down - z)
            loss = -(collapsed * log_ndtr(z) + survived * log_ndtr(-z))
        else:
            chance = expit(z)
            first = n[fit] * chance - collapsed
            second = n[fit] * chance * (1.0 - chance)
            loss = collapsed * np.logaddexp(0.0, -z) + survived * np.logaddexp(0.0, z)
        b = (second * u).sum(1)
        hessian = np.array([[second.sum(1), b], [b, (second * u * u).sum(1)]])
        gradient = np.stack([first.sum(1), (first * u).sum(1)], axis=1)
        return loss.sum(axis=1), gradient, np.moveaxis(hessian, 2, 0)

    line, (loss, _, found) = least(terms, np.zeros((todo.size, 2)))
    # (a, b) of the scaled line are linear in those of the line itself.
    slope = line[:, 1] / width
    rising = line[:, 1] > 1e-9
    information = _rescaled(found, centre, width)
    known = line[:, 0] - slope * centre, slope, loss, information
    for part, values in zip(lines, known):
        part[todo[rising]] = values[rising]
    return tuple(lines)


def _rescaled(
    information: FloatArray, centre: FloatArray, scale: FloatArray
) -> FloatArray:
    """Return information, (n_fit, q, q), in parameters of unscaled values.

    It is given in parameters of values that were shifted by `centre` and divided by `scale`; only
    the first and the last parameter change.
    """
    back = np.tile(np.eye(information.shape[-1]), (len(scale), 1, 1))
    back[:, 0, -1] = centre
    back[:, -1, -1] = scale
    return np.asarray(back.transpose(0, 2, 1) @ information @ back)


def normal_lines(
    design: FloatArray, lower: FloatArray, upper: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Find the likeliest regressions y = design @ coefficients + error, of bounded values (Tobit).

    `lower` and `upper`, (n_point,) or (n_fit, n_point), are equal where a value is known exactly,
    infinite where there is no bound; the first column of `design`, (n_point, q), is 1. Returns
    coefficients (n_fit, q); deviation of the error and negative log-likelihood, (n_fit,) each;
    observed information in (coefficients, 1) / deviation, (n_fit, q + 1, q + 1), in which the
    loss is convex (Olsen 1978, Econometrica 46).
    """
    low = np.atleast_2d(lower)
    high = np.atleast_2d(upper)
    known = np.where(np.isfinite(low), low, high)
    known = 0.5 * (known + np.where(np.isfinite(high), high, low))
    centre = known.mean(axis=1, keepdims=True)
    scale = known.std(axis=1, keepdims=True)
    scale = np.where(scale > 0.0, scale, 1.0)
    low = (low - centre) / scale
    high = (high - centre) / scale
    exact = np.where(np.isfinite(high - low), high - low, 1.0) < _EXACT
    # A value known exactly counts by its density, one in narrow bounds by density times width.
    width = np.where(exact & (high > low), (high - low) * scale, 1.0)
    density = np.where(exact, np.log(scale * _EXACT / width), 0.0).sum(axis=1)
    middle = 0.5 * (low + high)
    q = design.shape[1]
    bounds = []
    for end, sign in ((low, -1.0), (high, 1.0)):
        end = np.where(exact, middle + sign * 0.5 * _EXACT, end)[..., None]
        rows = np.concatenate([np.broadcast_to(-design, (*low.shape, q)), end], axis=2)
        bounds.append(np.where(np.isfinite(end), rows, np.nan))

    def terms(p: FloatArray, fit: IntArray) -> Terms:
        return interval_terms(p, *(each[fit] for each in bounds))

    start = np.append(np.zeros(q), 1.0)
    p, (loss, _, found) = least(terms, np.tile(start, (len(low), 1)))
    coefficients = p[:, :-1] / p[:, -1:] * scale
    coefficients[:, :1] += centre
    information = _rescaled(found, -centre[:, 0], scale[:, 0])
    return coefficients, scale[:, 0] / p[:, -1], loss + density, information


def inverse_mills(z: FloatArray) -> FloatArray:
    """Return phi(z) / Phi(z), also far in the lower tail."""
    return np.sqrt(2.0 / np.pi) / erfcx(-z / np.sqrt(2.0))


def log_between(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return ln(Phi(high) - Phi(low)), precise in both tails; -inf unless low < high."""
    flip = low + high > 0.0
    near = np.where(flip, -low, high)
    far = np.where(flip, -high, low)
    top = log_ndtr(near)
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = top + np.log(-np.expm1(log_ndtr(far) - top))
    return np.where((high > low) & np.isfinite(top), inside, -np.inf)
