"""Event-driven integration on mega-voussoirs: a run as a table of phases.

Between events the mega-voussoirs that move relative to each other are integrated by a Runge-Kutta
method with step control (`integrate`), every event is located on its dense output (`events`), and
what follows it is the contact problem of all voussoirs (`transitions`). While the body force
stays inside the range of rest nothing is integrated. Where events accumulate faster than they
can be distinguished (a rocking body comes to rest through infinitely many impacts), or where a
mechanism has no unique motion, all voussoirs are stepped for a while
(`archfrag.physics.steps`).
"""

import numpy as np

from archfrag.physics import shared
from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact.placing import move_faces
from archfrag.physics.contact.ties import stretch_yielding
from archfrag.physics.energy import balance_energy, energies_of
from archfrag.physics.events import transitions
from archfrag.physics.events.integrate import (
    BOUND,
    COLLAPSES,
    EVENT,
    REGROUPED,
    STOPPED,
    Progress,
    begin_motion,
    integrate,
    recover_reactions,
    recover_voussoirs,
)
from archfrag.physics.events.locate import NONE
from archfrag.physics.ground import end_of_motion, ground_after, segment_at
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.mega_voussoirs import assemble
from archfrag.physics.mega_voussoirs.first_level import is_four_hinges, pose
from archfrag.physics.mega_voussoirs.second_level import GAP_0
from archfrag.physics.state import Clock
from archfrag.physics.status import Cause, Count, Energy, Level, Peak
from archfrag.physics.steps import service
from archfrag.physics.steps.run import start_at_rest, step_one
from archfrag.physics.steps.step import record_overlap

BY_ACCUMULATION = int(Cause.ACCUMULATION)
BY_QUIESCENCE = int(Cause.QUIESCENT)
BY_UNSOLVED = int(Cause.UNSOLVED)
FOUR = int(Level.FOUR_HINGES)
MEGA = int(Level.MEGA_VOUSSOIRS)
# Phases of a run: those that follow each other from event to event, and the others.
IMPACT = 0
MODES = 1
ASSEMBLE = 2
INTEGRATE = 3
UPON_EVENT = 4
STILL = 5
ALL_VOUSSOIRS = 6
DONE = 7
# So many events within this part of that time accumulate; and so many closer to each other than
# the options allow.
ACCUMULATION = 64
ACCUMULATED = 1e-2
SOME = 12
# All voussoirs are stepped for this part of that time, or until nothing changes in so many steps.
# Where they have to be again at once both are doubled, up to these.
WINDOW = 0.05
LONGEST_WINDOW = 1.0
QUIESCENT_STEPS = 4.0
MOST_QUIESCENT_STEPS = 64.0
# Every so many events the residual of the contact problem behind them is measured.
MEASURED = 16


@inlined
def _unit(run):
    return run.motion.length / run.motion.speed


@inlined
def _set_cause(run, cause, joint):
    run.progress[Progress.CAUSE] = cause
    run.progress[Progress.JOINT] = joint


@kernel
def impact(run):
    """Solve for velocities after an impact (Eqs 8, 9, 11, 21).

    Reads: run.
    Writes: run.
    """
    trigger = run.motion.trigger
    joint = -1
    corner = -1
    if run.progress[Progress.CAUSE] == transitions.BY_IMPACT:
        joint = trigger[0]
        corner = trigger[1] - GAP_0
    trigger[0] = NONE
    model = run.model
    state = run.state
    work = run.work
    if transitions.pose_impact(run, joint, corner) and not transitions.solve_posed(
        model, state, work, run.path
    ):
        return ALL_VOUSSOIRS
    transitions.take_impact(run)
    return MODES


@kernel
def modes_of_accelerations(run):
    """Find the contact modes from now on (Eqs 15-19, 29-35).

    Reads: run.
    Writes: run.
    """
    trigger = run.motion.trigger
    if run.progress[Progress.SWITCH] == BY_ACCUMULATION:
        return ALL_VOUSSOIRS
    ground = transitions.ground_now(run, run.progress[Progress.LEAVES_REST] == 1.0)
    run.progress[Progress.JAMMED] = (
        1.0 if transitions.pose_accelerations(run, ground) else 0.0
    )
    if trigger[0] != NONE:
        transitions.change_mode(
            run, int(run.progress[Progress.CAUSE]), trigger[0], trigger[1]
        )
        trigger[0] = NONE
    model = run.model
    state = run.state
    work = run.work
    solved = transitions.solve_posed(model, state, work, run.path)
    return ASSEMBLE if solved and transitions.take_modes(run) else ALL_VOUSSOIRS


