"""A block that has slipped on its pedestal: which of the two bodies lends the vertex.

Where the joint is open Signorini's law splits (Eqs 23a and 23b): towards one side the block's
own corner stands on the pedestal, towards the other the pedestal's edge bears the block's face.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import archfrag as af
from archbench.paper.arch import cross
from tests.mechanics.linkages import rotate
from tests.validation.scenes import g

HALF, UP = 0.3, 0.6
GYRATION = (HALF**2 + UP**2) / 3.0
FRICTION, TILT, DURATION = 0.05, 0.25, 0.15


def leaning(shift):
    """Displacement of a block shifted, then rotated to the right about what it stands on."""
    pivot = np.array([min(HALF, HALF + shift), 0.0])
    centre = pivot + rotate(np.array([shift, UP]) - pivot, -TILT)
    return np.array([[centre[0], centre[1] - UP, -TILT]])


def slide(shift):
    """Times and displacements (3, n) of the block by its equations of motion; its slip rates."""
    corner, edge = np.array([HALF, -UP]), np.array([HALF, 0.0])

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
        moment, lever = cross(arm, reaction), cross(arm, normal)
        press = -unforced / (normal @ reaction + lever * moment / GYRATION)
        assert press > 0.0
        return [*state[3:], *(press * reaction - [0.0, g]), press * moment / GYRATION]

    start = np.append(leaning(shift)[0] + [0.0, UP, 0.0], np.zeros(3))
    time = np.linspace(0.0, DURATION, 50)[1:]
    for sense in (1.0, -1.0):
        found = solve_ivp(
            moving, (0.0, DURATION), start, args=(sense,), t_eval=time, rtol=1e-11, atol=1e-13
        )
        slips = np.array([slip_rate(s) for s in found.y.T])
        if (sense * slips > 0.0).all():
            return time, found.y[:3] - [[0.0], [UP], [0.0]], slips
    raise AssertionError("the contact sticks")


# To the left, so that the block's right corner is over the pedestal; and to the right.
@pytest.mark.parametrize("shift", [-0.1, 0.1])
def test_a_vertex_that_runs_over_the_other_bodys_face_obeys_the_equations_of_motion(shift):
    time, exact, slips = slide(shift)
    assert np.abs(slips[-1]) > 0.05
    block, start = af.Block(2.0 * HALF, 2.0 * UP, FRICTION), (leaning(shift), np.zeros((1, 3)))
    errors = []
    for dt in (2e-4, 1e-4):
        history = af.simulate(
            block, af.Motion(np.zeros(round(DURATION / dt) + 1), dt), method="time_stepping",
            dt=dt, initial=start, history=True, follow=0.0,
        ).history  # fmt: skip
        found = *history.displacement.values[:, 0].T, history.rotation.values[:, 0]
        moved = np.array([np.interp(time, history.time, each) for each in found])
        errors.append(np.abs(moved - exact).max())
    assert errors[1] < 3e-8
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
