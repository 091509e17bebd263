"""Detect loss of contact at joints (Signorini), and decide when it is collapse.

A joint whose last contact has vanished is noted and the motion goes on, since bodies may land
again. A collapse is a loss that is not regained (METHOD of Sinopoli, section 3.5): the gap at both
corners has passed a limit, the faces no longer overlap, or a joint has rotated by 90 degrees.
"""

import math

from archfrag.physics.contact.laws import touching
from archfrag.physics.contact.placing import least_gap, slip_and_gap, turn_of
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import opposite, select, some
from archfrag.physics.numbers import flag, larger
from archfrag.physics.state import Clock
from archfrag.physics.status import CollapseMode, Loss

# Contact lost below this slip over joint length and this rotation [rad] is lift-off.
SMALL = 0.02
# A gap at both corners beyond this part of the joint's length is a loss of contact that counts;
# below it joints part and meet again many times as they rock.
NOTED_GAP = 0.02
RIGHT_ANGLE = 0.5 * math.pi


@inlined
def loss_mode(j, state):
    """Return the CollapseMode of joint j: how it moved when it lost contact."""
    slip = state.lost_slip[j]
    rotation = state.lost_rotation[j]
    little = (larger(slip, rotation) < SMALL) & (state.bore_face[j] > 0.5)
    slides = select(slip > rotation, CollapseMode.SLIDING, CollapseMode.HINGING)
    return select(little, CollapseMode.LIFT_OFF, slides)


@inlined
def record_gap(j, state, gap, where):
    """Record `gap`, the gap of joint `j` over its length [1], where `where` holds.

    The joint is open at both corners there. The first gap beyond `NOTED_GAP` sets time, joint and
    mode in ``state.loss``.
    """
    loss = state.loss
    loss[Loss.WIDEST] = select(
        where & (gap > loss[Loss.WIDEST]), gap, loss[Loss.WIDEST]
    )
    first = where & (gap > NOTED_GAP) & (loss[Loss.TIME] != loss[Loss.TIME])
    if some(first):
        loss[Loss.TIME] = select(first, state.lost_since[j], loss[Loss.TIME])
        loss[Loss.JOINT] = select(first, float(j), loss[Loss.JOINT])
        loss[Loss.MODE] = select(first, loss_mode(j, state), loss[Loss.MODE])


@kernel
def follow_joints(model, state, work, where, loss_limit):
    """Update modes, slips and losses of contact after a step; return where the chain collapsed.

    `work` has the modes of the step and the faces where it ends; `where` masks the runs that made
    it. A chain has collapsed if a joint without contact has a gap of more than `loss_limit` times
    its length, or if a joint has slid by its length or rotated by 90 degrees.

    Writes: state (bore_face, contact, loss, lost_rotation, lost_since, lost_slip, slide, slip).
    """
    time = state.clock[Clock.TIME]
    collapsed = False
    for j in range(state.slip.shape[0]):
        is_0, is_1 = touching(j, work)
        none = where & opposite(is_0 | is_1)
        slides = where & (work.slide[j] != 0.0)
        rotation = turn_of(j, model, state.position)
        if some(none | slides):
            unit = 1.0 / model.length[j]
            was_0, was_1 = touching(j, state)
            lost = none & (was_0 | was_1)
            by_slip = abs(state.slip[j]) * unit
            state.lost_since[j] = select(lost, time, state.lost_since[j])
            state.lost_slip[j] = select(lost, by_slip, state.lost_slip[j])
            turned = select(lost, abs(rotation), state.lost_rotation[j])
            state.lost_rotation[j] = turned
            slip, gap = slip_and_gap(j, is_0, is_1, work)
            state.slip[j] = select(none | slides, slip, state.slip[j])
            gap = gap * unit
            record_gap(j, state, gap, none)
            collapsed = collapsed | (none & (gap > loss_limit))
        collapsed = collapsed | (where & (abs(state.slip[j]) >= model.length[j]))
        collapsed = collapsed | (where & (abs(rotation) >= RIGHT_ANGLE))
        in_contact = where & (is_0 | is_1)
        state.bore_face[j] = select(in_contact, flag(is_0 & is_1), state.bore_face[j])
        state.contact[j, 0] = select(where, work.contact[j, 0], state.contact[j, 0])
        state.contact[j, 1] = select(where, work.contact[j, 1], state.contact[j, 1])
        state.slide[j] = select(where, work.slide[j], state.slide[j])
    return collapsed


@kernel
def collapse_of(model, state, work, loss_limit):
    """Find the joint that collapsed; return its number, CollapseMode, and time of the loss [s].

    If none did these are -1, NONE and nan; of several joints it is the last. `loss_limit` is that
    of `follow_joints`.
    """
    found = -1
    how = CollapseMode.NONE
    since = math.nan
    for j in range(state.slip.size):
        slip = abs(state.slip[j]) / model.length[j]
        rotation = turn_of(j, model, state.position)
        at_0, at_1 = touching(j, state)
        none = not (at_0 or at_1)
        lost = none and least_gap(j, work) / model.length[j] > loss_limit
        if slip >= 1.0 or abs(rotation) >= RIGHT_ANGLE or lost:
            found = j
            how = CollapseMode.OVERTURNING
            since = state.clock[Clock.TIME]
            if none:
                how = int(loss_mode(j, state))
                since = state.lost_since[j]
            elif slip >= 1.0:
                how = CollapseMode.SLIDING
    return found, how, since
