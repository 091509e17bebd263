"""A step of contact dynamics with two contacts at each joint, as general codes for bodies have it.

Shared by the two baselines on the velocity level, `gauss_seidel` and `quadratic_programme`: they
differ in how they solve a step, not in how they pose it. A closed joint has a contact at each of
its corners, each with a normal and a tangential impulse: four unknowns where three suffice.

The scheme is Moreau's with Jean's theta (Moreau 1988, CISM 302; Jean 1999, *Comput. Methods Appl.
Mech. Engrg.* 177). Contacts are looked for at the middle of the step, and Signorini's law holds on
velocities: a corner that touches there may not approach, one that is open by a gap g may close by
no more than g in a step (the inelastic quasi-shock law of Dubois and Jean). Impacts are inelastic.

What that gets wrong: velocities obey the law, positions only follow. Rotation in a step opens or
closes a touching corner by the square of its angle; an opening heals in the next step, an overlap
never does, and sticking vertices drift. Where two vertices meet, the contact has one normal,
halfway between those of the two faces.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.collapse import collapse_of, follow_joints, unregained_loss
from archfrag.mechanics.compile import allocating, inlined, kernel
from archfrag.mechanics.delassus import Contacts, ContactWork, contact_work, relative_velocity
from archfrag.mechanics.energy import contact_works, ground_work, potential_energy
from archfrag.mechanics.ground import cumulative_impulse, impulse_between
from archfrag.mechanics.kinematics import (
    COINCIDENT,
    empty_contacts,
    joint_lengths,
    move_faces,
    place_contacts,
)
from archfrag.mechanics.laws import MINUS, OPEN, PLUS, STICK, closed_mode, corner_mode
from archfrag.mechanics.ledger import (
    book_changes,
    book_motion,
    book_state,
    book_work,
    log_change,
    makes_contact,
    write_frame,
)
from archfrag.mechanics.residuals import measure_state
from archfrag.mechanics.status import Cause, CollapseMode, Count, Energy, Model, Status
from archfrag.mechanics.types import Outcome
from archfrag.methods.former_stepping import FRESH_STEPS
from archfrag.methods.rest import read_joints, rest_reactions
from archfrag.methods.stepping import Kick, free_fall

STANDING = int(Status.STANDING)
COLLAPSED = int(Status.COLLAPSED)
UNFINISHED = int(Status.UNFINISHED)
NOT_FINITE = int(Status.NOT_FINITE)
GO = -1
NO_MODE = int(CollapseMode.NONE)
AT_REST, ALL = int(Model.REST), int(Model.ALL_VOUSSOIRS)
BY_START, BY_REST = int(Cause.START), int(Cause.REST)

# What a contact does; the friction of FORWARD points along the tangent, that of BACKWARD against.
FREE, STICKING, FORWARD, BACKWARD = 0, 1, 2, 3

# The chain is at rest once the record is over and nothing has moved faster than STILL times
# sqrt(gravity x joint length) for this long [s]: nothing rests while it is shaken.
STILL = 1e-5
REST_SPAN = 0.25


class Clock(IntEnum):
    """Entries of ``Corners.clock``."""

    TIME = 0  # of positions and velocities [s]
    NEXT_FRAME = 1  # time from which on a frame of the history is due [s]
    START_POTENTIAL = 2  # [J]
    CALM_SINCE = 3  # from when on nothing has moved faster than STILL allows [s]
    RECORD_END = 4  # [s]


N_CLOCK = len(Clock)


class Corners(NamedTuple):
    """Room for the steps of a run; two contacts at each joint, one at each corner."""

    contacts: Contacts
    work: ContactWork  # velocities, reactions about the pivots and modes of the solved step
    before: np.ndarray  # (n_joint, 2, 2) faces
    after: np.ndarray
    length: np.ndarray  # (n_joint,) [m]
    middle: np.ndarray  # (n_body, 3) positions in the middle of the step
    free: np.ndarray  # (n_body, 3) velocities without reactions
    mean: np.ndarray  # (n_body, 3) velocities between those before and after the step
    mean_relative: np.ndarray  # (n_joint, 3) the same at the pivots
    normal: np.ndarray  # (n_joint, 2, 2) corner, xy
    lever: np.ndarray  # (n_joint, 2, 4) normal, tangential on body after; on body before [m]
    gap: np.ndarray  # (n_joint, 2) in the middle of the step; negative: overlap [m]
    bias: np.ndarray  # (n_joint, 2) gap that may close, over the step [m/s]
    impulse: np.ndarray  # (n_joint, 2, 2) corner; normal, tangential on the body after [N s]
    state: np.ndarray  # (n_joint, 2) int8: FREE, STICKING, FORWARD or BACKWARD
    fresh: np.ndarray  # (n_joint,) int64: steps for which a new contact counts as an impact
    impulse_x: np.ndarray  # (n_sample,) of the ground up to each sample [m/s]
    impulse_y: np.ndarray
    clock: np.ndarray  # (len(Clock),)


@allocating
def new_corners(chain, ground, position):
    """Room for the steps of a run.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    position : ndarray, (n_body, 3)
        Initial.

    Returns
    -------
    Corners
        Without impulses; faces are those of `position`.
    """
    n_body, n_joint = chain.mass.size, chain.friction.size
    corners = Corners(
        empty_contacts(n_body, n_joint),
        contact_work(n_body, n_joint),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        joint_lengths(chain),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_joint, 3)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 4)),
        np.zeros((n_joint, 2)),
        np.zeros((n_joint, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2), np.int8),
        np.zeros(n_joint, np.int64),
        cumulative_impulse(ground.horizontal, ground.time_step),
        cumulative_impulse(ground.vertical, ground.time_step),
        np.zeros(N_CLOCK),
    )
    corners.clock[Clock.START_POTENTIAL] = potential_energy(chain.mass, chain.gravity, position)
    corners.clock[Clock.RECORD_END] = (ground.horizontal.size - 1) * ground.time_step
    move_faces(chain, position, corners.before, corners.after)
    return corners


@allocating
def begin(
    chain, ground, corners, joints, ledger, frames, log, options, position, velocity, from_rest
):  # fmt: skip
    """Book the initial state of a run.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    corners : Corners
    joints : archfrag.mechanics.collapse.JointState
    ledger, frames, log, options
    position, velocity : ndarray, (n_body, 3)
    from_rest : bool
        Whether the chain is at rest in its own geometry.
    """
    clock = corners.clock
    if not from_rest:
        read_joints(chain, corners, joints, position)
    book_state(chain, position, velocity, clock[Clock.START_POTENTIAL], ledger)
    # A chain that has never moved rests.
    clock[Clock.CALM_SINCE] = -REST_SPAN if from_rest else 0.0
    log_change(log, ledger, 0.0, BY_START, -1, ALL, joints.mode)
    if from_rest and frames.time.size > 0:
        rest_reactions(chain, ground, corners, joints, position, 0.0)
        write_frame(
            frames, ledger, 0.0, chain, position, velocity, corners.work.reaction, joints.mode,
            1.0,
        )  # fmt: skip
        clock[Clock.NEXT_FRAME] = options.frame_interval - 0.5 * options.time_step


@inlined
def _place_corner(j, corner, n_body, corners, unslipped, step):
    """Normal, lever arms, gap and bias of one contact."""
    contacts = corners.contacts
    normal = contacts.normal[j] if unslipped else contacts.normal_plus[j, corner]
    nx, ny = normal[0], normal[1]
    before, after = corners.before[j, corner], corners.after[j, corner]
    corners.normal[j, corner, 0], corners.normal[j, corner, 1] = nx, ny
    gap = nx * (after[0] - before[0]) + ny * (after[1] - before[1])
    bias = max(gap, 0.0) / step
    corners.gap[j, corner], corners.bias[j, corner] = gap, bias
    contacts.bias[j, corner, 0], contacts.bias[j, corner, 1] = bias * nx, bias * ny
    lever = corners.lever[j, corner]
    lever[:] = 0.0
    for side in range(2):
        body = j - side
        if 0 <= body < n_body:
            px = contacts.point[j, corner, 0] - contacts.centroid[body, 0]
            py = contacts.point[j, corner, 1] - contacts.centroid[body, 1]
            lever[2 * side] = px * ny - py * nx
            lever[2 * side + 1] = px * nx + py * ny


@kernel
def pose_step(chain, ground, corners, joints, position, velocity, step, theta):
    """Contacts in the middle of a step, and the velocities that bodies without them would reach.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    corners : Corners
        Overwritten.
    joints : archfrag.mechanics.collapse.JointState
    position, velocity : ndarray, (n_body, 3)
        Before the step.
    step : float [s]
    theta : float
        Weight of the velocities after the step in the change of position.

    Returns
    -------
    archfrag.methods.stepping.Kick
    """
    contacts, middle, n_body = corners.contacts, corners.middle, position.shape[0]
    for i in range(n_body):
        for k in range(3):
            middle[i, k] = position[i, k] + (1.0 - theta) * step * velocity[i, k]
    move_faces(chain, middle, corners.before, corners.after)
    place_contacts(middle, corners.before, corners.after, joints.slip, corners.length, contacts)
    pivot = corners.work.pivot
    for j in range(joints.slip.size):
        unslipped = abs(joints.slip[j]) <= COINCIDENT * corners.length[j]
        for corner in range(2):
            _place_corner(j, corner, n_body, corners, unslipped, step)
            for k in range(2):
                contacts.normal_plus[j, corner, k] = corners.normal[j, corner, k]
                contacts.normal_minus[j, corner, k] = corners.normal[j, corner, k]
        for k in range(2):
            pivot[j, k] = 0.5 * (contacts.point[j, 0, k] + contacts.point[j, 1, k])
    time, sampling = corners.clock[Clock.TIME], ground.time_step
    kick = Kick(
        impulse_between(time, time + step, ground.horizontal, corners.impulse_x, sampling),
        impulse_between(time, time + step, ground.vertical, corners.impulse_y, sampling),
        step,
    )
    free_fall(velocity, kick, chain.gravity, corners.free)
    return kick


@inlined
def corner_velocity(j, corner, corners, velocity):
    """Relative velocity of the faces at a contact: normal (positive: parting), tangential."""
    nx, ny = corners.normal[j, corner, 0], corners.normal[j, corner, 1]
    lever = corners.lever[j, corner]
    normal = tangential = 0.0
    if j < velocity.shape[0]:
        vx, vy, w = velocity[j, 0], velocity[j, 1], velocity[j, 2]
        normal += nx * vx + ny * vy + lever[0] * w
        tangential += nx * vy - ny * vx + lever[1] * w
    if j > 0:
        vx, vy, w = velocity[j - 1, 0], velocity[j - 1, 1], velocity[j - 1, 2]
        normal -= nx * vx + ny * vy + lever[2] * w
        tangential -= nx * vy - ny * vx + lever[3] * w
    return normal, tangential


@inlined
def push_corner(j, corner, chain, corners, normal, tangential, velocity):
    """Change the velocities of the two bodies at a contact by an impulse [N s]."""
    nx, ny = corners.normal[j, corner, 0], corners.normal[j, corner, 1]
    lever = corners.lever[j, corner]
    fx, fy = normal * nx - tangential * ny, normal * ny + tangential * nx
    if j < velocity.shape[0]:
        velocity[j, 0] += fx / chain.mass[j]
        velocity[j, 1] += fy / chain.mass[j]
        velocity[j, 2] += (lever[0] * normal + lever[1] * tangential) / chain.inertia[j]
    if j > 0:
        i = j - 1
        velocity[i, 0] -= fx / chain.mass[i]
        velocity[i, 1] -= fy / chain.mass[i]
        velocity[i, 2] -= (lever[2] * normal + lever[3] * tangential) / chain.inertia[i]


@inlined
def _slip_of_state(state):
    if state == FORWARD:
        return PLUS
    return MINUS if state == BACKWARD else STICK


@kernel
def gather_joints(corners):
    """Reactions about the pivots and contact modes from the impulses of a solved step.

    A joint is closed where both corners press, and slides where all that press slide alike.
    """
    contacts, work = corners.contacts, corners.work
    for j in range(work.mode.size):
        reaction = work.reaction[j]
        reaction[:] = 0.0
        for corner in range(2):
            nx, ny = corners.normal[j, corner, 0], corners.normal[j, corner, 1]
            normal, tangential = corners.impulse[j, corner, 0], corners.impulse[j, corner, 1]
            fx, fy = normal * nx - tangential * ny, normal * ny + tangential * nx
            px = contacts.point[j, corner, 0] - work.pivot[j, 0]
            py = contacts.point[j, corner, 1] - work.pivot[j, 1]
            reaction[0] += fx
            reaction[1] += fy
            reaction[2] += px * fy - py * fx
        first, second = corners.state[j, 0], corners.state[j, 1]
        if first != FREE and second != FREE:
            work.mode[j] = closed_mode(_slip_of_state(first) if first == second else STICK)
        elif first != FREE:
            work.mode[j] = corner_mode(0, _slip_of_state(first))
        elif second != FREE:
            work.mode[j] = corner_mode(1, _slip_of_state(second))
        else:
            work.mode[j] = OPEN


@allocating
def _measure_state(chain, corners, joints, ledger, position, velocity, step):
    """Note how far the state that a step has reached is from the contact laws."""
    measure_state(
        chain, position, velocity, corners.before, corners.after, corners.length, joints.slip,
        corners.work.reaction, corners.work.pivot, step, corners.contacts,
        corners.work.relative, ledger.peak,
    )  # fmt: skip


@inlined
def _book_step(chain, corners, joints, ledger, kick, velocity, step, theta):
    """Works of a step; `velocity` is still that before it."""
    work, mean, fresh = corners.work, corners.mean, corners.fresh
    rise = 0.0
    for i in range(velocity.shape[0]):
        for k in range(3):
            mean[i, k] = 0.5 * (velocity[i, k] + work.velocity[i, k])
        rise += chain.mass[i] * (work.velocity[i, 1] - velocity[i, 1])
    relative_velocity(corners.contacts, mean, work.pivot, corners.mean_relative)
    ledger.energy[Energy.GROUND] += ground_work(chain.mass, kick.x, kick.y, mean)
    for j in range(fresh.size):
        if makes_contact(joints.mode[j], work.mode[j]):
            fresh[j] = FRESH_STEPS
    friction, impact, stray = contact_works(
        corners.contacts, work, corners.mean_relative, joints.mode, fresh
    )
    for j in range(fresh.size):
        fresh[j] = max(fresh[j] - 1, 0)
    # With theta other than 1/2 bodies rise by more than gravity has taken account of.
    stray += chain.gravity * step * (theta - 0.5) * rise
    book_work(friction, impact, stray, ledger)


@allocating
def accept_step(
    chain, corners, joints, ledger, frames, log, options, position, velocity, kick, step, theta,
    converged,
):  # fmt: skip
    """Move the bodies by a solved step and book it.

    Reactions are means over the step, so a frame belongs to its middle: mean positions and
    velocities.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    corners : Corners
        As `gather_joints` leaves it, with the new velocities in ``work.velocity``.
    joints, ledger, frames, log, options
    position, velocity : ndarray, (n_body, 3)
        Those before the step; overwritten.
    kick : archfrag.methods.stepping.Kick
    step : float [s]
    theta : float
    converged : bool
        A step that is not has its residual measured, others now and then.

    Returns
    -------
    int
        GO, or how the run ended: COLLAPSED, STANDING, NOT_FINITE.
    """
    work, clock = corners.work, corners.clock
    _book_step(chain, corners, joints, ledger, kick, velocity, step, theta)
    for i in range(position.shape[0]):
        for k in range(3):
            gained = theta * work.velocity[i, k] + (1.0 - theta) * velocity[i, k]
            corners.middle[i, k] = position[i, k] + 0.5 * step * gained
            position[i, k] += step * gained
            velocity[i, k] = work.velocity[i, k]
    move_faces(chain, position, corners.before, corners.after)
    cause, joint = book_changes(joints.mode, work.mode, ledger)
    start = clock[Clock.TIME]
    follow_joints(
        work.mode, position, corners.before, corners.after, corners.length, start, joints
    )
    clock[Clock.TIME] += step
    time = clock[Clock.TIME]
    ledger.model_time[ALL] += step
    if cause >= 0:
        log_change(log, ledger, time, cause, joint, ALL, joints.mode)
    fastest = book_motion(chain, position, velocity, corners.length[0], ledger)
    if np.isnan(fastest):
        return NOT_FINITE
    fallen = _collapse(corners, joints, position, options)[0] >= 0
    middle = time - 0.5 * step
    if frames.time.size > 0 and (fallen or middle >= clock[Clock.NEXT_FRAME]):
        write_frame(
            frames, ledger, middle, chain, corners.middle, corners.mean, work.reaction,
            joints.mode, step,
        )  # fmt: skip
        clock[Clock.NEXT_FRAME] = middle + options.frame_interval - 0.5 * options.time_step
    if not converged or ledger.count[Count.STEPS] % options.check_interval == 0:
        _measure_state(chain, corners, joints, ledger, position, velocity, step)
    if fallen:
        return COLLAPSED
    if fastest >= STILL * np.sqrt(chain.gravity * np.max(corners.length)):
        clock[Clock.CALM_SINCE] = time
    if time < clock[Clock.RECORD_END] or time - clock[Clock.CALM_SINCE] < REST_SPAN:
        return GO
    ledger.count[Count.RESTS] += 1
    log_change(log, ledger, time, BY_REST, -1, AT_REST, joints.mode)
    return STANDING


@kernel
def _collapse(corners, joints, position, options):
    return collapse_of(
        position, corners.before, corners.after, corners.length, joints,
        options.loss_limit, corners.clock[Clock.TIME],
    )  # fmt: skip


@allocating
def finish(chain, corners, joints, ledger, options, position, velocity, status):
    """Close the account of a run.

    Returns
    -------
    archfrag.mechanics.types.Outcome
    """
    start, time = corners.clock[Clock.START_POTENTIAL], corners.clock[Clock.TIME]
    book_state(chain, position, velocity, start, ledger)
    joint, mode, since = -1, NO_MODE, np.nan
    if status == COLLAPSED:
        joint, mode, since = _collapse(corners, joints, position, options)
    elif status == UNFINISHED:
        joint, mode, since = unregained_loss(
            position, corners.before, corners.after, corners.length, joints, time
        )
        if joint >= 0:
            status = COLLAPSED
    return Outcome(status, time, since, joint, mode, joints.loss, ledger)
