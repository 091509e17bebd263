"""Probability that a collapse takes a part of a bridge: a curve of collapse, divided.

P(collapse in part k | im) = P(collapse | im) q_k(im), where q_k is the share of the part in the
collapses near im. A collapse has one part, so that the parts add up to the curve.

Numbers of collapses at the levels are averaged with normal weights in ln im, of deviation 0.3;
beyond the levels with collapses they are those at the nearest of them. With the prior 1 / n_part
for each part they are a Dirichlet density of the shares, whose mean q_k is. Records that resemble
each other count as fewer (`contributions`: n_effective). The band is from draws of theta and beta,
and of the shares.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv, ndtr

from archfrag.fragility.curve import Curve, FloatArray, log_intensity, tails
from archfrag.fragility.risk import Contributions

_WIDTH = 0.3
_DRAWS = 2000
_SEED = 5


def divide(
    curve: Curve, split: Contributions, levels: ArrayLike, im: ArrayLike
) -> FloatArray:
    """Return the probability of a collapse in each part, and both ends of its band.

    `split` has the collapses of each part at `levels`, (n_level,); `im`, (n,), are intensities >=
    0 in the same unit. The result is (3, n_part, n); the first row adds up to the curve.
    """
    x = log_intensity(im)
    seen = _near(split, np.log(levels), x)
    points = np.random.default_rng(_SEED).random((_DRAWS, len(seen), 1))
    draws = gammaincinv(seen, points)  # of all intensities alike: smooth bands
    theta, beta = np.reshape(curve.draws(_SEED, _DRAWS), (2, -1, 1))
    drawn = ndtr((x - np.log(theta)) / beta) / draws.sum(axis=1)
    band = np.quantile(draws * drawn[:, None], tails(curve.confidence), axis=0)
    return np.stack([curve(im) * seen / seen.sum(axis=0), *band])


def _near(split: Contributions, logs: FloatArray, x: FloatArray) -> FloatArray:
    """Return the Dirichlet parameters of the shares at ln im `x`, (n_part, n).

    `logs` are those of the levels.
    """
    number = split.counts.sum(axis=0)
    near = np.clip(x, *logs[number > 0][[0, -1]])[:, None]
    weight = np.exp(-0.5 * ((near - logs) / _WIDTH) ** 2)
    seen = split.counts @ (weight / weight.sum(axis=1, keepdims=True)).T
    return seen * min(1.0, split.n_effective / number.max()) + 1.0 / len(seen)
