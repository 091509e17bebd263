"""Pure parts of the long benchmarks: runs that resume, tables, random scenes, cuts."""

import os
import time
from dataclasses import dataclass

import numpy as np
import pytest
from ladder_tables import (
    MODELS,
    PARTS,
    Pair,
    agreement_rows,
    curve_of,
    decided_rows,
    distance_to_agreement,
    pairs_of,
    parts_of,
    rates_of,
)
from random_scenes import CHAINS, how_contact_ended, random_scene, segment_distance
from resumable import CRASHED, ERROR, HUNG, kept_rows, run_all
from run_growth import INSIDE, SEVEN, cut_inside, exponent
from scipy.stats import norm

import archfrag

FIELDS, KEYS = ("index", "status", "square"), ("index",)


@dataclass(frozen=True)
class Task:
    """A number, and what becomes of its run."""

    index: int
    fate: str = ""


def square(task):
    """Square of the number, or the fate asked for."""
    if task.fate == "hang":
        time.sleep(120.0)
    if task.fate == "crash":
        os._exit(3)
    if task.fate == "raise":
        raise ValueError("as asked for")
    return {"status": "DONE", "square": task.index**2}


class TestResumableRuns:
    def test_rows_come_in_the_order_of_the_tasks_and_are_kept(self, tmp_path):
        path = tmp_path / "runs.csv"
        tasks = [Task(i) for i in range(6)]
        rows = run_all(tasks, square, path, FIELDS, KEYS, workers=2)
        assert [row["square"] for row in rows] == ["0", "1", "4", "9", "16", "25"]
        assert {row["index"] for row in kept_rows(path)} == set("012345")

    def test_only_what_is_missing_is_run(self, tmp_path):
        path = tmp_path / "runs.csv"
        path.write_text("index,status,square\n1,KEPT,one\n2,KEPT,t")
        path.write_text(path.read_text() + "wo\n3,CUT")
        rows = run_all([Task(i) for i in range(1, 4)], square, path, FIELDS, KEYS)
        assert [row["status"] for row in rows] == ["KEPT", "KEPT", "DONE"]
        assert len(kept_rows(path)) == 3

    def test_hung_crashed_and_failed_runs_cost_only_themselves(self, tmp_path):
        tasks = [Task(1, "hang"), Task(2, "crash"), Task(3, "raise"), Task(4)]
        rows = run_all(tasks, square, tmp_path / "runs.csv", FIELDS, KEYS, workers=2, limit=2.0)
        assert [row["status"] for row in rows] == [HUNG, CRASHED, ERROR, "DONE"]


def verdict(method, level, status, **cells):
    """A row of the ladder's runs."""
    row = {"method": method, "arch": "a", "record": "r", "level": str(level), "status": status}
    return row | dict.fromkeys(("wall_time", *MODELS), "0") | cells


class TestLadderTables:
    def test_pairs_differ_where_a_run_has_no_verdict(self):
        rows = [
            verdict("judge", 1, "STANDING"),
            verdict("judge", 2, "UNFINISHED"),
            verdict("judge", 3, "COLLAPSED"),
            verdict("mine", 1, "STANDING"),
            verdict("mine", 2, "UNFINISHED"),
            verdict("mine", 3, "STANDING"),
        ]
        pairs = pairs_of(rows, "judge", "mine")
        assert [pair.agree for pair in pairs] == [True, False, False]
        assert agreement_rows(pairs)[-1][1:7] == [3, 1, 2, 2, "33.33 %", "1 / 0, p = 1.00"]

    def test_distance_is_to_the_nearest_equal_verdict_of_the_same_record(self):
        same, other = verdict("j", 0, "STANDING"), verdict("m", 0, "COLLAPSED")
        pairs = [
            Pair("a", "r", 1.0, same, same),
            Pair("a", "r", 2.0, same, other),
            Pair("a", "r", 2.5, same, same),
            Pair("a", "s", 2.0, same, same),
        ]
        assert distance_to_agreement(pairs[1], pairs) == pytest.approx(0.25)
        assert distance_to_agreement(pairs[1], [*pairs[:2], pairs[3]]) == pytest.approx(0.5)
        assert np.isinf(distance_to_agreement(pairs[1], [pairs[1], pairs[3]]))

    def test_a_method_is_judged_where_the_judges_agree(self):
        said = {"a": "SSCC", "b": "SSCS", "mine": "SCCC"}
        words = {"S": "STANDING", "C": "COLLAPSED"}
        rows = [
            verdict(method, level, words[letter])
            for method, letters in said.items()
            for level, letter in enumerate(letters)
        ]
        table = {row[0]: row[1:] for row in decided_rows(rows, ["a", "b"])}
        assert table["mine"] == [2, 3, 1, "66.67 %"]
        assert table["a"] == [1, 4, 1, "75.00 %"]

    def test_curve_leaves_out_runs_without_a_verdict(self):
        levels = np.linspace(0.5, 2.0, 15)
        rows = []
        for level in levels:
            falls = round(200 * norm.cdf(np.log(level / 1.2) / 0.3))
            rows += [verdict("m", level, "COLLAPSED")] * falls
            rows += [verdict("m", level, "STANDING")] * (200 - falls)
            rows += [verdict("m", level, "NOT_FINITE")] * 50
        curve = curve_of(rows)
        assert curve.theta == pytest.approx(1.2, rel=5e-3)
        assert curve.beta == pytest.approx(0.3, rel=2e-2)

    def test_rates_are_found_from_times_and_counts(self):
        rng = np.random.default_rng(5)
        wanted = dict(zip(PARTS, (2e-4, 3e-6, 4e-5, 2e-4, 7e-3)))
        rows = []
        for _ in range(60):
            stepped, few, events, general = rng.exponential([2.0, 3e3, 2e3, 1e2])
            counts = {"steps": few + round(1.01 * stepped / 5e-4), "events": events + general}
            row = verdict("m", 1, "STANDING", all_voussoirs=str(stepped), general=str(general))
            row |= {name: str(value) for name, value in counts.items()}
            spent = sum(wanted[name] * part for name, part in parts_of(row, 5e-4).items())
            rows.append(row | {"wall_time": str(spent)})
        rates, misfit = rates_of(rows, 5e-4)
        assert rates == pytest.approx(wanted, rel=1e-5)
        assert misfit < 1e-6


