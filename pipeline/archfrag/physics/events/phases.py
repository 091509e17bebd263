"""Event-driven integration on mega-voussoirs: a run as a table of phases.

Between events the mega-voussoirs that move relative to each other are integrated by a Runge-Kutta
method with step control (`integrate`), every event is located on its dense output (`locate`), and
what follows it is the contact problem of all voussoirs (`transitions`). While the body force stays
inside the range of rest nothing is integrated. Where events accumulate faster than they can be
distinguished (a rocking body comes to rest through infinitely many impacts), or where a mechanism
has no unique motion, all voussoirs are stepped for a while (`archfrag.physics.steps`).

The kernel of each phase returns the next `Phase`.
"""

import numpy as np

from archfrag.physics import shared
from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact.laws import GAP_0
from archfrag.physics.contact.path import new_path
from archfrag.physics.contact.placing import move_faces
from archfrag.physics.contact.ties import stretch_yielding
from archfrag.physics.energy import balance_energy, energies_of
from archfrag.physics.events import transitions
from archfrag.physics.events.integrate import (
    FIRST,
    REGROUPED,
    Progress,
    Run,
    begin_motion,
    integrate,
    recover_reactions,
    recover_voussoirs,
)
from archfrag.physics.events.locate import NONE, new_motion
from archfrag.physics.events.runge_kutta import FIFTH_ORDER, THIRD_ORDER
from archfrag.physics.ground import (
    Grounds,
    end_of_motion,
    ground_after,
    one_of,
    segment_at,
)
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.mega_voussoirs import assemble
from archfrag.physics.mega_voussoirs.first_level import is_four_hinges, pose
from archfrag.physics.state import Clock, Model, model_of, new_state, new_work
from archfrag.physics.status import (
    Cause,
    Count,
    Energy,
    Level,
    Peak,
    Phase,
    Stretch,
    Wait,
)
from archfrag.physics.steps import service
from archfrag.physics.steps.run import RIGID, UNKNOWN, rest_of, start_at_rest, step_one
from archfrag.physics.steps.step import record_overlap

# Tolerances above this are met by the method of order 3; an impact that only grazes needs order 5.
COARSE = 1e-3
# Steps that a run may take for each sample of the ground motion, for events and errors as well.
STEPS_PER_SAMPLE = 4
# Events accumulate if ACCUMULATION of them follow within ACCUMULATED times the time of a fall
# through a joint's length, or SOME of them more closely than the options allow.
ACCUMULATION = 64
ACCUMULATED = 1e-2
SOME = 12
# All voussoirs are stepped for WINDOW times the time of a fall through a joint's length, or until
# nothing changes in QUIESCENT_STEPS steps. If they have to be stepped again at once, both are
# doubled, up to LONGEST_WINDOW and MOST_QUIESCENT_STEPS.
WINDOW = 0.05
LONGEST_WINDOW = 1.0
QUIESCENT_STEPS = 4.0
MOST_QUIESCENT_STEPS = 64.0
# Every so many events the contact residual is measured.
MEASURED = 16


@inlined
def _unit(run):
    return run.motion.length / run.motion.speed


@inlined
def _set_cause(run, cause, joint):
    run.progress[Progress.CAUSE] = cause
    run.progress[Progress.JOINT] = joint


@inlined
def _log_change(run, cause, level, output):
    clock = run.state.clock
    joint = int(run.progress[Progress.JOINT])
    shared.log_change(run.state, clock[Clock.TIME], int(cause), joint, level, output)


@kernel
def impact(run):
    """Solve for the velocities after an impact (Eqs 8, 9, 11, 21)."""
    trigger = run.motion.trigger
    joint = -1
    corner = -1
    if run.progress[Progress.CAUSE] == Cause.IMPACT:
        joint = trigger[0]
        corner = trigger[1] - GAP_0
    trigger[0] = NONE
    if transitions.pose_impact(run, joint, corner) and not transitions.solve_posed(run):
        return Phase.ALL_VOUSSOIRS
    transitions.take_impact(run)
    return Phase.MODES


