"""Time stepping as a method: one run, or many of one arch four at a time.

The stepper is the same for rigid joints and for joints that give; each has a `Law` of its own.
With rigid joints nothing is integrated while the body force stays inside the range of rest of the
configuration; a chain on springs is never at rest in a motion. Four runs go side by side until one
waits for what has to be done for it alone (`Law.handle`), and a run that has ended makes place for
the next. A run's results are the same to the last bit, whether it goes alone or beside others.
"""

import functools
import threading

import numpy as np

from archfrag.physics import shared
from archfrag.physics.contact.path import new_path
from archfrag.physics.contact.placing import move_faces
from archfrag.physics.ground import Grounds, end_of_motion, move_ground
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.kernels.primitives import LANES, lane, lane_array, some
from archfrag.physics.state import KEPT, Clock, Law, Model, Runs, model_of, new_runs
from archfrag.physics.status import Cause, Count, Energy, Level, Status, Wait
from archfrag.physics.steps import service
from archfrag.physics.steps.at_impacts import solve_contacts
from archfrag.physics.steps.face_rest import settled
from archfrag.physics.steps.face_step import new_face_runs
from archfrag.physics.steps.step import (
    accept_contacts,
    accept_step,
    pose_contacts,
    pose_step,
)

UNKNOWN = (np.nan, np.nan)
RIGID = Law(
    pose=pose_contacts,
    solve=solve_contacts,
    accept=accept_contacts,
    go_on=service.go_on,
    start=service.rest,
    handle=service.handle,
)


@kernel
def try_step(runs, live):
    """Pose the next step of every run, and solve it.

    Return the impulse of the ground, and the masks solved and unsolved. A run in neither has had
    its step shortened, or its step is not done yet.
    """
    impulse = move_ground(runs)
    pose_step(runs, impulse)
    solved, unsolved = runs.law.solve(runs, live)
    return impulse, solved, unsolved


@kernel
def step_four(runs):
    """Step four runs until one waits; the reason is in ``state.clock[Clock.CODE]``."""
    clock = runs.state.clock
    until = end_of_motion(runs.grounds, clock, runs.options.follow)
    waits = False
    while not waits:
        impulse, solved, unsolved = try_step(runs, clock[Clock.CODE] == Wait.GO)
        collapsed = broken = clock[Clock.CODE] != clock[Clock.CODE]
        if some(solved):
            collapsed, broken = accept_step(runs, impulse, solved)
        runs.law.go_on(runs, until, (solved, unsolved, collapsed, broken))
        code = clock[Clock.CODE]
        waits = some((code != Wait.GO) & (code != Wait.IDLE))


@kernel
def step_one(runs, until, output):
    """Try a step of one run, and write its history; as `step_four` set its code."""
    impulse, solved, unsolved = try_step(runs, True)
    collapsed = broken = False
    if solved:
        collapsed, broken = service.accept_recorded(runs, impulse, output)
    runs.law.go_on(runs, until, (solved, unsolved, collapsed, broken))


@kernel
def end(runs, output, results):
    """Write the results of a run that has ended.

    Energy that joints store counts as potential energy.

    Writes: output (energy, peak), results.energy.
    """
    clock = runs.state.clock
    row = int(clock[Clock.RUN])
    given = runs.model, runs.state, runs.work, runs.options
    shared.end_run(*given, output, results, row)
    stored = clock[Clock.STORED] - clock[Clock.STORED_FIRST]
    results.energy[row, Energy.POTENTIAL] += stored


@kernel
def start_at_rest(runs, motion, factor, output):
    """Start a run from rest where the model starts.

    `motion` is the number of its ground motion, and `factor` multiplies that motion.
    """
    shared.begin(runs.model, runs.state, runs.work, motion, factor)
    runs.state.clock[Clock.CODE] = runs.law.start(runs, output)


@kernel
def start_given(runs, output):
    """Start from the positions and velocities of a given state."""
    shared.read_state(runs.model, runs.state, runs.work)
    shared.log_change(runs.state, 0.0, Cause.START, -1, Level.ALL_VOUSSOIRS, output)
    service.start_moving(runs.state, runs.options, output)


@kernel
def run_one(runs, at_rest, output, results):
    """Move one run to its end, with its history."""
    clock = runs.state.clock
    work = runs.work
    if at_rest:
        start_at_rest(runs, 0, clock[Clock.FACTOR], output)
    else:
        start_given(runs, output)
    until = end_of_motion(runs.grounds, clock, runs.options.follow)
    while clock[Clock.CODE] == Wait.GO:
        step_one(runs, until, output)
        runs.law.handle(runs, output)
    position = runs.state.position
    move_faces(runs.model, position, work)
    end(runs, output, results)


