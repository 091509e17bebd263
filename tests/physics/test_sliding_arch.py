"""Arches with little friction: when their joints slide and stick, and what collapses them."""

import math

import numpy as np
import pytest

import archfrag as af
from tests.validation.scenes import sampled

PERIOD = 0.8


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
    """An arch, its onset, and its response to one sine by events and by steps."""
    arch = af.Arch.circular(10.0, 1.5, 157.5, 7, request.param)
    start, sine = af.onset(arch), sampled(lambda t: np.sin(2.0 * np.pi * t / PERIOD), PERIOD)
    ours, fine = (
        af.simulate(arch, sine, scale=1.8 * start.plus, history=True, **options)
        for options in (
            {"method": "event_driven", "rtol": 1e-6}, {"method": "time_stepping", "dt": 2.5e-4},
        )
    )  # fmt: skip
    return arch, start, ours, fine


def test_slides_on_its_cone_from_the_instant_at_which_the_load_passes_the_onset(both):
    arch, start, ours, _ = both
    expected = math.asin(1.0 / 1.8) * PERIOD / (2.0 * math.pi)
    assert start.sliding == [0]
    assert slide_of(ours, 0)[0] == pytest.approx(expected, abs=1e-6)
    tangent = arch.extrados[0] - arch.intrados[0]
    tangent /= np.linalg.norm(tangent)
    normal = np.array([tangent[1], -tangent[0]])
    history = ours.history
    slides = np.isin(history.contact_mode.values[:, 0], (2, 3, 5, 6, 8, 9))
    force = history.reaction.values[:, 0][slides & (history.time.values < 0.45)]
    assert len(force) > 100
    assert np.abs(force @ tangent) / np.abs(force @ normal) == (
        pytest.approx(arch.chain.friction[0], rel=1e-6)
    )


def test_slips_peak_and_energy_lost_are_those_of_time_stepping(both):
    *_, ours, fine = both
    assert slide_of(ours, 0) == pytest.approx(slide_of(fine, 0), abs=1e-3)
    # The other springing slides after the first impacts.
    assert slide_of(ours, 7) == pytest.approx(slide_of(fine, 7), rel=1e-2)
    assert ours.peak_displacement == pytest.approx(fine.peak_displacement, rel=1e-2)
    left = [np.abs(run.history.displacement.values[-1]).max() for run in (ours, fine)]
    assert left[0] == pytest.approx(left[1], rel=2e-2)
    lost = [run.energy["friction"] + run.energy["impacts"] for run in (ours, fine)]
    assert lost[0] == pytest.approx(lost[1], rel=1e-2)
    assert max(run.energy["friction"] for run in (ours, fine)) < 0.5 * lost[0]
