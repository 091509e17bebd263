"""Distribution of the probit line on a grid that finds its own extent, and its quantiles.

Rows have one slope b = 1 / beta each, even in ln b; along a row the intercept a varies between
limits of its own. Every quantile that a curve needs is one of a + b x <= c, which is a sum of
distribution functions over the rows: of the probability at x with c unknown, of ln theta with
c = 0 and x unknown.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from archfrag.fragility.curve import FloatArray

LogDensity = Callable[[FloatArray, FloatArray], FloatArray]

_DEPTH, _ROW_DEPTH = 18.0, 9.0
_REACH = 9.0
_HALVINGS = 38
_ROWS, _NODES = 28, 28


@dataclass(frozen=True)
class LineGrid:
    """Distribution of (a, b) of z = a + b x, row by row; `line_grid` lays them even in ln b."""

    slope: FloatArray  #: (n_row,), b
    mass: FloatArray  #: (n_row,), sums to 1
    first: FloatArray  #: (n_row,), intercepts of row i are first + step j
    step: FloatArray  #: (n_row,)
    density: FloatArray  #: (n_row, n_node), of the intercept within its row
    below: FloatArray  #: (n_row, n_node), its integral up to the node

    def flatter(self, variance: float, middle: float, stretch: float) -> "LineGrid":
        """The same with `variance` added to the 1 / b^2 of each row, and its a / b kept.

        Then ln b is stretched about ln `middle` by the factor `stretch`.
        """
        slope = middle * (self.slope**-2 + variance) ** (-0.5 * stretch) / middle**stretch
        factor = slope / self.slope
        return replace(
            self, slope=slope, first=self.first * factor, step=self.step * factor,
            density=self.density / factor[:, None],
        )  # fmt: skip

    def probability(self, x: FloatArray, c: FloatArray) -> FloatArray:
        """P(a + b x <= c), shape of x and c."""
        place = (c[..., None] - self.slope * x[..., None] - self.first) / self.step
        last = self.density.shape[1] - 1
        node = np.clip(place.astype(np.int64), 0, last - 1)
        t = np.clip(place - node, 0.0, 1.0)
        row = np.arange(self.slope.size)
        low, high = self.below[row, node], self.below[row, node + 1]
        p, q = self.density[row, node] * self.step, self.density[row, node + 1] * self.step
        return _cubic(t, low, high, p, q) @ self.mass

    def probits(self, x: FloatArray, level: FloatArray) -> FloatArray:
        """Quantiles of a + b x at each x: (n_level, n_x)."""
        rise, last = np.multiply.outer(x, self.slope), self.density.shape[1] - 1
        low = (self.first + rise).min(axis=1)
        high = (self.first + self.step * last + rise).max(axis=1)
        xs, low, high = (np.broadcast_to(v, (level.size, x.size)) for v in (x, low, high))
        return root(lambda c: self.probability(xs, c) - level[:, None], low, high)

    def log_medians(self, level: FloatArray) -> FloatArray:
        """Quantiles of ln theta = -a / b, (n_level,)."""
        last = self.first + self.step * (self.density.shape[1] - 1)
        ends = np.concatenate([-self.first / self.slope, -last / self.slope])
        low, high = (np.full(level.shape, end) for end in (ends.min(), ends.max()))
        zero = np.zeros(level.shape)
        return root(lambda t: (1.0 - self.probability(t, zero)) - level, low, high)

    def slopes(self, level: FloatArray) -> FloatArray:
        """Quantiles of b, (n_level,)."""
        below = _integral(self.mass[None])[0]
        below, density = below / below[-1], self.mass / below[-1]

        def less(place: FloatArray) -> FloatArray:
            node = np.minimum(place.astype(np.int64), self.mass.size - 2)
            low, high = below[node], below[node + 1]
            return _cubic(place - node, low, high, density[node], density[node + 1]) - level

        rows = np.full(level.shape, self.mass.size - 1.0)
        place = root(less, 0.0 * rows, rows)
        return np.exp(np.interp(place, np.arange(self.mass.size), np.log(self.slope)))

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
    log_density: LogDensity, x: FloatArray, slopes: tuple[float, float] | None = None
) -> LineGrid:
    """Lay a grid where a density of (a, ln b) is, with one peak along each row and over the rows.

    `log_density` takes intercepts (n_row, n_node) and slopes (n_row,). The search spans all lines
    that rise near or between the distinct levels `x`, at least two, or the given `slopes`.
    """
    x = np.sort(x)
    low, high = slopes or (1e-4 / (x[-1] - x[0]), 20.0 / np.diff(x).min())
    low, high = np.log(low), np.log(high)
    for _ in range(12):
        rows = np.linspace(low, high, 16)
        limits = _limits(log_density, np.exp(rows), x)
        mass = _rows(log_density, np.exp(rows), *limits, 12)[0]
        kept = np.flatnonzero(mass > mass.max() - _ROW_DEPTH)
        low, high = rows[max(kept[0] - 1, 0)], rows[min(kept[-1] + 1, rows.size - 1)]
        if kept.size >= 7:
            break
    fine = np.linspace(low, high, _ROWS if slopes else 2 * _ROWS)
    slope = np.exp(fine)
    first, last = (np.interp(fine, rows, limit) for limit in limits)
    mass, step, density = _rows(log_density, slope, first, last, _NODES)
    below = _integral(density)
    total = below[:, -1:]
    mass = np.exp(mass - mass.max())
    return LineGrid(
        slope, mass / mass.sum(), first, step, density / (total * step[:, None]), below / total
    )


def _limits(
    log_density: LogDensity, slope: FloatArray, x: FloatArray
) -> tuple[FloatArray, FloatArray]:
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


def _rows(
    log_density: LogDensity, slope: FloatArray, first: FloatArray, last: FloatArray, n_node: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log mass (n_row,), step (n_row,) and density by node relative to its greatest."""
    step = (last - first) / (n_node - 1)
    value = log_density(first[:, None] + step[:, None] * np.arange(n_node), slope)
    top = value.max(axis=1, keepdims=True)
    density = np.exp(value - top)
    return top[:, 0] + np.log(density.sum(axis=1) * step), step, density


def _integral(density: FloatArray) -> FloatArray:
    """Integral of rows up to each node at unit step: trapezia with their end correction."""
    rate = np.gradient(density, axis=1)
    below = np.cumsum(density, axis=1) - 0.5 * (density + density[:, :1])
    below -= (rate - rate[:, :1]) / 12.0
    return np.maximum.accumulate(np.clip(below, 0.0, None), axis=1)


def _cubic(
    t: FloatArray, low: FloatArray, high: FloatArray, p: FloatArray, q: FloatArray
) -> FloatArray:
    """Hermite's cubic between values `low`, `high` with slopes `p`, `q`, at 0 <= t <= 1."""
    rise = high - low
    return low + t * (p + t * (3.0 * rise - 2.0 * p - q + t * (p + q - 2.0 * rise)))


def root(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray,
    halvings: int = _HALVINGS,
) -> FloatArray:  # fmt: skip
    """Where increasing functions cross zero, by halving."""
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        less = function(middle) < 0.0
        low, high = np.where(less, middle, low), np.where(less, high, middle)
    return 0.5 * (low + high)
