"""What methods have in common with time stepping: beginning, rests, end of a run, and its
accuracy."""

from collections.abc import Callable

import numpy as np

from archfrag.mechanics.collapse import NO_MODE
from archfrag.mechanics.compile import inlined, kernel
from archfrag.mechanics.model import Clock, model_of
from archfrag.mechanics.status import Count, Energy, Peak, Status
from archfrag.mechanics.types import Chain, Options, Outcome
from archfrag.methods.time_stepping.front import Case, outcome_of
from archfrag.methods.time_stepping.recording import log_change
from archfrag.methods.time_stepping.run import start_at_rest, start_given
from archfrag.methods.time_stepping.service import AT_REST, BY_REST, Results, end_run, serve
from archfrag.methods.time_stepping.waits import GO, IDLE, PAUSE

# A run is refused that makes or loses more energy than this many times its accuracy, over the
# largest kinetic energy, or whose bodies overlap by more than this many times it, over a joint's
# length; an accuracy finer than the default counts as the default.
ENERGY_ALLOWED, LEAST_ENERGY = 10.0, 1e-2
OVERLAP_ALLOWED, LEAST_OVERLAP = 0.1, 1e-4


def is_accurate(chain: Chain, options: Options, results: Results, negligible: float) -> np.ndarray:
    """Which runs are as good as their tolerance allows, by what they measured themselves.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    options : archfrag.mechanics.types.Options
    results : archfrag.methods.time_stepping.service.Results
    negligible : float
        Energy that counts for nothing, over weight times the longest joint's length [1].

    Returns
    -------
    ndarray of bool, (n_run,)
        True for runs that have not ended.
    """
    energy, overlap = results.energy, results.peak[:, Peak.OVERLAP]
    allowed = max(ENERGY_ALLOWED * options.accuracy, LEAST_ENERGY)
    largest = np.maximum(energy[:, Energy.LARGEST_KINETIC], energy[:, Energy.START_KINETIC])
    weight = chain.gravity * float(np.sum(chain.mass))
    tiny = negligible * weight * float(model_of(chain).length.max())
    deepest = max(OVERLAP_ALLOWED * options.accuracy, LEAST_OVERLAP)
    good = energy[:, Energy.BALANCE_ERROR_PEAK] <= allowed * largest + tiny
    ended = np.isin(results.status, (int(Status.STANDING), int(Status.COLLAPSED)))
    return ~ended | (good & (overlap <= deepest))


def refuse(results: Results, rows: np.ndarray) -> None:
    """Make inaccurate runs failures, which are neither collapse nor survival."""
    results.status[rows] = int(Status.INACCURATE)
    results.collapse_time[rows] = np.nan
    results.collapse_joint[rows] = -1
    results.collapse_mode[rows] = NO_MODE


def start(case: Case, position: np.ndarray, velocity: np.ndarray, from_rest: bool) -> None:
    """Start a run at rest in the chain's own geometry, or with given positions and velocities."""
    model, grounds, state, work, path, steps, limits, output, _ = case
    if from_rest and not np.isnan(limits.rest_plus):
        start_at_rest(model, grounds, state, work, path, steps, limits, output)
        return
    state.position[1:-1], state.velocity[1:-1] = position, velocity
    start_given(model, state, work, steps, output)


def finish(case: Case, position: np.ndarray, velocity: np.ndarray) -> Outcome:
    """End a run; its final state goes into `position` and `velocity`."""
    model, _, state, work, _, _, limits, output, results = case
    end_run(model, state, work, limits, output, results, 0)
    position[:], velocity[:] = state.position[1:-1], state.velocity[1:-1]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    return outcome_of(results, 0)


def integrate(
    case: Case,
    advance: Callable[[], object],
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
) -> Outcome:
    """Move a case to its end."""
    start(case, position, velocity, from_rest)
    while case.state.clock[Clock.CODE] == GO:
        advance()
        if case.state.clock[Clock.CODE] == PAUSE:
            serve(*case[:-1])
    return finish(case, position, velocity)


@inlined
def write_rows(j, nx, ny, px, py, position, row):
    """Parting and tangential velocity at a point by the coordinates of the bodies of joint j."""
    for side in range(2):
        sign, at = 2.0 * side - 1.0, 3 * side
        x, y = px - position[j + side, 0], py - position[j + side, 1]
        row[0, at], row[0, at + 1] = sign * nx, sign * ny
        row[1, at], row[1, at + 1] = -sign * ny, sign * nx
        row[0, at + 2] = sign * (x * ny - y * nx)
        row[1, at + 2] = sign * (x * nx + y * ny)


@kernel
def stands(state, limits, until, moved, span):
    """Whether, once the record is over, nothing has been too fast for rest for some time."""
    time = state.clock[Clock.TIME]
    if state.clock[Clock.FASTEST] > limits.still or time <= until - limits.follow:
        moved[0] = time
    return time - moved[0] >= span


@kernel
def end_at_rest(state, output):
    """End a run that stands."""
    state.count[Count.RESTS] += 1.0
    state.clock[Clock.CODE] = IDLE
    log_change(state, state.clock[Clock.TIME], BY_REST, -1, AT_REST, output)
