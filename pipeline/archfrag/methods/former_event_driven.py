"""Event-driven integration on mega-voussoirs.

Between events the few bodies that move relative to each other are integrated by a Runge-Kutta
method of order 5 with step control (`smooth`), every event is located on its dense output
(`events`), and what follows it is the contact problem of all voussoirs, by levels first
(`resolve`). While the body force stays inside the rest range nothing is integrated. Where events
accumulate faster than they can be told apart (a rocking body comes to rest through infinitely
many impacts), or where a mechanism's reactions are not unique, time stepping takes over for a
while and gives back.
"""

import numpy as np

from archfrag.mechanics.collapse import collapse_of, new_joint_state, note_loss, unregained_loss
from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.energy import kinetic_energy
from archfrag.mechanics.ground import rest_margin
from archfrag.mechanics.kinematics import move_faces
from archfrag.mechanics.laws import CLOSED_STICK, OPEN, is_closed
from archfrag.mechanics.ledger import close_account, log_change, new_ledger, write_frame
from archfrag.mechanics.levels import view_few
from archfrag.mechanics.mechanism import (
    assemble_mechanism,
    farthest_regrouped,
    gather_state,
    split_state,
)
from archfrag.mechanics.newton import is_finite
from archfrag.mechanics.reactions import inner_target, is_four_hinges
from archfrag.mechanics.status import Cause, CollapseMode, Count, Energy, Model, Peak, Status
from archfrag.mechanics.types import Outcome
from archfrag.methods.events import GAP, PASSING, SLIP_END, new_margins
from archfrag.methods.few_bodies import new_few_room, view_motion
from archfrag.methods.former_stepping import advance
from archfrag.methods.recording import record_state
from archfrag.methods.resolve import (
    measure_event,
    new_whole,
    place_whole,
    resolve_accelerations,
    resolve_impact,
    settle,
)
from archfrag.methods.rest import leave_rest, read_joints, rest_range, rest_reactions, rests
from archfrag.methods.smooth import (
    BOUND,
    BROKEN,
    COLLAPSE,
    EVENT,
    FIRST,
    REGROUPED,
    Pace,
    begin,
    find_breaks,
    integrate,
    segment_at,
)
from archfrag.methods.stepping import Clock, new_stepper

STANDING = int(Status.STANDING)
COLLAPSED = int(Status.COLLAPSED)
UNFINISHED = int(Status.UNFINISHED)
WORK_BOUND = int(Status.WORK_BOUND)
NOT_FINITE = int(Status.NOT_FINITE)
INACCURATE = int(Status.INACCURATE)
NO_MODE = int(CollapseMode.NONE)
BY_START, BY_HINGE, BY_SLIDE = int(Cause.START), int(Cause.HINGE), int(Cause.SLIDE)
BY_STICK, BY_IMPACT, BY_LOSS = int(Cause.STICK), int(Cause.IMPACT), int(Cause.LOSS)
BY_REST, BY_CROWD, BY_CALM = int(Cause.REST), int(Cause.CROWD), int(Cause.CALM)
BY_UNSOLVED = int(Cause.UNSOLVED)
AT_REST, FOUR, FEW = int(Model.REST), int(Model.FOUR_HINGES), int(Model.MEGA_VOUSSOIRS)
ALL = int(Model.ALL_VOUSSOIRS)
STILL = 1e-7
# Rest is left where the load is beyond its range by this part of gravity.
BEYOND = 1e-7
# First look ahead for that, over the time of a fall through a joint's length.
SOONEST = 1e-9
# Rocking slower than this times the root of the tolerance, over the speed of a fall, has settled:
# what is left out is of the second order. Below the other its flights are shorter than the gaps
# to which impacts are located.
SLOW = 1e-1
SLOWEST = 3e-6
# So many events within this part of the time of a fall through a joint's length are a crowd; and
# so many closer to each other than the options allow.
CROWD = 64
CROWDED = 1e-2
SOME = 12
# Time stepping goes on for this part of that time, or until nothing changes in so many steps.
WINDOW = 0.05
CALM_STEPS = 4
# Where it has to take over again at once both are doubled, up to these.
LONGEST_WINDOW = 1.0
MOST_CALM_STEPS = 64
# Every so many events the residual of the contact problem behind them is measured.
MEASURED = 16
# A run is refused that makes or loses more energy than this many times its accuracy, over the
# largest kinetic energy, or whose bodies overlap by more than this many times it, over a joint's
# length; less energy than ROUNDING times weight times length is rounding.
ENERGY_ALLOWED, LEAST_ENERGY = 10.0, 1e-2
OVERLAP_ALLOWED, LEAST_OVERLAP = 0.1, 1e-4
ROUNDING = 1e-12
RESTING = 0
RESOLVE = 1
START = 2
MOVING = 3
HAND = 4


