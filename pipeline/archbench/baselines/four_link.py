"""The arch as a linkage of one degree of freedom that jumps to its mirror image at an impact.

The model of Oppenheim (1992, *Earthquake Engng Struct. Dyn.* 21(11), 1005-1017), Clemente (1998,
ibid. 27(5), 513-522) and De Lorenzis, DeJong and Ochsendorf (2007, ibid. 36(14), 2119-2136):

- At rest until the ground acceleration leaves the range of rest. Limit analysis there gives which
  four hinges open; they stay for as long as the arch moves in that direction.
- Then three bodies, four pins, one angle (`archbench.baselines.four_bars`), integrated by the
  classical method of Runge and Kutta with equal steps. Its acceleration and the reactions at all
  joints are those of the contact problem with the modes of the linkage.
- Where the linkage returns to its undeformed shape all joints close, and the hinges jump to those
  of limit analysis in the other direction, at the speed that the balance of impulse gives. The
  arch rests when that speed is negligible and the body force lies inside the range of rest.
- Collapse is where it cannot recover: three pins in a row have come into line (`STRAIGHT`), a
  joint has rotated by 90 degrees, or a pin would need a tensile force on a linkage that opens
  beyond its unstable equilibrium. Tension before that counts as a loss of contact; the pin holds.

A chain with a free end moves about one hinge, as Housner's (1963) block. If a joint slides in the
onset mechanism, or an initial state is none of a linkage's, the run is ``NOT_APPLICABLE``. The
contact laws at closed joints are not looked at while it moves; the residual of the response is
how far they are broken. `docs/evidence.md` says what the method gets wrong.
"""

from typing import NamedTuple

import numpy as np

from archbench.baselines.common import Case, case_of, finish, start
from archbench.baselines.four_bars import (
    Linkage,
    inner_sine,
    linkage_of,
    place_linkage,
    speed_after_impact,
)
from archfrag.physics.contact.blocks import EXACT, solve_modes
from archfrag.physics.contact.placing import move_faces, place_contacts
from archfrag.physics.energy import energies_of
from archfrag.physics.events.phases import balance_energy
from archfrag.physics.ground import Grounds, end_rest, one_of, segment_at
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.onset import NO_LIMIT, new_rest_problem, rest_limit
from archfrag.physics.shared import log_change, write_frame
from archfrag.physics.state import Clock
from archfrag.physics.status import (
    Cause,
    CollapseMode,
    Count,
    Energy,
    Level,
    Status,
    Wait,
)
from archfrag.physics.steps.service import dominant_change, measure_state
from archfrag.physics.steps.step import count_changes, record_motion

NOT_APPLICABLE = -1
CLOSED = -2

# Slower than this part of a fall through a joint's length is no motion.
STILL = 1e-7
# Of an initial state, over joint length and the speed of that fall: still a linkage's.
MATCHES = 1e-6
# Three pins are in line where the sine of the angle at the middle one is this part of that at
# rest: there the first or the last bar rotates back, and the arch snaps through.
STRAIGHT = 0.05
# Steps over the time of a fall through a joint's length: times the fourth root of the tolerance,
# and the largest.
STEP = 1.8
LONGEST = 0.1
# What a root is sought of, and how closely, over the step.
OF_CLOSING = 0
OF_ROTATION = 1
OF_COLLAPSE = 2
ROOT = 1e-13


@struct()
class Motion(NamedTuple):
    """The one coordinate of a linkage."""

    now: (
        np.ndarray
    )  # (3,) angle [rad], speed [rad/s], work of the ground since `now` [J]
    then: np.ndarray  # (3,) at the end of the step taken last
    shake: np.ndarray  # (2, 2) ground acceleration `now`, and its rate: x, y
    tensile: np.ndarray  # (1,) one where a pin is in tension
    collapse: np.ndarray  # (2,) joint and mode that are nearest to collapse


@kernel
def shake_at(grounds, time, shake):
    """Acceleration and its rate at an instant, into `shake`; until when they hold [s]."""
    segment = segment_at(time, grounds)
    shake[0, 0] = segment.x
    shake[1, 0] = segment.slope_x
    shake[0, 1] = segment.y
    shake[1, 1] = segment.slope_y
    return segment.end


