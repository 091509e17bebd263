"""Integrate between two events by Runge-Kutta steps of mega-voussoirs, with step control.

Every law of the mechanism is looked at after each step. A step is cut where the slope of the
ground acceleration changes, and where a law ends.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from archfrag.physics.collapse import RIGHT_ANGLE, record_gap
from archfrag.physics.contact.laws import touching
from archfrag.physics.contact.path import Path, copy_modes
from archfrag.physics.contact.placing import least_gap, move_faces, place_contacts
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
from archfrag.physics.numbers import copy_rows, sine_cosine
from archfrag.physics.shared import write_frame
from archfrag.physics.state import Clock, Law, Model, State, Work
from archfrag.physics.status import Count, Energy, Peak, Stretch

# Largest step, over the time of a fall through a joint's length; first step after an event.
LONGEST = 0.1
FIRST = 0.02
SHORTEST = 1e-9
# When mega-voussoirs are formed, no voussoir may be moved by more than this part of a joint's
# length to bring it into them and onto their contacts. After a step none may be moved by more than
# FARTHEST, nor by more than the error allowed.
REGROUPED = 1e-6
FARTHEST = 3e-5
# Distances from the contacts, and rates, that are left after a step, over the error allowed to it.
DRIFT = 0.01
# Samples at which a peak is looked for in a step, if a body turned back in it or may have landed.
PEAK_SAMPLES = 16
# Motions smaller than this part of a joint's length, or of the speed of a fall through it, need
# not be relatively exact.
FLOOR = 0.02


class Progress(IntEnum):
    """Indices into ``Run.progress``; the comment at each says what is stored there."""

    STEP = 0  # size of the next step [s]
    FARTHEST = 1  # square of the largest displacement of a body [m2]
    FOUR_HINGES = 2  # time spent in that model [s]
    MEGA_VOUSSOIRS = 3  # time spent in that model [s]
    WINDOW = 4  # time for which all voussoirs are stepped [s]
    QUIESCENT_STEPS = 5  # steps without a change after which that ends earlier
    # if all voussoirs have to be stepped again before this time [s], both are doubled
    QUIESCENT_UNTIL = 6
    LEAVES_REST = 7  # one where the chain has just begun to move
    JAMMED = 8  # one where a slip was ended by unlimited friction
    CAUSE = 9  # cause in the next entry of the log
    JOINT = 10  # joint in the next entry of the log
    SWITCH = 11  # cause for which all voussoirs are stepped


@struct()
class Run(NamedTuple):
    """Workspace of an event-driven run: chain, mega-voussoirs, ground motion and options."""

    law: Law  # of all voussoirs
    model: Model
    state: State
    work: Work
    mega: MegaVoussoirs
    motion: MechanismMotion
    progress: np.ndarray  # (len(Progress),)
    recent: np.ndarray  # (n,) times of the last events [s]
    # (n_body + 2,) half the rate of the squared displacement [m2/s]
    outward: np.ndarray
    grounds: Grounds  # one motion
    path: Path
    options: Options


@inlined
def look_outward(run, mega, position, velocity):
    """Record in ``run.outward`` how fast each voussoir moves away from where it started.

    Return whether a voussoir that moved away at the last call comes back now.
    """
    comes_back = False
    for k in range(1, position.shape[0] - 1):
        s, c = sine_cosine(position[k, 2])
        v = velocity[k]
        for i in range(mega.first[k], mega.last[k] + 1):
            offset = mega.offset[i]
            start = run.model.start[i]
            x = c * offset[0] - s * offset[1]
            y = s * offset[0] + c * offset[1]
            rate = (position[k, 0] + x - start[0]) * (v[0] - v[2] * y)
            rate += (position[k, 1] + y - start[1]) * (v[1] + v[2] * x)
            comes_back = comes_back or (run.outward[i] > 0.0 > rate)
            run.outward[i] = rate
    return comes_back


@inlined
def record_place(run, mega, position):
    """Record the largest displacement and rotation of any voussoir so far."""
    rotation = run.state.peak[Peak.ROTATION]
    farthest = run.progress[Progress.FARTHEST]
    for k in range(1, position.shape[0] - 1):
        at = position[k]
        s, c = sine_cosine(at[2])
        for i in range(mega.first[k], mega.last[k] + 1):
            x = mega.offset[i, 0]
            y = mega.offset[i, 1]
            start = run.model.start[i]
            dx = at[0] + c * x - s * y - start[0]
            dy = at[1] + s * x + c * y - start[1]
            rotation = max(rotation, abs(at[2] - start[2]))
            farthest = max(farthest, dx * dx + dy * dy)
    run.state.peak[Peak.ROTATION] = rotation
    run.progress[Progress.FARTHEST] = farthest


@inlined
def _has_collapsed(run, mega, position):
    """Return whether a joint has lost contact for good; records gaps of joints without contact."""
    collapsed = False
    work = mega.work
    for k in range(work.slip.shape[0]):
        per_length = 1.0 / mega.model.length[k]
        at_0, at_1 = touching(k, work)
        if not (at_0 or at_1):
            gap = least_gap(k, work) * per_length
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

    `segment` is that of the ground motion. Return False if the mechanism cannot be integrated: its
    equations of motion have no solution, or the state is too far from its contacts.
    """
    motion = run.motion
    position = mega.position
    velocity = mega.velocity
    ground = ground_after(segment, 0.0)
    velocity[-1, 0] = segment.far_x[1]
    velocity[-1, 1] = segment.far_y[1]
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
    """Set positions, velocities and reactions of all voussoirs from those of mega-voussoirs.

    Return False if the first level has no solution.
    """
    state = run.state
    if not solve_first_level(mega, position, velocity, ground, run.motion.acceleration):
        return False
    find_margins(run.motion, mega, position, velocity, ground)
    recover_voussoirs(mega, position, velocity, state)
    move_faces(run.model, state.position, run.work)
    place_contacts(run.model, state.slip, run.work)
    joint_reactions(mega, run.work)
    copy_modes(state, run.work)
    return True


