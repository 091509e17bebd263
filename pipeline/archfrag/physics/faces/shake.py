"""Time stepping of chains whose joints give: one run, or many of one arch four at a time.

Steps are equal but where joints slide, which is worked out by shorter ones, and where velocities
are not found, which halves them. Every step of the motion is computed, as a chain on springs is
never at rest in it; the run is over when no body has been faster than a small speed for a while
afterwards.
"""

import math
import threading
from typing import NamedTuple

import numpy as np

from archfrag.physics import shared
from archfrag.physics.contact.placing import move_faces
from archfrag.physics.energy import kinetic_energy
from archfrag.physics.faces.law import Faces
from archfrag.physics.faces.midpoint import (
    FaceRuns,
    accept_step,
    delay_of,
    new_runs,
    pose_step,
    record_joints,
)
from archfrag.physics.faces.settle import settled
from archfrag.physics.faces.velocities import find_velocities
from archfrag.physics.ground import Grounds, end_of_motion, impulse_between
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import (
    LANES,
    lane,
    lane_array,
    opposite,
    select,
    some,
)
from archfrag.physics.kernels.structs import struct
from archfrag.physics.numbers import smaller
from archfrag.physics.state import Clock, Model
from archfrag.physics.status import Count, Energy, Status
from archfrag.physics.steps import service
from archfrag.physics.steps.side_by_side import fetch_run, jobs_of, return_run

# A chain rests when it has not been faster than this in the mean, nor any body than three times
# this, over the root of gravity times joint length, for so long after the motion, over the root of
# its size over gravity: longer than a turning point lasts. A loose voussoir rattles for long.
STILL = 1e-2
FASTEST_STILL = 3e-2
REST_SPAN = 2.0
BALANCED = 1e-6  # acceleration over gravity that a step may leave unbalanced
ALMOST = 1e-6  # of a step is no step
SLIDING_STEP = 0.5  # of the step, where a joint slides
VACANT = 100.0  # code of a place side by side that no run takes


@struct()
class Scene(NamedTuple):
    """What does not change in the runs of a chain."""

    model: Model
    faces: Faces
    grounds: Grounds
    options: Options
    calm: float  # how long a chain is still that rests [s]
    sway: float  # kinetic energy of a chain that is still [J]


@kernel
def try_step(scene, runs, live):
    """Pose the next step of every run and find its velocities; return impulse, solved.

    The step of a run that is not solved is halved.
    """
    model = scene.model
    state = runs.state
    clock = runs.state.clock
    step = clock[Clock.STEP]
    time = clock[Clock.TIME]
    impulse = impulse_between(scene.grounds, clock, time, time + step)
    pose_step(model, runs, impulse, step)
    delay = delay_of(scene.faces, step)
    solved, iterations = find_velocities(
        model, scene.faces, runs, step, delay, BALANCED, live
    )
    state.count[Count.ITERATIONS] += select(live, iterations, 0.0)
    failed = live & opposite(solved)
    state.count[Count.SHORTENED] += select(failed, 1.0, 0.0)
    clock[Clock.STEP] = select(failed, 0.5 * step, step)
    if some(solved):
        record_joints(model, scene.faces, runs, step, solved)
    return impulse, solved


