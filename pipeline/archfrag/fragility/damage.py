"""Posterior of the curve of a limit state, from runs whose levels were chosen by collapse.

A search for collapse chooses its levels by verdicts of collapse alone. Such a choice can be left
out of the likelihood of both states together (Rubin 1976, Biometrika 63), while the likelihood of
the lighter state alone is biased: its median was 7 to 50 % too low.
"""

from collections.abc import Callable

import numpy as np
import scipy  # whose parts are loaded when they are used
from scipy.special import chdtri, ndtr, ndtri, softmax

from archfrag.errors import FitError
from archfrag.fragility.curve import FloatArray, Pair
from archfrag.fragility.posterior import ONE_LEVEL, Posterior, capacity_prior, gridded
from archfrag.fragility.verdicts import Brackets

LEAST_BELOW = 0.3  # fraction of the records that have a run below the state
# Prior of the correlation r, (1 + r)^6, and standard deviation of ln of the ratio of both betas:
# in the shipped study by stripes r is 0.97 or more, and the betas differ by up to 6 %.
_ALIKE = 6.0
_UNLIKE = 0.5
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_POINTS = 1024  # of importance sampling by Student's t
_ITERATIONS = 7
_FREEDOM = 5.0
_LEAST_SHARE = 0.05  # of the points that count in an iteration
_KERNEL = 0.15  # standard deviation of a point's kernel, over that of all points
_SIZE = (72, 96)  # of the grid, and its half width in standard deviations
_REACH = 6.0


def fit_state_posterior(
    collapse: Brackets, state: Brackets, number: float
) -> Posterior:
    """Return the posterior of the curve of a limit state that is lighter than collapse.

    `collapse` are the brackets of collapse. `state` are brackets from the runs that did not
    collapse, where a verdict of collapse stands for exceedance of the state. `number` is the
    effective number of records. ln S and ln C of a record, capacities for the state and for
    collapse, are bivariate normal. The curve is that of min(S, C), lognormal with the mean and the
    standard deviation of its logarithm (Clark 1961, Oper. Res. 9). Points are drawn by population
    Monte Carlo (Cappe, Guillin, Marin and Robert 2004, J. Comput. Graph. Stat. 13). FitError
    unless enough records have a run below the state.
    """
    known = collapse.run
    share = (state.lower[known] > 0.0).mean()
    if share < LEAST_BELOW:
        raise FitError(
            f"only {100.0 * share:.0f} % of the records have a run below it, and "
            f"{100.0 * LEAST_BELOW:.0f} % are needed"
        )
    ends = np.vstack([collapse.logs, state.logs])[:, known]
    rows, count = np.unique(ends, axis=1, return_counts=True)
    levels = [np.unique(pair[np.isfinite(pair)]) for pair in (rows[:2], rows[2:])]
    if min(x.size for x in levels) < 2:
        raise FitError(ONE_LEVEL)
    steps = [np.median(np.diff(x)) for x in levels]

    def density(points: FloatArray) -> FloatArray:
        """Return ln of the posterior density at points; `_both` says what they hold."""
        logs = points[:, [1, 3]]
        r = np.clip(np.tanh(points[:, 4]), -1.0 + 1e-12, 1.0 - 1e-12)
        prior = sum(map(capacity_prior, np.exp(logs).T, steps, levels))
        prior += np.log1p(-r * r) + _ALIKE * np.log1p(r)
        prior -= 0.5 * (np.diff(logs)[:, 0] / _UNLIKE) ** 2
        return np.asarray(_both(points, rows) @ (count * number / known.sum()) + prior)

    points, weight = _sampled(density, *map(np.median, levels))
    log_theta, beta = _of_lesser(points)
    sizes = levels[1].size, max(1, round(number))
    return smoothed(np.stack([np.log(beta), log_theta]), weight, sizes)


