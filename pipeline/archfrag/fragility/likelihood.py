"""The log-likelihood of a normal distribution seen through intervals, and its maximum.

One likelihood serves all data of a lognormal curve. In the probit line z = a + b x, with
x = ln im and b = 1 / beta, a run that collapsed at x adds ln Phi(z), one that stood
ln Phi(-z), a capacity between x and x' ln(Phi(z') - Phi(z)), a capacity known exactly
ln(b phi(z)). All are concave in (a, b) (Olsen 1978, Econometrica 46; Burridge 1981, Journal of
the Royal Statistical Society B 43), so there is one maximum or none, and Newton's method finds it.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from archfrag.fragility.curve import FloatArray
from archfrag.fragility.newton import Terms, least

_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)
_NONE = np.empty(0)


@dataclass(frozen=True)
class Observations:
    """What is known of some capacities.

    Attributes
    ----------
    level : ndarray, (n_level,)
        ln im at which runs were made.
    collapsed, standing : ndarray, (n_level)
        Number of runs there with capacity below, above.
    lower, upper : ndarray, (n_bracket,)
        ln im between which a capacity lies.
    bracketed : ndarray, (n_bracket)
        Number of capacities there.
    exact : ndarray, (n_exact,)
        ln im of capacities known exactly.
    seen : ndarray, (n_exact)
        Number of them.
    """

    level: FloatArray = field(default_factory=lambda: _NONE)
    collapsed: FloatArray = field(default_factory=lambda: _NONE)
    standing: FloatArray = field(default_factory=lambda: _NONE)
    lower: FloatArray = field(default_factory=lambda: _NONE)
    upper: FloatArray = field(default_factory=lambda: _NONE)
    bracketed: FloatArray = field(default_factory=lambda: _NONE)
    exact: FloatArray = field(default_factory=lambda: _NONE)
    seen: FloatArray = field(default_factory=lambda: _NONE)


def likeliest_line(seen: Observations) -> tuple[FloatArray, FloatArray, float]:
    """Likeliest probit line.

    Only observations whose likelihood has a maximum may be given; x should be centred and scaled.

    Returns
    -------
    (ndarray, ndarray, float)
        Intercept and slope, (2,); observed information in them, (2, 2); the log-likelihood
        without binomial coefficients.
    """

    def terms(lines: FloatArray, _: NDArray[np.intp]) -> Terms:
        value, gradient, information = _terms(seen, lines)
        return np.where(np.isnan(value), np.inf, -value), -gradient, information

    lines, (loss, _, information) = least(terms, np.array([[0.0, 1.0]]))
    return lines[0], information[0], -float(loss[0])


def _terms(seen: Observations, lines: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log-likelihood (n,), its gradient (n, 2) and minus its second derivatives (n, 2, 2)."""
    a, b = lines[:, :1], lines[:, 1:]
    value = np.zeros(len(lines))
    gradient = np.zeros((len(lines), 2))
    information = np.zeros((len(lines), 2, 2))

    def add(x: FloatArray, slope: FloatArray, curvature: FloatArray) -> None:
        gradient[:, 0] += slope.sum(axis=1)
        gradient[:, 1] += slope @ x
        for i, j, power in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
            information[:, i, j] += curvature @ x**power

    if seen.level.size:
        z = a + b * seen.level
        below, above = log_ndtr(z), log_ndtr(-z)
        value += (seen.collapsed * below + seen.standing * above).sum(axis=1)
        log_density = -0.5 * z * z - _LOG_ROOT_TWO_PI
        up, down = np.exp(log_density - below), np.exp(log_density - above)
        add(
            seen.level,
            seen.collapsed * up - seen.standing * down,
            seen.collapsed * up * (z + up) + seen.standing * down * (down - z),
        )
    if seen.exact.size:
        z = a + b * seen.exact
        with np.errstate(invalid="ignore", divide="ignore"):
            inside = np.log(b) - 0.5 * z * z - _LOG_ROOT_TWO_PI
        value += (seen.seen * np.where(b > 0.0, inside, -np.inf)).sum(axis=1)
        add(seen.exact, -seen.seen * z, np.broadcast_to(seen.seen, z.shape))
        number = np.broadcast_to(seen.seen, z.shape).sum(axis=1)
        gradient[:, 1] += number / lines[:, 1]
        information[:, 1, 1] += number / lines[:, 1] ** 2
    if seen.lower.size:
        _add_brackets(seen, lines, value, gradient, information)
    return value, gradient, information


def _add_brackets(seen, lines, value, gradient, information) -> None:
    """Terms of capacities between two finite values."""
    a, b = lines[:, :1], lines[:, 1:]
    low, high = a + b * seen.lower, a + b * seen.upper
    log_mass = log_between(low, high)
    weight = np.broadcast_to(seen.bracketed, low.shape)
    used = np.where(weight > 0.0, log_mass, 0.0)
    value += (weight * used).sum(axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        up = np.exp(-0.5 * high * high - _LOG_ROOT_TWO_PI - log_mass)
        down = np.exp(-0.5 * low * low - _LOG_ROOT_TWO_PI - log_mass)
        slope = up * seen.upper - down * seen.lower
        first = (up - down, slope)
        gradient += np.stack([(weight * f).sum(axis=1) for f in first], axis=1)
        turned = -high * up, -low * down
        for i, j, power in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
            second = turned[0] * seen.upper**power - turned[1] * seen.lower**power
            information[:, i, j] += (weight * (first[i] * first[j] - second)).sum(axis=1)


def log_between(low: FloatArray, high: FloatArray) -> FloatArray:
    """ln(Phi(high) - Phi(low)), precise in both tails; -inf unless low < high."""
    flip = low + high > 0.0
    near, far = np.where(flip, -low, high), np.where(flip, -high, low)
    top = log_ndtr(near)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(high > low, top + np.log(-np.expm1(log_ndtr(far) - top)), -np.inf)
