"""Locate the end of a mechanism: the instant at which a margin of a contact law is used up.

Every margin is dimensionless and positive while the mechanism holds (Sinopoli, section 3.5):
forces over the weight, gaps over the joint's length, slip rates over the speed of a fall through
that length. Gaps and rates weigh more, so that all are located to the same threshold. Each law
has a margin of its own at each joint of the chain: `archfrag.physics.contact.laws`
numbers them.
"""

import math
from typing import NamedTuple

import numpy as np

from archfrag.physics.contact import laws
from archfrag.physics.contact.laws import GAP_0, GAP_1, N_LAW, along
from archfrag.physics.contact.placing import clearance, corner_rate_at, move_faces
from archfrag.physics.contact.ties import pull_count, set_pull_margins
from archfrag.physics.events import runge_kutta
from archfrag.physics.events.runge_kutta import Scheme, Stages
from archfrag.physics.ground import ground_after
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.mega_voussoirs.first_level import solve_first_level
from archfrag.physics.mega_voussoirs.second_level import solve_second_level
from archfrag.physics.state import Model

# Joint in ``MechanismMotion.trigger`` if no law has ended.
NONE = -1
# A law counts as broken if its margin is below minus this; contact problems are solved to a
# hundredth of this.
THRESHOLD = 1e-9
GAP_WEIGHT = 1e4
MOST_ITERATIONS = 60
# A corner that parts, and overlaps by less than this part of the joint's length, was located late
# by rounding. If it overlaps by more, its impact was missed.
ROUNDING = 1e-9


@struct()
class MechanismMotion(NamedTuple):
    """Workspace for the motion of mega-voussoirs between events."""

    model: Model  # of the voussoirs
    stages: Stages
    scheme: Scheme
    length: float  # shortest joint [m]
    speed: float  # of a fall through it [m/s]
    acceleration: float  # scale of errors in equations of motion [m/s2]
    per_weight: float  # one over the weight of the chain [1/N]
    tolerance: float  # relative error of a step
    value: (
        np.ndarray
    )  # (n_joint + n_tie, N_LAW) margins of all laws, of joints and of ties
    low: np.ndarray  # (n_joint + n_tie, N_LAW) `value` at the beginning of a step
    # (n_joint, 2, 2) corners of joints between mega-voussoirs: gap [m] and its rate [m/s]; inf
    # where they touch
    gap: np.ndarray
    low_gap: np.ndarray  # (n_joint, 2, 2) `gap` at the beginning of a step
    trigger: np.ndarray  # (2,) int64: joint and law of the smallest margin


def new_motion(model: Model, scheme: Scheme, tolerance: float) -> MechanismMotion:
    """Allocate the workspace of a chain's motion, for a relative error of a step."""
    n_joint = model.friction.size
    length = float(model.length.min())
    margins = np.full((2, n_joint + pull_count(model), N_LAW), np.inf)
    gaps = np.full((2, n_joint, 2, 2), np.inf)
    return MechanismMotion(
        model=model,
        stages=runge_kutta.new_stages(model.mass.size),
        scheme=scheme,
        length=length,
        speed=float(np.sqrt(model.gravity * length)),
        acceleration=model.gravity * min(1.0, max(1e-3, 1e3 * tolerance)),
        per_weight=1.0 / (model.gravity * float(model.mass.sum())),
        tolerance=float(tolerance),
        value=margins[0],
        low=margins[1],
        gap=gaps[0],
        low_gap=gaps[1],
        trigger=np.full(2, NONE),
    )


@kernel
def keep_margins(mega, motion):
    """Keep the present margins as those at the beginning of a step.

    Reads: motion (gap, value).
    Writes: motion (low, low_gap).
    """
    for j in range(motion.value.shape[0]):
        for law in range(N_LAW):
            motion.low[j, law] = motion.value[j, law]
    for k in range(mega.work.slip.shape[0]):
        for c in range(2):
            motion.low_gap[k, c, 0] = motion.gap[k, c, 0]
            motion.low_gap[k, c, 1] = motion.gap[k, c, 1]


