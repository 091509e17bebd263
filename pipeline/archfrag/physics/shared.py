"""What all methods share: begin and end of a run, its history, results and accuracy."""

from typing import NamedTuple

import numpy as np

from archfrag.physics.collapse import NOTED_GAP, collapse_of, loss_mode
from archfrag.physics.contact.laws import mode_of
from archfrag.physics.contact.placing import (
    clearance,
    move_faces,
    slip_and_gap,
    turn_of,
)
from archfrag.physics.contact.ties import is_pulled, reset_pulls
from archfrag.physics.energy import energies_of
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.numbers import copy_rows
from archfrag.physics.state import Clock, Model, model_of
from archfrag.physics.status import (
    CollapseMode,
    Count,
    Energy,
    Level,
    Loss,
    Peak,
    Status,
    Wait,
)

# Gap over joint length below which a corner is closed in a chain at rest [1].
CLOSED_GAP = 1e-7
# Speed over that of a fall through the longest joint below which a chain may be at rest [1].
STILL = 1e-7
# A chain on ties sways at rest if it has been calm for this time, over the time of a fall through
# its longest joint [1]: 10 s for a joint of 0.45 m.
CALM_TIME = 46.7
# Energy that is rounding, over weight times the longest joint's length [1].
NEGLIGIBLE = 1e-12
# A run is refused if its energy error, over the largest kinetic energy, is more than
# ENERGY_ALLOWED times its accuracy, or the overlap of its bodies, over a joint's length, more than
# OVERLAP_ALLOWED times. An accuracy finer than the default counts as the default.
ENERGY_ALLOWED = 10.0
LEAST_ENERGY = 1e-2
OVERLAP_ALLOWED = 0.1
LEAST_OVERLAP = 1e-4


def ready(options: Options, model: Model, rest: tuple[float, float]) -> Options:
    """Return `options` with the values that depend on the chain filled in.

    These are the speeds `still` and `held`, the range of rest, and a largest step that is at least
    the time step. `rest` has the ground accelerations, plus and minus, within which the chain
    rests [g]; nan if they are not known. It is ignored unless ``options.rests``.
    """
    still = float(STILL * np.sqrt(model.gravity * model.length.max()))
    plus, minus = rest if options.rests else (np.nan, np.nan)
    return options._replace(
        largest_step=max(float(options.largest_step), float(options.time_step)),
        still=still,
        held=-1.0 if options.rests else still,
        rest_plus=plus,
        rest_minus=minus,
    )


def new_results(n_run: int) -> Outcomes:
    """Allocate the results of `n_run` runs."""
    return Outcomes(
        status=np.zeros(n_run, np.int64),
        end_time=np.zeros(n_run),
        collapse_time=np.full(n_run, np.nan),
        collapse_joint=np.full(n_run, -1),
        collapse_mode=np.zeros(n_run, np.int64),
        loss=np.zeros((n_run, len(Loss))),
        count=np.zeros((n_run, len(Count))),
        energy=np.zeros((n_run, len(Energy))),
        model_time=np.zeros((n_run, len(Level))),
        peak=np.zeros((n_run, len(Peak))),
    )


@struct(forces=(3,))
class Output(NamedTuple):
    """Buffers for frames and log entries, with counts of both.

    Buffers of length zero take none.
    """

    frames: Frames
    log: MechanismLog
    # (2,) int64: number of frames, and of log entries, with those that found no room
    written: np.ndarray
    due: np.ndarray  # (1,) time from which the next frame is due [s]
    interval: float  # least time between frames [s]
    forces: np.ndarray  # (n_joint, 3) mean reactions over the last step, for frames
    span: np.ndarray  # (1,) length of that step [s]; zero where a motion begins


def output_to(frames: Frames, log: MechanismLog, interval: float) -> Output:
    """Make an empty output into given frames and log.

    Frames are at least `interval` [s] apart.
    """
    written = np.zeros(2, np.int64)
    forces = np.zeros(frames.reaction.shape[1:])
    due, span = np.zeros((2, 1))
    return Output(frames, log, written, due, float(interval), forces, span)


def no_output(n_body: int, n_joint: int) -> Output:
    """Make the output of runs without history."""
    frames = Frames(
        np.zeros(0),
        np.zeros((0, n_body, 3)),
        np.zeros((0, n_body, 3)),
        np.zeros((0, n_joint, 3)),
        np.zeros((0, n_joint), np.int8),
    )
    entries = np.zeros(0, np.int8), np.zeros(0, np.int32), np.zeros(0, np.int8)
    log = MechanismLog(np.zeros(0), *entries, np.zeros((0, n_joint), np.int8))
    return output_to(frames, log, np.inf)


