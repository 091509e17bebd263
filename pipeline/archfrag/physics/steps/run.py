"""Time stepping as a method: one run, or many of one arch four at a time.

While the body force stays inside the range of rest of the configuration nothing is integrated.
Four runs go side by side for as long as nothing but Newton's iteration on the modes is needed;
what else a run may need is done for it alone (`service`), and a run that has ended makes place for
the next. A run's results are the same to the last bit whichever path it takes.
"""

import threading
from typing import NamedTuple

import numpy as np

from archfrag.physics import shared
from archfrag.physics.contact.blocks import FOR_STEPS
from archfrag.physics.contact.modes import solve_contact, start_modes
from archfrag.physics.contact.path import Path, new_path
from archfrag.physics.contact.placing import move_faces
from archfrag.physics.ground import Grounds, end_of_motion, impulse_between
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.kernels.primitives import (
    LANES,
    lane,
    lane_array,
    opposite,
    runs_of,
    select,
    some,
)
from archfrag.physics.kernels.structs import struct
from archfrag.physics.state import (
    Clock,
    Model,
    State,
    Work,
    model_of,
    new_state,
    new_work,
)
from archfrag.physics.status import Count
from archfrag.physics.steps import at_impacts, service
from archfrag.physics.steps.side_by_side import fetch_run, jobs_of, return_run
from archfrag.physics.steps.step import accept_step, pose_step

UNKNOWN = (np.nan, np.nan)


@kernel
def try_step(model, grounds, state, work, options, live):
    """Pose the next step of every run, solve it, and shorten it where that is due.

    Returns impulse, solved, unsolved. What is neither has been shortened, or its modes go on
    changing in the next call.
    """
    clock = state.clock
    step = clock[Clock.STEP]
    time = clock[Clock.TIME]
    stops = at_impacts.locates(state, options, live)
    impulse = impulse_between(grounds, clock, time, time + step)
    pose_step(model, state, work, impulse, step, options.time_step)
    start_modes(state, work, clock[Clock.ITERATIONS] == 0.0, opposite(stops))
    lead = at_impacts.LEAD * options.time_step
    ahead = select(stops, at_impacts.beyond(step, options.time_step, lead), -1.0)
    solved, refused, active, iterations = solve_contact(
        model, work.position, work, live, clock[Clock.ITERATIONS], ahead, FOR_STEPS
    )
    clock[Clock.ITERATIONS] = select(active, iterations, 0.0)
    state.count[Count.ITERATIONS] += select(live & opposite(active), iterations, 0.0)
    failed = live & opposite(solved | refused | active)
    poor = failed & (step > 1.5 * options.time_step)
    unsolved = failed & opposite(poor)
    again, shorter = at_impacts.refuse_poor(
        model, state, work, solved, stops, options.tolerance
    )
    solved = solved & opposite(again | shorter)
    poor = poor | shorter
    at_impacts.expect_impact(model, state, work, options, solved)
    if some(refused | poor):
        at_impacts.shorten(model, state, work, options, refused, poor)
    return impulse, solved, unsolved


@kernel
def step_four(model, grounds, state, work, options):
    """Step four runs until one waits; the reason is in ``state.clock[Clock.CODE]``."""
    clock = state.clock
    until = end_of_motion(grounds, clock, options.follow)
    waits = False
    while not waits:
        live = clock[Clock.CODE] == shared.GO
        impulse, solved, unsolved = try_step(model, grounds, state, work, options, live)
        collapsed = broken = clock[Clock.CODE] != clock[Clock.CODE]
        if some(solved):
            collapsed, broken = accept_step(
                model, state, work, impulse, solved, options.loss_limit
            )
            at_impacts.next_step(state, options, solved, until)
        code = service.code_after(
            state, options, until, (solved, unsolved, collapsed, broken)
        )
        clock[Clock.CODE] = code
        waits = some((code != shared.GO) & (code != shared.IDLE))


