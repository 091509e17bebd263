"""Lines of many data sets: other people's code, a search, weights, and data without a maximum."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit, ndtr
from scipy.stats import norm
from sklearn.linear_model import LogisticRegression

from archfrag.fragility.lines import binomial_lines, inverse_mills, log_between, normal_lines

LEVELS = np.geomspace(0.2, 1.5, 9)


class TestBinomial:
    def test_logistic_line_is_that_of_scikit_learn(self):
        generator = np.random.default_rng(2)
        n = generator.integers(5, 40, (1, LEVELS.size)).astype(float)
        collapses = generator.binomial(n.astype(int), ndtr(np.log(LEVELS / 0.6) / 0.4))
        x = np.concatenate([np.log(LEVELS)] * 2)[:, None]
        weight = np.concatenate([collapses[0], n[0] - collapses[0]])
        model = LogisticRegression(C=np.inf, tol=1e-10, max_iter=1000, solver="newton-cholesky")
        model.fit(x, np.repeat([1, 0], LEVELS.size), weight)
        lines = binomial_lines(np.log(LEVELS), collapses, n, "logistic")
        assert lines.slope[0] == pytest.approx(model.coef_[0, 0], rel=1e-6)
        assert lines.intercept[0] == pytest.approx(model.intercept_[0], rel=1e-6)

    @pytest.mark.parametrize(("link", "inverse"), [("probit", ndtr), ("logistic", expit)])
    def test_data_without_a_maximum_give_the_limit(self, link, inverse):
        """None, all, a step between and at levels, and fractions that fall."""
        rows = [[0] * 4, [2] * 4, [0, 0, 2, 2], [0, 1, 2, 2], [2, 2, 0, 0], [2, 1, 1, 0]]
        limits = [[0, 0], [1, 1], [0, 1], [0, 1], [0.5, 0.5], [0.5, 0.5]]
        counts = np.array(rows, dtype=float)
        lines = binomial_lines(np.arange(4.0), counts, np.full(counts.shape, 2.0), link)
        assert lines.degenerate.all()
        ends = lines.intercept[:, None] + lines.slope[:, None] * np.array([-1.0, 4.0])
        assert inverse(ends) == pytest.approx(np.array(limits, dtype=float), abs=1e-9)
        assert -lines.intercept[2:4] / lines.slope[2:4] == pytest.approx([1.5, 1.0])


def test_tails():
    ratio = inverse_mills(np.array([-40.0, 0.0, 40.0]))
    assert ratio == pytest.approx([40.0249688, 0.7978845608, 0.0], rel=1e-8)
    low, high = np.array([-INF, 30.0, 1.0, -2.0]), np.array([0.0, INF, 1.0, 2.0])
    expected = [np.log(0.5), norm.logsf(30.0), -INF, np.log(norm.cdf(2.0) - norm.cdf(-2.0))]
    assert log_between(low, high) == pytest.approx(expected, rel=1e-12)


INF = np.inf


def data(seed, n=80):
    """Values on a line; beyond 1.5 only known as bounds, and a third between two."""
    generator = np.random.default_rng(seed)
    x = generator.normal(size=n)
    y = 0.5 + 1.3 * x + generator.normal(0.0, 0.6, n)
    lower, upper = np.clip(y, -INF, 1.5), np.clip(y, -1.5, INF)
    lower[y < -1.5], upper[y > 1.5] = -INF, INF
    between = (np.arange(n) % 3 == 0) & (np.abs(y) < 1.5)
    lower[between], upper[between] = np.floor(y[between]), np.floor(y[between]) + 1.0
    return np.column_stack([np.ones(n), x]), lower, upper


def test_normal_regression_beats_a_search():
    design, lower, upper = data(1)

    def loss(p):
        a, b = ((end - design @ p[:2]) / np.exp(p[2]) for end in (lower, upper))
        with np.errstate(divide="ignore"):
            inside = np.log(norm.cdf(b) - norm.cdf(a))
        return -np.sum(np.where(lower == upper, norm.logpdf(a) - p[2], inside))

    options = {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 5000}
    best = minimize(loss, [0.0, 1.0, 0.0], method="Nelder-Mead", options=options)
    found = normal_lines(design, lower, upper, np.ones((1, lower.size)))
    assert found.coefficients[0] == pytest.approx(best.x[:2], abs=1e-6)
    assert found.deviation[0] == pytest.approx(np.exp(best.x[2]), rel=1e-6)
    assert found.loss[0] == pytest.approx(best.fun, rel=1e-10)
