"""Designs on made-up tables of verdicts: what they ask for, that they end, what they find."""

import numpy as np
import pytest

from archfrag.fragility.counts import Verdict
from archfrag.fragility.quoted import quoted_posterior
from archfrag.study import grids
from archfrag.study.design import Ida, Precision, Scattered, TwoStage
from archfrag.study.grids import Borders, Grid, ida, search
from archfrag.study.rounds import BEYOND, COARSE, FINE, Rounds, scattered

LEVELS = np.linspace(0.05, 0.75, 15)


def grid_of(n_record, n_level=15, measures=None):
    if measures is None:
        measures = np.empty((n_record, 0))
    return Grid(0, np.arange(n_record), LEVELS[:n_level], measures)


def monotone(first, n_level=15):
    """Verdicts of records of which the lowest collapsing level is known, (n_record, n_level)."""
    return (np.arange(n_level) >= np.asarray(first)[:, None]).astype(np.int8)


def lognormal(seed, n_record=30, theta=0.3, beta=0.4):
    """Table of records with lognormal capacities, and these."""
    drawn = np.random.default_rng(seed).standard_normal(n_record)
    capacity = theta * np.exp(beta * drawn)
    return monotone(np.searchsorted(LEVELS, capacity)), capacity


def driven(strand, fine, coarse=None):
    """What a strand returns, and all cells it asked for by stage, none of them twice."""
    rounds, asked = Rounds({0: strand}), {FINE: [], COARSE: []}
    while len(rounds.wanted):
        wanted = rounds.wanted
        verdicts = np.empty(len(wanted), np.int8)
        for stage, table in ((FINE, fine), (COARSE, coarse)):
            own = wanted["stage"] == stage
            if own.any():
                verdicts[own] = table[wanted["record"][own], wanted["place"][own]]
                asked[stage] += zip(wanted["record"][own].tolist(), wanted["place"][own].tolist())
        rounds.answer(verdicts)
    for cells in asked.values():
        assert len(cells) == len(set(cells)), "a cell was asked for twice"
    return rounds.notes[0], asked


def bracketed(asked, table):
    """The highest standing and the lowest collapsing level among the runs made, by record."""
    n_record, n_level = table.shape
    low, high = np.full(n_record, -1), np.full(n_record, n_level)
    for record, place in asked:
        if table[record, place] == Verdict.COLLAPSED:
            high[record] = min(high[record], place)
        elif table[record, place] == Verdict.STANDING:
            low[record] = max(low[record], place)
    return low, high


def search_only(table, prepare=lambda borders: None):
    """Borders that a search of all rows of a table ends with."""
    borders = Borders(grid_of(*table.shape))
    prepare(borders)

    def strand():
        yield from search(borders, range(len(table)), FINE)
        return {}

    driven(strand(), table)
    return borders


class TestRounds:
    def test_strands_are_answered_each_with_its_own_verdicts(self):
        def strand(arch, lengths):
            seen = []
            for length in lengths:
                cells = grids.cases_of(arch, [0] * length, range(length), [1.0] * length)
                seen.append((yield cells).tolist())
            return {"seen": seen}

        rounds = Rounds({0: strand(0, [2, 0, 1]), 1: strand(1, []), 5: strand(5, [3])})
        assert rounds.wanted["arch"].tolist() == [0, 0, 5, 5, 5]
        rounds.answer(np.array([1, 2, 3, 0, 1], np.int8))
        assert rounds.wanted["arch"].tolist() == [0]
        for missing in ([-1], [4], [], [0, 0]):
            with pytest.raises(ValueError, match="must have been made"):
                rounds.answer(np.array(missing, np.int8))
        rounds.answer(np.array([2], np.int8))
        assert not len(rounds.wanted)
        assert rounds.notes == {
            1: {"seen": []}, 5: {"seen": [[3, 0, 1]]}, 0: {"seen": [[1, 2], [], [2]]}
        }  # fmt: skip


