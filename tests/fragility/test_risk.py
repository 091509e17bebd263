"""Rate of collapse: closed forms, quadrature, bands, and its division by category."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from archfrag.fragility.curve import Curve
from archfrag.fragility.quoted import capacity_posterior
from archfrag.fragility.risk import (
    HazardCurve,
    collapse_rate,
    contributions,
    mean_of,
    rate_by_level,
)
from archfrag.fragility.verdicts import Verdict, find_brackets

IM = np.geomspace(0.05, 2.0, 9)
BENT = HazardCurve(IM, np.exp(-7.0 - 2.0 * np.log(IM) - 0.3 * np.log(IM) ** 2))


def lognormal(theta, beta):
    return Curve(theta, beta, np.diag([0.01, 0.005]), 0.0, 5, 30, "ida")


def by_quadrature(hazard, curve, low, high):
    """Integral of P |d lambda| from rates of exceedance alone."""
    knots = np.unique(
        np.clip(np.log([low, *hazard.im, high]), np.log(low), np.log(high))
    )
    total = 0.0
    for a, b in pairwise(knots):
        fall = np.log(hazard.rate_at(np.exp(a)) / hazard.rate_at(np.exp(b))) / (b - a)
        total += quad(
            lambda x, k=fall: (
                curve.probability(np.exp(x)) * k * hazard.rate_at(np.exp(x))
            ),
            a,
            b,
            epsabs=0.0,
            epsrel=1e-11,
        )[0]
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
        assert parts[2] == pytest.approx(
            by_quadrature(BENT, curve, 0.33, 0.7), rel=1e-9
        )
        assert parts.sum() == pytest.approx(
            by_quadrature(BENT, curve, 1e-3, 1e4), rel=1e-7
        )
        far = collapse_rate(BENT, lognormal(2.0, 0.4))
        beyond = by_quadrature(BENT, lognormal(2.0, 0.4), 2.0, 1e5)
        assert far.above == pytest.approx(beyond / far.rate, rel=1e-6)

    def test_hazard_is_a_power_between_and_beyond(self):
        curve = HazardCurve([0.1, 0.2, 0.4], [1e-2, 5e-3, 6.25e-4])
        expected = [2e-2, 5e-3 / 2.0**1.5, 6.25e-4 / 8.0]
        assert curve.rate_at([0.05, 0.2 * np.sqrt(2.0), 0.8]) == pytest.approx(expected)
        np.testing.assert_allclose(curve.rate_at(curve.im), curve.rate)
        curve = HazardCurve.from_exceedance(
            [0.1, 0.2, 0.4, 0.8], [1.0, 0.1, 0.02, 0.0], 50.0
        )
        np.testing.assert_array_equal(
            curve.im, [0.2, 0.4]
        )  # of 0 and 1 the rate is not known


class TestBand:
    def test_wide_curves_below_the_hazard_do_not_explode(self):
        """A steep first slope: what lies below the first point adds at most its rate."""
        hazard = HazardCurve([0.3, 0.4, 2.0], [1e-2, 1e-4, 1e-6])
        beta = np.linspace(0.02, 3.0, 50)
        found = collapse_rate(hazard, lognormal(0.5, 0.05), (np.full(50, 0.5), beta))
        assert not found.is_bound
        assert found.rate < found.mean < found.upper < 2e-2
        assert found.probability_in(50.0)[0] == pytest.approx(
            1.0 - np.exp(-50.0 * found.rate)
        )
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
            fit = capacity_posterior(find_brackets(capacity <= levels, levels))[0].curve
            found = collapse_rate(hazard, fit, fit.draws(repeat, 500))
            held.append(found.lower <= truth <= found.upper)
        assert 0.83 <= np.mean(held) <= 0.96


class TestContributions:
    def test_weights_are_the_hazards_not_the_counts(self):
        """One mechanism below, another above: with equal counts their fractions are the rates'."""
        kind = np.tile([0, 1], (10, 1))
        found = contributions(
            np.ones((10, 2), bool), kind, ("low", "high"), [9e-4, 1e-4]
        )
        np.testing.assert_allclose(found.fraction, [0.9, 0.1])
        np.testing.assert_allclose(
            found.rate.sum(axis=0) + found.unassigned, [9e-4, 1e-4]
        )

    def test_every_collapse_is_counted_once_and_nothing_else(self):
        generator = np.random.default_rng(4)
        verdict = generator.choice([0, 1, 2, 3], (30, 6), p=[0.3, 0.6, 0.05, 0.05])
        verdict[:, 2] = Verdict.SURVIVED
        kind = generator.integers(0, 3, verdict.shape)
        fell = verdict == Verdict.COLLAPSED
        found = contributions(fell, np.where(fell, kind, -7), "abc")
        for i in range(3):
            assert found.counts[i].tolist() == (fell & (kind == i)).sum(axis=0).tolist()
        assert found.fraction.sum() == pytest.approx(1.0)

    def test_overall_interval_holds_where_records_fall_alike(self):
        """Category by record, collapses of unequal number: coverage at least nominal."""
        generator = np.random.default_rng(5)
        held = []
        for _ in range(1000):
            first = generator.integers(0, 8, 24)
            verdict = (np.arange(8) >= first[:, None]).astype(int)
            kind = np.broadcast_to(
                generator.random((24, 1)) < 0.4, verdict.shape
            ).astype(int)
            found = contributions(verdict == 1, kind, ("a", "b"))
            held.append(found.lower[1] <= 0.4 <= found.upper[1])
        assert 0.86 < np.mean(held) < 0.95

    @pytest.mark.parametrize("alike", [True, False])
    def test_interval_holds_where_records_of_an_event_fall_alike(self, alike):
        """12 events of 2 records each; counted as 24 it held in 77 % of such studies."""
        generator = np.random.default_rng(5)
        held = []
        event = np.arange(24) // 2
        for _ in range(400):
            verdict = np.arange(8) >= generator.integers(0, 8, 24)[:, None]
            draw = (
                generator.random((12, 1))[event] if alike else generator.random((24, 1))
            )
            kind = np.broadcast_to(draw < 0.4, verdict.shape)
            found = contributions(verdict, kind.astype(int), ("a", "b"), groups=event)
            held.append(found.lower[1] <= 0.4 <= found.upper[1])
        assert 0.86 < np.mean(held) < 0.97