@kernel
def write_frame(model, state, work, output):
    """Write a frame of the present state, if there is room.

    Its forces are those in ``work.reaction``.
    """
    frames = output.frames
    n = output.written[0]
    if n >= frames.time.size:
        return
    output.written[0] += 1
    frames.time[n] = state.clock[Clock.TIME]
    for i in range(frames.position.shape[1]):
        for c in range(3):
            frames.position[n, i, c] = state.position[i + 1, c] - model.start[i + 1, c]
            frames.velocity[n, i, c] = state.velocity[i + 1, c]
    copy_rows(work.reaction, frames.reaction[n], 0, state.slip.size)
    for j in range(state.slip.size):
        frames.mode[n, j] = mode_of(j, work)


@kernel
def log_change(state, time, cause, joint, level, output):
    """Log a change of the mechanism, or of the level of its model.

    `cause` is a Cause, `joint` the joint that caused the change or -1, and `level` the Level from
    then on. If the log has no room, the entry is only counted.

    Reads: state (contact, slide, slip), output (log, log.time, written).
    Writes: output (log.cause, log.joint, log.mode, log.model, log.time, written).
    """
    log = output.log
    entry = output.written[1]
    output.written[1] += 1
    if entry >= log.time.size:
        return
    log.time[entry] = time
    log.cause[entry] = cause
    log.joint[entry] = joint
    log.model[entry] = level
    for j in range(state.slip.size):
        log.mode[entry, j] = mode_of(j, state)


@kernel
def clear(state):
    """Reset the state and close all joints; keep positions and velocities."""
    state.contact[:] = 1.0
    state.bore_face[:] = 1.0
    state.lost_since[:] = np.nan
    state.slide[:] = state.slip[:] = state.impact[:] = 0.0
    state.lost_slip[:] = state.lost_rotation[:] = 0.0
    state.force[:] = 0.0
    state.loss[:] = state.clock[:] = state.count[:] = 0.0
    state.energy[:] = state.peak[:] = 0.0
    state.loss[Loss.TIME] = np.nan
    state.loss[Loss.JOINT] = -1.0


@kernel
def read_joints(model, state, work):
    """Set slips and modes of all joints of an initial state from positions alone.

    A joint that is open at both corners has been without contact since time zero.

    Writes: state (bore_face, contact, loss, lost_rotation, lost_since, lost_slip, slip).
    """
    for j in range(state.slip.size):
        slip, gap = slip_and_gap(j, False, False, work)
        length = model.length[j]
        closed = CLOSED_GAP * length
        k = 1 if clearance(j, 1, work) < clearance(j, 0, work) else 0
        state.slip[j] = 0.0 if abs(slip) < closed else slip
        if clearance(j, 1 - k, work) > closed:
            state.contact[j, 1 - k] = 0.0
            state.bore_face[j] = 0.0
        if gap > closed:
            state.contact[j, k] = 0.0
            state.bore_face[j] = 1.0
            state.lost_since[j] = 0.0
            state.lost_slip[j] = abs(state.slip[j]) / length
            state.lost_rotation[j] = abs(turn_of(j, model, state.position))
            gap = gap / length
            state.loss[Loss.WIDEST] = max(state.loss[Loss.WIDEST], gap)
            if gap > NOTED_GAP and np.isnan(state.loss[Loss.TIME]):
                state.loss[Loss.TIME] = 0.0
                state.loss[Loss.JOINT] = j
                state.loss[Loss.MODE] = loss_mode(j, state)


@kernel
def read_state(model, state, work):
    """Start a run from the positions and velocities in `state`; all else is reset.

    The number of its ground motion and the factor on the motion are kept.
    """
    clock = state.clock
    factor = clock[Clock.FACTOR]
    motion = clock[Clock.MOTION]
    energy = state.energy
    clear(state)
    reset_pulls(model, state, work)
    clock[Clock.FACTOR] = factor
    clock[Clock.MOTION] = motion
    kinetic, clock[Clock.START] = energies_of(model, state)
    energy[Energy.START_KINETIC] = energy[Energy.LARGEST_KINETIC] = kinetic
    move_faces(model, state.position, work)
    read_joints(model, state, work)


@kernel
def begin(model, state, work, motion, factor):
    """Start a run from rest where the model starts.

    `motion` is the number of its ground motion, `factor` multiplies that motion.
    """
    copy_rows(model.start, state.position, 0, state.position.shape[0])
    state.velocity[:] = 0.0
    state.clock[Clock.MOTION] = motion
    state.clock[Clock.FACTOR] = factor
    read_state(model, state, work)


@kernel
def record_end(model, state):
    """Record the largest rotation and the largest displacement of any body at the end of a run.

    Reads: model.start, state.position.
    Writes: state.peak.
    """
    rotation = farthest = 0.0
    for i in range(1, state.position.shape[0] - 1):
        dx = state.position[i, 0] - model.start[i, 0]
        dy = state.position[i, 1] - model.start[i, 1]
        farthest = max(farthest, dx * dx + dy * dy)
        rotation = max(rotation, abs(state.position[i, 2] - model.start[i, 2]))
    state.peak[Peak.END_ROTATION] = rotation
    state.peak[Peak.END_DISPLACEMENT] = np.sqrt(farthest)