@kernel
def modes_of_accelerations(run):
    """Find the contact modes from now on (Eqs 15-19, 29-35)."""
    trigger = run.motion.trigger
    if run.progress[Progress.SWITCH] == Cause.ACCUMULATION:
        return Phase.ALL_VOUSSOIRS
    ground = transitions.ground_now(run, run.progress[Progress.LEAVES_REST] == 1.0)
    jammed = transitions.pose_accelerations(run, ground)
    run.progress[Progress.JAMMED] = 1.0 if jammed else 0.0
    if trigger[0] != NONE:
        cause = int(run.progress[Progress.CAUSE])
        transitions.change_mode(run, cause, trigger[0], trigger[1])
        trigger[0] = NONE
    if transitions.solve_posed(run) and transitions.take_modes(run):
        return Phase.ASSEMBLE
    return Phase.ALL_VOUSSOIRS


@kernel
def assemble_mega_voussoirs(run, output):
    """Assemble mega-voussoirs of the present modes (section 3.3)."""
    model = run.model
    state = run.state
    work = run.work
    progress = run.progress
    clock = state.clock
    clock[Clock.FASTEST] = transitions.fastest_of(run)
    fastest = clock[Clock.FASTEST]
    if np.isnan(fastest):
        clock[Clock.CODE] = Wait.BROKEN
        return Phase.DONE
    had = balance_energy(model, state)
    if fastest < run.options.still and progress[Progress.LEAVES_REST] == 0.0:
        return Phase.STILL
    progress[Progress.LEAVES_REST] = 0.0
    if int(state.count[Count.EVENTS]) % MEASURED == MEASURED - 1:
        service.measure_state(model, state, work)
        record_overlap(model, state, work, True)
    assemble.assemble(model, state.contact, state.slide, state.slip, run.mega)
    mega = assemble.in_use(run.mega)
    assemble.gather_state(model, state.position, state.velocity, mega)
    assemble.split_state(mega, mega.position, mega.velocity, work.position, work.solved)
    moved = assemble.farthest_move(model, state.position, work.position)
    if mega.count[0] == 0 or not moved <= REGROUPED * run.motion.length:
        if mega.count[0] > 0:
            state.count[Count.REFUSED] += 1.0
        return Phase.ALL_VOUSSOIRS
    ground = segment_at(clock[Clock.TIME], run.grounds)
    if not begin_motion(run, mega, ground):
        return Phase.ALL_VOUSSOIRS
    if progress[Progress.JAMMED] == 1.0:
        # What a corner without friction limit loses by sticking it loses by an impact.
        recover_voussoirs(mega, mega.position, mega.velocity, state)
        left, _ = energies_of(model, state)
        state.energy[Energy.IMPACT] += min(left - had, 0.0)
    four = is_four_hinges(mega.work, mega.position.shape[0])
    level = Level.FOUR_HINGES if four else Level.MEGA_VOUSSOIRS
    _log_change(run, progress[Progress.CAUSE], level, output)
    return Phase.INTEGRATE


@kernel
def integrate_to_next_event(run, output):
    """Integrate mega-voussoirs until the next event (section 3.5)."""
    model = run.model
    state = run.state
    clock = state.clock
    mega = assemble.in_use(run.mega)
    before = clock[Clock.TIME]
    record_end = end_of_motion(run.grounds, clock, 0.0)
    end = record_end + run.options.follow
    until = record_end if before < record_end else end
    code = integrate(run, mega, until, output)
    four = is_four_hinges(mega.work, mega.position.shape[0])
    spent = Progress.FOUR_HINGES if four else Progress.MEGA_VOUSSOIRS
    run.progress[spent] += clock[Clock.TIME] - before
    pose(mega, mega.position)
    recover_voussoirs(mega, mega.position, mega.velocity, state)
    state.energy[Energy.FRICTION] -= stretch_yielding(model, state)
    if code == Stretch.EVENT:
        return Phase.UPON_EVENT
    run.motion.trigger[0] = NONE
    transitions.place_voussoirs(run)
    if code == Stretch.STUCK:
        return Phase.ALL_VOUSSOIRS
    complete = code == Stretch.COMPLETE
    if complete and clock[Clock.TIME] < end:
        return Phase.MODES
    balance_energy(model, state)
    clock[Clock.FASTEST] = transitions.fastest_of(run)
    ground = ground_after(segment_at(clock[Clock.TIME], run.grounds), 0.0)
    recover_reactions(run, mega, mega.position, mega.velocity, ground)
    clock[Clock.CODE] = Wait.AT_END if complete else Wait.EXHAUSTED
    if code == Stretch.FALL:
        follow_joints(model, state, run.work, True, run.options.loss_limit)
        clock[Clock.CODE] = Wait.COLLAPSES
    n = output.written[0]
    shown = output.frames.time
    if 0 < n <= shown.size and shown[n - 1] >= clock[Clock.TIME]:
        output.written[0] -= 1  # the last frame is written again
    return Phase.DONE


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
        progress[Progress.SWITCH] = Cause.ACCUMULATION
    if cause == Cause.IMPACT:
        return Phase.IMPACT
    transitions.place_voussoirs(run)
    return Phase.MODES