@inlined
def _go_on(scene, state, until, solved, collapsed, broken):
    """Set the next step of runs, and the codes of those that end or wait."""
    options = scene.options
    clock = state.clock
    count = state.count
    over = clock[Clock.TIME] >= until - ALMOST * options.time_step
    left = until - clock[Clock.TIME]
    longest = options.time_step
    slides = False
    for j in range(state.slide.shape[0]):
        slides = slides | (state.slide[j] != 0.0)
    longest = select(slides, SLIDING_STEP * longest, longest)
    next_step = smaller(2.0 * clock[Clock.STEP], longest)
    next_step = select((left > 0.0) & (left < next_step), left, next_step)
    clock[Clock.STEP] = select(solved, next_step, clock[Clock.STEP])
    shaken = clock[Clock.TIME] < until - options.follow - ALMOST * options.time_step
    # A chain that nothing has moved rests as soon as the motion is over.
    lively = kinetic_energy(scene.model, state.velocity) >= scene.sway
    lively = lively | (clock[Clock.FASTEST] >= options.held)
    moved = lively | (shaken & (clock[Clock.LIVELY] > 0.0))
    clock[Clock.LIVELY] = select(solved & moved, clock[Clock.TIME], clock[Clock.LIVELY])
    still_for = clock[Clock.TIME] - clock[Clock.LIVELY]
    calm = opposite(shaken) & ((still_for >= scene.calm) | (clock[Clock.LIVELY] == 0.0))
    shortest = SLIDING_STEP * options.time_step
    most = options.first_steps + until * (service.MOST_STEPS / shortest)
    spent = count[Count.STEPS] + count[Count.SHORTENED] >= most
    hopeless = clock[Clock.STEP] < service.SHORTEST * options.time_step
    hopeless = hopeless & opposite(solved)
    before = clock[Clock.CODE]
    clock[Clock.CODE] = select(
        broken,
        float(shared.BROKEN),
        select(
            collapsed,
            float(shared.COLLAPSES),
            select(
                before > shared.GO,
                before,
                select(
                    solved & calm,
                    float(shared.IDLE),
                    select(
                        solved & over,
                        float(shared.AT_END),
                        select(
                            spent,
                            float(shared.EXHAUSTED),
                            select(hopeless, float(shared.UNSOLVED), before),
                        ),
                    ),
                ),
            ),
        ),
    )


@kernel
def step_four(scene, runs):
    """Step four runs until one ends; the reason is in ``state.clock[Clock.CODE]``."""
    state = runs.state
    clock = runs.state.clock
    until = end_of_motion(scene.grounds, clock, scene.options.follow)
    ends = False
    while not ends:
        live = clock[Clock.CODE] == shared.GO
        impulse, solved = try_step(scene, runs, live)
        collapsed = broken = clock[Clock.CODE] != clock[Clock.CODE]
        if some(solved):
            collapsed, broken = accept_step(
                scene.model, state, runs.work, impulse, solved, scene.options.loss_limit
            )
        _go_on(scene, state, until, solved, collapsed, broken)
        ends = some((clock[Clock.CODE] != shared.GO) & (clock[Clock.CODE] < VACANT))


@kernel
def run_one(scene, runs, factor, output, results):
    """Move one run to its end, with its history."""
    model = scene.model
    state = runs.state
    work = runs.work
    clock = runs.state.clock
    _begin(scene, runs, 0, factor)
    shared.log_change(state, 0.0, service.BY_START, -1, shared.ALL, output)
    until = end_of_motion(scene.grounds, clock, scene.options.follow)
    while clock[Clock.CODE] == shared.GO:
        impulse, solved = try_step(scene, runs, True)
        collapsed = broken = False
        if solved:
            service.write_if_due(model, state, work, output)
            cause = -1
            joint = -1
            time = clock[Clock.TIME]
            if output.log.time.size > 0:
                cause, joint = service.dominant_change(state, work)
            collapsed, broken = accept_step(
                model, state, work, impulse, True, scene.options.loss_limit
            )
            service.keep_forces(work, clock[Clock.STEP], output)
            if cause >= 0:
                shared.log_change(state, time, cause, joint, shared.ALL, output)
        _go_on(scene, state, until, solved, collapsed, broken)
    _end(scene, runs, output, results, 0)


@inlined
def _begin(scene, runs, motion, factor):
    """Start a run from rest on its joints."""
    state = runs.state
    memory = runs.memory
    faces = scene.faces
    shared.begin(scene.model, state, runs.work, motion, factor)
    state.clock[Clock.STEP] = scene.options.time_step
    state.clock[Clock.BEGINS] = scene.grounds.begins[motion]
    memory.stored[0] = faces.stored
    for j in range(state.slip.size):
        memory.touching[j] = faces.touching[j]
        memory.half[j] = faces.half[j]
        for i in range(3):
            memory.slip[j, i] = faces.slip[j, i]