def smoothed(
    points: FloatArray, weight: FloatArray, sizes: tuple[int, int]
) -> Posterior:
    """Return the posterior of weighted points of (ln beta, ln theta), (2, n_point), on a grid.

    `sizes` are as for `gridded`.
    """
    centre = points @ weight
    spread = np.sqrt(np.diag(np.cov(points, aweights=weight)))
    axes = [np.linspace(-_REACH, _REACH, size) for size in _SIZE]
    kernels = [
        np.exp(-0.5 * ((axis[:, None] - z) / _KERNEL) ** 2)
        for axis, z in zip(axes, (points - centre[:, None]) / spread[:, None])
    ]
    rise, run = (c + s * axis for c, s, axis in zip(centre, spread, axes))
    return gridded(
        np.exp(rise),
        np.tile(run, (rise.size, 1)),
        (kernels[0] * weight) @ kernels[1].T,
        sizes,
    )


def _sampled(
    density: Callable[[FloatArray], FloatArray], collapse: float, state: float
) -> Pair:
    """Draw points of the posterior, (n_point, 5), and return them with their weights.

    `density` returns ln of the posterior density at points. `collapse` and `state` are the ln
    medians at which the search begins.
    """
    uniform = np.clip(
        scipy.stats.qmc.Sobol(6, seed=1).random(_POINTS), 1e-9, 1.0 - 1e-9
    )
    t = ndtri(uniform[:, :5]) * np.sqrt(_FREEDOM / chdtri(_FREEDOM, uniform[:, 5:]))
    log_t = -0.5 * (_FREEDOM + 5.0) * np.log1p((t * t).sum(axis=1) / _FREEDOM)
    centre = np.array([collapse, -1.0, state, -1.0, 1.0])
    spread = 0.16 * np.eye(5)
    for _ in range(_ITERATIONS):
        points = centre + t @ np.linalg.cholesky(spread).T
        logs = density(points) - log_t
        power = 1.0
        weight = softmax(logs)
        # The first iterations are far off.
        while (weight**2).sum() * _LEAST_SHARE * _POINTS > 1.0:
            power *= 0.7
            weight = softmax(power * logs)
        centre = weight @ points
        spread = np.cov(points.T, aweights=weight) + 1e-8 * np.eye(5)
    return points, weight


def _both(points: FloatArray, rows: FloatArray) -> FloatArray:
    """Return ln of the probability that both capacities lie in their brackets, (n_point, n_row).

    A row of `points`, (n_point, 5), holds the mean of ln C and ln of its standard deviation, the
    same two of ln S, and Fisher's z of their correlation. `rows`, (4, n_row), hold ln of the ends
    of the brackets of C and of S.
    """
    mean_c, log_c, mean_s, log_s, fisher = points.T[:, :, None]
    r = np.tanh(fisher)
    chance = 0.0
    low, high = ndtr((rows[:2, None] - mean_c) * np.exp(-log_c))
    ends = (rows[2:, None] - mean_s) * np.exp(-log_s)
    for node, weight in zip(_NODES, _WEIGHTS):  # of Gauss, in the probability of C
        at = 0.5 * (low + high + node * (high - low))
        z = ndtri(np.clip(at, 1e-14, 1.0 - 1e-14))
        below, above = ndtr((ends - r * z) * np.cosh(fisher))
        chance = chance + weight * (above - below)
    return np.asarray(np.log(np.maximum(0.5 * (high - low) * chance, 1e-300)))


def _of_lesser(points: FloatArray) -> Pair:
    """Return the mean and the standard deviation of ln min(S, C) at points.

    `_both` says what the points hold.
    """
    mean_c, log_c, mean_s, log_s, fisher = points.T
    beta_c = np.exp(log_c)
    beta_s = np.exp(log_s)
    shared = 2.0 * np.tanh(fisher) * beta_c * beta_s
    apart = np.sqrt(beta_c**2 + beta_s**2 - shared) + 1e-9
    z = (mean_c - mean_s) / apart
    first = ndtr(z)
    other = 1.0 - first
    both = apart * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    mean = mean_s * first + mean_c * other - both
    s = mean_s - mean
    c = mean_c - mean
    square = (s**2 + beta_s**2) * first + (c**2 + beta_c**2) * other - (s + c) * both
    return mean, np.sqrt(np.maximum(square, 1e-12))
