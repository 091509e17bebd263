"""What time stepping does for one run alone, besides Newton's iteration.

This is rest, the history, a solution path if the modes are not reconciled, and measurements of the
contact residual.
"""

import numpy as np

from archfrag.physics import shared
from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact.blocks import EXACT
from archfrag.physics.contact.modes import solve_contact
from archfrag.physics.contact.path import copy_modes, solve_with_fallback
from archfrag.physics.contact.placing import (
    clearance,
    move_faces,
    place_contacts,
)
from archfrag.physics.contact.ties import (
    accept_pulls,
    aim_pulls,
    pull_at_rest,
    pull_bodies,
    recall_pulls,
)
from archfrag.physics.energy import kinetic_energy, record_work
from archfrag.physics.ground import (
    end_of_motion,
    end_rest,
    impulse_between,
    move_ground,
)
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import select, some
from archfrag.physics.numbers import flag, nearest
from archfrag.physics.onset import find_rest_limit
from archfrag.physics.residual import state_residual
from archfrag.physics.shared import log_change, write_frame
from archfrag.physics.state import Clock
from archfrag.physics.status import Cause, Count, Level, Peak, Wait
from archfrag.physics.steps.at_impacts import next_step
from archfrag.physics.steps.step import (
    accept_step,
    go_to_middle,
    move_to_middle,
    normal_of,
    offset_of,
    pass_time,
    pose_step,
    speed_of,
)

# Causes of a change of a joint's mode, the dominant one last.
CHANGES = tuple(
    map(int, (Cause.STICK, Cause.SLIDE, Cause.HINGE, Cause.IMPACT, Cause.LOSS))
)
# A step whose contact problem no method solves is halved, down to this part of the shortest.
SHORTEST = 1.0 / 100.0
# Contacts hold a chain that stands if they leave no more than this part of gravity [1].
HELD = 1e-7
# A run may take MOST_STEPS times as many steps as would cover its duration at the shortest length.
# A step needs one or several linear problems; ITERATIONS_PER_STEP on average mean no advance.
MOST_STEPS = 2.0
ITERATIONS_PER_STEP = 16.0
# Corners nearer than this part of the joint's length may close in a step of a slow motion.
NEAR = 0.02


@kernel
def is_as_built(model, state):
    """Return whether all joints are closed and none has slipped: the chain is in its own geometry.

    Reads: model.length, state (contact, slip).
    """
    for j in range(state.slip.size):
        slips = abs(state.slip[j]) > shared.CLOSED_GAP * model.length[j]
        if slips or state.contact[j, 0] + state.contact[j, 1] < 1.5:
            return False
    return True


@kernel
def rest_range(model, state, work, problem):
    """Return whether a chain can rest where it is, and the limits of its range of rest [g].

    These are two load factors, plus and minus.
    """
    place_contacts(model, state.slip, work)
    for j in range(state.slip.size):
        for k in range(2):
            gap = clearance(j, k, work)
            problem.candidate[j, k] = (
                0 if gap > shared.CLOSED_GAP * model.length[j] else 1
            )
    problem.pull[:] = 0.0
    for i in range(state.position.shape[0]):
        for c in range(2):
            problem.centroid[i, c] = state.position[i, c]
    pull_at_rest(model, state, work, problem.pull)
    found, plus = find_rest_limit(model, work, problem, 1.0)
    also, minus = find_rest_limit(model, work, problem, -1.0)
    return found and also, plus, -minus


@kernel
def start_moving(state, options, output):
    """Begin to step from the positions and velocities of a state.

    Reads: state.clock, options.time_step.
    Writes: state (clock, force, impact), output.span.
    """
    clock = state.clock
    clock[Clock.STEP] = options.time_step
    clock[Clock.IMPACT] = -np.inf
    clock[Clock.FASTEST] = np.inf
    output.span[0] = 0.0
    state.impact[:] = 0.0
    state.force[:] = 0.0


