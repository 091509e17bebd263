"""Solve what follows an event: the impact, and the mechanism from then on.

Both are contact problems of all voussoirs: of velocities at an impact (Eqs 8, 9, 11, 21), of
accelerations for the mechanism (Eqs 15-19, 29-33). A problem is posed and solved, and its solution
is taken over. If Newton's iteration on the modes does not solve it, solution paths do.
"""

import math

import numpy as np

from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact import laws, placing
from archfrag.physics.contact.blocks import EXACT, solve_modes
from archfrag.physics.contact.laws import along, cross, opening_rate
from archfrag.physics.contact.modes import solve_contact, velocity_scale
from archfrag.physics.contact.path import copy_modes, solve_by_path
from archfrag.physics.contact.ties import change_pull, pull_bodies, release_pulls
from archfrag.physics.energy import kinetic_energy
from archfrag.physics.events.runge_kutta import far_power
from archfrag.physics.ground import ground_after, rest_margin, segment_at
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.mega_voussoirs.first_level import centripetal_bias, set_free
from archfrag.physics.numbers import copy_rows
from archfrag.physics.state import Clock
from archfrag.physics.status import Cause, Count, Energy

# Corners this close, over the joint's length, touch; slower than this, over the speed of a fall
# through it, they stay.
TOUCHING = 1e-9
STAYING = 1e-8
# A slip slower than this part of the speed of a fall through a joint's length may end at once.
SLIPPING = 1e-6
# Accelerations beyond this many times gravity are no motion but a state in which rigid bodies
# with friction have none (Painleve).
IMPOSSIBLE = 300.0
# Corners that overlap by more than this part of the joint's length are not taken as closed.
OVERLAP = 1e-6
# Relative velocities below this part of that speed are rounding: an impact has nothing to change.
LEAST_SPEED = 1e-8
# Rocking slower than SLOW times the root of the tolerance, over the speed of a fall, is over: what
# is left out is of the second order. Below SLOWEST its flights are shorter than the gaps to which
# impacts are located.
SLOW = 1e-1
SLOWEST = 3e-6
# A chain leaves rest where the load is beyond the range of rest by BEYOND times gravity. That
# instant is looked for from SOONEST on, over the time of a fall through a joint's length.
BEYOND = 1e-7
SOONEST = 1e-9


@kernel
def place_voussoirs(run):
    """Place faces and contacts of all joints where the voussoirs are."""
    state = run.state
    placing.place_chain(
        run.model, state.position, state, TOUCHING, state.slip, run.work
    )


@inlined
def pose_impact(run, joint, corner):
    """Set up the contact problem of an impact at the present state.

    Corner `corner` of joint `joint` counts as closed; -1 if there is none. Return whether there is
    anything that an impact could change.
    """
    model = run.model
    state = run.state
    work = run.work
    place_voussoirs(run)
    for j in range(state.slip.size):
        for k in range(2):
            near = placing.clearance(j, k, work) <= TOUCHING * model.length[j]
            held = state.contact[j, k] > 0.5 or (j == joint and k == corner)
            work.candidate[j, k] = work.contact[j, k] = 1.0 if near or held else 0.0
    work.bias[:] = 0.0
    work.slide[:] = work.known[:] = 0.0
    release_pulls(work)
    copy_rows(state.velocity, work.free, 1, state.velocity.shape[0])
    copy_rows(state.velocity, work.solved, 1, state.velocity.shape[0])
    return velocity_scale(model, state.position, work) > LEAST_SPEED * run.motion.speed


@inlined
def _close_slow_joints(run):
    """Close joints and stop slips, in `work`, whose motion is nearly over.

    Return whether there are any. A joint that rocks from corner to corner loses a fixed part of
    its rate at each impact and is closed after infinitely many of them, in a finite time; a slip
    ends by friction in a time in proportion to its rate.
    """
    model = run.model
    work = run.work
    motion = run.motion
    changed = False
    slow = motion.speed * max(SLOW * math.sqrt(motion.tolerance), SLOWEST)
    for j in range(work.slide.size):
        at_0, at_1 = laws.touching(j, work)
        if not (at_0 or at_1):
            continue
        normal = laws.normal_of(j, work)
        if at_0 != at_1:
            k = 1 if at_0 else 0
            gap = placing.clearance(j, k, work)
            rate = along(normal, placing.corner_velocity(j, k, work.relative, work))
            near = work.candidate[j, k] > 0.5 and gap > -OVERLAP * model.length[j]
            if near and rate < slow:
                work.contact[j, k] = 1.0
                changed = True
                if math.isinf(model.friction[j]):
                    work.slide[j] = 0.0
        rate = cross(normal, work.relative[j])
        if work.slide[j] != 0.0 and abs(rate) < slow:
            work.slide[j] = 0.0
            changed = True
    return changed


