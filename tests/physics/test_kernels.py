"""Kernels that all methods are judged or ended by, on hand-made states of a block.

The block is 1 m wide and 2 m high; its joint's corner 0 lies at x = 0.5 m, corner 1 at -0.5 m, so
that the normal points up and the tangent along -x. Gravity is 10 m/s2, the weight W.
"""

import math

import numpy as np
import pytest

import archfrag as af
from archfrag.physics import shared
from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact.blocks import EXACT
from archfrag.physics.contact.modes import solve_contact
from archfrag.physics.contact.placing import move_faces, place_contacts
from archfrag.physics.energy import record_step
from archfrag.physics.interface import Options
from archfrag.physics.residual import state_residual
from archfrag.physics.state import Clock, model_of, new_state, new_work
from archfrag.physics.status import CollapseMode, Energy, Loss, Status, Wait

CHAIN = af.Block(1.0, 2.0, friction=0.5).chain
MODEL = model_of(CHAIN)._replace(gravity=10.0)
MASS = float(CHAIN.mass[0])
WEIGHT = 10.0 * MASS
LOSS_LIMIT = 0.5


def placed(x=0.0, y=0.0, tilt=0.0, contact=(1.0, 1.0), slide=0.0):
    """State and workspace of the block displaced by (x, y) with its joint in a mode."""
    state = new_state(MODEL)
    work = new_work(MODEL)
    shared.clear(state)
    state.position[1] = [CHAIN.centroid[0, 0] + x, CHAIN.centroid[0, 1] + y, tilt]
    move_faces(MODEL, state.position, work)
    place_contacts(MODEL, state.slip, work)
    work.contact[0] = contact
    work.slide[0] = slide
    return state, work


@pytest.mark.parametrize(
    ("place", "mode", "collapses", "slip"),
    [
        ((), {}, False, 0.0),
        (
            (0.0, 0.3),
            {"contact": (0.0, 0.0)},
            False,
            0.0,
        ),  # in flight: it may land again
        (
            (0.0, 0.6),
            {"contact": (0.0, 0.0)},
            True,
            0.0,
        ),  # the gap has passed the limit
        ((0.7, 0.0), {"slide": 1.0}, False, -0.7),
        ((1.1, 0.0), {"slide": 1.0}, True, -1.1),  # the faces no longer overlap
        (
            (0.0, 0.0, 1.6),
            {"contact": (0.0, 1.0)},
            True,
            0.0,
        ),  # rotated beyond 90 degrees
    ],
)
def test_follow_joints(place, mode, collapses, slip):
    state, work = placed(*place, **mode)
    state.clock[Clock.TIME] = 2.0
    assert bool(follow_joints(MODEL, state, work, True, LOSS_LIMIT)) is collapses
    assert list(state.contact[0]) == list(work.contact[0])
    if len(place) < 3:
        assert state.slip[0] == pytest.approx(slip, abs=1e-12)
    lost = mode.get("contact") == (0.0, 0.0)
    assert (state.lost_since[0] == 2.0) == lost
    assert state.loss[Loss.WIDEST] == pytest.approx(place[1] if lost else 0.0)
    assert math.isnan(state.loss[Loss.TIME]) is not lost


@pytest.mark.parametrize(
    ("place", "force", "expected"),
    [
        ((), (0.0, 1.0, 0.0), 0.0),  # at rest under its weight
        ((), (0.4, 1.0, 0.0), 0.0),  # inside the cone
        ((), (0.7, 1.0, 0.0), 0.2),  # 0.2 W outside
        (
            (),
            (0.0, 1.0, 0.6),
            0.1,
        ),  # acts 0.1 m outside the base: 0.1 W of tension at a corner
        ((), (0.0, -1.0, 0.0), 0.5),  # tension at both corners
        ((0.0, 0.1), (0.0, 0.0, 0.0), 0.0),  # in flight
        ((0.0, 0.1), (0.0, 1.0, 0.0), 0.1),  # a reaction across a gap
        ((0.0, -0.01), (0.0, 1.0, 0.0), 0.01),  # overlap, over the joint's length
    ],
)
def test_state_residual(place, force, expected):
    state, work = placed(*place)
    work.reaction[0] = np.array(force) * WEIGHT
    found = state_residual(MODEL, state, work)
    assert found == pytest.approx(expected, rel=0.15, abs=1e-9)
    assert work.reaction[0] == pytest.approx(np.array(force) * WEIGHT)


