"""Bands keep what they promise, the isotonic curve, and the test of the lognormal shape."""

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import binomtest
from sklearn.isotonic import IsotonicRegression

from archfrag.errors import FitError, InputError
from archfrag.fragility.counts import clopper_pearson, draws_of_records, find_brackets, wilson
from archfrag.fragility.quoted import (
    check_lognormal,
    independent_records,
    isotonic_curve,
    quoted_band,
    quoted_runs,
    shared_events,
)


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


def standing(generator):
    """Half of the runs survive the highest level, and half of the records are not monotone."""
    levels = np.exp(BETA * np.linspace(-2.2, 0.0, 15))
    capacity = 0.28 * generator.standard_normal((24, 1)) + 0.21 * generator.standard_normal(
        (24, 15)
    )
    return quoted_band(find_brackets(np.exp(capacity) <= levels, levels), IM)


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
            (standing, 160, (0.85, 0.935)),
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
            assert np.all(held[1:] > limits[0] - 0.03)

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