@kernel
def step_one(model, grounds, state, work, options, output):
    """Step one run with its history; as `step_four`."""
    clock = state.clock
    until = end_of_motion(grounds, clock, options.follow)
    while clock[Clock.CODE] == shared.GO:
        impulse, solved, unsolved = try_step(model, grounds, state, work, options, True)
        collapsed = broken = False
        if solved:
            collapsed, broken = service.accept_recorded(
                model, state, work, impulse, options, output
            )
            at_impacts.next_step(state, options, True, until)
        clock[Clock.CODE] = service.code_after(
            state, options, until, (solved, unsolved, collapsed, broken)
        )


@kernel
def finish_one(model, grounds, state, work, path, options, output, results, row):
    """Move one run to its end."""
    code = int(state.clock[Clock.CODE])
    while code == shared.GO:
        step_one(model, grounds, state, work, options, output)
        code = int(state.clock[Clock.CODE])
        if code in (shared.UNSOLVED, shared.PAUSE):
            code = service.handle(model, grounds, state, work, path, options, output)
    shared.end_run(model, state, work, options, output, results, row)


@kernel
def start_at_rest(model, grounds, state, work, path, options, output):
    """Let the chain rest in its own geometry until the ground moves it."""
    shared.begin(model, state, work, 0, state.clock[Clock.FACTOR])
    service.write_rest(model, grounds, state, work, path, output)
    state.clock[Clock.CODE] = service.rest_until_onset(
        model, grounds, state, options, options.rest_plus, options.rest_minus, output
    )


@kernel
def start_given(model, state, work, options, output):
    """Start from the positions and velocities of a given state."""
    shared.read_state(model, state, work)
    shared.log_change(state, 0.0, service.BY_START, -1, shared.ALL, output)
    service.start_moving(state, options, output)


@struct()
class Four(NamedTuple):
    """State and workspace of four runs, and the same memory as columns of numbers."""

    state: State
    work: Work
    fetched: tuple[
        np.ndarray, ...
    ]  # (n, 4) each: the state's arrays, then what else is looked at
    returned: tuple[np.ndarray, ...]  # (n, 4) each: the state's arrays


@struct()
class One(NamedTuple):
    """State and workspace of one run, and the same memory as plain arrays."""

    state: State
    work: Work
    path: Path
    fetched: tuple[np.ndarray, ...]  # (n,) each
    returned: tuple[np.ndarray, ...]  # (n,) each


def new_one(model: Model) -> One:
    """Return the buffers for one run."""
    state = new_state(model)
    work = new_work(model)
    returned = tuple(array.reshape(-1) for array in state)
    fetched = (*returned, work.reaction.reshape(-1), work.pivot.reshape(-1))
    return One(state, work, new_path(model), fetched, returned)


def new_four(model: Model) -> Four:
    """Return the buffers for four runs."""
    state = new_state(model, lane_array)
    work = new_work(model, lane_array)
    returned = tuple(runs_of(array).reshape(-1, LANES) for array in state)
    also = (runs_of(array).reshape(-1, LANES) for array in (work.reaction, work.pivot))
    return Four(state, work, (*returned, *also), returned)


@kernel
def next_run(model, grounds, one, options, jobs, output, results):
    """Start the next run that moves at all; those that do not are over at once.

    Returns its number, -1 if there is none.
    """
    state = one.state
    while jobs.upcoming[0] < jobs.motion.size:
        run = jobs.upcoming[0]
        jobs.upcoming[0] += 1
        motion = jobs.motion[run]
        factor = jobs.factor[run]
        shared.begin(model, state, one.work, motion, factor)
        code = service.rest_until_onset(
            model,
            grounds,
            state,
            options,
            options.rest_plus,
            options.rest_minus,
            output,
        )
        state.clock[Clock.CODE] = code
        if code == shared.GO:
            return run
        shared.end_run(model, state, one.work, options, output, results, run)
    state.clock[Clock.CODE] = shared.IDLE
    state.clock[Clock.STEP] = options.largest_step
    return -1


