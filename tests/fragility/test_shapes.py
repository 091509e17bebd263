"""Free curves: isotonic against scikit-learn, the kernel's limits, bands, and their variance."""

import numpy as np
import pytest
from scipy.special import ndtr
from sklearn.isotonic import IsotonicRegression

from archfrag.errors import FitError, InputError
from archfrag.fragility.fit import fit_stripes
from archfrag.fragility.runs import Resampling, gather_runs
from archfrag.fragility.shapes import isotonic_curve, kernel_curve

LEVELS = np.geomspace(0.1, 1.2, 10)
DRAWS = Resampling(seed=1, resamples=200)


def grid(seed, n=30, beta=0.4):
    capacity = np.exp(np.random.default_rng(seed).normal(-1.0, beta, (n, 1)))
    return (capacity <= LEVELS).astype(int)


class TestIsotonic:
    def test_is_that_of_scikit_learn(self):
        generator = np.random.default_rng(2)
        for _ in range(20):
            verdict = generator.choice([0, 1, 2], (25, LEVELS.size), p=[0.5, 0.4, 0.1])
            runs = gather_runs(verdict, LEVELS)
            collapses, n = runs.totals
            other = IsotonicRegression().fit_transform(LEVELS, collapses / n, sample_weight=n)
            assert isotonic_curve(runs, DRAWS).value == pytest.approx(other, abs=1e-12)

    def test_scattered_runs(self):
        generator = np.random.default_rng(3)
        im = np.exp(generator.normal(-1.0, 0.6, 200))
        verdict = (np.log(im) > generator.normal(-1.0, 0.4, 200)).astype(int)
        order = np.argsort(im)
        other = IsotonicRegression().fit_transform(im[order], verdict[order])
        curve = isotonic_curve(gather_runs(verdict, im), DRAWS)
        assert curve.value == pytest.approx(other, abs=1e-12)
        band = curve.band([0.2, 0.37, 0.7])
        assert np.all(band.lower <= curve.probability([0.2, 0.37, 0.7]))
        assert np.all(band.upper >= curve.probability([0.2, 0.37, 0.7]))

    def test_values_between_and_beyond_the_levels(self):
        curve = isotonic_curve(gather_runs([[0, 1], [0, 0]], [0.1, 0.4]), DRAWS)
        assert curve.probability([0.0, 0.05, 0.2, 9.0]) == pytest.approx([0.0, 0.0, 0.25, 0.5])

    def test_band_has_the_width_of_a_binomial_where_levels_are_independent(self):
        verdict = grid(4, n=60)
        curve = isotonic_curve(gather_runs(verdict, LEVELS), Resampling(seed=1, resamples=2000))
        p = verdict[:, 5].mean()
        band = curve.band(LEVELS[5])
        expected = 2 * 1.645 * np.sqrt(p * (1 - p) / 60)
        assert band.upper - band.lower == pytest.approx(expected, rel=0.15)


class TestKernel:
    def test_a_wide_line_is_the_lognormal_curve(self):
        verdict = grid(5)
        curve = kernel_curve(gather_runs(verdict, LEVELS), DRAWS, bandwidth=1e3)
        fit = fit_stripes(LEVELS, verdict.sum(axis=0), 30)
        assert curve.value == pytest.approx(fit.probability(curve.im), abs=1e-4)

    def test_a_wide_fraction_is_the_fraction_of_all(self):
        verdict = grid(6)
        runs = gather_runs(verdict, LEVELS)
        curve = kernel_curve(runs, DRAWS, degree="constant", bandwidth=1e3)
        assert curve.value == pytest.approx(np.full(curve.im.size, verdict.mean()), abs=1e-4)

    def test_constant_is_the_weighted_mean(self):
        verdict = grid(7)
        curve = kernel_curve(gather_runs(verdict, LEVELS), DRAWS, degree="constant", bandwidth=0.3)
        weight = np.exp(-0.5 * (np.log(LEVELS / curve.im[8]) / 0.3) ** 2)
        assert curve.value[8] == pytest.approx(weight @ verdict.mean(axis=0) / weight.sum())

    def test_follows_a_curve_that_is_not_lognormal(self):
        """Two populations: the chosen bandwidth must see the shelf between them."""
        generator = np.random.default_rng(8)
        centre = np.where(generator.random((400, 1)) < 0.5, -2.0, -0.4)
        verdict = (np.log(LEVELS) >= generator.normal(centre, 0.12)).astype(int)
        runs = gather_runs(verdict, LEVELS)
        at = np.exp([-1.6, -1.2, -0.8])
        free = kernel_curve(runs, DRAWS).probability(at)
        bound = fit_stripes(LEVELS, verdict.sum(axis=0), 400).probability(at)
        assert free == pytest.approx([0.5, 0.5, 0.5], abs=0.08)
        assert np.abs(bound - 0.5).max() > 0.15

    def test_many_scattered_runs(self):
        generator = np.random.default_rng(9)
        im = np.exp(generator.normal(-1.0, 0.6, 1000))
        verdict = (np.log(im) > generator.normal(-1.0, 0.4, 1000)).astype(int)
        curve = kernel_curve(gather_runs(verdict, im), Resampling(seed=1, resamples=100))
        at = np.array([0.25, 0.37, 0.55])
        assert curve.probability(at) == pytest.approx(ndtr((np.log(at) + 1.0) / 0.4), abs=0.08)
        band = curve.band(at)
        assert np.all((band.upper - band.lower > 0.02) & (band.upper - band.lower < 0.2))


def test_what_gives_no_curve():
    one = gather_runs([[0], [1]], [0.1])
    with pytest.raises(FitError, match="one level"):
        isotonic_curve(one, DRAWS)
    runs = gather_runs([[0, 1], [1, 1]], [0.1, 0.2])
    with pytest.raises(InputError, match="constant, linear"):
        kernel_curve(runs, DRAWS, degree="cubic")
    with pytest.raises(InputError, match="bandwidth"):
        kernel_curve(runs, DRAWS, bandwidth=-1.0)
