"""The ladder's own limits: where it steps over all voussoirs, and where it never does."""

from pathlib import Path

import numpy as np
import pytest

import archfrag as af
from archfrag.physics.methods import auto
from archfrag.physics.status import Status

RECORDS = Path(__file__).parents[2] / "records"
ARCH = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
TIME = np.arange(0.0, 1.2, 0.001)
MOTION = af.Motion(6.0 * np.sin(2.0 * np.pi * TIME / 0.4), dt=0.001)


def run(rtol):
    return af.simulate(ARCH, MOTION, rtol=rtol, history=True)


def test_coarse_tolerances_are_met_by_steps_and_fine_ones_by_events():
    coarse = run(0.05)
    stepped = af.simulate(ARCH, MOTION, method="time_stepping", rtol=0.05, history=True)
    assert coarse.steps == stepped.steps
    assert np.array_equal(coarse.history.displacement, stepped.history.displacement)
    assert coarse.model_time["all_voussoirs"] > 0.0
    assert (
        coarse.model_time["mega_voussoirs"] == coarse.model_time["four_hinges"] == 0.0
    )
    times = run(1e-4).model_time
    assert times["four_hinges"] + times["mega_voussoirs"] > 0.1


@pytest.mark.parametrize(
    ("bad", "by_events"), [(0, False), (1, True), (2, False), (3, False)]
)
def test_a_run_that_breaks_its_tolerance_is_made_again_by_another_method(
    monkeypatch, bad, by_events
):
    judged = []
    judge = auto.is_accurate

    def strict(*given):
        judged.append(given)
        return judge(*given) & (len(judged) > bad)

    monkeypatch.setattr(auto, "is_accurate", strict)
    found = run(1e-3)
    times = found.model_time
    assert (times["four_hinges"] + times["mega_voussoirs"] > 0.1) == by_events
    assert found.work["refined"] == min(bad, 2)
    assert (found.status is Status.INACCURATE) == (bad == 3)
    if bad == 3:
        assert found.collapsed is None
    judged.clear()
    many = af.simulate_many(ARCH, MOTION, [1.0])
    assert many.steps.values[0] == found.steps
    if bad == 2:  # equal steps, not those that failed
        dt = judged[0][1].time_step
        equal = af.simulate(ARCH, MOTION, method="time_stepping", dt=dt)
        assert found.steps == equal.steps


def test_a_history_under_a_pulse_goes_by_events_and_a_verdict_by_steps():
    pulse = af.Motion(np.where(TIME < 0.3, 5.0, 0.0), dt=0.001)
    shown = af.simulate(ARCH, pulse, rtol=1e-2, history=True)
    assert shown.model_time["all_voussoirs"] < 0.1 * shown.end_time
    assert shown.events["events"] > 0
    alone = af.simulate(ARCH, pulse, rtol=1e-2)
    assert alone.model_time["mega_voussoirs"] == alone.model_time["four_hinges"] == 0.0
    many = af.simulate_many(ARCH, pulse, [1.0], rtol=1e-2)
    assert many.peak_rotation.values[0] == alone.peak_rotation
    assert alone.peak_rotation == pytest.approx(shown.peak_rotation, rel=0.05)


def test_blocks_under_records_go_by_steps():
    """Events at the default tolerance cost five times as much there and are no more accurate."""
    files = sorted((RECORDS / "near_source" / "synthetic").glob("*.mseed"))
    motions = [af.read_motion(each) for each in files[16:20]]
    block = af.Block(0.15, 1.2, 0.8)
    found = af.simulate_many(block, motions, np.full(4, 0.4))
    steps = af.simulate_many(block, motions, np.full(4, 0.4), method="time_stepping")
    assert found.drop_attrs().equals(steps.drop_attrs())
    fine = af.simulate(block, motions[2], 0.4, method="event_driven", rtol=1e-7)
    assert found.peak_rotation.values[2] == pytest.approx(fine.peak_rotation, rel=2e-3)


@pytest.mark.parametrize("solved", [True, False])
def test_a_run_whose_contacts_are_not_solved_is_made_again_by_another_method(
    monkeypatch, solved
):
    made = []
    step = auto.stepper.run

    def fails(*given):
        results = step(*given)
        made.append(given)
        if len(made) == 1 or not solved:
            results.status[:] = int(Status.NO_CONTACT_SOLUTION)
        return results

    for method in (auto.stepper, auto.events):
        monkeypatch.setattr(method, "run", fails)
    found = af.simulate(ARCH, MOTION, rtol=0.05)
    assert len(made) == (2 if solved else 3)
    assert (found.status == Status.NO_CONTACT_SOLUTION) is not solved