class TestOnset:
    """Below the onset of motion nothing collapses: the rate is an integral from there on."""

    @pytest.mark.parametrize("onset", [1e-4, 0.02, 0.3, 1.1, 5.0])
    def test_against_quadrature(self, onset):
        found, whole = (
            collapse_rate(BENT, lognormal(0.8, 0.5), onset=o) for o in (onset, 0.0)
        )
        assert found.rate == pytest.approx(
            by_quadrature(BENT, lognormal(0.8, 0.5), onset, 1e6), rel=1e-6
        )
        assert found.below_onset == pytest.approx(
            whole.rate - found.rate, rel=1e-9, abs=1e-15
        )
        assert whole.below_onset == 0.0

    def test_each_arch_of_a_class_has_its_own(self):
        parts = [lognormal(0.6, 0.4), lognormal(1.2, 0.5)]
        both = mean_of(parts[0], np.vstack([fit.parts for fit in parts]), "mixture")
        onsets = np.array([0.4, 0.7])
        found = collapse_rate(BENT, both, onset=onsets)
        alone = [collapse_rate(BENT, p, onset=o).rate for p, o in zip(parts, onsets)]
        assert found.rate == pytest.approx(np.mean(alone), rel=1e-12)
        by_level = rate_by_level(BENT, both, [0.5, 1.0], onsets)
        assert by_level.sum() == pytest.approx(found.rate, rel=1e-12)
        assert by_level[0] < rate_by_level(BENT, both, [0.5, 1.0])[0]

    def test_band_and_mean_leave_the_same_part_out(self):
        fit = lognormal(0.8, 0.5)
        none, some = (
            collapse_rate(BENT, fit, fit.draws(1), onset=onset) for onset in (0.0, 0.5)
        )
        assert some.lower < some.rate < some.upper < none.upper
        assert some.mean < none.mean
