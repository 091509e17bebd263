"""Maps of failures: each kind is seen where it is, and hung runs are ended."""

import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from archfrag.evidence.part import Setup
from archfrag.evidence.run import Places, Way, run_scene
from archfrag.evidence.scene import load_scene
from archfrag.evidence.stability import planes as stability
from archfrag.evidence.stability.maps import (
    FAILURES,
    KINDS,
    RIGHT,
    draw_maps,
    kinds_of,
    lead_sentences,
)
from archfrag.evidence.stability.planes import Plane, judge_cell, measure, reference, show, ways
from archfrag.evidence.stability.watch import in_watched_processes
from archfrag.mechanics.status import Status

STEPS = Way("time_stepping", "dt", 1e-3)
SHORT = replace(load_scene("arch7_pulse"), duration=2.0)


def nap(seconds):
    """Sleep, and say how long."""
    time.sleep(seconds)
    return seconds


def leave(code):
    """End the process."""
    raise SystemExit(code)


class TestWatchedProcesses:
    def test_what_takes_too_long_is_ended_and_the_rest_is_done_in_order(self):
        began = time.monotonic()
        found = in_watched_processes(nap, [(0.2,), (600.0,), (0.0,), (0.1,)], 2, limit=3.0)
        assert found == [0.2, None, 0.0, 0.1]
        assert time.monotonic() - began < 60.0

    def test_a_process_that_ends_by_itself_is_told(self):
        with pytest.raises(RuntimeError, match="task 0 ended by itself"):
            in_watched_processes(leave, [(3,)], 1, limit=30.0)


class TestJudgement:
    """A run made wrong in one way is wrong in that way only."""

    def judged(self, monkeypatch, change, level=0.45, expected="stands", must_rest=False):
        response = run_scene(SHORT.at(level), STEPS, history=True)
        wrong = change(replace(response, history=response.history.copy(deep=True)))
        monkeypatch.setattr(stability, "run_scene", lambda *_, **__: wrong)
        row = judge_cell(SHORT.at(level), STEPS, expected, must_rest)
        return [name for name in FAILURES if row.get(name)]

    def test_a_right_run(self, monkeypatch):
        assert self.judged(monkeypatch, lambda r: r) == []

    def test_not_finite(self, monkeypatch):
        def change(r):
            return replace(r, status=Status.NOT_FINITE, collapsed=None)

        assert self.judged(monkeypatch, change) == ["diverged"]

    def test_a_collapse_that_is_not_finite(self, monkeypatch):
        def change(r):
            r.history["displacement"][-1] = np.nan
            return replace(r, status=Status.COLLAPSED, collapsed=True)

        assert self.judged(monkeypatch, change) == ["diverged", "false collapse"]

    def test_unconverged(self, monkeypatch):
        def change(r):
            return replace(r, status=Status.NO_CONTACT_SOLUTION, collapsed=None)

        assert self.judged(monkeypatch, change) == ["unconverged"]

    def test_steps_left_unsolved(self, monkeypatch):
        def change(r):
            return replace(r, work={**r.work, "unconverged": 3})

        assert self.judged(monkeypatch, change) == ["unconverged"]

    def test_a_method_without_a_model_for_it_does_not_fail(self, monkeypatch):
        def change(r):
            return replace(r, status=Status.NOT_APPLICABLE, collapsed=None)

        assert self.judged(monkeypatch, change) == []

    def test_work_bound(self, monkeypatch):
        def change(r):
            return replace(r, status=Status.WORK_BOUND, collapsed=None)

        assert self.judged(monkeypatch, change) == ["hung"]

    def test_drift(self, monkeypatch):
        def change(r):
            return replace(r, peak_displacement=2e-6)

        assert self.judged(monkeypatch, change, 0.3, must_rest=True) == ["drifted at rest"]

    def test_overlap(self, monkeypatch):
        def change(r):
            r.history["displacement"][:, 3, 1] -= 0.01
            return r

        assert self.judged(monkeypatch, change) == ["penetrated"]

    def test_energy(self, monkeypatch):
        def change(r):
            late = (r.history.time > 0.5).values[:, None]
            r.history["displacement"][:, :, 1] += 0.1 * late
            return r

        assert "gained energy" in self.judged(monkeypatch, change)

    def test_verdicts(self, monkeypatch):
        assert self.judged(monkeypatch, lambda r: r, expected="falls") == ["missed collapse"]
        fallen = {"status": Status.COLLAPSED, "collapsed": True}
        assert self.judged(monkeypatch, lambda r: replace(r, **fallen)) == ["false collapse"]
        assert self.judged(monkeypatch, lambda r: r, expected="undecided") == []