@kernel
def _model(few):
    if is_four_hinges(few.work.mode, few.position.shape[0]):
        return FOUR
    return FEW


@kernel
def cause_of(margins, few):
    """Why the mechanism ends, and at which joint of the chain."""
    inner, k, q = margins.trigger[0], margins.trigger[1], margins.trigger[2]
    if inner == 1:
        return (BY_HINGE if q < 2 else BY_SLIDE), k
    joint = few.joint[k]
    if q == SLIP_END:
        return BY_STICK, joint
    if q == PASSING or q >= GAP:
        return BY_IMPACT, joint
    if margins.target[k, q] == OPEN:
        return BY_LOSS, joint
    if is_closed(few.work.mode[k]):
        return BY_HINGE, joint
    return BY_SLIDE, joint


@kernel
def _note_contacts(whole, joints, old, time, ledger):
    """Joints that lost all contact, and the last contact of the others."""
    for j in range(joints.mode.size):
        if joints.mode[j] == OPEN:
            if old[j] != OPEN:
                note_loss(j, time, whole.position, whole.length, joints)
                ledger.count[Count.LOSSES] += 1
        else:
            joints.last_contact[j] = joints.mode[j]
        old[j] = joints.mode[j]


@allocating
def _start_few(chain, whole, joints, margins, few_room, pace, ground, ledger):
    """Assemble the mechanism of the present modes.

    The margin is nan where it has no unique motion, or where the voussoirs would have to be moved
    to bear like that: such a state is refused and counted.
    """
    n, m = assemble_mechanism(chain, joints.mode, joints.slip, whole.length, whole.mechanism)
    gather_state(
        chain,
        whole.mechanism,
        whole.position,
        whole.velocity,
        whole.bodies.position,
        whole.bodies.velocity,
    )
    few = view_motion(whole.mechanism, chain.gravity, view_few(whole.bodies, n, m), few_room)
    worst = np.nan
    moved = farthest_regrouped(whole.mechanism, pace.length, whole.bodies.position, whole.position)
    if not moved <= REGROUPED * pace.length:
        ledger.count[Count.REFUSED] += n > 0
    elif n > 0:
        worst = begin(chain, whole.mechanism, few, margins, pace, ground)
    return few, worst


@allocating
def _settle(chain, whole, joints, margins, few_room, pace, ground, ledger):
    """Take slow rocking and slips as over, where bringing velocities there gives no energy."""
    slow = pace.falling * max(SLOW * np.sqrt(pace.tolerance), SLOWEST)
    modes = joints.mode.copy()
    if not settle(chain, whole, joints.mode, slow):
        return
    had = kinetic_energy(chain.mass, chain.inertia, whole.velocity)
    few, worst = _start_few(chain, whole, joints, margins, few_room, pace, ground, ledger)
    if few.position.shape[0] > 0:
        if (
            not worst > -np.inf
            or kinetic_energy(few.chain.mass, few.chain.inertia, few.velocity) > had
        ):
            joints.mode[:] = modes
            return
        split_state(whole.mechanism, few.position, few.velocity, whole.position, whole.velocity)
    else:
        whole.velocity[:] = 0.0
    left = kinetic_energy(chain.mass, chain.inertia, whole.velocity)
    ledger.energy[Energy.IMPACT] += left - had


