"""Irregular scenes and studies with a vertical: what is drawn, what is run, what is counted."""

from dataclasses import replace

import numpy as np
import pytest
import run_hopping
from run_hopping import STUDIES, Task, motion_of, run_limits, study_rows
from run_irregular import MEASURES, summary_rows, violates
from tests.physics.irregular import irregular_scene

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY as G


class TestIrregularScenes:
    def test_a_scene_follows_from_its_seed(self):
        one, again, other = irregular_scene(4), irregular_scene(4), irregular_scene(5)
        np.testing.assert_array_equal(one.arch.intrados, again.arch.intrados)
        np.testing.assert_array_equal(one.motion.acceleration, again.motion.acceleration)
        assert one.arch.intrados.shape != other.arch.intrados.shape

    def test_scenes_are_irregular_stand_and_are_shaken(self):
        scenes = [irregular_scene(seed) for seed in range(80)]
        for scene in scenes:
            arch, motion = scene.arch, scene.motion
            assert 2 <= arch.n_voussoir <= 15
            assert af.onset(arch).stands
            assert np.abs(motion.acceleration).max() == pytest.approx(scene.peak * G)
            assert max(0.3, scene.onset) <= scene.peak <= 2.0
            assert 2.0 <= motion.duration + motion.dt <= 4.0 + 2e-3
            assert motion.vertical is None or np.abs(motion.vertical).max() <= 0.3 * G
            lengths = np.linalg.norm(arch.extrados - arch.intrados, axis=1)
            assert np.ptp(lengths) > 0.005 * lengths.max()
        friction = np.array([scene.arch.chain.friction[0] for scene in scenes])
        assert 0 < np.isinf(friction).sum() < 20
        assert friction.min() >= 0.2
        assert friction[np.isfinite(friction)].max() <= 0.9
        assert 0 < sum(scene.arch.free_end for scene in scenes) < 20
        loaded = sum(scene.arch.parameters["dead_load"] is not None for scene in scenes)
        assert 10 < loaded < 40


def judged(status="STANDING", **measures):
    """A row of run_irregular."""
    row = dict.fromkeys((*MEASURES, "wall_time"), "0.0")
    return row | {"status": status} | {name: str(value) for name, value in measures.items()}


class TestIrregularTables:
    @pytest.mark.parametrize(
        ("row", "broken"),
        [
            (judged(overlap=0.9e-4, energy_error=0.9e-2), False),
            (judged(overlap=1.1e-4), True),
            (judged("COLLAPSED", overlap=1.1e-4), True),
            (judged("UNFINISHED", energy_error=1.1e-2), True),
            (judged("NOT_FINITE", overlap=0.3), False),
            (judged(overlap=float("nan")), True),
        ],
    )
    def test_only_answers_can_break_the_row(self, row, broken):
        assert violates(row, 1e-3) is broken
        assert violates(judged(energy_error=2e-3), 1e-4)

    def test_the_row_is_kept_by_few_refusals_and_no_wrong_answer(self):
        rows = [judged() for _ in range(997)] + [judged("NO_CONTACT_SOLUTION")] * 3
        assert dict(summary_rows(rows, 1e-3))["row kept"] == "yes"
        for bad in (judged("NO_CONTACT_SOLUTION"), judged(overlap=0.1), judged("HUNG")):
            assert dict(summary_rows([*rows, bad], 1e-3))["row kept"] == "NO"


class TestHoppingStudies:
    def test_the_vertical_is_the_next_record_at_two_thirds(self):
        last = STUDIES["shipped"].records - 1
        for record, other in ((0, 1), (last, 0)):
            motion = motion_of("shipped", record, None)
            assert np.abs(motion.acceleration).max() == pytest.approx(G)
            assert np.abs(motion.vertical).max() == pytest.approx(0.67 * G)
            source = run_hopping.records_of(last + 1, None)[other]
            n = min(motion.vertical.size, source.acceleration.size)
            assert motion.dt == source.dt
            match = np.corrcoef(motion.vertical[:n], source.acceleration[:n])[0, 1]
            assert match == pytest.approx(1.0)
        assert motion_of("shipped, no vertical", 0, None).vertical is None

    def test_only_collapses_are_run_again_at_a_higher_limit(self, monkeypatch):
        capacity = {"0.02": 1.0, "0.5": 2.0}
        asked = []

        def run_all(tasks, work, path, fields, keys):
            asked.append(len(tasks))
            return [
                {key: str(getattr(task, key)) for key in keys}
                | {"status": "STANDING" if float(task.level) < limit else "COLLAPSED"}
                for task in tasks
                for limit in [capacity[task.loss_limit] * (0.8 + 0.1 * task.record)]
            ]

        monkeypatch.setattr(run_hopping, "run_all", run_all)
        task = Task("shipped", "auto", "", 0, "1", None)
        levels = [f"{level:g}" for level in np.linspace(0.5, 2.5, 21)]
        tasks = [replace(task, record=k, level=level) for k in range(5) for level in levels]
        rows = run_limits(tasks, ["0.02", "0.5"], None)
        fell = sum(row["status"] == "COLLAPSED" for row in rows[: len(tasks)])
        assert asked == [len(tasks), fell]
        assert len(rows) == 2 * len(tasks)
        low, high = study_rows(rows, ["0.02", "0.5"])
        assert low[4:6] == [fell, fell - high[4]]
        assert high[5] == 0
        assert float(low[-1].rstrip("%")) == pytest.approx(-50.0, abs=2.0)
