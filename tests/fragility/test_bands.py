"""Bands keep what they promise: coverage by simulation, and exact intervals."""

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import binomtest, chi2, norm, t

from archfrag.errors import FitError, InputError
from archfrag.fragility.bands import (
    beta_interval,
    capacity_band,
    confidence_band,
    theta_interval,
)
from archfrag.fragility.brackets import find_brackets
from archfrag.fragility.counts import clopper_pearson, wilson
from archfrag.fragility.fit import fit_brackets, fit_ida, fit_stripes
from archfrag.fragility.quoted import (
    independent_records,
    quoted_band,
    quoted_posterior,
    shared_events,
)
from archfrag.fragility.runs import Resampling

STRIPES = fit_stripes([0.2, 0.4, 0.6, 0.8, 1.0], [0, 3, 4, 13, 16], 40)
CAPACITY = np.random.default_rng(4).lognormal(-0.5, 0.4, 12)


def test_delta_method_is_that_of_the_numerical_derivative():
    def z(ln_theta, beta):
        return (np.log(0.5) - ln_theta) / beta

    a, b, h = np.log(STRIPES.theta), STRIPES.beta, 1e-6
    slope = np.array([z(a + h, b) - z(a - h, b), z(a, b + h) - z(a, b - h)]) / (2 * h)
    reach = norm.ppf(0.975) * np.sqrt(slope @ STRIPES.covariance @ slope)
    band = confidence_band(STRIPES, [0.5, 0.0], confidence=0.95)
    ends = [z(a, b) - reach, z(a, b) + reach]
    assert norm.ppf([band.lower[0], band.upper[0]]) == pytest.approx(ends, rel=1e-8)
    assert (band.lower[1], band.upper[1]) == (0.0, 0.0)
    errors = STRIPES.standard_errors / [1.0, b]
    for interval, error in zip((theta_interval, beta_interval), errors):
        low, high = np.log(interval(STRIPES))
        assert 0.5 * (high - low) == pytest.approx(1.6448536 * error, rel=1e-6)


class TestStudentsT:
    def test_band_is_the_formula_inverted(self):
        """At the ends of the band of ln IM at z, the band of probability ends at Phi(z)."""
        fit, z = fit_ida(CAPACITY), np.linspace(-2.0, 2.0, 9)
        reach = t.ppf(0.95, 11) * fit.beta * np.sqrt(1.0 / 12 + z**2 / 22.0)
        middle = np.log(fit.theta) + z * fit.beta
        assert capacity_band(fit, np.exp(middle - reach)).upper == pytest.approx(norm.cdf(z))
        assert capacity_band(fit, np.exp(middle + reach)).lower == pytest.approx(norm.cdf(z))

    def test_intervals_are_those_of_a_normal_sample(self):
        fit, near = fit_ida(CAPACITY), fit_brackets(0.999 * CAPACITY, 1.001 * CAPACITY)
        reach = t.ppf(0.95, 11) * fit.beta / np.sqrt(12) * np.array([-1.0, 1.0])
        assert np.log(theta_interval(fit)) == pytest.approx(np.log(fit.theta) + reach)
        expected = fit.beta * np.sqrt(11 / chi2.ppf([0.95, 0.05], 11))
        for each, rel in ((fit, 1e-6), (near, 1e-3)):
            assert beta_interval(each) == pytest.approx(expected, rel=rel)

    @pytest.mark.parametrize("n", [2, 12])
    def test_rises_within_0_and_1(self, n):
        band = capacity_band(fit_ida(CAPACITY[:n]), [0.0, *np.geomspace(1e-4, 1e4, 200), np.inf])
        assert np.all(np.diff([band.lower, band.upper]) >= 0.0)
        assert (band.lower[0], band.upper[0], band.lower[-1], band.upper[-1]) == (0, 0, 1, 1)


@pytest.mark.parametrize(("interval", "method"), [(clopper_pearson, "exact"), (wilson, "wilson")])
def test_intervals_of_fractions_are_those_of_scipy(interval, method):
    lower, upper = interval([0, 1, 7, 19, 20, 0], [20] * 5 + [0], 0.9)
    for k, low, high in zip([0, 1, 7, 19, 20], lower, upper):
        other = binomtest(k, 20).proportion_ci(0.9, method=method)
        assert (low, high) == pytest.approx((other.low, other.high), abs=1e-10)
    assert np.isnan([lower[-1], upper[-1]]).all()


BETA = 0.35
GRID = np.exp(BETA * np.linspace(-2.2, 2.2, 15))
P = np.array([0.1, 0.25, 0.5, 0.75, 0.9])
IM = np.exp(BETA * ndtri(P))


def table(generator, n_record):
    return (np.exp(BETA * generator.standard_normal((n_record, 1))) <= GRID).astype(int)