@kernel
def write_step(run, mega, start, step, shown, ground, output):
    """Write the frames that are due in a step up to the time `shown` [s], from its dense output.

    The step begins at `start` and is `step` long [s]; `ground` is its segment of the ground
    motion.
    """
    clock = run.state.clock
    now = clock[Clock.TIME]
    position = mega.next_position
    velocity = mega.next_velocity
    while output.due[0] <= shown:
        later = max(min(output.due[0], now) - start, 0.0)
        runge_kutta.dense_state(run.motion.stages, later / step, position, velocity)
        clock[Clock.TIME] = output.due[0]
        then = ground_after(ground, later)
        if recover_reactions(run, mega, position, velocity, then):
            write_frame(run.model, run.state, run.work, output)
        output.due[0] += output.interval
    clock[Clock.TIME] = now


@inlined
def _accept(run, mega, part, peaks):
    """Accept the state at `part`, 0 to 1, of a step; record works and peaks up to there.

    `peaks` says whether peaks are looked for inside the step, too.
    """
    stages = run.motion.stages
    energy = run.state.energy
    work = stages.dense_work
    energy[Energy.GROUND] += runge_kutta.blend(work[runge_kutta.BY_GROUND], part)
    energy[Energy.FRICTION] += runge_kutta.blend(work[runge_kutta.BY_FRICTION], part)
    copy_rows(mega.next_position, mega.position, 1, mega.position.shape[0])
    copy_rows(mega.next_velocity, mega.velocity, 1, mega.position.shape[0])
    kinetic = kinetic_energy(mega.model, mega.velocity)
    energy[Energy.LARGEST_KINETIC] = max(energy[Energy.LARGEST_KINETIC], kinetic)
    record_calm(run.model, run.state, kinetic, True)
    # The end, and if a body may have reversed, also between.
    for sample in range(PEAK_SAMPLES if peaks else 1):
        record_place(run, mega, mega.next_position)
        inside = part * (sample + 1) / PEAK_SAMPLES
        runge_kutta.dense_state(stages, inside, mega.next_position, mega.next_velocity)


