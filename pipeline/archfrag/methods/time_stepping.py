"""Moreau-Jean time stepping on all voussoirs, with large rotations.

Forces and contact directions are taken at the middle of the step, where Moreau's scheme looks
for contacts (Moreau 1988, 1999; Jean 1999), and Signorini's law is imposed on the position that
the step reaches, as Paoli and Schatzman do (2002, *SIAM J. Numer. Anal.* 40(2)): with no
restitution a contact neither drifts nor penetrates. Between impacts this is the Stoermer-Verlet
method with constraints, of second order and without numerical damping; an impact is caught
within its step.

While the body force stays inside the rest range of the configuration nothing is integrated.
"""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.contact import newton_contact, path_contact
from archfrag.mechanics.delassus import (
    Contacts,
    ContactWork,
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
    joint_lengths,
    measure_slip,
    move_faces,
    place_contacts,
)
from archfrag.mechanics.laws import (
    CLOSED_STICK,
    OPEN,
    STICK,
    is_closed,
    slip_of,
    touches,
)
from archfrag.mechanics.onset import rest_limit
from archfrag.mechanics.residuals import contact_residual
from archfrag.mechanics.status import CollapseMode, Status
from archfrag.mechanics.types import Outcome

STANDING = int(Status.STANDING)
COLLAPSED = int(Status.COLLAPSED)
UNFINISHED = int(Status.UNFINISHED)
NO_SOLUTION = int(Status.NO_CONTACT_SOLUTION)
NOT_FINITE = int(Status.NOT_FINITE)
WORK_BOUND = int(Status.WORK_BOUND)
MODE_NONE = int(CollapseMode.NONE)
MODE_HINGING = int(CollapseMode.HINGING)
MODE_SLIDING = int(CollapseMode.SLIDING)
MODE_LIFT_OFF = int(CollapseMode.LIFT_OFF)
MODE_OVERTURNING = int(CollapseMode.OVERTURNING)

STILL = 1e-7
CLOSED_GAP = 1e-7
FRESH_STEPS = 2
# Gaps of this size, relative to the coordinates, are rounding. A closed ring is overdetermined:
# it would answer them with reactions of any size.
# A corner takes part in a step if its gap could close within it at this many times its relative
# velocity. Where both corners of a joint do, the joint has one normal for both.
REACH = 5.0
# Overlap is mended no faster than at the joint's own relative speed plus what gravity and this
# many times rotation do in a step: mending a deep one at once would throw the bodies apart.
SWING = 4.0
# A step whose contact problem is not solved is halved, down to this part of the nominal one.
SHORTEST = 1.0 / 100.0
# Contact lost below this slip over joint length and this rotation [rad] is lift-off.
SMALL = 0.02
ROUNDING = 64 * 2.2e-16