def test_reference_is_undecided_where_two_methods_do_not_agree(monkeypatch):
    said = iter([True, True, True, False])
    monkeypatch.setattr(stability, "run_scene", lambda *_: None)
    monkeypatch.setattr(stability, "verdict_of", lambda _: next(said))
    assert reference(SHORT, quick=True) == "undecided"
    monkeypatch.setattr(stability, "verdict_of", lambda _: True)
    assert reference(SHORT, quick=True) == "falls"


def test_a_run_that_blows_up_is_no_collapse():
    planes = {plane.name: plane for plane in stability.planes(quick=True)}
    scene = dict(planes["slenderness"].scenes)["0.3"]
    response = run_scene(scene, Way("event_driven", "rtol", 0.3))
    assert not response.collapsed or response.collapse_joint >= 0
    assert response.collapsed is None or response.peak_displacement < 100.0


def test_every_method_has_ways_from_coarse_to_fine():
    for method in ("time_stepping", "event_driven", "auto"):
        values = [way.value for way in ways(method, quick=True)]
        assert values == sorted(values, reverse=True)
        assert len(values) == 5


def test_a_method_that_divides_its_step_is_varied_by_the_part_of_the_critical_one():
    found = [stability.knob_of(way) for way in ways("penalty", quick=True)]
    assert {knob for knob, _ in found} == {"step_fraction"}
    assert len({value for _, value in found}) == 5


@pytest.fixture(scope="module")
def small():
    """Tables of one plane of two levels by time stepping."""
    plane = Plane("level", "Level", "g", (("0.2", SHORT.at(0.2)), ("0.45", SHORT.at(0.45))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stability, "planes", lambda quick: [plane])
        patch.setattr(stability, "available_methods", lambda: ("time_stepping",))
        patch.setattr(
            stability, "in_watched_processes",
            lambda function, tasks, *_, **__: [function(*task) for task in tasks],
        )  # fmt: skip
        setup = Setup(True, Places(None), say=lambda _: None)
        yield measure(setup)


class TestTables:
    def test_a_row_for_each_run_and_a_verdict_for_each_scene(self, small):
        assert len(small["cells"]) == 10
        assert list(small["references"]["reference"]) == ["stands", "stands"]
        assert list(small["references"]["must_rest"]) == [True, False]

    def test_what_must_rest_is_judged_by_its_drift(self, small):
        still = small["cells"].query("row == '0.2'")
        assert (still["drift"] == 0.0).all()
        assert small["cells"].query("row == '0.45'")["drift"].isna().all()

    def test_shown(self, small):
        section = show(small)
        assert set(section.pictures) == {"stability-level"}
        assert any(line.startswith("time_stepping: ") for line in section.lead)


class TestMaps:
    CELLS = pd.DataFrame(
        {
            "method": ["a", "a", "b"], "knob": ["dt", "dt", "rtol"], "value": [1e-2, 1e-3, 1e-2],
            "row": [27.0, 27.0, 27.0], "diverged": [True, False, np.nan],
            "penetrated": [True, True, np.nan], "does not apply": [np.nan, np.nan, True],
        }
    )  # fmt: skip

    def test_the_worst_kind_is_shown_and_all_are_counted(self):
        assert list(kinds_of(self.CELLS)) == ["diverged", "penetrated", "does not apply"]
        first, second = lead_sentences(self.CELLS)
        assert first == "a: 0 of 2 runs without a failure; 1 diverged, 2 penetrated."
        assert second == "b: 0 of 0 runs without a failure; none failed."

    def test_colours_differ_and_letters_too(self):
        assert len({fill for _, fill, _ in KINDS.values()}) == len(KINDS)
        assert len({letter for letter, _, _ in KINDS.values()}) == len(KINDS)
        assert next(reversed(KINDS)) == RIGHT

    def test_drawn_with_its_counts(self):
        svg = draw_maps("m", "Title", "voussoirs", self.CELLS).svg
        assert "D diverged (1)" in svg
        assert ">27<" in svg
        assert "27.0" not in svg
