"""Curves of whole studies beside a reference, and what their dispersion is made of."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import multivariate_normal

from archfrag.evidence.fragility import error as fragility
from archfrag.evidence.fragility.partition import (
    between_ways,
    both_below,
    bounds,
    draws,
    parts_of,
    resampled_parts,
)
from archfrag.evidence.fragility.studies import (
    main_arch,
    real_records,
    run_record,
    run_studies,
    shipped_records,
)
from archfrag.evidence.part import Setup
from archfrag.evidence.run import Places, Way
from archfrag.evidence.store import load, save
from archfrag.fragility.counts import Verdict
from archfrag.simulate import onset

RECORDS = Path(__file__).parents[2] / "records"
LEVELS = np.linspace(0.2, 3.0, 15)
WAYS = ("time_stepping 4 ms", "auto 0.001")
PAIR = ("time_stepping 0.05 ms", "event_driven 1e-06")
GROUPS = tuple((way,) for way in PAIR)


class TestPairsOfVerdicts:
    @pytest.mark.parametrize("correlation", [-0.5, 0.0, 0.3, 0.9, 0.999])
    @pytest.mark.parametrize("bound", [(0.0, 0.0), (-1.5, 0.4), (2.0, 1.9)])
    def test_chance_of_both_is_that_of_the_bivariate_normal(self, bound, correlation):
        expected = multivariate_normal([0.0, 0.0], [[1.0, correlation], [correlation, 1.0]])
        found = both_below(np.array([bound[0]]), np.array([bound[1]]), correlation)
        assert found[0] == pytest.approx(expected.cdf(bound), abs=1e-6)

    def test_certain_pairs_fall_together(self):
        found = both_below(np.array([0.3]), np.array([0.3]), 1.0)
        assert found[0] == pytest.approx(0.6179114, abs=1e-6)


def made_up(shares, n_record=400, n_repetition=6, seed=3):
    """Verdicts whose latent variance has given shares: numerical, level, record."""
    rng = np.random.default_rng(seed)
    record = rng.normal(size=(n_record, 1, 1)) * np.sqrt(shares[2])
    level = rng.normal(size=(n_record, LEVELS.size, 1)) * np.sqrt(shares[1])
    own = rng.normal(size=(n_record, LEVELS.size, n_repetition)) * np.sqrt(shares[0])
    capacity = np.log(1.4) + 0.5 * (record + level + own)
    fallen = np.sum(np.log(LEVELS)[None, :, None] > capacity, axis=2).astype(float)
    return fallen, n_repetition - fallen


class TestWhatBetaIsMadeOf:
    @pytest.mark.parametrize("shares", [(0.02, 0.08, 0.9), (0.2, 0.3, 0.5), (0.4, 0.0, 0.6)])
    def test_shares_are_found_again(self, shares):
        parts = parts_of(LEVELS, *made_up(shares))
        assert (parts.numerical, parts.level, parts.record) == pytest.approx(shares, abs=0.04)
        assert parts.beta == pytest.approx(0.5, rel=0.06)

    def test_nothing_is_numerical_where_no_verdict_flips(self):
        assert parts_of(LEVELS, *made_up((0.0, 0.2, 0.8))).numerical == 0.0

    def test_interval_holds_the_share(self):
        drawn = resampled_parts(LEVELS, *made_up((0.1, 0.1, 0.8), 60), 60, seed=1)
        low, high = np.quantile(drawn[:, 0], (0.05, 0.95))
        assert low < 0.1 < high < 0.2

    def test_a_way_shares_all_with_itself_and_less_with_another(self):
        fallen, stood = made_up((0.3, 0.0, 0.7), n_repetition=2)
        scale = bounds(LEVELS, fallen, stood)[0]
        first = ((fallen > 0).astype(float), (fallen == 0).astype(float), scale)
        other, held = made_up((0.3, 0.0, 0.7), n_repetition=2, seed=4)
        assert between_ways(first, first).correlation() == 1.0
        assert between_ways(first, (other, held, scale)).correlation() < 0.2


def made_up_runs(factors, n_record=24, seed=7):
    """Runs of several ways whose capacities differ by a factor, without chaos."""
    capacity = np.exp(np.log(1.4) + 0.5 * np.random.default_rng(seed).normal(size=n_record))
    rows = [
        ("shipped", way, repetition, f"r{number}", level, int(level > own * factor), 9, 0.25)
        for way, repetition, factor in factors
        for number, own in enumerate(capacity)
        for level in LEVELS
    ]
    columns = ["study", "way", "repetition", "record", "level", "verdict", "steps", "cpu_seconds"]
    return pd.DataFrame(rows, columns=columns)


class TestCurvesBesideTheReference:
    runs = made_up_runs([(PAIR[0], 0, 1.0), (PAIR[1], 0, 1.0), (WAYS[0], 0, 1.3), (WAYS[1], 0, 1)])

    def table(self, runs=None):
        runs = self.runs if runs is None else runs
        return fragility.curves_table(runs, GROUPS, 100).set_index("way")

    def test_a_way_that_makes_capacities_larger_is_seen_by_as_much(self):
        row = self.table().loc[WAYS[0]]
        assert row["ln_theta_difference"] == pytest.approx(np.log(1.3), abs=0.06)
        assert 0.1 < row["ln_theta_low"] < row["ln_theta_difference"] < row["ln_theta_high"]
        assert row["differ"] > 20
        assert row["cpu_seconds"] == pytest.approx(0.25 * 24 * 15)

    def test_records_are_resampled_in_pairs(self):
        row = self.table().loc[WAYS[1]]
        assert row["sampling_ln_theta"] > 0.05
        same = row[["ln_theta_difference", "ln_theta_low", "ln_theta_high"]].to_numpy(float)
        assert same == pytest.approx(0.0, abs=1e-9)
        assert row["not_shared"] == 0.0

    def test_failures_and_unfinished_runs_are_neither(self):
        runs = self.runs.copy()
        mine = np.flatnonzero(runs["way"] == WAYS[1])
        runs.loc[mine[:3], "verdict"] = int(Verdict.SOLVER_FAILURE)
        runs.loc[mine[-2:], "verdict"] = int(Verdict.UNFINISHED)
        row = self.table(runs).loc[WAYS[1]]
        assert (row["failures"], row["unfinished"], row["differ"]) == (3, 2, 5)
        outcomes, verdicts = fragility.Outcomes(runs.iloc[mine]), runs.iloc[mine]["verdict"]
        assert outcomes.fallen.sum() == (verdicts == int(Verdict.COLLAPSED)).sum()
        assert outcomes.stood.sum() == (verdicts == int(Verdict.STANDING)).sum()

    def test_how_far_the_reference_lies_from_itself(self):
        runs = made_up_runs([(PAIR[0], 0, 1.0), (PAIR[1], 0, 1.2)])
        row = self.table(runs).iloc[0]
        assert row["reference_ln_theta_apart"] == pytest.approx(np.log(1.2), abs=0.05)
        assert row["reference_ln_theta_error"] == 0.5 * row["reference_ln_theta_apart"]
        assert row["reference_disagrees"] > 0

    def test_studies_that_scatter_leave_the_reference_in_doubt(self):
        factors = (1.0, 1.3, 1.3, 1.0)
        ways = [f"{name} {k}" for name in ("time_stepping", "event_driven") for k in (1, 2)]
        runs = made_up_runs([(way, 0, factor) for way, factor in zip(ways, factors)])
        row = fragility.curves_table(runs, (ways[:2], ways[2:]), 100).iloc[0]
        assert row["reference_ln_theta_apart"] == pytest.approx(0.0, abs=1e-9)
        expected = np.log(1.3) / np.sqrt(2.0) / np.sqrt(4.0)
        assert row["reference_ln_theta_error"] == pytest.approx(expected, rel=0.2)

    def test_a_way_without_a_curve_has_no_error(self):
        runs = pd.concat([self.runs, made_up_runs([("four_link 2 ms", 0, 100.0)])])
        row = self.table(runs).loc["four_link 2 ms"]
        assert np.isnan(row["ln_theta_difference"])
        assert np.isnan(row["ln_theta_high"])

    def test_what_is_shown_comes_from_the_tables_on_disk(self, tmp_path):
        again = [("auto 0.001", k, 1.0 + 0.01 * k) for k in range(3)]
        runs = made_up_runs([*((way, 0, 1.0) for way in PAIR), (WAYS[0], 0, 1.3), *again])
        runs = pd.concat([runs, made_up_runs([("four_link 2 ms", 0, 100.0)])])
        frames = {
            "runs": runs,
            "curves": fragility.curves_table(runs[runs["repetition"] == 0], GROUPS, 100),
            "dispersion": fragility.dispersion_table(runs, 20),
            "repeated": fragility.repeated_table(runs),
            "left_out": pd.DataFrame(columns=["study", "way", "reason"]),
        }
        save(tmp_path, "fragility", frames, {})
        section = fragility.show(load(tmp_path, "fragility"))
        assert set(section.pictures) == {"fragility_cost", "fragility_dispersion"}
        assert all("<svg" in shown.svg for shown in section.pictures.values())
        shown = {row[0] for row in section.notes[0].rows}
        assert {WAYS[0], "four_link 2 ms", f"{PAIR[0]} (reference)"} <= shown
        assert "% of beta² is numerical" in section.lead[2]


class TestRecordsAndRuns:
    def setup(self, quick=True, real=None):
        return Setup(quick, Places(RECORDS, real), say=lambda _: None)

    def test_the_full_study_is_the_main_job(self):
        from archfrag.study.config import load_study

        job = load_study(RECORDS.parent / "configs" / "shipped.yaml")
        full = shipped_records(self.setup(quick=False))
        assert full.levels == pytest.approx(job.intensity.given)
        assert len(full.motions) == 30
        quick = shipped_records(self.setup())
        assert len(quick.motions) == 20
        assert set(quick.levels) < set(full.levels)

    def test_without_real_records_there_is_no_second_study(self, tmp_path):
        assert real_records(self.setup(real=tmp_path)) is None
        assert real_records(self.setup()) is None

    def test_draws_are_the_same_for_all(self):
        assert np.array_equal(draws(20, 5, 1), draws(20, 5, 1))

    def test_rows_do_not_depend_on_the_number_of_processes(self):
        records = shipped_records(self.setup())
        few = type(records)("shipped", records.motions[:2], [0.2, 30.0])
        wanted = [(few, Way("time_stepping", "dt", 4e-3), k) for k in (0, 1)]
        one, two = (run_studies(wanted, workers) for workers in (1, 2))
        timeless = [column for column in one.columns if column != "cpu_seconds"]
        pd.testing.assert_frame_equal(one[timeless], two[timeless])
        assert one["cpu_seconds"].gt(0.0).all()
        assert set(one["verdict"]) == {Verdict.STANDING, Verdict.COLLAPSED}

    def test_a_level_is_the_peak_in_g(self):
        motion = shipped_records(self.setup()).motions[0]
        start = onset(main_arch())
        least = min(start.plus, start.minus)
        rows = run_record(Way("time_stepping", "dt", 4e-3), motion, [0.99 * least, 1.4 * least], 0)
        assert rows[0][:2] == (Verdict.STANDING, 0)
        assert rows[1][1] > 0
