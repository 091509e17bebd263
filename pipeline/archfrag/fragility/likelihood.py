"""Concave log-likelihoods of the lognormal curve and their maxima."""

import numpy as np
from scipy.optimize import minimize
from scipy.special import log_ndtr

from archfrag.fragility.curve import FloatArray


def binomial_loss(z: FloatArray, collapses: FloatArray, standing: FloatArray) -> float:
    """Negative log-likelihood without binomial coefficients, `z` on the probit scale."""
    return float(-np.sum(collapses * log_ndtr(z) + standing * log_ndtr(-z)))


def _mills(z: FloatArray) -> FloatArray:
    """phi(z) / Phi(z), also far in the lower tail."""
    return np.exp(-0.5 * z * z - 0.5 * np.log(2.0 * np.pi) - log_ndtr(z))


def probit_line(
    x: FloatArray, collapses: FloatArray, standing: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Intercept and slope of the likeliest probit line, and the observed information there."""
    design = np.stack([np.ones_like(x), x])

    def gradient(line):
        z = line @ design
        return design @ (standing * _mills(-z) - collapses * _mills(z))

    def hessian(line):
        z = line @ design
        up, down = _mills(z), _mills(-z)
        weight = collapses * up * (z + up) + standing * down * (down - z)
        return (design * weight) @ design.T

    line = _maximum(
        lambda line: binomial_loss(line @ design, collapses, standing),
        gradient,
        hessian,
        np.zeros(2),
    )
    return line, hessian(line)


def censored_normal(below: FloatArray, n_censored: int) -> tuple[FloatArray, FloatArray, float]:
    """Likeliest normal distribution of values of which those above 0 are only counted.

    In p = (mean, 1) / deviation the likelihood is concave (Olsen 1978, Econometrica 46).

    Parameters
    ----------
    below : ndarray, (n_observed,)
        Values seen, <= 0 and not all 0.
    n_censored : int
        Values above 0.

    Returns
    -------
    (ndarray, ndarray, float)
        p, (2,); the observed information in p, (2, 2); the log-likelihood.
    """

    def loss(p):
        if p[1] <= 0.0:
            return np.inf
        z = p[1] * below - p[0]
        constant = below.size * (0.5 * np.log(2.0 * np.pi) - np.log(p[1]))
        return 0.5 * z @ z + constant - n_censored * log_ndtr(p[0])

    def gradient(p):
        z = p[1] * below - p[0]
        return np.array([-z.sum() - n_censored * _mills(p[0]), z @ below - below.size / p[1]])

    def hessian(p):
        hazard = _mills(p[0])
        corner = below.size + n_censored * hazard * (p[0] + hazard)
        off = -below.sum()
        return np.array([[corner, off], [off, below @ below + below.size / p[1] ** 2]])

    p = _maximum(loss, gradient, hessian, np.array([0.0, 1.0]))
    return p, hessian(p), float(-loss(p))


def _maximum(loss, gradient, hessian, start: FloatArray) -> FloatArray:
    """Minimise a convex loss to rounding.

    A stopping rule on the gradient stops early where the loss is flat, as it is for nearly
    separated data, so Newton's steps follow until they no longer matter.
    """
    p = minimize(
        loss, start, method="trust-exact", jac=gradient, hess=hessian, options={"gtol": 1e-6}
    ).x
    for _ in range(50):
        step = np.linalg.solve(hessian(p), gradient(p))
        p = p - step
        if np.all(np.abs(step) <= 1e-10 * (1.0 + np.abs(p))):
            break
    return p