@kernel
def accelerate(case, linkage, motion, q, speed, late):
    """Accelerations of all voussoirs and reactions, into ``case.work``; acceleration, power.

    The contact problem with the linkage's modes; what rotation takes from the relative
    accelerations of the corners (the centripetal terms of Eqs 17 and 18) is its bias.
    """
    model = case.model
    state = case.state
    work = case.work
    if not place_linkage(model, linkage, q, speed, state):
        return np.nan, np.nan
    move_faces(model, state.position, work)
    place_contacts(model, state.slip, work)
    power = 0.0
    for i in range(1, state.position.shape[0] - 1):
        for c in range(2):
            acceleration = motion.shake[0, c] + late * motion.shake[1, c]
            work.free[i, c] = -acceleration - (model.gravity if c == 1 else 0.0)
            power -= model.mass[i] * acceleration * state.velocity[i, c]
        work.free[i, 2] = 0.0
    for j in range(work.slide.size):
        work.slide[j] = 0.0
        before = state.velocity[j, 2] ** 2
        after = state.velocity[j + 1, 2] ** 2
        for k in range(2):
            work.contact[j, k] = linkage.contact[j, k]
            for c in range(2):
                point = work.point[j, k, c]
                work.bias[j, k, c] = before * (point - state.position[j, c])
                work.bias[j, k, c] -= after * (point - state.position[j + 1, c])
    solve_modes(model, state.position, work, model.gravity, EXACT, 0)
    return linkage.sense * work.solved[linkage.joint[0] + 1, 2], power


@kernel
def take_step(case, linkage, motion, step):
    """One step of Runge and Kutta from ``motion.now`` into ``motion.then``."""
    now = motion.now
    then = motion.then
    for c in range(3):
        then[c] = now[c]
    speed = acceleration = 0.0
    for part, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
        late = part * step
        weight = weight * step / 6.0
        q = now[0] + late * speed
        speed = now[1] + late * acceleration
        acceleration, power = accelerate(case, linkage, motion, q, speed, late)
        then[0] += weight * speed
        then[1] += weight * acceleration
        then[2] += weight * power


@kernel
def _go_to(case, linkage, motion, step):
    """A step, with voussoirs, faces and reactions where it ends."""
    take_step(case, linkage, motion, step)
    accelerate(case, linkage, motion, motion.then[0], motion.then[1], step)


@kernel
def _weakest_pin(case, linkage):
    """The joint with the least compression, and its value by the mean normal [N]."""
    weakest = -1
    least = np.inf
    for j in range(case.work.slide.size):
        if linkage.contact[j, 0] + linkage.contact[j, 1] < 2.0:
            press = case.work.reaction[j, 0] * case.work.normal[j, 0]
            press += case.work.reaction[j, 1] * case.work.normal[j, 1]
            if press < least:
                weakest = j
                least = press
    return weakest, least


@kernel
def fall_margin(case, linkage, motion):
    """How far the configuration accelerated last is from collapse; negative: collapsed.

    The joint that is nearest to it, and the mode of collapse, go into ``motion.collapse``.
    """
    model = case.model
    state = case.state
    weight = rise = 0.0
    for i in range(1, state.position.shape[0] - 1):
        weight += model.mass[i] * model.gravity
        rise += model.mass[i] * model.gravity * state.velocity[i, 1]
    joint, press = _weakest_pin(case, linkage)
    # Tension that the linkage may still return from: it rises in opening, or it closes.
    margin = max(press / weight, rise / weight, -motion.then[1])
    mode = CollapseMode.HINGING
    for j in range(linkage.contact.shape[0]):
        left = 0.5 * np.pi - abs(state.position[j + 1, 2] - state.position[j, 2])
        if left < margin:
            margin = left
            joint = j
            mode = CollapseMode.OVERTURNING
    for k in range(1, linkage.joint.size - 2):
        left = inner_sine(linkage, state, k) / linkage.sine[k - 1] - STRAIGHT
        if left < margin:
            margin = left
            joint = linkage.joint[k]
            mode = CollapseMode.HINGING
    motion.collapse[0] = joint
    motion.collapse[1] = mode
    return margin


