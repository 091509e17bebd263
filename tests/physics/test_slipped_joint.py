"""A block that has slipped on its pedestal: which of the two bodies lends the vertex.

Where the joint is open Signorini's law splits (Eqs 23a and 23b): towards one side the block's
own corner stands on the pedestal, towards the other the pedestal's edge bears the block's face.
Both are compared with equations of motion written for the two bodies' geometry.
"""

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import archfrag as af
from archbench.paper.arch import cross
from tests.mechanics.linkages import rotate
from tests.physics.audit import g

simulate = functools.partial(af.simulate, method="time_stepping")

HALF, UP = 0.3, 0.6
GYRATION = (HALF**2 + UP**2) / 3.0
# To the left, so that the block's right corner is over the pedestal; and to the right.
SHIFTS = [-0.1, 0.1]
FINE = {"rtol": 1e-11, "atol": 1e-13}


def pivots(shift):
    """Where a block shifted by `shift` touches when it leans to the right, and to the left."""
    return min(HALF, HALF + shift), max(-HALF, -HALF + shift)


def leaning(shift, tilt):
    """Displacement from rest of a block shifted, then rotated to the right by `tilt`, (1, 3)."""
    pivot = np.array([pivots(shift)[0], 0.0])
    centre = pivot + rotate(np.array([shift, UP]) - pivot, -tilt)
    return np.array([[centre[0], centre[1] - UP, -tilt]])


def moved(friction, shift, tilt, duration, dt):
    """History of such a block, let go at rest on ground that does not move."""
    block = af.Block(2.0 * HALF, 2.0 * UP, friction=friction)
    still = af.Motion(np.zeros(round(duration / dt) + 1), dt)
    start = leaning(shift, tilt), np.zeros((1, 3))
    return simulate(block, still, dt=dt, initial=start, history=True, follow=0.0).history


def slide(friction, shift, tilt, duration):
    """Motion of a leaning block whose contact slides, (n, 3) at so many equal times.

    Returns
    -------
    time : ndarray, (n,) [s]
    state : ndarray, (6, n)
        x, y, rotation and their rates.
    slip_rate : ndarray, (n,)
    """
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
        reaction = normal - sense * friction * np.array([normal[1], -normal[0]])
        moment, lever = cross(arm, reaction), cross(arm, normal)
        press = -unforced / (normal @ reaction + lever * moment / GYRATION)
        assert press > 0.0
        return [*state[3:], *(press * reaction - [0.0, g]), press * moment / GYRATION]

    x, y, rotation = leaning(shift, tilt)[0]
    start = np.array([x, y + UP, rotation, 0.0, 0.0, 0.0])
    for sense in (1.0, -1.0):
        found = solve_ivp(moving, (0.0, duration), start, args=(sense,), dense_output=True, **FINE)
        time = np.linspace(0.0, duration, 50)[1:]
        state = found.sol(time)
        slips = np.array([slip_rate(s) for s in state.T])
        if (sense * slips > 0.0).all():
            return time, state, slips
    raise AssertionError("the contact sticks")


class TestSliding:
    """The vertex runs over the other body's face."""

    @pytest.mark.parametrize("shift", SHIFTS)
    def test_equals_the_equations_of_motion(self, shift):
        friction, tilt, duration = 0.05, 0.25, 0.15
        time, state, slips = slide(friction, shift, tilt, duration)
        assert np.abs(slips[-1]) > 0.05
        errors = []
        for dt in (2e-4, 1e-4):
            history = moved(friction, shift, tilt, duration, dt)
            found = np.column_stack(
                [history.displacement.values[:, 0], history.rotation.values[:, 0]]
            )
            exact = state[:3] - np.array([[0.0], [UP], [0.0]])
            error = [np.interp(time, history.time, found[:, k]) - exact[k] for k in range(3)]
            errors.append(np.abs(error).max())
        assert errors[1] < 3e-8
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
