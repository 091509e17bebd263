"""Samples of uncertain parameters.

Points fill the unit cube evenly (quasi-Monte Carlo), and the quantile function of each marginal
makes a coordinate a value.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc

from archfrag.errors import InputError

FloatArray = NDArray[np.float64]
Scheme = Literal["sobol", "latin_hypercube"]
# Distance of a point from the faces of the unit cube, where quantiles may be infinite.
_EDGE = 2.0**-32
# Probability that truncation has to leave; below it the bounds were mistaken.
LEAST_KEPT = 1e-6
# Of a value: the same number on every machine, whatever the last digits of its quantile function.
DIGITS = 10


@dataclass(frozen=True)
class Marginal:
    """A distribution, truncated if it has bounds."""

    full: Any  # without truncation, of `scipy.stats`
    lower: float = -math.inf
    upper: float = math.inf

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the values that are not exceeded with the probabilities given, same shape."""
        low, high = self.full.cdf([self.lower, self.upper]).tolist()
        if high - low < LEAST_KEPT:
            between = f"lies between lower = {self.lower:g} and upper = {self.upper:g}"
            few = f"only {max(high - low, 0.0):.1g} of the distribution {between}"
            raise InputError(f"{few}; it must be at least {LEAST_KEPT:g}")
        inside = low + np.asarray(probability, dtype=float) * (high - low)
        return np.clip(self.full.ppf(inside), self.lower, self.upper)


def sample(
    marginals: Mapping[str, Marginal],
    count: int,
    *,
    scheme: Scheme = "sobol",
    seed: int | Sequence[int] = 1,
) -> dict[str, FloatArray]:
    """Sample parameters with given distributions, `count` values of each.

    `scheme` is Sobol's sequence, scrambled (Owen 1998): the first samples of a longer design are
    those of a shorter one, and its one- and two-dimensional projections are even if `count` is a
    power of two. Or it is the Latin hypercube (McKay, Beckman and Conover 1979), for any `count`:
    one sample in each of `count` slices of every parameter.
    """
    names = list(marginals)
    generator = np.random.default_rng(seed)
    if not names:
        return {}
    if scheme == "sobol":
        power = max(count - 1, 0).bit_length()
        design = qmc.Sobol(len(names), scramble=True, seed=generator)
        points = design.random_base2(power)[:count]
    else:
        points = qmc.LatinHypercube(len(names), seed=generator).random(count)
    points = np.clip(points, _EDGE, 1.0 - _EDGE)
    return {
        name: to_digits(marginals[name].quantile(x)) for name, x in zip(names, points.T)
    }


def to_digits(values: ArrayLike) -> FloatArray:
    """Return the values to `DIGITS` significant digits, same shape."""
    array = np.asarray(values, dtype=float)
    return np.array([float(f"{v:.{DIGITS}g}") for v in array.ravel()]).reshape(
        array.shape
    )
