"""Curves of studies beside a reference, coverage of bands, and the page."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from archbench import bands, knee, page
from archbench.fragility import (
    REFERENCES,
    SHIPPED,
    Study,
    run_study,
    scenes_of,
    tables_of,
)
from archbench.runner import Bench
from archbench.settings import Setting
from archfrag.study.file.schema import load_study

LEVELS = np.linspace(0.2, 3.0, 15)
ROOT = Path(__file__).parents[2]
SETS = ROOT.parent / "shared" / "validation" / "small_samples"
EXACT = {("reference", each): 1.0 for each in REFERENCES}
COARSE = Setting("time_stepping", "dt", 8e-3)
FINE = Setting("auto", "rtol", 1e-3)


def tables_from(factors, scatter=0.0, failures=0):
    """Tables of several settings whose capacities differ by a factor, each repeated 8 times."""
    rng = np.random.default_rng(7)
    capacity = np.exp(np.log(1.4) + 0.5 * rng.normal(size=24))
    studies = []
    for (role, setting), factor in factors.items():
        for k in range(8):
            own = capacity * factor * np.exp(scatter * rng.normal(size=24))
            outcomes = (own[:, None] < LEVELS).astype(int).tolist()
            studies.append(Study(role, setting, k, outcomes, 3.0))
    studies[-1].outcomes[0][:failures] = [None] * failures
    return tables_of(studies, LEVELS)


def curves_of(factors, **options):
    return tables_from(factors, **options)["curves"].set_index("method")


class TestCurvesBesideTheReference:
    def test_a_setting_that_makes_capacities_larger_is_seen_by_as_much(self):
        curves = curves_of({**EXACT, ("setting", COARSE): 1.3, ("setting", FINE): 1.0})
        off = curves.loc["time_stepping", "theta_difference"]
        assert off == pytest.approx(np.log(1.3), abs=0.06)
        row = curves.loc["auto"]
        assert row[["theta_difference", "theta_scatter"]].tolist() == pytest.approx(
            [0.0, 0.0]
        )
        assert row["theta_sampling"] > 0.05
        assert row["seconds"] == 3.0

    def test_bars_are_the_scatter_of_repetitions(self):
        row = curves_of({**EXACT, ("setting", FINE): 1.0}, scatter=0.3).iloc[0]
        assert row["repeats"] == 8
        assert row["theta_low"] < row["theta_difference"] < row["theta_high"]
        assert min(row["theta_scatter"] - 0.02, row["theta_known_to"]) > 0.0

    def test_the_reference_is_no_better_than_its_two_methods_agree(self):
        factors = {("reference", REFERENCES[0]): 1.0, ("reference", REFERENCES[1]): 1.2}
        known = curves_of({**factors, ("setting", FINE): 1.0}).iloc[0]["theta_known_to"]
        assert known == pytest.approx(0.5 * np.log(1.2), abs=0.03)

    def test_failures_are_neither_collapse_nor_survival(self):
        assert curves_of({**EXACT, ("setting", FINE): 1.0}, failures=3)[
            "failures"
        ].tolist() == [3]


def test_the_knee_is_measured_beside_the_reference_on_the_same_records():
    capacity = np.exp(
        np.log(1.4) + 0.5 * np.random.default_rng(3).normal(size=(100, 1))
    )
    studies = {
        setting: [
            Study("", setting, 0, (capacity * factor < own).astype(int).tolist(), 1.0)
            for own in (LEVELS[k :: knee.SETS] for k in range(knee.SETS))
        ]
        for setting, factor in ((knee.REFERENCE, 1.0), (FINE, 1.15))
    }
    reference, row = knee.errors_of_theta(studies, LEVELS)
    assert (reference["error"], reference["rms"], row["sets"]) == (0.0, 0.0, knee.SETS)
    assert row["error"] == pytest.approx(np.log(1.15), abs=3.0 * row["standard_error"])


def test_a_study_runs_the_main_job_s_records_and_levels():
    job = load_study(ROOT / "configs" / "ring.yaml")
    scenes, levels = scenes_of(SHIPPED, False)
    assert len(scenes) == 30
    assert levels == pytest.approx(job.intensity.given)
    found = run_study(COARSE, 0, SHIPPED, True)
    outcomes = np.array(found["outcomes"], float)
    assert outcomes.shape == (20, 8)
    assert outcomes[:, 0].sum() == 0.0 < found["seconds"]
    assert outcomes[:, -1].mean() > 0.5


def test_the_page_is_made_from_tables_alone(tmp_path):
    tables = tables_from({**EXACT, ("setting", COARSE): 1.3}, scatter=0.1)
    named = {name: table.assign(study="shipped") for name, table in tables.items()}
    Bench(tmp_path, part="fragility", report=lambda _: None).save(named)
    assert "<svg" in page.write_page(tmp_path).read_text()


def test_a_band_holds_lognormal_capacities_and_not_two_peaks():
    held = [
        bands.coverage_of(bands.RECORDS, family, 24, 40)["theta"]
        for family in bands.FAMILIES
    ]
    assert held[0] > 0.75 > held[-1]


@pytest.mark.parametrize(
    "name",
    [
        "limit state of 12 records",
        "limit state, 2 records an event",
        "ida, single runs scatter by 0.2",
    ],
)
def test_bands_of_limit_states_and_of_ida_hold(name):
    held = bands.coverage_in(name, 20)
    assert min(held.values()) >= 0.7  # of 18 of 20 that are expected
    assert max(held.values()) > 0.8


def test_the_interval_of_a_ratio_holds_with_three_earthquakes():
    held = bands.coverage_of_ratios("3 events of 2", 20)
    assert min(held.values()) >= 0.75  # a percentile bootstrap held 52 to 62 %


def few_runs(folder, sizes, sets):
    return bands.few_runs(folder, sizes, sets).set_index("runs")


def test_error_and_coverage_of_few_runs_are_those_of_sets_that_are_made(tmp_path):
    generator, (theta, beta) = np.random.default_rng(5), bands.TRUTH
    im = np.exp(generator.standard_normal((200, 30)))
    capacity = theta * np.exp(beta * generator.standard_normal(im.shape))
    np.savez(tmp_path / "pairs.npz", intensity=im, failed=1.0 * (capacity < im))
    found = few_runs(tmp_path, [10, 200], 30)
    assert found["archfrag, all sets"].tolist() == pytest.approx(
        [0.105, 0.030], rel=0.15
    )
    assert found[["theta", "beta"]].min(axis=None) > 0.75
    np.savez(tmp_path / "pairs.npz", intensity=im, failed=1.0 * (3.0 * capacity < im))
    assert few_runs(tmp_path, [200], 30)["theta"].max() == 0.0  # of another curve


@pytest.mark.skipif(
    not SETS.is_dir(), reason="../shared/validation is not beside the repository"
)
def test_few_runs_of_the_public_sets():
    table = ROOT / "docs" / "evidence" / "data" / "bands_few_runs.csv"
    kept = pd.read_csv(table, index_col="runs")
    again = few_runs(SETS, [10, 20, 30, 50, 100], bands.FIRST)
    assert again["archfrag"].to_numpy() == pytest.approx(
        kept["archfrag"][:-1], abs=2e-3
    )
    assert np.all(again["archfrag"] <= [0.11, 0.082, 0.071, 0.071, 0.051])
    assert np.all(again["archfrag"] < again["constrained"] + 1e-3)
