"""One step of a chain whose joints give, of one run or of four: pose, solve, accept.

Positions are those of the midpoint scheme. In the middle of the step each joint has a gap, and the
elastic part of its slip; forces act at its middle for the entire step. What a joint stores is
known at the ends of steps; what it takes beyond that and beyond friction its dashpots take, and
where the step is longer than their delay, the step itself.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact.placing import move_faces, relative_velocity
from archfrag.physics.energy import record_faces
from archfrag.physics.faces.law import ALONG, ROUGH, overlap_moments, places_of, rub
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


@struct(slip=(3,))
class Memory(NamedTuple):
    """What joints that give remember between steps, of one run or of four."""

    slip: np.ndarray  # (n_joint, 3) elastic part of the slip of points [m]
    touching: np.ndarray  # (n_joint,) length in contact [m]
    stored: np.ndarray  # (1,) elastic energy of all [J]


@struct()
class FaceRuns(NamedTuple):
    """State and workspace of one run or of four, and the same memory as columns of numbers."""

    state: State
    memory: Memory
    work: Work
    own: FaceWork
    columns: tuple[np.ndarray, ...]  # (n,) or (n, 4) each: arrays of state and memory


def new_runs(model: Model, zeros: Callable[[tuple[int, ...]], Any] = np.zeros) -> FaceRuns:
    """Allocate the buffers of one run, or of four with `lane_array` as `zeros`."""
    state, n_joint, n_row = new_state(model, zeros), model.friction.size, model.mass.size
    memory = Memory(zeros((n_joint, 3)), zeros((n_joint,)), zeros((1,)))
    own: Any = FaceWork(*(
        zeros((n_row if name in OF_ROWS else n_joint, *OF_WORK.get(name, ())))
        for name in FaceWork._fields
    ))  # fmt: skip
    shape = (-1,) if zeros is np.zeros else (-1, LANES)
    plain = runs_of if zeros is lane_array else np.asarray
    columns = tuple(plain(array).reshape(shape) for array in (*state, *memory))
    return FaceRuns(state, memory, new_work(model, zeros), own, columns)


@inlined
def _place_joint(j, model, work, own):
    """Set pivot, normal and gap of joint j between the faces as they are; return its slip [m]."""
    face, tangent = work.face, work.tangent
    ax, ay = tangent[j, 0, 0], tangent[j, 0, 1]
    bx, by = tangent[j, 1, 0], tangent[j, 1, 1]
    sum_of_both = math.sqrt((ax + bx) * (ax + bx) + (ay + by) * (ay + by))
    size = 1.0 / sum_of_both
    tx, ty = size * (ax + bx), size * (ay + by)
    px = 0.5 * (face[j, 0, 0, 0] + face[j, 0, 1, 0])
    py = 0.5 * (face[j, 0, 0, 1] + face[j, 0, 1, 1])
    qx = 0.5 * (face[j, 1, 0, 0] + face[j, 1, 1, 0])
    qy = 0.5 * (face[j, 1, 0, 1] + face[j, 1, 1, 1])
    dx, dy = qx - px, qy - py
    work.normal[j, 0], work.normal[j, 1] = ty, -tx
    work.pivot[j, 0], work.pivot[j, 1] = 0.5 * (px + qx), 0.5 * (py + qy)
    slip = tx * dx + ty * dy
    own.gap[j, 0] = ty * dx - tx * dy
    # Twice the sine of half the angle between both faces, and the rate at which that grows.
    own.gap[j, 1] = -2.0 * size * (ax * by - ay * bx)
    own.tilt[j] = 0.5 * sum_of_both
    own.half[j] = 0.5 * larger(model.length[j] - abs(slip), 0.0)
    return slip


@kernel
def pose_step(model, runs, impulse, step):
    """Move the chain to the middle of a step, and set up the gaps there.

    Reads: model, runs, impulse.
    Writes: runs.
    """
    state, work, own = runs.state, runs.work, runs.own
    free_fall(model, state, work, impulse, step)
    move_far_springing(state, work, impulse)
    for i in range(1, state.position.shape[0] - 1):
        for c in range(3):
            work.position[i, c] = state.position[i, c] + 0.5 * step * state.velocity[i, c]
    move_faces(model, work.position, work.rotated, work.face, work.tangent)
    for j in range(state.slip.shape[0]):
        work.slip[j] = _place_joint(j, model, work, own)
    relative_velocity(work.position, state.velocity, work.pivot, work.earlier)
    for j in range(state.slip.shape[0]):
        nx, ny = work.normal[j, 0], work.normal[j, 1]
        rate = nx * work.earlier[j, 1] - ny * work.earlier[j, 0]
        own.touching[j] = runs.memory.touching[j]
        for i in range(3):
            own.slip[j, i] = runs.memory.slip[j, i] + 0.5 * step * rate


@inlined
def _slip_after(j, i, gap, size, along, model, faces, own):
    """Return the elastic slip of a contact after a step, and the work of its friction [J].

    `gap` is that at which the law holds, `size` the length in contact there; without friction the
    slip would go to `along`.
    """
    normal = -faces.stiffness[j] * size * gap
    hold = faces.shear[j] * size
    most = smaller(model.friction[j], ROUGH) * normal / larger(hold, 1e-300)
    shear, sense = rub(normal, own.slip[j, i] + along[0], hold, model.friction[j])
    slip = own.slip[j, i] + along[1]
    kept = select(sense != 0.0, smaller(larger(slip, -most), most), slip)
    return kept, shear * (slip - kept), sense


@inlined
def remember(j, model, faces, runs, b, span, where):
    """Remember slips and contact of joint j a time `span` after the middle of the step.

    `b` is the time at which its law holds. Returns the energy that it stores then, and the work
    of friction [J].
    """
    memory, work, own = runs.memory, runs.work, runs.own
    nx, ny = work.normal[j, 0], work.normal[j, 1]
    ux, uy, turns = work.relative[j, 0], work.relative[j, 1], own.tilt[j] * work.relative[j, 2]
    opens, slides, half = nx * ux + ny * uy, nx * uy - ny * ux, own.half[j]
    g0, g1 = own.gap[j, 0] + b * opens, own.gap[j, 1] - b * turns
    d0, d1 = own.gap[j, 0] + span * opens, own.gap[j, 1] - span * turns
    k, points, ways = faces.stiffness[j], faces.points, (b * slides, span * slides)
    moments = overlap_moments(d0, d1, half, points)
    l0 = moments[0]
    sense = friction = held = 0.0 * half
    if points == ALONG:
        size = smaller(overlap_moments(g0, g1, half, points)[0], own.touching[j])
        gap = -own.force[j, 0] / (k * larger(size, 1e-300))
        kept, friction, sense = _slip_after(j, 0, gap, size, ways, model, faces, own)
        # What comes into contact has not slipped yet.
        kept = kept * smaller(own.touching[j] / larger(l0, 1e-300), 1.0)
        kept = select(l0 > 0.0, kept, 0.0)
        memory.slip[j, 0] = select(where, kept, memory.slip[j, 0])
        held = l0 * kept * kept
    else:
        outer, inner = places_of(half, points)
        for i in range(3):
            place, size = half * (i - 1.0), inner if i == 1 else outer
            gap = g0 + place * g1
            touching = select(gap < 0.0, size, 0.0)
            kept, work_of, way = _slip_after(j, i, gap, touching, ways, model, faces, own)
            kept = select(d0 + place * d1 < 0.0, kept, 0.0)
            memory.slip[j, i] = select(where, kept, memory.slip[j, i])
            friction += select(touching > 0.0, work_of, 0.0)
            sense = select((touching > 0.0) & (sense == 0.0), way, sense)
            held += select(d0 + place * d1 < 0.0, size, 0.0) * kept * kept
    memory.touching[j] = select(where, l0, memory.touching[j])
    work.contact[j, 0] = flag(d0 - half * d1 < 0.0)
    work.contact[j, 1] = flag(d0 + half * d1 < 0.0)
    work.slide[j] = select(l0 > 0.0, sense, 0.0)
    l0, l1, l2 = moments
    pressed = d0 * (d0 * l0 + 2.0 * d1 * l1) + d1 * d1 * l2
    return 0.5 * (k * pressed + faces.shear[j] * held), friction


@kernel
def record_joints(model, faces, runs, step, where):
    """Remember joints at the end of a solved step, and record their work; modes go into `work`.

    Reads: model.friction, faces (delay, points, shear, stiffness), runs.
    Writes: runs.
    """
    memory, work = runs.memory, runs.work
    relative_velocity(work.position, work.solved, work.pivot, work.relative)
    stored = friction = done = 0.0 * step
    b = larger(step, faces.delay + 0.0 * step)
    for j in range(work.slide.shape[0]):
        for c in range(3):
            mean = 0.5 * (work.earlier[j, c] + work.relative[j, c])
            done += work.reaction[j, c] * mean
        energy, rubbed = remember(j, model, faces, runs, b, 0.5 * step, where)
        stored += energy
        friction += rubbed
    taken = done + stored - memory.stored[0] - friction
    record_faces(friction, taken, where, runs.state.energy)
    memory.stored[0] = select(where, stored, memory.stored[0])


@inlined
def _count_changes(state, work, where):
    """Count the changes of joints in a step."""
    count = state.count
    for j in range(state.slip.shape[0]):
        was_0, was_1 = state.contact[j, 0] > 0.5, state.contact[j, 1] > 0.5
        is_0, is_1 = work.contact[j, 0] > 0.5, work.contact[j, 1] > 0.5
        count[Count.IMPACTS] += flag(where & ((is_0 & opposite(was_0)) | (is_1 & opposite(was_1))))
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

    Reads: model, state, work, impulse (x, y).
    Writes: state, work (face, reaction, rotated, tangent, tie).
    """
    clock, step = state.clock, state.clock[Clock.STEP]
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
        move_faces(model, state.position, work.rotated, work.face, work.tangent)
    collapsed = follow_joints(model, state, work, where, loss_limit)
    broken = record_motion(model, state, where)
    clock[Clock.TIME] = select(where, clock[Clock.TIME] + step, clock[Clock.TIME])
    clock[Clock.MOVING] += select(where, step, 0.0)
    state.count[Count.STEPS] += flag(where)
    return collapsed, broken
