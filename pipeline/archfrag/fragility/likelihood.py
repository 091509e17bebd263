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

_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)
_STEPS = 200
_CLOSE = 1e-11
_NONE = np.empty(0)


@dataclass(frozen=True)
class Observations:
    """What is known of the capacities of one or many draws; weights end in the axis named.

    Attributes
    ----------
    level : ndarray, (n_level,)
        ln im at which runs were made.
    collapsed, standing : ndarray, (..., n_level)
        Number of runs there with capacity below, above.
    lower, upper : ndarray, (n_bracket,)
        ln im between which a capacity lies.
    bracketed : ndarray, (..., n_bracket)
        Number of capacities there.
    exact : ndarray, (n_exact,)
        ln im of capacities known exactly.
    seen : ndarray, (..., n_exact)
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

    def draws(self, chosen: NDArray[np.intp] | NDArray[np.bool_]) -> "Observations":
        """The same of some draws only, where weights are (n_draw, ...)."""
        weights = (self.collapsed, self.standing, self.bracketed, self.seen)
        a, b, c, d = (w[chosen] if w.ndim > 1 else w for w in weights)
        return Observations(self.level, a, b, self.lower, self.upper, c, self.exact, d)


def likeliest_lines(seen: Observations, n_draw: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Likeliest probit line of each draw, all at once.

    Only draws whose likelihood has a maximum may be given; x should be centred and scaled.

    Returns
    -------
    (ndarray, ndarray, ndarray)
        Intercept and slope, (n_draw, 2); observed information in them, (n_draw, 2, 2); the
        log-likelihood without binomial coefficients, (n_draw,).
    """
    lines = np.tile([0.0, 1.0], (n_draw, 1))
    value, gradient, information = _terms(seen, lines)
    active = np.arange(n_draw)
    for _ in range(_STEPS):
        step = _solve(information[active], gradient[active])
        few = seen.draws(active)
        trial = lines[active] + step
        terms = _terms(few, trial)
        allowed = 1e-12 * (1.0 + np.abs(value[active]))
        for _ in range(60):
            worse = ~(terms[0] >= value[active] - allowed)
            if not worse.any():
                break
            step[worse] *= 0.5
            trial[worse] = lines[active[worse]] + step[worse]
            again = _terms(few.draws(worse), trial[worse])
            for old, new in zip(terms, again, strict=True):
                old[worse] = new
        lines[active] = trial
        value[active], gradient[active], information[active] = terms
        moved = np.abs(step) > _CLOSE * (1.0 + np.abs(trial))
        active = active[moved.any(axis=1)]
        if not active.size:
            break
    return lines, information, value


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions of symmetric 2 x 2 systems, (n, 2); a flat direction is not followed."""
    a, b, c = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    determinant = np.maximum(a * c - b * b, 1e-300)
    return (
        np.stack([c * right[:, 0] - b * right[:, 1], a * right[:, 1] - b * right[:, 0]], axis=1)
        / determinant[:, None]
    )


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