def alone(generator):
    at = np.tile(GRID, 2)
    return (np.exp(BETA * generator.standard_normal(30)) <= at) * 1, at, None


def in_events(generator):
    z = generator.standard_normal((8, 1)) + generator.standard_normal((8, 3))
    capacity = np.exp(BETA * z.reshape(-1, 1) / np.sqrt(2.0))
    return (capacity <= GRID).astype(int), GRID, np.arange(24) // 3


def scattered_runs(generator):
    """Half of the records stand again above a level at which they collapsed."""
    capacity = 0.28 * generator.standard_normal((24, 1)) + 0.21 * generator.standard_normal(
        (24, 15)
    )
    return (np.exp(capacity) <= GRID).astype(int), GRID, None


TABLE = table(np.random.default_rng(1), 24)


class TestQuoted:
    @pytest.mark.parametrize(
        ("design", "draw", "n_study", "limits"),
        [
            ("stripes", lambda g: (table(g, 24), GRID, None), 120, (0.865, 0.935)),
            ("stripes", scattered_runs, 160, (0.865, 0.935)),
            ("scattered", alone, 100, (0.865, 0.935)),
            ("stripes", in_events, 60, (0.85, 0.95)),
            ("stripes", lambda g: (*in_events(g)[:2], None), 60, (0.0, 0.83)),
        ],
        ids=["records", "records not monotone", "runs", "events", "events not known"],
    )
    def test_coverage(self, design, draw, n_study, limits):
        """Of the curve at `P` together, of theta, and of beta: a sixth too narrow fails."""
        generator, held = np.random.default_rng(15), np.zeros(3)
        for _ in range(n_study):
            verdict, intensity, groups = draw(generator)
            known = quoted_band(design, verdict, intensity, IM, groups=groups)
            held[0] += np.mean((known.band.lower <= P) & (known.band.upper >= P))
            held[1] += known.theta[0] <= 1.0 <= known.theta[1]
            held[2] += known.beta[0] <= BETA <= known.beta[1]
        assert limits[0] < held[0] / n_study < limits[1]
        assert draw is in_events or limits[0] == 0.0 or np.all(held[1:] > 0.85 * n_study)

    def test_bisected_levels_hold_what_the_grid_holds(self):
        """Only the two runs next to the border of each record: nothing else was known."""
        border = np.argmax(np.hstack([TABLE, np.ones((24, 1), int)]), axis=1)[:, None]
        near = (np.arange(15) == border) | (np.arange(15) == border - 1)
        one = quoted_band("stripes", TABLE, GRID, IM)
        for design in ("ida", "two_stage"):
            other = quoted_band(design, np.where(near, TABLE, 2), GRID, IM)
            assert np.array_equal(one.band.lower, other.band.lower)
            assert one.theta == other.theta

    def test_alike_records_are_worth_their_events(self):
        capacity = np.repeat(np.exp(BETA * np.random.default_rng(1).standard_normal(10)), 3)
        found = find_brackets((capacity[:, None] <= GRID) * 1, GRID, "count")
        assert independent_records(found, np.arange(30) // 3) == pytest.approx(10.0)
        assert independent_records(found, np.arange(30)) == 30.0
        assert independent_records(found, np.arange(30) % 10) > 15.0
        assert shared_events(["a", "b", ""]) is None
        assert shared_events(["a", "a"]) is None
        assert shared_events(["a", "a", ""]).tolist() == ["a", "a", "record 2"]


@pytest.mark.parametrize(
    ("make", "arguments", "kind", "key"),
    [
        (confidence_band, (STRIPES, 0.5, 90.0), InputError, "confidence is 90"),
        (capacity_band, (STRIPES, 0.5), InputError, "'stripes'"),
        (Resampling, (1, 10), InputError, "resamples is 10"),
        (quoted_band, ("cloud", [[0, 1]], [0.1, 0.2], 0.1), InputError, "design is 'cloud'"),
        (quoted_band, ("scattered", [0, 1], [0.1], 0.1), InputError, "intensity has shape"),
        (quoted_band, ("scattered", [2, 3], [0.1, 0.2], 0.1), FitError, "no run collapsed"),
        (quoted_band, ("stripes", TABLE[:2, :3] * 0, GRID[:3], 1.0), FitError, "add levels above"),
        (quoted_posterior, ("stripes", TABLE, GRID, [1] * 24), FitError, "one group, 1"),
        (quoted_posterior, ("stripes", TABLE, GRID, [1, 2]), InputError, r"shape \(2,\)"),
        (quoted_posterior, ("scattered", TABLE, GRID, [1] * 24), InputError, "are of records"),
    ],
)
def test_refusals(make, arguments, kind, key):
    with pytest.raises(kind, match=key):
        make(*arguments)