@inlined
def _changes(count):
    return count[Count.IMPACTS] + count[Count.OPENINGS] + count[Count.SLIDES]


@inlined
def step_until(run, until, output):
    """Step all voussoirs until their modes stop changing, at most until the time `until` [s].

    Return False if the run waits or ends before.
    """
    clock = run.state.clock
    end = end_of_motion(run.grounds, clock, run.options.follow)
    quiet = 0.0
    while clock[Clock.CODE] == Wait.GO and clock[Clock.TIME] < until:
        before = _changes(run.state.count)
        step_one(run, end, output)
        quiet = quiet + 1.0 if _changes(run.state.count) == before else 0.0
        if quiet >= run.progress[Progress.QUIESCENT_STEPS]:
            return True
    return clock[Clock.TIME] >= until


@kernel
def step_all_voussoirs(run, output):
    """Step all voussoirs for a while after events accumulate or a mechanism is not found."""
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
    window = WINDOW * unit
    quiet = QUIESCENT_STEPS
    if clock[Clock.TIME] < progress[Progress.QUIESCENT_UNTIL]:
        window = min(2.0 * progress[Progress.WINDOW], LONGEST_WINDOW * unit)
        quiet = min(2.0 * progress[Progress.QUIESCENT_STEPS], MOST_QUIESCENT_STEPS)
    progress[Progress.WINDOW] = window
    progress[Progress.QUIESCENT_STEPS] = quiet
    _log_change(run, progress[Progress.SWITCH], Level.ALL_VOUSSOIRS, output)
    move_faces(model, state.position, work)
    service.start_moving(state, run.options, output)
    work.known[:] = (
        0.0  # the sense of friction at slips in progress: no step may be held to it
    )
    clock[Clock.CODE] = Wait.GO
    until = clock[Clock.TIME] + window
    quiescent = False
    while not quiescent:
        quiescent = step_until(run, until, output)
        if service.handle(run, output) != Wait.GO:
            return Phase.DONE
    progress[Progress.QUIESCENT_UNTIL] = clock[Clock.TIME] + progress[Progress.WINDOW]
    run.recent[:] = -np.inf
    _set_cause(run, Cause.QUIESCENT, -1)
    progress[Progress.SWITCH] = Cause.UNSOLVED
    progress[Progress.LEAVES_REST] = 0.0
    return Phase.IMPACT


@kernel
def rest_if_still(run, output):
    """Let the chain rest until the ground moves it, if it stays at rest now."""
    state = run.state
    rests = run.state.count[Count.RESTS]
    code = service.handle_pause(run, output)
    run.progress[Progress.LEAVES_REST] = 1.0
    if state.count[Count.RESTS] == rests:
        return Phase.ASSEMBLE
    state.clock[Clock.CODE] = code
    return leave_rest(run, code, output)


@inlined
def leave_rest(run, code, output):
    """Begin to move at the end of a rest; `code` is the `Wait` with which the rest ended."""
    if code == Wait.IDLE:
        return Phase.DONE
    output.written[1] -= 1  # the mechanism that starts writes this entry of the log
    _set_cause(run, Cause.START, -1)
    run.progress[Progress.LEAVES_REST] = 1.0
    transitions.place_voussoirs(run)
    return Phase.MODES