@pytest.mark.parametrize(
    ("free", "contact", "slide", "velocity"),
    [
        ((0.0, -10.0, 0.0), (1, 1), 0, (0.0, 0.0, 0.0)),  # rests
        ((4.0, -10.0, 0.0), (1, 1), 0, (0.0, 0.0, 0.0)),  # friction and base hold it
        ((0.0, 1.0, 0.0), (0, 0), 0, (0.0, 1.0, 0.0)),  # lifts off
        ((1.0, 0.0, 0.0), (1, 1), 0, (1.0, 0.0, 0.0)),  # nothing presses
    ],
)
def test_solve_contact(free, contact, slide, velocity):
    state, work = placed()
    work.free[1] = free
    work.candidate[:] = 1.0
    solved, refused, active, iterations = solve_contact(
        MODEL, state.position, work, True, 0.0, -1.0, EXACT
    )
    assert (solved, refused, active) == (True, False, False)
    assert iterations >= 1.0
    assert work.solved[1] == pytest.approx(velocity, abs=1e-8)
    if free[1] < 0.0:
        assert list(work.contact[0]) == list(contact)
        assert work.slide[0] == slide
        assert work.reaction[0, :2] == pytest.approx(
            [-free[0] * MASS, WEIGHT], rel=1e-9
        )


def test_solve_contact_slides_on_the_cone_and_refuses_a_step_in_which_a_corner_closes():
    state, work = placed()
    work.free[1] = (6.0, -10.0, 0.0)
    work.candidate[:] = 1.0
    wide = MODEL._replace(friction=np.array([0.3]), ray=np.array([[1.0, 0.3]]))
    assert solve_contact(wide, state.position, work, True, 0.0, -1.0, EXACT)[0]
    assert work.reaction[0, 0] == pytest.approx(-0.3 * work.reaction[0, 1])
    state, work = placed(0.0, 0.01, contact=(0.0, 0.0))
    work.free[1] = (0.0, -10.0, 0.0)
    work.candidate[:] = 1.0
    work.bias[:, :, 1] = 1.0
    assert solve_contact(MODEL, state.position, work, True, 0.0, 0.0, EXACT)[1]


@pytest.mark.parametrize(
    ("code", "place", "status", "how"),
    [
        (Wait.IDLE, (), Status.STANDING, CollapseMode.NONE),
        (Wait.BROKEN, (), Status.NOT_FINITE, CollapseMode.NONE),
        (Wait.EXHAUSTED, (), Status.WORK_BOUND, CollapseMode.NONE),
        (Wait.UNSOLVED, (), Status.NO_CONTACT_SOLUTION, CollapseMode.NONE),
        (Wait.AT_END, (), Status.UNFINISHED, CollapseMode.NONE),
        (
            Wait.AT_END,
            (0.0, 0.1),
            Status.COLLAPSED,
            CollapseMode.LIFT_OFF,
        ),  # in flight
        (Wait.COLLAPSES, (0.0, 0.6), Status.COLLAPSED, CollapseMode.LIFT_OFF),
        (Wait.COLLAPSES, (0.0, 0.0, 1.6), Status.COLLAPSED, CollapseMode.OVERTURNING),
    ],
)
def test_end_run(code, place, status, how):
    state, work = placed(*place)
    if len(place) == 2:
        state.contact[0] = 0.0
        state.lost_since[0] = 3.0
    state.velocity[1, 0] = 2.0
    state.clock[Clock.CODE] = code
    state.clock[Clock.TIME] = 4.0
    options = Options(1e-3, 1e-3, 1e-3, 0.0, 10, LOSS_LIMIT, 64, 1e-2, 0.0)
    results = shared.new_results(2)
    shared.end_run(MODEL, state, work, options, shared.no_output(1, 1), results, 1)
    assert results.status[1] == status
    assert results.collapse_mode[1] == how
    assert results.collapse_joint[1] == (0 if status == Status.COLLAPSED else -1)
    assert results.end_time[1] == 4.0
    assert results.energy[1, Energy.KINETIC] == pytest.approx(2.0 * MASS)
    assert not results.energy[0].any()


@pytest.mark.parametrize(
    ("relative", "force", "impact", "entry", "expected"),
    [
        (
            (-1.0, 0.0),
            (1.0, 2.0),
            0.0,
            Energy.FRICTION,
            -1.0,
        ),  # slides against its friction
        (
            (0.0, -1.0),
            (0.0, 2.0),
            1.0,
            Energy.IMPACT,
            -2.0,
        ),  # an impact takes what it takes
        (
            (0.0, 1.0),
            (0.0, 2.0),
            0.0,
            Energy.BALANCE_ERROR,
            2.0,
        ),  # a normal force does no work
        ((1.0, 0.0), (1.0, 2.0), 0.0, Energy.BALANCE_ERROR, 1.0),  # friction gives none
    ],
)
def test_works_of_contacts(relative, force, impact, entry, expected):
    """Works by the mean of the relative velocities before and after a step."""
    state, work = placed(slide=-1.0)
    work.relative[0, :2] = work.earlier[0, :2] = relative
    work.reaction[0, :2] = force
    state.impact[0] = impact
    record_step(state, work, True)
    assert state.energy[entry] == pytest.approx(expected)
    assert np.abs(state.energy[:6]).sum() <= abs(expected) * (2.0 + 1e-9)