@kernel
def write_rest(runs, output):
    """Write a frame of the chain at rest, with reactions that balance the body force."""
    if output.frames.time.size == 0:
        return
    model = runs.model
    state = runs.state
    work = runs.work
    clock = state.clock
    place_contacts(model, state.slip, work)
    tiny = 1e-9 * runs.grounds.time_step[int(clock[Clock.MOTION])]
    time = clock[Clock.TIME]
    impulse = impulse_between(runs.grounds, clock, time - tiny, time + tiny)
    work.free[:] = 0.0
    for i in range(1, model.end):
        work.free[i, 0] = -impulse.x / (2.0 * tiny)
        work.free[i, 1] = -impulse.y / (2.0 * tiny) - model.gravity
    for j in range(state.slip.size):
        for k in range(2):
            work.candidate[j, k] = state.contact[j, k]
    work.bias[:] = 0.0
    move_to_middle(model, state, work, 0.0)
    pull_bodies(model, state, work)
    count = state.count
    taken = count[Count.ITERATIONS], count[Count.PATHS], count[Count.COMPLIANT]
    solved, _ = solve_with_fallback(model, state, work, runs.path)
    # A history does not change what a run has taken.
    count[Count.ITERATIONS], count[Count.PATHS], count[Count.COMPLIANT] = taken
    if not solved:
        work.reaction[:] = 0.0
    write_frame(model, state, work, output)


@kernel
def rest_until_onset(runs, plus, minus, output):
    """Let a chain rest until the ground motion moves it; return the code.

    `plus` and `minus` are the limits of its range of rest [g].
    """
    state = runs.state
    clock = state.clock
    leave, for_good = end_rest(runs.model, runs.grounds, clock, plus, minus)
    clock[Clock.NOTED] = runs.grounds.noted[int(clock[Clock.MOTION])]
    if clock[Clock.TIME] < clock[Clock.NOTED]:
        state.peak[Peak.MOVED_BEFORE] = 0.0
    clock[Clock.RESTING] += leave - clock[Clock.TIME]
    clock[Clock.TIME] = leave
    if for_good:
        return Wait.IDLE
    start_moving(state, runs.options, output)
    output.due[0] = leave
    log_change(state, leave, Cause.START, -1, Level.ALL_VOUSSOIRS, output)
    return Wait.GO


@kernel
def rest(runs, output):
    """Let a chain of rigid joints rest in its own geometry until the ground moves it.

    Return the code.
    """
    write_rest(runs, output)
    options = runs.options
    return rest_until_onset(runs, options.rest_plus, options.rest_minus, output)


@kernel
def write_if_due(model, state, work, output):
    """Write a frame of the beginning of a solved step, if one is due.

    Reactions act in the middle of steps; the frame's are interpolated between the last step and
    this.
    """
    clock = state.clock
    frames = output.frames
    n = output.written[0]
    if frames.time.size == 0 or clock[Clock.TIME] < output.due[0]:
        return
    write_frame(model, state, work, output)
    output.due[0] = clock[Clock.TIME] + output.interval
    if n >= frames.time.size:
        return
    step = clock[Clock.STEP]
    before = output.span[0]
    part = before / (before + step)
    for j in range(state.slip.size):
        for c in range(3):
            force = work.reaction[j, c] / step
            frames.reaction[n, j, c] = output.forces[j, c] + part * (
                force - output.forces[j, c]
            )
            if before == 0.0:
                frames.reaction[n, j, c] = force


@kernel
def keep_forces(work, step, output):
    """Keep the mean reactions of a step that has been made, for the frame after it.

    Reads: work.reaction, output.frames.time.
    Writes: output (forces, span).
    """
    if output.frames.time.size == 0:
        return
    output.span[0] = step
    for j in range(output.forces.shape[0]):
        for c in range(3):
            output.forces[j, c] = work.reaction[j, c]


@kernel
def dominant_change(state, work):
    """Return the most important change of a joint in a solved step: cause and joint.

    Both are -1 if no joint changes.

    Reads: state (contact, slide, slip), work (contact, slide).
    """
    joint = -1
    rank = -1
    for j in range(state.slip.size):
        was = state.contact[j, 0] + state.contact[j, 1]
        now = work.contact[j, 0] + work.contact[j, 1]
        made = (
            work.contact[j, 0] > state.contact[j, 0]
            or work.contact[j, 1] > state.contact[j, 1]
        )
        if not (made or now != was or work.slide[j] != state.slide[j]):
            continue
        own = 0
        if now == 0.0:
            own = 4
        elif made:
            own = 3
        elif was == 2.0 and now < 2.0:
            own = 2
        elif work.slide[j] != 0.0:
            own = 1
        if own > rank:
            joint = j
            rank = own
    return CHANGES[rank] if rank >= 0 else -1, joint


