"""Speed against accuracy: its reference and its errors."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from archbench.growth import DIFFERENCE, growth_of
from archbench.quantities import errors_of, marks_of, observe, positions_at
from archbench.reference import MARGIN, find_reference, limit_of, richardson
from archbench.scene import load_scene
from archbench.settings import Setting
from archbench.solve import (
    Frames,
    least_collapsing,
    nearest_change,
    solve,
    with_samples,
)
from archbench.speed import POINTS, kept_errors, points_of
from archfrag.errors import InputError


def test_a_record_that_is_not_there_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("archbench.solve.PRIVATE", tmp_path)
    with pytest.raises(InputError, match="arch7_real_pul164 needs the record"):
        with_samples(load_scene("arch7_real_pul164"))


@pytest.mark.parametrize("true", [0.93, 0.9999, 1.00002, 1.02, 1.4])
def test_the_nearest_change_is_found_to_a_tenth_of_its_distance(true):
    found = nearest_change(lambda a: a >= true, 1.0, 1e-7)
    assert found.offset == pytest.approx(true - 1.0, rel=0.06)
    assert least_collapsing(lambda a: a >= true, 0.5, 2.0) == pytest.approx(
        true, rel=1e-4
    )


def test_no_change_within_reach_is_not_a_failed_run():
    for above in (None, False):
        found = nearest_change(
            lambda a, seen=above: seen if a > 1.0 else False, 1.0, 1e-3, 0.3
        )
        assert math.isnan(found.offset)
        assert found.failed is (above is None)


def test_limit_and_order_of_a_vector():
    true = np.array([1.0, -2.0])
    slope = np.array([0.3, 0.7])
    limit, uncertainty, order = richardson([true + slope * h for h in (0.4, 0.2, 0.1)])
    assert limit == pytest.approx(true, abs=1e-12)
    assert (order, uncertainty) == (pytest.approx(1.0), pytest.approx(0.07))
    # A small last difference is not taken for a limit.
    limit, doubt = limit_of([np.array(v) for v in (0.10, 0.15, 0.19, 0.1901)])
    assert abs(float(limit) - 0.2) < doubt


def test_growth_of_a_difference_is_measured_and_runs_into_its_horizon():
    time = np.linspace(0.0, 10.0, 1001)
    noise = 1.0 + 0.1 * np.sin(37.0 * time)
    grows, stays = (
        growth_of(time, DIFFERENCE * each[None, :], 1.0, 0.0)
        for each in (np.exp(2.0 * time), noise)
    )
    assert grows["exponent"] == pytest.approx(2.0, rel=1e-9)
    assert grows["horizon"] == pytest.approx(
        math.log(1e-2 / DIFFERENCE) / 2.0, abs=0.011
    )
    assert math.isinf(stays["horizon"])
    assert stays["low"] < 0.0 < stays["high"]


def test_chance_at_a_coarse_setting_is_not_accuracy_and_errors_stand_at_the_floor():
    points = pd.DataFrame(
        {"value": [4, 2, 1], "seconds": 1.0, "error": [1e-5, 1e-2, 1e-9]}
    )
    points = points.assign(
        method="a", scene="s", quantity="amplitude", floor=1e-7, drawn=True
    )
    assert kept_errors(points)["kept"].tolist() == [1e-2, 1e-2, 1e-7]


@pytest.fixture(scope="module")
def block():
    scene = load_scene("block_sine")
    run = solve(scene, Setting("event_driven", "rtol", 1e-8), history=True)
    return scene, run, marks_of(run)


def test_positions_between_frames_follow_the_motion(block):
    _, run, marks = block
    inside = (run.frames.time > marks.onset + 1e-3) & (run.frames.time < marks.position)
    frames = Frames(*(each[inside] for each in run.frames))
    between = positions_at(Frames(*(each[::4] for each in frames)), frames.time[:-4])
    assert between == pytest.approx(frames.displacement[:-4], abs=1e-8)


def test_a_run_has_no_error_against_itself_and_a_coarse_one_has(block):
    scene, run, marks = block
    seen = observe(scene, run, marks)
    coarse = solve(scene, Setting("time_stepping", "dt", 8e-3), history=True)
    own, errors, failed = (
        errors_of(each, seen, scene.thickness)
        for each in (seen, observe(scene, coarse, marks), replace(seen, collapsed=None))
    )
    assert (own["position"], own["peak"]) == (0.0, 0.0)
    assert errors["position"] > 1e-6
    assert errors["peak"] > 1e-4
    assert all(math.isnan(value) for value in failed.values())


def test_a_scene_from_reference_to_points():
    reference = find_reference(load_scene("block_sine"), quick=True)
    # Housner's block: the two tolerances agree to the bracket, the second method to its own doubt.
    assert reference.amplitude == pytest.approx(0.29334, rel=1e-4)
    assert reference.error["amplitude"] < 1e-5
    assert reference.second["amplitude"][0] < 2e-3
    ladder = [Setting("time_stepping", "dt", step) for step in (8e-3, 1e-3)]
    points = pd.DataFrame(
        points_of(reference, ladder, True)["points"], columns=list(POINTS)
    )
    by = points[points["quantity"] == "amplitude"].set_index("value")
    assert by.loc[8e-3, "error"] > 5.0 * by.loc[1e-3, "error"] > 0.0
    assert by["floor"].min() >= MARGIN * reference.error["amplitude"] * (1.0 - 1e-12)
    assert (points["seconds"] > 0.0).all()
