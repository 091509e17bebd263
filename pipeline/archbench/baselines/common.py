"""What the baselines have in common with time stepping: beginning, rests and end of a run."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from archfrag.physics import shared
from archfrag.physics.contact.path import Path
from archfrag.physics.ground import Grounds
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.state import Clock, Law, Model, State, Work, model_of
from archfrag.physics.status import Cause, Count, Level, Wait
from archfrag.physics.steps import run as stepper
from archfrag.physics.steps.service import handle


@struct()
class Case(NamedTuple):
    """All that one run takes."""

    law: Law
    model: Model
    grounds: Grounds
    state: State
    work: Work
    path: Path
    options: Options
    output: shared.Output
    results: Outcomes


def case_of(
    chain: Chain,
    grounds: Grounds,
    factor: float,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
) -> Case:
    """A case that has not been started; its range of rest is known where it begins at rest."""
    model = model_of(chain)
    rest = stepper.rest_of(model) if from_rest else stepper.UNKNOWN
    options = shared.ready(options, model, rest)
    one = stepper.new_rigid_runs(model)
    one.state.clock[Clock.FACTOR] = factor
    return Case(
        one.law,
        model,
        grounds,
        one.state,
        one.work,
        one.path,
        options,
        shared.output_to(frames, log, options.frame_interval),
        shared.new_results(1),
    )


def start(
    case: Case, position: np.ndarray, velocity: np.ndarray, from_rest: bool
) -> None:
    """Start a run at rest in the chain's own geometry, or with given positions and velocities."""
    state = case.state
    if from_rest and not np.isnan(case.options.rest_plus):
        stepper.start_at_rest(case, 0, state.clock[Clock.FACTOR], case.output)
        return
    state.position[1:-1] = position
    state.velocity[1:-1] = velocity
    stepper.start_given(case, case.output)


def finish(case: Case, position: np.ndarray, velocity: np.ndarray) -> Outcomes:
    """End a run; its final state goes into `position` and `velocity`."""
    _, model, _, state, work, _, options, output, results = case
    shared.end_run(model, state, work, options, output, results, 0)
    position[:] = state.position[1:-1]
    velocity[:] = state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    return results


def integrate(
    case: Case,
    advance: Callable[[], object],
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
) -> Outcomes:
    """Move a case to its end."""
    start(case, position, velocity, from_rest)
    while case.state.clock[Clock.CODE] == Wait.GO:
        advance()
        if case.state.clock[Clock.CODE] == Wait.PAUSE:
            handle(case, case.output)
    return finish(case, position, velocity)


@inlined
def write_rows(j, nx, ny, px, py, position, row):
    """Parting and tangential velocity at a point by the coordinates of the bodies of joint j."""
    for side in range(2):
        sign = 2.0 * side - 1.0
        at = 3 * side
        x = px - position[j + side, 0]
        y = py - position[j + side, 1]
        row[0, at] = sign * nx
        row[0, at + 1] = sign * ny
        row[1, at] = -sign * ny
        row[1, at + 1] = sign * nx
        row[0, at + 2] = sign * (x * ny - y * nx)
        row[1, at + 2] = sign * (x * nx + y * ny)


@kernel
def stands(state, options, until, moved, span):
    """Whether, once the record is over, nothing has been too fast for rest for some time."""
    time = state.clock[Clock.TIME]
    if state.clock[Clock.FASTEST] > options.still or time <= until - options.follow:
        moved[0] = time
    return time - moved[0] >= span


@kernel
def end_at_rest(state, output):
    """End a run that stands."""
    state.count[Count.RESTS] += 1.0
    state.clock[Clock.CODE] = Wait.IDLE
    shared.log_change(
        state, state.clock[Clock.TIME], Cause.REST, -1, Level.REST, output
    )
