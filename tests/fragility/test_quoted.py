"""Verdicts and brackets, bands that keep what they promise, isotonic curves, tests of fit."""

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import binomtest
from sklearn.isotonic import IsotonicRegression

from archfrag.errors import FitError
from archfrag.fragility import quoted
from archfrag.fragility.quoted import (
    check_lognormal,
    independent_records,
    isotonic_curve,
    quoted_band,
    shared_events,
)
from archfrag.fragility.verdicts import (
    clopper_pearson,
    count_verdicts,
    draws_of_records,
    find_brackets,
    wilson,
)

BETA = 0.35
GRID = np.exp(BETA * np.linspace(-2.2, 2.2, 15))
LOW = np.exp(BETA * np.linspace(-2.2, 0.0, 15))
LEVELS = np.geomspace(0.1, 1.2, 12)
P = np.array([0.1, 0.25, 0.5, 0.75, 0.9])
IM = np.exp(BETA * ndtri(P))
EVENTS = np.arange(24) // 3


FEW = np.array([0.2, 0.3, 0.4, 0.5, 0.7])


def test_each_verdict_at_each_level():
    counts = count_verdicts([[0, 1, 4], [0, 2, 4], [1, 3, 1], [5, 4, 4]])
    assert {name: each.tolist() for name, each in counts.items()} == {
        "survived": [2, 0, 0],
        "collapsed": [1, 1, 1],
        "unfinished": [0, 1, 0],
        "failed": [0, 1, 0],
        "collapsed_before": [1, 0, 0],
        "n": [3, 1, 1],
        "runs": [4, 3, 1],
        "fraction": [1 / 3, 1.0, 1.0],
    }


@pytest.mark.parametrize(
    ("row", "ends", "contradictions"),
    [
        ([0, 0, 1, 1, 1], (0.3, 0.4), 0),
        ([1, 1, 1, 1, 1], (0.0, 0.2), 0),
        ([0, 0, 0, 0, 0], (0.7, np.inf), 0),
        ([0, 1, 0, 0, 1], (0.5, 0.7), 1),
        ([0, 2, 3, 1, 4], (0.2, 0.5), 0),
        ([0, 1, 2, 0, 1], (0.2, 0.3), 1),
    ],
)
def test_border_is_the_one_that_the_fewest_verdicts_contradict(
    row, ends, contradictions
):
    for order in (slice(None), slice(None, None, -1)):
        found = find_brackets([row[order]], FEW[order])
        assert (found.lower[0], found.upper[0]) == ends
        assert found.contradictions[0] == contradictions


def test_undecided_records_are_left_out():
    found = find_brackets([[0, 0, 1, 1, 1], [2, 3, 2, 4, 2], [1, 0, 0, 0, 0]], FEW)
    assert (found.lower[1], found.upper[1], found.run[1]) == (0.0, np.inf, False)
    assert found.of_records().lower.size == 2
    assert found.middle[0] == pytest.approx(np.sqrt(0.12))
    assert np.isnan(found.middle[1])


def test_bisected_grid_is_filled_to_the_grid_it_stands_for_and_has_its_band():
    """Only the two runs next to the border of each record: nothing else was known."""
    capacity = np.random.default_rng(1).uniform(0.1, 0.9, 40)
    full = (capacity[:, None] <= FEW).astype(int)
    border = np.argmax(np.hstack([full, np.ones((40, 1), int)]), axis=1)[:, None]
    near = (np.arange(5) == border) | (np.arange(5) == border - 1)
    bisected = np.where(near, full, 4)
    assert np.count_nonzero(bisected == 4) > 50
    one, other = (find_brackets(verdict, FEW) for verdict in (full, bisected))
    assert np.array_equal(other.filled, full)
    bands = quoted_band(one, FEW), quoted_band(other, FEW)
    assert (bands[0].lower, bands[0].theta) == (bands[1].lower, bands[1].theta)


@pytest.mark.parametrize(
    ("interval", "method"), [(clopper_pearson, "exact"), (wilson, "wilson")]
)
def test_intervals_of_fractions_are_those_of_scipy(interval, method):
    lower, upper = interval(
        np.array([0, 1, 7, 19, 20, 0]), np.repeat([20, 0], [5, 1]), 0.9
    )
    for k, low, high in zip([0, 1, 7, 19, 20], lower, upper):
        other = binomtest(k, 20).proportion_ci(0.9, method=method)
        assert (low, high) == pytest.approx((other.low, other.high), abs=1e-10)
    assert np.isnan([lower[-1], upper[-1]]).all()


