"""Many normal regressions at once in which some values are known as bounds only (Tobit)."""

import numpy as np
from scipy.special import log_ndtr

from archfrag.fragility.binomial_lines import inverse_mills
from archfrag.fragility.curve import FloatArray

OBSERVED, ABOVE, BELOW = 0, 1, -1
_ROUNDS = 80


def censored_lines(
    design: FloatArray, y: FloatArray, side: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Likeliest coefficients and standard deviation of y = design @ coefficients + error.

    In p = (coefficients, 1) / deviation the loss is convex (Olsen 1978, Econometrica 46), so
    damped Newton steps find its least value.

    Parameters
    ----------
    design : ndarray, (n_point, n_coefficient)
    y : ndarray, (n_point,)
        Values, or the bounds of those that are known as bounds only.
    side : ndarray of int, (n_point,)
        `OBSERVED`, `ABOVE` (the value lies above y) or `BELOW`.
    weight : ndarray, (n_fit, n_point)
        How often each point counts in each fit, >= 0.

    Returns
    -------
    (ndarray, ndarray, ndarray)
        Coefficients, (n_fit, n_coefficient), deviation and negative log-likelihood, (n_fit,);
        nan where the observed points lie on a line exactly, so that no maximum exists.
    """
    n_fit, q = len(weight), design.shape[1]
    observed = side == OBSERVED
    centre, scale = y[observed].mean(), y[observed].std() or 1.0
    values = (y - centre) / scale
    start, deviation = _least_squares(design, values, weight * observed)
    coefficients, loss = np.full((n_fit, q), np.nan), np.full(n_fit, np.nan)
    sound = np.isfinite(deviation) & (deviation > 1e-9)
    if sound.any():
        p = np.concatenate([start[sound], np.ones((sound.sum(), 1))], axis=1)
        p = _newton(p / deviation[sound, None], design, values, side, weight[sound])
        coefficients[sound] = p[:, :-1] / p[:, -1:]
        deviation[sound] = 1.0 / p[:, -1]
        constant = (weight[sound] * observed).sum(axis=1) * np.log(np.sqrt(2.0 * np.pi) * scale)
        loss[sound] = _losses(p, design, values, side, weight[sound]) + constant
    deviation[~sound] = np.nan
    intercept = np.linalg.lstsq(design, np.ones(len(y)), rcond=None)[0]
    return scale * coefficients + centre * intercept, scale * deviation, loss


def _least_squares(
    design: FloatArray, y: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Coefficients and deviation of weighted least squares; nan where not determined."""
    normal = _squares(weight, design)
    right = weight @ (design * y[:, None])
    coefficients = np.full(right.shape, np.nan)
    sizes = np.einsum("fjj->fj", normal).prod(axis=1)
    sound = (np.linalg.det(normal) > 1e-10 * sizes) & (sizes > 0.0)
    sound &= np.count_nonzero(weight, axis=1) > design.shape[1]
    if sound.any():
        coefficients[sound] = np.linalg.solve(normal[sound], right[sound][..., None])[..., 0]
    residual = y - coefficients @ design.T
    return coefficients, np.sqrt((weight * residual**2).sum(axis=1) / weight.sum(axis=1))


def _squares(weight: FloatArray, columns: FloatArray) -> FloatArray:
    """Weighted sums of products of columns, (n_fit, n_column, n_column)."""
    n_point, q = columns.shape
    products = (columns[:, :, None] * columns[:, None, :]).reshape(n_point, q * q)
    return (weight @ products).reshape(-1, q, q)


def _losses(
    p: FloatArray, design: FloatArray, y: FloatArray, side: FloatArray, weight: FloatArray
) -> FloatArray:
    z = p[:, -1:] * y - p[:, :-1] @ design.T
    with np.errstate(invalid="ignore", divide="ignore"):
        observed = 0.5 * z * z - np.log(p[:, -1:])
    bound = -log_ndtr(np.where(side == ABOVE, -z, z))
    loss = (weight * np.where(side == OBSERVED, observed, bound)).sum(axis=1)
    return np.where(p[:, -1] > 0.0, loss, np.inf)


def _newton(
    p: FloatArray, design: FloatArray, y: FloatArray, side: FloatArray, weight: FloatArray
) -> FloatArray:
    slope_of_z = np.concatenate([-design, y[:, None]], axis=1)
    observed, above = side == OBSERVED, side == ABOVE
    p = p.copy()
    active = np.arange(len(p))
    loss = _losses(p, design, y, side, weight)
    for _ in range(_ROUNDS):
        w, now = weight[active], p[active]
        z = now[:, -1:] * y - now[:, :-1] @ design.T
        mills = inverse_mills(np.where(above, -z, z))
        first = w * np.where(observed, z, np.where(above, mills, -mills))
        second = w * np.where(observed, 1.0, mills * (mills + np.where(above, -z, z)))
        count = (w * observed).sum(axis=1)
        gradient = first @ slope_of_z
        gradient[:, -1] -= count / now[:, -1]
        hessian = _squares(second, slope_of_z)
        hessian[:, -1, -1] += count / now[:, -1] ** 2
        step = np.linalg.solve(hessian, gradient[..., None])[..., 0]
        for _halving in range(30):
            trial = now - step
            new = _losses(trial, design, y, side, w)
            worse = ~(new <= loss[active] + 1e-10 * (1.0 + np.abs(loss[active])))
            if not worse.any():
                break
            step[worse] *= 0.5
        p[active], loss[active] = trial, new
        active = active[np.abs(step).max(axis=1) > 1e-9 * (1.0 + np.abs(now).max(axis=1))]
        if not active.size:
            break
    return p
