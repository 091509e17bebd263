"""Motion of a linkage between impacts: steps of Dormand and Prince, and where they end.

What ends a motion is located by steps of the right size from where the last step began, so that
states at events and in frames are as exact as those at the end of steps.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.delassus import Contacts
from archfrag.mechanics.ground import segment_at
from archfrag.mechanics.kinematics import move_faces
from archfrag.mechanics.ledger import book_motion, exhausted, write_frame
from archfrag.mechanics.linkage import (
    N_BAR,
    N_PIN,
    Linkage,
    Pose,
    pose_linkage,
    relative_turn,
    straightness,
)
from archfrag.mechanics.linkage_motion import (
    accelerate,
    carry,
    find_forces,
    first_moments,
    height_moment,
    inertia_of,
    joint_reactions,
    pin_press,
)
from archfrag.mechanics.residuals import measure_state
from archfrag.mechanics.status import CollapseMode, Count, Energy, Model, Status
from archfrag.mechanics.types import Chain, Frames, GroundMotion, Ledger, MechanismLog, Options
from archfrag.methods.event_driven.runge_kutta import N_STAGE, A, C, E

COLLAPSED = int(Status.COLLAPSED)
UNFINISHED = int(Status.UNFINISHED)
NOT_FINITE = int(Status.NOT_FINITE)
WORK_BOUND = int(Status.WORK_BOUND)
HINGING, OVERTURNING = int(CollapseMode.HINGING), int(CollapseMode.OVERTURNING)
GO, CLOSED = -1, -2

# Three pins are in line where the sine of the angle at the middle one is this part of that at
# rest: there the first or the last bar turns back, and the arch snaps through.
STRAIGHT = 0.05
# Steps over the time of a fall through a joint's length: largest, first after an event, smallest.
LONGEST, FIRST, SHORTEST = 0.25, 0.02, 1e-10
# Rotations smaller than this, and speeds smaller than this part of that of a fall through a
# joint's length, need not be relatively exact.
FLOOR = 0.02
N_ROOT, ROOT = 60, 1e-13
# What a root is sought of.
OF_CLOSING, OF_TURNING, OF_FALLING = 0, 1, 2


class Clock(IntEnum):
    """Entries of ``Case.clock``."""

    TIME = 0  # [s]
    STEP = 1  # size of the next step [s]
    NEXT_FRAME = 2  # [s]
    START_ENERGY = 3  # kinetic and potential energy at the beginning [J]
    PULLS = 4  # whether a pin pulls


N_CLOCK = len(Clock)


class Case(NamedTuple):
    """What all parts of a run share."""

    chain: Chain
    ground: GroundMotion
    options: Options
    ledger: Ledger
    frames: Frames
    log: MechanismLog
    plus: Linkage  # for a ground accelerating towards +x
    minus: Linkage
    pose: Pose
    rest: np.ndarray  # (2,) limits of the rest range
    breaks: np.ndarray  # (n_sample,) next sample at which the ground's slope changes
    length: float  # shortest joint [m]
    falling: float  # speed of a fall through it [m/s]
    state: np.ndarray  # (3,) angle [rad], speed [rad/s], work of the ground [J]
    trial: np.ndarray  # (3,) at the end of the step taken last
    stage: np.ndarray  # (7, 3) derivatives of the state at the stages
    slopes: np.ndarray  # (4,) ground acceleration at `time` and its rate: x, x, y, y
    position: np.ndarray  # (n_body, 3) of all voussoirs
    velocity: np.ndarray  # (n_body, 3)
    unit: np.ndarray  # (n_body, 3) velocities of a linkage for a unit speed
    before: np.ndarray  # (n_joint, 2, 2) faces
    after: np.ndarray
    mid: np.ndarray  # (n_joint, 2) middles of the joints [m]
    reaction: np.ndarray  # (n_joint, 3)
    mode: np.ndarray  # (n_joint,) int8
    lengths: np.ndarray  # (n_joint,) [m]
    slip: np.ndarray  # (n_joint,) none [m]
    contacts: Contacts  # workspace
    relative: np.ndarray  # (n_joint, 3) workspace
    straight: np.ndarray  # (2,) `straightness` at rest of the linkage that moves
    clock: np.ndarray  # (len(Clock),)


@kernel
def take_step(case, linkage, step):
    """Step of Dormand and Prince from ``case.state`` into ``case.trial``.

    Returns
    -------
    float
        Estimated error over the one allowed; nan where the linkage does not reach.
    """
    chain, state, trial, stage, slopes = (
        case.chain, case.state, case.trial, case.stage, case.slopes
    )  # fmt: skip
    for s in range(N_STAGE):
        for c in range(3):
            trial[c] = state[c]
            for p in range(s):
                trial[c] += step * A[s, p] * stage[p, c]
        late = C[s] * step
        stage[s, 0] = trial[1]
        stage[s, 1], stage[s, 2] = accelerate(
            linkage, case.pose, trial[0], trial[1], slopes[0] + slopes[1] * late,
            slopes[2] + slopes[3] * late, chain.gravity,
        )  # fmt: skip
    far = quick = 0.0
    for s in range(N_STAGE):
        far += E[s] * stage[s, 0]
        quick += E[s] * stage[s, 1]
    # The fastest body counts: the first one of a mirrored linkage may hardly turn.
    gear = 0.0
    for k in range(linkage.count[0]):
        gear = max(gear, abs(case.pose.rate[k]))
    tolerance = case.options.tolerance
    allowed = tolerance * (max(abs(state[0]), abs(trial[0])) + FLOOR / gear)
    allowed_speed = max(abs(state[1]), abs(trial[1])) + FLOOR * case.falling / case.length / gear
    return max(
        abs(step * far) / allowed, abs(step * quick) / (tolerance * allowed_speed)
    )  # fmt: skip


@kernel
def _pose_trial(case, linkage, step):
    """Pose, acceleration and pin forces at the end of the step taken last.

    Returns
    -------
    acceleration : float [rad/s2]
    residual : float
        Of `find_forces`.
    """
    gx = case.slopes[0] + case.slopes[1] * step
    gy = case.slopes[2] + case.slopes[3] * step
    q, speed, gravity = case.trial[0], case.trial[1], case.chain.gravity
    acceleration, _ = accelerate(linkage, case.pose, q, speed, gx, gy, gravity)
    residual = find_forces(linkage, case.pose, speed, acceleration, gx, gy, gravity)
    return acceleration, residual


@kernel
def _weakest_pin(case, linkage):
    """Pin that presses least, and how much, over the weight [1]."""
    weight = 0.0
    for k in range(linkage.count[0]):
        weight += linkage.mass[k] * case.chain.gravity
    pin, least = 0, np.inf
    for k in range(N_PIN if linkage.count[0] == N_BAR else 1):
        press = pin_press(case.chain, linkage, case.pose, k) / weight
        if press < least:
            pin, least = k, press
    return pin, least


@kernel
def fall_margin(case, linkage):
    """How far the pose that was evaluated last is from collapse.

    Returns
    -------
    margin : float
        Negative: collapsed.
    pin, mode : int
        The one that is nearest to it, and the mode of collapse.
    """
    pose = case.pose
    weakest, press = _weakest_pin(case, linkage)
    _, sy = first_moments(linkage, pose)
    mass, _ = inertia_of(linkage, pose)
    rising = sy * case.chain.gravity / mass * case.length / case.falling**2
    closing = -case.trial[1] * case.length / case.falling
    margin, pin, mode = max(press, rising, closing), weakest, HINGING
    n = linkage.count[0]
    for k in range(N_PIN if n == N_BAR else 1):
        left = 0.5 * np.pi - abs(relative_turn(linkage, pose, k))
        if left < margin:
            margin, pin, mode = left, k, OVERTURNING
    if n == N_BAR:
        for k in range(1, N_BAR):
            left = straightness(pose, k) / case.straight[k - 1] - STRAIGHT
            if left < margin:
                margin, pin, mode = left, k, HINGING
    return margin, pin, mode


@kernel
def _measure(case, linkage, kind, step):
    """What is zero at an event, after a step of the given size."""
    error = take_step(case, linkage, step)
    if not np.isfinite(error):
        return -1.0
    if kind == OF_TURNING:
        return -case.trial[1] if case.state[1] < 0.0 else case.trial[1]
    if kind == OF_CLOSING:
        return case.trial[0] if case.state[0] > 0.0 else case.trial[0] / step
    _pose_trial(case, linkage, step)
    return fall_margin(case, linkage)[0]


@kernel
def locate(case, linkage, kind, step):
    """Size of the step that ends at an event; the state there is left in ``case.trial``.

    Regula falsi in the Illinois form, every value by a step of that size from the beginning.

    Returns
    -------
    float
        0 where the event is at the beginning.
    """
    low, high = 0.0, step
    at_high = _measure(case, linkage, kind, high)
    at_low = abs(case.state[1])
    if kind == OF_CLOSING and case.state[0] > 0.0:
        at_low = case.state[0]
    if kind == OF_FALLING or at_low == 0.0:
        at_low, low = -1.0, high
        while at_low <= 0.0:
            low *= 0.5
            if low < 1e-12 * step:
                return 0.0
            at_low = _measure(case, linkage, kind, low)
    side = 0
    none = ROOT * max(at_low, -at_high)
    for _ in range(N_ROOT):
        here = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < here < high:
            here = 0.5 * (low + high)
        value = _measure(case, linkage, kind, here)
        if abs(value) <= none or high - low < ROOT * step:
            return here
        if value < 0.0:
            high, at_high = here, value
            if side == -1:
                at_low *= 0.5
            side = -1
        else:
            low, at_low = here, value
            if side == 1:
                at_high *= 0.5
            side = 1
    _measure(case, linkage, kind, high)
    return high


@kernel
def spread(case, linkage, step):
    """Voussoirs and their velocities where the step taken last ends; returns what `_pose_trial`
    does.
    """
    acceleration, residual = _pose_trial(case, linkage, step)
    carry(case.chain, linkage, case.pose, case.trial[1], case.position, case.velocity)
    return acceleration, residual


@kernel
def note_peaks(case):
    book_motion(case.chain, case.position, case.velocity, case.length, case.ledger)


@kernel
def write(case, time):
    """Frame of the present state, at a time [s]."""
    write_frame(
        case.frames, case.ledger, time, case.chain, case.position, case.velocity, case.reaction,
        case.mode, 1.0,
    )  # fmt: skip


@kernel
def gather_moving(case, linkage, step):
    """Voussoirs, faces and reactions where the step taken last ends."""
    acceleration, _ = spread(case, linkage, step)
    gx = case.slopes[0] + case.slopes[1] * step
    gy = case.slopes[2] + case.slopes[3] * step
    move_faces(case.chain, case.position, case.before, case.after)
    for j in range(case.mode.size):
        for d in range(2):
            total = case.before[j, 0, d] + case.before[j, 1, d]
            case.mid[j, d] = 0.25 * (total + case.after[j, 0, d] + case.after[j, 1, d])
    joint_reactions(
        case.chain, linkage, case.pose, case.position, case.trial[1], acceleration, gx, gy,
        case.mid, case.reaction,
    )  # fmt: skip


@kernel
def write_moving(case, linkage, step):
    """Frame where the step taken last ends."""
    gather_moving(case, linkage, step)
    write(case, case.clock[Clock.TIME] + step)


@allocating
def measure_moving(case, linkage, step):
    """Note how far the state where the step taken last ends is from the contact laws."""
    gather_moving(case, linkage, step)
    measure_state(
        case.chain, case.position, case.velocity, case.before, case.after, case.lengths,
        case.slip, case.reaction, case.mid, 1.0, case.contacts, case.relative, case.ledger.peak,
    )  # fmt: skip


@kernel
def _write_frames(case, linkage, step):
    """Frames that are due up to the end of a step; ``case.trial`` is that of `step` again."""
    clock = case.clock
    if case.frames.time.size == 0 or clock[Clock.NEXT_FRAME] > clock[Clock.TIME] + step:
        return
    while clock[Clock.NEXT_FRAME] <= clock[Clock.TIME] + step:
        part = max(clock[Clock.NEXT_FRAME] - clock[Clock.TIME], 0.0)
        take_step(case, linkage, part)
        write_moving(case, linkage, part)
        clock[Clock.NEXT_FRAME] += case.options.frame_interval
    take_step(case, linkage, step)


@allocating
def _book_step(case, linkage, step):
    """Take the trial state over; energies and pulls there, and now and then the residual."""
    ledger, clock, trial, state = case.ledger, case.clock, case.trial, case.state
    if ledger.count[Count.STEPS] % case.options.check_interval == 0:
        measure_moving(case, linkage, step)
    _pose_trial(case, linkage, step)
    pulls = _weakest_pin(case, linkage)[1] < 0.0
    ledger.count[Count.LOSSES] += pulls and clock[Clock.PULLS] == 0.0
    clock[Clock.PULLS] = 1.0 if pulls else 0.0
    energy = ledger.energy
    energy[Energy.GROUND] += trial[2]
    state[0], state[1], state[2] = trial[0], trial[1], 0.0
    kinetic = 0.5 * inertia_of(linkage, case.pose)[0] * state[1] ** 2
    energy[Energy.LARGEST_KINETIC] = max(energy[Energy.LARGEST_KINETIC], kinetic)
    raised = case.chain.gravity * height_moment(linkage, case.pose)
    pose_linkage(linkage, 0.0, case.pose)
    raised -= case.chain.gravity * height_moment(linkage, case.pose)
    stray = kinetic + raised - clock[Clock.START_ENERGY]
    stray -= energy[Energy.GROUND] + energy[Energy.IMPACT]
    energy[Energy.STRAY_PEAK] = max(energy[Energy.STRAY_PEAK], abs(stray))
    ledger.model_time[Model.FOUR_HINGES] += step
    clock[Clock.TIME] += step
    case.slopes[0] += case.slopes[1] * step
    case.slopes[2] += case.slopes[3] * step


@kernel
def _end_of(case, linkage, step):
    """Where in an accepted step something ends, and what: CLOSED, COLLAPSED or GO."""
    state, trial = case.state, case.trial
    closes = trial[0] <= 0.0
    turns_out = state[1] < 0.0 < trial[1]
    if turns_out and not closes:
        lowest = locate(case, linkage, OF_TURNING, step)
        if trial[0] < 0.0:
            closes, step = True, lowest
        else:
            take_step(case, linkage, step)
    if closes:
        return locate(case, linkage, OF_CLOSING, step), CLOSED
    turns_back = state[1] > 0.0 > trial[1]
    _pose_trial(case, linkage, step)
    if fall_margin(case, linkage)[0] < 0.0:
        return locate(case, linkage, OF_FALLING, step), COLLAPSED
    if turns_back:
        spread(case, linkage, locate(case, linkage, OF_TURNING, step))
        note_peaks(case)
        take_step(case, linkage, step)
    return step, GO


@allocating
def move(case, linkage, stop):
    """Integrate a linkage until it closes, collapses or time is up.

    Returns
    -------
    int
        CLOSED or a status.
    """
    clock, ground, slopes = case.clock, case.ground, case.slopes
    unit = case.length / case.falling
    clock[Clock.STEP] = FIRST * unit
    clock[Clock.PULLS] = 0.0
    pose_linkage(linkage, 0.0, case.pose)
    for k in range(1, N_BAR):
        case.straight[k - 1] = straightness(case.pose, k) if linkage.count[0] == N_BAR else 1.0
    while clock[Clock.TIME] < stop:
        if exhausted(case.ledger, case.options):
            return WORK_BOUND
        time = clock[Clock.TIME]
        end, slopes[0], slopes[1], slopes[2], slopes[3] = segment_at(time, ground, case.breaks)
        end = min(end, stop)
        step = min(clock[Clock.STEP], LONGEST * unit)
        cut = time + 1.001 * step >= end
        if cut:
            step = end - time
        error = take_step(case, linkage, step)
        case.ledger.count[Count.STEPS] += 1
        if not error <= 1.0:
            case.ledger.count[Count.SHORTENED] += 1
            clock[Clock.STEP] = step * (max(0.2, 0.9 * error**-0.2) if error < 1e5 else 0.1)
            if clock[Clock.STEP] < SHORTEST * unit:
                return NOT_FINITE
            continue
        taken, code = _end_of(case, linkage, step)
        _write_frames(case, linkage, taken)
        _book_step(case, linkage, taken)
        if code != GO:
            return code
        if cut:
            clock[Clock.TIME] = end
        proposed = step * (5.0 if error < 1e-4 else min(5.0, 0.9 * error**-0.2))
        clock[Clock.STEP] = max(proposed, clock[Clock.STEP]) if cut else proposed
    return UNFINISHED
