"""Cloud analysis on simulated clouds: what is true comes back, collapses do not bias it."""

import numpy as np
import pytest
from scipy.special import expit, ndtr
from scipy.stats import linregress

from archfrag.errors import FitError, InputError
from archfrag.fragility.cloud import cloud_binary, cloud_censored, cloud_modified
from archfrag.fragility.fit import fit_stripes
from archfrag.fragility.runs import Resampling

DRAWS = Resampling(seed=1, resamples=200)
SLOPE, DEVIATION = 1.5, 0.4


def cloud(seed, n=300, cap=1.0):
    """ln response = 1 + 1.5 ln im + 0.4 e; collapsed where it reaches the cap."""
    generator = np.random.default_rng(seed)
    x = generator.normal(-1.0, 0.6, n)
    response = np.exp(1.0 + SLOPE * x + generator.normal(0.0, DEVIATION, n))
    return np.exp(x), np.where(response >= cap, np.inf, response)


class TestBinary:
    def test_probit_is_the_lognormal_curve(self):
        im, response = cloud(1)
        curve = cloud_binary(im, response == np.inf, DRAWS, link="probit")
        fit = fit_stripes(im, (response == np.inf).astype(int), 1)
        assert curve.theta == pytest.approx(fit.theta, rel=1e-9)
        assert curve.beta == pytest.approx(fit.beta, rel=1e-9)
        assert curve.probability([0.0, 0.5]) == pytest.approx([0.0, *fit.probability([0.5])])

    def test_logistic_points(self):
        im, response = cloud(2)
        curve = cloud_binary(im, response == np.inf, DRAWS)
        a, b = curve.parameters.values()
        assert curve.probability(0.4) == pytest.approx(expit(a + b * np.log(0.4)))
        assert curve.probability(curve.points) == pytest.approx(ndtr([-1.0, 0.0, 1.0]))

    def test_intervals_hold_the_truth(self):
        """50 clouds, nominal 90 %; three standard errors of 50 draws are 12 %."""
        theta, beta = np.exp(-1.0 / SLOPE), DEVIATION / SLOPE
        held = np.zeros(3)
        for seed in range(50):
            im, response = cloud(seed + 100, n=150)
            curve = cloud_binary(im, response == np.inf, DRAWS, link="probit")
            band = curve.band(0.4)
            held += [
                curve.theta_interval[0] <= theta <= curve.theta_interval[1],
                curve.beta_interval[0] <= beta <= curve.beta_interval[1],
                band.lower <= ndtr(np.log(0.4 / theta) / beta) <= band.upper,
            ]
        assert held / 50 == pytest.approx(0.88, abs=0.12)

    def test_what_gives_no_curve(self):
        im = [0.1, 0.2, 0.3, 0.4]
        with pytest.raises(FitError, match="above"):
            cloud_binary(im, [0, 0, 0, 0], DRAWS)
        with pytest.raises(FitError, match="below"):
            cloud_binary(im, [1, 1, 1, 1], DRAWS)
        with pytest.raises(FitError, match="separation"):
            cloud_binary(im, [0, 0, 1, 1], DRAWS)
        with pytest.raises(FitError, match="does not rise"):
            cloud_binary(im, [1, 1, 0, 0], DRAWS)
        with pytest.raises(FitError, match="one intensity"):
            cloud_binary([0.1, 0.1], [0, 1], DRAWS)
        with pytest.raises(InputError, match="0 and 1"):
            cloud_binary(im, [0, 1, 2, 1], DRAWS)
        with pytest.raises(InputError, match=r"-0\.1"):
            cloud_binary([-0.1, 0.2], [0, 1], DRAWS)


