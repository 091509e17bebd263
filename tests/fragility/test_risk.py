"""Rate of collapse: closed forms, quadrature, bands, and its division by category."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from archfrag.errors import InputError
from archfrag.fragility.contributions import (
    contributions,
    deaggregate,
    implied_collapses,
    level_edges,
)
from archfrag.fragility.counts import Verdict, find_brackets
from archfrag.fragility.curve import Fragility
from archfrag.fragility.quoted import capacity_posterior
from archfrag.fragility.risk import HazardCurve, collapse_rate, parameter_draws, rate_by_level

IM = np.geomspace(0.05, 2.0, 9)
BENT = HazardCurve(IM, np.exp(-7.0 - 2.0 * np.log(IM) - 0.3 * np.log(IM) ** 2))


def lognormal(theta, beta, kind="ida"):
    return Fragility(theta, beta, np.diag([0.01, 0.005]), 0.0, 5, 30, kind)


CURVE = lognormal(0.5, 0.4)


def by_quadrature(hazard, curve, low, high):
    """Integral of P |d lambda| from rates of exceedance alone."""
    knots = np.unique(np.clip(np.log([low, *hazard.im, high]), np.log(low), np.log(high)))
    total = 0.0
    for a, b in pairwise(knots):
        fall = np.log(hazard.rate_at(np.exp(a)) / hazard.rate_at(np.exp(b))) / (b - a)
        total += quad(
            lambda x, k=fall: curve.probability(np.exp(x)) * k * hazard.rate_at(np.exp(x)),
            a, b, epsabs=0.0, epsrel=1e-11,
        )[0]  # fmt: skip
    return total


class TestRate:
    def test_steep_power_does_not_overflow(self):
        hazard = HazardCurve([1.0, 1.1], [1e-2, 1e-2 * 1.1**-60.0])
        found = collapse_rate(hazard, lognormal(1.05, 0.01)).rate
        assert found == pytest.approx(1e-2 * 1.05**-60.0 * np.exp(0.18), rel=1e-9)
        wide = collapse_rate(hazard, lognormal(1.0, 2.0))
        assert np.isfinite(wide.rate)
        assert wide.below == pytest.approx(1.0)

    def test_levels_sum_to_the_rate(self):
        curve = lognormal(0.4, 0.4)
        parts = rate_by_level(BENT, curve, [0.02, 0.33, 0.7, 3.0])
        assert np.all(parts >= 0.0)
        assert parts.sum() == pytest.approx(collapse_rate(BENT, curve).rate, rel=1e-12)
        assert parts[2] == pytest.approx(by_quadrature(BENT, curve, 0.33, 0.7), rel=1e-9)
        assert parts.sum() == pytest.approx(by_quadrature(BENT, curve, 1e-3, 1e4), rel=1e-7)
        far = collapse_rate(BENT, lognormal(2.0, 0.4))
        beyond = by_quadrature(BENT, lognormal(2.0, 0.4), 2.0, 1e5)
        assert far.above == pytest.approx(beyond / far.rate, rel=1e-6)


class TestHazardCurve:
    def test_power_between_and_beyond(self):
        curve = HazardCurve([0.1, 0.2, 0.4], [1e-2, 5e-3, 6.25e-4])
        expected = [2e-2, 5e-3 / 2.0**1.5, 6.25e-4 / 8.0]
        assert curve.rate_at([0.05, 0.2 * np.sqrt(2.0), 0.8]) == pytest.approx(expected)
        np.testing.assert_allclose(curve.rate_at(curve.im), curve.rate)
        curve = HazardCurve.from_exceedance([0.1, 0.2, 0.4, 0.8], [1.0, 0.1, 0.02, 0.0], 50.0)
        np.testing.assert_array_equal(curve.im, [0.2, 0.4])  # of 0 and 1 the rate is not known

    @pytest.mark.parametrize(
        ("make", "arguments", "key"),
        [
            (HazardCurve, ([0.1, 0.2], [1e-3, 2e-3]), "rises from 0.001 to 0.002 at im = 0.2"),
            (HazardCurve, ([0.2, 0.1], [2e-3, 1e-3]), "has 0.1 after 0.2"),
            (HazardCurve, ([0.1, 0.2], [1e-3, 1e-3]), "is 0.001 at all its points"),
            (HazardCurve, ([0.1, -0.2], [2e-3, 1e-3]), "im holds -0.2"),
            (HazardCurve, ([0.1], [1e-3]), "has 1 of 1 points"),
            (HazardCurve, ([0.1, 0.2], [1e-3]), "two lists of at least two points"),
            (HazardCurve.from_exceedance, ([0.1, 0.2], [1.2, 0.1], 50.0), r"holds 1\.2"),
            (HazardCurve.from_exceedance, ([0.1, 0.2], [0.2, 0.1], 0.0), "0 years"),
        ],
    )
    def test_refusals(self, make, arguments, key):
        with pytest.raises(InputError, match=key):
            make(*arguments)


class TestBand:
    def test_wide_curves_below_the_hazard_do_not_explode(self):
        """A steep first slope: what lies below the first point adds at most its rate."""
        hazard = HazardCurve([0.3, 0.4, 2.0], [1e-2, 1e-4, 1e-6])
        beta = np.linspace(0.02, 3.0, 50)
        found = collapse_rate(hazard, lognormal(0.5, 0.05), (np.full(50, 0.5), beta))
        assert not found.is_bound
        assert found.rate < found.mean < found.upper < 2e-2
        assert found.probability_in(50.0)[0] == pytest.approx(1.0 - np.exp(-50.0 * found.rate))
        assert found.return_period == pytest.approx(1.0 / found.rate)
        beyond = collapse_rate(hazard, lognormal(0.5, 0.5), (np.full(50, 0.5), beta))
        assert beyond.is_bound
        assert beyond.quoted < 1e-2
        assert np.isnan([beyond.mean, beyond.lower, beyond.upper]).all()

    def test_holds_the_true_rate_as_often_as_claimed(self):
        """90 % with 24 records, whose capacities are seen through 15 levels."""
        generator = np.random.default_rng(8)
        hazard = HazardCurve([0.01, 10.0], 1e-4 * np.array([0.01, 10.0]) ** -2.0)
        truth = 1e-4 * np.exp(0.5 * (2.0 * 0.4) ** 2)
        levels = np.exp(0.4 * np.linspace(-2.2, 2.2, 15))
        held = []
        for repeat in range(120):
            capacity = np.exp(0.4 * generator.standard_normal((24, 1)))
            fit = capacity_posterior(find_brackets(capacity <= levels, levels))[0].fragility
            found = collapse_rate(hazard, fit, parameter_draws(fit, repeat, draws=500))
            held.append(found.lower <= truth <= found.upper)
        assert 0.83 <= np.mean(held) <= 0.96


NAMES = ("a", "b", "c")


def scene(n_record=30, n_level=6, seed=4):
    generator = np.random.default_rng(seed)
    verdict = generator.choice([0, 1, 2, 3], (n_record, n_level), p=[0.3, 0.6, 0.05, 0.05])
    verdict[:, 2] = Verdict.STANDING
    return verdict, generator.integers(0, 3, verdict.shape)


class TestContributions:
    def test_weights_are_the_hazards_not_the_counts(self):
        """One mechanism below, another above: with equal counts their fractions are the rates'."""
        kind = np.tile([0, 1], (10, 1))
        found = contributions([9e-4, 1e-4], np.ones((10, 2), bool), kind, ("low", "high"))
        np.testing.assert_allclose(found.fraction, [0.9, 0.1])
        np.testing.assert_allclose(found.rate.sum(axis=0) + found.unassigned, [9e-4, 1e-4])
        np.testing.assert_allclose([found.lower, found.upper], [[0.9, 0.1]] * 2)

    def test_band_is_that_of_resampled_records(self):
        """At one level it is the band of a binomial fraction of records."""
        kind = (np.arange(400) >= 100).astype(int)[:, None]
        found = contributions([1e-4], np.ones((400, 1), bool), kind, ("rare", "common"))
        half = 1.645 * np.sqrt(0.25 * 0.75 / 400)
        ends = [found.lower[0], found.upper[0]]
        assert ends == pytest.approx([0.25 - half, 0.25 + half], abs=0.006)
        # Four records of each earthquake: a hundred earthquakes, and a band twice as wide.
        event = (np.arange(400) // 4).astype(str)
        fell = np.ones((400, 1), bool)
        found = contributions([1e-4], fell, kind, ("rare", "common"), event=event)
        ends = [found.lower[0], found.upper[0]]
        assert ends == pytest.approx([0.25 - 2 * half, 0.25 + 2 * half], abs=0.012)

    def test_gaps_of_a_bisection_follow_from_their_neighbours(self):
        fell, known = [[0, 0, 0, 0, 0], [0, 1, 0, 0, 1]], [[0, 1, 0, 0, 0], [1, 1, 1, 0, 1]]
        filled, category = implied_collapses(fell, known, [[-1] * 5, [-1, 0, -1, -1, 1]])
        assert filled.astype(int).tolist() == fell
        assert category[1].tolist() == [-1, 0, -1, -1, 1]


class TestDeaggregation:
    def test_every_collapse_is_counted_once_and_nothing_else(self):
        verdict, kind = scene()
        fell = verdict == Verdict.COLLAPSED
        found = deaggregate(verdict, np.where(fell, kind, -7), NAMES)
        for i in range(3):
            assert found.counts[i].tolist() == (fell & (kind == i)).sum(axis=0).tolist()
        assert found.fraction.sum() == pytest.approx(1.0)

    def test_overall_interval_holds_where_records_fall_alike(self):
        """Category by record, collapses of unequal number: coverage at least nominal."""
        generator, held = np.random.default_rng(5), []
        for _ in range(1000):
            first = generator.integers(0, 8, 24)
            verdict = (np.arange(8) >= first[:, None]).astype(int)
            kind = np.broadcast_to(generator.random((24, 1)) < 0.4, verdict.shape).astype(int)
            found = deaggregate(verdict, kind, ("a", "b"))
            held.append(found.lower[1] <= 0.4 <= found.upper[1])
        assert 0.86 < np.mean(held) < 0.95


@pytest.mark.parametrize(
    ("make", "arguments", "key"),
    [
        (collapse_rate, (BENT, CURVE, None, 1.0), "confidence is 1"),
        (collapse_rate, (BENT, CURVE, ([0.5], [0.0])), "beta holds 0"),
        (collapse_rate(BENT, CURVE).probability_in, (0.0,), "years holds 0"),
        (parameter_draws, (lognormal(0.5, np.nan, "stripes"), 1), "not finite"),
        (level_edges, ([0.2, 0.1],), "levels has 0.1 after 0.2"),
        (contributions, ([1e-3], [[1, 0]], [[0, 0]], NAMES), "level_rate has shape"),
        (contributions, ([-1.0], [[1]], [[0]], NAMES), "level_rate holds -1"),
        (deaggregate, ([[1, 0]], [[0]], NAMES), "category has shape"),
        (deaggregate, ([[1, 0]], [[-1, 0]], NAMES), "category holds -1"),
    ],
)
def test_refusals(make, arguments, key):
    with pytest.raises(InputError, match=key):
        make(*arguments)
