"""One step of a chain whose joints give, of one run or of four: pose, solve, accept.

Positions are those of the midpoint scheme. In the middle of the step each joint has a gap, and the
elastic part of its slip; forces act at its middle for the entire step. What a joint stores is
known at the ends of steps. The work of springs, of friction and of dashpots is that of their laws,
so that what they do not explain of the work of reactions is the error of the steps.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact.placing import move_faces, relative_velocity
from archfrag.physics.energy import record_faces
from archfrag.physics.faces.law import ALONG, FLAT, ends_of, overlap_moments, places_of
from archfrag.physics.faces.velocities import OF_ROWS, OF_WORK, FaceWork
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import (
    LANES,
    lane_array,
    opposite,
    runs_of,
    select,
    some,
)
from archfrag.physics.kernels.structs import struct
from archfrag.physics.numbers import flag, larger, smaller
from archfrag.physics.state import Clock, Model, State, Work, new_state, new_work
from archfrag.physics.status import Count
from archfrag.physics.steps.step import (
    free_fall,
    move_far_springing,
    record_far_work,
    record_motion,
    take_velocities,
)

# The law is asked at least this part of a step after its middle; see `delay_of`.
LEAST_DELAY = 0.6
# The work of springs is integrated once more in so many pieces where it differs from what they
# store by more than this part.
PIECES = 16
SMOOTH = 1e-4


@struct(slip=(3,))
class Memory(NamedTuple):
    """What joints that give remember between steps, of one run or of four."""

    slip: np.ndarray  # (n_joint, 3) elastic part of the slip of points [m]
    touching: np.ndarray  # (n_joint,) length in contact [m]
    half: np.ndarray  # (n_joint,) of the length along which faces lay opposite [m]
    stored: np.ndarray  # (1,) elastic energy of all [J]


@struct()
class FaceRuns(NamedTuple):
    """State and workspace of one run or of four, and the same memory as columns of numbers."""

    state: State
    memory: Memory
    work: Work
    own: FaceWork
    columns: tuple[np.ndarray, ...]  # (n,) or (n, 4) each: arrays of state and memory


def new_runs(
    model: Model, zeros: Callable[[tuple[int, ...]], Any] = np.zeros
) -> FaceRuns:
    """Allocate the buffers of one run, or of four with `lane_array` as `zeros`."""
    state = new_state(model, zeros)
    n_joint = model.friction.size
    n_row = model.mass.size
    memory = Memory(
        zeros((n_joint, 3)), zeros((n_joint,)), zeros((n_joint,)), zeros((1,))
    )
    own: Any = FaceWork(
        *(
            zeros((n_row if name in OF_ROWS else n_joint, *OF_WORK.get(name, ())))
            for name in FaceWork._fields
        )
    )
    shape = (-1,) if zeros is np.zeros else (-1, LANES)
    plain = runs_of if zeros is lane_array else np.asarray
    columns = tuple(plain(array).reshape(shape) for array in (*state, *memory))
    return FaceRuns(state, memory, new_work(model, zeros), own, columns)


@inlined
def _place_joint(j, model, work, own):
    """Set pivot, normal and gap of joint j between the faces as they are; return its slip [m]."""
    face = work.face
    tangent = work.tangent
    ax = tangent[j, 0, 0]
    ay = tangent[j, 0, 1]
    bx = tangent[j, 1, 0]
    by = tangent[j, 1, 1]
    sum_of_both = math.sqrt((ax + bx) * (ax + bx) + (ay + by) * (ay + by))
    size = 1.0 / sum_of_both
    tx = size * (ax + bx)
    ty = size * (ay + by)
    px = 0.5 * (face[j, 0, 0, 0] + face[j, 0, 1, 0])
    py = 0.5 * (face[j, 0, 0, 1] + face[j, 0, 1, 1])
    qx = 0.5 * (face[j, 1, 0, 0] + face[j, 1, 1, 0])
    qy = 0.5 * (face[j, 1, 0, 1] + face[j, 1, 1, 1])
    dx = qx - px
    dy = qy - py
    work.normal[j, 0] = ty
    work.normal[j, 1] = -tx
    work.pivot[j, 0] = 0.5 * (px + qx)
    work.pivot[j, 1] = 0.5 * (py + qy)
    slip = tx * dx + ty * dy
    own.gap[j, 0] = ty * dx - tx * dy
    # Twice the sine of half the angle between both faces, and the rate at which that grows.
    own.gap[j, 1] = -2.0 * size * (ax * by - ay * bx)
    own.tilt[j] = 0.5 * sum_of_both
    own.half[j] = 0.5 * larger(model.length[j] - abs(slip), 0.0)
    return slip


@kernel
def pose_step(model, runs, impulse, step):
    """Move the chain to the middle of a step, and set up the gaps there."""
    state = runs.state
    work = runs.work
    own = runs.own
    free_fall(model, state, work, impulse, step)
    move_far_springing(state, work, impulse)
    for i in range(1, state.position.shape[0] - 1):
        for c in range(3):
            work.position[i, c] = (
                state.position[i, c] + 0.5 * step * state.velocity[i, c]
            )
    move_faces(model, work.position, work)
    for j in range(state.slip.shape[0]):
        work.slip[j] = _place_joint(j, model, work, own)
    relative_velocity(work.position, state.velocity, work.pivot, work.earlier)
    for j in range(state.slip.shape[0]):
        nx = work.normal[j, 0]
        ny = work.normal[j, 1]
        rate = nx * work.earlier[j, 1] - ny * work.earlier[j, 0]
        opens = nx * work.earlier[j, 0] + ny * work.earlier[j, 1]
        own.before[j, 0] = own.gap[j, 0] - 0.5 * step * opens
        own.before[j, 1] = own.gap[j, 1] + 0.5 * step * own.tilt[j] * work.earlier[j, 2]
        ends = ends_of(own.before[j, 0], own.before[j, 1], own.half[j])
        own.part[j, 0], own.part[j, 1] = ends
        own.touching[j] = runs.memory.touching[j]
        for i in range(3):
            own.slip[j, i] = runs.memory.slip[j, i] + 0.5 * step * rate


@inlined
def delay_of(faces, step):
    """Return how long after the middle of a step the law is asked where faces overlap already [s].

    Stiff contacts would ring with steps of twice this.
    """
    return larger(LEAST_DELAY * step, faces.delay + 0.0 * step)


@inlined
def _press(d0, d1, half, stiffness, points):
    """Return the energy that the springs normal to a joint store, and its derivatives [J], [N],
    [N m].
    """
    l0, l1, l2 = overlap_moments(d0, d1, half, points)
    by_gap = stiffness * (d0 * l0 + d1 * l1)
    by_slope = stiffness * (d0 * l1 + d1 * l2)
    return 0.5 * (d0 * by_gap + d1 * by_slope), by_gap, by_slope


@inlined
def _simpson(start, way, half, law, pieces):
    """Return the work of the springs normal to a joint on its way from a gap and slope, by
    Simpson's rule in so many pieces [J].

    `law` has the stiffness of a metre and the points.
    """
    work = 0.0 * half
    steps = 2 * pieces
    for i in range(steps + 1):
        at = i / steps
        share = 1.0 if i in (0, steps) else 2.0 + 2.0 * (i % 2)
        _, gap, slope = _press(
            start[0] + at * way[0], start[1] + at * way[1], half, *law
        )
        work -= share / (6.0 * pieces) * (gap * way[0] + slope * way[1])
    return work


@inlined
def _spring_works(j, runs, law, end):
    """Return the energy that the springs normal to joint j store at the `end` of a step, their
    work in it, and what those store that have slid onto the joint or off it [J].
    """
    own = runs.own
    g0 = own.before[j, 0]
    g1 = own.before[j, 1]
    half = own.half[j]
    way = end[0] - g0, end[1] - g1
    had, _, _ = _press(g0, g1, runs.memory.half[j], *law)
    has, _, _ = _press(g0, g1, half, *law)
    stored, _, _ = _press(end[0], end[1], half, *law)
    work = _simpson((g0, g1), way, half, law, 1)
    # A face that closes or opens on its way presses by other laws before and after.
    bent = abs(stored - has + work) > SMOOTH * (stored + has)
    if some(bent):
        work = select(bent, _simpson((g0, g1), way, half, law, PIECES), work)
    return stored, work, has - had


@inlined
def _cut(slip, most):
    return smaller(larger(slip, -most), most)


@inlined
def _keep_slip(j, i, size, was, times, runs):
    """Return the elastic slip of a point after a step and the work of its friction and of its
    dashpot, over the stiffness of a metre [m3]; and the sense in which it slides.

    It has the length `size` in contact then, and had `was`. What leaves loses what it stores, and
    what comes has not slipped.
    """
    memory = runs.memory
    work = runs.work
    own = runs.own
    nx = work.normal[j, 0]
    ny = work.normal[j, 1]
    slides = nx * work.relative[j, 1] - ny * work.relative[j, 0]
    held = own.held[j, i]
    most = own.most[j, i]
    start = memory.slip[j, i]
    asked = own.slip[j, i] + times[0] * slides
    moved = own.slip[j, i] + times[1] * slides
    slips = (abs(asked) > most) & (held > 0.0)
    sense = select(slips, select(asked < 0.0, 1.0, -1.0), 0.0)
    asked = _cut(asked, most)
    end = _cut(moved, most)
    grown = end - start
    kept = select(size > 0.0, end * smaller(held / larger(size, FLAT), 1.0), 0.0)
    lost = 0.5 * (size * kept * kept - held * end * end - (was - held) * start * start)
    friction = lost - held * asked * (moved - start - grown)
    damped = held * (0.5 * (start + end) - asked) * grown
    return kept, friction, select(slips, smaller(damped, 0.0), damped), sense


@inlined
def remember(j, model, faces, runs, times, where):
    """Remember slips and contact of joint j after a step.

    `times` are those after the middle of the step at which the law has been asked where faces
    overlapped already, and at which it ends. Returns the energy stored then, and the work of
    friction and of dashpots [J].
    """
    memory = runs.memory
    work = runs.work
    own = runs.own
    nx = work.normal[j, 0]
    ny = work.normal[j, 1]
    opens = nx * work.relative[j, 0] + ny * work.relative[j, 1]
    turns = own.tilt[j] * work.relative[j, 2]
    half = own.half[j]
    points = faces.points
    d0 = own.gap[j, 0] + times[1] * opens
    d1 = own.gap[j, 1] - times[1] * turns
    stored, sprung, friction = _spring_works(
        j, runs, (faces.stiffness[j], points), (d0, d1)
    )
    damped = own.force[j, 0] * (d0 - own.before[j, 0]) - sprung
    damped += own.force[j, 1] / own.tilt[j] * (d1 - own.before[j, 1])
    l0, _, _ = overlap_moments(d0, d1, half, points)
    outer, inner = places_of(half, points)
    shear = faces.shear[j]
    sense = 0.0 * half
    for i in range(1 if points == ALONG else 3):
        size = l0
        was = own.touching[j]
        if points != ALONG:
            was = inner if i == 1 else outer
            size = select(d0 + half * (i - 1.0) * d1 < 0.0, was, 0.0)
        kept, rubbed, damp, way = _keep_slip(j, i, size, was, times, runs)
        memory.slip[j, i] = select(where, kept, memory.slip[j, i])
        stored += 0.5 * shear * size * kept * kept
        friction += shear * rubbed
        damped += shear * damp
        sense = select(sense == 0.0, way, sense)
    memory.touching[j] = select(where, l0, memory.touching[j])
    memory.half[j] = select(where, half, memory.half[j])
    work.contact[j, 0] = flag(d0 - half * d1 < 0.0)
    work.contact[j, 1] = flag(d0 + half * d1 < 0.0)
    work.slide[j] = select(l0 > 0.0, sense, 0.0)
    return stored, friction, damped


@kernel
def record_joints(model, faces, runs, step, where):
    """Remember joints at the end of a solved step, and record their work; modes go into `work`."""
    memory = runs.memory
    work = runs.work
    relative_velocity(work.position, work.solved, work.pivot, work.relative)
    stored = friction = damped = done = 0.0 * step
    times = delay_of(faces, step), 0.5 * step
    for j in range(work.slide.shape[0]):
        for c in range(3):
            mean = 0.5 * (work.earlier[j, c] + work.relative[j, c])
            done += work.reaction[j, c] * mean
        energy, rubbed, damp = remember(j, model, faces, runs, times, where)
        stored += energy
        friction += rubbed
        damped += damp
    unexplained = done + stored - memory.stored[0] - friction - damped
    record_faces(friction, damped, unexplained, where, runs.state.energy)
    memory.stored[0] = select(where, stored, memory.stored[0])


@inlined
def _count_changes(state, work, where):
    """Count the changes of joints in a step."""
    count = state.count
    for j in range(state.slip.shape[0]):
        was_0 = state.contact[j, 0] > 0.5
        was_1 = state.contact[j, 1] > 0.5
        is_0 = work.contact[j, 0] > 0.5
        is_1 = work.contact[j, 1] > 0.5
        count[Count.IMPACTS] += flag(
            where & ((is_0 & opposite(was_0)) | (is_1 & opposite(was_1)))
        )
        count[Count.OPENINGS] += flag(
            where & ((was_0 & opposite(is_0)) | (was_1 & opposite(is_1)))
        )
        starts = (work.slide[j] != 0.0) & (state.slide[j] == 0.0)
        count[Count.SLIDES] += flag(where & starts)
        count[Count.LOSSES] += flag(where & (was_0 | was_1) & opposite(is_0 | is_1))


@kernel
def accept_step(model, state, work, impulse, where, loss_limit):
    """Accept solved velocities and the positions that they reach; return collapsed, broken.

    ``work.reaction`` goes from impulses into the mean forces over the step.
    """
    clock = state.clock
    step = state.clock[Clock.STEP]
    record_far_work(state, work, where)
    for i in range(1, state.position.shape[0]):
        for c in range(3):
            moved = work.position[i, c] + 0.5 * step * work.solved[i, c]
            state.position[i, c] = select(where, moved, state.position[i, c])
    take_velocities(model, state, work, impulse, where)
    _count_changes(state, work, where)
    lost = False
    for j in range(state.slip.shape[0]):
        for c in range(3):
            work.reaction[j, c] = work.reaction[j, c] / step
        state.slip[j] = select(where, work.slip[j], state.slip[j])
        none = (work.contact[j, 0] < 0.5) & (work.contact[j, 1] < 0.5)
        lost = lost | none | (work.slide[j] != 0.0)
    if some(lost):
        move_faces(model, state.position, work)
    collapsed = follow_joints(model, state, work, where, loss_limit)
    broken = record_motion(model, state, where)
    clock[Clock.TIME] = select(where, clock[Clock.TIME] + step, clock[Clock.TIME])
    clock[Clock.MOVING] += select(where, step, 0.0)
    state.count[Count.STEPS] += flag(where)
    return collapsed, broken
