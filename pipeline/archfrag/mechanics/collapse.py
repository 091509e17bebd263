"""Signorini loss: when a joint has lost its contact for good, and how it was moving before."""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.kinematics import clearance, measure_slip
from archfrag.mechanics.laws import CLOSED_STICK, OPEN, STICK, is_closed, slip_of, touches
from archfrag.mechanics.status import CollapseMode

# Contact lost below this slip over joint length and this rotation [rad] is lift-off.
SMALL = 0.02
HINGING = int(CollapseMode.HINGING)
SLIDING = int(CollapseMode.SLIDING)
LIFT_OFF = int(CollapseMode.LIFT_OFF)
OVERTURNING = int(CollapseMode.OVERTURNING)
NO_MODE = int(CollapseMode.NONE)


class JointState(NamedTuple):
    """What the joints remember from one instant to the next."""

    slip: np.ndarray  # (n_joint,) [m]
    mode: np.ndarray  # (n_joint,) int8: contact mode
    last_contact: np.ndarray  # (n_joint,) int8: last mode that was a contact
    lost_since: np.ndarray  # (n_joint,) when contact was lost last [s]; nan before
    lost_slip: np.ndarray  # (n_joint,) slip over length at that instant [1]
    lost_turn: np.ndarray  # (n_joint,) relative rotation at that instant [rad]


@allocating
def new_joint_state(n_joint):
    """Joints that are closed and have never slipped.

    Parameters
    ----------
    n_joint : int

    Returns
    -------
    JointState
    """
    return JointState(
        np.zeros(n_joint),
        np.full(n_joint, CLOSED_STICK, np.int8),
        np.full(n_joint, CLOSED_STICK, np.int8),
        np.full(n_joint, np.nan),
        np.zeros(n_joint),
        np.zeros(n_joint),
    )


@kernel
def relative_turn(j, position):
    """Rotation of the body after joint `j` relative to the one before it [rad]."""
    turn = 0.0
    if j < position.shape[0]:
        turn += position[j, 2]
    if j > 0:
        turn -= position[j - 1, 2]
    return turn


@kernel
def note_loss(j, time, position, length, joints):
    """Remember the state in which joint `j` loses its contact."""
    joints.lost_since[j] = time
    joints.lost_slip[j] = abs(joints.slip[j]) / length[j]
    joints.lost_turn[j] = abs(relative_turn(j, position))


@kernel
def follow_joints(mode, position, before, after, length, time, joints):
    """Bring slips and what joints remember up to a state that a step has reached.

    Parameters
    ----------
    mode : ndarray, (n_joint,) int8
        Contact modes there; ``joints.mode`` still holds those before.
    position : ndarray, (n_body, 3)
    before, after : ndarray, (n_joint, 2, 2)
        Faces there.
    length : ndarray, (n_joint,) [m]
    time : float
        From when on `mode` has held [s].
    joints : JointState
    """
    for j in range(mode.size):
        if mode[j] == OPEN:
            if joints.mode[j] != OPEN:
                note_loss(j, time, position, length, joints)
            corner = 0
            if clearance(j, 1, before, after) < clearance(j, 0, before, after):
                corner = 1
            joints.slip[j] = measure_slip(j, corner, before, after)
        else:
            joints.last_contact[j] = mode[j]
            if slip_of(mode[j]) != STICK:
                joints.slip[j] = measure_slip(j, 0 if touches(mode[j], 0) else 1, before, after)
        joints.mode[j] = mode[j]


@kernel
def collapse_of(position, before, after, length, joints, loss_limit, time):
    """The joint at which the chain has collapsed, if any.

    A joint has lost its contact for good where both corners are open by more than `loss_limit`
    times its length, or where it has slid past its end; one turned by 90 degrees counts too.

    Parameters
    ----------
    position : ndarray, (n_body, 3)
    before, after : ndarray, (n_joint, 2, 2)
        Faces there.
    length : ndarray, (n_joint,) [m]
    joints : JointState
    loss_limit : float
    time : float [s]

    Returns
    -------
    joint : int
        -1 if none.
    mode : int
        archfrag.mechanics.status.CollapseMode.
    since : float
        When its contact was lost [s].
    """
    found, how, since = -1, NO_MODE, np.nan
    for j in range(joints.mode.size):
        if joints.mode[j] == OPEN:
            gap = min(clearance(j, 0, before, after), clearance(j, 1, before, after))
            if gap > loss_limit * length[j]:
                found, how, since = j, HINGING, joints.lost_since[j]
                if joints.lost_slip[j] > joints.lost_turn[j]:
                    how = SLIDING
                little = max(joints.lost_slip[j], joints.lost_turn[j]) < SMALL
                if is_closed(joints.last_contact[j]) and little:
                    how = LIFT_OFF
        elif abs(joints.slip[j]) >= length[j]:
            found, how, since = j, SLIDING, time
        if abs(relative_turn(j, position)) >= 0.5 * np.pi:
            found, how, since = j, OVERTURNING, time
    return found, how, since