def brackets(generator, n, levels, rho=1.0, mean=0.0, beta=BETA):
    """Records whose capacities at the levels are correlated by rho: below 1 not monotone."""
    z = np.sqrt(rho) * generator.standard_normal((n, 1))
    if rho < 1.0:
        z = z + np.sqrt(1.0 - rho) * generator.standard_normal((n, levels.size))
    return find_brackets(mean + beta * z <= np.log(levels), levels)


def single_runs(generator, n):
    x = generator.normal(-1.0, 0.6, (n, 1))
    return find_brackets(x >= generator.normal(-1.0, 0.4, (n, 1)), np.exp(x))


def band_of_single_runs(generator):
    at = np.tile(GRID, 2)[:, None]
    fell = np.exp(BETA * generator.standard_normal((30, 1))) <= at
    return quoted_band(find_brackets(fell, at), IM)


def band_in_events(generator, groups):
    z = generator.standard_normal((8, 1)) + generator.standard_normal((8, 3))
    capacity = np.exp(BETA * z.reshape(-1, 1) / np.sqrt(2.0))
    return quoted_band(find_brackets(capacity <= GRID, GRID), IM, groups=groups)


STUDIES = {
    "monotone": (lambda g: quoted_band(brackets(g, 24, GRID), IM), 120, (0.865, 0.935)),
    "not monotone": (
        lambda g: quoted_band(brackets(g, 24, GRID, 0.64), IM),
        160,
        (0.865, 0.935),
    ),
    "half survive": (
        lambda g: quoted_band(brackets(g, 24, LOW, 0.64), IM),
        160,
        (0.85, 0.935),
    ),
    "single runs": (band_of_single_runs, 100, (0.865, 0.935)),
    "in events": (lambda g: band_in_events(g, EVENTS), 60, (0.85, 0.95)),
    "events not known": (lambda g: band_in_events(g, None), 60, (0.0, 0.83)),
}