@allocating
def _after_event(
    chain, whole, joints, few, margins, few_room, pace, ground, ground_x, ground_y, ledger
):
    """Resolve what the trigger says; False where no solution was found."""
    cause, joint = cause_of(margins, few)
    for k in range(few.joint.size):
        joints.slip[few.joint[k]] = few.slip[k]
    split_state(whole.mechanism, few.position, few.velocity, whole.position, whole.velocity)
    ledger.count[Count.EVENTS] += 1
    if cause == BY_IMPACT:
        k, q = margins.trigger[1], margins.trigger[2]
        if q != PASSING and joints.mode[joint] == OPEN:
            # The slip of a joint without contact is that of the corner which lands.
            place_whole(chain, whole, joints.slip, joints.mode)
        corner = q - GAP if q != PASSING else -1
        if not resolve_impact(
            chain, whole, joints.slip, joints.mode, joint if corner >= 0 else -1, corner, ledger
        ):
            return False
        _settle(chain, whole, joints, margins, few_room, pace, ground, ledger)
    elif cause == BY_STICK:
        mode = joints.mode[joint]
        joints.mode[joint] = CLOSED_STICK if is_closed(mode) else 1 + 3 * ((mode - 1) // 3)
    elif margins.trigger[0] == 1:
        joints.mode[joint] = inner_target(margins.trigger[2])
    else:
        joints.mode[joint] = margins.target[margins.trigger[1], margins.trigger[2]]
    return resolve_accelerations(
        chain, whole, joints.slip, joints.mode, ground_x, ground_y, ledger
    )


@kernel
def _look_ahead(time, ground, pace, gravity, plus, minus):
    """Ground acceleration just outside the rest range, after `time` [m/s2]."""
    end, gx, sx, gy, sy = segment_at(time, ground, pace.next_break)
    ahead = 0.0
    while True:
        x, y = gx + sx * ahead, gy + sy * ahead
        if rest_margin(x, y, gravity, plus, minus) < -BEYOND * gravity:
            return x, y
        if time + ahead >= end:
            return x, y
        ahead = min(max(2.0 * ahead, SOONEST * pace.length / pace.falling), end - time)


@allocating
def _comes_to_rest(chain, ground, whole, joints, stepper, time, falling):
    """Whether nothing moves, and the body force leaves it so; the range into the stepper."""
    fastest = 0.0
    for i in range(whole.velocity.shape[0]):
        v = whole.velocity[i]
        fastest = max(fastest, abs(v[0]) + abs(v[1]), whole.length[0] * abs(v[2]))
    if fastest > STILL * falling:
        return False
    move_faces(chain, whole.position, stepper.before, stepper.after)
    return rests(chain, ground, stepper, joints, whole.position, time)


@kernel
def is_accurate(chain, length, options, ledger):
    """Whether a run that ended is as good as its tolerance allows, by what it measured itself.

    Parameters
    ----------
    chain : Chain
    length : ndarray, (n_joint,) [m]
    options : Options
    ledger : Ledger

    Returns
    -------
    bool
        False where more energy than `ENERGY_ALLOWED` times the accuracy was made or lost, or
        bodies overlapped by more than `OVERLAP_ALLOWED` times it; an accuracy finer than the
        default counts as the default.
    """
    energy = ledger.energy
    allowed = max(ENERGY_ALLOWED * options.accuracy, LEAST_ENERGY)
    allowed *= max(energy[Energy.LARGEST_KINETIC], energy[Energy.START_KINETIC])
    allowed += ROUNDING * chain.gravity * np.sum(chain.mass) * np.max(length)
    if not energy[Energy.STRAY_PEAK] <= allowed:
        return False
    return ledger.peak[Peak.OVERLAP] <= max(OVERLAP_ALLOWED * options.accuracy, LEAST_OVERLAP)


@allocating
def _write_rest(chain, ground, stepper, whole, joints, time, frames, ledger):
    """Frame of the chain at rest, with the reactions that balance the body force."""
    if frames.time.size == 0:
        return
    move_faces(chain, whole.position, stepper.before, stepper.after)
    rest_reactions(chain, ground, stepper, joints, whole.position, time)
    write_frame(
        frames, ledger, time, chain, whole.position, whole.velocity, stepper.work.reaction,
        joints.mode, 1.0,
    )  # fmt: skip


@allocating
def _write_few(chain, ground, whole, joints, few, pace, frames, ledger):
    """Frame of the state that the mega-voussoirs have reached."""
    written = ledger.count[Count.FRAMES]
    if frames.time.size == 0 or (written > 0 and frames.time[written - 1] >= pace.clock[0]):
        return
    few.new_position[:] = few.position
    few.new_velocity[:] = few.velocity
    _, gx, _, gy, _ = segment_at(pace.clock[0], ground, pace.next_break)
    record_state(chain, whole, joints, few, gx, gy, frames, ledger, pace.clock[0])


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
    n_body, n_joint = chain.mass.size, chain.friction.size
    stepper = new_stepper(chain, ground, position)
    length = stepper.length
    whole = new_whole(n_body, n_joint, length)
    whole.position[:] = position
    whole.velocity[:] = velocity
    joints = new_joint_state(n_joint)
    ledger = new_ledger()
    ledger.energy[Energy.START_KINETIC] = kinetic_energy(chain.mass, chain.inertia, velocity)
    shortest = np.min(length)
    falling = np.sqrt(chain.gravity * shortest)
    pace = Pace(
        shortest,
        falling,
        1.0 / (chain.gravity * np.sum(chain.mass)),
        options.tolerance,
        find_breaks(ground),
        np.zeros(4),
        np.zeros(n_body),
    )
    clock = pace.clock
    unit = shortest / falling
    clock[1] = FIRST * unit
    margins = new_margins(n_joint)
    few_room = new_few_room(n_body, n_joint)
    old = joints.mode.copy()
    few, worst = _start_few(chain, whole, joints, margins, few_room, pace, ground, ledger)
    record_end = (ground.horizontal.size - 1) * ground.time_step
    stop = record_end + options.follow
    recent = np.full(CROWD, -np.inf)
    status = UNFINISHED
    collapse_time, collapse_joint, collapse_mode = np.nan, -1, NO_MODE
    window, calm_steps, calm_until = 0.0, CALM_STEPS, -np.inf
    cause, joint, why = BY_START, -1, BY_UNSOLVED
    leaves_rest = False
    move_faces(chain, position, stepper.before, stepper.after)
    phase = HAND
    if from_rest and rest_range(chain, position, joints, stepper):
        phase = RESTING
        _write_rest(chain, ground, stepper, whole, joints, 0.0, frames, ledger)
        clock[3] = options.frame_interval
    elif not from_rest:
        read_joints(chain, stepper, joints, position)
        old[:] = joints.mode
        # Which corners touch follows from the positions alone.
        joints.mode[:] = OPEN
        if resolve_impact(chain, whole, joints.slip, joints.mode, -1, -1, ledger):
            phase = RESOLVE
            ledger.count[Count.IMPACTS] = 0
        else:
            joints.mode[:] = old
    while True:
        if phase == RESTING:
            leave, for_good = leave_rest(chain, ground, stepper.rest, clock[0])
            ledger.model_time[Model.REST] += leave - clock[0]
            clock[0] = leave
            whole.velocity[:] = 0.0
            if for_good:
                status = STANDING
                break
            _write_rest(chain, ground, stepper, whole, joints, leave, frames, ledger)
            clock[3] = leave + options.frame_interval
            gx, gy = _look_ahead(
                leave, ground, pace, chain.gravity, stepper.rest[0], stepper.rest[1]
            )
            cause, joint = BY_START, -1
            leaves_rest = True
            phase = START
            if not resolve_accelerations(chain, whole, joints.slip, joints.mode, gx, gy, ledger):
                phase = HAND
        elif phase == RESOLVE:
            _, gx, _, gy, _ = segment_at(clock[0], ground, pace.next_break)
            phase = START
            if not resolve_accelerations(chain, whole, joints.slip, joints.mode, gx, gy, ledger):
                phase = HAND
        elif phase == START:
            if not is_finite(whole.velocity):
                status = NOT_FINITE
                break
            _note_contacts(whole, joints, old, clock[0], ledger)
            close_account(
                chain, whole.position, whole.velocity, stepper.clock[Clock.START_POTENTIAL], ledger
            )
            may_rest, leaves_rest = not leaves_rest, False
            if may_rest and _comes_to_rest(
                chain, ground, whole, joints, stepper, clock[0], falling
            ):
                phase = RESTING
                had = kinetic_energy(chain.mass, chain.inertia, whole.velocity)
                ledger.energy[Energy.IMPACT] -= had
                whole.velocity[:] = 0.0
                close_account(
                    chain, whole.position, whole.velocity, stepper.clock[Clock.START_POTENTIAL],
                    ledger,
                )  # fmt: skip
                _write_rest(chain, ground, stepper, whole, joints, clock[0], frames, ledger)
                ledger.count[Count.RESTS] += 1
                log_change(log, ledger, clock[0], BY_REST, -1, AT_REST, joints.mode)
                continue
            few, worst = _start_few(chain, whole, joints, margins, few_room, pace, ground, ledger)
            phase = MOVING if worst > -np.inf else HAND
            if phase == MOVING and whole.jam[0] == 1:
                # What a corner without friction limit loses by sticking it loses by an impact.
                left = kinetic_energy(few.chain.mass, few.chain.inertia, few.velocity)
                had = kinetic_energy(chain.mass, chain.inertia, whole.velocity)
                ledger.energy[Energy.IMPACT] += min(left - had, 0.0)
            whole.jam[0] = 0
            if phase == MOVING:
                log_change(log, ledger, clock[0], cause, joint, _model(few), joints.mode)
        elif phase == MOVING:
            before = clock[0]
            limit = record_end if before < record_end else stop
            code = integrate(
                chain, whole, joints, few, margins, pace, ground, limit, options, frames, ledger
            )
            ledger.model_time[_model(few)] += clock[0] - before
            if code == EVENT:
                cause, joint = cause_of(margins, few)
                _, gx, _, gy, _ = segment_at(clock[0], ground, pace.next_break)
                phase = START
                if not _after_event(
                    chain, whole, joints, few, margins, few_room, pace, ground, gx, gy, ledger
                ):
                    phase = HAND
                elif ledger.count[Count.EVENTS] % MEASURED == 0:
                    measure_event(chain, whole, joints.slip, ledger)
                slot = ledger.count[Count.EVENTS] % CROWD
                since = clock[0] - recent[slot - SOME]
                if clock[0] - recent[slot] < CROWDED * unit or since < SOME * options.crowding:
                    phase, why = HAND, BY_CROWD
                recent[slot] = clock[0]
                continue
            split_state(
                whole.mechanism, few.position, few.velocity, whole.position, whole.velocity
            )
            # The last evaluation may be that of a step that was not made.
            place_whole(chain, whole, joints.slip, joints.mode)
            close_account(
                chain, whole.position, whole.velocity, stepper.clock[Clock.START_POTENTIAL], ledger
            )
            if code == COLLAPSE:
                move_faces(chain, whole.position, whole.before, whole.after)
                collapse_joint, collapse_mode, collapse_time = collapse_of(
                    whole.position, whole.before, whole.after, length, joints,
                    options.loss_limit, clock[0],
                )  # fmt: skip
                # Where no joint has lost its contact, positions have ceased to be numbers.
                status = COLLAPSED if collapse_joint >= 0 else NOT_FINITE
                _write_few(chain, ground, whole, joints, few, pace, frames, ledger)
                break
            if code == BOUND:
                status = WORK_BOUND
                break
            if code == BROKEN:
                phase = HAND
            elif clock[0] >= stop:
                _write_few(chain, ground, whole, joints, few, pace, frames, ledger)
                break
            else:
                phase = RESOLVE
        else:
            leaves_rest = False
            ledger.count[Count.HAND_OVERS] += 1
            stepper.clock[Clock.NEXT_FRAME] = clock[3]
            if clock[0] < calm_until:
                window = min(2.0 * window, LONGEST_WINDOW * unit)
                calm_steps = min(2 * calm_steps, MOST_CALM_STEPS)
            else:
                window, calm_steps = WINDOW * unit, CALM_STEPS
            log_change(log, ledger, clock[0], why, joint, ALL, joints.mode)
            why = BY_UNSOLVED
            status, clock[0], collapse_time, collapse_joint, collapse_mode = advance(
                chain, ground, options, stepper, joints, ledger, frames, log, whole.position,
                whole.velocity, clock[0], min(clock[0] + window, stop), calm_steps,
            )  # fmt: skip
            clock[3] = max(clock[3], stepper.clock[Clock.NEXT_FRAME])
            calm_until = clock[0] + window
            old[:] = joints.mode
            if status == STANDING:
                phase = RESTING
            elif status != UNFINISHED or clock[0] >= stop:
                break
            elif resolve_impact(chain, whole, joints.slip, joints.mode, -1, -1, ledger):
                _settle(chain, whole, joints, margins, few_room, pace, ground, ledger)
                cause, joint = BY_CALM, -1
                phase = RESOLVE
            recent[:] = -np.inf
    peak = ledger.peak
    peak[Peak.DISPLACEMENT] = max(peak[Peak.DISPLACEMENT], np.sqrt(clock[2]))
    position[:] = whole.position
    velocity[:] = whole.velocity
    if status == UNFINISHED:
        move_faces(chain, position, whole.before, whole.after)
        collapse_joint, collapse_mode, collapse_time = unregained_loss(
            position, whole.before, whole.after, length, joints, clock[0]
        )
        if collapse_joint >= 0:
            status = COLLAPSED
    if status in (STANDING, COLLAPSED) and not is_accurate(chain, length, options, ledger):
        status = INACCURATE
        collapse_time, collapse_joint, collapse_mode = np.nan, -1, NO_MODE
    return Outcome(
        status, clock[0], collapse_time, collapse_joint, collapse_mode, joints.loss, ledger
    )  # fmt: skip
