"""Samples of uncertain parameters.

Points fill the unit cube evenly (quasi-Monte Carlo), a Gaussian copula correlates their
coordinates, and the quantile function of each marginal makes a coordinate a value.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri
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
        """Values that are not exceeded with the probabilities given, same shape."""
        low, high = self.full.cdf([self.lower, self.upper]).tolist()
        if high - low < LEAST_KEPT:
            raise InputError(
                f"only {max(high - low, 0.0):.1g} of the distribution lies between lower = "
                f"{self.lower:g} and upper = {self.upper:g}; it must be at least {LEAST_KEPT:g}"
            )
        inside = low + np.asarray(probability, dtype=float) * (high - low)
        return np.clip(self.full.ppf(inside), self.lower, self.upper)


def correlation_factor(
    names: Sequence[str], correlation: Mapping[str, Mapping[str, float]]
) -> FloatArray:
    """Lower triangular factor of a correlation matrix, (n, n), rows and columns as in `names`.

    `correlation` maps names to mappings of names to coefficients; other pairs are not correlated.
    """
    matrix = np.eye(len(names))
    pairs = [(a, b, rho) for a, others in correlation.items() for b, rho in others.items()]
    for one, other, coefficient in pairs:
        if {one, other} - set(names) or not -1.0 < coefficient < 1.0 or one == other:
            raise InputError(
                f"correlation of {one} and {other} = {coefficient:g} must be greater than -1 and "
                f"less than 1, of two of the parameters that vary ({', '.join(names)})"
            )
        i, j = names.index(one), names.index(other)
        if matrix[i, j] != 0.0:
            raise InputError(f"correlation of {one} and {other}: is given twice")
        matrix[i, j] = matrix[j, i] = coefficient
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise InputError(
            "the correlations cannot hold together (their matrix is not positive definite); make "
            "them smaller or give those that are missing"
        ) from None


def sample(
    marginals: Mapping[str, Marginal], count: int, *, scheme: Scheme = "sobol",
    seed: int | Sequence[int] = 1, correlation: Mapping[str, Mapping[str, float]] | None = None,
) -> dict[str, FloatArray]:  # fmt: skip
    """Sample parameters with given distributions and correlations, `count` values of each.

    `scheme` is Sobol's sequence, scrambled (Owen 1998): the first samples of a longer design are
    those of a shorter one, and its one- and two-dimensional projections are even if `count` is a
    power of two. Or it is the Latin hypercube (McKay, Beckman and Conover 1979), for any `count`:
    one sample in each of `count` slices of every parameter.

    `correlation` is as in `correlation_factor`: coefficients rho of the Gaussian copula, which are
    the correlations of the normal scores (of the logarithms, if both are lognormal). The rank
    correlation by Spearman is then 6/pi arcsin(rho/2).
    """
    names, generator = list(marginals), np.random.default_rng(seed)
    if not names:
        return {}
    if scheme == "sobol":
        power = max(count - 1, 0).bit_length()
        design = qmc.Sobol(len(names), scramble=True, seed=generator)
        points = design.random_base2(power)[:count]
    else:
        points = qmc.LatinHypercube(len(names), seed=generator).random(count)
    points = np.clip(points, _EDGE, 1.0 - _EDGE)
    if correlation:
        points = ndtr(ndtri(points) @ correlation_factor(names, correlation).T)
    return {
        name: to_digits(marginals[name].quantile(points[:, i])) for i, name in enumerate(names)
    }


def to_digits(values: ArrayLike) -> FloatArray:
    """Values to `DIGITS` significant digits, same shape."""
    array = np.asarray(values, dtype=float)
    return np.array([float(f"{v:.{DIGITS}g}") for v in array.ravel()]).reshape(array.shape)
