"""Maps of failures: a run made wrong in one thing is found wrong in that only."""

from dataclasses import replace

import numpy as np
import pytest

from archbench import stability
from archbench.scene import load_scene
from archbench.settings import Setting
from archbench.solve import solve
from archbench.stability import judge_cell, reference_of

STEPS = Setting("time_stepping", "dt", 1e-3)
SHORT = replace(load_scene("arch7_pulse"), duration=2.0).at(0.45)


@pytest.fixture(scope="module")
def right():
    return solve(SHORT, STEPS, history=True)


def moved(run, where, by):
    """The run with displacements changed, in frames and in the response's history."""
    displacement = run.frames.displacement.copy()
    displacement[where] += by
    history = run.response.history.copy(deep=True)
    history["displacement"].values[:] = displacement
    return replace(
        run,
        frames=run.frames._replace(displacement=displacement),
        response=replace(run.response, history=history),
    )


@pytest.mark.parametrize(
    ("change", "expected", "must_rest", "failures"),
    [
        (lambda run: run, False, False, ""),
        (
            lambda run: replace(run, status="not_finite", collapsed=None),
            False,
            False,
            "diverged",
        ),
        (lambda run: moved(run, np.s_[-1, :, 1], np.nan), False, False, "diverged"),
        (lambda run: replace(run, unconverged=True), False, False, "unconverged"),
        (
            lambda run: replace(run, status="work_bound", collapsed=None),
            False,
            False,
            "not ended",
        ),
        (lambda run: replace(run, peak=2e-6), False, True, "drifted at rest"),
        (lambda run: moved(run, np.s_[:, 3, 1], -0.01), False, False, "penetrated"),
        (
            lambda run: moved(run, np.s_[run.frames.time > 0.5, :, 1], 0.1),
            False,
            False,
            "gained energy",
        ),
        (lambda run: run, True, False, "missed collapse"),
        (lambda run: replace(run, collapsed=True), False, False, "false collapse"),
        (lambda run: replace(run, collapsed=True), None, False, ""),
    ],
)
def test_each_failure_is_found(
    monkeypatch, right, change, expected, must_rest, failures
):
    monkeypatch.setattr(stability, "solve", lambda *_, **__: change(right))
    row = judge_cell(SHORT, STEPS, expected, must_rest)
    assert row["failures"] == failures
    assert row["kind"] == (failures or ("undecided" if expected is None else "right"))


def test_reference_is_open_where_two_methods_do_not_agree(monkeypatch, right):
    answers = iter([True, True, True, False, True, True])
    monkeypatch.setattr(
        stability, "solve", lambda *_: replace(right, collapsed=next(answers))
    )
    assert reference_of(SHORT, quick=True) is None
    answers = iter([True] * 6)
    assert reference_of(SHORT, quick=True) is True
