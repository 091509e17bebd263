"""What a run may need besides Newton's iteration, done for one run alone.

A solution path where the modes are not reconciled, rest, measurements of the contact residual, the
beginning of a run and its end.
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.collapse import NOTED_GAP, collapse_of, loss_mode
from archfrag.mechanics.compile import kernel
from archfrag.mechanics.contact.placing import clearance, move_faces, slip_and_gap
from archfrag.mechanics.contact.problem import solve_anyhow
from archfrag.mechanics.energy import energies_of, record_work
from archfrag.mechanics.model import Clock
from archfrag.mechanics.residual import state_residual
from archfrag.mechanics.status import Cause, Count, Energy, Loss, Peak, Status
from archfrag.mechanics.status import Model as Rung
from archfrag.methods.time_stepping.at_impacts import next_step
from archfrag.methods.time_stepping.motion import end_of_motion, end_rest, kick_between
from archfrag.methods.time_stepping.recording import (
    dominant_change,
    keep_forces,
    log_change,
    write_frame,
    write_if_due,
)
from archfrag.methods.time_stepping.rest import (
    CLOSED_GAP,
    is_as_built,
    rest_range,
    rest_until_onset,
    write_rest,
)
from archfrag.methods.time_stepping.step import accept_step, pose_step
from archfrag.methods.time_stepping.waits import (
    AT_END,
    BROKEN,
    EXHAUSTED,
    FALLEN,
    GO,
    IDLE,
    PAUSE,
    UNSOLVED,
)

STANDING, COLLAPSED = int(Status.STANDING), int(Status.COLLAPSED)
UNFINISHED, NO_SOLUTION = int(Status.UNFINISHED), int(Status.NO_CONTACT_SOLUTION)
NOT_FINITE, WORK_BOUND = int(Status.NOT_FINITE), int(Status.WORK_BOUND)
BY_START, BY_REST = int(Cause.START), int(Cause.REST)
AT_REST, ALL = int(Rung.REST), int(Rung.ALL_VOUSSOIRS)
# Speed over that of a fall through the longest joint below which a chain may be at rest [1].
STILL = 1e-7
# A step whose contact problem no method solves is halved, down to this part of the shortest.
SHORTEST = 1.0 / 100.0


class Limits(NamedTuple):
    """What bounds a run."""

    follow: float  # how long to go on past the end of the ground motion [s]
    loss_limit: float  # gap at both corners, over joint length, that cannot be undone [1]
    check_interval: int  # steps between measurements of the contact residual
    still: float  # speed below which the chain may be at rest [m/s]
    rest_plus: float  # range of rest of the chain in its own geometry [g]; nan: not known
    rest_minus: float
    first_steps: float = 1000.0  # allowed beyond those for as long as a run lasts


@kernel
def accept_recorded(model, state, work, kick, limits, output):
    """Make a solved step of one run, and write what is due; as `accept_step`."""
    write_if_due(model, state, work, output)
    cause, joint, time = -1, -1, state.clock[Clock.TIME]
    if output.log.time.size > 0:
        cause, joint = dominant_change(state, work)
    step = state.clock[Clock.STEP]
    fallen, broken = accept_step(model, state, work, kick, True, limits.loss_limit)
    keep_forces(work, step, output)
    if cause >= 0:
        log_change(state, time, cause, joint, ALL, output)
    return fallen, broken


@kernel
def measure_state(model, state, work):
    """Note how far the state that the last step reached is from the contact laws."""
    residual = state_residual(model, state, work)
    state.peak[Peak.RESIDUAL] = max(state.peak[Peak.RESIDUAL], residual)


@kernel
def serve_unsolved(model, grounds, state, work, path, steps, limits, output):
    """Make a step whose modes are not reconciled, or halve it; returns the code."""
    clock = state.clock
    time, step = clock[Clock.TIME], clock[Clock.STEP]
    kick = kick_between(grounds, clock, time, time + step)
    pose_step(model, state, work, kick, step, steps.impact)
    solved, compliant = solve_anyhow(model, state, work, path)
    if solved:
        fallen, broken = accept_recorded(model, state, work, kick, limits, output)
        next_step(state, steps, True, end_of_motion(grounds, clock, limits.follow))
        if compliant:
            measure_state(model, state, work)
        if broken:
            return BROKEN
        return FALLEN if fallen else PAUSE
    if clock[Clock.STEP] < SHORTEST * steps.impact:
        return UNSOLVED
    clock[Clock.STEP] *= 0.5
    state.count[Count.SHORTENED] += 1.0
    return GO


@kernel
def serve_pause(model, grounds, state, work, path, steps, limits, output):
    """Between two steps: measure what is due, and see whether the chain rests; the code."""
    clock = state.clock
    if int(state.count[Count.STEPS]) % limits.check_interval == 0:
        measure_state(model, state, work)
    if clock[Clock.FASTEST] >= limits.still:
        return GO
    found, plus, minus = True, limits.rest_plus, limits.rest_minus
    if np.isnan(plus) or not is_as_built(model, state):
        found, plus, minus = rest_range(model, state, work)
    if not found:
        return GO
    motion = int(clock[Clock.MOTION])
    samples = grounds.first[motion + 1] - grounds.first[motion] - 1
    leave, for_good = end_rest(model, grounds, clock, plus, minus)
    over = clock[Clock.TIME] >= samples * grounds.time_step[motion]
    if leave <= clock[Clock.TIME] and not (over and for_good):
        return GO
    stops = 0.0
    for i in range(1, state.position.shape[0] - 1):
        ux, uy, w = state.velocity[i, 0], state.velocity[i, 1], state.velocity[i, 2]
        stops -= 0.5 * (model.mass[i] * (ux * ux + uy * uy) + model.inertia[i] * w * w)
        for c in range(3):
            state.velocity[i, c] = 0.0
    record_work(0.0, 0.0, stops, True, state.energy)
    state.count[Count.RESTS] += 1.0
    write_rest(model, grounds, state, work, path, output)
    log_change(state, clock[Clock.TIME], BY_REST, -1, AT_REST, output)
    return rest_until_onset(model, grounds, state, steps, plus, minus, output)


@kernel
def serve(model, grounds, state, work, path, steps, limits, output):
    """Do for one run what stopped it; the code that it goes on with, or ends with."""
    code = int(state.clock[Clock.CODE])
    if code == UNSOLVED:
        code = serve_unsolved(model, grounds, state, work, path, steps, limits, output)
    if code == PAUSE:
        code = serve_pause(model, grounds, state, work, path, steps, limits, output)
    state.clock[Clock.CODE] = code
    return code


@kernel
def clear(state):
    """Forget all that a run remembers, and close all joints; positions and velocities stay."""
    for j in range(state.slip.size):
        state.touch[j, 0] = state.touch[j, 1] = state.bore_face[j] = 1.0
        state.slide[j] = state.slip[j] = state.impact[j] = 0.0
        state.lost_since[j] = np.nan
        state.lost_slip[j] = state.lost_rotation[j] = 0.0
    for values in (state.loss, state.clock, state.count, state.energy, state.peak):
        values[:] = 0.0
    state.loss[Loss.TIME], state.loss[Loss.JOINT] = np.nan, -1.0


@kernel
def read_joints(model, state, work):
    """Slips and modes of all joints of an initial state, from positions alone.

    A joint that is open at both corners has been without contact since time zero.
    """
    for j in range(state.slip.size):
        gaps = clearance(j, 0, work.face, work.tangent), clearance(j, 1, work.face, work.tangent)
        length = model.length[j]
        k = 1 if gaps[1] < gaps[0] else 0
        slip, _ = slip_and_gap(j, False, False, work.face, work.tangent)
        state.slip[j] = 0.0 if abs(slip) < CLOSED_GAP * length else slip
        if max(gaps) > CLOSED_GAP * length:
            state.touch[j, 1 - k] = 0.0
            state.bore_face[j] = 0.0
        if min(gaps) > CLOSED_GAP * length:
            state.touch[j, k] = 0.0
            state.bore_face[j] = 1.0
            state.lost_since[j] = 0.0
            state.lost_slip[j] = abs(state.slip[j]) / length
            state.lost_rotation[j] = abs(state.position[j + 1, 2] - state.position[j, 2])
            gap = min(gaps) / length
            state.loss[Loss.WIDEST] = max(state.loss[Loss.WIDEST], gap)
            if gap > NOTED_GAP and np.isnan(state.loss[Loss.TIME]):
                state.loss[Loss.TIME], state.loss[Loss.JOINT] = 0.0, j
                state.loss[Loss.MODE] = loss_mode(j, state)


@kernel
def begin(model, grounds, state, work, steps, limits, motion, factor):
    """Start a run from rest in the chain's own geometry."""
    for i in range(state.position.shape[0]):
        for c in range(3):
            state.position[i, c] = model.centroid[i, c] if c < 2 else 0.0
            state.velocity[i, c] = 0.0
    clear(state)
    state.clock[Clock.MOTION], state.clock[Clock.FACTOR] = motion, factor
    move_faces(model, state.position, work.rotated, work.face, work.tangent)