@allocating
def _room(n_body, n_joint):
    block = (n_joint, 3, 3)
    work = ContactWork(
        np.zeros((n_body, 3)),
        np.zeros((n_joint, 3)),
        np.zeros(n_joint, np.int8),
        np.zeros((n_joint, 2)),
        np.zeros((n_joint, 3)),
        np.zeros(block),
        np.zeros(block),
        np.zeros(n_joint, np.int64),
        np.zeros(block),
        np.zeros(block),
        np.zeros(block),
        np.zeros((n_joint, 3), np.int8),
        np.zeros(block),
        np.zeros(block),
        np.zeros((n_joint, 3)),
        np.zeros((n_joint, 3)),
        np.zeros(n_joint, np.int8),
    )
    contacts = Contacts(
        np.zeros((n_body, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        np.ones((n_joint, 2), np.int8),
        np.zeros(n_joint, np.int8),
        np.zeros((n_joint, 2, 2)),
    )
    return work, contacts


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
    for j in range(n_joint):
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
            reach = REACH * step * (abs(ux) + abs(uy) + gravity * step)
            contacts.candidate[j, c] = gap < reach
        if contacts.candidate[j, 0] and contacts.candidate[j, 1]:
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
def _rest_range(chain, position, before, after, slip, length, contacts):
    """Load factors between which the present configuration would stay at rest."""
    place_contacts(position, before, after, slip, length, contacts)
    candidate = np.ones((slip.size, 2), np.int8)
    for j in range(slip.size):
        for c in range(2):
            if clearance(j, c, before, after) > CLOSED_GAP * length[j]:
                candidate[j, c] = 0
    centroid = position[:, :2].copy()
    plus = rest_limit(
        chain.mass,
        centroid,
        contacts.point,
        contacts.normal,
        candidate,
        chain.friction,
        chain.gravity,
        1.0,
    )
    if not plus.found:
        return False, 0.0, 0.0
    minus = rest_limit(
        chain.mass,
        centroid,
        contacts.point,
        contacts.normal,
        candidate,
        chain.friction,
        chain.gravity,
        -1.0,
    )
    return minus.found, plus.load_factor, -minus.load_factor


@allocating
def _write_frame(frames, n_frame, time, position, centroid, velocity, work, span):
    if n_frame < frames.time.size:
        frames.time[n_frame] = time
        for i in range(position.shape[0]):
            frames.position[n_frame, i, 0] = position[i, 0] - centroid[i, 0]
            frames.position[n_frame, i, 1] = position[i, 1] - centroid[i, 1]
            frames.position[n_frame, i, 2] = position[i, 2]
        frames.velocity[n_frame] = velocity
        frames.reaction[n_frame] = work.reaction / span
        frames.mode[n_frame] = work.mode
        return n_frame + 1
    return n_frame


@allocating
def run(chain, ground, position, velocity, from_rest, options, frames):
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

    Returns
    -------
    archfrag.mechanics.types.Outcome
    """
    n_body = chain.mass.size
    n_joint = chain.friction.size
    mass, inertia, gravity = chain.mass, chain.inertia, chain.gravity
    dt = options.time_step
    work, contacts = _room(n_body, n_joint)
    before = np.zeros((n_joint, 2, 2))
    after = np.zeros((n_joint, 2, 2))
    next_before = np.zeros((n_joint, 2, 2))
    next_after = np.zeros((n_joint, 2, 2))
    slip = np.zeros(n_joint)
    free = np.zeros((n_body, 3))
    trial = np.zeros((n_body, 3))
    mean = np.zeros((n_body, 3))
    mean_relative = np.zeros((n_joint, 3))
    moved = np.zeros((n_joint, 3))
    old_mode = np.full(n_joint, CLOSED_STICK, np.int8)
    last_contact = np.full(n_joint, CLOSED_STICK, np.int8)
    fresh = np.zeros(n_joint, np.int64)
    lost_since = np.full(n_joint, np.nan)
    lost_slip = np.zeros(n_joint)
    lost_turn = np.zeros(n_joint)
    work.mode[:] = CLOSED_STICK
    length = joint_lengths(chain)
    impulse_x = cumulative_impulse(ground.horizontal, ground.time_step)
    impulse_y = cumulative_impulse(ground.vertical, ground.time_step)
    record_end = (ground.horizontal.size - 1) * ground.time_step
    stop = record_end + options.follow
    rounding = ROUNDING * np.max(np.abs(chain.centroid))
    still = STILL * np.sqrt(gravity * np.max(length))

    move_faces(chain, position, before, after)
    found = False
    plus = 0.0
    minus = 0.0
    if from_rest:
        found, plus, minus = _rest_range(chain, position, before, after, slip, length, contacts)
    else:
        for j in range(n_joint):
            corner = 0
            if clearance(j, 1, before, after) < clearance(j, 0, before, after):
                corner = 1
            slip[j] = measure_slip(j, corner, before, after)
            if abs(slip[j]) < CLOSED_GAP * length[j]:
                slip[j] = 0.0
    at_rest = found
    rest_from = 0.0
    previous = 0.0
    step = dt
    sampling = ground.time_step

    time = 0.0
    span = dt
    status = UNFINISHED
    collapse_time = np.nan
    collapse_joint = -1
    collapse_mode = MODE_NONE
    peak_rotation = peak_displacement = 0.0
    rest_time = moving_time = 0.0
    steps = iterations = paths = compliant = shortened = 0
    impacts = openings = slides = losses = rests = 0
    residual = 0.0
    kinetic = kinetic_energy(mass, inertia, velocity)
    largest_kinetic = kinetic
    start_potential = potential_energy(mass, gravity, position)
    potential = start_potential
    work_ground = work_friction = work_impact = work_stray = stray_peak = 0.0
    n_frame = _write_frame(frames, 0, 0.0, position, chain.centroid, velocity, work, span)
    next_frame = options.frame_interval

    while True:
        if at_rest:
            leave = end_of_rest(time, ground, gravity, plus, minus)
            stays = rest_margin(0.0, 0.0, gravity, plus, minus) >= 0.0
            if leave >= record_end and not stays:
                leave = max(time, record_end)
            elif leave >= record_end:
                rest_time += max(record_end - rest_from, 0.0)
                time = max(time, record_end)
                status = STANDING
                break
            rest_time += leave - rest_from
            time = leave
            at_rest = False
            previous = 0.0
            step = dt
            velocity[:] = 0.0
            work.mode[:] = old_mode
            n_frame = _write_frame(
                frames, n_frame, time, position, chain.centroid, velocity, work, span
            )
        if time >= stop:
            status = UNFINISHED
            break
        if steps >= options.max_steps:
            status = WORK_BOUND
            break

        span = 0.5 * (previous + step)
        kick_x = impulse_between(
            time - 0.5 * previous, time + 0.5 * step, ground.horizontal, impulse_x, sampling
        )
        kick_y = impulse_between(
            time - 0.5 * previous, time + 0.5 * step, ground.vertical, impulse_y, sampling
        )
        solved, n_iteration = try_step(
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
            kick_y + span * gravity,
            rounding,
            free,
            trial,
            moved,
            contacts,
            work,
        )
        n_break = 0
        soft = False
        if solved != STANDING:
            solved, more, n_break, soft = path_contact(
                mass, inertia, contacts, chain.friction, free, work
            )
            n_iteration += more
        steps += 1
        iterations += n_iteration
        if n_break > 0:
            paths += 1
        if soft:
            compliant += 1
        last_try = solved != STANDING and step < SHORTEST * dt
        if soft or last_try or steps % options.check_interval == 0:
            scale = velocity_scale(contacts, free, work)
            force_scale = 0.0
            for j in range(n_joint):
                for k in range(2):
                    force_scale = max(force_scale, abs(work.reaction[j, k]))
            if force_scale > 0.0:
                relative_velocity(contacts, work.velocity, work.pivot, work.relative)
                residual = max(
                    residual,
                    contact_residual(
                        contacts,
                        chain.friction,
                        work.relative,
                        work.reaction,
                        work.pivot,
                        scale,
                        force_scale,
                    ),
                )
        if solved != STANDING:
            if step < SHORTEST * dt:
                status = NO_SOLUTION
                break
            step *= 0.5
            shortened += 1
            for j in range(n_joint):
                work.mode[j] = old_mode[j]
            continue

        gain = finish_step(
            chain, step, kick_x, kick_y, position, velocity, mean, mean_relative, contacts, work
        )
        work_ground += gain
        if step != previous:
            # Weight and height are weighed differently where the step changes.
            for i in range(n_body):
                change = work.velocity[i, 1] - (free[i, 1] + kick_y + span * gravity)
                work_stray += 0.25 * gravity * mass[i] * (step - previous) * change
        fastest = 0.0
        move_faces(chain, position, before, after)
        for j in range(n_joint):
            mode = work.mode[j]
            old = old_mode[j]
            made = (touches(mode, 0) and not touches(old, 0)) or (
                touches(mode, 1) and not touches(old, 1)
            )
            broke = (touches(old, 0) and not touches(mode, 0)) or (
                touches(old, 1) and not touches(mode, 1)
            )
            if made:
                impacts += 1
                fresh[j] = FRESH_STEPS
            if broke:
                openings += 1
            if slip_of(mode) != STICK and slip_of(old) == STICK:
                slides += 1
            turn = 0.0
            if j < n_body:
                turn += position[j, 2]
            if j > 0:
                turn -= position[j - 1, 2]
            if mode == OPEN:
                if old != OPEN:
                    losses += 1
                    lost_since[j] = time
                    lost_slip[j] = abs(slip[j]) / length[j]
                    lost_turn[j] = abs(turn)
                corner = 0
                gap_0 = clearance(j, 0, before, after)
                gap_1 = clearance(j, 1, before, after)
                if gap_1 < gap_0:
                    corner = 1
                slip[j] = measure_slip(j, corner, before, after)
                if min(gap_0, gap_1) > options.loss_limit * length[j]:
                    status = COLLAPSED
                    collapse_joint = j
                    collapse_time = lost_since[j]
                    collapse_mode = MODE_HINGING
                    if lost_slip[j] > lost_turn[j]:
                        collapse_mode = MODE_SLIDING
                    if is_closed(last_contact[j]) and max(lost_slip[j], lost_turn[j]) < SMALL:
                        collapse_mode = MODE_LIFT_OFF
            else:
                last_contact[j] = mode
                if slip_of(mode) != STICK:
                    corner = 0 if touches(mode, 0) else 1
                    slip[j] = measure_slip(j, corner, before, after)
                    if abs(slip[j]) >= length[j]:
                        status = COLLAPSED
                        collapse_joint = j
                        collapse_time = time + step
                        collapse_mode = MODE_SLIDING
            if abs(turn) >= 0.5 * np.pi:
                status = COLLAPSED
                collapse_joint = j
                collapse_time = time + step
                collapse_mode = MODE_OVERTURNING
        friction, impact, stray = contact_works(contacts, work, mean_relative, old_mode, fresh)
        work_friction += min(friction, 0.0)
        work_impact += min(impact, 0.0)
        work_stray += stray + max(friction, 0.0) + max(impact, 0.0)
        for j in range(n_joint):
            old_mode[j] = work.mode[j]
            if fresh[j] > 0:
                fresh[j] -= 1
        stray_peak = max(stray_peak, abs(work_stray))
        time += step
        moving_time += step
        previous = step
        step = dt
        finite = True
        for i in range(n_body):
            dx = position[i, 0] - chain.centroid[i, 0]
            dy = position[i, 1] - chain.centroid[i, 1]
            shift = dx * dx + dy * dy
            if not np.isfinite(shift + position[i, 2]):
                finite = False
            peak_displacement = max(peak_displacement, shift)
            peak_rotation = max(peak_rotation, abs(position[i, 2]))
            speed = abs(velocity[i, 0]) + abs(velocity[i, 1])
            fastest = max(fastest, speed, length[0] * abs(velocity[i, 2]))
        kinetic = kinetic_energy(mass, inertia, velocity)
        largest_kinetic = max(largest_kinetic, kinetic)
        if not finite:
            status = NOT_FINITE
            break
        if frames.time.size > 0 and (time >= next_frame or status == COLLAPSED):
            n_frame = _write_frame(
                frames, n_frame, time, position, chain.centroid, velocity, work, span
            )
            next_frame = time + options.frame_interval - 0.5 * dt
        if status == COLLAPSED:
            break
        if fastest < still:
            margin = 0.0
            found, plus, minus = _rest_range(
                chain, position, before, after, slip, length, contacts
            )
            if found:
                margin = rest_margin(
                    acceleration_at(time, ground.horizontal, ground.time_step),
                    acceleration_at(time, ground.vertical, ground.time_step),
                    gravity,
                    plus,
                    minus,
                )
            if margin > 0.0:
                work_stray -= kinetic
                for i in range(n_body):
                    work_stray += 0.5 * gravity * mass[i] * previous * velocity[i, 1]
                kinetic = 0.0
                velocity[:] = 0.0
                at_rest = True
                rest_from = time
                rests += 1
                n_frame = _write_frame(
                    frames, n_frame, time, position, chain.centroid, velocity, work, span
                )

    # The potential belongs to the instant of the velocities, half a step back.
    for i in range(n_body):
        for k in range(3):
            trial[i, k] = position[i, k] - 0.5 * previous * velocity[i, k]
    potential = potential_energy(mass, gravity, trial) - start_potential
    return Outcome(
        status,
        time,
        collapse_time,
        collapse_joint,
        collapse_mode,
        peak_rotation,
        np.sqrt(peak_displacement),
        rest_time,
        moving_time,
        steps,
        iterations,
        paths,
        compliant,
        shortened,
        impacts,
        openings,
        slides,
        losses,
        rests,
        residual,
        largest_kinetic,
        work_ground,
        potential,
        kinetic,
        work_friction,
        work_impact,
        work_stray,
        stray_peak,
        n_frame,
    )
