"""Many binomial regressions on one variable at once: probit and logistic lines."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx, expit, log_ndtr, ndtr, ndtri

from archfrag.errors import InputError
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.newton import Terms, least

LINKS = ("probit", "logistic")
_STEEP = 1e6
_CERTAIN = 40.0


@dataclass(frozen=True)
class Lines:
    """Lines intercept + slope x on the scale of the link.

    A fit without a maximum has the line that its likelihood tends to: all 0, all 1, a step
    (slope 1e6), or level where the fraction of collapses does not rise.

    Attributes
    ----------
    intercept, slope : ndarray, (n_fit,)
    degenerate : ndarray of bool, (n_fit,)
        No maximum with slope > 0.
    loss : ndarray, (n_fit,)
        Negative log-likelihood without binomial coefficients, at the line.
    information : ndarray, (n_fit, 2, 2)
        Observed, in (intercept, slope); nan where degenerate.
    """

    intercept: FloatArray
    slope: FloatArray
    degenerate: NDArray[np.bool_]
    loss: FloatArray
    information: FloatArray


def binomial_lines(
    x: FloatArray, collapses: FloatArray, n: FloatArray, link: str = "probit"
) -> Lines:
    """Likeliest lines of many weighted data sets.

    The loss is convex for both links (Pratt 1981, J. Am. Stat. Assoc. 76), so damped Newton steps
    from any start find its least value.

    Parameters
    ----------
    x : ndarray, (n_point,) or (n_fit, n_point)
    collapses, n : ndarray, (n_fit, n_point)
        Weighted counts, 0 <= collapses <= n; they need not be whole.
    link : str
        ``"probit"`` or ``"logistic"``.

    Raises
    ------
    InputError
        If the link is unknown.
    """
    if link not in LINKS:
        raise InputError(f"link is {link!r}; it is one of {', '.join(LINKS)}")
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

        def terms(p: FloatArray, fit: NDArray[np.intp]) -> Terms:
            return _terms(p, points[fit], fallen[fit], runs[fit], link)

        line, (_, _, found) = least(terms, np.zeros((todo.size, 2)))
        slope[todo] = line[:, 1] / width
        intercept[todo] = line[:, 0] - slope[todo] * centre
        falling = line[:, 1] <= 1e-9
        # (a, b) of the scaled line are linear in those of the line itself.
        scaling = np.zeros((todo.size, 2, 2))
        scaling[:, 0, 0], scaling[:, 0, 1], scaling[:, 1, 1] = 1.0, centre, width
        information[todo] = scaling.transpose(0, 2, 1) @ found @ scaling
        flat = todo[falling]
        slope[flat] = 0.0
        intercept[flat] = _level(k[flat].sum(axis=1), n[flat].sum(axis=1), link)
        degenerate[flat] = True
        information[flat] = np.nan
    loss = _loss(intercept[:, None] + slope[:, None] * x, k, n, link)
    return Lines(intercept, slope, degenerate, loss, information)


def inverse_link(z: FloatArray, link: str) -> FloatArray:
    """Probability at `z` on the scale of the link."""
    return ndtr(z) if link == "probit" else expit(z)


def inverse_mills(z: FloatArray) -> FloatArray:
    """phi(z) / Phi(z), also far in the lower tail."""
    return np.sqrt(2.0 / np.pi) / erfcx(-z / np.sqrt(2.0))


def _loss(z: FloatArray, k: FloatArray, n: FloatArray, link: str) -> FloatArray:
    if link == "probit":
        return -np.sum(k * log_ndtr(z) + (n - k) * log_ndtr(-z), axis=1)
    return np.sum(k * np.logaddexp(0.0, -z) + (n - k) * np.logaddexp(0.0, z), axis=1)


def _slopes(
    z: FloatArray, k: FloatArray, n: FloatArray, link: str
) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of the loss in z, point by point."""
    if link == "probit":
        up, down = inverse_mills(z), inverse_mills(-z)
        curvature = k * up * (z + up) + (n - k) * down * (down - z)
        return (n - k) * down - k * up, curvature
    p = expit(z)
    return n * p - k, n * p * (1.0 - p)


def _terms(p: FloatArray, x: FloatArray, k: FloatArray, n: FloatArray, link: str) -> Terms:
    """Loss of lines `p` (n_fit, 2), and its derivatives in them."""
    z = p[:, :1] + p[:, 1:] * x
    first, second = _slopes(z, k, n, link)
    a, b, c = second.sum(1), (second * x).sum(1), (second * x * x).sum(1)
    gradient = np.stack([first.sum(1), (first * x).sum(1)], axis=1)
    return _loss(z, k, n, link), gradient, np.stack([a, b, b, c], axis=1).reshape(-1, 2, 2)


def _level(k: FloatArray, n: FloatArray, link: str) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        p = np.where(n > 0, k / np.where(n > 0, n, 1.0), 0.5)
        z = ndtri(p) if link == "probit" else np.log(p) - np.log1p(-p)
    return np.clip(z, -_CERTAIN, _CERTAIN)


def _without_maximum(
    x: FloatArray, k: FloatArray, n: FloatArray, link: str
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Limits of those fits whose data are separated (Albert and Anderson 1984)."""
    fell, stood = k > 0, n > k
    first = np.where(fell, x, np.inf).min(axis=1)
    last = np.where(stood, x, -np.inf).max(axis=1)
    step = (first >= last) & fell.any(axis=1) & stood.any(axis=1)
    falls = np.where(fell, x, -np.inf).max(axis=1) <= np.where(stood, x, np.inf).min(axis=1)
    flat = ~step & falls
    slope = np.where(step, _STEEP, 0.0)
    middle = np.where(step, 0.5 * (np.where(step, first, 0.0) + np.where(step, last, 0.0)), 0.0)
    intercept = np.where(step, -_STEEP * middle, _level(k.sum(axis=1), n.sum(axis=1), link))
    return intercept, slope, step | flat
