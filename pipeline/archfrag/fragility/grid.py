"""Distribution of the probit line on a grid that finds its own extent, and its quantiles.

Rows have one slope b = 1 / beta each, even in ln b; along a row the intercept a varies between
limits of its own. Every quantile that a curve needs is one of a + b x <= c, which is a sum of
distribution functions over the rows: of the probability at x with c unknown, of ln theta with
c = 0 and x unknown.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from archfrag.fragility.curve import FloatArray

LogDensity = Callable[[FloatArray, FloatArray], FloatArray]

_DEPTH = 18.0
_REACH = 9.0
_HALVINGS = 46


@dataclass(frozen=True)
class LineGrid:
    """Distribution of (a, b) of z = a + b x.

    Attributes
    ----------
    slope : ndarray, (n_row,)
        b, even in its logarithm.
    mass : ndarray, (n_row,)
        Of each row; sums to 1.
    first, step : ndarray, (n_row,)
        Intercepts of row i are first + step j.
    density, below : ndarray, (n_row, n_node)
        Of the intercept within its row, and its integral up to the node.
    """

    slope: FloatArray
    mass: FloatArray
    first: FloatArray
    step: FloatArray
    density: FloatArray
    below: FloatArray

    def probability(self, x: FloatArray, c: FloatArray) -> FloatArray:
        """P(a + b x <= c), shape of x and c."""
        place = (c[..., None] - self.slope * x[..., None] - self.first) / self.step
        last = self.density.shape[1] - 1
        node = np.clip(place.astype(np.int64), 0, last - 1)
        t = np.clip(place - node, 0.0, 1.0)
        row = np.arange(self.slope.size)
        p, q = self.density[row, node], self.density[row, node + 1]
        rise = self.below[row, node + 1] - self.below[row, node]
        p, q = p * self.step, q * self.step
        cubic = t * (p + t * (3.0 * rise - 2.0 * p - q + t * (p + q - 2.0 * rise)))
        return (self.below[row, node] + cubic) @ self.mass

    def probits(self, x: FloatArray, level: FloatArray) -> FloatArray:
        """Quantiles of a + b x at each x: (n_level, n_x)."""
        ends = self.first, self.first + self.step * (self.density.shape[1] - 1)
        low = (ends[0] + np.multiply.outer(x, self.slope)).min(axis=1)
        high = (ends[1] + np.multiply.outer(x, self.slope)).max(axis=1)
        shape = (level.size, x.size)
        xs = np.broadcast_to(x, shape)
        return _root(
            lambda c: self.probability(xs, c) - level[:, None],
            np.broadcast_to(low, shape),
            np.broadcast_to(high, shape),
        )

    def log_medians(self, level: FloatArray) -> FloatArray:
        """Quantiles of ln theta = -a / b, (n_level,)."""
        last = self.first + self.step * (self.density.shape[1] - 1)
        ends = np.concatenate([-self.first / self.slope, -last / self.slope])
        zero = np.zeros(level.shape)
        return _root(
            lambda t: (1.0 - self.probability(t, zero)) - level,
            np.full(level.shape, ends.min()),
            np.full(level.shape, ends.max()),
        )

    def slopes(self, level: FloatArray) -> FloatArray:
        """Quantiles of b, (n_level,)."""
        below = np.cumsum(self.mass) - 0.5 * self.mass - np.gradient(self.mass) / 12.0
        return np.exp(np.interp(level, np.maximum.accumulate(below), np.log(self.slope)))

    def correlation(self) -> float:
        """Of ln theta and beta, both cut at their 1 and 99 % quantiles."""
        node = self.first[:, None] + self.step[:, None] * np.arange(self.density.shape[1])
        weight = self.density * (self.step * self.mass)[:, None]
        tails = np.array([0.01, 0.99])
        t = np.clip(-node / self.slope[:, None], *self.log_medians(tails))
        beta = np.clip(1.0 / self.slope, *(1.0 / self.slopes(tails)[::-1]))[:, None]
        weight = weight / weight.sum()
        t, beta = t - (weight * t).sum(), beta - (weight * beta).sum()
        scale = np.sqrt((weight * t * t).sum() * (weight * beta * beta).sum())
        return float((weight * t * beta).sum() / scale)


def line_grid(
    log_density: LogDensity, x: FloatArray, n_row: int = 40, n_node: int = 36
) -> LineGrid:
    """Lay a grid where a density of (a, ln b) is.

    Parameters
    ----------
    log_density : callable
        Of intercepts (n_row, n_node) and slopes (n_row,); with one peak along each row, and of
        the masses of the rows. Levels far apart from one another are where (a, b) matters, so
        the search spans all lines that change somewhere between or near the levels.
    x : ndarray, (n_level,)
        Distinct levels, at least two.
    """
    x = np.sort(x)
    low = np.log(1e-4 / (x[-1] - x[0]))
    high = np.log(20.0 / np.diff(x).min())
    for _ in range(12):
        rows = np.linspace(low, high, 16)
        slope = np.exp(rows)
        mass = _rows(log_density, slope, *_limits(log_density, slope, x), 12)[0]
        kept = np.flatnonzero(mass > mass.max() - _DEPTH)
        low, high = rows[max(kept[0] - 1, 0)], rows[min(kept[-1] + 1, rows.size - 1)]
        if kept.size >= 7:
            break
    slope = np.exp(np.linspace(low, high, n_row))
    first, last = _limits(log_density, slope, x)
    mass, step, density = _rows(log_density, slope, first, last, n_node)
    rate = np.gradient(density, axis=1)
    below = np.cumsum(density, axis=1) - 0.5 * (density + density[:, :1])
    below -= (rate - rate[:, :1]) / 12.0
    below = np.maximum.accumulate(np.clip(below, 0.0, None), axis=1)
    total = below[:, -1:]
    mass = np.exp(mass - mass.max())
    return LineGrid(
        slope, mass / mass.sum(), first, step, density / (total * step[:, None]), below / total
    )


def _limits(log_density, slope: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Intercepts between which each row has its mass."""
    first, last = -_REACH - slope * x[-1], _REACH - slope * x[0]
    fraction = np.linspace(0.0, 1.0, 12)
    row = np.arange(slope.size)
    for _ in range(30):
        node = first[:, None] + (last - first)[:, None] * fraction
        value = log_density(node, slope)
        kept = value > value.max(axis=1, keepdims=True) - _DEPTH
        begin = np.maximum(kept.argmax(axis=1) - 1, 0)
        end = fraction.size - 1 - np.maximum(kept[:, ::-1].argmax(axis=1) - 1, 0)
        first, last = node[row, begin], node[row, end]
        if np.all(end - begin >= 7):
            break
    return first, last


def _rows(log_density, slope, first, last, n_node):
    """Log mass (n_row,), step (n_row,) and density by node relative to its greatest."""
    step = (last - first) / (n_node - 1)
    value = log_density(first[:, None] + step[:, None] * np.arange(n_node), slope)
    top = value.max(axis=1, keepdims=True)
    density = np.exp(value - top)
    return top[:, 0] + np.log(density.sum(axis=1) * step), step, density


def _root(function, low: FloatArray, high: FloatArray) -> FloatArray:
    """Where increasing functions cross zero, by halving."""
    low, high = low.copy(), high.copy()
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        less = function(middle) < 0.0
        low, high = np.where(less, middle, low), np.where(less, high, middle)
    return 0.5 * (low + high)