@kernel
def run_four(model, grounds, four, one, options, jobs, output, results):
    """Make many runs from rest, four at a time; arguments are those of `next_run`."""
    state = one.state
    runs = jobs.runs
    running = 0
    for number in range(LANES):
        runs[number] = next_run(model, grounds, one, options, jobs, output, results)
        running += runs[number] >= 0
        return_run(one.returned, number, four.returned)
    while running > 0:
        move_faces(model, four.state.position, four.work)
        step_four(model, grounds, four.state, four.work, options)
        for number in range(LANES):
            code = int(lane(four.state.clock[Clock.CODE], number))
            if code in (shared.GO, shared.IDLE):
                continue
            fetch_run(four.fetched, number, one.fetched)
            move_faces(model, state.position, one.work)
            if code in (shared.UNSOLVED, shared.PAUSE):
                code = service.handle(
                    model, grounds, state, one.work, one.path, options, output
                )
            if code != shared.GO:
                shared.end_run(
                    model, state, one.work, options, output, results, runs[number]
                )
                runs[number] = next_run(
                    model, grounds, one, options, jobs, output, results
                )
                running -= runs[number] < 0
            return_run(one.returned, number, four.returned)


def rest_of(model: Model) -> tuple[float, float]:
    """Return the rest range of a chain in its own geometry [g]; nan if it cannot rest."""
    kept = model.__dict__
    if "rest" not in kept:
        one = new_one(model)
        shared.begin(model, one.state, one.work, 0, 0.0)
        found, plus, minus = service.rest_range(
            model, one.state, one.work, one.path.rest
        )
        kept["rest"] = (plus, minus) if found else UNKNOWN
    rest: tuple[float, float] = kept["rest"]
    return rest


def _buffers(model: Model) -> tuple[Four, One]:
    """Return buffers for many runs of a chain; a thread keeps those that it used last."""
    kept = _kept.__dict__
    if kept.get("model") is not model:
        kept["model"], kept["buffers"] = model, (new_four(model), new_one(model))
        return kept["buffers"]
    four, one = kept["buffers"]
    for array in (*four.work, *one.work, *one.path[1:-1]):
        array.view(np.ndarray).view(np.uint8)[...] = 0
    runs_of(four.work.rotated)[:, 0] = one.work.rotated[:, 0] = 1.0
    return four, one


_kept = threading.local()


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
    """Integrate one chain under one ground motion; the signature of every method.

    Parameters
    ----------
    position, velocity : ndarray, (n_body, 3)
        Initial state; overwritten with the final one.
    from_rest : bool
        Whether the initial state is the chain at rest in its own geometry.
    frames, log
        Overwritten with the history and the changes of the mechanism; of length zero for none.

    Returns
    -------
    archfrag.physics.interface.Outcomes
        One row.
    """
    model = model_of(chain)
    results = shared.new_results(1)
    options = shared.ready(options, model, rest_of(model) if from_rest else UNKNOWN)
    state, work, path = new_one(model)[:3]
    output = shared.output_to(frames, log, options.frame_interval)
    state.clock[Clock.FACTOR] = factor
    if from_rest and not np.isnan(options.rest_plus):
        start_at_rest(model, grounds, state, work, path, options, output)
    else:
        state.position[1:-1] = position
        state.velocity[1:-1] = velocity
        start_given(model, state, work, options, output)
    finish_one(model, grounds, state, work, path, options, output, results, 0)
    position[:] = state.position[1:-1]
    velocity[:] = state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    return results


def run_many(
    chain: Chain,
    grounds: Grounds,
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
) -> Outcomes:
    """Integrate one chain from rest under many scaled ground motions, four at a time.

    Run k is moved by the motion of number ``motion[k]``, times ``factor[k]``; its row of the
    results is the same as of `run`.
    """
    model = model_of(chain)
    results = shared.new_results(len(motion))
    options = shared.ready(options, model, rest_of(model))
    output = shared.no_output(chain.mass.size, chain.friction.size)
    jobs = jobs_of(motion, factor)
    run_four(model, grounds, *_buffers(model), options, jobs, output, results)
    return results