@kernel
def _left(case, linkage, motion, kind, step):
    """What is positive before an event and negative past it, after a step."""
    _go_to(case, linkage, motion, step)
    if not np.isfinite(motion.then[0]):
        return -1.0
    if kind == OF_COLLAPSE:
        return fall_margin(case, linkage, motion)
    if kind == OF_ROTATION:
        return motion.then[1]
    return motion.then[0] / (step if motion.now[0] == 0.0 else 1.0)


@kernel
def locate(case, linkage, motion, kind, step):
    """Size of the step that ends at an event, by regula falsi; ``motion.then`` is there."""
    low = 0.0
    high = step
    at_low = 1.0
    at_high = _left(case, linkage, motion, kind, step)
    if kind != OF_COLLAPSE:
        at_low = (
            motion.now[1]
            if kind == OF_ROTATION or motion.now[0] == 0.0
            else motion.now[0]
        )
    here = step
    last = 0.0
    size = max(at_low, -at_high)
    while high - low > ROOT * step:
        here = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < here < high:
            here = 0.5 * (low + high)
        left = _left(case, linkage, motion, kind, here)
        if abs(left) <= ROOT * size:
            break
        if left < 0.0:
            high = here
            at_high = left
            at_low *= 0.5 if last < 0.0 else 1.0
        else:
            low = here
            at_low = left
            at_high *= 0.5 if last > 0.0 else 1.0
        last = left
    return here


@kernel
def end_of_step(case, linkage, motion, step):
    """Take a step, or the part of it up to an event; its size, and CLOSED, FALLEN or Wait.GO."""
    then = motion.then
    _go_to(case, linkage, motion, step)
    if then[0] <= 0.0:
        return locate(case, linkage, motion, OF_CLOSING, step), CLOSED
    if not np.isfinite(then[0]) or fall_margin(case, linkage, motion) < 0.0:
        size = locate(case, linkage, motion, OF_COLLAPSE, step)
        fall_margin(case, linkage, motion)
        return size, Wait.COLLAPSES
    if motion.now[1] > 0.0 > then[1]:
        locate(case, linkage, motion, OF_ROTATION, step)
        record_motion(case.model, case.state, True)
        _go_to(case, linkage, motion, step)
    return step, Wait.GO


@kernel
def write_due(case, linkage, motion, step):
    """Frames that are due in a step; ``motion.then`` is that of the full step again."""
    clock = case.state.clock
    output = case.output
    time = clock[Clock.TIME]
    if output.frames.time.size == 0 or output.due[0] > time + step:
        return
    while output.due[0] <= time + step:
        clock[Clock.TIME] = max(output.due[0], time)
        _go_to(case, linkage, motion, clock[Clock.TIME] - time)
        write_frame(case.model, case.state, case.work, output)
        output.due[0] += output.interval
    clock[Clock.TIME] = time
    _go_to(case, linkage, motion, step)


@kernel
def _accept(case, linkage, motion, step):
    """Take the end of a step over; peaks, energies and tension there, now and then the
    residual."""
    state = case.state
    now = motion.now
    then = motion.then
    state.clock[Clock.TIME] += step
    state.energy[Energy.GROUND] += then[2]
    now[0] = then[0]
    now[1] = then[1]
    now[2] = 0.0
    record_motion(case.model, state, True)
    balance_energy(case.model, case.state)
    tensile = 1.0 if _weakest_pin(case, linkage)[1] < 0.0 else 0.0
    state.count[Count.LOSSES] += max(tensile - motion.tensile[0], 0.0)
    motion.tensile[0] = tensile
    state.count[Count.STEPS] += 1.0
    if int(state.count[Count.STEPS]) % case.options.check_interval == 0:
        measure_state(case.model, state, case.work)


@kernel
def move(case, linkage, motion, grounds, largest, stop, most):
    """Integrate a linkage until it closes, collapses or time is up; returns the code."""
    clock = case.state.clock
    motion.tensile[0] = 0.0
    while clock[Clock.TIME] < stop:
        if case.state.count[Count.STEPS] >= most:
            return Wait.EXHAUSTED
        time = clock[Clock.TIME]
        end = min(shake_at(grounds, time, motion.shake), stop)
        cuts = time + 1.001 * largest >= end
        step, code = end_of_step(case, linkage, motion, end - time if cuts else largest)
        write_due(case, linkage, motion, step)
        _accept(case, linkage, motion, step)
        if code != Wait.GO:
            return code
        if cuts:
            clock[Clock.TIME] = end
    return Wait.AT_END