@inlined
def _approaches(run):
    """Return whether the solved velocities close a corner that touches."""
    work = run.work
    limit = -STAYING * run.motion.speed
    approaches = False
    for j in range(work.slide.size):
        for k in range(2):
            closes = opening_rate(j, k, laws.rate_of(j, k, work), work) < limit
            approaches = approaches or (work.candidate[j, k] > 0.5 and closes)
    return approaches


@inlined
def take_impact(run):
    """Accept the velocities after an impact, and close slow joints."""
    model = run.model
    state = run.state
    work = run.work
    had = kinetic_energy(model, state.velocity)
    for j in range(state.slip.size):
        made_0 = work.contact[j, 0] > state.contact[j, 0]
        made = made_0 or work.contact[j, 1] > state.contact[j, 1]
        if made:
            state.count[Count.IMPACTS] += 1.0
    by_far = _take_velocities(run)
    if _close_slow_joints(run):
        left = kinetic_energy(model, state.velocity)
        copy_rows(state.velocity, work.free, 1, state.velocity.shape[0])
        solve_modes(model, state.position, work, run.motion.speed, EXACT, 0)
        # Where bringing velocities there would give energy, or another joint would have to be
        # struck, nothing is closed.
        if kinetic_energy(model, work.solved) <= left and not _approaches(run):
            by_far += _take_velocities(run)
    state.energy[Energy.GROUND] += by_far
    state.energy[Energy.IMPACT] += kinetic_energy(model, state.velocity) - had - by_far


@inlined
def _take_velocities(run):
    """Accept solved velocities and modes; return the work of the far springing [J]."""
    velocity = run.state.velocity
    by_far = far_power(run.work, velocity)
    copy_rows(run.work.solved, velocity, 1, velocity.shape[0] - 1)
    copy_modes(run.work, run.state)
    return by_far


@inlined
def _find_touching(j, run):
    """Set ``work.candidate`` of joint `j` at corners that touch and stay.

    Return the slip rate [m/s]; if both corners touch, it is the larger one.
    """
    model = run.model
    state = run.state
    work = run.work
    rate = 0.0
    speed = run.motion.speed
    for k in range(2):
        work.candidate[j, k] = 0.0
        velocity = placing.corner_velocity(j, k, work.relative, work)
        if state.contact[j, k] < 0.5:
            apart = placing.clearance(j, k, work) > TOUCHING * model.length[j]
            if apart or opening_rate(j, k, velocity, work) > STAYING * speed:
                continue
        work.candidate[j, k] = 1.0
        slip = cross(laws.normal_of(j, work), velocity)
        rate = slip if abs(slip) > abs(rate) else rate
    return rate


@inlined
def ground_now(run, leaves_rest):
    """Return the present ground acceleration, as `ground_after`.

    If `leaves_rest`, it is that of the instant at which the load is just outside the range of
    rest, or the far springing begins to move.
    """
    time = run.state.clock[Clock.TIME]
    options = run.options
    g = run.model.gravity
    segment = segment_at(time, run.grounds)
    later = 0.0
    end = segment.end if leaves_rest and not np.isnan(options.rest_plus) else time
    while time + later < end:
        ahead = ground_after(segment, later)
        margin = rest_margin(
            ahead[0], ahead[1], g, options.rest_plus, options.rest_minus
        )
        if margin < -BEYOND * g or abs(ahead[2]) + abs(ahead[3]) > BEYOND * g:
            break
        soonest = SOONEST * (run.motion.length / run.motion.speed)
        later = min(max(2.0 * later, soonest), end - time)
    return ground_after(segment, later)


@inlined
def pose_accelerations(run, ground):
    """Set up the contact problem of accelerations at the present state.

    `ground` is from `ground_now`. Return whether unlimited friction ends a slip at once.
    """
    model = run.model
    state = run.state
    work = run.work
    jammed = False
    copy_modes(state, work)
    placing.relative_velocity(
        model, state.position, state.velocity, work.pivot, work.relative
    )
    for j in range(state.slip.size):
        rate = _find_touching(j, run)
        slips = abs(rate) > SLIPPING * run.motion.speed
        rough = math.isinf(model.friction[j])
        jammed = jammed or (slips and rough)
        work.known[j] = 0.0
        if slips and not rough:
            work.known[j] = work.slide[j] = -1.0 if rate > 0.0 else 1.0
        if state.contact[j, 0] + state.contact[j, 1] == (2.0 if rough else 0.0):
            work.slide[j] = 0.0
    set_free(model, ground, work.free)
    pull_bodies(model, state, work)
    centripetal_bias(
        model, state.position, state.velocity, state.slip, work.known, work
    )
    return jammed


