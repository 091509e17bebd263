"""Many normal regressions at once in which some values are known as bounds only (Tobit)."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from archfrag.fragility.binomial_lines import inverse_mills
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.newton import Terms, least

IntArray = NDArray[np.int64]

OBSERVED, ABOVE, BELOW = 0, 1, -1


def censored_lines(
    design: FloatArray, y: FloatArray, side: IntArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Likeliest coefficients and standard deviation of y = design @ coefficients + error.

    In p = (coefficients, 1) / deviation the loss is convex (Olsen 1978, Econometrica 46), so
    damped Newton steps find its least value.

    Parameters
    ----------
    design : ndarray, (n_point, n_coefficient)
        The first column is 1.
    y : ndarray, (n_point,) or (n_fit, n_point)
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
    observed = side == OBSERVED
    n_fit = max(len(weight), np.atleast_2d(y).shape[0])
    shape = (n_fit, design.shape[0])
    weight, y = np.broadcast_to(weight, shape), np.broadcast_to(y, shape)
    seen = y[:, observed]
    centre, scale = seen.mean(axis=1), seen.std(axis=1)
    scale = np.where(scale > 0.0, scale, 1.0)
    values = (y - centre[:, None]) / scale[:, None]
    start, deviation = _least_squares(design, values, weight * observed)
    coefficients, loss = np.full(start.shape, np.nan), np.full(n_fit, np.nan)
    sound = np.isfinite(deviation) & (deviation > 1e-9)
    if sound.any():
        p = np.concatenate([start[sound], np.ones((sound.sum(), 1))], axis=1)
        p /= deviation[sound, None]
        known, counted = values[sound], weight[sound]

        def terms(p: FloatArray, fit: NDArray[np.intp]) -> Terms:
            return _terms(p, design, known[fit], side, counted[fit])

        p, (loss[sound], _, _) = least(terms, p)
        coefficients[sound] = p[:, :-1] / p[:, -1:]
        deviation[sound] = 1.0 / p[:, -1]
        count = (counted * observed).sum(axis=1)
        loss[sound] += count * np.log(np.sqrt(2.0 * np.pi) * scale[sound])
    deviation[~sound] = np.nan
    coefficients = coefficients * scale[:, None]
    coefficients[:, 0] += centre
    return coefficients, scale * deviation, loss


def _least_squares(
    design: FloatArray, y: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Coefficients and deviation of weighted least squares; nan where not determined."""
    normal = _squares(weight, design)
    right = (weight * y) @ design
    coefficients = np.full(right.shape, np.nan)
    sizes = np.einsum("fjj->fj", normal).prod(axis=1)
    sound = (np.linalg.det(normal) > 1e-10 * sizes) & (sizes > 0.0)
    sound &= np.count_nonzero(weight, axis=1) > design.shape[1]
    if sound.any():
        coefficients[sound] = np.linalg.solve(normal[sound], right[sound][..., None])[..., 0]
    residual = y - coefficients @ design.T
    with np.errstate(invalid="ignore"):
        return coefficients, np.sqrt((weight * residual**2).sum(axis=1) / weight.sum(axis=1))


def _squares(weight: FloatArray, columns: FloatArray) -> FloatArray:
    """Weighted sums of products of columns, (n_fit, n_column, n_column)."""
    n_point, q = columns.shape
    products = (columns[:, :, None] * columns[:, None, :]).reshape(n_point, q * q)
    return (weight @ products).reshape(-1, q, q)


def _terms(
    p: FloatArray, design: FloatArray, y: FloatArray, side: IntArray, weight: FloatArray
) -> Terms:
    """Loss of p = (coefficients, 1) / deviation, (n_fit, q + 1), and its derivatives."""
    observed, above = side == OBSERVED, side == ABOVE
    inverse = p[:, -1]
    z = inverse[:, None] * y - p[:, :-1] @ design.T
    toward = np.where(above, -z, z)
    with np.errstate(invalid="ignore", divide="ignore"):
        density = 0.5 * z * z - np.log(inverse[:, None])
    loss = (weight * np.where(observed, density, -log_ndtr(toward))).sum(axis=1)
    mills = inverse_mills(toward)
    first = weight * np.where(observed, z, np.where(above, mills, -mills))
    second = weight * np.where(observed, 1.0, mills * (mills + toward))
    count = (weight * observed).sum(axis=1)
    by_inverse = (first * y).sum(axis=1) - count / inverse
    q = design.shape[1]
    hessian = np.empty((len(p), q + 1, q + 1))
    hessian[:, :q, :q] = _squares(second, design)
    hessian[:, :q, q] = hessian[:, q, :q] = -(second * y) @ design
    hessian[:, q, q] = (second * y * y).sum(axis=1) + count / inverse**2
    gradient = np.concatenate([-first @ design, by_inverse[:, None]], axis=1)
    return np.where(inverse > 0.0, loss, np.inf), gradient, hessian
