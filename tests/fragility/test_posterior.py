"""Posterior: brute-force integration, exact limits, small samples."""

import numpy as np
import pytest
from scipy.special import log_ndtr, ndtr
from scipy.stats import chi2, norm, t

from archfrag.fragility.posterior import fit_capacity_posterior, fit_posterior
from archfrag.fragility.verdicts import find_brackets

INF = np.inf
TAILS = np.array([0.05, 0.5, 0.95])


class BruteForce:
    """Sums over a fixed mesh of (a, ln b), each quantile by sorting all of it."""

    def __init__(self, log_weight, reach=30.0):
        a = np.linspace(-reach, reach, 1001)[:, None]
        b = np.exp(np.linspace(np.log(5e-3), np.log(200.0), 700))
        weight = log_weight(a, b)
        self.weight = np.exp(weight - weight.max()).ravel()
        self.weight /= self.weight.sum()
        row = self.weight.reshape(weight.shape).sum(axis=0)[::-1]
        self.of_beta = np.cumsum(row) - 0.5 * row, -np.log(b[::-1])
        self.a, self.b = (np.broadcast_to(v, weight.shape) for v in (a, b))

    def quantiles(self, values):
        values = values.ravel()
        order = np.argsort(values)
        below = np.cumsum(self.weight[order]) - 0.5 * self.weight[order]
        return np.interp(TAILS, below, values[order])

    def check(self, known, intensities):
        """Quantiles of theta, of beta (by its own sum: sorted values come in steps), of P."""
        theta = np.exp(self.quantiles(-self.a / self.b))
        assert known.with_band([]).theta_interval == pytest.approx(
            theta[[0, 2]], rel=5e-3
        )
        assert known.curve.theta == pytest.approx(theta[1], rel=2e-3)
        beta = np.exp(np.interp(TAILS, *self.of_beta))
        assert known.with_band([]).beta_interval == pytest.approx(
            beta[[0, 2]], rel=5e-3
        )
        assert known.curve.beta == pytest.approx(beta[1], rel=2e-3)
        for im in intensities:
            p = self.quantiles(ndtr(self.a + self.b * np.log(im)))
            assert known.band(im) == pytest.approx(p[[0, 2]], abs=1e-3)


def run_weight(x, k, n):
    """Likelihood, determinant in (ln theta, beta) and factor, by their definitions."""

    def log_weight(a, b):
        theta = -a / b
        beta = 1.0 / b
        value = 0.0
        information = np.zeros((3, *np.broadcast_shapes(a.shape, b.shape)))
        for level, fell, runs in zip(x, k, n, strict=True):
            z = (level - theta) / beta
            value = value + fell * log_ndtr(z) + (runs - fell) * log_ndtr(-z)
            weight = (
                runs
                * np.exp(2.0 * norm.logpdf(z) - log_ndtr(z) - log_ndtr(-z))
                / beta**2
            )
            information += np.stack([weight, weight * z, weight * z * z])
        determinant = np.maximum(
            information[0] * information[2] - information[1] ** 2, 1e-300
        )
        to_mesh = 2.0 * np.log(beta)
        factor = -np.log(1.0 / beta + beta / max(0.3 * (max(x) - min(x)), 0.35) ** 2)
        return value + 0.5 * np.log(determinant) + factor + to_mesh

    return log_weight


class TestRuns:
    IM = np.array([0.5, 0.7, 0.9, 1.1, 1.4])

    @pytest.mark.parametrize("k", [(0, 1, 1, 2, 3), (0, 0, 2, 3, 3)])
    def test_brute_force(self, k):
        x = np.log(self.IM)
        n = np.full(5, 3)
        BruteForce(run_weight(x, k, n)).check(
            fit_posterior(self.IM, k, n), (0.6, 0.9, 1.3)
        )

    @pytest.mark.parametrize("k", [[0] * 5, [1] * 5, [0, 0, 1, 1, 1], [1, 0, 1, 0, 1]])
    def test_always_a_band(self, k):
        known = fit_posterior(self.IM, k, 1, one_sided=True)
        im = np.concatenate([[0.0], np.geomspace(0.05, 20.0, 60), [INF]])
        lower, upper = known.band(im)
        assert np.all((lower >= 0.0) & (upper <= 1.0))
        assert np.all(lower <= upper)
        for end in (lower, upper):
            assert np.all(np.diff(end) >= -1e-9)
            assert (end[0], end[-1]) == (0.0, 1.0)
        low, high = known.with_band([]).beta_interval
        assert 0.0 < low < known.curve.beta < high
        assert np.isfinite(known.curve.log_likelihood)


class TestCapacities:
    LEVELS = np.array([0.2, 0.3, 0.4, 0.5, 0.7])
    BELOW = np.array([0, 1, 2, 2, 3, 3, 4, 5])  # levels that each record survived

    def test_brute_force(self):
        known = fit_capacity_posterior(
            find_brackets(np.arange(5) >= self.BELOW[:, None], self.LEVELS)
        )
        low = np.append(0.0, self.LEVELS)[self.BELOW]
        high = np.append(self.LEVELS, INF)[self.BELOW]
        with np.errstate(divide="ignore"):
            low = np.log(low)
            high = np.log(high)
        width = np.median((high - low)[1:-1])
        span = np.log(0.7 / 0.2)

        def log_weight(a, b):
            beta = 1.0 / b
            mass = 1.0
            for x, y in zip(low, high, strict=True):
                mass = mass * np.maximum(ndtr(a + b * y) - ndtr(a + b * x), 1e-30)
            prior = beta / (beta**2 + width**2 / 12.0) / (1.0 + (beta / span) ** 2)
            return np.log(mass) + np.log(prior) + 2.0 * np.log(beta)

        BruteForce(log_weight, reach=40.0).check(known, (0.25, 0.4, 0.8))

    def test_narrow_brackets_are_a_normal_sample(self):
        """Student's t and chi-square, but for the effect of the finite span of levels."""
        logs = np.random.default_rng(3).normal(0.0, 0.35, 40)
        levels = np.exp(logs[:, None] + [-1e-3, 1e-3])
        known = fit_capacity_posterior(find_brackets([[0, 1]] * 40, levels))
        mean = logs.mean()
        deviation = logs.std(ddof=1)
        reach = t.ppf(0.95, 39) * deviation / np.sqrt(40)
        ends = [mean - reach, mean + reach]
        assert np.log(known.with_band([]).theta_interval) == pytest.approx(
            ends, abs=2e-3
        )
        betas = deviation * np.sqrt(39 / chi2.ppf([0.95, 0.05], 39))
        assert known.with_band([]).beta_interval == pytest.approx(betas, rel=1e-2)

    def test_one_capacity_that_agrees_with_all_still_gives_a_curve(self):
        known = fit_capacity_posterior(find_brackets([[0, 1]] * 6, [0.3, 0.4]))
        low, high = known.with_band([]).theta_interval
        assert 0.28 < low < 0.35 < high < 0.43
        assert known.with_band([]).beta_interval[1] < np.log(0.4 / 0.3)
