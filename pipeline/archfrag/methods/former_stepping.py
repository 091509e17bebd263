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

from archfrag.mechanics.collapse import (
    JointState,
    collapse_of,
    follow_joints,
    new_joint_state,
    unregained_loss,
)
from archfrag.mechanics.compile import allocating, inlined, kernel
from archfrag.mechanics.energy import contact_works, kinetic_energy
from archfrag.mechanics.former_contact import newton_contact, path_contact
from archfrag.mechanics.kinematics import move_faces, place_contacts
from archfrag.mechanics.laws import touches
from archfrag.mechanics.ledger import (
    book_changes,
    book_motion,
    book_state,
    book_work,
    exhausted,
    log_change,
    makes_contact,
    new_ledger,
    write_frame,
)
from archfrag.mechanics.residuals import deepest_overlap, measure_state
from archfrag.mechanics.status import Cause, CollapseMode, Count, Energy, Model, Peak, Status
from archfrag.mechanics.types import (
    Chain,
    Frames,
    GroundMotion,
    Ledger,
    MechanismLog,
    Options,
    Outcome,
)
from archfrag.methods.rest import leave_rest, read_joints, rest_range, rest_reactions, rests
from archfrag.methods.stepping import (
    Clock,
    Stepper,
    change_of_step,
    finish_step,
    free_fall,
    kick_between,
    new_stepper,
    take_velocities,
    try_step,
    velocity_at_position,
)

STANDING = int(Status.STANDING)
COLLAPSED = int(Status.COLLAPSED)
UNFINISHED = int(Status.UNFINISHED)
NO_SOLUTION = int(Status.NO_CONTACT_SOLUTION)
NOT_FINITE = int(Status.NOT_FINITE)
WORK_BOUND = int(Status.WORK_BOUND)
NO_MODE = int(CollapseMode.NONE)
AT_REST, ALL = int(Model.REST), int(Model.ALL_VOUSSOIRS)
BY_START, BY_REST = int(Cause.START), int(Cause.REST)
# What else a stride may stop for, besides a status.
GO = -1
UNSOLVED = -2
PAUSE = -3

STILL = 1e-7
# Steps between looks for overlaps.
OVERLAP_INTERVAL = 8
FRESH_STEPS = 2
# A step whose contact problem is not solved is halved, down to this part of the nominal one.
SHORTEST = 1.0 / 100.0


class Case(NamedTuple):
    """What all steps of a run share."""

    chain: Chain
    ground: GroundMotion
    options: Options
    stepper: Stepper
    joints: JointState
    ledger: Ledger
    frames: Frames
    log: MechanismLog


@inlined
def _due_kick(case):
    clock = case.stepper.clock
    start = clock[Clock.TIME] - 0.5 * clock[Clock.PREVIOUS]
    end = clock[Clock.TIME] + 0.5 * clock[Clock.STEP]
    return kick_between(case.ground, case.stepper, start, end)


@inlined
def _book_contacts(case, extra):
    """Works and changes of mode in a step; `extra` is stray work [J] known otherwise.

    Returns
    -------
    cause, joint : int
        As `book_changes`.
    """
    stepper, joints = case.stepper, case.joints
    mode, fresh = stepper.work.mode, stepper.fresh
    for j in range(mode.size):
        if makes_contact(joints.mode[j], mode[j]):
            fresh[j] = FRESH_STEPS
    friction, impact, stray = contact_works(
        stepper.contacts, stepper.work, stepper.mean_relative, joints.mode, fresh
    )
    for j in range(mode.size):
        fresh[j] = max(fresh[j] - 1, 0)
    book_work(friction, impact, stray + extra, case.ledger)
    return book_changes(joints.mode, mode, case.ledger)


@inlined
def _collapse(case, position):
    """Joint, mode and time of a collapse, as `collapse_of`."""
    stepper = case.stepper
    return collapse_of(
        position, stepper.before, stepper.after, stepper.length, case.joints,
        case.options.loss_limit, stepper.clock[Clock.TIME],
    )  # fmt: skip