class Results(NamedTuple):
    """What runs end in, a row for each."""

    status: np.ndarray  # (n_run,) int64: archfrag.mechanics.status.Status
    end_time: np.ndarray  # (n_run,) [s]
    collapse_time: np.ndarray  # (n_run,) [s]; nan if none
    collapse_joint: np.ndarray  # (n_run,) int64; -1 if none
    collapse_mode: np.ndarray  # (n_run,) int64: archfrag.mechanics.status.CollapseMode
    loss: np.ndarray  # (n_run, len(Loss))
    # (n_run, len(Count)) by archfrag.mechanics.status.Count
    count: np.ndarray  # type: ignore[assignment]
    energy: np.ndarray  # (n_run, len(Energy)) [J]
    model_time: np.ndarray  # (n_run, len(Rung)) [s]
    peak: np.ndarray  # (n_run, len(Peak))


def new_results(n_run: int) -> Results:
    """Rows for so many runs."""
    return Results(
        status=np.zeros(n_run, np.int64),
        end_time=np.zeros(n_run),
        collapse_time=np.full(n_run, np.nan),
        collapse_joint=np.full(n_run, -1),
        collapse_mode=np.zeros(n_run, np.int64),
        loss=np.zeros((n_run, len(Loss))),
        count=np.zeros((n_run, len(Count))),
        energy=np.zeros((n_run, len(Energy))),
        model_time=np.zeros((n_run, len(Rung))),
        peak=np.zeros((n_run, len(Peak))),
    )