@inlined
def _end(scene, runs, output, results, row):
    """Write the results of a run that has ended; what joints store is potential energy."""
    model = scene.model
    state = runs.state
    work = runs.work
    move_faces(model, state.position, work)
    shared.end_run(model, state, work, scene.options, output, results, row)
    results.energy[row, Energy.POTENTIAL] += runs.memory.stored[0] - scene.faces.stored


@inlined
def _next_run(scene, one, jobs):
    """Start the next run; return its number, -1 if there is none."""
    run = jobs.upcoming[0]
    if run >= jobs.motion.size:
        one.state.clock[Clock.CODE] = VACANT
        one.state.clock[Clock.STEP] = 1.0
        return -1
    jobs.upcoming[0] += 1
    _begin(scene, one, jobs.motion[run], jobs.factor[run])
    return run


@kernel
def run_four(scene, four, one, jobs, output, results):
    """Make many runs from rest, four at a time."""
    running = 0
    for number in range(LANES):
        jobs.runs[number] = _next_run(scene, one, jobs)
        running += jobs.runs[number] >= 0
        return_run(one.columns, number, four.columns)
    while running > 0:
        step_four(scene, four)
        for number in range(LANES):
            if (
                jobs.runs[number] < 0
                or int(lane(four.state.clock[Clock.CODE], number)) == 0
            ):
                continue
            fetch_run(four.columns, number, one.columns)
            _end(scene, one, output, results, jobs.runs[number])
            jobs.runs[number] = _next_run(scene, one, jobs)
            running -= jobs.runs[number] < 0
            return_run(one.columns, number, four.columns)


def _scene(chain: Chain, grounds: Grounds, options: Options) -> Scene | Status:
    """Return what the runs of a chain share; a status if it has no rest on its joints."""
    found = settled(chain)
    if isinstance(found, Status):
        return found
    model, faces = found
    square = float(model.gravity * model.length.max())
    # A slender body is as long as its radius of gyration says.
    longest = np.sqrt(12.0 * (chain.inertia / chain.mass).max())
    size = float(np.ptp(chain.centroid, axis=0).max() + longest)
    calm = REST_SPAN * math.sqrt(size / chain.gravity)
    sway = 0.5 * STILL**2 * square * float(chain.mass.sum())
    options = options._replace(held=FASTEST_STILL * math.sqrt(square))
    return Scene(model, faces, grounds, options, calm, sway)


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
    """Integrate one chain under one ground motion; as `archfrag.physics.steps.run.run`.

    A run begins at rest on the joints, whatever the state given.
    """
    scene = _scene(chain, grounds, options)
    results = shared.new_results(1)
    if isinstance(scene, Status):
        results.status[:] = int(scene)
        return results
    runs = new_runs(scene.model)
    output = shared.output_to(frames, log, options.frame_interval)
    run_one(scene, runs, float(factor), output, results)
    position[:] = runs.state.position[1:-1]
    velocity[:] = runs.state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    return results


def run_many(
    chain: Chain,
    grounds: Grounds,
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
) -> Outcomes:
    """Integrate one chain from rest under many scaled ground motions, four at a time; as
    `archfrag.physics.steps.run.run_many`.
    """
    scene = _scene(chain, grounds, options)
    results = shared.new_results(len(motion))
    if isinstance(scene, Status):
        results.status[:] = int(scene)
        return results
    output = shared.no_output(chain.mass.size, chain.friction.size)
    run_four(scene, *_buffers(scene.model), jobs_of(motion, factor), output, results)
    return results


def _buffers(model: Model) -> tuple[FaceRuns, FaceRuns]:
    """Return buffers for many runs of a chain; a thread keeps those that it used last."""
    kept = _kept.__dict__
    if kept.get("model") is not model:
        kept["model"], kept["buffers"] = (
            model,
            (new_runs(model, lane_array), new_runs(model)),
        )
    buffers: tuple[FaceRuns, FaceRuns] = kept["buffers"]
    return buffers


_kept = threading.local()
