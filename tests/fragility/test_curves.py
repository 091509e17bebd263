"""Runs gathered, curves without a given shape, the test of fit, and clouds."""

import numpy as np
import pytest
from scipy.special import expit, logit, ndtr
from scipy.stats import linregress
from sklearn.isotonic import IsotonicRegression

from archfrag.errors import FitError, InputError
from archfrag.fragility.cloud import cloud_binary, cloud_modified
from archfrag.fragility.fit import fit_stripes
from archfrag.fragility.goodness import check_lognormal
from archfrag.fragility.runs import Resampling, gather_runs
from archfrag.fragility.shapes import _local, isotonic_curve, kernel_curve

LEVELS = np.geomspace(0.1, 1.2, 12)
DRAWS = Resampling(seed=1, resamples=200)


def grid(generator, n=30, rho=1.0):
    """Verdicts of records with capacity exp(-1 + 0.4 z), z correlated by rho in a record."""
    noise = np.sqrt(rho) * generator.normal(size=(n, 1))
    noise = noise + np.sqrt(1.0 - rho) * generator.normal(size=(n, LEVELS.size))
    return (np.log(LEVELS) >= -1.0 + 0.4 * noise).astype(int)


def scattered(generator, n):
    x = generator.normal(-1.0, 0.6, n)
    return (x >= generator.normal(-1.0, 0.4, n)).astype(int), np.exp(x)


def shelf(generator, n):
    """Two populations, far apart."""
    centre = np.where(generator.random((n, 1)) < 0.5, -2.0, -0.4)
    return (np.log(LEVELS) >= generator.normal(centre, 0.12)).astype(int)


class TestRuns:
    def test_events_are_resampled_together(self):
        verdict = np.array([[1, 1], [1, 1], [0, 0], [0, 0]])
        runs = gather_runs(verdict, [0.1, 0.2], event=["a", "a", "", ""])
        collapses, n = runs.resample(DRAWS)
        assert set(collapses[:, 0]) <= {0.0, 2.0, 4.0, 6.0}
        assert n.mean() == pytest.approx(4.0, abs=0.2)
        assert np.all(collapses[:, 0] == collapses[:, 1])

    def test_many_intensities_are_gathered_without_loss(self):
        verdict, im = scattered(np.random.default_rng(3), 3000)
        runs = gather_runs(verdict, im)
        for part, size in ((runs, 500), (runs.binned(40), 40)):
            assert part.levels.size == size
            assert part.totals[0].sum() == verdict.sum()
            weighted = part.totals[1] @ np.log(part.levels)
            assert weighted == pytest.approx(np.log(im).sum(), abs=1e-6)

    @pytest.mark.parametrize(
        ("verdict", "im", "event", "key"),
        [
            ([2, 3], 0.1, None, "no run that"),
            ([0, 1], [0.1, 0.2, 0.3], None, "one intensity per run"),
            ([0, 1], [0.1, -0.2], None, "-0.2"),
            ([0, 1], [0.1, 0.2], ["a"], "event"),
            (1, 0.1, None, "n_record"),
        ],
    )
    def test_refusals(self, verdict, im, event, key):
        with pytest.raises(InputError, match=key):
            gather_runs(verdict, im, event=event)


class TestIsotonic:
    def test_is_that_of_scikit_learn(self):
        generator = np.random.default_rng(2)
        for _ in range(10):
            verdict = generator.choice([0, 1, 2], (25, LEVELS.size), p=[0.5, 0.4, 0.1])
            runs = gather_runs(verdict, LEVELS)
            collapses, n = runs.totals
            other = IsotonicRegression().fit_transform(LEVELS, collapses / n, sample_weight=n)
            assert isotonic_curve(runs, DRAWS).value == pytest.approx(other, abs=1e-12)
        verdict, im = scattered(generator, 200)
        order = np.argsort(im)
        other = IsotonicRegression().fit_transform(im[order], verdict[order])
        value = isotonic_curve(gather_runs(verdict, im), DRAWS).value
        assert value == pytest.approx(other, abs=1e-12)

    @pytest.mark.parametrize("curve", [isotonic_curve, kernel_curve])
    def test_one_level_gives_no_curve(self, curve):
        with pytest.raises(FitError, match="one level"):
            curve(gather_runs([[0], [1]], [0.1]), DRAWS)

    def test_band_has_the_width_of_a_binomial_where_levels_are_independent(self):
        verdict = grid(np.random.default_rng(4), n=60)
        curve = isotonic_curve(gather_runs(verdict, LEVELS), Resampling(seed=1, resamples=2000))
        p, width = verdict[:, 6].mean(), curve.upper - curve.lower
        assert width[6] == pytest.approx(2 * 1.645 * np.sqrt(p * (1 - p) / 60), rel=0.15)


