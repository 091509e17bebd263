"""Many binomial lines at once: against one by one, and what their likelihoods tend to."""

import numpy as np
import pytest
from scipy.special import expit, ndtr
from sklearn.linear_model import LogisticRegression

from archfrag.errors import InputError
from archfrag.fragility.binomial_lines import binomial_lines, inverse_link, inverse_mills
from archfrag.fragility.fit import fit_stripes

LEVELS = np.geomspace(0.2, 1.5, 9)


def drawn(seed, draws):
    generator = np.random.default_rng(seed)
    n = generator.integers(5, 40, (draws, LEVELS.size)).astype(float)
    return generator.binomial(n.astype(int), ndtr(np.log(LEVELS / 0.6) / 0.4)).astype(float), n


def test_probit_lines_are_those_of_fit_stripes():
    collapses, n = drawn(1, 30)
    lines = binomial_lines(np.log(LEVELS), collapses, n)
    for i in range(30):
        fit = fit_stripes(LEVELS, collapses[i], n[i])
        assert 1.0 / lines.slope[i] == pytest.approx(fit.beta, rel=1e-9)
        assert -lines.intercept[i] / lines.slope[i] == pytest.approx(np.log(fit.theta), rel=1e-9)


def test_logistic_line_is_that_of_scikit_learn():
    collapses, n = drawn(2, 1)
    x = np.concatenate([np.log(LEVELS)] * 2)[:, None]
    y = np.repeat([1, 0], LEVELS.size)
    weight = np.concatenate([collapses[0], n[0] - collapses[0]])
    model = LogisticRegression(C=np.inf, tol=1e-10, max_iter=1000, solver="newton-cholesky")
    model.fit(x, y, weight)
    lines = binomial_lines(np.log(LEVELS), collapses, n, "logistic")
    assert lines.slope[0] == pytest.approx(model.coef_[0, 0], rel=1e-6)
    assert lines.intercept[0] == pytest.approx(model.intercept_[0], rel=1e-6)


@pytest.mark.parametrize("link", ["probit", "logistic"])
def test_whole_weights_are_repeated_points(link):
    generator = np.random.default_rng(3)
    x = generator.normal(size=60)
    fell = (x + generator.normal(size=60) > 0).astype(float)
    times = generator.integers(0, 4, 60)
    weighted = binomial_lines(x, (times * fell)[None], times[None].astype(float), link)
    repeated = binomial_lines(
        np.repeat(x, times), np.repeat(fell, times)[None], np.ones((1, times.sum())), link
    )
    assert weighted.slope == pytest.approx(repeated.slope, rel=1e-8)
    assert weighted.loss == pytest.approx(repeated.loss, rel=1e-10)


@pytest.mark.parametrize("link", ["probit", "logistic"])
def test_data_without_a_maximum_give_the_limit(link):
    x = np.array([0.0, 1.0, 2.0, 3.0])
    rows = {
        "none": ([0, 0, 0, 0], [0.0, 0.0]),
        "all": ([2, 2, 2, 2], [1.0, 1.0]),
        "step": ([0, 0, 2, 2], [0.0, 1.0]),
        "step at a level": ([0, 1, 2, 2], [0.0, 1.0]),
        "falling": ([2, 2, 0, 0], [0.5, 0.5]),
        "falling, overlapping": ([2, 1, 1, 0], [0.5, 0.5]),
    }
    collapses = np.array([row[0] for row in rows.values()], dtype=float)
    lines = binomial_lines(x, collapses, np.full(collapses.shape, 2.0), link)
    assert lines.degenerate.all()
    ends = lines.intercept[:, None] + lines.slope[:, None] * np.array([-1.0, 4.0])
    for found, (_, expected) in zip(inverse_link(ends, link), rows.values(), strict=True):
        assert found == pytest.approx(expected, abs=1e-9)
    assert -lines.intercept[2] / lines.slope[2] == pytest.approx(1.5)
    assert -lines.intercept[3] / lines.slope[3] == pytest.approx(1.0)


def test_mills_ratio_far_out():
    z = np.array([-40.0, 0.0, 40.0])
    assert inverse_mills(z) == pytest.approx([40.0249688, 0.7978845608, 0.0], rel=1e-8)


def test_inverse_links():
    z = np.linspace(-2.0, 2.0, 5)
    assert inverse_link(z, "probit") == pytest.approx(ndtr(z))
    assert inverse_link(z, "logistic") == pytest.approx(expit(z))


def test_unknown_link():
    with pytest.raises(InputError, match="probit, logistic"):
        binomial_lines(np.zeros(2), np.zeros((1, 2)), np.ones((1, 2)), "cauchit")
