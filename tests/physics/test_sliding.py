"""Sliding: arches with little friction by events and by steps, and a block that has slipped.

Where a slipped joint is open Signorini's law splits (Eqs 23a and 23b): towards one side the
block's own corner stands on its pedestal, towards the other the pedestal's edge bears its face.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import archfrag as af
from archbench.paper.arch import cross
from tests.physics.linkages import rotate
from tests.validation.scenes import g, sampled

PERIOD = 0.8
HALF = 0.3
UP = 0.6
GYRATION = (HALF**2 + UP**2) / 3.0
FRICTION = 0.05
TILT = 0.25
DURATION = 0.15


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
    start = af.onset(arch)
    sine = sampled(lambda t: np.sin(2.0 * np.pi * t / PERIOD), PERIOD)
    ours, fine = (
        af.simulate(arch, sine, scale=1.8 * start.plus, history=True, **options)
        for options in (
            {"method": "event_driven", "rtol": 1e-6},
            {"method": "time_stepping", "dt": 2.5e-4},
        )
    )
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


def leaning(shift):
    """Displacement of a block shifted, then rotated to the right about what it stands on."""
    pivot = np.array([min(HALF, HALF + shift), 0.0])
    centre = pivot + rotate(np.array([shift, UP]) - pivot, -TILT)
    return np.array([[centre[0], centre[1] - UP, -TILT]])


def slide(shift):
    """Times and displacements (3, n) of the block by its equations of motion; its slip rates."""
    corner = np.array([HALF, -UP])
    edge = np.array([HALF, 0.0])

    def contact(state):
        """Normal, arm from the centre to the contact, and what the gap accelerates unforced."""
        _, _, rotation, vx, vy, spin = state
        if shift < 0.0:
            normal = np.array([0.0, 1.0])
            arm = rotate(corner, rotation)
            return normal, arm, -g - spin**2 * arm[1]
        normal = rotate(np.array([0.0, 1.0]), rotation)
        arm = edge - state[:2]
        swung = spin * np.array([-normal[1], normal[0]])
        bend = 2.0 * swung @ [vx, vy] + spin**2 * (normal @ arm)
        return normal, arm, normal @ [0.0, -g] + bend

    def slip_rate(state):
        normal, arm, _ = contact(state)
        rate = state[3:5] + state[5] * np.array([-arm[1], arm[0]])
        return rate @ [normal[1], -normal[0]]

    def moving(_, state, sense):
        normal, arm, unforced = contact(state)
        reaction = normal - sense * FRICTION * np.array([normal[1], -normal[0]])
        moment = cross(arm, reaction)
        lever = cross(arm, normal)
        press = -unforced / (normal @ reaction + lever * moment / GYRATION)
        assert press > 0.0
        return [*state[3:], *(press * reaction - [0.0, g]), press * moment / GYRATION]

    start = np.append(leaning(shift)[0] + [0.0, UP, 0.0], np.zeros(3))
    time = np.linspace(0.0, DURATION, 50)[1:]
    for sense in (1.0, -1.0):
        found = solve_ivp(
            moving,
            (0.0, DURATION),
            start,
            args=(sense,),
            t_eval=time,
            rtol=1e-11,
            atol=1e-13,
        )
        slips = np.array([slip_rate(s) for s in found.y.T])
        if (sense * slips > 0.0).all():
            return time, found.y[:3] - [[0.0], [UP], [0.0]], slips
    raise AssertionError("the contact sticks")


# To the left, so that the block's right corner is over the pedestal; and to the right.
@pytest.mark.parametrize("shift", [-0.1, 0.1])
def test_a_vertex_that_runs_over_the_other_bodys_face_obeys_the_equations_of_motion(
    shift,
):
    time, exact, slips = slide(shift)
    assert np.abs(slips[-1]) > 0.05
    block = af.Block(2.0 * HALF, 2.0 * UP, FRICTION)
    start = (leaning(shift), np.zeros((1, 3)))
    errors = []
    for dt in (2e-4, 1e-4):
        history = af.simulate(
            block,
            af.Motion(np.zeros(round(DURATION / dt) + 1), dt),
            method="time_stepping",
            dt=dt,
            initial=start,
            history=True,
            follow=0.0,
        ).history
        found = *history.displacement.values[:, 0].T, history.rotation.values[:, 0]
        moved = np.array([np.interp(time, history.time, each) for each in found])
        errors.append(np.abs(moved - exact).max())
    assert errors[1] < 3e-8
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