class TestKernel:
    def test_a_wide_line_is_the_lognormal_curve(self):
        verdict = grid(np.random.default_rng(5))
        runs, x = gather_runs(verdict, LEVELS), np.log(LEVELS)
        value = _local(x, *(part[None] for part in runs.totals), x, 1e3)[0]
        fit = fit_stripes(LEVELS, verdict.sum(axis=0), 30)
        assert value == pytest.approx(fit.probability(LEVELS), abs=1e-4)

    def test_follows_a_curve_that_is_not_lognormal(self):
        verdict = shelf(np.random.default_rng(8), 400)
        at, curve = np.array([-1.6, -1.2, -0.8]), kernel_curve(gather_runs(verdict, LEVELS), DRAWS)
        bound = fit_stripes(LEVELS, verdict.sum(axis=0), 400).probability(np.exp(at))
        assert np.interp(at, np.log(curve.im), curve.value) == pytest.approx([0.5] * 3, abs=0.08)
        assert np.abs(bound - 0.5).max() > 0.15


class TestOfFit:
    @pytest.mark.parametrize("rho", [1.0, 0.5, None])
    def test_size(self, rho):
        """60 lognormal studies: p is below 0.5 in half and below 0.1 in a tenth of them.

        Three standard errors are 19 and 12 %. With runs drawn as independent, p of shared records
        is above 0.5 in nearly all. None: each run has a motion of its own.
        """
        p = []
        for i in range(60):
            draw = np.random.default_rng(i)
            given = scattered(draw, 150) if rho is None else (grid(draw, 30, rho), LEVELS)
            p.append(check_lognormal(gather_runs(*given), Resampling(i, 100)).p_value)
        assert np.mean(np.array(p) < 0.5) == pytest.approx(0.5, abs=0.19)
        assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.12)

    def test_two_populations_are_found(self):
        runs = gather_runs(shelf(np.random.default_rng(1), 40), LEVELS)
        found = check_lognormal(runs, DRAWS)
        assert found.p_value < 0.01
        assert "does not describe" in found.message

    def test_correlation_of_a_record_is_recovered(self):
        generator = np.random.default_rng(2)
        for rho in (0.3, 0.9):
            runs = gather_runs(grid(generator, n=400, rho=rho), LEVELS)
            found = check_lognormal(runs, Resampling(3, 100))
            assert found.record_correlation == pytest.approx(rho, abs=0.07)
        monotone = check_lognormal(gather_runs(grid(generator), LEVELS), Resampling(3, 100))
        assert monotone.record_correlation == 1.0
        with pytest.raises(FitError, match="nothing to test"):
            check_lognormal(gather_runs([[0, 1], [0, 1]], [0.1, 0.2]), Resampling(1, 100))


SLOPE, DEVIATION = 1.5, 0.4


