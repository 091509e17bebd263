"""Speed against accuracy: tables from made-up points, and one scene from end to end."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from archfrag.evidence.part import Setup
from archfrag.evidence.run import Places, Way, run_scene
from archfrag.evidence.scene import load_scene
from archfrag.evidence.speed import accuracy as speed_accuracy
from archfrag.evidence.speed.first_change import nearest_change
from archfrag.evidence.speed.horizon import DIFFERENCE, growth_of, slope_interval
from archfrag.evidence.speed.quantities import (
    QUANTITIES,
    errors_of,
    marks_of,
    observe,
    positions_at,
    resultants_at,
)
from archfrag.evidence.speed.reference import MARGIN
from archfrag.evidence.speed.runs import POINT
from archfrag.evidence.speed.second_method import richardson, settle, settled
from archfrag.evidence.speed.tables import (
    against_peers,
    auto_table,
    exponents,
    kept_errors,
    limits_table,
)
from archfrag.evidence.store import load, save
from archfrag.evidence.ways import LADDERS, Line, ladders
from archfrag.methods.registry import METHODS

RECORDS = Path(__file__).parents[2] / "records"
EXACT = Way("event_driven", "rtol", 1e-8)


def made_up(rows):
    """Points of one scene: (who, line, method, place, cost, error)."""
    table = pd.DataFrame(rows, columns=["who", "line", "method", "place", "cost", "error"])
    table["scene"], table["quantity"], table["floor"] = "s", "amplitude", 1e-7
    table["charted"], table["at_floor"], table["status"] = True, False, ""
    table["way"] = table["line"] + table["place"].astype(str)
    table["least_cost"] = table["cost"]
    return table[list(POINT)]


class TestLadders:
    def test_every_line_is_one_method_from_coarse_to_fine(self):
        for line in LADDERS:
            assert {way.method for way in line.ways} == {line.method}
            values = [
                -way.settings["stiffness"] if "stiffness" in way.settings else way.value
                for way in line.ways
            ]
            assert values == sorted(values, reverse=True)

    def test_methods_that_are_not_registered_are_named_and_skipped(self, monkeypatch):
        unknown = Line("other", (Way("no_such_method", "dt", 1e-3),))
        known = next(line for line in LADDERS if line.method == "time_stepping")
        monkeypatch.setattr("archfrag.evidence.ways.LADDERS", (unknown, known))
        lines, missing = ladders(quick=True)
        assert [line.label for line in lines] == ["time_stepping"]
        assert missing == ["no_such_method is not a method of this version"]

    def test_own_settings_of_ladders_are_known_to_the_registry(self):
        for line in LADDERS:
            if line.method in METHODS:
                own = {each.name for each in METHODS[line.method].parameters}
                for way in line.ways:
                    assert set(way.settings) <= own - {"dt", "rtol", "follow"}
                    assert way.knob in own


class TestNearestChange:
    @pytest.mark.parametrize("true", [0.93, 0.9999, 1.00002, 1.02, 1.4])
    def test_finds_the_distance_to_a_tenth(self, true):
        found = nearest_change(lambda a: a >= true, 1.0, 1e-7)
        assert found.offset == pytest.approx(true - 1.0, rel=0.06)
        assert found.runs < 16

    def test_share_zero_goes_down_to_the_floor(self):
        found = nearest_change(lambda a: a >= 1.000123456, 1.0, 1e-8, share=0.0)
        assert found.offset == pytest.approx(1.23456e-4, abs=1e-8)

    def test_a_failed_run_is_neither_collapse_nor_survival(self):
        found = nearest_change(lambda a: None if a > 1.0 else False, 1.0, 1e-6)
        assert found.failed
        assert math.isnan(found.offset)

    def test_no_change_within_reach(self):
        found = nearest_change(lambda a: False, 1.0, 1e-3, reach=0.3)
        assert math.isnan(found.offset)
        assert not found.failed


class TestRichardson:
    def test_limit_and_order_of_a_vector(self):
        true, slope = np.array([1.0, -2.0]), np.array([0.3, 0.7])
        limit, uncertainty, order = richardson([true + slope * h for h in (0.4, 0.2, 0.1)])
        assert limit == pytest.approx(true, abs=1e-12)
        assert order == pytest.approx(1.0)
        assert uncertainty == pytest.approx(0.07)

    def test_values_that_do_not_converge_have_an_uncertainty_of_their_size(self):
        _, uncertainty, order = richardson([np.array(v) for v in (1.0, 1.1, 1.3)])
        assert order == 0.5
        assert uncertainty > 0.2

    def test_a_small_last_difference_is_not_taken_for_a_limit(self):
        values = [np.array(v) for v in (0.10, 0.15, 0.19, 0.1901)]
        limit, doubt = settled(values)
        assert abs(float(limit) - 0.2) < doubt


class TestHorizon:
    def test_exponential_growth_is_measured_and_runs_into_its_horizon(self):
        time = np.linspace(0.0, 10.0, 1001)
        distance = DIFFERENCE * np.exp(2.0 * time)[None, :]
        growth = growth_of(time, distance, 1.0, 0.0)
        assert growth.exponent == pytest.approx(2.0, rel=1e-9)
        assert growth.horizon == pytest.approx(math.log(1e-2 / DIFFERENCE) / 2.0, abs=0.011)

    def test_what_does_not_grow_has_no_horizon(self):
        time = np.linspace(0.0, 10.0, 1001)
        noise = 1.0 + 0.1 * np.sin(37.0 * time)
        growth = growth_of(time, DIFFERENCE * noise[None, :], 1.0, 0.0)
        assert math.isinf(growth.horizon)
        assert growth.low < 0.0 < growth.high

    def test_interval_holds_the_true_slope_nine_times_in_ten(self):
        generator = np.random.default_rng(5)
        x = np.arange(8.0)
        inside = 0
        for _ in range(2000):
            _, low, high = slope_interval(x, 0.7 * x + generator.normal(size=8))
            inside += low <= 0.7 <= high
        assert inside / 2000 == pytest.approx(0.9, abs=0.02)


class TestTables:
    def test_luck_at_a_coarse_setting_is_no_way_to_an_error(self):
        points = made_up(
            [
                ("ours", "a", "a", 0, 1.0, 1e-5),  # by luck
                ("ours", "a", "a", 1, 2.0, 1e-2),
                ("ours", "a", "a", 2, 4.0, 1e-4),
            ]
        )
        assert kept_errors(points)["kept"].tolist() == [1e-2, 1e-2, 1e-4]

    def test_auto_is_compared_with_the_cheapest_at_every_decade(self):
        points = made_up(
            [
                ("ours", "auto, x", "auto", 0, 1.0, 9e-2),
                ("ours", "auto, x", "auto", 1, 8.0, 9e-4),
                ("ours", "time_stepping", "time_stepping", 0, 2.0, 9e-3),
                ("ours", "time_stepping", "time_stepping", 1, 5.0, 9e-4),
                ("ours", "event_driven", "event_driven", 0, 50.0, 9e-6),
            ]
        )
        table = auto_table(points).set_index("level")
        assert table["ratio"].tolist() == [1.0, 4.0, 1.6, math.inf, math.inf]
        assert table["flag"].tolist() == [False, True, True, True, True]

    def test_exponent_of_a_clean_method_is_one_over_its_order(self):
        rows = [
            ("ours", "a", "a", k, 2.0**k * (1.01 if k % 2 else 1.0), 0.5 * 4.0**-k)
            for k in range(6)
        ]
        found = exponents(made_up(rows)).iloc[0]
        assert found["low"] < 0.5 < found["high"]
        assert found["exponent"] == pytest.approx(0.5, abs=0.01)

    def test_points_at_the_floor_do_not_enter_exponents(self):
        rows = [("ours", "a", "a", k, 2.0**k, 0.5 * 4.0**-k) for k in range(6)]
        points = made_up([*rows, ("ours", "a", "a", 6, 1e6, 1e-9)])
        points.loc[6, "at_floor"] = True
        assert exponents(points).iloc[0]["exponent"] == pytest.approx(0.5)

    def test_a_limit_of_auto_is_weighed_against_its_default(self):
        points = pd.concat(
            made_up(
                [
                    ("ours", "auto", "auto", 0, cost, 1e-2),
                    ("limit", "auto 0.001, hand_over 10", "auto", 0, factor * cost, 4e-2),
                ]
            ).assign(scene=f"s{cost}")
            for cost, factor in ((1.0, 0.5), (2.0, 2.0))
        )
        points["way"] = points["line"].replace("auto", "auto 0.001")
        row = limits_table(points).iloc[0]
        assert row["scenes"] == 2
        assert (row["cost_ratio"], row["cost_least"], row["cost_most"]) == (1.0, 0.5, 2.0)
        assert row["error_ratio"] == pytest.approx(4.0)
        assert auto_table(points)["ratio"].tolist() == [1.0, 1.0]

    def test_a_peer_that_is_faster_at_equal_error_is_seen(self):
        points = made_up(
            [
                ("ours", "auto, x", "auto", 0, 1.0, 1e-1),
                ("ours", "auto, x", "auto", 1, 3.0, 1e-3),
                ("peer", "mujoco", "mujoco", 0, 2.0, 5e-2),
                ("peer", "mujoco", "mujoco", 1, 2.5, 1e-1),
            ]
        )
        table = against_peers(points)
        # Kept errors: 1e-1 at the coarse step too, so that only that level is left.
        assert table["level"].tolist() == [1e-1]
        assert table["peer_over_cheapest"].tolist() == [2.0]


@pytest.fixture(scope="module")
def block_history():
    scene = load_scene("block_sine")
    response = run_scene(scene, Way("event_driven", "rtol", 1e-9), history=True)
    return scene, response, marks_of(scene, response)


class TestQuantities:
    def test_positions_between_frames_follow_the_motion(self, block_history):
        _, response, marks = block_history
        history = response.history
        history = history.sel(time=slice(marks.onset + 1e-3, marks.impact))
        coarse, time = history.isel(time=slice(None, None, 4)), history["time"].to_numpy()
        between = positions_at(coarse, time[:-4])
        assert between == pytest.approx(history["displacement"].to_numpy()[:-4], abs=1e-8)

    def test_the_block_s_reaction_is_what_newton_s_law_asks_for(self, block_history):
        scene, response, marks = block_history
        history = response.history
        time, fall = history["time"].to_numpy(), history["velocity"].to_numpy()[:, 0, 1]
        upward = np.interp(marks.reactions, time, np.gradient(fall, time))
        force = resultants_at(history, marks.reactions)[:, 0, 1]
        assert force == pytest.approx(scene.bodies().mass[0] * (9.80665 + upward), rel=1e-5)

    def test_marks_lie_before_the_first_impact(self, block_history):
        _, _, marks = block_history
        assert marks.onset < marks.position < marks.impact
        assert marks.reactions.size >= 1
        assert np.all((marks.reactions > marks.onset) & (marks.reactions < marks.impact))

    def test_errors_fall_with_the_step_and_vanish_against_oneself(self, block_history):
        scene, response, marks = block_history
        true = observe(scene, response, marks)
        assert errors_of(true, true, 0.2)["position"] == 0.0
        found = []
        for step in (4e-3, 1e-3):
            way = Way("time_stepping", "dt", step)
            seen = observe(scene, run_scene(scene, way, history=True), marks)
            found.append(errors_of(seen, true, 0.2))
        for name in ("position", "reactions"):
            assert found[1][name] < 0.6 * found[0][name]
            assert found[1][name] < 0.05

    @pytest.mark.parametrize("late", [-2e-3, 2e-3])
    def test_frames_of_time_stepping_hold_all_of_one_instant(self, block_history, late):
        scene, response, marks = block_history
        true = observe(scene, response, marks)
        stepped = run_scene(scene, Way("time_stepping", "dt", 4e-3), history=True)
        shifted = stepped.history.assign_coords(time=stepped.history.time + late)
        at_once, beside = (
            errors_of(observe(scene, replace(stepped, history=history), marks), true, 0.2)
            for history in (stepped.history, shifted)
        )
        for name in ("position", "reactions"):
            assert at_once[name] < 0.5 * beside[name]


def test_one_scene_from_end_to_end(monkeypatch, tmp_path):
    few = (
        Line("time_stepping", tuple(Way("time_stepping", "dt", h) for h in (4e-3, 2e-3, 1e-3))),
        Line("auto", tuple(Way("auto", "rtol", r) for r in (1e-2, 1e-4))),
        Line("auto 0.01, coarse 0", (Way("auto", "rtol", 1e-2, {"coarse": 0.0}),), "limit"),
    )
    monkeypatch.setattr(speed_accuracy, "QUICK_SCENES", ("block_sine",))
    monkeypatch.setattr(speed_accuracy, "ladders", lambda quick: (few, ["nothing"]))
    frames = speed_accuracy.measure(Setup(True, Places(RECORDS), say=lambda _: None))
    points, references = frames["points"], frames["references"]
    assert set(points["quantity"]) == set(QUANTITIES)
    charted = points[points["charted"]]
    assert {"amplitude", "position"} <= set(charted["quantity"])
    # The reference's error is at most a tenth of the smallest error on each chart.
    for (scene, quantity), part in charted.groupby(["scene", "quantity"]):
        if quantity == "verdicts":
            continue
        own = references.set_index(["scene", "quantity"]).loc[(scene, quantity), "error"]
        smallest = np.maximum(part["error"], part["floor"]).min()
        assert own <= smallest / MARGIN * (1.0 + 1e-12)
    assert (points["cost"] > 0.0).all()
    save(tmp_path, "speed", frames, {})
    section = speed_accuracy.show(load(tmp_path, "speed"))
    assert "speed-amplitude" in section.pictures
    assert any("auto is within 1.5 times" in sentence for sentence in section.lead)
    peak = references.set_index("quantity").loc["peak", "value"]
    dense = run_scene(load_scene("block_sine"), Way("event_driven", "rtol", 1e-9), history=True)
    assert peak >= np.hypot(*dense.history["displacement"].to_numpy()[:, 0].T).max()
    amplitude = references.set_index("quantity").loc["amplitude"]
    assert amplitude["value"] == pytest.approx(0.2937, abs=1e-3)
    assert amplitude["second_away"] < 1e-3


def test_a_second_method_that_disagrees_raises_the_reference_s_error():
    stand = SimpleNamespace(error={"amplitude": 1e-8}, second={})
    settle(stand, "amplitude", 1e-3, 1e-2)
    assert stand.error["amplitude"] == 1e-8
    settle(stand, "amplitude", 1e-3, 1e-4)
    assert stand.error["amplitude"] == 1e-3