@kernel
def are_held(model, state, work, options):
    """Return whether the contacts hold all bodies where they stand in a solved step.

    Reads: model (gravity, length), state (clock, velocity), work.solved, options.held.
    """
    most = HELD * model.gravity * state.clock[Clock.STEP]
    length = model.length[0]
    for i in range(1, state.velocity.shape[0]):
        if speed_of(i, state.velocity, length) >= options.held:
            return False
        if speed_of(i, work.solved, length) > most:
            return False
    return True


@inlined
def stop(model, state):
    """Stop all bodies, and record their kinetic energy as an error."""
    record_work(0.0, 0.0, -kinetic_energy(model, state.velocity), True, state.energy)
    state.velocity[:] = 0.0


@kernel
def hold(model, state, work):
    """Let a chain that its contacts hold stand where it is for a step.

    Any motion would be rounding, which would add up as joints open and close by it.

    Reads: model (inertia, mass), state (clock, energy, impact, velocity).
    Writes: state (clock, count, energy, impact, velocity), work.reaction.
    """
    step = state.clock[Clock.STEP]
    stop(model, state)
    state.clock[Clock.FASTEST] = 0.0
    pass_time(state, True)
    state.impact[:] = 0.0
    for j in range(state.impact.size):
        for c in range(3):
            work.reaction[j, c] /= step


@kernel
def accept_recorded(runs, impulse, output):
    """Accept a solved step of one run, and write frames and log; return as `accept_step`."""
    model = runs.model
    state = runs.state
    work = runs.work
    write_if_due(model, state, work, output)
    time = state.clock[Clock.TIME]
    step = state.clock[Clock.STEP]
    collapsed = broken = False
    cause = joint = -1
    if are_held(model, state, work, runs.options):
        hold(model, state, work)
    else:
        if output.log.time.size > 0:
            cause, joint = dominant_change(state, work)
        collapsed, broken = accept_step(runs, impulse, True)
    keep_forces(work, step, output)
    if cause >= 0:
        log_change(state, time, cause, joint, Level.ALL_VOUSSOIRS, output)
    return collapsed, broken


@kernel
def measure_state(model, state, work):
    """Record the contact residual of the present state."""
    residual = state_residual(model, state, work)
    state.peak[Peak.RESIDUAL] = max(state.peak[Peak.RESIDUAL], residual)


@kernel
def handle_unsolved(runs, output):
    """Solve an unsolved step along paths, or halve it; return the code."""
    state = runs.state
    clock = state.clock
    options = runs.options
    impulse = move_ground(runs)
    pose_step(runs, impulse)
    solved, compliant = solve_with_fallback(runs.model, state, runs.work, runs.path)
    if solved:
        collapsed, broken = accept_recorded(runs, impulse, output)
        until = end_of_motion(runs.grounds, clock, options.follow)
        next_step(state, options, True, until)
        if compliant:
            measure_state(runs.model, state, runs.work)
        if broken:
            return Wait.BROKEN
        return Wait.COLLAPSES if collapsed else Wait.PAUSE
    if clock[Clock.STEP] < SHORTEST * options.time_step:
        return Wait.UNSOLVED
    clock[Clock.STEP] *= 0.5
    state.count[Count.SHORTENED] += 1.0
    return Wait.GO


@kernel
def handle_pause(runs, output):
    """Measure what is due, and let the chain rest if it stays at rest; return the code."""
    model = runs.model
    state = runs.state
    options = runs.options
    grounds = runs.grounds
    clock = state.clock
    if int(state.count[Count.STEPS]) % options.check_interval == 0:
        measure_state(model, state, runs.work)
    if clock[Clock.FASTEST] >= options.still or not options.rests:
        return Wait.GO
    found = True
    plus = options.rest_plus
    minus = options.rest_minus
    if np.isnan(plus) or not is_as_built(model, state):
        found, plus, minus = rest_range(model, state, runs.work, runs.path.rest)
    if not found:
        return Wait.GO
    leave, for_good = end_rest(model, grounds, clock, plus, minus)
    over = clock[Clock.TIME] >= end_of_motion(grounds, clock, 0.0)
    if leave <= clock[Clock.TIME] and not (over and for_good):
        return Wait.GO
    stop(model, state)
    state.count[Count.RESTS] += 1.0
    write_rest(runs, output)
    log_change(state, clock[Clock.TIME], Cause.REST, -1, Level.REST, output)
    return rest_until_onset(runs, plus, minus, output)