@inlined
def _cone_margins(k, c, model, work, per_weight, value):
    """Set the margins of friction and force at joint `k`, which touches at corner `c` only.

    If it sticks, they are those of both edges of Coulomb's cones; if it slides, that of the force
    along its ray. They go into `value`, (N_LAW,).
    """
    n = model.ray[k, 0]
    t = model.ray[k, 1]
    size = per_weight / math.sqrt(n * n + t * t)
    fx, fy = laws.force_of(k, work)
    force = size * fx, size * fy
    high, low = laws.cones_at(k, c, model, work)
    if work.slide[k] == 0.0:
        value[laws.FRICTION_PLUS] = laws.cross(force, high)
        value[laws.FRICTION_MINUS] = laws.cross(low, force)
    else:
        value[laws.FORCE_0 + c] = along(high if work.slide[k] > 0.0 else low, force)


@inlined
def margins_between(mega, motion, position, velocity):
    """Set margins at the joints between mega-voussoirs, after `solve_first_level`."""
    work = mega.work
    for k in range(work.slip.shape[0]):
        value = motion.value[mega.joint[k]]
        at_0, at_1 = laws.touching(k, work)
        per_length = 1.0 / mega.model.length[k]
        for c in range(2):
            gap = rate = np.inf
            if work.contact[k, c] < 0.5:
                gap = clearance(k, c, work)
                x = work.point[k, c, 0]
                y = work.point[k, c, 1]
                slip = corner_rate_at(k, x, y, mega.model, position, velocity)
                rate = along(laws.normal_of(k, work), slip)
                late = gap < 0.0 <= rate and gap * per_length > -ROUNDING
                value[GAP_0 + c] = 0.0 if late else GAP_WEIGHT * gap * per_length
            motion.gap[k, c, 0] = gap
            motion.gap[k, c, 1] = rate
        if at_0 and at_1:
            force_0, force_1, _, _ = laws.closed_forces(k, work)
            value[laws.FORCE_0] = motion.per_weight * force_0
            value[laws.FORCE_1] = motion.per_weight * force_1
        elif at_0 or at_1:
            c = 0 if at_0 else 1
            _cone_margins(k, c, mega.model, work, motion.per_weight, value)
        if work.slide[k] != 0.0:
            rate, _ = runge_kutta.sliding_rate(k, mega.model, position, velocity, work)
            slips = -laws.SLIP_WEIGHT * work.slide[k] * rate
            value[laws.SLIP_END] = slips / motion.speed


@kernel
def find_margins(motion, mega, position, velocity, ground):
    """Set the margins of all laws after `solve_first_level`; return the smallest.

    Its joint and law are left in ``motion.trigger``.

    Writes: motion (gap, trigger, value), mega.inner_reaction.
    """
    value = motion.value
    value[:] = np.inf
    margins_between(mega, motion, position, velocity)
    solve_second_level(
        motion.model, mega, position, velocity, ground, motion.per_weight, value
    )
    set_pull_margins(mega, motion)
    least = np.inf
    for j in range(value.shape[0]):
        for law in range(N_LAW):
            if not value[j, law] >= least:
                least = value[j, law]
                motion.trigger[0] = j
                motion.trigger[1] = law
    return least


@kernel
def margins_at(motion, mega, part, step, ground):
    """Return the smallest margin at `part`, 0 to 1, of a step; nan if there is no solution.

    ``mega.next_position`` and ``mega.next_velocity`` become those of that instant.
    """
    position = mega.next_position
    velocity = mega.next_velocity
    runge_kutta.dense_state(motion.stages, part, position, velocity)
    now = ground_after(ground, part * step)
    if not solve_first_level(mega, position, velocity, now, motion.acceleration):
        return np.nan
    return find_margins(motion, mega, position, velocity, now)


@kernel
def _gap_at(motion, mega, part, k, c):
    """Return the gap of corner `c` of joint `k` at `part`, 0 to 1, of a step [m].

    It is found from positions alone.

    Writes: mega (next_position, next_velocity, work.face, work.rotated, work.tangent).
    """
    position = mega.next_position
    runge_kutta.dense_state(motion.stages, part, position, mega.next_velocity)
    move_faces(mega.model, position, mega.work)
    return clearance(k, c, mega.work)