@kernel
def change_modes(case, contact, cause, level):
    """Take over which corners touch, count what joints did, and note it in the log."""
    state = case.state
    work = case.work
    for j in range(work.slide.size):
        work.slide[j] = 0.0
        work.contact[j, 0] = contact[j, 0]
        work.contact[j, 1] = contact[j, 1]
    by, joint = dominant_change(state, work)
    count_changes(case.model, state, work, True)
    for j in range(work.slide.size):
        state.contact[j, 0] = contact[j, 0]
        state.contact[j, 1] = contact[j, 1]
    if cause >= 0:
        by = cause
        joint = -1
    state.count[Count.EVENTS] += 1.0
    log_change(state, state.clock[Clock.TIME], by, joint, level, case.output)


class Run:
    """One run on the two linkages of a chain, for a ground that accelerates towards +x and -x."""

    def __init__(self, case: Case, factor: float, options: Options) -> None:
        self.case = case
        self.state = case.state
        self.clock = case.state.clock
        grounds = case.grounds
        self.side = -1
        self.dt = float(grounds.time_step[0])
        self.now = np.zeros(3)
        self.motion = Motion(
            self.now, np.zeros(3), np.zeros((2, 2)), np.zeros(1), np.zeros(2)
        )
        self.stop = (grounds.horizontal.size - 1) * self.dt + options.follow
        self.ground = one_of(grounds, 0, factor)
        model = case.model
        work = case.work
        self.unit = float(np.sqrt(model.length.min() / model.gravity))
        self.step = min(STEP * options.tolerance**0.25, LONGEST) * self.unit
        self.most = options.max_steps + 2.0 * self.stop / self.step
        self.mass = np.stack([model.mass, model.mass, model.inertia], axis=1)[1:-1]
        place_contacts(model, self.state.slip, work)
        self.limits: list[float] = []
        self.linkages: list[Linkage | None] = []
        problem = new_rest_problem(model)
        problem.centroid[:] = model.centroid
        for sense in (1.0, -1.0):
            limit = rest_limit(model, work, problem, sense)
            self.limits.append(sense * limit.load_factor if limit.found else -NO_LIMIT)
            self.linkages.append(linkage_of(model, limit.mechanism))

    def match(self, position: np.ndarray, velocity: np.ndarray) -> bool:
        """Whether an initial state is one of a linkage, which is then taken over."""
        size = np.array([self.case.model.length.min()] * 2 + [1.0])
        for side, linkage in enumerate(self.linkages):
            if linkage is None:
                continue
            q, speed = (
                linkage.sense * x[linkage.joint[0], 2] for x in (position, velocity)
            )
            if q < 0.0 or (q == 0.0 and speed < 0.0):
                continue
            if not place_linkage(self.case.model, linkage, q, speed, self.state):
                continue
            away = np.abs((self.state.position[1:-1] - position) / size).max()
            aside = np.abs((self.state.velocity[1:-1] - velocity) / size).max()
            if away <= MATCHES and aside <= MATCHES / self.unit:
                self.side = side
                self.now[:2] = (q, speed)
                return True
        return False

    def write(self) -> None:
        """Frame of the chain without reactions."""
        self.case.work.reaction[:] = 0.0
        write_frame(self.case.model, self.state, self.case.work, self.case.output)
        self.case.output.due[0] = self.clock[Clock.TIME] + self.case.output.interval

    def rest(self) -> int:
        """Rest until the ground moves the chain; returns the code."""
        time = float(self.clock[Clock.TIME])
        model = self.case.model
        leave, for_good = end_rest(model, self.case.grounds, self.clock, *self.limits)
        self.clock[Clock.RESTING] += leave - time
        self.clock[Clock.TIME] = leave
        if for_good:
            return Wait.IDLE
        shake_at(self.ground, leave, self.motion.shake)
        x, y = self.motion.shake[0]
        # An arch lifts off where the ground falls away faster than gravity.
        down = model.gravity + y
        self.side = int(self.limits[1] * down + x < self.limits[0] * down - x)
        linkage = self.linkages[self.side]
        if down <= 0.0 or linkage is None:
            return NOT_APPLICABLE
        if leave > time:
            self.write()
        change_modes(self.case, linkage.contact, Cause.START, Level.FOUR_HINGES)
        return Wait.GO

    def move(self) -> int:
        """Move on one linkage, with the impact that ends it; returns the code."""
        began = float(self.clock[Clock.TIME])
        linkage = self.linkages[self.side]
        assert linkage is not None
        code = move(
            self.case,
            linkage,
            self.motion,
            self.ground,
            self.step,
            self.stop,
            self.most,
        )
        if code != CLOSED:
            return code
        if self.clock[Clock.TIME] - began <= ROOT * self.step:
            # The force was outside the range of rest for less than time can resolve.
            self.clock[Clock.TIME] = (np.floor(began / self.dt + 1e-9) + 1.0) * self.dt
        self.side = 1 - self.side
        other = self.linkages[self.side]
        if other is None:
            return NOT_APPLICABLE
        self.impact(linkage, other)
        return Wait.GO

    def impact(self, old: Linkage, new: Linkage) -> None:
        """All joints close and the other linkage takes over, at a speed that may be zero."""
        model = self.case.model
        state = self.state
        now = self.now
        place_linkage(model, old, 0.0, now[1], state)
        before = state.velocity[1:-1].copy()
        place_linkage(model, new, 0.0, 1.0, state)
        unit = state.velocity[1:-1].copy()
        speed = max(speed_after_impact(self.mass, unit, before), 0.0)
        if speed * np.abs(unit[:, 2]).max() < STILL / self.unit:
            speed = 0.0
        change = 0.5 * (self.mass * ((speed * unit) ** 2 - before**2)).sum()
        state.energy[Energy.IMPACT] += min(change, 0.0)
        now[:] = 0.0, speed, 0.0
        place_linkage(model, new, 0.0, speed, state)
        if speed > 0.0:
            change_modes(self.case, new.contact, -1, Level.FOUR_HINGES)
            return
        change_modes(self.case, np.ones_like(new.contact), Cause.REST, Level.REST)
        state.count[Count.RESTS] += 1
        self.write()

    def finish(self, code: int, position: np.ndarray, velocity: np.ndarray) -> Outcomes:
        """What the run has ended in."""
        self.clock[Clock.CODE] = Wait.IDLE if code == NOT_APPLICABLE else code
        results = finish(self.case, position, velocity)
        balance_energy(self.case.model, self.state)
        results.energy[0] = self.state.energy
        results.model_time[0, Level.FOUR_HINGES] = (
            results.end_time[0] - self.clock[Clock.RESTING]
        )
        if code == NOT_APPLICABLE:
            results.status[0] = int(Status.NOT_APPLICABLE)
        elif code == Wait.COLLAPSES:
            results.status[0] = int(Status.COLLAPSED)
            results.collapse_time[0] = results.end_time[0]
            results.collapse_joint[0], results.collapse_mode[0] = self.motion.collapse
        return results


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
    """Move a chain on four hinges; as `archfrag.physics.steps.run.run`.

    Frames at rest have no reactions.
    """
    case = case_of(chain, grounds, factor, False, options, frames, log)
    still = np.column_stack([chain.centroid, np.zeros(chain.mass.size)])
    start(case, still, np.zeros_like(still), False)
    case.output.written[1] = 0
    this = Run(case, factor, options)
    code: int = Wait.GO
    if not from_rest and not this.match(position, velocity):
        code = NOT_APPLICABLE
    case.state.position[1:-1] = position
    case.state.velocity[1:-1] = velocity
    kinetic, case.state.clock[Clock.START] = energies_of(case.model, case.state)
    case.state.energy[Energy.START_KINETIC] = kinetic
    this.write()
    linkage = this.linkages[this.side]
    if linkage is not None and this.now.any():
        change_modes(case, linkage.contact, Cause.START, Level.FOUR_HINGES)
    while code == Wait.GO:
        if not this.now.any():
            code = this.rest()
        if code == Wait.GO:
            code = this.move()
    return this.finish(code, position, velocity)