@kernel
def handle(runs, output):
    """Do what a run waits for; return the code with which it goes on or ends."""
    code = int(runs.state.clock[Clock.CODE])
    if code == Wait.UNSOLVED:
        code = handle_unsolved(runs, output)
    if code == Wait.PAUSE:
        code = handle_pause(runs, output)
    runs.state.clock[Clock.CODE] = code
    return code


@inlined
def code_after(before, outcome, over, spent, due):
    """Return the codes of runs (`Wait`) after an attempt at a step.

    `before` are the codes before it. The other arguments are masks: `outcome` has solved,
    unsolved, collapsed, broken; `over` is where the time is up, `spent` where the work allowed is
    spent, and `due` where something is to be done between steps. If several codes apply, the last
    below counts.
    """
    _, unsolved, collapsed, broken = outcome
    code = select(unsolved, Wait.UNSOLVED, before)
    code = select(due, Wait.PAUSE, code)
    code = select(spent, Wait.EXHAUSTED, code)
    code = select(over, Wait.AT_END, code)
    code = select(before > Wait.PAUSE, before, code)
    code = select(collapsed, Wait.COLLAPSES, code)
    return select(broken, Wait.BROKEN, code)


@kernel
def go_on(runs, until, outcome):
    """Set the next steps of runs with rigid joints, and the codes of those that end or wait.

    Writes: runs.state.clock.
    """
    state = runs.state
    options = runs.options
    clock = state.clock
    count = state.count
    solved = outcome[0]
    if some(solved):
        next_step(state, options, solved, until)
    checks = count[Count.STEPS] * (1.0 / options.check_interval)
    due = (clock[Clock.FASTEST] < options.still) | (checks == nearest(checks))
    over = clock[Clock.TIME] >= until
    most = options.first_steps + until * (MOST_STEPS / options.time_step)
    spent = (count[Count.STEPS] >= most) | (
        count[Count.ITERATIONS] >= ITERATIONS_PER_STEP * most
    )
    before = clock[Clock.CODE]
    clock[Clock.CODE] = code_after(before, outcome, over, spent, solved & due)


@kernel
def creep(model, state, work, path, step, loss_limit):
    """Make one step of a motion so slow that the chain is in equilibrium at every instant.

    It is the contact problem of a time step in which bodies have no velocity before it:
    M w = h S + H r. With h so long that M w is small beside h S, forces are in equilibrium, and
    h w is how far the bodies move. Springings move by their joint faces.

    Returns whether its contact problem is solved, the largest displacement of a centroid in it
    [m], and whether a joint has lost its contact for good.
    """
    end = model.end
    for i in range(1, end):
        work.free[i, 0] = 0.0
        work.free[i, 1] = -step * model.gravity
        work.free[i, 2] = 0.0
    go_to_middle(model, state, work, 0.0)
    work.known[:] = 0.0
    for j in range(state.slip.size):
        nx, ny = normal_of(j, work)
        for k in range(2):
            ex, ey = offset_of(j, k, model, work)
            work.bias[j, k, 0] = ex / step
            work.bias[j, k, 1] = ey / step
            work.candidate[j, k] = flag(nx * ex + ny * ey < NEAR * model.length[j])
    aim_pulls(model, state, work, step, 1.0)
    copy_modes(state, work)
    recall_pulls(state, work, True)
    solved, _, _, _ = solve_contact(model, work.position, work, True, 0.0, -1.0, EXACT)
    if not solved:
        solved, _ = solve_with_fallback(model, state, work, path)
    farthest = 0.0
    for i in range(1, end):
        for c in range(3):
            state.position[i, c] += step * work.solved[i, c]
        farthest = max(
            farthest, step * abs(work.solved[i, 0]), step * abs(work.solved[i, 1])
        )
    move_faces(model, state.position, work)
    accept_pulls(model, state, work, step, True)
    collapsed = follow_joints(model, state, work, True, loss_limit)
    return solved, farthest, collapsed
