"""Moreau-Jean time stepping on all voussoirs, with large rotations.

Forces and contact directions are taken at the middle of the step, where Moreau's scheme looks
for contacts (Moreau 1988, 1999; Jean 1999), and Signorini's law is imposed on the position that
the step reaches, as Paoli and Schatzman do (2002, *SIAM J. Numer. Anal.* 40(2)): with no
restitution a contact neither drifts nor penetrates. Between impacts this is the Stoermer-Verlet
method with constraints, of second order and without numerical damping; an impact is caught
within its step.

While the body force stays inside the rest range of the configuration nothing is integrated.
`advance` moves a chain over a part of the motion and leaves positions and velocities at one
instant, so that other methods can hand over to it and take back.
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.collapse import collapse_of, new_joint_state, note_loss
from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.contact import newton_contact, path_contact
from archfrag.mechanics.delassus import (
    Contacts,
    ContactWork,
    contact_work,
    relative_velocity,
    velocity_scale,
)
from archfrag.mechanics.energy import (
    contact_works,
    ground_work,
    kinetic_energy,
    potential_energy,
)
from archfrag.mechanics.ground import (
    acceleration_at,
    cumulative_impulse,
    end_of_rest,
    impulse_between,
    rest_margin,
)
from archfrag.mechanics.kinematics import (
    clearance,
    corner_offset,
    empty_contacts,
    joint_lengths,
    measure_slip,
    move_faces,
    place_contacts,
)
from archfrag.mechanics.laws import OPEN, STICK, is_closed, slip_of, touches
from archfrag.mechanics.ledger import close_account, log_change, new_ledger, write_frame
from archfrag.mechanics.onset import rest_limit
from archfrag.mechanics.residuals import contact_residual
from archfrag.mechanics.status import Cause, CollapseMode, Count, Energy, Model, Peak, Status
from archfrag.mechanics.types import Outcome

STANDING = int(Status.STANDING)
COLLAPSED = int(Status.COLLAPSED)
UNFINISHED = int(Status.UNFINISHED)
NO_SOLUTION = int(Status.NO_CONTACT_SOLUTION)
NOT_FINITE = int(Status.NOT_FINITE)
WORK_BOUND = int(Status.WORK_BOUND)
NO_MODE = int(CollapseMode.NONE)
AT_REST, ALL = int(Model.REST), int(Model.ALL_VOUSSOIRS)
BY_START, BY_HINGE, BY_SLIDE = int(Cause.START), int(Cause.HINGE), int(Cause.SLIDE)
BY_STICK, BY_IMPACT, BY_LOSS = int(Cause.STICK), int(Cause.IMPACT), int(Cause.LOSS)
BY_REST = int(Cause.REST)

STILL = 1e-7
CLOSED_GAP = 1e-7
FRESH_STEPS = 2
# A corner takes part in a step if its gap could close within it at this many times the largest
# relative velocity of any joint: an impact elsewhere may throw it shut. Both corners of a joint
# get one normal if both could close at this many times their own.
REACH = 5.0
# Overlap is mended no faster than at the joint's own relative speed plus what gravity and this
# many times rotation do in a step: mending a deep one at once would throw the bodies apart.
SWING = 4.0
# A step whose contact problem is not solved is halved, down to this part of the nominal one.
SHORTEST = 1.0 / 100.0
# Gaps of this size, relative to the coordinates, are rounding. A closed ring is overdetermined:
# it would answer them with reactions of any size.
ROUNDING = 64 * 2.2e-16


class Stepper(NamedTuple):
    """Room for time stepping, and what of a run does not change."""

    work: ContactWork
    contacts: Contacts
    before: np.ndarray  # (n_joint, 2, 2) faces now
    after: np.ndarray
    next_before: np.ndarray  # (n_joint, 2, 2) and where the present velocities take them
    next_after: np.ndarray
    length: np.ndarray  # (n_joint,)
    free: np.ndarray  # (n_body, 3)
    trial: np.ndarray  # (n_body, 3)
    mean: np.ndarray  # (n_body, 3)
    mean_relative: np.ndarray  # (n_joint, 3)
    moved: np.ndarray  # (n_joint, 3)
    fresh: np.ndarray  # (n_joint,) int64: steps for which a new contact counts as an impact
    impulse_x: np.ndarray  # (n_sample,) of the ground up to each sample [m/s]
    impulse_y: np.ndarray
    rest: np.ndarray  # (2,) rest range where the chain came to rest last
    clock: np.ndarray  # (2,) time of the next frame [s]; potential energy at the beginning [J]


@allocating
def new_stepper(chain, ground, position):
    """Room for stepping a chain through a ground motion from an initial position."""
    n_body, n_joint = chain.mass.size, chain.friction.size
    stepper = Stepper(
        contact_work(n_body, n_joint),
        empty_contacts(n_body, n_joint),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        joint_lengths(chain),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_joint, 3)),
        np.zeros((n_joint, 3)),
        np.zeros(n_joint, np.int64),
        cumulative_impulse(ground.horizontal, ground.time_step),
        cumulative_impulse(ground.vertical, ground.time_step),
        np.zeros(2),
        np.zeros(2),
    )
    stepper.clock[1] = potential_energy(chain.mass, chain.gravity, position)
    return stepper


@kernel
def aim_contacts(
    velocity,
    slip,
    length,
    next_before,
    next_after,
    step,
    gravity,
    rounding,
    moved,
    contacts,
    work,
):
    """Bias that makes the contact laws hold at the positions which a step reaches.

    Parameters
    ----------
    velocity : ndarray, (n_body, 3)
        Before the step.
    slip, length : ndarray, (n_joint,) [m]
    next_before, next_after : ndarray, (n_joint, 2, 2)
        Faces where `velocity` would take them.
    step : float [s]
    gravity : float [m/s2]
    rounding : float [m]
        Gaps smaller than this are none.
    moved : ndarray, (n_joint, 3)
        Overwritten: relative velocity at the pivots before the step.
    contacts : Contacts
        `bias` and `candidate` are overwritten, and the normals of joints that both corners
        may close in this step.
    work : ContactWork
        `pivot` is overwritten.
    """
    n_joint = slip.size
    for j in range(n_joint):
        work.pivot[j, 0] = 0.5 * (contacts.point[j, 0, 0] + contacts.point[j, 1, 0])
        work.pivot[j, 1] = 0.5 * (contacts.point[j, 0, 1] + contacts.point[j, 1, 1])
    relative_velocity(contacts, velocity, work.pivot, moved)
    n_body = velocity.shape[0]
    fastest = 0.0
    for j in range(n_joint):
        for c in range(2):
            ux = moved[j, 0] - moved[j, 2] * (contacts.point[j, c, 1] - work.pivot[j, 1])
            uy = moved[j, 1] + moved[j, 2] * (contacts.point[j, c, 0] - work.pivot[j, 0])
            fastest = max(fastest, abs(ux) + abs(uy))
    for j in range(n_joint):
        closing = True
        turning = 0.0
        if j < n_body:
            turning = abs(velocity[j, 2])
        if j > 0:
            turning = max(turning, abs(velocity[j - 1, 2]))
        slow = step * (gravity + SWING * turning * turning * length[j])
        for c in range(2):
            ex, ey = corner_offset(j, c, next_before, next_after, slip)
            if abs(ex) + abs(ey) < rounding:
                ex = ey = 0.0
            ux = moved[j, 0] - moved[j, 2] * (contacts.point[j, c, 1] - work.pivot[j, 1])
            uy = moved[j, 1] + moved[j, 2] * (contacts.point[j, c, 0] - work.pivot[j, 0])
            limit = slow + abs(ux) + abs(uy)
            bx = ex / step - ux
            by = ey / step - uy
            nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
            inward = -limit - (nx * bx + ny * by)
            if inward > 0.0:
                bx += inward * nx
                by += inward * ny
            along = nx * by - ny * bx
            excess = along - min(max(along, -limit), limit)
            contacts.bias[j, c, 0] = bx + excess * ny
            contacts.bias[j, c, 1] = by - excess * nx
            gap = contacts.normal[j, 0] * ex + contacts.normal[j, 1] * ey
            contacts.candidate[j, c] = gap < REACH * step * (fastest + gravity * step)
            own = REACH * step * (abs(ux) + abs(uy) + gravity * step)
            closing = closing and gap < own
        if closing:
            for c in range(2):
                for k in range(2):
                    contacts.normal_plus[j, c, k] = contacts.normal[j, k]
                    contacts.normal_minus[j, c, k] = contacts.normal[j, k]


@kernel
def try_step(
    chain,
    position,
    velocity,
    slip,
    length,
    before,
    after,
    next_before,
    next_after,
    step,
    kick_x,
    kick_y,
    rounding,
    free,
    trial,
    moved,
    contacts,
    work,
):
    """Pose the contact problem of a step and solve it by the Newton iteration.

    Parameters
    ----------
    kick_x, kick_y : float
        What the ground, and gravity, take from the velocities [m/s].
    free : ndarray, (n_body, 3)
        Overwritten: velocities without reactions.

    Returns
    -------
    status, iterations : int
        As `newton_contact`.
    """
    for i in range(position.shape[0]):
        free[i, 0] = velocity[i, 0] - kick_x
        free[i, 1] = velocity[i, 1] - kick_y
        free[i, 2] = velocity[i, 2]
        for k in range(3):
            trial[i, k] = position[i, k] + step * velocity[i, k]
    place_contacts(position, before, after, slip, length, contacts)
    move_faces(chain, trial, next_before, next_after)
    aim_contacts(
        velocity,
        slip,
        length,
        next_before,
        next_after,
        step,
        chain.gravity,
        rounding,
        moved,
        contacts,
        work,
    )
    return newton_contact(chain.mass, chain.inertia, contacts, chain.friction, free, work)


@kernel
def finish_step(
    chain, step, kick_x, kick_y, position, velocity, mean, mean_relative, contacts, work
):
    """Take the solved velocities over and move the bodies; returns the work of the ground [J]."""
    for i in range(position.shape[0]):
        for k in range(3):
            mean[i, k] = 0.5 * (velocity[i, k] + work.velocity[i, k])
            velocity[i, k] = work.velocity[i, k]
            position[i, k] += step * velocity[i, k]
    relative_velocity(contacts, mean, work.pivot, mean_relative)
    return ground_work(chain.mass, kick_x, kick_y, mean)


@allocating
def rest_range(chain, position, joints, stepper):
    """Load factors between which a configuration would stay at rest, into ``stepper.rest``.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    position : ndarray, (n_body, 3)
    joints : JointState
    stepper : Stepper
        Its faces are those of `position`.

    Returns
    -------
    bool
        False if no load factor leaves it at rest.
    """
    contacts = stepper.contacts
    place_contacts(position, stepper.before, stepper.after, joints.slip, stepper.length, contacts)
    n_joint = joints.slip.size
    candidate = np.ones((n_joint, 2), np.int8)
    for j in range(n_joint):
        for c in range(2):
            if clearance(j, c, stepper.before, stepper.after) > CLOSED_GAP * stepper.length[j]:
                candidate[j, c] = 0
    centroid = position[:, :2].copy()
    for k in range(2):
        sense = 1.0 - 2.0 * k
        limit = rest_limit(
            chain.mass,
            centroid,
            contacts.point,
            contacts.normal,
            candidate,
            chain.friction,
            chain.gravity,
            sense,
        )
        if not limit.found:
            return False
        stepper.rest[k] = sense * limit.load_factor
    return True


@allocating
def _solve_step(
    chain, ground, options, stepper, joints, ledger, position, velocity, time, previous, step
):
    """One attempt at a step; what the ground takes from the velocities comes back with it."""
    span = 0.5 * (previous + step)
    start, end = time - 0.5 * previous, time + 0.5 * step
    sampling = ground.time_step
    kick_x = impulse_between(start, end, ground.horizontal, stepper.impulse_x, sampling)
    kick_y = impulse_between(start, end, ground.vertical, stepper.impulse_y, sampling)
    work, contacts = stepper.work, stepper.contacts
    solved, iterations = try_step(
        chain,
        position,
        velocity,
        joints.slip,
        stepper.length,
        stepper.before,
        stepper.after,
        stepper.next_before,
        stepper.next_after,
        step,
        kick_x,
        kick_y + span * chain.gravity,
        ROUNDING * np.max(np.abs(chain.centroid)),
        stepper.free,
        stepper.trial,
        stepper.moved,
        contacts,
        work,
    )
    breaks = 0
    soft = False
    if solved != STANDING:
        solved, more, breaks, soft = path_contact(
            chain.mass, chain.inertia, contacts, chain.friction, stepper.free, work
        )
        iterations += more
    count = ledger.count
    count[Count.STEPS] += 1
    count[Count.ITERATIONS] += iterations
    if breaks > 0:
        count[Count.PATHS] += 1
    if soft:
        count[Count.COMPLIANT] += 1
    final = solved == STANDING or step < SHORTEST * options.time_step
    if final and (soft or solved != STANDING or count[Count.STEPS] % options.check_interval == 0):
        residual = _measure_residual(chain, stepper)
        ledger.peak[Peak.RESIDUAL] = max(ledger.peak[Peak.RESIDUAL], residual)
    return solved == STANDING, kick_x, kick_y, span


@allocating
def _measure_residual(chain, stepper):
    work, contacts = stepper.work, stepper.contacts
    scale = velocity_scale(contacts, stepper.free, work)
    force_scale = 0.0
    for j in range(work.mode.size):
        for k in range(2):
            force_scale = max(force_scale, abs(work.reaction[j, k]))
    if force_scale == 0.0:
        return 0.0
    relative_velocity(contacts, work.velocity, work.pivot, work.relative)
    return contact_residual(
        contacts, chain.friction, work.relative, work.reaction, work.pivot, scale, force_scale
    )


@kernel
def cause_of_change(old, new):
    """Why the contact modes changed, and at which joint: the gravest change of a step.

    Returns
    -------
    cause : int
        archfrag.mechanics.status.Cause; -1 if nothing changed.
    joint : int
    """
    cause, joint, gravest = -1, -1, -1
    for j in range(old.size):
        if new[j] == old[j]:
            continue
        made = False
        for c in range(2):
            made = made or (touches(new[j], c) and not touches(old[j], c))
        if new[j] == OPEN:
            this, grave = BY_LOSS, 5
        elif made:
            this, grave = BY_IMPACT, 4
        elif is_closed(old[j]) and not is_closed(new[j]):
            this, grave = BY_HINGE, 3
        elif slip_of(new[j]) != STICK:
            this, grave = BY_SLIDE, 2
        else:
            this, grave = BY_STICK, 1
        if grave > gravest:
            cause, joint, gravest = this, j, grave
    return cause, joint


@kernel
def _book_contacts(stepper, joints, ledger, position, time):
    """Contacts made, lost and slipping after a step; slips are measured anew."""
    mode, count = stepper.work.mode, ledger.count
    before, after, length = stepper.before, stepper.after, stepper.length
    for j in range(mode.size):
        new, old = mode[j], joints.mode[j]
        made = broke = False
        for c in range(2):
            made = made or (touches(new, c) and not touches(old, c))
            broke = broke or (touches(old, c) and not touches(new, c))
        if made:
            count[Count.IMPACTS] += 1
            stepper.fresh[j] = FRESH_STEPS
        if broke:
            count[Count.OPENINGS] += 1
        if slip_of(new) != STICK and slip_of(old) == STICK:
            count[Count.SLIDES] += 1
        if new == OPEN:
            if old != OPEN:
                count[Count.LOSSES] += 1
                note_loss(j, time, position, length, joints)
            corner = 0
            if clearance(j, 1, before, after) < clearance(j, 0, before, after):
                corner = 1
            joints.slip[j] = measure_slip(j, corner, before, after)
            continue
        joints.last_contact[j] = new
        if slip_of(new) != STICK:
            joints.slip[j] = measure_slip(j, 0 if touches(new, 0) else 1, before, after)


@kernel
def book_work(friction, impact, stray, ledger):
    """Work of one step: what contacts give together is the integrator's error.

    In a step with an impact the impulses of several joints belong together, and those of one
    of them may give what those of another take.
    """
    taken = friction + impact
    if taken > 0.0:
        stray += taken
        friction = impact = 0.0
    elif friction > 0.0:
        friction, impact = 0.0, taken
    elif impact > 0.0:
        friction, impact = taken, 0.0
    energy = ledger.energy
    energy[Energy.FRICTION] += friction
    energy[Energy.IMPACT] += impact
    energy[Energy.STRAY] += stray
    energy[Energy.STRAY_PEAK] = max(energy[Energy.STRAY_PEAK], abs(energy[Energy.STRAY]))


@kernel
def _book_motion(chain, stepper, ledger, position, velocity):
    """Peaks and kinetic energy; the largest speed, nan where a position is not finite."""
    fastest = 0.0
    peak = ledger.peak
    for i in range(position.shape[0]):
        dx = position[i, 0] - chain.centroid[i, 0]
        dy = position[i, 1] - chain.centroid[i, 1]
        shift = np.sqrt(dx * dx + dy * dy)
        if not np.isfinite(shift + position[i, 2]):
            return np.nan
        peak[Peak.DISPLACEMENT] = max(peak[Peak.DISPLACEMENT], shift)
        peak[Peak.ROTATION] = max(peak[Peak.ROTATION], abs(position[i, 2]))
        speed = abs(velocity[i, 0]) + abs(velocity[i, 1])
        fastest = max(fastest, speed, stepper.length[0] * abs(velocity[i, 2]))
    kinetic = kinetic_energy(chain.mass, chain.inertia, velocity)
    ledger.energy[Energy.LARGEST_KINETIC] = max(ledger.energy[Energy.LARGEST_KINETIC], kinetic)
    return fastest


@allocating
def _synchronise(chain, ground, stepper, joints, ledger, position, velocity, time, previous):
    """Give velocities the half kick that is due, so that they belong to `time`."""
    sampling = ground.time_step
    start = time - 0.5 * previous
    kick_x = impulse_between(start, time, ground.horizontal, stepper.impulse_x, sampling)
    kick_y = impulse_between(start, time, ground.vertical, stepper.impulse_y, sampling)
    work, contacts, free = stepper.work, stepper.contacts, stepper.free
    place_contacts(position, stepper.before, stepper.after, joints.slip, stepper.length, contacts)
    contacts.bias[:] = 0.0
    for j in range(joints.mode.size):
        for c in range(2):
            contacts.candidate[j, c] = touches(joints.mode[j], c)
    for i in range(position.shape[0]):
        free[i, 0] = velocity[i, 0] - kick_x
        free[i, 1] = velocity[i, 1] - kick_y - 0.5 * previous * chain.gravity
        free[i, 2] = velocity[i, 2]
    solved, _ = newton_contact(chain.mass, chain.inertia, contacts, chain.friction, free, work)
    if solved != STANDING:
        solved, _, _, _ = path_contact(
            chain.mass, chain.inertia, contacts, chain.friction, free, work
        )
    if solved == STANDING:
        for i in range(position.shape[0]):
            for c in range(3):
                stepper.mean[i, c] = 0.5 * (velocity[i, c] + work.velocity[i, c])
                velocity[i, c] = work.velocity[i, c]
        ledger.energy[Energy.GROUND] += ground_work(chain.mass, kick_x, kick_y, stepper.mean)
        relative_velocity(contacts, stepper.mean, work.pivot, stepper.mean_relative)
        friction, impact, stray = contact_works(
            contacts, work, stepper.mean_relative, joints.mode, stepper.fresh
        )
        book_work(friction, impact, stray, ledger)
    close_account(chain, position, velocity, stepper.clock[1], ledger)
    return solved == STANDING


@allocating
def advance(
    chain,
    ground,
    options,
    stepper,
    joints,
    ledger,
    frames,
    log,
    position,
    velocity,
    time,
    until,
    calm_steps,
):
    """Step a chain through a part of the motion.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    options : archfrag.mechanics.types.Options
    stepper : Stepper
    joints : JointState
        Slips and contact modes; changed.
    ledger, frames, log
        What is counted, and rooms for the history.
    position, velocity : ndarray, (n_body, 3)
        At `time`; on return those at the end.
    time, until : float [s]
    calm_steps : int
        Return after so many steps in a row in which no contact mode changed; 0: never.

    Returns
    -------
    status : int
        ``Status.UNFINISHED`` at `until` or where it is calm, ``STANDING`` at rest (with the rest
        range in ``stepper.rest``), or how the run ended.
    time : float [s]
    collapse_time : float [s]
    collapse_joint, collapse_mode : int
    """
    work = stepper.work
    dt = options.time_step
    still = STILL * np.sqrt(chain.gravity * np.max(stepper.length))
    work.mode[:] = joints.mode
    stepper.fresh[:] = 0
    move_faces(chain, position, stepper.before, stepper.after)
    previous, step, calm = 0.0, dt, 0
    collapse_joint, collapse_mode, collapse_time = -1, NO_MODE, np.nan
    status = UNFINISHED
    while time < until and (calm_steps == 0 or calm < calm_steps):
        if ledger.count[Count.STEPS] >= options.max_steps:
            status = WORK_BOUND
            break
        solved, kick_x, kick_y, span = _solve_step(
            chain, ground, options, stepper, joints, ledger, position, velocity, time, previous,
            step,
        )  # fmt: skip
        if not solved:
            if step < SHORTEST * dt:
                status = NO_SOLUTION
                break
            step *= 0.5
            ledger.count[Count.SHORTENED] += 1
            work.mode[:] = joints.mode
            continue
        ledger.energy[Energy.GROUND] += finish_step(
            chain, step, kick_x, kick_y, position, velocity, stepper.mean, stepper.mean_relative,
            stepper.contacts, work,
        )  # fmt: skip
        stray = _change_of_step(chain, stepper, step, previous, kick_y, span)
        move_faces(chain, position, stepper.before, stepper.after)
        cause, joint = cause_of_change(joints.mode, work.mode)
        _book_contacts(stepper, joints, ledger, position, time)
        friction, impact, more = contact_works(
            stepper.contacts, work, stepper.mean_relative, joints.mode, stepper.fresh
        )
        book_work(friction, impact, stray + more, ledger)
        for j in range(joints.mode.size):
            joints.mode[j] = work.mode[j]
            stepper.fresh[j] = max(stepper.fresh[j] - 1, 0)
        collapse_joint, collapse_mode, collapse_time = collapse_of(
            position, stepper.before, stepper.after, stepper.length, joints, options.loss_limit,
            time + step,
        )  # fmt: skip
        time += step
        ledger.model_time[Model.ALL_VOUSSOIRS] += step
        previous, step = step, dt
        calm = calm + 1 if cause < 0 else 0
        if cause >= 0:
            log_change(log, ledger, time, cause, joint, ALL, joints.mode)
        fastest = _book_motion(chain, stepper, ledger, position, velocity)
        if np.isnan(fastest):
            status = NOT_FINITE
            break
        if frames.time.size > 0 and (time >= stepper.clock[0] or collapse_joint >= 0):
            write_frame(
                frames, ledger, time, chain, position, velocity, work.reaction, joints.mode, span
            )
            stepper.clock[0] = time + options.frame_interval - 0.5 * dt
        if collapse_joint >= 0:
            status = COLLAPSED
            break
        if fastest < still and rests(chain, ground, stepper, joints, position, time):
            velocity[:] = 0.0
            close_account(chain, position, velocity, stepper.clock[1], ledger)
            ledger.count[Count.RESTS] += 1
            write_frame(
                frames, ledger, time, chain, position, velocity, work.reaction, joints.mode, span
            )
            log_change(log, ledger, time, BY_REST, -1, AT_REST, joints.mode)
            return STANDING, time, np.nan, -1, NO_MODE
    if status == UNFINISHED:
        if not _synchronise(
            chain, ground, stepper, joints, ledger, position, velocity, time, previous
        ):
            status = NO_SOLUTION
    else:
        # The potential belongs to the instant of the velocities, half a step back.
        for i in range(position.shape[0]):
            for k in range(3):
                stepper.trial[i, k] = position[i, k] - 0.5 * previous * velocity[i, k]
        close_account(chain, stepper.trial, velocity, stepper.clock[1], ledger)
    return status, time, collapse_time, collapse_joint, collapse_mode


@kernel
def _change_of_step(chain, stepper, step, previous, kick_y, span):
    """Weight and height are weighed differently where the step changes [J]."""
    if step == previous:
        return 0.0
    work = 0.0
    for i in range(chain.mass.size):
        free = stepper.free[i, 1] + kick_y + span * chain.gravity
        change = stepper.work.velocity[i, 1] - free
        work += 0.25 * chain.gravity * chain.mass[i] * (step - previous) * change
    return work


@allocating
def rests(chain, ground, stepper, joints, position, time):
    """Whether the ground motion leaves a still chain at rest; the range into the stepper."""
    if not rest_range(chain, position, joints, stepper):
        return False
    sampling = ground.time_step
    margin = rest_margin(
        acceleration_at(time, ground.horizontal, sampling),
        acceleration_at(time, ground.vertical, sampling),
        chain.gravity,
        stepper.rest[0],
        stepper.rest[1],
    )
    return margin > 0.0


@kernel
def leave_rest(chain, ground, rest, time):
    """Until when a chain at rest stays so.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    rest : ndarray, (2,)
        Limits of its rest range.
    time : float [s]

    Returns
    -------
    leave : float
        When it starts to move, or where the record ends [s].
    for_good : bool
        Whether it stays at rest for ever.
    """
    record_end = (ground.horizontal.size - 1) * ground.time_step
    leave = end_of_rest(time, ground, chain.gravity, rest[0], rest[1])
    if leave < record_end:
        return leave, False
    stays = rest_margin(0.0, 0.0, chain.gravity, rest[0], rest[1]) >= 0.0
    return max(time, record_end), stays


@kernel
def read_slips(chain, stepper, joints, position):
    """Slips of all joints of an initial state, each at its nearer corner."""
    before, after = stepper.before, stepper.after
    move_faces(chain, position, before, after)
    for j in range(joints.slip.size):
        corner = 0
        if clearance(j, 1, before, after) < clearance(j, 0, before, after):
            corner = 1
        joints.slip[j] = measure_slip(j, corner, before, after)
        if abs(joints.slip[j]) < CLOSED_GAP * stepper.length[j]:
            joints.slip[j] = 0.0


@allocating
def run(chain, ground, position, velocity, from_rest, options, frames, log):
    """Integrate one chain under one ground motion; the signature of every method.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    position, velocity : ndarray, (n_body, 3)
        Initial state; overwritten with the final one.
    from_rest : bool
        Whether the initial state is the chain at rest in its own geometry.
    options : archfrag.mechanics.types.Options
    frames : archfrag.mechanics.types.Frames
        Overwritten with the history; arrays of length zero for none.
    log : archfrag.mechanics.types.MechanismLog
        Overwritten with the changes of the mechanism; arrays of length zero for none.

    Returns
    -------
    archfrag.mechanics.types.Outcome
    """
    stepper = new_stepper(chain, ground, position)
    joints = new_joint_state(chain.friction.size)
    ledger = new_ledger()
    stop = (ground.horizontal.size - 1) * ground.time_step + options.follow
    time = 0.0
    status = UNFINISHED
    collapse_time, collapse_joint, collapse_mode = np.nan, -1, NO_MODE
    close_account(chain, position, velocity, stepper.clock[1], ledger)
    write_frame(
        frames, ledger, time, chain, position, velocity, stepper.work.reaction, joints.mode, 1.0
    )
    stepper.clock[0] = options.frame_interval
    move_faces(chain, position, stepper.before, stepper.after)
    resting = False
    if from_rest:
        resting = rest_range(chain, position, joints, stepper)
    else:
        read_slips(chain, stepper, joints, position)
    while True:
        if resting:
            leave, for_good = leave_rest(chain, ground, stepper.rest, time)
            ledger.model_time[Model.REST] += leave - time
            time = leave
            velocity[:] = 0.0
            if for_good:
                status = STANDING
                break
            write_frame(
                frames, ledger, time, chain, position, velocity, stepper.work.reaction,
                joints.mode, 1.0,
            )  # fmt: skip
            log_change(log, ledger, time, BY_START, -1, ALL, joints.mode)
        status, time, collapse_time, collapse_joint, collapse_mode = advance(
            chain, ground, options, stepper, joints, ledger, frames, log, position, velocity,
            time, stop, 0,
        )  # fmt: skip
        resting = status == STANDING
        if not resting:
            break
    return Outcome(status, time, collapse_time, collapse_joint, collapse_mode, ledger)