@kernel
def follow_phases(run, at_rest, output, results, row):
    """Make one run from beginning to end, phase by phase.

    `at_rest` says whether it starts at rest. Its outcome goes into row `row` of `results`.
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
        _set_cause(run, Cause.START, -1)
        phase = Phase.IMPACT
    while phase != Phase.DONE:
        if phase == Phase.IMPACT:
            phase = impact(run)
        elif phase == Phase.MODES:
            phase = modes_of_accelerations(run)
        elif phase == Phase.ASSEMBLE:
            phase = assemble_mega_voussoirs(run, output)
        elif phase == Phase.INTEGRATE:
            phase = integrate_to_next_event(run, output)
        elif phase == Phase.UPON_EVENT:
            phase = impact_or_mechanism_change(run)
        elif phase == Phase.STILL:
            phase = rest_if_still(run, output)
        else:
            phase = step_all_voussoirs(run, output)
    shared.end_run(model, state, work, options, output, results, row)
    spent = results.model_time[row]
    spent[Level.FOUR_HINGES] = run.progress[Progress.FOUR_HINGES]
    spent[Level.MEGA_VOUSSOIRS] = run.progress[Progress.MEGA_VOUSSOIRS]
    peak = results.peak[row]
    farthest = np.sqrt(run.progress[Progress.FARTHEST])
    peak[Peak.DISPLACEMENT] = max(peak[Peak.DISPLACEMENT], farthest)


def new_run(
    model: Model, grounds: Grounds, options: Options, rest: tuple[float, float]
) -> Run:
    """Set up a run under one ground motion; `rest` has the limits of its range of rest [g]."""
    scheme = THIRD_ORDER if options.tolerance > COARSE else FIFTH_ORDER
    motion = new_motion(model, scheme, options.tolerance)
    progress = np.zeros(len(Progress))
    progress[Progress.STEP] = FIRST * motion.length / motion.speed
    progress[Progress.QUIESCENT_UNTIL] = -np.inf
    progress[Progress.SWITCH] = Cause.UNSOLVED
    most = int(options.max_steps) + STEPS_PER_SAMPLE * grounds.horizontal.size
    options = options._replace(
        largest_step=0.0, max_steps=most, first_steps=float(most)
    )
    state = new_state(model)
    return Run(
        law=RIGID,
        model=model,
        state=state,
        work=new_work(model),
        mega=assemble.new_mega_voussoirs(model, state),
        motion=motion,
        progress=progress,
        recent=np.full(ACCUMULATION, -np.inf),
        outward=np.zeros(model.mass.size),
        grounds=grounds,
        path=new_path(model),
        options=shared.ready(options, model, rest),
    )


def run(
    chain: Chain,
    grounds: Grounds,
    factor: float,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
) -> Outcomes:
    """Integrate one chain; arguments and result as `archfrag.physics.steps.run.run`."""
    model = model_of(chain)
    results = shared.new_results(1)
    rest = rest_of(model) if from_rest else UNKNOWN
    made = new_run(model, one_of(grounds, 0, factor), options, rest)
    state = made.state
    output = shared.output_to(frames, log, options.frame_interval)
    state.position[1:-1] = position
    state.velocity[1:-1] = velocity
    at_rest = from_rest and not np.isnan(made.options.rest_plus)
    follow_phases(made, at_rest, output, results, 0)
    position[:] = state.position[1:-1]
    velocity[:] = state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    return shared.checked(chain, options, results)


def run_many(
    chain: Chain,
    grounds: Grounds,
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
) -> Outcomes:
    """Make runs one after the other; arguments as `archfrag.physics.steps.run.run_many`."""
    model = model_of(chain)
    results = shared.new_results(len(motion))
    rest = rest_of(model)
    output = shared.no_output(chain.mass.size, chain.friction.size)
    for row, (number, by) in enumerate(zip(motion, factor)):
        made = new_run(model, one_of(grounds, number, by), options, rest)
        made.state.position[:] = model.start
        follow_phases(made, not np.isnan(rest[0]), output, results, row)
    return shared.checked(chain, options, results)