@kernel
def record_end(model, state):
    """Rotation and displacement that are left at the end."""
    rotation = farthest = 0.0
    for i in range(1, state.position.shape[0] - 1):
        dx = state.position[i, 0] - model.centroid[i, 0]
        dy = state.position[i, 1] - model.centroid[i, 1]
        farthest = max(farthest, dx * dx + dy * dy)
        rotation = max(rotation, abs(state.position[i, 2]))
    state.peak[Peak.END_ROTATION] = rotation
    state.peak[Peak.END_DISPLACEMENT] = np.sqrt(farthest)


@kernel
def end_run(model, state, work, limits, output, results, row):
    """Write what a run has ended in."""
    clock, energy = state.clock, state.energy
    code, status = int(clock[Clock.CODE]), NO_SOLUTION
    if code == IDLE:
        status = STANDING
    elif code == BROKEN:
        status = NOT_FINITE
    elif code == EXHAUSTED:
        status = WORK_BOUND
    elif code in (FALLEN, AT_END):
        status = UNFINISHED
        write_frame(model, state, work, output)
        limit = limits.loss_limit if code == FALLEN else NOTED_GAP
        joint, how, since = collapse_of(model, state, work, limit)
        if joint >= 0:
            status = COLLAPSED
            results.collapse_joint[row], results.collapse_mode[row] = joint, how
            results.collapse_time[row] = since
    kinetic, potential = energies_of(model, state)
    energy[Energy.KINETIC] = kinetic
    energy[Energy.POTENTIAL] = potential - clock[Clock.START]
    energy[Energy.LARGEST_KINETIC] = max(energy[Energy.LARGEST_KINETIC], kinetic)
    results.status[row], results.end_time[row] = status, clock[Clock.TIME]
    record_end(model, state)
    given = state.loss, state.count, energy, state.peak
    kept = results.loss, results.count, results.energy, results.peak
    for k in range(4):
        for i in range(given[k].size):
            kept[k][row, i] = given[k][i]
    results.model_time[row, AT_REST] = clock[Clock.RESTING]
    results.model_time[row, ALL] = clock[Clock.MOVING]
