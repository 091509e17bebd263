"""What the dispersion of a fragility curve is made of, from outcomes of repeated studies.

A run collapses where ln level exceeds ln theta + beta Z with Z standard normal: the curve's own
law. Z is a sum of what the record brings, what changes from level to level of one record but
comes back in every repetition, and what comes back in none. Two runs that have a part in common
have its fraction of beta squared as correlation, and that is seen in how often their outcomes
agree: the tetrachoric correlation (Pearson 1900, Phil. Trans. R. Soc. A 195, 1-47).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import ndtr

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)
_LEAST, _NO_CHANCE = 1e-6, 1e-14


def both_below(first: Array, second: Array, correlation: float) -> Array:
    """Probability that two standard normal variables lie below two bounds, (n,) each.

    Plackett's integral over the correlation, with its sine as variable (Genz 2004, Statistics
    and Computing 14, 251-260).

    Examples
    --------
    >>> import numpy as np
    >>> from archbench.dispersion import both_below
    >>> both_below(np.zeros(1), np.zeros(1), 0.5).round(12).tolist()
    [0.333333333333]
    """
    end = np.arcsin(correlation)
    angle = 0.5 * end * (_NODES + 1.0)
    cosine = np.maximum(np.cos(angle) ** 2, 1e-300)
    a, b = first[:, None], second[:, None]
    height = np.exp(-0.5 * (a * a - 2.0 * a * b * np.sin(angle) + b * b) / cosine)
    chance = ndtr(first) * ndtr(second) + height @ _WEIGHTS * end / (4.0 * np.pi)
    return np.clip(chance, 0.0, 1.0)


def correlation_of(first: Array, second: Array, counts: tuple[Array, ...]) -> float:
    """Likeliest correlation of pairs of runs, from 0 to 1: 1 where no pair disagrees."""
    _, one, other, _ = counts
    apart = ((one > 0.0) & (first <= second)) | ((other > 0.0) & (second <= first))
    if not np.any(apart):
        return 1.0
    below = ndtr(first), ndtr(second)

    def loss(log_apart: float) -> float:
        both = both_below(first, second, 1.0 - np.exp(log_apart))
        chances = (both, below[0] - both, below[1] - both, 1.0 - below[0] - below[1] + both)
        return -sum(
            float(count @ np.log(np.maximum(chance, _NO_CHANCE)))
            for count, chance in zip(counts, chances, strict=True)
        )

    found = minimize_scalar(
        loss, bounds=(np.log(_LEAST), 0.0), method="bounded", options={"xatol": 1e-3}
    )
    return float(1.0 - np.exp(found.x))


class Parts(NamedTuple):
    """Fractions of beta squared; they add up to 1."""

    numerical: float
    level: float
    record: float


def parts_of(bound: Array, collapsed: Array, stood: Array) -> Parts:
    """Fractions of beta squared of one study made several times."""
    mixed = 0.5 * np.sum(collapsed * stood, axis=0)
    same = correlation_of(
        bound, bound,
        (np.sum(0.5 * collapsed * (collapsed - 1.0), axis=0), mixed, mixed,
         np.sum(0.5 * stood * (stood - 1.0), axis=0)),
    )  # fmt: skip
    low, high = np.triu_indices(bound.size, 1)
    runs = np.maximum(collapsed + stood, 1.0)
    fell, held = collapsed / runs, stood / runs
    counts = tuple(
        np.sum(one[:, low] * other[:, high], axis=0)
        for one, other in ((fell, fell), (fell, held), (held, fell), (held, held))
    )
    record = min(same, correlation_of(bound[low], bound[high], counts))
    return Parts(1.0 - same, same - record, record)