class TestModified:
    def test_without_collapse_it_is_the_regression(self):
        im, response = cloud(3, cap=np.inf)
        curve = cloud_modified(im, response, np.zeros(im.size, int), 0.5, DRAWS)
        line = linregress(np.log(im), np.log(response))
        residual = np.log(response) - line.intercept - line.slope * np.log(im)
        deviation = np.sqrt(residual @ residual / (im.size - 2))
        assert curve.parameters["response_deviation"] == pytest.approx(deviation, rel=1e-9)
        assert curve.theta == pytest.approx(
            np.exp((np.log(0.5) - line.intercept) / line.slope), rel=1e-9
        )
        assert curve.beta == pytest.approx(deviation / line.slope, rel=1e-9)
        assert "no run collapsed" in curve.notes[0]

    def test_total_probability(self):
        """Collapse by a logistic law of its own, response a line where it did not."""
        generator = np.random.default_rng(4)
        x = generator.normal(-1.0, 0.7, 8000)
        fell = generator.random(x.size) < expit(2.0 + 4.0 * x)
        response = np.exp(1.0 + SLOPE * x + generator.normal(0.0, DEVIATION, x.size))
        response[fell] = np.nan
        draws = Resampling(seed=2, resamples=100)
        curve = cloud_modified(np.exp(x), response, fell, 0.5, draws)
        at = np.log([0.2, 0.35, 0.6])
        demand = ndtr((1.0 + SLOPE * at - np.log(0.5)) / DEVIATION)
        collapse = expit(2.0 + 4.0 * at)
        truth = demand * (1.0 - collapse) + collapse
        assert curve.probability(np.exp(at)) == pytest.approx(truth, abs=0.02)
        band = curve.band(np.exp(at))
        assert np.all(band.lower < curve.probability(np.exp(at)))
        assert np.all(band.upper > curve.probability(np.exp(at)))
        assert np.all(band.upper - band.lower < 0.06)
        assert curve.probability(0.0) == 0.0

    def test_what_gives_no_curve(self):
        with pytest.raises(FitError, match="only 2 of 4"):
            cloud_modified([0.1, 0.2, 0.3, 0.4], [0.1, 0.2, 1, 1], [0, 0, 1, 1], 0.5, DRAWS)
        with pytest.raises(FitError, match="does not rise"):
            cloud_modified([0.1, 0.2, 0.3, 0.4], [4.0, 3.1, 2.0, 1], [0, 0, 0, 0], 0.5, DRAWS)
        with pytest.raises(InputError, match="limit is 0"):
            cloud_modified([0.1, 0.2], [1, 2], [0, 0], 0.0, DRAWS)
        with pytest.raises(InputError, match="response holds 0"):
            cloud_modified([0.1, 0.2], [0, 2], [0, 0], 1.0, DRAWS)


class TestCensored:
    def test_collapses_do_not_bias_the_line(self):
        """Mean of 20 clouds, standard error 0.02; without collapses the slope is too small."""
        found, naive = np.zeros(3), np.zeros(2)
        for seed in range(20):
            im, response = cloud(seed + 50, cap=0.8)
            curve = cloud_censored(im, response, 0.8, 0.5, Resampling(seed=1, resamples=100))
            names = ("response_intercept", "response_slope", "response_deviation")
            found += np.array([curve.parameters[name] for name in names]) / 20
            kept = np.isfinite(response)
            line = linregress(np.log(im[kept]), np.log(response[kept]))
            naive += np.array([line.intercept, line.slope]) / 20
        assert found == pytest.approx([1.0, SLOPE, DEVIATION], abs=0.06)
        assert naive[1] < 1.45

    def test_limit_at_the_cap_agrees_with_the_verdicts(self):
        im, response = cloud(7, n=2000)
        draws = Resampling(seed=1, resamples=100)
        censored = cloud_censored(im, response, 1.0, 1.0, draws)
        binary = cloud_binary(im, response == np.inf, draws, link="probit")
        assert censored.theta == pytest.approx(binary.theta, rel=0.03)
        assert censored.beta == pytest.approx(DEVIATION / SLOPE, rel=0.05)
        width = np.log(censored.theta_interval[1] / censored.theta_interval[0])
        assert width < np.log(binary.theta_interval[1] / binary.theta_interval[0])

    def test_what_gives_no_curve(self):
        with pytest.raises(InputError, match="above the cap"):
            cloud_censored([0.1, 0.2], [0.1, 0.2], 1.0, 2.0, DRAWS)
        with pytest.raises(FitError, match="only 1 of 2"):
            cloud_censored([0.1, 0.2], [0.1, 2.0], 1.0, 1.0, DRAWS)


def test_events_widen_the_intervals():
    """Ten records an event with an error in common: the interval that knows it is wider."""
    generator = np.random.default_rng(8)
    event = np.repeat(np.arange(20), 10)
    x = generator.normal(-1.0, 0.6, 200)
    y = 1.0 + SLOPE * x + generator.normal(0.0, 0.5, 20)[event] + generator.normal(0.0, 0.2, 200)
    alone = cloud_censored(np.exp(x), np.exp(y), 5.0, 1.0, DRAWS)
    grouped = cloud_censored(np.exp(x), np.exp(y), 5.0, 1.0, DRAWS, event=event.astype(str))
    widths = [np.log(c.theta_interval[1] / c.theta_interval[0]) for c in (alone, grouped)]
    assert widths[1] > 1.6 * widths[0]