@inlined
def _write_frame(case, position, velocity, span):
    write_frame(
        case.frames, case.ledger, case.stepper.clock[Clock.TIME], case.chain, position, velocity,
        case.stepper.work.reaction, case.stepper.work.mode, span,
    )  # fmt: skip


@inlined
def _write_if_due(case, position, velocity, kick):
    """Frame of the instant from which a solved step sets out, before it is made."""
    clock = case.stepper.clock
    if case.frames.time.size == 0 or clock[Clock.TIME] < clock[Clock.NEXT_FRAME]:
        return
    velocity_at_position(
        case.stepper, velocity, clock[Clock.PREVIOUS], clock[Clock.STEP], case.stepper.mean
    )
    _write_frame(case, position, case.stepper.mean, kick.span)
    due = clock[Clock.TIME] + case.options.frame_interval
    clock[Clock.NEXT_FRAME] = due - 0.5 * case.options.time_step


@allocating
def _write_rest(case, position, velocity):
    """Frame of the chain at rest, with the reactions that balance the body force."""
    if case.frames.time.size == 0:
        return
    time = case.stepper.clock[Clock.TIME]
    rest_reactions(case.chain, case.ground, case.stepper, case.joints, position, time)
    _write_frame(case, position, velocity, 1.0)


@inlined
def _accept(case, position, velocity, kick):
    """Make a step whose contact problem is solved, and book it.

    Returns
    -------
    int
        GO, PAUSE or how the run ended.
    """
    chain, stepper, ledger = case.chain, case.stepper, case.ledger
    clock = stepper.clock
    step, previous = clock[Clock.STEP], clock[Clock.PREVIOUS]
    clock[Clock.SPAN] = kick.span
    _write_if_due(case, position, velocity, kick)
    given = finish_step(chain, stepper, position, velocity, kick, step)
    ledger.energy[Energy.GROUND] += given
    extra = change_of_step(chain, stepper, velocity, kick, step, previous)
    cause, joint = _book_contacts(case, extra)
    follow_joints(
        stepper.work.mode, position, stepper.before, stepper.after, stepper.length,
        clock[Clock.TIME], case.joints,
    )  # fmt: skip
    ledger.model_time[Model.ALL_VOUSSOIRS] += step
    clock[Clock.TIME] += step
    clock[Clock.PREVIOUS], clock[Clock.STEP] = step, case.options.time_step
    clock[Clock.CALM] += 1.0
    if cause >= 0:
        clock[Clock.CALM] = 0.0
        log_change(case.log, ledger, clock[Clock.TIME], cause, joint, ALL, case.joints.mode)
    fastest = book_motion(chain, position, velocity, stepper.length[0], ledger)
    clock[Clock.FASTEST] = fastest
    if np.isnan(fastest):
        return NOT_FINITE
    if _collapse(case, position)[0] >= 0:
        return COLLAPSED
    count = ledger.count[Count.STEPS]
    if count % OVERLAP_INTERVAL == 0:
        overlap = deepest_overlap(stepper.before, stepper.after, stepper.length)
        ledger.peak[Peak.OVERLAP] = max(ledger.peak[Peak.OVERLAP], overlap)
    measures = count % case.options.check_interval == 0
    return PAUSE if measures or fastest < stepper.clock[Clock.STILL] else GO


@kernel
def _stride(case, position, velocity, until, calm_steps):
    """Step for as long as nothing but the Newton iteration is needed.

    Returns
    -------
    int
        UNSOLVED where it finds no solution, PAUSE, or a status.
    """
    clock, count = case.stepper.clock, case.ledger.count
    while clock[Clock.TIME] < until and (calm_steps == 0 or clock[Clock.CALM] < calm_steps):
        if exhausted(case.ledger, case.options):
            return WORK_BOUND
        kick = _due_kick(case)
        solved, iterations = try_step(
            case.chain, case.stepper, case.joints, position, velocity, kick, clock[Clock.STEP]
        )
        count[Count.STEPS] += 1
        count[Count.ITERATIONS] += iterations
        if solved != STANDING:
            return UNSOLVED
        code = _accept(case, position, velocity, kick)
        if code != GO:
            return code
    return UNFINISHED