class TestQuoted:
    @pytest.mark.parametrize("name", STUDIES)
    def test_coverage(self, name):
        """Of the curve at `P` together, of theta and of beta: a sixth too narrow fails."""
        study, n_study, limits = STUDIES[name]
        generator = np.random.default_rng(15)
        held = np.zeros(3)
        for _ in range(n_study):
            known = study(generator)
            held[0] += np.mean((known.lower <= P) & (known.upper >= P))
            held[1] += known.theta_interval[0] <= 1.0 <= known.theta_interval[1]
            held[2] += known.beta_interval[0] <= BETA <= known.beta_interval[1]
        held /= n_study
        assert limits[0] < held[0] < limits[1]
        if name != "events not known":
            assert np.all(held[1:] > limits[0] - 0.03)

    def test_alike_records_count_as_their_events(self):
        capacity = np.repeat(
            np.exp(BETA * np.random.default_rng(1).standard_normal(10)), 3
        )
        found = find_brackets(capacity[:, None] <= GRID, GRID)
        assert independent_records(found, np.arange(30) // 3) == pytest.approx(10.0)
        assert independent_records(found, np.arange(30)) == 30.0
        assert independent_records(found, np.arange(30) % 10) > 15.0
        assert shared_events(["a", "b", ""]) is shared_events(["a", "a"]) is None
        assert shared_events(["a", "a", ""]).tolist() == ["a", "a", "record 2"]
        times = draws_of_records(["a", "a", "b", "c"], 4, 1, 200)
        assert np.all(times[:, 0] == times[:, 1])
        assert times.sum(axis=1).mean() == pytest.approx(4.0, abs=0.2)

    def test_records_of_a_single_run_need_no_bracket(self):
        """Whatever their levels: brackets of one end gave a beta of 0 and a numpy warning."""
        generator = np.random.default_rng(12)
        for _ in range(30):
            im = 1.4 * np.exp(0.5 * generator.standard_normal((8, 1)))
            fell = im >= 1.4 * np.exp(0.4 * generator.standard_normal((8, 1)))
            if fell.all() or not fell.any():
                continue
            codes = np.hstack([fell, np.full((8, 1), 4)])
            levels = np.hstack([im, 2.0 * im])
            found = quoted_band(find_brackets(codes, levels), [])
            assert found.theta == quoted_band(find_brackets(fell, im), []).theta
            assert found.beta > 0.05

    @pytest.mark.parametrize("spread", [0.03, 0.1])
    def test_contradictions_where_one_capacity_agrees_with_all_brackets(self, spread):
        levels = np.geomspace(0.5, 2.0, 8)
        generator = np.random.default_rng(3)
        codes = np.tile((levels > 1.0).astype(int), (12, 1))
        codes[generator.integers(0, 12, 2), 4] = 0
        codes[0, 3:6] = 1, 0, 1
        curve = quoted_band(find_brackets(codes, levels * (1.0 + spread)), [])
        assert curve.n_non_monotone
        assert 0.8 < curve.theta < 1.4
        assert 0.02 < curve.beta < 0.6
        codes = np.tile([1, 0], (5, 1))  # no record has both ends, and all contradict
        codes[:2] = 0
        assert quoted_band(find_brackets(codes, [0.5, 0.7]), []).beta > 0.1


def shaped(generator, n=30, rho=1.0):
    return brackets(generator, n, LEVELS, rho, -1.0, 0.4)


class TestIsotonic:
    def test_is_that_of_scikit_learn(self):
        generator = np.random.default_rng(2)
        cases = []
        for _ in range(10):
            found = shaped(generator, rho=0.5)
            cases.append((found, LEVELS, (found.verdict == 1).mean(axis=0)))
        found = single_runs(generator, 200)
        order = np.argsort(found.levels[:, 0])
        cases.append((found, found.levels[order, 0], (found.verdict == 1)[order, 0]))
        for found, im, collapsed in cases:
            other = IsotonicRegression().fit_transform(im, collapsed)
            assert isotonic_curve(found)["probability"] == pytest.approx(
                other, abs=1e-12
            )

    def test_band_has_the_width_of_a_binomial_where_levels_are_independent(self):
        found = shaped(np.random.default_rng(4), n=60)
        curve = isotonic_curve(found, resamples=2000)
        p = (found.verdict == 1)[:, 6].mean()
        width = curve["upper"] - curve["lower"]
        assert width[6] == pytest.approx(
            2 * 1.645 * np.sqrt(p * (1 - p) / 60), rel=0.15
        )


class TestOfFit:
    @pytest.mark.parametrize("rho", [1.0, 0.5, None])
    def test_size(self, rho):
        """Of 60 lognormal studies, within three standard errors. None: records of one run."""
        p = []
        for i in range(60):
            draw = np.random.default_rng(i)
            found = single_runs(draw, 150) if rho is None else shaped(draw, rho=rho)
            p.append(check_lognormal(found, seed=i, resamples=100)[0])
        assert np.mean(np.array(p) < 0.5) == pytest.approx(0.5, abs=0.19)
        assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.12)

    def test_two_populations_are_found(self):
        generator = np.random.default_rng(1)
        centre = np.where(generator.random((40, 1)) < 0.5, -2.0, -0.4)
        found = find_brackets(np.log(LEVELS) >= generator.normal(centre, 0.12), LEVELS)
        assert check_lognormal(found, resamples=200)[0] < 0.01

    @pytest.mark.parametrize("rho", [0.3, 0.9, 1.0])
    def test_correlation_of_a_record_is_recovered(self, rho):
        found = shaped(np.random.default_rng(2), n=400, rho=rho)
        assert check_lognormal(found, seed=3, resamples=100)[1] == pytest.approx(
            rho, abs=0.07
        )


def test_the_band_and_the_test_of_its_shape_fit_the_same_runs_once(monkeypatch):
    """Records that contradict themselves, where a fit takes a tenth of a second."""
    calls = []
    fit = quoted.fit_capacity_posterior
    monkeypatch.setattr(
        quoted, "fit_capacity_posterior", lambda *a: calls.append(a) or fit(*a)
    )
    rows = [[0, 1, 0, 1, 1], [0, 0, 0, 1, 1], [0, 0, 0, 0, 1], [0, 1, 1, 1, 1]]
    found = find_brackets(rows, FEW)
    quoted_band(found, FEW)
    check_lognormal(found, resamples=10)
    assert len(calls) == 1


