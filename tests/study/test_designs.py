"""Designs on made-up tables of verdicts: what they ask for, that they end, what they find."""

from dataclasses import replace

import numpy as np
import pytest

from archfrag.fragility.counts import Verdict, find_brackets
from archfrag.fragility.quoted import capacity_posterior, quoted_band
from archfrag.study.runs.design import Grid, ask
from archfrag.study.runs.ida import (
    LEAST_RECORDS,
    NEAR,
    Ida,
    Precision,
    expected_borders,
    look,
    search,
)

LEVELS = np.linspace(0.05, 0.75, 15)


def grid_of(n_record, n_level=15, measures=None):
    if measures is None:
        measures = np.empty((n_record, 0))
    return Grid(0, np.arange(n_record), LEVELS[:n_level], np.ones(n_record), 1.0, measures)


def monotone(first, n_level=15):
    """Verdicts of records of which the lowest collapsing level is known, (n_record, n_level)."""
    return (np.arange(n_level) >= np.asarray(first)[:, None]).astype(np.int8)


def lognormal(seed, n_record=30, theta=0.3, beta=0.4):
    """Table of records with lognormal capacities, and these."""
    drawn = np.random.default_rng(seed).standard_normal(n_record)
    capacity = theta * np.exp(beta * drawn)
    return monotone(np.searchsorted(LEVELS, capacity)), capacity


def driven(requests, table):
    """What a design returns, and all cells that it requested, none of them twice."""
    cases, notes = ask(
        {0: requests}, lambda cases: table[cases["record"], cases["place"]].astype(np.int8)
    )
    asked = list(zip(cases["record"].tolist(), cases["place"].tolist()))
    assert len(asked) == len(set(asked)), "a cell was asked for twice"
    return notes[0], asked


def seen_of(asked, table):
    """Verdicts of the runs made, (n_record, n_level)."""
    seen, cells = np.full_like(table, Verdict.NOT_SIMULATED), tuple(np.transpose(asked))
    seen[cells] = table[cells]
    return seen


def bracketed(asked, table):
    """The highest standing and the lowest collapsing level among the runs made, by record."""
    seen, place = seen_of(asked, table), np.arange(table.shape[1])
    low = np.where(seen == Verdict.STANDING, place, -1).max(axis=1)
    return low, np.where(seen == Verdict.COLLAPSED, place, place.size).min(axis=1)


def search_only(table, expected=None):
    """Borders that a search of all rows of a table ends with: the levels below and above."""
    n_record, n_level = table.shape
    low, high = np.full(n_record, -1), np.full(n_record, n_level)
    if expected is None:
        expected = np.full((n_record, n_level + 1), 1.0 / (n_level + 1))

    def design():
        yield from search(grid_of(*table.shape), low, high, expected, range(n_record))
        return {}

    driven(design(), table)
    return low, high


def test_designs_are_answered_each_with_its_own_verdicts():
    def design(arch, lengths):
        seen = []
        for length in lengths:
            cells = replace(grid_of(1), arch=arch).cases([0] * length, range(length))
            seen.append((yield cells).tolist())
        return {"seen": seen}

    answers = iter([[1, 2, 3, 0, 1], [2]])
    requests = {0: design(0, [2, 0, 1]), 1: design(1, []), 5: design(5, [3])}
    cases, notes = ask(requests, lambda _: np.array(next(answers), np.int8))
    assert cases["arch"].tolist() == [0, 0, 5, 5, 5, 0]
    assert notes == {
        1: {"seen": []}, 5: {"seen": [[3, 0, 1]]}, 0: {"seen": [[1, 2], [], [2]]}
    }  # fmt: skip


class TestSearch:
    @pytest.mark.parametrize("n_level", [1, 2, 3, 15])
    @pytest.mark.parametrize("prior", ["none", "wrong", "narrow"])
    def test_brackets_are_the_lowest_collapsing_level_whatever_is_expected(self, n_level, prior):
        first = np.arange(n_level + 1)  # the last record stands everywhere

        true = np.log(np.append(LEVELS[:n_level], 2 * LEVELS[n_level - 1]))
        expected = {
            "none": None,
            "wrong": expected_borders(LEVELS[:n_level], true[::-1], 0.3),
            "narrow": expected_borders(LEVELS[:n_level], true + 0.3, 0.0),
        }[prior]
        low, high = search_only(monotone(first, n_level), expected)
        np.testing.assert_array_equal(low, first - 1)
        np.testing.assert_array_equal(high, first)

    def test_ends_with_failures_anywhere_and_the_border_is_within(self):
        generator = np.random.default_rng(3)
        first = generator.integers(0, 16, 200)
        table = monotone(first)
        table[generator.random(table.shape) < 0.3] = Verdict.SOLVER_FAILURE
        low, high = search_only(table)
        assert (low < first).all()
        assert (first <= high).all()
        for row in range(200):
            between = table[row, low[row] + 1 : high[row]]
            assert (between == Verdict.SOLVER_FAILURE).all()