@allocating
def _solve_by_path(case, position, velocity):
    """Follow the solution's path where Newton failed: make the step, or halve it.

    Returns
    -------
    int
        As `_accept`.
    """
    chain, stepper, count = case.chain, case.stepper, case.ledger.count
    clock = stepper.clock
    solved, iterations, breaks, soft = path_contact(
        chain.mass, chain.inertia, stepper.contacts, chain.friction, stepper.free, stepper.work
    )
    count[Count.ITERATIONS] += iterations
    count[Count.PATHS] += breaks > 0
    count[Count.COMPLIANT] += soft
    if solved == STANDING:
        code = _accept(case, position, velocity, _due_kick(case))
        if soft:
            _measure_state(case, position, velocity)
        return code
    if clock[Clock.STEP] < SHORTEST * case.options.time_step:
        return NO_SOLUTION
    clock[Clock.STEP] *= 0.5
    count[Count.SHORTENED] += 1
    stepper.work.mode[:] = case.joints.mode
    return GO


@allocating
def _measure_state(case, position, velocity):
    """Note how far the state that the last step reached is from the contact laws."""
    stepper = case.stepper
    measure_state(
        case.chain, position, velocity, stepper.before, stepper.after, stepper.length,
        case.joints.slip, stepper.work.reaction, stepper.work.pivot, stepper.clock[Clock.SPAN],
        stepper.contacts, stepper.work.relative, case.ledger.peak,
    )  # fmt: skip


@allocating
def _pause(case, position, velocity):
    """Between two steps: measure the residual if it is due, and see whether the chain rests.

    Returns
    -------
    int
        GO or STANDING.
    """
    stepper, ledger = case.stepper, case.ledger
    clock = stepper.clock
    if ledger.count[Count.STEPS] % case.options.check_interval == 0:
        _measure_state(case, position, velocity)
    if clock[Clock.FASTEST] >= clock[Clock.STILL]:
        return GO
    time = clock[Clock.TIME]
    if not rests(case.chain, case.ground, stepper, case.joints, position, time):
        return GO
    stops = -kinetic_energy(case.chain.mass, case.chain.inertia, velocity)
    for i in range(position.shape[0]):
        lead = 0.5 * clock[Clock.PREVIOUS] * velocity[i, 1]
        stops += case.chain.gravity * case.chain.mass[i] * lead
    book_work(0.0, 0.0, stops, ledger)
    velocity[:] = 0.0
    ledger.count[Count.RESTS] += 1
    _write_rest(case, position, velocity)
    log_change(case.log, ledger, time, BY_REST, -1, AT_REST, case.joints.mode)
    return STANDING


