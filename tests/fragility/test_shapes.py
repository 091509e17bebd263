"""The isotonic curve, the test of fit, and clouds."""

import numpy as np
import pytest
from scipy.special import logit, ndtr
from sklearn.isotonic import IsotonicRegression

from archfrag.errors import FitError, InputError
from archfrag.fragility.brackets import find_brackets
from archfrag.fragility.counts import draws_of_records
from archfrag.fragility.fit import fit_cloud
from archfrag.fragility.quoted import check_lognormal, isotonic_curve

LEVELS = np.geomspace(0.1, 1.2, 12)


def grid(generator, n=30, rho=1.0):
    """Brackets of records with capacity exp(-1 + 0.4 z), z correlated by rho in a record."""
    noise = np.sqrt(rho) * generator.normal(size=(n, 1))
    noise = noise + np.sqrt(1.0 - rho) * generator.normal(size=(n, LEVELS.size))
    return find_brackets(np.log(LEVELS) >= -1.0 + 0.4 * noise, LEVELS)


def single(generator, n):
    """Brackets of records with one run each."""
    x = generator.normal(-1.0, 0.6, (n, 1))
    return find_brackets(x >= generator.normal(-1.0, 0.4, (n, 1)), np.exp(x))


def shelf(generator, n):
    """Two populations, far apart."""
    centre = np.where(generator.random((n, 1)) < 0.5, -2.0, -0.4)
    return find_brackets(np.log(LEVELS) >= generator.normal(centre, 0.12), LEVELS)


def test_events_are_resampled_together():
    times = draws_of_records(["a", "a", "b", "c"], 4, 1, 200)
    assert np.all(times[:, 0] == times[:, 1])
    assert times.sum(axis=1).mean() == pytest.approx(4.0, abs=0.2)
    with pytest.raises(InputError, match="resamples is 10"):
        draws_of_records(None, 4, 1, 10)
    with pytest.raises(InputError, match="event"):
        isotonic_curve(grid(np.random.default_rng(1)), ["a"])


class TestIsotonic:
    def test_is_that_of_scikit_learn(self):
        generator = np.random.default_rng(2)
        for _ in range(10):
            found = grid(generator, rho=0.5)
            collapsed = found.collapsed.mean(axis=0)
            other = IsotonicRegression().fit_transform(LEVELS, collapsed)
            assert isotonic_curve(found)["probability"] == pytest.approx(other, abs=1e-12)
        found = single(generator, 200)
        order = np.argsort(found.levels[:, 0])
        im, collapsed = found.levels[order, 0], found.collapsed[order, 0]
        other = IsotonicRegression().fit_transform(im, collapsed)
        assert isotonic_curve(found)["probability"] == pytest.approx(other, abs=1e-12)

    def test_what_gives_no_curve(self):
        with pytest.raises(FitError, match="one level"):
            isotonic_curve(find_brackets([[0], [1]], [0.1]))
        with pytest.raises(FitError, match="no run"):
            isotonic_curve(find_brackets([[2, 3]], [0.1, 0.2]))

    def test_band_has_the_width_of_a_binomial_where_levels_are_independent(self):
        found = grid(np.random.default_rng(4), n=60)
        curve = isotonic_curve(found, resamples=2000)
        p, width = found.collapsed[:, 6].mean(), curve["upper"] - curve["lower"]
        assert width[6] == pytest.approx(2 * 1.645 * np.sqrt(p * (1 - p) / 60), rel=0.15)


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
            found = single(draw, 150) if rho is None else grid(draw, 30, rho)
            p.append(check_lognormal(found, seed=i, resamples=100)[0])
        assert np.mean(np.array(p) < 0.5) == pytest.approx(0.5, abs=0.19)
        assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.12)

    def test_two_populations_are_found(self):
        assert check_lognormal(shelf(np.random.default_rng(1), 40), resamples=200)[0] < 0.01

    def test_correlation_of_a_record_is_recovered(self):
        generator = np.random.default_rng(2)
        for rho in (0.3, 0.9):
            found = check_lognormal(grid(generator, n=400, rho=rho), seed=3, resamples=100)
            assert found[1] == pytest.approx(rho, abs=0.07)
        assert check_lognormal(grid(generator), resamples=100)[1] == 1.0
        with pytest.raises(FitError, match="nothing to test"):
            check_lognormal(find_brackets([[0, 1], [0, 1]], [0.1, 0.2]))


class TestClouds:
    def test_logistic_curve_and_its_points(self):
        found = single(np.random.default_rng(2), 300)
        curve = fit_cloud(found.levels[:, 0], found.collapsed[:, 0])
        a, b = curve["intercept"], curve["slope"]
        low, high = np.exp((logit(ndtr([-1.0, 1.0])) - a) / b)
        assert a + b * np.log(curve["theta"]) == pytest.approx(0.0, abs=1e-12)
        assert curve["beta"] == pytest.approx(0.5 * np.log(high / low))

    def test_events_widen_the_intervals(self):
        """Ten records an event with an error in common: the interval that knows it is wider."""
        generator = np.random.default_rng(8)
        event = np.repeat(np.arange(20), 10)
        x = generator.normal(-1.0, 0.6, 200)
        error = generator.normal(0.0, 0.5, 20)[event] + generator.normal(0.0, 0.2, 200)
        given = np.exp(x), x >= -1.0 + error
        both = fit_cloud(*given), fit_cloud(*given, event.astype(str))
        widths = [np.log(c["theta_interval"][1] / c["theta_interval"][0]) for c in both]
        assert widths[1] > 1.5 * widths[0]

    IM = (0.1, 0.2, 0.3, 0.4)

    @pytest.mark.parametrize(
        ("im", "collapsed", "kind", "key"),
        [
            (IM, [0, 0, 0, 0], FitError, "above"),
            (IM, [1, 1, 1, 1], FitError, "below"),
            (IM, [0, 0, 1, 1], FitError, "separation"),
            (IM, [1, 1, 0, 0], FitError, "does not rise"),
            ([0.1, 0.1], [0, 1], FitError, "one level"),
            (IM, [0, 1, 2, 1], InputError, "0 and 1"),
        ],
    )
    def test_what_gives_no_curve(self, im, collapsed, kind, key):
        with pytest.raises(kind, match=key):
            fit_cloud(im, collapsed)
