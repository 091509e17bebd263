"""Integrate between two events by Runge-Kutta steps of mega-voussoirs, with step control.

Every law of the mechanism is looked at after each step. A step is cut where the slope of the
ground acceleration changes, and where a law ends.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from archfrag.physics.collapse import RIGHT_ANGLE, record_gap
from archfrag.physics.contact.path import Path
from archfrag.physics.contact.placing import clearance, move_faces, place_contacts
from archfrag.physics.energy import kinetic_energy, record_calm
from archfrag.physics.events import runge_kutta
from archfrag.physics.events.locate import (
    THRESHOLD,
    MechanismMotion,
    closed_inside,
    find_margins,
    keep_margins,
    locate,
    margins_at,
)
from archfrag.physics.ground import Grounds, ground_after, segment_at
from archfrag.physics.interface import Options
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.mega_voussoirs.assemble import MegaVoussoirs, split_state
from archfrag.physics.mega_voussoirs.first_level import pose, project, solve_first_level
from archfrag.physics.mega_voussoirs.second_level import joint_reactions
from archfrag.physics.numbers import sine_cosine
from archfrag.physics.shared import write_frame
from archfrag.physics.state import Clock, Law, Model, State, Work
from archfrag.physics.status import Count, Energy, Peak

# How a stretch of motion ends: at the time given, with an event, with a collapse, with the work
# allowed spent, or where the equations of motion have no solution.
STOPPED = 0
EVENT = 1
COLLAPSES = 2
BOUND = 3
BROKEN = 4
# Largest step, over the time of a fall through a joint's length; first step after an event.
LONGEST = 0.1
FIRST = 0.02
SHORTEST = 1e-9
# Bringing voussoirs into mega-voussoirs, and those onto their contacts, may move none of them
# by more than this part of a joint's length; a step may not by more than FARTHEST nor by more
# than its error.
REGROUPED = 1e-6
FARTHEST = 3e-5
# Distances from the contacts, and rates, that are left after a step, over the error allowed to it.
DRIFT = 0.01
# Looks for a peak in a step in which a body came to a halt moving outwards, or may have landed.
PEAK_SAMPLES = 16
# Motions smaller than this part of a joint's length, or of the speed of a fall through it, need
# not be relatively exact.
FLOOR = 0.02


class Progress(IntEnum):
    """Entries of ``Run.progress``."""

    STEP = 0  # size of the next step [s]
    FARTHEST = 1  # square of the largest displacement of a body [m2]
    FOUR_HINGES = 2  # time spent in that model [s]
    MEGA_VOUSSOIRS = 3  # time spent in that model [s]
    WINDOW = 4  # for which all voussoirs are stepped [s]
    QUIESCENT_STEPS = 5  # after so many steps without a change they are no longer
    QUIESCENT_UNTIL = 6  # stepped again before this the window doubles [s]
    LEAVES_REST = 7  # one where the chain has just begun to move
    JAMMED = 8  # one where a slip was ended by unlimited friction
    CAUSE = 9  # of the next entry of the log
    JOINT = 10  # of the next entry of the log
    SWITCH = 11  # cause for which all voussoirs are stepped


@struct()
class Run(NamedTuple):
    """A run: the chain, its mega-voussoirs, ground motion and options."""

    law: Law  # of all voussoirs
    model: Model
    state: State
    work: Work
    mega: MegaVoussoirs
    motion: MechanismMotion
    progress: np.ndarray  # (len(Progress),)
    recent: np.ndarray  # (n,) times of the last events [s]
    outward: np.ndarray  # (n_body + 2,) rate of the squared displacement [m2/s]
    grounds: Grounds  # one motion
    path: Path
    options: Options


@inlined
def look_outward(run, mega, position, velocity):
    """Record the rates at which voussoirs move away from rest.

    Returns whether one that moved away when they were kept last comes back.
    """
    comes_back = False
    for k in range(1, position.shape[0] - 1):
        s, c = sine_cosine(position[k, 2])
        for i in range(mega.first[k], mega.last[k] + 1):
            x = c * mega.offset[i, 0] - s * mega.offset[i, 1]
            y = s * mega.offset[i, 0] + c * mega.offset[i, 1]
            dx = position[k, 0] + x - run.model.start[i, 0]
            dy = position[k, 1] + y - run.model.start[i, 1]
            rate = dx * (velocity[k, 0] - velocity[k, 2] * y)
            rate += dy * (velocity[k, 1] + velocity[k, 2] * x)
            comes_back = comes_back or (run.outward[i] > 0.0 > rate)
            run.outward[i] = rate
    return comes_back


@inlined
def record_place(run, mega, position):
    """Record the largest displacement and rotation so far."""
    rotation = run.state.peak[Peak.ROTATION]
    farthest = run.progress[Progress.FARTHEST]
    for k in range(1, position.shape[0] - 1):
        s, c = sine_cosine(position[k, 2])
        for i in range(mega.first[k], mega.last[k] + 1):
            x = mega.offset[i, 0]
            y = mega.offset[i, 1]
            dx = position[k, 0] + c * x - s * y - run.model.start[i, 0]
            dy = position[k, 1] + s * x + c * y - run.model.start[i, 1]
            rotation = max(rotation, abs(position[k, 2] - run.model.start[i, 2]))
            farthest = max(farthest, dx * dx + dy * dy)
    run.state.peak[Peak.ROTATION] = rotation
    run.progress[Progress.FARTHEST] = farthest


@inlined
def _has_collapsed(run, mega, position):
    """Return whether a joint has lost contact for good; records gaps of joints without contact."""
    collapsed = False
    work = mega.work
    for k in range(mega.work.slip.shape[0]):
        per_length = 1.0 / mega.model.length[k]
        if work.contact[k, 0] < 0.5 and work.contact[k, 1] < 0.5:
            gap = clearance(k, 0, work.face, work.tangent)
            gap = min(gap, clearance(k, 1, work.face, work.tangent)) * per_length
            record_gap(mega.joint[k], run.state, gap, True)
            collapsed = collapsed or gap > run.options.loss_limit
        rotation = position[k + 1, 2] - position[k, 2]
        collapsed = collapsed or abs(work.slip[k]) * per_length >= 1.0
        collapsed = collapsed or abs(rotation) >= RIGHT_ANGLE
    return collapsed


@kernel
def recover_voussoirs(mega, position, velocity, state):
    """Set the state of all voussoirs, and slips of their joints, from the mega-voussoirs.

    Reads: mega (count, group, joint, offset, work.slip), position, velocity.
    Writes: state (position, slip, velocity).
    """
    split_state(mega, position, velocity, state.position, state.velocity)
    for k in range(mega.work.slip.shape[0]):
        state.slip[mega.joint[k]] = mega.work.slip[k]


@inlined
def begin_motion(run, mega, segment):
    """Bring the state onto the contacts after an event, and evaluate it for the first time.

    Returns whether the mechanism can be integrated: its equations of motion have a solution, and
    the state is not too far from its contacts.
    """
    motion = run.motion
    position = mega.position
    velocity = mega.velocity
    ground = ground_after(segment, 0.0)
    end = position.shape[0] - 1
    velocity[end, 0] = segment.far_x[1]
    velocity[end, 1] = segment.far_y[1]
    pose(mega, position)
    if not project(mega, position, velocity, (0.0, 0.0), REGROUPED * motion.length):
        return False
    if not solve_first_level(mega, position, velocity, ground, motion.acceleration):
        return False
    runge_kutta.keep_stage(mega, motion.stages, 0, position, velocity, ground)
    least = find_margins(motion, mega, position, velocity, ground)
    keep_margins(mega, motion)
    look_outward(run, mega, position, velocity)
    return least > -np.inf


@kernel
def recover_reactions(run, mega, position, velocity, ground):
    """Recover all voussoirs and their reactions; return whether the first level has a solution.

    Reads: run, mega, position, velocity, ground.
    Writes: run, mega.
    """
    state = run.state
    work = run.work
    if not solve_first_level(mega, position, velocity, ground, run.motion.acceleration):
        return False
    find_margins(run.motion, mega, position, velocity, ground)
    recover_voussoirs(mega, position, velocity, state)
    move_faces(run.model, state.position, work.rotated, work.face, work.tangent)
    place_contacts(run.model, state.slip, work.face, work.tangent, work)
    joint_reactions(mega, work)
    for j in range(state.slip.size):
        work.contact[j, 0] = state.contact[j, 0]
        work.contact[j, 1] = state.contact[j, 1]
        work.slide[j] = state.slide[j]
    return True


@kernel
def write_step(run, mega, start, step, shown, ground, output):
    """Write frames that are due in a step until it is `shown`, from its dense output.

    Reads: run, mega, ground, output.
    Writes: run, mega, output.
    """
    clock = run.state.clock
    now = run.state.clock[Clock.TIME]
    position = mega.next_position
    velocity = mega.next_velocity
    while output.due[0] <= shown:
        later = max(min(output.due[0], now) - start, 0.0)
        runge_kutta.dense_state(run.motion.stages, later / step, position, velocity)
        clock[Clock.TIME] = output.due[0]
        if recover_reactions(
            run, mega, position, velocity, ground_after(ground, later)
        ):
            write_frame(run.model, run.state, run.work, output)
        output.due[0] += output.interval
    clock[Clock.TIME] = now


@inlined
def _accept(run, mega, part, peaks):
    """Accept the state at the end of a step or of its part; record works and peaks."""
    stages = run.motion.stages
    energy = run.state.energy
    energy[Energy.GROUND] += runge_kutta.blend(
        stages.dense_work[runge_kutta.BY_GROUND], part
    )
    energy[Energy.FRICTION] += runge_kutta.blend(
        stages.dense_work[runge_kutta.BY_FRICTION], part
    )
    for i in range(1, mega.position.shape[0]):
        for c in range(3):
            mega.position[i, c] = mega.next_position[i, c]
            mega.velocity[i, c] = mega.next_velocity[i, c]
    kinetic = kinetic_energy(mega.model, mega.velocity)
    energy[Energy.LARGEST_KINETIC] = max(energy[Energy.LARGEST_KINETIC], kinetic)
    record_calm(run.model, run.state, kinetic, True)
    # The end, and if a body may have reversed, also between.
    for sample in range(PEAK_SAMPLES if peaks else 1):
        record_place(run, mega, mega.next_position)
        inside = part * (sample + 1) / PEAK_SAMPLES
        runge_kutta.dense_state(stages, inside, mega.next_position, mega.next_velocity)


@inlined
def _shift_stages(mega, stages, last):
    """Use the last stage as the first one of the next step."""
    for i in range(1, mega.position.shape[0]):
        for c in range(3):
            stages.velocity[i, 0, c] = stages.velocity[i, last, c]
            stages.acceleration[i, 0, c] = stages.acceleration[i, last, c]
    for p in range(2):
        stages.power[0, p] = stages.power[last, p]


@inlined
def _allowed_errors(mega, motion, farthest):
    """Return the errors in position [m] and in velocity [m/s] that count as one."""
    fastest = 0.0
    for i in range(1, mega.velocity.shape[0] - 1):
        fastest = max(fastest, abs(mega.velocity[i, 0]), abs(mega.velocity[i, 1]))
    size = motion.tolerance * (np.sqrt(farthest) + FLOOR * motion.length)
    return size, motion.tolerance * (fastest + FLOOR * motion.speed)


@inlined
def check_laws(motion, mega, step, ground):
    """Check all laws at the end of a step, and gaps inside it; return part, event."""
    now = ground_after(ground, step)
    least = find_margins(motion, mega, mega.next_position, mega.next_velocity, now)
    runge_kutta.make_dense(mega, motion.stages, motion.scheme, step)
    end, searched = closed_inside(motion, mega, step)
    if searched:
        least = margins_at(motion, mega, end, step, ground)
    if least >= -THRESHOLD:
        return 1.0, False
    if np.isnan(least):
        return np.nan, False
    return locate(motion, mega, step, ground, end), True


@inlined
def integrate(run, mega, stop, output):
    """Integrate mega-voussoirs until a law ends or `stop` is reached.

    Returns how it ends; for an event ``run.motion.trigger`` has the law.
    """
    motion = run.motion
    progress = run.progress
    clock = run.state.clock
    count = run.state.count
    last = motion.scheme.time.shape[0] - 1
    unit = motion.length / motion.speed
    while count[Count.STEPS] < run.options.max_steps:
        time = clock[Clock.TIME]
        ground = segment_at(time, run.grounds)
        until = min(ground.end, stop)
        step = min(progress[Progress.STEP], LONGEST * unit)
        cut = time + 1.001 * step >= until
        if cut:
            step = until - time
        allowed = _allowed_errors(mega, motion, progress[Progress.FARTHEST])
        error = runge_kutta.take_step(
            mega,
            motion.stages,
            motion.scheme,
            step,
            ground,
            motion.acceleration,
            allowed,
        )
        count[Count.STEPS] += 1.0
        part = 1.0
        event = False
        good = error <= 1.0
        factor = min(5.0, 0.9 * max(error, 1e-9) ** motion.scheme.power)
        if good:
            part, event = check_laws(motion, mega, step, ground)
            if np.isnan(part):
                return BROKEN
            # Other mega-voussoirs are formed of a state that lies on the contacts.
            drift = 0.0 if event or until >= stop else DRIFT
            farthest = min(allowed[0], FARTHEST * motion.length)
            enough = drift * allowed[0], drift * allowed[1]
            good = project(
                mega, mega.next_position, mega.next_velocity, enough, farthest
            )
            count[Count.REFUSED] += 0.0 if good else 1.0
            factor = factor if good else 0.25
        if not good:
            # Its error is too large, or its drift off the contacts.
            count[Count.SHORTENED] += 1.0
            progress[Progress.STEP] = (
                step * max(0.2, factor) if np.isfinite(error) else 0.1 * step
            )
            if progress[Progress.STEP] < SHORTEST * unit:
                return BROKEN
            continue
        collapsed = not event and _has_collapsed(run, mega, mega.next_position)
        comes_back = look_outward(run, mega, mega.next_position, mega.next_velocity)
        # One that lands where it left has no rate at either end.
        _accept(run, mega, part, comes_back or event)
        _shift_stages(mega, motion.stages, last)
        keep_margins(mega, motion)
        clock[Clock.TIME] = until if cut and not event else time + part * step
        if output.due[0] <= clock[Clock.TIME] and output.frames.time.size > 0:
            joint = motion.trigger[0]
            law = motion.trigger[1]
            # A frame due at the end is not left out by rounding; where the mechanism is refused
            # it shows the next one.
            near = 1e-9 * output.interval
            shown = clock[Clock.TIME] + (-near if event else near)
            write_step(run, mega, time, step, shown, ground, output)
            motion.trigger[0] = joint
            motion.trigger[1] = law
        if event:
            return EVENT
        progress[Progress.STEP] = (
            max(step * factor, progress[Progress.STEP]) if cut else step * factor
        )
        if collapsed:
            return COLLAPSES
        if clock[Clock.TIME] >= stop:
            return STOPPED
    return BOUND
