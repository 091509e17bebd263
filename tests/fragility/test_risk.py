"""Rate of collapse: closed forms, quadrature, and a band that holds the truth as often as said."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from archfrag.errors import InputError
from archfrag.fragility.curve import Fragility
from archfrag.fragility.fit import fit_ida, fit_stripes
from archfrag.fragility.hazard_curve import HazardCurve
from archfrag.fragility.parameters import parameter_draws
from archfrag.fragility.risk import (
    TabulatedCurve,
    collapse_rate,
    rate_by_level,
)

IM = np.geomspace(0.05, 2.0, 9)
BENT = HazardCurve(IM, np.exp(-7.0 - 2.0 * np.log(IM) - 0.3 * np.log(IM) ** 2))


def lognormal(theta, beta):
    return Fragility(theta, beta, np.diag([0.01, 0.005]), 0.0, 5, 30, "ida")


def by_quadrature(hazard, probability, low, high, cuts=()):
    """Integral of P |d lambda| from rates of exceedance alone."""
    knots = np.unique(np.clip(np.log([low, *hazard.im, *cuts, high]), np.log(low), np.log(high)))
    total = 0.0
    for a, b in pairwise(knots):
        fall = np.log(hazard.rate_at(np.exp(a)) / hazard.rate_at(np.exp(b))) / (b - a)
        total += quad(
            lambda x, k=fall: probability(np.exp(x)) * k * hazard.rate_at(np.exp(x)), a, b,
            epsabs=0.0, epsrel=1e-11,
        )[0]  # fmt: skip
    return total


class TestClosedForm:
    @pytest.mark.parametrize("k", [0.5, 1.0, 2.5, 4.0, 8.0])
    @pytest.mark.parametrize(("theta", "beta"), [(0.2, 0.15), (0.5, 0.4), (3.0, 0.8)])
    def test_power_law(self, k, theta, beta):
        hazard = HazardCurve(IM, 1e-4 * IM**-k)
        exact = 1e-4 * theta**-k * np.exp(0.5 * (k * beta) ** 2)
        assert collapse_rate(hazard, lognormal(theta, beta)).rate == pytest.approx(exact, rel=1e-9)

    def test_steep_power_does_not_overflow(self):
        hazard = HazardCurve([1.0, 1.1], [1e-2, 1e-2 * 1.1**-60.0])
        found = collapse_rate(hazard, lognormal(1.05, 0.01)).rate
        assert found == pytest.approx(1e-2 * 1.05**-60.0 * np.exp(0.18), rel=1e-9)
        wide = collapse_rate(hazard, lognormal(1.0, 2.0))
        assert np.isfinite(wide.rate)
        assert wide.below == pytest.approx(1.0)

    def test_step_is_the_rate_of_exceedance(self):
        assert collapse_rate(BENT, lognormal(0.4, 1e-6)).rate == pytest.approx(
            float(BENT.rate_at(0.4)), rel=1e-4
        )

    def test_tabulated_step(self):
        curve = TabulatedCurve([0.4, 0.4 * (1.0 + 1e-9)], [0.0, 1.0])
        assert collapse_rate(BENT, curve).rate == pytest.approx(float(BENT.rate_at(0.4)), rel=1e-6)


class TestQuadrature:
    @pytest.mark.parametrize(("theta", "beta"), [(0.3, 0.4), (1.0, 0.3)])
    def test_lognormal(self, theta, beta):
        curve = lognormal(theta, beta)
        expected = by_quadrature(BENT, curve.probability, 1e-3, 1e4)
        assert collapse_rate(BENT, curve).rate == pytest.approx(expected, rel=1e-7)

    def test_tabulated(self):
        curve = TabulatedCurve(np.geomspace(0.1, 1.5, 5), [0.01, 0.2, 0.5, 0.9, 0.95])
        expected = by_quadrature(BENT, curve.probability, 0.1, 1e5, curve.im)
        assert collapse_rate(BENT, curve).rate == pytest.approx(expected, rel=1e-7)

    def test_dense_table_of_a_lognormal_curve(self):
        curve = lognormal(0.5, 0.3)
        im = np.geomspace(0.05, 5.0, 4000)
        table = TabulatedCurve(im, curve.probability(im))
        assert collapse_rate(BENT, table).rate == pytest.approx(
            collapse_rate(BENT, curve).rate, rel=1e-5
        )


class TestLevels:
    @pytest.mark.parametrize(
        "curve", [lognormal(0.4, 0.4), TabulatedCurve([0.1, 0.5, 1.0], [0.1, 0.5, 1.0])]
    )
    def test_levels_add_up_to_the_rate(self, curve):
        parts = rate_by_level(BENT, curve, [0.02, 0.1, 0.33, 0.7, 3.0])
        assert np.all(parts >= 0.0)
        assert parts.sum() == pytest.approx(collapse_rate(BENT, curve).rate, rel=1e-12)

    def test_one_level_against_quadrature(self):
        curve = lognormal(0.4, 0.4)
        parts = rate_by_level(BENT, curve, [0.33, 0.7])
        expected = by_quadrature(BENT, curve.probability, 0.33, 0.7)
        assert parts[1] == pytest.approx(expected, rel=1e-9)

    def test_outside_of_the_hazard_curve(self):
        found = collapse_rate(BENT, lognormal(2.0, 0.4))
        beyond = by_quadrature(BENT, lognormal(2.0, 0.4).probability, 2.0, 1e5)
        assert found.above == pytest.approx(beyond / found.rate, rel=1e-6)
        assert found.below < 1e-9
        assert found.outside == found.below + found.above

    def test_flat_pieces_bring_nothing(self):
        flat = HazardCurve([0.01, 0.1, 0.5, 1.0, 2.0], [0.02, 0.02, 1e-3, 1e-4, 1e-4])
        parts = rate_by_level(flat, lognormal(0.3, 0.6), flat.im)
        assert parts[0] == parts[1] == parts[4] == 0.0
        assert parts[5] > 0.0


class TestHazardCurve:
    def test_probabilities_are_of_a_poisson_process(self):
        curve = HazardCurve.from_exceedance([0.1, 0.2, 0.4], [0.5, 0.1, 0.02], 50.0)
        assert 1.0 / curve.rate[1] == pytest.approx(474.561, rel=1e-5)
        assert curve.rate[0] == pytest.approx(np.log(2.0) / 50.0)

    def test_certain_and_impossible_points_are_left_out(self):
        curve = HazardCurve.from_exceedance([0.1, 0.2, 0.4, 0.8], [1.0, 0.1, 0.02, 0.0], 50.0)
        np.testing.assert_array_equal(curve.im, [0.2, 0.4])

    def test_power_between_and_beyond(self):
        curve = HazardCurve([0.1, 0.2, 0.4], [1e-2, 5e-3, 6.25e-4])
        assert curve.rate_at(0.05) == pytest.approx(2e-2)
        assert curve.rate_at(0.2 * np.sqrt(2.0)) == pytest.approx(5e-3 / 2.0**1.5)
        assert curve.rate_at(0.8) == pytest.approx(6.25e-4 / 8.0)
        np.testing.assert_allclose(curve.rate_at(curve.im), curve.rate)

    @pytest.mark.parametrize(
        ("im", "rate", "sentence"),
        [
            ([0.1, 0.2], [1e-3, 2e-3], "rises from 0.001 to 0.002 at im = 0.2"),
            ([0.2, 0.1], [2e-3, 1e-3], "has 0.1 after 0.2"),
            ([0.1, 0.2], [1e-3, 1e-3], "is 0.001 at all its points"),
            ([0.1, -0.2], [2e-3, 1e-3], "im holds -0.2"),
            ([0.1, 0.2], [np.nan, 1e-3], "rate holds nan"),
            ([0.1], [1e-3], "has 1 of 1 points"),
            ([0.1, 0.2], [1e-3], "two lists of at least two points"),
        ],
    )
    def test_refusals(self, im, rate, sentence):
        with pytest.raises(InputError, match=sentence):
            HazardCurve.from_rates(im, rate)

    def test_probability_that_is_none(self):
        with pytest.raises(InputError, match=r"probability holds 1\.2"):
            HazardCurve.from_exceedance([0.1, 0.2], [1.2, 0.1], 50.0)


class TestBand:
    def test_probability_in_years(self):
        found = collapse_rate(BENT, lognormal(0.5, 0.4), ([0.4, 0.5, 0.6], [0.4, 0.4, 0.4]))
        value, low, high = found.probability_in(50.0)
        assert value == pytest.approx(1.0 - np.exp(-50.0 * found.rate))
        assert low < value < high
        assert found.return_period == pytest.approx(1.0 / found.rate)

    def test_same_seed_same_draws(self):
        fit = lognormal(0.5, 0.4)
        for a, b in zip(parameter_draws(fit, 3), parameter_draws(fit, 3)):
            np.testing.assert_array_equal(a, b)

    def test_draws_have_the_covariance_of_the_fit(self):
        fit = Fragility(0.5, 0.4, np.array([[4e-3, 1e-3], [1e-3, 2e-3]]), 0.0, 5, 200, "stripes")
        theta, beta = parameter_draws(fit, 1, draws=100_000)
        found = np.cov(np.log(theta), 0.4 * np.log(beta))
        np.testing.assert_allclose(found, fit.covariance, rtol=0.03)

    @pytest.mark.parametrize("shared", [False, True])
    def test_holds_the_true_rate_as_often_as_it_says(self, shared):
        """90 % with 24 records: capacities known, and seen through 15 levels."""
        generator = np.random.default_rng(8)
        hazard = HazardCurve([0.01, 10.0], 1e-4 * np.array([0.01, 10.0]) ** -2.0)
        truth = 1e-4 * np.exp(0.5 * (2.0 * 0.4) ** 2)
        levels = np.exp(0.4 * np.linspace(-2.2, 2.2, 15))
        held = []
        for repeat in range(200):
            capacity = np.exp(0.4 * generator.standard_normal(24))
            if shared:
                fit = fit_stripes(levels, (capacity[:, None] <= levels).sum(axis=0), 24)
            else:
                fit = fit_ida(capacity)
            found = collapse_rate(hazard, fit, parameter_draws(fit, repeat, 24, draws=500))
            held.append(found.lower <= truth <= found.upper)
        assert 0.83 <= np.mean(held) <= 0.96

    def test_wide_covariance_is_not_narrowed_by_many_records(self):
        fit = Fragility(0.5, 0.4, np.diag([0.09, 0.01]), 0.0, 5, 900, "stripes")
        theta, _ = parameter_draws(fit, 1, n_record=300)
        assert np.log(theta).std() == pytest.approx(0.3, rel=0.05)


class TestRefusals:
    def test_confidence(self):
        with pytest.raises(InputError, match="confidence is 1"):
            collapse_rate(BENT, lognormal(0.5, 0.4), confidence=1.0)

    def test_years(self):
        with pytest.raises(InputError, match="years is 0"):
            collapse_rate(BENT, lognormal(0.5, 0.4)).probability_in(0.0)

    def test_edges(self):
        with pytest.raises(InputError, match="edges must be"):
            rate_by_level(BENT, lognormal(0.5, 0.4), [0.2, 0.1])

    def test_table_that_falls(self):
        with pytest.raises(InputError, match="never fall"):
            TabulatedCurve([0.1, 0.2], [0.5, 0.4])

    def test_draws_without_meaning(self):
        with pytest.raises(InputError, match="beta holds 0"):
            collapse_rate(BENT, lognormal(0.5, 0.4), ([0.5], [0.0]))
