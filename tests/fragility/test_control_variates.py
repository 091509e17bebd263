"""Two-fidelity estimators: unbiased, with the errors they state, and the gain they promise."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from archfrag.errors import FitError, InputError
from archfrag.fragility.control_variates import control_variate_gain, estimate_two_fidelity

SLOPE, NOISE, SIGMA = 0.85, 0.08, 0.4
TRUTH = np.array([0.1, np.hypot(SLOPE * SIGMA, NOISE)])


def pair(generator, n=100, m=15):
    x = generator.normal(0.0, SIGMA, n)
    y = 0.1 + SLOPE * x + generator.normal(0.0, NOISE, n)
    y[m:] = np.nan
    return np.exp(x), np.exp(y)


@pytest.mark.parametrize("method", ["fine", "difference", "optimal"])
def test_estimates_and_their_errors(method):
    """400 studies; the standard error of their mean is 0.002 to 0.005."""
    generator = np.random.default_rng(1)
    values, errors = np.empty((400, 2)), np.empty((400, 2))
    for i in range(400):
        found = estimate_two_fidelity(*pair(generator), method)
        values[i], errors[i] = (np.log(found.theta), found.beta), found.standard_errors
    assert values.mean(axis=0) == pytest.approx(TRUTH, abs=0.015)
    assert errors.mean(axis=0) == pytest.approx(values.std(axis=0), rel=0.15)
    if method == "optimal":
        square = SLOPE**2 * SIGMA**2
        expected = np.sqrt(square / 100 + NOISE**2 / 15)
        assert values[:, 0].std() == pytest.approx(expected, rel=0.15)


def test_bias_of_the_estimated_coefficient_is_estimated():
    """Skewed capacities and a curved relation: c from 8 records biases ln theta; the jackknife
    takes out most of it (2,000 studies, standard error 0.003)."""
    generator = np.random.default_rng(2)
    raw, corrected = np.empty(2000), np.empty(2000)
    for i in range(2000):
        x = generator.gamma(1.0, 0.4, 60)
        y = x + 0.8 * x**2
        truth = 0.4 + 0.8 * 2.0 * 0.4**2
        y[8:] = np.nan
        found = estimate_two_fidelity(np.exp(x), np.exp(y))
        corrected[i] = np.log(found.theta) - truth
        raw[i] = corrected[i] + found.bias[0]
    assert abs(raw.mean()) > 0.03
    assert abs(corrected.mean()) < 0.5 * abs(raw.mean())


def test_optimal_is_the_likeliest_estimate_of_normal_values():
    """Anderson 1957: regression on the pairs, moments of the cheap values over all records."""
    coarse, fine = pair(np.random.default_rng(5))
    found = estimate_two_fidelity(coarse, fine)
    x, y = np.log(coarse), np.log(fine[:15])
    slope, intercept = np.polyfit(x[:15], y, 1)
    residual = y - intercept - slope * x[:15]
    raw = np.log(found.theta) + found.bias[0], found.beta + found.bias[1]
    beta = np.sqrt(np.mean(residual**2) + slope**2 * x.var())
    assert raw == pytest.approx((intercept + slope * x.mean(), beta), rel=1e-9)


def test_same_settings_give_the_whole_sample():
    coarse, _ = pair(np.random.default_rng(3))
    fine = coarse.copy()
    fine[20:] = np.nan
    for method in ("difference", "optimal"):
        found = estimate_two_fidelity(coarse, fine, method)
        assert found.coefficient == pytest.approx(1.0)
        assert found.theta == pytest.approx(np.exp(np.log(coarse).mean()), rel=1e-9)
        assert found.bias[0] == pytest.approx(0.0, abs=1e-12)
        assert found.beta == pytest.approx(np.log(coarse).std(ddof=1), rel=0.01)
        assert found.standard_errors[0] == pytest.approx(
            np.log(coarse).std(ddof=1) / np.sqrt(100), rel=0.01
        )
        assert found.correlation == pytest.approx(1.0)


@pytest.mark.parametrize("ratio", [3.0, 8.5, 40.0])
def test_gain_is_the_best_that_a_search_finds(ratio):
    for r in (0.6, 0.9, 0.98):

        def product(log_ratio, r=r):
            n_over_m = np.exp(log_ratio)
            return (1 - r * r + r * r / n_over_m) * (1 + n_over_m / ratio)

        best = minimize_scalar(product, bounds=(0.0, 8.0), method="bounded")
        gain = control_variate_gain(r, ratio)
        assert gain.factor == pytest.approx(max(1.0, 1.0 / best.fun), rel=1e-4)
        if gain.pays:
            assert gain.fine_fraction == pytest.approx(np.exp(-best.x), rel=1e-2)


def test_when_it_pays():
    assert control_variate_gain(0.95, 8.5).pays
    assert not control_variate_gain(0.3, 8.5).pays
    assert control_variate_gain(0.3, 8.5).factor == 1.0
    assert control_variate_gain(0.75, 8.5).pays
    doubtful = control_variate_gain(0.75, 8.5, n_pilot=10)
    assert not doubtful.pays
    assert "do not pay" in doubtful.message
    assert control_variate_gain(1.0, 8.5).factor == pytest.approx(8.5)


def test_bad_input_is_refused():
    coarse, fine = pair(np.random.default_rng(4))
    with pytest.raises(InputError, match="fine, difference, optimal"):
        estimate_two_fidelity(coarse, fine, "best")
    with pytest.raises(InputError, match="shape"):
        estimate_two_fidelity(coarse, fine[:5])
    with pytest.raises(InputError, match="-1"):
        estimate_two_fidelity(-np.ones(100), fine)
    with pytest.raises(FitError, match="4 are needed"):
        estimate_two_fidelity(coarse, np.where(np.arange(100) < 3, fine, np.nan))
    with pytest.raises(FitError, match="do not vary"):
        estimate_two_fidelity(np.ones(100), fine)
    with pytest.raises(InputError, match="correlation"):
        control_variate_gain(1.2, 8.0)
    with pytest.raises(InputError, match="cost_ratio"):
        control_variate_gain(0.9, 1.0)
    with pytest.raises(InputError, match="n_pilot"):
        control_variate_gain(0.9, 8.0, n_pilot=3)