class TestIda:
    @pytest.mark.parametrize("known", [False, True])
    def test_thirty_records_on_fifteen_levels_take_150_runs_and_135_if_a_measure_helps(
        self, known
    ):
        runs = []
        for seed in range(60):
            table, capacity = lognormal(seed)
            noise = np.random.default_rng([seed, 1]).standard_normal((30, 3))
            measures = 0.3 * noise + known * np.log(capacity)[:, None]
            note, asked = driven(Ida(kind="ida").requests(grid_of(30, measures=measures)), table)
            assert note["runs"] == len(asked)
            assert (note["records"], note["checked"], note["contradictions"]) == (30, 30, 0)
            low, high = bracketed(asked, table)
            np.testing.assert_array_equal(high - low, 1)
            runs.append(note["runs"])
        assert np.mean(runs) <= (135 if known else 150)

    def test_checks_find_contradictions_near_the_borders_at_their_rate(self):
        """A tenth of the cells are flipped, which also misleads the search."""
        rates = []
        for seed in range(12):
            table, _ = lognormal(seed, n_record=100)
            first = table.argmax(axis=1) + 15 * (table.max(axis=1) == 0)
            near = np.abs(np.arange(15) - first[:, None] + 0.5) < 1
            flipped = np.random.default_rng([seed, 2]).random(table.shape) < 0.1
            spoilt = np.where(flipped & ~near, 1 - table, table)
            for checks in (10**6, 100):
                design = Ida(kind="ida", checks=checks, seed=seed)
                note, asked = driven(design.requests(grid_of(100)), spoilt)
                assert note["checked"] == checks or checks > 100
                rates.append(note["contradictions"] / note["checked"])
        low, high = bracketed(asked[:-100], spoilt)
        cells = np.array(asked)[-100:]
        assert np.all(cells[:, 1] >= low[cells[:, 0]] - NEAR)
        assert np.all(cells[:, 1] <= high[cells[:, 0]] + NEAR)
        assert 0.08 < np.mean(rates[::2]) < 0.2
        assert np.mean(rates[1::2]) == pytest.approx(np.mean(rates[::2]), abs=0.02)

    def test_curve_is_that_of_stripes_where_single_runs_scatter(self):
        """The same verdicts, half of the records not monotone: theta to 1 %, beta to 5 %."""
        off = []
        for seed in range(40):
            generator = np.random.default_rng(seed)
            capacity = 0.4 * generator.standard_normal((30, 1))
            capacity = 0.3 * np.exp(capacity + 0.2 * generator.standard_normal((30, 15)))
            table = (capacity <= LEVELS).astype(np.int8)
            _, asked = driven(Ida(kind="ida", seed=seed).requests(grid_of(30)), table)
            one, other = (
                capacity_posterior(find_brackets(verdict, LEVELS))[0].fragility
                for verdict in (seen_of(asked, table), table)
            )
            pairs = (one.theta / other.theta, one.beta / other.beta, one.beta / np.sqrt(0.2))
            off.append(np.log(pairs))
        assert np.all(np.abs(np.mean(off, axis=0)) < [0.01, 0.05, 0.05])


FINE = np.exp(0.3 * np.linspace(-2.5, 2.5, 15))


def capacities(seed, n=2000):
    return 0.3 * np.random.default_rng(seed).standard_normal(n)


def until_known(log_capacity, groups=None, **keys):
    """Facts of a search with a wanted precision, and the verdicts of the records searched."""
    precision = Precision(**({"theta": 0.1, "runs": 10_000} | keys))
    n = log_capacity.size
    grid = Grid(0, np.arange(n), FINE, np.ones(n), 1.0, np.empty((n, 0)), groups)
    table = (np.log(FINE) >= log_capacity[:, None]).astype(np.int8)
    note, asked = driven(Ida(kind="ida", checks=0, precision=precision).requests(grid), table)
    return note, seen_of(asked, table)[: note["records"]]


class TestPrecision:
    @pytest.mark.parametrize(
        ("runs", "why"), [(10**5, "no more than 40 records"), (60, "60 runs do not suffice")]
    )
    def test_why_it_was_not_reached_is_stated(self, runs, why):
        note, _ = until_known(capacities(8, n=40), theta=0.01, runs=runs)
        assert not note["reached"]
        assert why in note["why"]
        assert note["half_width"] > 0.01

    def test_it_stops_by_the_interval_that_is_quoted(self):
        note, seen = until_known(capacities(1))
        quoted = quoted_band(find_brackets(seen, FINE), 1.0)
        reach = np.abs(np.log(np.array(quoted.theta) / quoted.curve.theta)).max()
        assert note["reached"]
        assert note["half_width"] == pytest.approx(reach, rel=1e-12)
        assert note["half_width"] <= 0.1
        assert note["records"] > LEAST_RECORDS

    def test_median_is_as_well_known_as_asked(self):
        """90 % is asked for; 25 repeats have a standard error of 6 %."""
        error = []
        for seed in range(25):
            seen = until_known(capacities(seed), theta=0.06)[1]
            posterior = capacity_posterior(find_brackets(seen, FINE))[0]
            error.append(abs(np.log(posterior.fragility.theta)))
        assert np.mean(np.array(error) <= 0.06) >= 0.8

    def test_one_narrow_look_is_not_enough(self, monkeypatch):
        narrow, reached = 0, []
        for width, done in ((0.01, 10), (0.09, 40), (0.11, 42), (0.09, 45), (0.09, 48)):
            monkeypatch.setattr("archfrag.study.runs.ida.half_width", lambda *_, w=width: w)
            _, narrow, facts = look(Precision(theta=0.1), grid_of(100), done, narrow)
            reached.append(facts["reached"])
        assert reached == [False] * 4 + [True]

    def test_records_of_shared_events_are_worth_fewer(self):
        shared = np.repeat(capacities(4, n=400), 4)
        groups = np.repeat(np.arange(400), 4).astype(str)
        aware, unaware = until_known(shared, groups)[0], until_known(shared)[0]
        assert aware["records"] > 2 * unaware["records"]
