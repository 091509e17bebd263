"""Signorini loss: when joints lose their contact, and when that cannot be undone.

A joint whose last contact has vanished is noted and the motion goes on, since bodies may land
again. A collapse is a loss that is not regained (METHOD of Sinopoli, section 3.5): the gap at both
corners has passed a limit, the faces no longer overlap, or a joint has turned by 90 degrees.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.kinematics import clearance, measure_slip
from archfrag.mechanics.laws import CLOSED_STICK, OPEN, STICK, is_closed, slip_of, touches
from archfrag.mechanics.status import CollapseMode

# Contact lost below this slip over joint length and this rotation [rad] is lift-off.
SMALL = 0.02
# A gap at both corners beyond this part of the joint's length is a loss of contact that counts;
# below it joints part and meet again many times as they rock.
NOTED_GAP = 0.02
RIGHT_ANGLE = 0.5 * np.pi
HINGING = int(CollapseMode.HINGING)
SLIDING = int(CollapseMode.SLIDING)
LIFT_OFF = int(CollapseMode.LIFT_OFF)
OVERTURNING = int(CollapseMode.OVERTURNING)
NO_MODE = int(CollapseMode.NONE)


class Loss(IntEnum):
    """Entries of ``JointState.loss``."""

    TIME = 0  # of the first loss of contact that counted [s]; nan if there was none
    JOINT = 1  # where; -1 if nowhere
    MODE = 2  # archfrag.mechanics.status.CollapseMode of that joint
    WIDEST = 3  # largest gap at both corners of a joint, over its length [1]


N_LOSS = len(Loss)


class JointState(NamedTuple):
    """What the joints remember from one instant to the next."""

    slip: np.ndarray  # (n_joint,) [m]
    mode: np.ndarray  # (n_joint,) int8: contact mode
    last_contact: np.ndarray  # (n_joint,) int8: last mode that was a contact
    lost_since: np.ndarray  # (n_joint,) when contact was lost last [s]; nan before
    lost_slip: np.ndarray  # (n_joint,) slip over length at that instant [1]
    lost_turn: np.ndarray  # (n_joint,) relative rotation at that instant [rad]
    loss: np.ndarray  # (len(Loss),)


@allocating
def new_loss():
    """No loss of contact yet, (len(Loss),)."""
    loss = np.zeros(N_LOSS)
    loss[Loss.TIME], loss[Loss.JOINT] = np.nan, -1.0
    return loss


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
        new_loss(),
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
def loss_mode(j, joints):
    """How joint `j` moved when it lost its contact: archfrag.mechanics.status.CollapseMode."""
    little = max(joints.lost_slip[j], joints.lost_turn[j]) < SMALL
    if is_closed(joints.last_contact[j]) and little:
        return LIFT_OFF
    return SLIDING if joints.lost_slip[j] > joints.lost_turn[j] else HINGING


@kernel
def smallest_gap(k, before, after):
    """Gap by which a joint without contact is open at both of its corners [m]."""
    return min(clearance(k, 0, before, after), clearance(k, 1, before, after))


@kernel
def note_gap(j, gap, joints):
    """Remember a gap, over the joint's length, at both corners of joint `j`."""
    loss = joints.loss
    loss[Loss.WIDEST] = max(loss[Loss.WIDEST], gap)
    if gap > NOTED_GAP and np.isnan(loss[Loss.TIME]):
        loss[Loss.TIME] = joints.lost_since[j]
        loss[Loss.JOINT] = j
        loss[Loss.MODE] = loss_mode(j, joints)


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
            first = clearance(j, 0, before, after)
            second = clearance(j, 1, before, after)
            joints.slip[j] = measure_slip(j, 1 if second < first else 0, before, after)
            note_gap(j, min(first, second) / length[j], joints)
        else:
            joints.last_contact[j] = mode[j]
            if slip_of(mode[j]) != STICK:
                joints.slip[j] = measure_slip(j, 0 if touches(mode[j], 0) else 1, before, after)
        joints.mode[j] = mode[j]


@kernel
def is_beyond_return(mode, gap, slip, turn, loss_limit):
    """Whether a joint cannot come to bear again.

    Parameters
    ----------
    mode : int
        Contact mode.
    gap, slip : float
        Gap at both corners, and slip, over the joint's length [1].
    turn : float
        Relative rotation [rad].
    loss_limit : float
        Gap of a joint without contact beyond which its loss is final [1].

    Returns
    -------
    bool
    """
    if abs(slip) >= 1.0 or abs(turn) >= RIGHT_ANGLE:
        return True
    return mode == OPEN and gap > loss_limit


@kernel
def collapse_of(position, before, after, length, joints, loss_limit, time):
    """The joint at which the chain has collapsed, if any.

    Parameters
    ----------
    position : ndarray, (n_body, 3)
    before, after : ndarray, (n_joint, 2, 2)
        Faces there.
    length : ndarray, (n_joint,) [m]
    joints : JointState
    loss_limit : float
        See `is_beyond_return`.
    time : float [s]

    Returns
    -------
    joint : int
        -1 if none.
    mode : int
        archfrag.mechanics.status.CollapseMode.
    since : float
        When its contact was lost last [s]; `time` where contact is kept.
    """
    found, how, since = -1, NO_MODE, np.nan
    for j in range(joints.mode.size):
        gap, slip = 0.0, joints.slip[j]
        if joints.mode[j] == OPEN:
            gap = smallest_gap(j, before, after) / length[j]
        slip /= length[j]
        turn = relative_turn(j, position)
        if is_beyond_return(joints.mode[j], gap, slip, turn, loss_limit):
            found, how, since = j, OVERTURNING, time
            if joints.mode[j] == OPEN:
                how, since = loss_mode(j, joints), joints.lost_since[j]
            elif abs(slip) >= 1.0:
                how = SLIDING
    return found, how, since


@kernel
def unregained_loss(position, before, after, length, joints, time):
    """The joint that is without contact where a run ends unfinished; as `collapse_of`."""
    return collapse_of(position, before, after, length, joints, NOTED_GAP, time)