@inlined
def closed_inside(motion, mega, step):
    """Find where inside a step a corner closes that is open at both ends of the step.

    Return `part`, 0 to 1, of the first one, or 1 if none closes; and `searched`, whether any
    corner had to be looked at.

    A gap that first shrinks and then grows lies above the tangents at the ends of the step, as
    long as its rate changes sign only once. Where these allow it to close, it is looked at on the
    dense output where its rate, taken to be linear, vanishes.
    """
    found = 1.0
    searched = False
    for k in range(mega.work.slip.shape[0]):
        for c in range(2):
            first = motion.low_gap[k, c, 0]
            falls = motion.low_gap[k, c, 1]
            last = motion.gap[k, c, 0]
            rises = motion.gap[k, c, 1]
            below = first * rises - last * falls < -falls * rises * step
            if falls < 0.0 < rises and below:
                part = falls / (falls - rises)
                searched = True
                gap = _gap_at(motion, mega, part, k, c)
                if gap < -ROUNDING * mega.model.length[k]:
                    found = min(found, part)
    return found, searched


@kernel
def _margin_at(motion, mega, part, step, ground, joint, law):
    """Return the margin of one law at `part`, 0 to 1, of a step."""
    if law not in (GAP_0, GAP_1):
        least = margins_at(motion, mega, part, step, ground)
        return least if np.isnan(least) else motion.value[joint, law]
    k = 0
    while mega.joint[k] != joint:
        k += 1
    gap = _gap_at(motion, mega, part, k, law - GAP_0)
    return GAP_WEIGHT * gap / mega.model.length[k]


@inlined
def _root(motion, mega, step, ground, end, joint, law):
    """Find the part of a step at which the margin of one law is used up (Illinois method).

    It lies between 0 and `end`.
    """
    low = 0.0
    high = end
    low_value = motion.low[joint, law]
    high_value = motion.value[joint, law]
    if low_value <= THRESHOLD and law in (GAP_0, GAP_1):
        # A corner that has just opened lies at the threshold: it closes after it was open.
        while low_value <= THRESHOLD:
            if high < 1e-6:
                return 0.0
            low = 0.5 * high
            low_value = _margin_at(motion, mega, low, step, ground, joint, law)
            if low_value < 0.0:
                high = low
                high_value = low_value
            elif low_value <= THRESHOLD:
                return low
    elif low_value <= 0.0:
        return 0.0
    side = 0
    part = end
    for number in range(MOST_ITERATIONS):
        part = (low * high_value - high * low_value) / (high_value - low_value)
        if number % 4 == 3 or not low < part < high:
            part = 0.5 * (low + high)
        value = _margin_at(motion, mega, part, step, ground, joint, law)
        value = value + 0.5 * THRESHOLD
        if not abs(value) > 0.5 * THRESHOLD or high - low < 1e-15:
            break
        if value < 0.0:
            high = part
            high_value = value
            low_value *= 0.5 if side == -1 else 1.0
            side = -1
        else:
            low = part
            low_value = value
            high_value *= 0.5 if side == 1 else 1.0
            side = 1
    return part


@inlined
def locate(motion, mega, step, ground, end):
    """Find the first part of a step at which a law ends; nan if there is no solution.

    A law is broken at `end`. The law with the smallest margin is followed back to where that is
    used up; for an impact only the gap is evaluated. Then all laws are looked at there, and this
    is repeated until none is broken. ``mega.next_position``, ``mega.next_velocity`` and the last
    solution are those of that instant.
    """
    trigger = motion.trigger
    part = end
    for _ in range(MOST_ITERATIONS):
        joint = trigger[0]
        law = trigger[1]
        part = _root(motion, mega, step, ground, part, joint, law)
        least = margins_at(motion, mega, part, step, ground)
        if np.isnan(least):
            return np.nan
        if least >= -THRESHOLD or part == 0.0:
            trigger[0] = joint
            trigger[1] = law
            return part
    return part