@kernel
def assemble_mega_voussoirs(run, output):
    """Assemble mega-voussoirs of the present modes (section 3.3).

    Reads: run, output (log, log.time, written).
    Writes: run, output (log.cause, log.joint, log.mode, log.model, log.time, written).
    """
    model = run.model
    state = run.state
    work = run.work
    progress = run.progress
    clock = state.clock
    motion = run.motion
    clock[Clock.FASTEST] = transitions.fastest_of(run)
    if np.isnan(clock[Clock.FASTEST]):
        clock[Clock.CODE] = shared.BROKEN
        return DONE
    had = balance_energy(model, state)
    if (
        clock[Clock.FASTEST] < run.options.still
        and progress[Progress.LEAVES_REST] == 0.0
    ):
        return STILL
    progress[Progress.LEAVES_REST] = 0.0
    if int(state.count[Count.EVENTS]) % MEASURED == MEASURED - 1:
        service.measure_state(model, state, work)
        record_overlap(model, state, work, True)
    assemble.assemble(model, state.contact, state.slide, state.slip, run.mega)
    mega = assemble.in_use(run.mega)
    assemble.gather_state(model, state.position, state.velocity, mega)
    assemble.split_state(mega, mega.position, mega.velocity, work.position, work.solved)
    moved = assemble.farthest_move(model, state.position, work.position)
    if mega.count[0] == 0 or not moved <= REGROUPED * motion.length:
        state.count[Count.REFUSED] += 1.0 if mega.count[0] > 0 else 0.0
        return ALL_VOUSSOIRS
    ground = segment_at(clock[Clock.TIME], run.grounds)
    if not begin_motion(run, mega, ground):
        return ALL_VOUSSOIRS
    if progress[Progress.JAMMED] == 1.0:
        # What a corner without friction limit loses by sticking it loses by an impact.
        recover_voussoirs(mega, mega.position, mega.velocity, run.state)
        left, _ = energies_of(model, state)
        state.energy[Energy.IMPACT] += min(left - had, 0.0)
    level = FOUR if is_four_hinges(mega.work, mega.position.shape[0]) else MEGA
    cause = int(progress[Progress.CAUSE])
    joint = int(progress[Progress.JOINT])
    shared.log_change(state, clock[Clock.TIME], cause, joint, level, output)
    return INTEGRATE


@kernel
def integrate_to_next_event(run, output):
    """Integrate mega-voussoirs until the next event (section 3.5).

    Reads: run, output (due, frames, frames.time, interval, written).
    Writes: run, output.
    """
    model = run.model
    state = run.state
    work = run.work
    clock = run.state.clock
    mega = assemble.in_use(run.mega)
    before = clock[Clock.TIME]
    record_end = end_of_motion(run.grounds, clock, 0.0)
    end = record_end + run.options.follow
    code = integrate(run, mega, record_end if before < record_end else end, output)
    level = is_four_hinges(mega.work, mega.position.shape[0])
    spent = Progress.FOUR_HINGES if level else Progress.MEGA_VOUSSOIRS
    run.progress[spent] += clock[Clock.TIME] - before
    pose(mega, mega.position)
    recover_voussoirs(mega, mega.position, mega.velocity, run.state)
    state.energy[Energy.FRICTION] -= stretch_yielding(model, state)
    if code == EVENT:
        return UPON_EVENT
    run.motion.trigger[0] = NONE
    transitions.place_voussoirs(run.model, run.state, run.work)
    if code == STOPPED and clock[Clock.TIME] < end:
        return MODES
    if code != STOPPED and code != COLLAPSES and code != BOUND:
        return ALL_VOUSSOIRS
    balance_energy(model, state)
    clock[Clock.FASTEST] = transitions.fastest_of(run)
    ground = ground_after(segment_at(clock[Clock.TIME], run.grounds), 0.0)
    recover_reactions(run, mega, mega.position, mega.velocity, ground)
    clock[Clock.CODE] = shared.AT_END if code == STOPPED else shared.EXHAUSTED
    if code == COLLAPSES:
        follow_joints(model, state, work, True, run.options.loss_limit)
        clock[Clock.CODE] = shared.COLLAPSES
    written = output.written
    frames = output.frames
    if (
        0 < written[0] <= frames.time.size
        and frames.time[written[0] - 1] >= clock[Clock.TIME]
    ):
        written[0] -= 1  # the last frame is written again
    return DONE


@inlined
def impact_or_mechanism_change(run):
    """Classify an event, and detect whether events accumulate."""
    state = run.state
    progress = run.progress
    recent = run.recent
    cause, joint = transitions.cause_of(run)
    _set_cause(run, cause, joint)
    state.count[Count.EVENTS] += 1.0
    time = state.clock[Clock.TIME]
    slot = int(state.count[Count.EVENTS]) % ACCUMULATION
    many = time - recent[slot]
    some = time - recent[slot - SOME]
    recent[slot] = time
    if many < ACCUMULATED * _unit(run) or some < SOME * run.options.crowding:
        progress[Progress.SWITCH] = BY_ACCUMULATION
    if cause == transitions.BY_IMPACT:
        return IMPACT
    transitions.place_voussoirs(run.model, run.state, run.work)
    return MODES


@kernel
def go_on(run, output, phase):
    """Go from event to event, phase by phase, until another kind of phase is due.

    Reads: run, output.
    Writes: run, output.
    """
    while phase <= UPON_EVENT:
        if phase == IMPACT:
            phase = impact(run)
        elif phase == MODES:
            phase = modes_of_accelerations(run)
        elif phase == ASSEMBLE:
            phase = assemble_mega_voussoirs(run, output)
        elif phase == INTEGRATE:
            phase = integrate_to_next_event(run, output)
        else:
            phase = impact_or_mechanism_change(run)
    return phase


