"""Arches with little friction: when their joints slide and stick, and what collapses them."""

import math

import numpy as np
import pytest

import archfrag as af
from tests.physics.audit import sampled

PERIOD = 0.8
EVENT_DRIVEN = {"method": "event_driven", "rtol": 1e-6}
FINE = {"method": "time_stepping", "dt": 2.5e-4}


def low_friction(friction, thickness=1.5):
    return af.Arch.circular(10.0, thickness, 157.5, 7, friction)


def one_sine():
    return sampled(lambda t: np.sin(2.0 * np.pi * t / PERIOD), PERIOD)


def slide_of(run, joint, interruption=5e-3):
    """Start and end of the first slide of a joint that lasts, short interruptions left out [s]."""
    times = [
        (change.time, change.until)
        for change in run.mechanism
        if "towards" in change.joints.get(joint, "")
    ]
    start, end = times[0]
    for begin, until in times[1:]:
        if begin - end > interruption:
            if end - start > 2.0 * interruption:
                break
            start = begin
        end = until
    return start, end


@pytest.fixture(scope="module", params=[0.33, 0.36, 0.45])
def both(request):
    """An arch, its onset, and its response to one sine by either method."""
    arch = low_friction(request.param)
    start = af.onset(arch)
    runs = [
        af.simulate(arch, one_sine(), scale=1.8 * start.plus, history=True, **options)
        for options in (EVENT_DRIVEN, FINE)
    ]
    return arch, start, runs


class TestStart:
    def test_slides_from_the_instant_at_which_the_load_passes_the_onset(self, both):
        _, start, (ours, _) = both
        expected = math.asin(1.0 / 1.8) * PERIOD / (2.0 * math.pi)
        assert start.sliding == [0]
        assert slide_of(ours, 0)[0] == pytest.approx(expected, abs=1e-6)

    def test_reaction_is_on_the_cone_of_the_joint_that_slides(self, both):
        arch, _, (ours, _) = both
        history = ours.history
        tangent = arch.extrados[0] - arch.intrados[0]
        tangent /= np.linalg.norm(tangent)
        normal = np.array([tangent[1], -tangent[0]])
        mode = history.contact_mode.values[:, 0]
        force = history.reaction.values[:, 0]
        during = np.isin(mode, (2, 3, 5, 6, 8, 9)) & (history.time.values < 0.45)
        assert during.sum() > 100
        ratio = np.abs(force[during] @ tangent) / np.abs(force[during] @ normal)
        assert ratio == pytest.approx(arch.chain.friction[0], rel=1e-6)


class TestAgainstTimeStepping:
    def test_slides_and_sticks_at_the_same_instants(self, both):
        *_, (ours, fine) = both
        assert slide_of(ours, 0) == pytest.approx(slide_of(fine, 0), abs=1e-3)
        # The other springing slides after the first impacts.
        assert slide_of(ours, 7) == pytest.approx(slide_of(fine, 7), rel=1e-2)

    def test_same_amplitude_and_energy_lost_in_friction_and_impacts(self, both):
        *_, (ours, fine) = both
        assert ours.peak_displacement == pytest.approx(fine.peak_displacement, rel=1e-2)
        left = [np.abs(run.history.displacement.values[-1]).max() for run in (ours, fine)]
        assert left[0] == pytest.approx(left[1], rel=2e-2)
        lost = [run.energy["friction"] + run.energy["impacts"] for run in (ours, fine)]
        assert lost[0] == pytest.approx(lost[1], rel=1e-2)
        for run in (ours, fine):
            assert run.energy["friction"] < 0.5 * lost[0]


@pytest.mark.parametrize("options", [EVENT_DRIVEN, FINE], ids=["event_driven", "time_stepping"])
def test_friction_work_is_that_of_the_reaction_at_the_joint_that_slides(options):
    arch = low_friction(0.36)
    part = sampled(lambda t: np.sin(2.0 * np.pi * t / PERIOD), 0.3, dt=5e-4)
    run = af.simulate(
        arch, part, scale=1.6 * af.onset(arch).plus, history=True, follow=0.0, **options
    )
    history = run.history.drop_duplicates("time")
    assert np.abs(history.rotation.values[:, 0]).max() < 1e-9
    power = (history.reaction.values[:, 0] * history.velocity.values[:, 0]).sum(1)
    work = np.trapezoid(power, history.time.values)
    assert work < -100.0
    assert run.energy["friction"] == pytest.approx(work, rel=2e-3)