@kernel
def sways_in_rest(model, state, options):
    """Return whether a chain sways on its ties for ever.

    It does if it has been calm for `CALM_TIME` since the ground motion ended. Elastic ties take no
    energy, and nothing gives any. In that time a motion away from an unstable position would have
    grown by many powers of ten, so the chain swings about a stable one.

    Reads: model.gravity, state.clock, options (follow, still).
    """
    calm = state.clock[Clock.TIME] - state.clock[Clock.LIVELY]
    enough = CALM_TIME * options.still / (STILL * model.gravity)
    return is_pulled(model) and min(calm, options.follow) >= enough


@inlined
def _copy(of, to):
    for k in range(of.size):
        to[k] = of[k]


@kernel
def end_run(model, state, work, options, output, results, row):
    """Write the outcome of a run that has ended into row `row` of `results`."""
    clock = state.clock
    energy = state.energy
    code = int(clock[Clock.CODE])
    status = Status.NO_CONTACT_SOLUTION
    if code == Wait.IDLE:
        status = Status.STANDING
    elif code == Wait.BROKEN:
        status = Status.NOT_FINITE
    elif code == Wait.EXHAUSTED:
        status = Status.WORK_BOUND
    elif code in (Wait.COLLAPSES, Wait.AT_END):
        status = Status.UNFINISHED
        write_frame(model, state, work, output)
        limit = options.loss_limit if code == Wait.COLLAPSES else NOTED_GAP
        joint, how, since = collapse_of(model, state, work, limit)
        stops = clock[Clock.FASTEST] < options.still
        if joint >= 0:
            status = Status.COLLAPSED
            results.collapse_joint[row] = joint
            results.collapse_mode[row] = how
            results.collapse_time[row] = since
        elif code == Wait.AT_END and (stops or sways_in_rest(model, state, options)):
            status = Status.STANDING
    kinetic, potential = energies_of(model, state)
    energy[Energy.KINETIC] = kinetic
    energy[Energy.POTENTIAL] = potential - clock[Clock.START]
    energy[Energy.LARGEST_KINETIC] = max(energy[Energy.LARGEST_KINETIC], kinetic)
    negligible = 0.0
    for i in range(model.mass.size):
        negligible += NEGLIGIBLE * model.mass[i] * (options.still / STILL) ** 2
    if (
        max(energy[Energy.BALANCE_ERROR_PEAK], energy[Energy.LARGEST_KINETIC])
        <= negligible
    ):
        energy[Energy.BALANCE_ERROR_PEAK] = 0.0
    results.status[row] = status
    results.end_time[row] = clock[Clock.TIME]
    record_end(model, state)
    _copy(state.loss, results.loss[row])
    _copy(state.count, results.count[row])
    _copy(energy, results.energy[row])
    _copy(state.peak, results.peak[row])
    results.model_time[row, Level.REST] = clock[Clock.RESTING]
    results.model_time[row, Level.ALL_VOUSSOIRS] = clock[Clock.MOVING]


def is_accurate(chain: Chain, options: Options, results: Outcomes) -> np.ndarray:
    """Return a mask of runs whose energy error and overlap of bodies are within their tolerance.

    A run that neither stands nor has collapsed at its end counts as accurate.
    """
    energy = results.energy
    overlap = results.peak[:, Peak.OVERLAP]
    allowed = max(ENERGY_ALLOWED * options.accuracy, LEAST_ENERGY)
    largest = np.maximum(
        energy[:, Energy.LARGEST_KINETIC], energy[:, Energy.START_KINETIC]
    )
    weight = chain.gravity * float(np.sum(chain.mass))
    tiny = NEGLIGIBLE * weight * float(model_of(chain).length.max())
    deepest = max(OVERLAP_ALLOWED * options.accuracy, LEAST_OVERLAP)
    good = energy[:, Energy.BALANCE_ERROR_PEAK] <= allowed * largest + tiny
    ended = np.isin(results.status, (Status.STANDING, Status.COLLAPSED))
    return ~ended | (good & (overlap <= deepest))


def refuse(results: Outcomes, rows: np.ndarray) -> None:
    """Mark the runs `rows` as inaccurate: failures, which are neither collapse nor survival."""
    results.status[rows] = Status.INACCURATE
    results.collapse_time[rows] = np.nan
    results.collapse_joint[rows] = -1
    results.collapse_mode[rows] = CollapseMode.NONE


def checked(chain: Chain, options: Options, results: Outcomes) -> Outcomes:
    """Mark the inaccurate runs in `results` as failures; return `results`."""
    refuse(results, np.flatnonzero(~is_accurate(chain, options, results)))
    return results