@allocating
def _synchronise(case, position, velocity):
    """Give velocities the half kick that is due, so that they belong to the positions.

    Returns
    -------
    bool
        Whether the contact problem of these velocities was solved; else they stay as they were.
    """
    chain, stepper, joints = case.chain, case.stepper, case.joints
    clock, contacts, work = stepper.clock, stepper.contacts, stepper.work
    previous = clock[Clock.PREVIOUS]
    if previous == 0.0:
        work.reaction[:] = 0.0
        clock[Clock.SPAN] = 1.0
        return True
    now = clock[Clock.TIME]
    kick = kick_between(case.ground, stepper, now - 0.5 * previous, now)
    place_contacts(position, stepper.before, stepper.after, joints.slip, stepper.length, contacts)
    contacts.bias[:] = 0.0
    for j in range(joints.mode.size):
        for c in range(2):
            contacts.candidate[j, c] = touches(joints.mode[j], c)
    free_fall(velocity, kick, chain.gravity, stepper.free)
    solved, _ = newton_contact(
        chain.mass, chain.inertia, contacts, chain.friction, stepper.free, work
    )
    if solved != STANDING:
        solved, _, _, _ = path_contact(
            chain.mass, chain.inertia, contacts, chain.friction, stepper.free, work
        )
    if solved != STANDING:
        return False
    case.ledger.energy[Energy.GROUND] += take_velocities(chain, stepper, velocity, kick)
    friction, impact, stray = contact_works(
        contacts, work, stepper.mean_relative, joints.mode, stepper.fresh
    )
    stray += change_of_step(chain, stepper, velocity, kick, 0.0, previous)
    book_work(friction, impact, stray, case.ledger)
    clock[Clock.PREVIOUS], clock[Clock.SPAN] = 0.0, kick.span
    return True


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
    stepper : archfrag.methods.stepping.Stepper
    joints : archfrag.mechanics.collapse.JointState
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
    case = Case(chain, ground, options, stepper, joints, ledger, frames, log)
    clock = stepper.clock
    clock[Clock.TIME], clock[Clock.PREVIOUS] = time, 0.0
    clock[Clock.STEP], clock[Clock.CALM] = options.time_step, 0.0
    clock[Clock.STILL] = STILL * np.sqrt(chain.gravity * np.max(stepper.length))
    stepper.work.mode[:] = joints.mode
    stepper.fresh[:] = 0
    move_faces(chain, position, stepper.before, stepper.after)
    code = GO
    while code == GO:
        code = _stride(case, position, velocity, until, calm_steps)
        if code == UNSOLVED:
            code = _solve_by_path(case, position, velocity)
        if code == PAUSE:
            code = _pause(case, position, velocity)
    if code == UNFINISHED and not _synchronise(case, position, velocity):
        code = NO_SOLUTION
    if code == COLLAPSED and _synchronise(case, position, velocity):
        _write_frame(case, position, velocity, clock[Clock.SPAN])
    # The potential belongs to the instant of the velocities.
    for i in range(position.shape[0]):
        for k in range(3):
            lead = 0.5 * clock[Clock.PREVIOUS] * velocity[i, k]
            stepper.trial[i, k] = position[i, k] - lead
    book_state(chain, stepper.trial, velocity, clock[Clock.START_POTENTIAL], ledger)
    collapse_joint, collapse_mode, collapse_time = -1, NO_MODE, np.nan
    if code == COLLAPSED:
        collapse_joint, collapse_mode, collapse_time = _collapse(case, position)
    return code, clock[Clock.TIME], collapse_time, collapse_joint, collapse_mode


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
    clock = stepper.clock
    case = Case(chain, ground, options, stepper, joints, ledger, frames, log)
    stop = (ground.horizontal.size - 1) * ground.time_step + options.follow
    time, status = 0.0, UNFINISHED
    collapse_time, collapse_joint, collapse_mode = np.nan, -1, NO_MODE
    book_state(chain, position, velocity, clock[Clock.START_POTENTIAL], ledger)
    move_faces(chain, position, stepper.before, stepper.after)
    resting = from_rest and rest_range(chain, position, joints, stepper)
    if not from_rest:
        read_joints(chain, stepper, joints, position)
    if resting:
        _write_rest(case, position, velocity)
        clock[Clock.NEXT_FRAME] = options.frame_interval
    else:
        log_change(log, ledger, time, BY_START, -1, ALL, joints.mode)
    while True:
        if resting:
            leave, for_good = leave_rest(chain, ground, stepper.rest, time)
            ledger.model_time[Model.REST] += leave - time
            time = clock[Clock.TIME] = leave
            velocity[:] = 0.0
            if for_good:
                status = STANDING
                break
            clock[Clock.NEXT_FRAME] = leave
            log_change(log, ledger, time, BY_START, -1, ALL, joints.mode)
        status, time, collapse_time, collapse_joint, collapse_mode = advance(
            chain, ground, options, stepper, joints, ledger, frames, log, position, velocity,
            time, stop, 0,
        )  # fmt: skip
        resting = status == STANDING
        if not resting:
            break
    if status == UNFINISHED:
        _write_frame(case, position, velocity, clock[Clock.SPAN])
        collapse_joint, collapse_mode, collapse_time = unregained_loss(
            position, stepper.before, stepper.after, stepper.length, joints, time
        )
        if collapse_joint >= 0:
            status = COLLAPSED
    return Outcome(
        status, time, collapse_time, collapse_joint, collapse_mode, joints.loss, ledger
    )  # fmt: skip