class TestClouds:
    def test_logistic_curve_and_its_points(self):
        verdict, im = scattered(np.random.default_rng(2), 300)
        curve = cloud_binary(im, verdict, DRAWS)
        a, b = curve.parameters
        assert curve.probability([0.0, 0.4]) == pytest.approx([0.0, expit(a + b * np.log(0.4))])
        low, high = np.exp((logit(ndtr([-1.0, 1.0])) - a) / b)
        assert curve.probability([curve.theta]) == pytest.approx(0.5)
        assert curve.beta == pytest.approx(0.5 * np.log(high / low))

    def test_without_collapse_it_is_the_regression(self):
        generator = np.random.default_rng(3)
        x = generator.normal(-1.0, 0.6, 300)
        y = 1.0 + SLOPE * x + generator.normal(0.0, DEVIATION, 300)
        curve = cloud_modified(np.exp(x), np.exp(y), np.zeros(300, int), 0.5, DRAWS)
        line = linregress(x, y)
        residual = y - line.intercept - line.slope * x
        deviation = np.sqrt(residual @ residual / 298)
        theta, beta = np.exp((np.log(0.5) - line.intercept) / line.slope), deviation / line.slope
        assert (curve.theta, curve.beta) == pytest.approx((theta, beta), rel=1e-9)
        assert "no run collapsed" in curve.notes[0]

    def test_total_probability(self):
        """Collapse by a logistic law of its own, response a line where it did not."""
        generator = np.random.default_rng(4)
        x = generator.normal(-1.0, 0.7, 8000)
        fell = generator.random(x.size) < expit(2.0 + 4.0 * x)
        response = np.exp(1.0 + SLOPE * x + generator.normal(0.0, DEVIATION, x.size))
        response[fell] = np.nan
        curve = cloud_modified(np.exp(x), response, fell, 0.5, Resampling(2, 100))
        at = np.log([0.2, 0.35, 0.6])
        demand = ndtr((1.0 + SLOPE * at - np.log(0.5)) / DEVIATION)
        truth = demand + (1.0 - demand) * expit(2.0 + 4.0 * at)
        assert curve.probability(np.exp(at)) == pytest.approx(truth, abs=0.02)
        assert 0.01 < np.log(curve.theta_interval[1] / curve.theta_interval[0]) < 0.06

    def test_events_widen_the_intervals(self):
        """Ten records an event with an error in common: the interval that knows it is wider."""
        generator = np.random.default_rng(8)
        event = np.repeat(np.arange(20), 10)
        x = generator.normal(-1.0, 0.6, 200)
        error = generator.normal(0.0, 0.5, 20)[event] + generator.normal(0.0, 0.2, 200)
        given = np.exp(x), np.exp(1.0 + SLOPE * x + error), np.zeros(200, int), 0.5, DRAWS
        both = cloud_modified(*given), cloud_modified(*given, event=event.astype(str))
        widths = [np.log(c.theta_interval[1] / c.theta_interval[0]) for c in both]
        assert widths[1] > 1.6 * widths[0]

    IM = (0.1, 0.2, 0.3, 0.4)

    @pytest.mark.parametrize(
        ("make", "arguments", "kind", "key"),
        [
            (cloud_binary, (IM, [0, 0, 0, 0]), FitError, "above"),
            (cloud_binary, (IM, [1, 1, 1, 1]), FitError, "below"),
            (cloud_binary, (IM, [0, 0, 1, 1]), FitError, "separation"),
            (cloud_binary, (IM, [1, 1, 0, 0]), FitError, "does not rise"),
            (cloud_binary, ([0.1, 0.1], [0, 1]), FitError, "one intensity"),
            (cloud_binary, (IM, [0, 1, 2, 1]), InputError, "0 and 1"),
            (cloud_modified, (IM, [0.1, 0.2, 1, 1], [0, 0, 1, 1], 0.5), FitError, "only 2 of 4"),
            (cloud_modified, (IM, [4, 3.1, 2, 1], [0] * 4, 0.5), FitError, "does not rise"),
            (cloud_modified, (IM, [1] * 4, [0] * 4, 0.0), InputError, "limit holds 0"),
            (cloud_modified, (IM, [0, 2, 2, 2], [0] * 4, 1.0), InputError, "collapse holds 0"),
        ],
    )
    def test_what_gives_no_curve(self, make, arguments, kind, key):
        with pytest.raises(kind, match=key):
            make(*arguments, DRAWS)
