"""Bands keep what they promise: coverage by simulation, and what records of one event count."""

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import binomtest, norm

from archfrag.errors import FitError, InputError
from archfrag.fragility.brackets import find_brackets
from archfrag.fragility.counts import clopper_pearson, wilson
from archfrag.fragility.fit import fit_stripes
from archfrag.fragility.quoted import (
    independent_records,
    quoted_band,
    quoted_runs,
    shared_events,
)

STRIPES = fit_stripes([0.2, 0.4, 0.6, 0.8, 1.0], [0, 3, 4, 13, 16], 40)


def test_delta_method_is_that_of_the_numerical_derivative():
    def z(ln_theta, beta):
        return (np.log(0.5) - ln_theta) / beta

    a, b, h = np.log(STRIPES.theta), STRIPES.beta, 1e-6
    slope = np.array([z(a + h, b) - z(a - h, b), z(a, b + h) - z(a, b - h)]) / (2 * h)
    reach = norm.ppf(0.975) * np.sqrt(slope @ STRIPES.covariance @ slope)
    lower, upper = STRIPES.band([0.5, 0.0], confidence=0.95)
    assert norm.ppf([lower[0], upper[0]]) == pytest.approx([z(a, b) - reach, z(a, b) + reach])
    assert (lower[1], upper[1]) == (0.0, 0.0)
    errors = STRIPES.standard_errors / [1.0, b]
    for interval, error in zip((STRIPES.theta_interval(), STRIPES.beta_interval()), errors):
        low, high = np.log(interval)
        assert 0.5 * (high - low) == pytest.approx(1.6448536 * error, rel=1e-6)


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


def records(generator):
    return quoted_band(find_brackets(table(generator, 24), GRID), IM)


def not_monotone(generator):
    """Half of the records survive again above a level at which they collapsed."""
    own = generator.standard_normal((24, 1))
    capacity = np.exp(0.28 * own + 0.21 * generator.standard_normal((24, 15)))
    return quoted_band(find_brackets(capacity <= GRID, GRID), IM)


def single(generator):
    at = np.tile(GRID, 2)
    return quoted_runs(at, np.exp(BETA * generator.standard_normal(30)) <= at, IM)


EVENTS = np.arange(24) // 3


def in_events(generator, groups=EVENTS):
    z = generator.standard_normal((8, 1)) + generator.standard_normal((8, 3))
    capacity = np.exp(BETA * z.reshape(-1, 1) / np.sqrt(2.0))
    return quoted_band(find_brackets(capacity <= GRID, GRID), IM, groups=groups)


def events_not_known(generator):
    return in_events(generator, None)


TABLE = table(np.random.default_rng(1), 24)


class TestQuoted:
    @pytest.mark.parametrize(
        ("study", "n_study", "limits"),
        [
            (records, 120, (0.865, 0.935)),
            (not_monotone, 160, (0.865, 0.935)),
            (single, 100, (0.865, 0.935)),
            (in_events, 60, (0.85, 0.95)),
            (events_not_known, 60, (0.0, 0.83)),
        ],
    )
    def test_coverage(self, study, n_study, limits):
        """Of the curve at `P` together, of theta and of beta: a sixth too narrow fails."""
        generator, held = np.random.default_rng(15), np.zeros(3)
        for _ in range(n_study):
            known = study(generator)
            held[0] += np.mean((known.lower <= P) & (known.upper >= P))
            held[1] += known.theta[0] <= 1.0 <= known.theta[1]
            held[2] += known.beta[0] <= BETA <= known.beta[1]
        held /= n_study
        assert limits[0] < held[0] < limits[1]
        if study is not events_not_known:
            assert np.all(held[1:] > 0.85)

    def test_bisected_levels_hold_what_the_grid_holds(self):
        """Only the two runs next to the border of each record: nothing else was known."""
        border = np.argmax(np.hstack([TABLE, np.ones((24, 1), int)]), axis=1)[:, None]
        near = (np.arange(15) == border) | (np.arange(15) == border - 1)
        one, other = (
            quoted_band(find_brackets(verdict, GRID), IM)
            for verdict in (TABLE, np.where(near, TABLE, 2))
        )
        assert np.array_equal(one.lower, other.lower)
        assert one.theta == other.theta

    def test_alike_records_count_as_their_events(self):
        capacity = np.repeat(np.exp(BETA * np.random.default_rng(1).standard_normal(10)), 3)
        found = find_brackets(capacity[:, None] <= GRID, GRID)
        assert independent_records(found, np.arange(30) // 3) == pytest.approx(10.0)
        assert independent_records(found, np.arange(30)) == 30.0
        assert independent_records(found, np.arange(30) % 10) > 15.0
        assert shared_events(["a", "b", ""]) is None
        assert shared_events(["a", "a"]) is None
        assert shared_events(["a", "a", ""]).tolist() == ["a", "a", "record 2"]


FOUND = find_brackets(TABLE, GRID)
STANDING = find_brackets(TABLE[:2, :3] * 0, GRID[:3])


@pytest.mark.parametrize(
    ("make", "arguments", "kind", "key"),
    [
        (STRIPES.band, (0.5, 90.0), InputError, "confidence is 90"),
        (quoted_runs, ([], [], 0.1), FitError, "no run collapsed"),
        (quoted_band, (find_brackets([[2, 3]], [1, 2]), 1.0), FitError, "no run collapsed"),
        (quoted_band, (STANDING, 1.0), FitError, "add levels above"),
    ],
)
def test_refusals(make, arguments, kind, key):
    with pytest.raises(kind, match=key):
        make(*arguments)


@pytest.mark.parametrize(
    ("groups", "kind", "key"),
    [([1] * 24, FitError, "one group, 1"), ([1, 2], InputError, r"shape \(2,\)")],
)
def test_groups_that_do_not_fit(groups, kind, key):
    with pytest.raises(kind, match=key):
        quoted_band(FOUND, 1.0, groups=groups)
