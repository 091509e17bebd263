"""Speed against accuracy: its reference, its errors, and its tables from made-up points."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from archbench.growth import DIFFERENCE, exponents_table, growth_of
from archbench.quantities import errors_of, marks_of, observe, positions_at
from archbench.reference import MARGIN, find_reference, limit_of, richardson
from archbench.scene import load_scene
from archbench.settings import Setting, ladders
from archbench.solve import (
    Frames,
    least_collapsing,
    nearest_change,
    solve,
    solve_many,
    with_samples,
)
from archbench.speed import POINTS, kept_errors, levels_table, lost_table, points_of
from archfrag.errors import InputError
from archfrag.methods.registry import resolve


def made_up(*rows):
    """Points of one scene: (method, value, seconds, error), from coarse to fine."""
    table = pd.DataFrame(rows, columns=["method", "value", "seconds", "error"])
    return table.assign(scene="s", quantity="amplitude", floor=1e-7, drawn=True, parameter="dt")


@pytest.mark.parametrize("column", ["values", "quick", "fragility", "fragility_quick"])
def test_settings_of_ladders_are_known_to_the_registry(column):
    for method, settings in ladders(column, ["siconos"]).items():
        info = resolve(method)
        own = {each.name for each in info.parameters} if info else {"dt"}
        assert {setting.parameter for setting in settings} <= own


def test_a_record_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="arch7_real_elc180 needs the record"):
        with_samples(load_scene("arch7_real_elc180"), (tmp_path, None))


def test_a_study_s_runs_are_those_of_single_calls():
    scene, setting = load_scene("arch7_pulse"), Setting("auto", "rtol", 1e-2)
    many = solve_many(scene, setting, [0.9, 2.0])
    single = [solve(scene.at(0.5 * factor), setting) for factor in (0.9, 2.0)]
    assert [run.collapsed for run in many] == [run.collapsed for run in single] == [False, True]
    assert many[0].peak == pytest.approx(single[0].peak, rel=1e-9)


@pytest.mark.parametrize("true", [0.93, 0.9999, 1.00002, 1.02, 1.4])
def test_the_nearest_change_is_found_to_a_tenth_of_its_distance(true):
    found = nearest_change(lambda a: a >= true, 1.0, 1e-7)
    assert found.offset == pytest.approx(true - 1.0, rel=0.06)
    assert least_collapsing(lambda a: a >= true, 0.5, 2.0) == pytest.approx(true, rel=1e-4)


def test_no_change_within_reach_is_not_a_failed_run():
    for above in (None, False):
        found = nearest_change(lambda a, seen=above: seen if a > 1.0 else False, 1.0, 1e-3, 0.3)
        assert math.isnan(found.offset)
        assert found.failed is (above is None)


def test_limit_and_order_of_a_vector():
    true, slope = np.array([1.0, -2.0]), np.array([0.3, 0.7])
    limit, uncertainty, order = richardson([true + slope * h for h in (0.4, 0.2, 0.1)])
    assert limit == pytest.approx(true, abs=1e-12)
    assert (order, uncertainty) == (pytest.approx(1.0), pytest.approx(0.07))
    # A small last difference is not taken for a limit.
    limit, doubt = limit_of([np.array(v) for v in (0.10, 0.15, 0.19, 0.1901)])
    assert abs(float(limit) - 0.2) < doubt


def test_exponent_of_a_power_law():
    runs = pd.DataFrame({"method": "auto", "voussoirs": (7, 14, 28), "moving_seconds": 2.0})
    row = exponents_table(runs.assign(seconds=1e-3 * runs["voussoirs"] ** 1.5)).iloc[0]
    assert row[["low", "exponent", "high"]].tolist() == pytest.approx([1.5] * 3)
    assert row["seconds_at_last"] == pytest.approx(5e-4 * 28**1.5)


class TestGrowth:
    time = np.linspace(0.0, 10.0, 1001)

    def test_exponential_growth_is_measured_and_runs_into_its_horizon(self):
        growth = growth_of(self.time, DIFFERENCE * np.exp(2.0 * self.time)[None, :], 1.0, 0.0)
        assert growth["exponent"] == pytest.approx(2.0, rel=1e-9)
        assert growth["horizon"] == pytest.approx(math.log(1e-2 / DIFFERENCE) / 2.0, abs=0.011)

    def test_what_does_not_grow_has_no_horizon(self):
        noise = 1.0 + 0.1 * np.sin(37.0 * self.time)
        growth = growth_of(self.time, DIFFERENCE * noise[None, :], 1.0, 0.0)
        assert math.isinf(growth["horizon"])
        assert growth["low"] < 0.0 < growth["high"]


class TestTables:
    def test_chance_at_a_coarse_setting_is_not_accuracy_and_errors_stand_at_the_floor(self):
        points = made_up(("a", 4, 1.0, 1e-5), ("a", 2, 2.0, 1e-2), ("a", 1, 4.0, 1e-9))
        assert kept_errors(points)["kept"].tolist() == [1e-2, 1e-2, 1e-7]

    def test_the_cheapest_at_each_error_and_what_auto_loses(self):
        points = made_up(
            ("auto", 1e-1, 1.0, 9e-2), ("auto", 1e-3, 8.0, 9e-4), ("mujoco", 4e-3, 0.5, 9e-2),
            ("mujoco", 2e-3, 9.0, 9e-3), ("mujoco", 1e-3, 10.0, 9e-5),
        )  # fmt: skip
        table = levels_table(points).round(9).set_index(["error", "method"])["over_cheapest"]
        assert table[0.1].to_dict() == {"auto": 2.0, "mujoco": 1.0}
        assert table[0.01].to_dict() == {"auto": 1.0, "mujoco": 1.125}
        lost = lost_table(points)
        assert lost["value"].tolist() == [4e-3, 1e-3]
        assert lost["auto_seconds"].tolist() == [1.0, math.inf]


@pytest.fixture(scope="module")
def block():
    scene = load_scene("block_sine")
    run = solve(scene, Setting("event_driven", "rtol", 1e-8), history=True)
    return scene, run, marks_of(run)


class TestQuantities:
    def test_positions_between_frames_follow_the_motion(self, block):
        _, run, marks = block
        inside = (run.frames.time > marks.onset + 1e-3) & (run.frames.time < marks.position)
        frames = Frames(*(each[inside] for each in run.frames))
        coarse = Frames(*(each[::4] for each in frames))
        between = positions_at(coarse, frames.time[:-4])
        assert between == pytest.approx(frames.displacement[:-4], abs=1e-8)

    def test_a_run_has_no_error_against_itself_and_a_coarse_one_has(self, block):
        scene, run, marks = block
        seen = observe(scene, run, marks)
        own = errors_of(seen, seen, scene.thickness)
        assert (own["position"], own["peak"]) == (0.0, 0.0)
        coarse = solve(scene, Setting("time_stepping", "dt", 8e-3), history=True)
        errors = errors_of(observe(scene, coarse, marks), seen, scene.thickness)
        assert errors["position"] > 1e-6
        assert errors["peak"] > 1e-4
        failed = errors_of(replace(seen, collapsed=None), seen, scene.thickness)
        assert all(math.isnan(value) for value in failed.values())


def test_a_scene_from_reference_to_points():
    reference = find_reference(load_scene("block_sine"), quick=True)
    # Housner's block: the two tolerances agree to the bracket, the second method to its own doubt.
    assert reference.amplitude == pytest.approx(0.29334, rel=1e-4)
    assert reference.error["amplitude"] < 1e-5
    assert reference.second["amplitude"][0] < 2e-3
    ladder = [Setting("time_stepping", "dt", step) for step in (8e-3, 1e-3)]
    points = pd.DataFrame(points_of(reference, ladder, True, ())["points"], columns=list(POINTS))
    by = points[points["quantity"] == "amplitude"].set_index("value")
    assert by.loc[8e-3, "error"] > 5.0 * by.loc[1e-3, "error"] > 0.0
    assert by["floor"].min() >= MARGIN * reference.error["amplitude"] * (1.0 - 1e-12)
    assert (points["seconds"] > 0.0).all()