@kernel
def solve_posed(run):
    """Solve the contact problem that is posed; return whether it is solved.

    If the modes go round in circles in Newton's iteration, it is solved along solution paths.
    """
    model = run.model
    position = run.state.position
    work = run.work
    path = run.path
    count = run.state.count
    copy_modes(work, path)
    solved, _, _, iterations = solve_contact(
        model, position, work, True, 0.0, -1.0, EXACT
    )
    count[Count.LEVELS] += 1.0
    if iterations > 1.0:
        count[Count.LEVEL_ITERATIONS] += 1.0
    if not solved:
        count[Count.GENERAL] += 1.0
        copy_modes(path, work)
        solved, _, more, breaks = solve_by_path(model, position, work, path, True)
        iterations += more
        if breaks > 0:
            count[Count.PATHS] += 1.0
    count[Count.ITERATIONS] += iterations
    return solved


@inlined
def take_modes(run):
    """Accept the modes of solved accelerations; return False if these are impossible."""
    model = run.model
    state = run.state
    work = run.work
    for i in range(1, state.position.shape[0] - 1):
        size = abs(work.solved[i, 0]) + abs(work.solved[i, 1])
        if not size <= IMPOSSIBLE * model.gravity:
            return False
    for j in range(state.slip.size):
        touches = work.contact[j, 0] + work.contact[j, 1]
        if work.known[j] != 0.0 and touches > 0.0 and work.slide[j] != work.known[j]:
            return False
        before = state.contact[j, 0] + state.contact[j, 1]
        slides = work.slide[j] != 0.0 and state.slide[j] == 0.0
        if slides:
            state.count[Count.SLIDES] += 1.0
        if touches < before:
            state.count[Count.OPENINGS] += 1.0
        if touches == 0.0 and before > 0.0:
            state.count[Count.LOSSES] += 1.0
    follow_joints(model, state, work, True, run.options.loss_limit)
    return True


@inlined
def cause_of(run):
    """Return why the mechanism ends: the Cause, and the joint of the chain, -1 for a tie."""
    joint = run.motion.trigger[0]
    law = run.motion.trigger[1]
    if joint >= run.state.slip.size:
        return Cause.TIE, -1
    if law == laws.SLIP_END:
        return Cause.STICK, joint
    if law in (laws.GAP_0, laws.GAP_1):
        return Cause.IMPACT, joint
    by_force = law in (laws.FORCE_0, laws.FORCE_1)
    at_0, at_1 = laws.touching(joint, run.state)
    if at_0 and at_1:
        return (Cause.HINGE if by_force else Cause.SLIDE), joint
    rough = math.isinf(run.model.friction[joint])
    return (Cause.LOSS if by_force or rough else Cause.SLIDE), joint


@inlined
def change_mode(run, cause, joint, law):
    """Change the mode of the joint or tie whose law has ended, to start the search for modes.

    `joint` and `law` are those of ``MechanismMotion.trigger``.
    """
    contact = run.work.contact
    slide = run.work.slide
    if cause == Cause.TIE:
        number = joint - slide.size
        yields = law == laws.FORCE_1
        breaks = law == laws.FRICTION_PLUS
        lost = change_pull(run.model, run.state, number, yields, breaks)
        run.state.energy[Energy.FRICTION] -= lost
    elif cause == Cause.STICK:
        slide[joint] = 0.0
    elif cause == Cause.HINGE:
        contact[joint, law - laws.FORCE_0] = 0.0
    elif cause == Cause.SLIDE:
        slide[joint] = 1.0 if law == laws.FRICTION_PLUS else -1.0
    elif cause == Cause.LOSS:
        contact[joint, 0] = contact[joint, 1] = slide[joint] = 0.0


@inlined
def fastest_of(run):
    """Return the largest speed of any body, with rotations times joint length [m/s].

    It is nan if a velocity is not finite.
    """
    fastest = spoiled = 0.0
    for i in range(1, run.state.velocity.shape[0] - 1):
        v = run.state.velocity[i]
        fastest = max(fastest, abs(v[0]) + abs(v[1]), run.motion.length * abs(v[2]))
        spoiled += 0.0 * (v[0] + v[1] + v[2])
    return fastest + spoiled
