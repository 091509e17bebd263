"""One step of Moreau-Jean time stepping: its room, its contact problem and what it moves."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import allocating, inlined
from archfrag.mechanics.delassus import Contacts, ContactWork, contact_work, relative_velocity
from archfrag.mechanics.energy import ground_work, potential_energy
from archfrag.mechanics.former_contact import newton_contact
from archfrag.mechanics.ground import cumulative_impulse, impulse_between
from archfrag.mechanics.kinematics import (
    corner_offset,
    empty_contacts,
    joint_lengths,
    move_faces,
    place_contacts,
)

# A corner takes part in a step if its gap could close within it at this many times the largest
# relative velocity of any joint: an impact elsewhere may throw it shut. Both corners of a joint
# get one normal if both could close at this many times their own.
REACH = 5.0
# Overlap is mended no faster than at the joint's own relative speed plus what gravity and this
# many times rotation do in a step: mending a deep one at once would throw the bodies apart.
SWING = 4.0
# Gaps of this size, relative to the coordinates, are rounding. A closed ring is overdetermined:
# it would answer them with reactions of any size.
ROUNDING = 64 * 2.2e-16


class Clock(IntEnum):
    """Entries of ``Stepper.clock``."""

    NEXT_FRAME = 0  # time from which on a frame of the history is due [s]
    START_POTENTIAL = 1  # potential energy at the beginning of the run [J]
    TIME = 2  # of the positions [s]
    PREVIOUS = 3  # size of the last step; velocities lie half of it back [s]
    STEP = 4  # size of the next step [s]
    CALM = 5  # steps since a contact mode changed last
    STILL = 6  # speed below which the chain may be at rest [m/s]
    FASTEST = 7  # largest speed of any body, rotation times joint length included [m/s]
    SPAN = 8  # for which the reactions of the last step act [s]


N_CLOCK = len(Clock)


class Stepper(NamedTuple):
    """Room for time stepping, and what of a run does not change."""

    work: ContactWork
    contacts: Contacts
    before: np.ndarray  # (n_joint, 2, 2) faces now
    after: np.ndarray
    next_before: np.ndarray  # (n_joint, 2, 2) and where the present velocities take them
    next_after: np.ndarray
    length: np.ndarray  # (n_joint,) [m]
    rounding: float  # gaps smaller than this are none [m]
    free: np.ndarray  # (n_body, 3) velocities without reactions
    trial: np.ndarray  # (n_body, 3) positions that the present velocities reach
    mean: np.ndarray  # (n_body, 3) velocities between those before and after the step
    mean_relative: np.ndarray  # (n_joint, 3) the same at the pivots
    moved: np.ndarray  # (n_joint, 3) relative velocities at the pivots before the step
    fresh: np.ndarray  # (n_joint,) int64: steps for which a new contact counts as an impact
    impulse_x: np.ndarray  # (n_sample,) of the ground up to each sample [m/s]
    impulse_y: np.ndarray
    rest: np.ndarray  # (2,) rest range where the chain came to rest last
    clock: np.ndarray  # (len(Clock),)


class Kick(NamedTuple):
    """What a step takes from the velocities of free bodies."""

    x: float  # integral of the ground acceleration [m/s]
    y: float
    span: float  # for which gravity acts [s]


@allocating
def new_stepper(chain, ground, position):
    """Room for stepping a chain through a ground motion from an initial position.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    position : ndarray, (n_body, 3)

    Returns
    -------
    Stepper
    """
    n_body, n_joint = chain.mass.size, chain.friction.size
    stepper = Stepper(
        contact_work(n_body, n_joint),
        empty_contacts(n_body, n_joint),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        joint_lengths(chain),
        ROUNDING * np.max(np.abs(chain.centroid)),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_joint, 3)),
        np.zeros((n_joint, 3)),
        np.zeros(n_joint, np.int64),
        cumulative_impulse(ground.horizontal, ground.time_step),
        cumulative_impulse(ground.vertical, ground.time_step),
        np.zeros(2),
        np.zeros(N_CLOCK),
    )
    stepper.clock[Clock.START_POTENTIAL] = potential_energy(chain.mass, chain.gravity, position)
    return stepper


@inlined
def kick_between(ground, stepper, start, end):
    """What ground motion and gravity take from the velocities between two instants [s].

    Returns
    -------
    Kick
    """
    sampling = ground.time_step
    return Kick(
        impulse_between(start, end, ground.horizontal, stepper.impulse_x, sampling),
        impulse_between(start, end, ground.vertical, stepper.impulse_y, sampling),
        end - start,
    )


@inlined
def free_fall(velocity, kick, gravity, free):
    """Velocities without reactions, (n_body, 3), into `free`."""
    fall = kick.y + kick.span * gravity
    for i in range(velocity.shape[0]):
        free[i, 0] = velocity[i, 0] - kick.x
        free[i, 1] = velocity[i, 1] - fall
        free[i, 2] = velocity[i, 2]


@inlined
def _speed_at(j, corner, stepper):
    """Relative velocity of the two faces at a corner before the step."""
    point, pivot, moved = stepper.contacts.point, stepper.work.pivot, stepper.moved
    ux = moved[j, 0] - moved[j, 2] * (point[j, corner, 1] - pivot[j, 1])
    uy = moved[j, 1] + moved[j, 2] * (point[j, corner, 0] - pivot[j, 0])
    return ux, uy


@inlined
def _largest_turn(j, velocity):
    """Larger angular velocity of the two bodies at a joint [rad/s]."""
    turn = 0.0
    if j < velocity.shape[0]:
        turn = abs(velocity[j, 2])
    if j > 0:
        turn = max(turn, abs(velocity[j - 1, 2]))
    return turn


@inlined
def _limited_bias(bx, by, nx, ny, limit):
    """Bias that mends overlap, and slip, no faster than at a limit [m/s]."""
    inward = -limit - (nx * bx + ny * by)
    if inward > 0.0:
        bx += inward * nx
        by += inward * ny
    along = nx * by - ny * bx
    excess = along - min(max(along, -limit), limit)
    return bx + excess * ny, by - excess * nx


@inlined
def aim_contacts(velocity, slip, step, gravity, stepper):
    """Bias that makes the contact laws hold at the positions which a step reaches.

    Parameters
    ----------
    velocity : ndarray, (n_body, 3)
        Before the step.
    slip : ndarray, (n_joint,) [m]
    step : float [s]
    gravity : float [m/s2]
    stepper : Stepper
        With the contacts where they are now, and the faces where `velocity` would take them.
        The contacts' bias and candidates are overwritten, and the normals of joints that both
        corners may close in this step by themselves.
    """
    contacts, pivot = stepper.contacts, stepper.work.pivot
    n_joint = slip.size
    for j in range(n_joint):
        pivot[j, 0] = 0.5 * (contacts.point[j, 0, 0] + contacts.point[j, 1, 0])
        pivot[j, 1] = 0.5 * (contacts.point[j, 0, 1] + contacts.point[j, 1, 1])
    relative_velocity(contacts, velocity, pivot, stepper.moved)
    fastest = 0.0
    for j in range(n_joint):
        for c in range(2):
            ux, uy = _speed_at(j, c, stepper)
            fastest = max(fastest, abs(ux) + abs(uy))
    reach = REACH * step * (fastest + gravity * step)
    for j in range(n_joint):
        nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
        turn = _largest_turn(j, velocity)
        slow = step * (gravity + SWING * turn * turn * stepper.length[j])
        closing = True
        for c in range(2):
            ex, ey = corner_offset(j, c, stepper.next_before, stepper.next_after, slip)
            if abs(ex) + abs(ey) < stepper.rounding:
                ex = ey = 0.0
            ux, uy = _speed_at(j, c, stepper)
            own = abs(ux) + abs(uy)
            bx, by = _limited_bias(ex / step - ux, ey / step - uy, nx, ny, slow + own)
            contacts.bias[j, c, 0] = bx
            contacts.bias[j, c, 1] = by
            gap = nx * ex + ny * ey
            contacts.candidate[j, c] = gap < reach
            closing = closing and gap < REACH * step * (own + gravity * step)
        if closing:
            for c in range(2):
                contacts.normal_plus[j, c, 0] = contacts.normal_minus[j, c, 0] = nx
                contacts.normal_plus[j, c, 1] = contacts.normal_minus[j, c, 1] = ny


@inlined
def try_step(chain, stepper, joints, position, velocity, kick, step):
    """Pose the contact problem of a step and solve it by the Newton iteration.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    stepper : Stepper
        Its faces are those of `position`; the solution is left in ``stepper.work``.
    joints : archfrag.mechanics.collapse.JointState
    position, velocity : ndarray, (n_body, 3)
        Before the step.
    kick : Kick
    step : float [s]

    Returns
    -------
    status, iterations : int
        As `newton_contact`.
    """
    contacts, trial = stepper.contacts, stepper.trial
    free_fall(velocity, kick, chain.gravity, stepper.free)
    for i in range(position.shape[0]):
        for k in range(3):
            trial[i, k] = position[i, k] + step * velocity[i, k]
    place_contacts(position, stepper.before, stepper.after, joints.slip, stepper.length, contacts)
    move_faces(chain, trial, stepper.next_before, stepper.next_after)
    aim_contacts(velocity, joints.slip, step, chain.gravity, stepper)
    return newton_contact(
        chain.mass, chain.inertia, contacts, chain.friction, stepper.free, stepper.work
    )


@inlined
def take_velocities(chain, stepper, velocity, kick):
    """Take the solved velocities over; returns the work of the ground [J]."""
    work, mean = stepper.work, stepper.mean
    for i in range(velocity.shape[0]):
        for k in range(3):
            mean[i, k] = 0.5 * (velocity[i, k] + work.velocity[i, k])
            velocity[i, k] = work.velocity[i, k]
    relative_velocity(stepper.contacts, mean, work.pivot, stepper.mean_relative)
    return ground_work(chain.mass, kick.x, kick.y, mean)


@inlined
def velocity_at_position(stepper, velocity, previous, step, out):
    """Velocities at the instant of the positions from which a solved step sets out.

    Those before and after lie half a step from it on either side.

    Parameters
    ----------
    stepper : Stepper
        With the solution in ``stepper.work``.
    velocity : ndarray, (n_body, 3)
        Before the step.
    previous, step : float
        Size of the step before (zero where velocities already are at that instant) and of this
        one [s].
    out : ndarray, (n_body, 3)
        Overwritten.
    """
    later = previous / (previous + step)
    for i in range(velocity.shape[0]):
        for k in range(3):
            change = stepper.work.velocity[i, k] - velocity[i, k]
            out[i, k] = velocity[i, k] + later * change


@inlined
def finish_step(chain, stepper, position, velocity, kick, step):
    """Take the solved velocities over and move the bodies; returns the work of the ground [J].

    Arguments as `try_step`; the faces in `stepper` are moved, too.
    """
    given = take_velocities(chain, stepper, velocity, kick)
    for i in range(position.shape[0]):
        for k in range(3):
            position[i, k] += step * velocity[i, k]
    move_faces(chain, position, stepper.before, stepper.after)
    return given


@inlined
def change_of_step(chain, stepper, velocity, kick, step, previous):
    """Work that weight and height, weighed apart, leave where the step changes [J].

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    stepper : Stepper
        With the velocities without reactions that `kick` gave.
    velocity : ndarray, (n_body, 3)
        After the step.
    kick : Kick
    step, previous : float
        Size of this step, zero where velocities are only brought to the time of positions,
        and of the one before [s].
    """
    if step == previous:
        return 0.0
    fall = kick.y + kick.span * chain.gravity
    work = 0.0
    for i in range(chain.mass.size):
        change = velocity[i, 1] - (stepper.free[i, 1] + fall)
        work += 0.25 * chain.gravity * chain.mass[i] * (step - previous) * change
    return work
