"""Probability density of ln theta and ln beta on a grid: quantiles, draws, and a compact copy."""

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # whose parts are loaded when they are used
from numpy.typing import ArrayLike, NDArray

from archfrag.files import Named

FloatArray = NDArray[np.float64]
Pair = tuple[FloatArray, FloatArray]
Triple = tuple[FloatArray, FloatArray, FloatArray]
_HALVINGS = 30


@dataclass(frozen=True, eq=False)
class Density:
    """Probability density of theta and beta on a grid of ln theta and ln beta."""

    beta: FloatArray  #: (n_row,), rising, evenly spaced in ln
    log_theta: FloatArray  #: (n_row, n_node), evenly spaced in each row
    density: (
        FloatArray  #: (n_row, n_node), probability of one step of ln theta at each node
    )

    def deviations(self, x: FloatArray, level: FloatArray) -> FloatArray:
        """Return quantiles of (x - ln theta) / beta at ln intensities `x`.

        `level` are the probabilities of the quantiles; it broadcasts with `x`.
        """
        at = x[..., None]
        z = (at[..., None] - self.log_theta[:, [0, -1]]) / self.beta[:, None]
        return _root(
            lambda z: 1.0 - self._below(at - z[..., None] * self.beta) - level,
            z.min(axis=(-1, -2)),
            z.max(axis=(-1, -2)),
        )

    def log_thetas(self, level: ArrayLike) -> FloatArray:
        """Return the quantiles of ln theta at probabilities `level`, of any shape."""
        return _root(
            lambda t: self._below(t[..., None]) - np.asarray(level),
            np.full(np.shape(level), self.log_theta.min()),
            self.log_theta.max(),
        )

    def betas(self, level: Sequence[float]) -> FloatArray:
        """Return the quantiles of beta at probabilities `level`, (n,)."""
        row = np.arange(self.beta.size)
        below = scipy.interpolate.PchipInterpolator(
            row, self._cumulative[:, -1]
        ).antiderivative()
        total = below(row[-1])
        place = [below.solve(each * total, extrapolate=False)[0] for each in level]
        return np.exp(np.interp(place, row, np.log(self.beta)))

    def draws(self, seed: int, number: int) -> Pair:
        """Draw ln theta and beta, (number,) each, by stratified sampling.

        The probability is divided into `number` equal parts, and one pair is drawn from each.
        """
        generator = np.random.default_rng(seed)
        nodes = np.cumsum(np.diff(self._cumulative, axis=1, prepend=0.0))
        part = nodes[-1] * (np.arange(number) + generator.random(number)) / number
        row = np.searchsorted(nodes, part) // self.density.shape[1]
        step = np.log(self.beta[1] / self.beta[0])
        beta = self.beta[row] * np.exp(step * (generator.random(number) - 0.5))
        # No draw lies between two rows, whose ends have no probability.
        return np.interp(part, nodes, self.log_theta.ravel()), beta

    def moved(self, shift: float) -> "Density":
        """Return the density with `shift` added to ln theta, as for another unit."""
        return replace(self, log_theta=self.log_theta + shift)

    def to_plain(self) -> Named:
        """Return the density as plain values for JSON, its probabilities with 16 bits."""
        relative = np.asarray(self.density / self.density.max(), "<f2")
        return {
            "beta": self.beta.tolist(),
            "log_theta": self.log_theta[:, [0, -1]].tolist(),
            "density": base64.b64encode(relative.tobytes()).decode(),
        }

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> "Density":
        """Return the density that `to_plain` wrote."""
        values = np.frombuffer(base64.b64decode(plain["density"]), "<f2").astype(float)
        values = values.reshape(len(plain["beta"]), -1)
        first, last = np.array(plain["log_theta"], float).T
        log_theta = np.linspace(first, last, values.shape[1], axis=1)
        values /= (values.sum(axis=1) - 0.5 * (values[:, 0] + values[:, -1])).sum()
        return cls(np.array(plain["beta"], float), log_theta, values)

    def compact(self) -> "Density":
        """Return the density with every other row only, as `to_plain` stores it.

        Quantiles of P(collapse) agree with those of all rows to 1e-4.
        """
        rows = (each[::2] for each in (self.beta, self.log_theta, self.density))
        return Density.from_plain(Density(*rows).to_plain())

    @cached_property
    def _cumulative(self) -> FloatArray:
        """Return the probability of each row up to each node, (n_row, n_node)."""
        middle = 0.5 * (self.density[:, 1:] + self.density[:, :-1])
        return np.pad(np.cumsum(middle, axis=1), ((0, 0), (1, 0)))

    def _below(self, limit: FloatArray) -> FloatArray:
        """Return P(ln theta <= limit) with a limit for each row, (..., n_row)."""
        first, second = self.log_theta[:, :2].T
        last = self.density.shape[1] - 1
        place = np.clip((limit - first) / (second - first), 0.0, last)
        node = np.minimum(place.astype(np.int64), last - 1)
        t = place - node
        row = np.arange(first.size)
        low = self.density[row, node]
        rise = self.density[row, node + 1] - low
        below = self._cumulative[row, node] + t * (low + 0.5 * t * rise)
        return below.sum(axis=-1)


def _root(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Find the zeros of increasing functions between `low` and `high`, by bisection."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        less = function(middle) < 0.0
        low = np.where(less, middle, low)
        high = np.where(less, high, middle)
    return 0.5 * (low + high)