@inlined
def step_until(run, until, output):
    """Step all voussoirs while their modes go on changing."""
    clock = run.state.clock
    count = run.state.count
    end = end_of_motion(run.grounds, clock, run.options.follow)
    quiet = 0.0
    while clock[Clock.CODE] == shared.GO and clock[Clock.TIME] < until:
        before = count[Count.IMPACTS] + count[Count.OPENINGS] + count[Count.SLIDES]
        step_one(run, end, output)
        after = count[Count.IMPACTS] + count[Count.OPENINGS] + count[Count.SLIDES]
        quiet = quiet + 1.0 if after == before else 0.0
        if quiet >= run.progress[Progress.QUIESCENT_STEPS]:
            return True
    return clock[Clock.TIME] >= until


@kernel
def step_all_voussoirs(run, output):
    """Step all voussoirs for a while after events accumulate or a mechanism is not found.

    Reads: run, output.
    Writes: run, output.
    """
    model = run.model
    state = run.state
    work = run.work
    progress = run.progress
    clock = state.clock
    unit = _unit(run)
    state.count[Count.SWITCHES] += 1.0
    balance_energy(
        model, state
    )  # what the events before have missed belongs to this instant
    again = clock[Clock.TIME] < progress[Progress.QUIESCENT_UNTIL]
    window = WINDOW * unit
    quiet = QUIESCENT_STEPS
    if again:
        window = min(2.0 * progress[Progress.WINDOW], LONGEST_WINDOW * unit)
        quiet = min(2.0 * progress[Progress.QUIESCENT_STEPS], MOST_QUIESCENT_STEPS)
    progress[Progress.WINDOW] = window
    progress[Progress.QUIESCENT_STEPS] = quiet
    cause = int(progress[Progress.SWITCH])
    joint = int(progress[Progress.JOINT])
    shared.log_change(state, clock[Clock.TIME], cause, joint, shared.ALL, output)
    move_faces(model, state.position, work.rotated, work.face, work.tangent)
    service.start_moving(state, run.options, output)
    work.known[:] = (
        0.0  # the sense of friction at slips in progress: no step may be held to it
    )
    clock[Clock.CODE] = shared.GO
    until = clock[Clock.TIME] + progress[Progress.WINDOW]
    quiescent = False
    while not quiescent:
        quiescent = step_until(run, until, output)
        if service.handle(run, output) != shared.GO:
            return DONE
    progress[Progress.QUIESCENT_UNTIL] = clock[Clock.TIME] + progress[Progress.WINDOW]
    for i in range(ACCUMULATION):
        run.recent[i] = -np.inf
    _set_cause(run, BY_QUIESCENCE, -1)
    progress[Progress.SWITCH] = BY_UNSOLVED
    progress[Progress.LEAVES_REST] = 0.0
    return IMPACT


@kernel
def rest_if_still(run, output):
    """Rest until the ground moves the chain, if the chain stays at rest now.

    Reads: run, output (frames, frames.time, log, log.time, written).
    Writes: run, output.
    """
    state = run.state
    rests = run.state.count[Count.RESTS]
    code = service.handle_pause(run, output)
    run.progress[Progress.LEAVES_REST] = 1.0
    if state.count[Count.RESTS] == rests:
        return ASSEMBLE
    state.clock[Clock.CODE] = code
    return leave_rest(run, code, output)


@inlined
def leave_rest(run, code, output):
    """Begin to move at the end of a rest."""
    if code == shared.IDLE:
        return DONE
    output.written[1] -= 1  # the mechanism that starts writes this entry of the log
    _set_cause(run, service.BY_START, -1)
    run.progress[Progress.LEAVES_REST] = 1.0
    transitions.place_voussoirs(run.model, run.state, run.work)
    return MODES


@kernel
def follow_phases(run, at_rest, output, results, row):
    """Run from beginning to end, phase by phase.

    Reads: run, output, results.peak.
    Writes: run, output, results.
    """
    model = run.model
    state = run.state
    work = run.work
    options = run.options
    state.clock[Clock.FACTOR] = 1.0
    if at_rest:
        start_at_rest(run, 0, 1.0, output)
        phase = leave_rest(run, int(state.clock[Clock.CODE]), output)
    else:
        shared.read_state(model, state, work)
        _set_cause(run, service.BY_START, -1)
        phase = IMPACT
    while phase != DONE:
        if phase <= UPON_EVENT:
            phase = go_on(run, output, phase)
        elif phase == STILL:
            phase = rest_if_still(run, output)
        else:
            phase = step_all_voussoirs(run, output)
    shared.end_run(model, state, work, options, output, results, row)
    results.model_time[row, FOUR] = run.progress[Progress.FOUR_HINGES]
    results.model_time[row, MEGA] = run.progress[Progress.MEGA_VOUSSOIRS]
    farthest = np.sqrt(run.progress[Progress.FARTHEST])
    results.peak[row, Peak.DISPLACEMENT] = max(
        results.peak[row, Peak.DISPLACEMENT], farthest
    )