@inlined
def check_laws(motion, mega, step, ground):
    """Check all laws at the end of a step, and gaps inside it; return part, event.

    `event` says whether a law ends, and `part`, 0 to 1, is where in the step; it is 1 if no law
    ends, and nan if there is no solution.
    """
    now = ground_after(ground, step)
    least = find_margins(motion, mega, mega.next_position, mega.next_velocity, now)
    runge_kutta.make_dense(mega, motion, step)
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
    """Integrate mega-voussoirs until a law ends or the time `stop` [s] is reached.

    Return how it ends, a `Stretch`; for an event ``run.motion.trigger`` has the law.
    """
    motion = run.motion
    progress = run.progress
    clock = run.state.clock
    count = run.state.count
    unit = motion.length / motion.speed
    while count[Count.STEPS] < run.options.max_steps:
        time = clock[Clock.TIME]
        ground = segment_at(time, run.grounds)
        until = min(ground.end, stop)
        step = min(progress[Progress.STEP], LONGEST * unit)
        cut = time + 1.001 * step >= until
        if cut:
            step = until - time
        fastest = 0.0
        for i in range(1, mega.velocity.shape[0] - 1):
            fastest = max(fastest, abs(mega.velocity[i, 0]), abs(mega.velocity[i, 1]))
        size = np.sqrt(progress[Progress.FARTHEST]) + FLOOR * motion.length
        rate = motion.tolerance * (fastest + FLOOR * motion.speed)
        allowed = motion.tolerance * size, rate  # what counts as one [m], [m/s]
        error = runge_kutta.take_step(mega, motion, step, ground, allowed)
        count[Count.STEPS] += 1.0
        part = 1.0
        event = False
        good = error <= 1.0
        factor = min(5.0, 0.9 * max(error, 1e-9) ** motion.scheme.power)
        if good:
            part, event = check_laws(motion, mega, step, ground)
            if np.isnan(part):
                return Stretch.STUCK
            # Other mega-voussoirs are formed of a state that lies on the contacts.
            drift = 0.0 if event or until >= stop else DRIFT
            farthest = min(allowed[0], FARTHEST * motion.length)
            enough = drift * allowed[0], drift * allowed[1]
            position = mega.next_position
            good = project(mega, position, mega.next_velocity, enough, farthest)
            if not good:
                count[Count.REFUSED] += 1.0
            factor = factor if good else 0.25
        if not good:
            # Its error is too large, or its drift off the contacts.
            count[Count.SHORTENED] += 1.0
            factor = max(0.2, factor) if np.isfinite(error) else 0.1
            progress[Progress.STEP] = step * factor
            if progress[Progress.STEP] < SHORTEST * unit:
                return Stretch.STUCK
            continue
        collapsed = not event and _has_collapsed(run, mega, mega.next_position)
        comes_back = look_outward(run, mega, mega.next_position, mega.next_velocity)
        # One that lands where it left has no rate at either end.
        peaks = comes_back or event
        _accept(run, mega, part, peaks)
        # The last stage is the first one of the next step.
        last = motion.scheme.time.shape[0] - 1
        stages = motion.stages
        rows = mega.position.shape[0]
        copy_rows(stages.velocity[:, last], stages.velocity[:, 0], 1, rows)
        copy_rows(stages.acceleration[:, last], stages.acceleration[:, 0], 1, rows)
        stages.power[0, 0] = stages.power[last, 0]
        stages.power[0, 1] = stages.power[last, 1]
        keep_margins(mega, motion)
        clock[Clock.TIME] = until if cut and not event else time + part * step
        if output.due[0] <= clock[Clock.TIME] and output.frames.time.size > 0:
            trigger = motion.trigger[0], motion.trigger[1]
            # A frame due at the end is not left out by rounding; where the mechanism is refused
            # it shows the next one.
            near = 1e-9 * output.interval
            near = -near if event else near
            shown = clock[Clock.TIME] + near
            write_step(run, mega, time, step, shown, ground, output)
            motion.trigger[0], motion.trigger[1] = trigger
        if event:
            return Stretch.EVENT
        least = progress[Progress.STEP] if cut else 0.0
        progress[Progress.STEP] = max(step * factor, least)
        if collapsed:
            return Stretch.FALL
        if clock[Clock.TIME] >= stop:
            return Stretch.COMPLETE
    return Stretch.SPENT