class TestSearch:
    @pytest.mark.parametrize("n_level", [1, 2, 3, 15])
    @pytest.mark.parametrize("prior", ["none", "wrong", "narrow"])
    def test_brackets_are_the_lowest_collapsing_level_whatever_is_expected(self, n_level, prior):
        first = np.arange(n_level + 1)  # the last record stands everywhere

        def prepare(borders):
            true = np.log(np.append(LEVELS[:n_level], 2 * LEVELS[n_level - 1]))
            medians = {"wrong": true[::-1], "narrow": true + 0.3}
            if prior in medians:
                deviation = 0.0 if prior == "narrow" else 0.3
                borders.expect(range(n_level + 1), medians[prior], deviation)

        borders = search_only(monotone(first, n_level), prepare)
        np.testing.assert_array_equal(borders.low, first - 1)
        np.testing.assert_array_equal(borders.high, first)

    def test_ends_with_failures_anywhere_and_the_border_is_within(self):
        generator = np.random.default_rng(3)
        first = generator.integers(0, 16, 200)
        table = monotone(first)
        table[generator.random(table.shape) < 0.3] = Verdict.SOLVER_FAILURE
        borders = search_only(table)
        assert (borders.low < first).all()
        assert (first <= borders.high).all()
        for row in range(200):
            between = table[row, borders.low[row] + 1 : borders.high[row]]
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
            note, asked = driven(ida(grid_of(30, measures=measures), Ida(kind="ida")), table)
            assert note["runs"] == len(asked[FINE])
            assert (note["records"], note["checked"], note["contradictions"]) == (30, 30, 0)
            low, high = bracketed(asked[FINE], table)
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
                note, asked = driven(ida(grid_of(100), design), spoilt)
                assert note["checked"] == checks or checks > 100
                rates.append(note["contradictions"] / note["checked"])
        low, high = bracketed(asked[FINE][:-100], spoilt)
        cells = np.array(asked[FINE])[-100:]
        assert np.all(cells[:, 1] >= low[cells[:, 0]] - grids.NEAR)
        assert np.all(cells[:, 1] <= high[cells[:, 0]] + grids.NEAR)
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
            _, asked = driven(ida(grid_of(30), Ida(kind="ida", seed=seed)), table)
            seen = np.full_like(table, Verdict.NOT_SIMULATED)
            seen[tuple(np.transpose(asked[FINE]))] = table[tuple(np.transpose(asked[FINE]))]
            one, other = (quoted_posterior(kind, verdict, LEVELS)[0].fragility
                          for kind, verdict in (("ida", seen), ("stripes", table)))  # fmt: skip
            pairs = (one.theta / other.theta, one.beta / other.beta, one.beta / np.sqrt(0.2))
            off.append(np.log(pairs))
        assert np.all(np.abs(np.mean(off, axis=0)) < [0.01, 0.05, 0.05])


class TestTwoStage:
    @pytest.mark.parametrize("coarse", ["same", "standing", "failed", "noise"])
    def test_brackets_are_those_of_ida_whatever_the_coarse_runs_are(self, coarse):
        table, _ = lognormal(5)
        tables = {
            "same": table,
            "standing": np.zeros_like(table),
            "failed": np.full_like(table, Verdict.SOLVER_FAILURE),
            "noise": np.random.default_rng(0).integers(0, 4, table.shape).astype(np.int8),
        }
        design = TwoStage(kind="two_stage", checks=0)
        note, asked = driven(ida(grid_of(30), design), table, tables[coarse])
        _, alone = driven(ida(grid_of(30), Ida(kind="ida", checks=0)), table)
        for found, expected in zip(bracketed(asked[FINE], table), bracketed(alone[FINE], table)):
            np.testing.assert_array_equal(found, expected)
        assert note["runs"] == len(asked[FINE])
        assert note["coarse_runs"] == len(asked[COARSE])
        if coarse == "same":
            assert len(asked[FINE]) < 0.7 * len(alone[FINE])

    @pytest.mark.parametrize(("fine", "decided"), [(0.3, 9), (0.01, 1), (1.0, 30)])
    def test_a_fraction_of_the_records_is_decided_by_fine_runs(self, fine, decided):
        table, _ = lognormal(6)
        design = TwoStage(kind="two_stage", fine=fine)
        _, asked = driven(ida(grid_of(30), design), table, table)
        records = sorted({record for record, _ in asked[FINE]})
        assert len(records) == decided
        assert {record for record, _ in asked[COARSE]} == set(range(30))
        if decided > 1:
            assert np.diff(records).max() <= np.ceil(1 / fine)