@kernel
def start_next(one, run, motion, factor, output, results):
    """Start the next run that moves at all, from number `run` on; end those that do not.

    Return its number, or the number of all runs if none is left.
    """
    clock = one.state.clock
    while run < motion.size:
        start_at_rest(one, motion[run], factor[run], output)
        clock[Clock.RUN] = run
        if clock[Clock.CODE] == Wait.GO:
            return run
        end(one, output, results)
        run += 1
    clock[Clock.CODE] = Wait.IDLE
    clock[Clock.STEP] = one.options.time_step
    return run


@kernel
def copy_run(of, place, to, number):
    """Copy the values that a run keeps from place `place` of `of` to place `number` of `to`.

    Reads: of.columns.
    Writes: to.columns.
    """
    for k in range(len(of.columns)):
        for i in range(of.columns[k].shape[0]):
            to.columns[k][i, number] = of.columns[k][i, place]


@kernel
def run_four(four, one, motion, factor, output, results):
    """Make many runs from rest, four at a time.

    `four` steps them; `one` starts, serves and ends each of them alone.
    """
    work = one.work
    clock = four.state.clock
    running = 0
    run = -1
    for number in range(LANES):
        run = start_next(one, run + 1, motion, factor, output, results)
        running += run < motion.size
        copy_run(one, 0, four, number)
    while running > 0:
        step_four(four)
        for number in range(LANES):
            code = int(lane(clock[Clock.CODE], number))
            if code in (Wait.GO, Wait.IDLE):
                continue
            copy_run(four, number, one, 0)
            position = one.state.position
            move_faces(one.model, position, work)
            if one.law.handle(one, output) != Wait.GO:
                end(one, output, results)
                run = start_next(one, run + 1, motion, factor, output, results)
                running -= run >= motion.size
            copy_run(one, 0, four, number)


def new_rigid_runs(model: Model, zeros=np.zeros) -> Runs:
    """Allocate one run with rigid joints, or four with `lane_array` as `zeros`."""
    return new_runs(RIGID, model, zeros, path=new_path(model))


@functools.lru_cache(maxsize=KEPT)
def rest_of(model: Model) -> tuple[float, float]:
    """Return the range of rest of a chain in its own geometry, plus and minus [g].

    Both are nan if it cannot rest.
    """
    one = new_rigid_runs(model)
    shared.begin(model, one.state, one.work, 0, 0.0)
    found, plus, minus = service.rest_range(model, one.state, one.work, one.path.rest)
    return (plus, minus) if found else UNKNOWN


_kept = threading.local()


def _runs_for(
    chain: Chain, grounds: Grounds, options: Options, from_rest: bool = True
) -> list[Runs] | Status:
    """Return four runs of a chain side by side, and one alone.

    If the chain has no rest on joints that give, return its status. A thread keeps the buffers
    that it used last.
    """
    if chain.joint is None:
        model = model_of(chain)
        rest = rest_of(model) if from_rest else UNKNOWN
        options = shared.ready(options, model, rest)
        make = functools.partial(new_rigid_runs, model)
    else:
        found = settled(chain)
        if isinstance(found, Status):
            return found
        model = found[0]
        make = functools.partial(new_face_runs, *found)
    if getattr(_kept, "model", None) is not model:
        _kept.model = model
        _kept.runs = make(lane_array), make()
    return [each._replace(grounds=grounds, options=options) for each in _kept.runs]


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
        Whether the initial state is the chain at rest in its own geometry. Chains whose joints
        give begin at rest on them, whatever the state given.
    frames, log
        Overwritten with the history and the changes of the mechanism; of length zero for none.

    Returns
    -------
    archfrag.physics.interface.Outcomes
        One row.
    """
    results = shared.new_results(1)
    found = _runs_for(chain, grounds, options, from_rest)
    if isinstance(found, Status):
        results.status[:] = int(found)
        return results
    one = found[1]
    state = one.state
    output = shared.output_to(frames, log, options.frame_interval)
    state.clock[Clock.FACTOR] = factor
    bodies = slice(1, one.model.end)
    state.position[:] = state.velocity[:] = 0.0
    state.position[bodies] = position
    state.velocity[bodies] = velocity
    rests = from_rest and not np.isnan(one.options.rest_plus)
    run_one(one, rests or chain.joint is not None, output, results)
    position[:] = state.position[bodies]
    velocity[:] = state.velocity[bodies]
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
    results = shared.new_results(len(motion))
    found = _runs_for(chain, grounds, options)
    if isinstance(found, Status):
        results.status[:] = int(found)
        return results
    output = shared.no_output(chain.mass.size, chain.friction.size)
    motion = np.ascontiguousarray(motion, np.int64)
    factor = np.ascontiguousarray(factor, float)
    run_four(*found, motion, factor, output, results)
    return results
