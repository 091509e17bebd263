"""Motion between two events: Runge-Kutta steps of the few bodies, with step control.

Every law of the mechanism is looked at after each step. A step is cut where the slope of the
ground acceleration changes, and where a law ends.
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.collapse import (
    is_beyond_return,
    note_gap,
    relative_turn,
    smallest_gap,
)
from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.energy import kinetic_energy
from archfrag.mechanics.kinematics import clearance, measure_slip
from archfrag.mechanics.laws import OPEN
from archfrag.mechanics.ledger import exhausted
from archfrag.mechanics.status import Count, Energy, Peak
from archfrag.methods.events import (
    THRESHOLD,
    all_margins,
    closed_inside,
    keep_margins,
    locate,
    margin_at,
    may_have_closed,
)
from archfrag.methods.few_bodies import (
    BY_FRICTION,
    BY_GROUND,
    N_STAGE,
    A,
    dense_state,
    dense_work,
    evaluate,
    keep_stage,
    make_dense,
    project,
    take_step,
)
from archfrag.methods.recording import record_step

WEIGHT = A[N_STAGE - 1]
EVENT = 1
STOPPED = 2
BROKEN = 3
COLLAPSE = 4
BOUND = 5
# Largest step and largest one while a joint is without contact, over the time of a fall through
# a joint's length; first step after an event.
LONGEST = 0.1
LONGEST_OPEN = 0.05
FIRST = 0.02
SHORTEST = 1e-9
# Bringing voussoirs into mega-voussoirs, and those onto their contacts, may move none of them
# by more than this part of a joint's length; a step may not by more than FARTHEST nor by more
# than its error.
REGROUPED = 1e-6
FARTHEST = 3e-5
# Steps longer than this, over the time of a fall, are searched for gaps that close and open.
SEARCHED = 0.05
# Looks for a peak in a step in which a body turned back.
PEAK_SAMPLES = 16
# Motion smaller than this part of a joint's length, or of the speed of a fall through it, need
# not be relatively exact.
FLOOR = 0.02


class Pace(NamedTuple):
    """Scales of a run, and what changes from step to step."""

    length: float  # shortest joint [m]
    falling: float  # speed of a fall through it [m/s]
    share: float  # one over the weight [1/N]
    tolerance: float
    next_break: np.ndarray  # (n_sample,) next sample at which the slope of the ground changes
    # (4,) time [s], size of the next step [s], square of the largest displacement of a body [m2],
    # time of the next frame [s]
    clock: np.ndarray
    outward: np.ndarray  # (n_body,) rate of the squared displacement at the last step [m2/s]


@allocating
def find_breaks(ground):
    """For each sample the next one at which the ground acceleration changes its slope.

    Parameters
    ----------
    ground : GroundMotion

    Returns
    -------
    ndarray, (n_sample,) int64
    """
    n = ground.horizontal.size
    out = np.empty(n, np.int64)
    largest = max(np.max(np.abs(ground.horizontal)), np.max(np.abs(ground.vertical)))
    out[n - 1] = n - 1
    following = n - 1
    for i in range(n - 2, -1, -1):
        out[i] = following
        if i > 0:
            x, y = ground.horizontal, ground.vertical
            bend = abs(x[i - 1] - 2.0 * x[i] + x[i + 1]) + abs(y[i - 1] - 2.0 * y[i] + y[i + 1])
            if bend > 1e-12 * largest:
                following = i
    return out


@kernel
def segment_at(time, ground, next_break):
    """Where the ground acceleration is linear in time.

    Returns
    -------
    end : float
        Until when [s]; inf after the record.
    gx, sx, gy, sy : float
        Acceleration at `time` and its rate [m/s2], [m/s3].
    """
    dt = ground.time_step
    last = ground.horizontal.size - 1
    i = int(np.floor(time / dt + 1e-9))
    if i >= last:
        return np.inf, 0.0, 0.0, 0.0, 0.0
    part = time - i * dt
    sx = (ground.horizontal[i + 1] - ground.horizontal[i]) / dt
    sy = (ground.vertical[i + 1] - ground.vertical[i]) / dt
    gx = ground.horizontal[i] + sx * part
    gy = ground.vertical[i] + sy * part
    return next_break[i] * dt, gx, sx, gy, sy


@kernel
def note_peaks(mechanism, few, position, velocity, chain, pace, ledger):
    """Largest displacement and rotation up to now, those inside the step by its rates."""
    for k in range(position.shape[0]):
        ledger.peak[Peak.ROTATION] = max(ledger.peak[Peak.ROTATION], abs(position[k, 2]))
        c, s = np.cos(position[k, 2]), np.sin(position[k, 2])
        for i in range(mechanism.first[k], mechanism.last[k] + 1):
            rx, ry = mechanism.offset[i, 0], mechanism.offset[i, 1]
            x, y = c * rx - s * ry, s * rx + c * ry
            dx = position[k, 0] + x - chain.centroid[i, 0]
            dy = position[k, 1] + y - chain.centroid[i, 1]
            vx = velocity[k, 0] - velocity[k, 2] * y
            vy = velocity[k, 1] + velocity[k, 2] * x
            square = dx * dx + dy * dy
            rate = dx * vx + dy * vy
            if square > pace.clock[2]:
                pace.clock[2] = square
            pace.outward[i] = rate


@kernel
def _turned_back(mechanism, chain, pace, position, velocity):
    """Whether a body that moved away before the last step comes back in the state after it."""
    for k in range(position.shape[0]):
        first, last = mechanism.first[k], mechanism.last[k]
        for i in (first, (first + last) // 2, last):
            rx, ry = mechanism.offset[i, 0], mechanism.offset[i, 1]
            q, v = position[k], velocity[k]
            c, s = np.cos(q[2]), np.sin(q[2])
            x, y = c * rx - s * ry, s * rx + c * ry
            dx, dy = q[0] + x - chain.centroid[i, 0], q[1] + y - chain.centroid[i, 1]
            rate = dx * (v[0] - v[2] * y) + dy * (v[1] + v[2] * x)
            if pace.outward[i] > 0.0 and rate < 0.0:
                return True
    return False


@kernel
def _note_inside(mechanism, few, chain, pace, ledger, part, position, velocity):
    """Peaks in the first `part` of a step, from its dense output; the state is room for it."""
    for k in range(1, PEAK_SAMPLES):
        dense_state(few, part * k / PEAK_SAMPLES, position, velocity)
        note_peaks(mechanism, few, position, velocity, chain, pace, ledger)


@kernel
def _collapsing(few, position, joints, loss_limit):
    """Whether the state evaluated last is a collapse; notes gaps of joints without contact."""
    collapsing = False
    for k in range(few.work.mode.size):
        gap, slip, length = 0.0, few.slip[k], few.length[k]
        if few.work.mode[k] == OPEN:
            gap = smallest_gap(k, few.before, few.after) / length
            nearer = clearance(k, 1, few.before, few.after) < clearance(
                k, 0, few.before, few.after
            )
            slip = measure_slip(k, 1 if nearer else 0, few.before, few.after)
            note_gap(few.joint[k], gap, joints)
        turn = relative_turn(k, position)
        if is_beyond_return(few.work.mode[k], gap, slip / length, turn, loss_limit):
            collapsing = True
    return collapsing


@kernel
def begin(chain, mechanism, few, margins, pace, ground):
    """First evaluation after an event; brings the state onto the contacts.

    Returns
    -------
    float
        Smallest margin; nan where the mechanism's reactions are not unique, or the state is too
        far from its contacts.
    """
    _, gx, _, gy, _ = segment_at(pace.clock[0], ground, pace.next_break)
    for _ in range(2):
        if not evaluate(few, few.position, few.velocity, gx, gy):
            return np.nan
        if not project(few, few.position, few.velocity, REGROUPED * pace.length):
            return np.nan
    if not evaluate(few, few.position, few.velocity, gx, gy):
        return np.nan
    keep_stage(few, 0, few.velocity, gx, gy)
    worst = all_margins(
        chain,
        mechanism,
        few,
        few.position,
        few.velocity,
        gx,
        gy,
        pace.share,
        pace.falling,
        margins,
    )
    keep_margins(few, margins)
    return worst


@kernel
def _accept(few):
    """Take the state that was evaluated last as the present one."""
    for i in range(few.position.shape[0]):
        for c in range(3):
            few.position[i, c] = few.new_position[i, c]
            few.velocity[i, c] = few.new_velocity[i, c]


@kernel
def _farthest(size, pace):
    """How far a step may be moved to bring its end onto the contacts [m]."""
    return min(size, FARTHEST * pace.length)


@kernel
def integrate(chain, whole, joints, few, margins, pace, ground, stop, options, frames, ledger):
    """Move the few bodies until a law ends or `stop` is reached.

    Parameters
    ----------
    chain : Chain
    whole : Whole
        Its mechanism is that of `few`.
    joints : JointState
    few : Few
        At ``pace.clock[0]``, after `begin`; moved on.
    margins : Margins
    pace : Pace
    ground : GroundMotion
    stop : float [s]
    options : Options
    frames : Frames
    ledger : Ledger

    Returns
    -------
    int
        EVENT (``margins.trigger`` says which law), STOPPED, COLLAPSE, BOUND, or BROKEN where
        the equations of motion could not be solved.
    """
    clock, mechanism = pace.clock, whole.mechanism
    unit = pace.length / pace.falling
    recording = frames.time.size > 0
    longest = LONGEST * unit
    for k in range(few.work.mode.size):
        if few.work.mode[k] == OPEN:
            longest = LONGEST_OPEN * unit
    while True:
        if exhausted(ledger, options):
            return BOUND
        time = clock[0]
        end, gx, sx, gy, sy = segment_at(time, ground, pace.next_break)
        end = min(end, stop)
        step = min(clock[1], longest)
        cut = time + 1.001 * step >= end
        if cut:
            step = end - time
        size = pace.tolerance * (np.sqrt(clock[2]) + FLOOR * pace.length)
        speed = 0.0
        for i in range(few.velocity.shape[0]):
            speed = max(speed, abs(few.velocity[i, 0]), abs(few.velocity[i, 1]))
        speed = pace.tolerance * (speed + FLOOR * pace.falling)
        possible, error = take_step(few, step, gx, sx, gy, sy, size, speed)
        if not possible:
            return BROKEN
        ledger.count[Count.STEPS] += 1
        if not error <= 1.0:
            ledger.count[Count.SHORTENED] += 1
            clock[1] = step * max(0.2, 0.9 * error**-0.2) if np.isfinite(error) else 0.1 * step
            if clock[1] < SHORTEST * unit:
                return BROKEN
            continue
        gx_end, gy_end = gx + sx * step, gy + sy * step
        worst = all_margins(
            chain, mechanism, few, few.new_position, few.new_velocity, gx_end, gy_end,
            pace.share, pace.falling, margins,
        )  # fmt: skip
        last, dense = 1.0, False
        suspect = may_have_closed(few, margins, step)
        if suspect or step > SEARCHED * unit:
            make_dense(few, step)
            dense = True
            inside = closed_inside(few, suspect)
            if inside > 0.0:
                last = inside
                worst = margin_at(
                    chain, mechanism, few, last, step, gx, sx, gy, sy, pace.share,
                    pace.falling, margins,
                )  # fmt: skip
        if not worst >= -THRESHOLD:
            if np.isnan(worst):
                return BROKEN
            if not dense:
                make_dense(few, step)
            theta = locate(
                chain, mechanism, few, step, last, gx, sx, gy, sy, pace.share, pace.falling,
                margins,
            )  # fmt: skip
            if np.isnan(theta):
                return BROKEN
            ledger.energy[Energy.GROUND] += dense_work(few, BY_GROUND, theta)
            ledger.energy[Energy.FRICTION] += dense_work(few, BY_FRICTION, theta)
            clock[0] = time + theta * step
            _accept(few)
            if recording and clock[3] <= clock[0]:
                record_step(
                    chain, whole, joints, few, time, step, theta, gx, sx, gy, sy, frames,
                    options.frame_interval, clock, ledger,
                )  # fmt: skip
                later = theta * step
                evaluate(few, few.position, few.velocity, gx + sx * later, gy + sy * later)
            if _turned_back(mechanism, chain, pace, few.position, few.velocity):
                _note_inside(
                    mechanism, few, chain, pace, ledger, theta, few.new_position, few.new_velocity
                )  # fmt: skip
            note_peaks(mechanism, few, few.position, few.velocity, chain, pace, ledger)
            if not project(few, few.position, few.velocity, _farthest(size, pace)):
                ledger.count[Count.REFUSED] += 1
                return BROKEN
            return EVENT
        due = recording and clock[3] <= time + step + 1e-9 * options.frame_interval
        turned = _turned_back(mechanism, chain, pace, few.new_position, few.new_velocity)
        if (due or turned) and not dense:
            make_dense(few, step)
        if not project(few, few.new_position, few.new_velocity, _farthest(size, pace)):
            # Its drift off the contacts is larger than its error: too long a step.
            ledger.count[Count.REFUSED] += 1
            clock[1] = 0.25 * step
            if clock[1] < SHORTEST * unit:
                return BROKEN
            continue
        collapsing = _collapsing(few, few.new_position, joints, options.loss_limit)
        if turned:
            _note_inside(
                mechanism, few, chain, pace, ledger, 1.0, few.position, few.velocity
            )  # fmt: skip
        for p in range(2):
            done = 0.0
            for stage in range(N_STAGE - 1):
                done += WEIGHT[stage] * few.stage_power[stage, p]
            ledger.energy[Energy.GROUND if p == BY_GROUND else Energy.FRICTION] += step * done
        _accept(few)
        for i in range(few.position.shape[0]):
            for c in range(3):
                few.stage_velocity[i, 0, c] = few.stage_velocity[i, N_STAGE - 1, c]
                few.stage_acceleration[i, 0, c] = few.stage_acceleration[i, N_STAGE - 1, c]
        for p in range(2):
            few.stage_power[0, p] = few.stage_power[N_STAGE - 1, p]
        if due:
            record_step(
                chain, whole, joints, few, time, step, 1.0, gx, sx, gy, sy, frames,
                options.frame_interval, clock, ledger,
            )  # fmt: skip
            evaluate(few, few.position, few.velocity, gx_end, gy_end)
        keep_margins(few, margins)
        note_peaks(mechanism, few, few.position, few.velocity, chain, pace, ledger)
        energy = kinetic_energy(few.chain.mass, few.chain.inertia, few.velocity)
        ledger.energy[Energy.LARGEST_KINETIC] = max(ledger.energy[Energy.LARGEST_KINETIC], energy)
        clock[0] = end if cut else time + step
        growth = 5.0 if error < 1e-4 else min(5.0, 0.9 * error**-0.2)
        proposed = step * growth
        clock[1] = max(proposed, clock[1]) if cut else proposed
        if collapsing:
            return COLLAPSE
        if clock[0] >= stop:
            return STOPPED
