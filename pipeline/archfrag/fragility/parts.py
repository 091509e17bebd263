"""Probability that a collapse takes a part of a bridge: a curve of collapse, divided.

P(collapse in part k | im) = P(collapse | im) q_k(im), where q_k is the share of the part in the
collapses at im: q_k = exp(a_k + b_k x) / sum over parts, with x = ln im in deviations of the
levels of the collapses (multinomial logit). Beyond the levels with collapses the shares are those
at the nearest of them. A collapse has one part, so that the parts add up to the curve.

a_k and b_k are normal about 0 with deviations 2 and 1 before the runs are seen. The collapses of a
record count as one (`contributions`: n_effective). The band is from draws of theta and beta, and
of a and b by the normal density about their likeliest values (Laplace's approximation).
"""

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy.special import log_softmax, ndtr, softmax

from archfrag.fragility.curve import Curve, FloatArray, log_intensity, tails
from archfrag.fragility.risk import Contributions

_PRIOR = np.array([2.0, 1.0])
_DRAWS = 2000
_SEED = 5


def divide(
    curve: Curve, split: Contributions, levels: ArrayLike, im: ArrayLike
) -> FloatArray:
    """Return the probability of a collapse in each part, and both ends of its band.

    `split` has the collapses of each part at `levels`, (n_level,); `im`, (n,), are intensities >=
    0 in the same unit. The result is (3, n_part, n); the first row adds up to the curve.
    """
    number = split.counts.sum(axis=0)
    logs = np.log(levels)
    ends = logs[number > 0][[0, -1]]
    centre = np.average(logs, weights=number)
    width = np.sqrt(np.average((logs - centre) ** 2, weights=number)) or 1.0

    def rows(x: FloatArray) -> FloatArray:
        return np.stack([np.ones(x.size), (np.clip(x, *ends) - centre) / width])

    known = rows(logs)
    kept = split.n_effective / number.sum()
    size = len(split.counts)

    def loss(flat: FloatArray) -> tuple[float, FloatArray]:
        lines = flat.reshape(size, 2)
        z = lines @ known
        value = 0.5 * ((lines / _PRIOR) ** 2).sum()
        value -= kept * (split.counts * log_softmax(z, axis=0)).sum()
        slope = kept * (number * softmax(z, axis=0) - split.counts) @ known.T
        return value, (slope + lines / _PRIOR**2).ravel()

    def second(flat: FloatArray) -> FloatArray:
        q = softmax(flat.reshape(size, 2) @ known, axis=0)
        each = kept * number * (np.eye(size)[..., None] * q - q[:, None] * q)
        hessian = np.einsum("klm,im,jm->kilj", each, known, known)
        return hessian.reshape(2 * size, -1) + np.diag(np.tile(_PRIOR**-2.0, size))

    start = np.zeros(2 * size)
    found = scipy.optimize.minimize(
        loss, start, jac=True, hess=second, method="trust-exact"
    ).x
    generator = np.random.default_rng(_SEED)
    lines = generator.multivariate_normal(found, np.linalg.inv(second(found)), _DRAWS)
    x = log_intensity(im)
    shares = softmax(np.reshape([*lines, found], (-1, size, 2)) @ rows(x), axis=1)
    theta, beta = np.reshape(curve.draws(_SEED, _DRAWS), (2, -1, 1))
    drawn = shares[:-1] * ndtr((x - np.log(theta)) / beta)[:, None]
    band = np.quantile(drawn, tails(curve.confidence), axis=0)
    return np.stack([curve(im) * shares[-1], *band])