class TestRandomScenes:
    def test_a_scene_follows_from_seed_and_index_alone(self):
        one = [random_scene(7, index) for index in (3, 4)]
        again = [random_scene(7, index) for index in (4, 3)][::-1]
        for a, b in zip(one, again):
            assert a.arch.parameters == b.arch.parameters
            np.testing.assert_array_equal(a.motion.acceleration, b.motion.acceleration)
        assert not np.array_equal(one[0].motion.acceleration, one[1].motion.acceleration)

    def test_every_profile_is_drawn_and_every_chain_stands_below_its_level(self):
        scenes = [random_scene(3, index) for index in range(150)]
        assert {scene.kind for scene in scenes} == set(CHAINS)
        assert max(scene.arch.n_voussoir for scene in scenes) > 50
        for scene in scenes:
            peak = np.abs(scene.motion.acceleration).max()
            assert peak == pytest.approx(scene.level * scene.onset * 9.80665)
            assert 0.5 <= scene.level <= 10.0
            assert archfrag.onset(scene.arch).stands


class TestContactSeenFromOutside:
    """A block of 1 m by 2 m: joint 0 is its base."""

    @pytest.mark.parametrize(
        ("shift", "turn", "state"),
        [
            ((0.0, 0.0), 0.0, "held"),
            ((0.3, 0.0), 0.0, "held"),
            ((0.0, 0.01), 0.0, "apart"),
            ((1.0, 0.0), 0.0, "past"),
            ((-1.1, -0.1), 0.0, "apart"),
            ((-1.0, 0.0), 0.0, "past"),
            ((0.0, 0.0), 0.5 * np.pi, "overturned"),
            ((0.0, 0.0), -1.6, "overturned"),
        ],
    )
    def test_state_of_the_base(self, shift, turn, state):
        chain = archfrag.Block(1.0, 2.0, 0.5).chain
        place = np.array([[*(chain.centroid[0] + shift), turn]])
        assert how_contact_ended(chain, place, 0) == state

    def test_rocking_on_a_corner_is_contact(self):
        chain = archfrag.Block(1.0, 2.0, 0.5).chain
        angle = 0.2
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        corner = np.array([-0.5, 0.0])
        centroid = corner + turn @ (chain.centroid[0] - corner)
        place = np.array([[*centroid, angle]])
        assert how_contact_ended(chain, place, 0) == "held"
        assert how_contact_ended(chain, np.add(place, [0.0, 0.01, 0.0]), 0) == "apart"

    def test_distance_of_segments(self):
        one = np.array([[0.0, 0.0], [1.0, 0.0]])
        assert segment_distance(one, np.array([[0.5, 0.3], [0.5, 1.0]])) == pytest.approx(0.3)
        assert segment_distance(one, np.array([[0.5, -0.1], [0.6, 1.0]])) == 0.0
        assert segment_distance(one, np.array([[4.0, 4.0], [5.0, 9.0]])) == pytest.approx(5.0)


class TestCuts:
    @pytest.mark.parametrize("voussoirs", [7, 14, 27, 108])
    def test_joints_of_seven_stay_and_others_keep_off_the_hinges(self, voussoirs):
        joints = np.array(cut_inside(voussoirs).parameters["joints"])
        assert len(joints) == voussoirs + 1
        extra = [x for x in joints if np.abs(SEVEN - x).min() > 1e-9]
        assert len(extra) == voussoirs - 7
        assert all(any(start <= x <= end for start, end in INSIDE) for x in extra)

    def test_exponent_of_a_power_law(self):
        numbers = [7, 14, 28, 56]
        slope, reach = exponent(numbers, [3e-4 * n**0.5 for n in numbers])
        assert slope == pytest.approx(0.5)
        assert reach == pytest.approx(0.0, abs=1e-9)