class TestPrecision:
    @pytest.mark.parametrize(
        ("runs", "why"), [(10**5, "no more than 40 records"), (60, "60 runs do not suffice")]
    )
    @pytest.mark.parametrize("kind", ["ida", "two_stage"])
    def test_why_it_was_not_reached_is_stated(self, runs, why, kind):
        table, _ = lognormal(8, n_record=40)
        wanted = Precision(theta=0.01, runs=runs)
        design = (Ida if kind == "ida" else TwoStage)(kind=kind, precision=wanted)
        note, _ = driven(ida(grid_of(40), design), table, table)
        assert not note["reached"]
        assert why in note["why"]
        assert note["half_width"] > 0.01


def reported(strand, capacity):
    """Runs of a scattered strand, whose records fall above their capacities [SI]."""
    rounds, made = Rounds({0: strand}), []
    while len(rounds.wanted):
        wanted = rounds.wanted
        made.append(wanted)
        rounds.answer((wanted["level"] >= capacity[wanted["record"]]).astype(np.int8))
    return rounds.notes[0], made


class TestScattered:
    @pytest.fixture
    def capacity(self):
        return 0.3 * np.exp(0.4 * np.random.default_rng(9).standard_normal(1000))

    def test_each_record_once_and_levels_near_15_and_85_percent(self, capacity):
        design = Scattered(kind="scattered", runs=300)
        note, made = reported(scattered(0, np.arange(1000), LEVELS, design), capacity)
        assert [len(cases) for cases in made] == [40] + [20] * 13
        runs = np.concatenate(made)
        assert runs["record"].tolist() == list(range(300))
        assert note == {"runs": 300, "records": 300}
        # The pilot fills the range of the levels evenly in their logarithm.
        pilot = np.sort(np.log(runs["level"][:40]))
        step = np.log(15) / 40
        np.testing.assert_allclose(np.diff(pilot), step)
        assert pilot[0] == pytest.approx(np.log(0.05) + step / 2)
        later = np.log(runs["level"][200:] / 0.3) / 0.4
        assert np.median(later[later < 0]) == pytest.approx(-1.036, abs=0.35)
        assert np.median(later[later > 0]) == pytest.approx(1.036, abs=0.35)
        assert (later < 0).sum() == (later > 0).sum() == 50

    @pytest.mark.parametrize("verdict", list(Verdict)[:4])
    @pytest.mark.parametrize("n_level", [1, 15])
    def test_ends_if_all_runs_end_alike_within_the_range_allowed(self, verdict, n_level):
        design = Scattered(kind="scattered", runs=100)
        rounds = Rounds({0: scattered(0, np.arange(70), LEVELS[:n_level], design)})
        count = 0
        while len(rounds.wanted):
            level = rounds.wanted["level"]
            assert np.isfinite(level).all()
            assert level.min() >= LEVELS[0] / BEYOND * (1 - 1e-6)
            assert level.max() <= LEVELS[n_level - 1] * BEYOND * (1 + 1e-6)
            count += len(level)
            rounds.answer(np.full(len(level), verdict, np.int8))
        assert count == 70

    @pytest.mark.parametrize(
        ("n_record", "runs", "why"),
        [(90, 10**5, "no more than 90 records"), (1000, 60, "60 runs do not suffice")],
    )
    def test_why_precision_is_not_reached_is_stated(self, capacity, n_record, runs, why):
        wanted = Precision(theta=0.02, runs=runs)
        design = Scattered(kind="scattered", precision=wanted)
        note, _ = reported(scattered(0, np.arange(n_record), LEVELS, design), capacity)
        assert why in note["why"]
