"""Lines of many data sets: other people's code, a search, weights, and data without a maximum."""

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import norm
from sklearn.linear_model import LogisticRegression

from archfrag.fragility.probit import binomial_lines, inverse_mills, log_between

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

    @pytest.mark.parametrize("link", ["probit", "logistic"])
    def test_data_without_a_maximum(self, link):
        """None, all, a step between and at levels, and fractions that fall; the last has one."""
        rows = [[0] * 4, [2] * 4, [0, 0, 2, 2], [0, 1, 2, 2], [2, 2, 0, 0], [2, 1, 1, 0],
                [0, 1, 1, 2]]  # fmt: skip
        counts = np.array(rows, dtype=float)
        lines = binomial_lines(np.arange(4.0), counts, np.full(counts.shape, 2.0), link)
        assert np.isnan(lines.slope).tolist() == [True] * 6 + [False]
        assert -lines.intercept[-1] / lines.slope[-1] == pytest.approx(1.5)


def test_tails():
    ratio = inverse_mills(np.array([-40.0, 0.0, 40.0]))
    assert ratio == pytest.approx([40.0249688, 0.7978845608, 0.0], rel=1e-8)
    low, high = np.array([-np.inf, 30.0, 1.0, -2.0]), np.array([0.0, np.inf, 1.0, 2.0])
    expected = [np.log(0.5), norm.logsf(30.0), -np.inf, np.log(norm.cdf(2.0) - norm.cdf(-2.0))]
    assert log_between(low, high) == pytest.approx(expected, rel=1e-12)