class TestCrossed:
    """Rows that are alike in several ways: by earthquake and first shock, by record and arch."""

    @staticmethod
    def drawn(seed, rows, records, of_rows, of_records=0.4, own=0.1):
        """Brackets of `rows` arches under `records`, with the record and the arch of each."""
        generator = np.random.default_rng(seed)
        logs = of_rows * generator.standard_normal((rows, 1))
        logs = logs + of_records * generator.standard_normal((1, records))
        logs = logs + own * generator.standard_normal((rows, records))
        levels = np.geomspace(0.2, 5.0, 15)
        found = find_brackets(
            (np.exp(logs.reshape(-1, 1)) <= levels).astype(int), levels
        )
        place = np.indices((rows, records)).reshape(2, -1)
        return found, place[::-1].astype(str)

    def test_groups_that_cross_evenly_are_those_of_two_factors(self):
        found, groups = self.drawn(1, 6, 24, 0.3)
        number = independent_records(found, groups)
        y = quoted._standardised(found).reshape(6, 24)
        arch = y.mean(axis=1)
        record = y.mean(axis=0)
        rest = y - arch[:, None] - record + y.mean()
        error = (rest**2).sum() / (5 * 23)
        parts = np.array(
            [arch.var(ddof=1) - error / 24, record.var(ddof=1) - error / 6]
        )
        sizes = np.array([24, 6])
        whole = parts.sum() + error
        rho = parts / whole
        rho += (
            0.5 * (1 - rho) * (1 + (sizes - 1) * rho) / np.sqrt(144 * (sizes - 1) / 2)
        )
        assert number == pytest.approx(144 / (1 + ((sizes - 1) * rho).sum()), rel=1e-9)

    def test_one_way_told_twice_is_one_way(self):
        found, (record, _) = self.drawn(2, 4, 12, 0.0)
        once = independent_records(found, record)
        assert independent_records(found, np.array([record, record])) == pytest.approx(
            once
        )
        halves = np.array(
            [str(int(each) // 2) for each in record]
        )  # which records lie within
        assert independent_records(found, np.array([record, halves])) <= 1.1 * once

    def test_one_group_is_refused(self):
        found, (record, _) = self.drawn(2, 4, 12, 0.0)
        with pytest.raises(
            FitError, match="all rows belong to one group, x; two are needed"
        ):
            independent_records(found, np.array([record, np.full(record.size, "x")]))

    @pytest.mark.parametrize("rows", [3, 5, 10])
    def test_rows_of_a_stock_hold_its_median(self, rows):
        held = {"record": [], "record and row": []}
        for seed in range(30):
            found, groups = self.drawn(seed, rows, 16, 0.3)
            for what, own in zip(held, (groups[0], groups)):
                low, high = quoted_band(found, IM, groups=own).theta_interval
                held[what].append(low <= 1.0 <= high)
        assert np.mean(held["record"]) < 0.85
        assert np.mean(held["record and row"]) >= 0.8

    def test_first_shocks_in_turn_hold_the_median_after_them(self):
        held = {"event": [], "first shock": [], "both": []}
        levels = np.geomspace(0.2, 5.0, 15)
        events = np.arange(24) // 2
        turn = np.arange(24) % 3
        for seed in range(40):
            generator = np.random.default_rng(seed)
            z = np.sqrt(0.5) * generator.standard_normal(12)[events]
            z = 0.4 * (z + np.sqrt(0.5) * generator.standard_normal(24))
            z += 0.25 * generator.standard_normal(3)[turn]
            found = find_brackets((np.exp(z[:, None]) <= levels).astype(int), levels)
            ways = events.astype(str), turn.astype(str)
            for what, own in zip(held, (*ways, np.array(ways))):
                low, high = quoted_band(found, IM, groups=own).theta_interval
                held[what].append(low <= 1.0 <= high)
        assert np.mean(held["event"]) < 0.8
        assert np.mean(held["both"]) >= max(0.85, np.mean(held["first shock"]))
