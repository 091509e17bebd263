"""One step of a chain whose joints give, of one run or of four: pose, solve, accept.

Positions are those of the midpoint scheme. In the middle of the step each joint has a gap, and the
elastic part of its slip; forces act at its middle for the entire step. What a joint stores is
known at the ends of steps. The work of springs, of friction and of dashpots is that of their laws,
so that what they do not explain of the work of reactions is the error of the steps.
"""

import math

import numpy as np

from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact.placing import move_faces, relative_velocity
from archfrag.physics.energy import kinetic_energy, record_faces
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import opposite, select, some
from archfrag.physics.numbers import flag, larger, smaller
from archfrag.physics.shared import log_change
from archfrag.physics.state import Clock, Law, Model, Runs, allocate, new_runs
from archfrag.physics.status import Cause, Count, Level, Wait
from archfrag.physics.steps.face_law import (
    ALONG,
    FLAT,
    Faces,
    ends_of,
    overlap_moments,
    places_of,
    press,
)
from archfrag.physics.steps.face_velocities import (
    OF_BODIES,
    FaceWork,
    Memory,
    find_velocities,
    parts_of,
    three,
)
from archfrag.physics.steps.service import (
    MOST_STEPS,
    SHORTEST,
    code_after,
)
from archfrag.physics.steps.step import (
    count_change,
    move_to_middle,
    record_base_work,
    set_step,
    take_step,
)

# The law is asked at least this part of a step after its middle; see `delay_of`.
LEAST_DELAY = 0.6
# The work of springs is integrated once more, in PIECES pieces, if it differs from what they store
# by more than the part SMOOTH.
PIECES = 16
SMOOTH = 1e-4
BALANCED = 1e-6  # acceleration over gravity that a step may leave unbalanced
ALMOST = 1e-6  # part of a step that counts as no time
SLIDING_STEP = 0.5  # part of the step that is made while a joint slides


@inlined
def _middle_of(j, side, face):
    """Return the middle of a face of joint `j`: `side` 0 before it, 1 after it."""
    x = 0.5 * (face[j, side, 0, 0] + face[j, side, 1, 0])
    return x, 0.5 * (face[j, side, 0, 1] + face[j, side, 1, 1])


@inlined
def _place_joint(j, model, work, own):
    """Set pivot, normal, gap and slip of joint `j` from its faces."""
    tangent = work.tangent
    ax = tangent[j, 0, 0]
    ay = tangent[j, 0, 1]
    bx = tangent[j, 1, 0]
    by = tangent[j, 1, 1]
    sum_of_both = math.sqrt((ax + bx) * (ax + bx) + (ay + by) * (ay + by))
    size = 1.0 / sum_of_both
    tx = size * (ax + bx)
    ty = size * (ay + by)
    px, py = _middle_of(j, 0, work.face)
    qx, qy = _middle_of(j, 1, work.face)
    dx = qx - px
    dy = qy - py
    work.normal[j, 0] = ty
    work.normal[j, 1] = -tx
    work.pivot[j, 0] = 0.5 * (px + qx)
    work.pivot[j, 1] = 0.5 * (py + qy)
    slip = tx * dx + ty * dy
    work.slip[j] = slip
    own.gap[j, 0] = ty * dx - tx * dy
    # Twice the sine of half the angle between both faces, and the rate at which that grows.
    own.gap[j, 1] = -2.0 * size * (ax * by - ay * bx)
    own.tilt[j] = 0.5 * sum_of_both
    own.half[j] = 0.5 * larger(model.length[j] - abs(slip), 0.0)


@kernel
def pose_faces(runs, step):
    """Move the chain to the middle of a step, and set the gaps and slips there."""
    model = runs.model
    state = runs.state
    work = runs.work
    own = runs.own
    move_to_middle(model, state, work, step)
    move_faces(model, work.position, work)
    for j in range(state.slip.size):
        _place_joint(j, model, work, own)
    relative_velocity(
        runs.model, work.position, state.velocity, work.pivot, work.earlier
    )
    for j in range(state.slip.size):
        x, y, turns = three(work.earlier, j)
        opens, rate = parts_of(j, work, x, y)
        d0 = own.gap[j, 0] - 0.5 * step * opens
        d1 = own.gap[j, 1] + 0.5 * step * own.tilt[j] * turns
        own.before[j, 0] = d0
        own.before[j, 1] = d1
        own.part[j, 0], own.part[j, 1] = ends_of(d0, d1, own.half[j])
        own.touching[j] = runs.memory.touching[j]
        for i in range(3):
            own.slip[j, i] = runs.memory.slip[j, i] + 0.5 * step * rate


@inlined
def delay_of(faces, step):
    """Return how long after the middle of a step the law is asked where faces overlap already [s].

    With half a step, stiff contacts would ring.
    """
    return larger(LEAST_DELAY * step, faces.delay + 0.0 * step)


@inlined
def _simpson(start, way, half, law, pieces):
    """Return the work of the springs normal to a joint while gap and slope change [J].

    It is integrated by Simpson's rule in `pieces` pieces. `start` has gap [m] and slope at the
    beginning, and `way` their changes; `law` has the stiffness of a metre and the points.
    """
    work = 0.0 * half
    steps = 2 * pieces
    for i in range(steps + 1):
        at = i / steps
        share = 1.0 if i in (0, steps) else 2.0 + 2.0 * (i % 2)
        _, gap, slope = press(
            start[0] + at * way[0], start[1] + at * way[1], half, *law
        )
        work -= share / (6.0 * pieces) * (gap * way[0] + slope * way[1])
    return work


@inlined
def _spring_works(j, runs, law, end):
    """Return three energies of the springs normal to joint `j` in a step [J].

    They are what the springs store at its `end`, (gap, slope); their work in it; and what those
    store that have slid onto the joint, less those that have slid off it. `law` is that of
    `_simpson`.
    """
    own = runs.own
    half = own.half[j]
    start = own.before[j, 0], own.before[j, 1]
    way = end[0] - start[0], end[1] - start[1]
    had, _, _ = press(*start, runs.memory.half[j], *law)
    has, _, _ = press(*start, half, *law)
    stored, _, _ = press(*end, half, *law)
    work = _simpson(start, way, half, law, 1)
    # A face that closes or opens on its way presses by other laws before and after.
    bent = abs(stored - has + work) > SMOOTH * (stored + has)
    if some(bent):
        work = select(bent, _simpson(start, way, half, law, PIECES), work)
    return stored, work, has - had


@inlined
def _cut(slip, most):
    return smaller(larger(slip, -most), most)


@inlined
def _keep_slip(j, i, size, was, times, runs, where, sums):
    """Remember the elastic slip of point `i` of joint `j` after a step.

    `size` is its length in contact then, and `was` the length that had its slip before [m];
    `times` are those of `remember`. What leaves contact loses what it stores, and what comes into
    contact has not slipped. Return the sense in which the point slides, and `sums` with what it
    adds: energy stored, work of friction and work of dashpots [J].
    """
    memory = runs.memory
    work = runs.work
    own = runs.own
    _, slides = parts_of(j, work, work.relative[j, 0], work.relative[j, 1])
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
    damped = select(slips, smaller(damped, 0.0), damped)
    memory.slip[j, i] = select(where, kept, memory.slip[j, i])
    shear = runs.faces.shear[j]
    stored = sums[0] + 0.5 * shear * size * kept * kept
    return sense, (stored, sums[1] + shear * friction, sums[2] + shear * damped)


@inlined
def remember_face(j, runs, times, size, where, sums):
    """Remember the slip of a joint that bears all along it.

    `size` is its length in contact after the step [m]. Return what `_keep_slip` does.
    """
    return _keep_slip(j, 0, size, runs.own.touching[j], times, runs, where, sums)


@inlined
def remember_points(j, runs, times, gap, where, sums):
    """Remember the slips of the points of a joint.

    `gap` has gap and slope after the step. Return what `_keep_slip` does.
    """
    half = runs.own.half[j]
    outer, inner = places_of(half, runs.faces.points)
    sense = 0.0 * half
    for i in range(3):
        was = inner if i == 1 else outer
        size = select(gap[0] + half * (i - 1.0) * gap[1] < 0.0, was, 0.0)
        way, sums = _keep_slip(j, i, size, was, times, runs, where, sums)
        sense = select(sense == 0.0, way, sense)
    return sense, sums


@inlined
def remember(j, runs, times, where):
    """Remember slips and contact of joint `j` after a step; its mode goes into ``runs.work``.

    `times` are two times after the middle of the step [s]: at which the law has been asked where
    faces overlapped already, and at which the step ends. Return the energy stored then, and the
    work of friction and of dashpots in the step [J].
    """
    memory = runs.memory
    work = runs.work
    own = runs.own
    x, y, turns = three(work.relative, j)
    opens, _ = parts_of(j, work, x, y)
    half = own.half[j]
    points = runs.faces.points
    d0 = own.gap[j, 0] + times[1] * opens
    d1 = own.gap[j, 1] - times[1] * (own.tilt[j] * turns)
    law = runs.faces.stiffness[j], points
    stored, sprung, friction = _spring_works(j, runs, law, (d0, d1))
    damped = own.force[j, 0] * (d0 - own.before[j, 0]) - sprung
    damped += own.force[j, 1] / own.tilt[j] * (d1 - own.before[j, 1])
    sums = (stored, friction, damped)
    size, _, _ = overlap_moments(d0, d1, half, points)
    if points == ALONG:
        sense, sums = remember_face(j, runs, times, size, where, sums)
    else:
        sense, sums = remember_points(j, runs, times, (d0, d1), where, sums)
    memory.touching[j] = select(where, size, memory.touching[j])
    memory.half[j] = select(where, half, memory.half[j])
    work.contact[j, 0] = flag(d0 - half * d1 < 0.0)
    work.contact[j, 1] = flag(d0 + half * d1 < 0.0)
    work.slide[j] = select(size > 0.0, sense, 0.0)
    return sums


@kernel
def record_joints(runs, step, where):
    """Remember all joints at the end of a solved step, and record their work.

    Their modes go into ``runs.work``.
    """
    state = runs.state
    clock = state.clock
    work = runs.work
    relative_velocity(runs.model, work.position, work.solved, work.pivot, work.relative)
    stored = friction = damped = done = 0.0 * step
    times = delay_of(runs.faces, step), 0.5 * step
    for j in range(work.slide.size):
        for c in range(3):
            mean = 0.5 * (work.earlier[j, c] + work.relative[j, c])
            done += work.reaction[j, c] * mean
        energy, rubbed, damp = remember(j, runs, times, where)
        stored += energy
        friction += rubbed
        damped += damp
    unexplained = done + stored - clock[Clock.STORED] - friction - damped
    record_faces(friction, damped, unexplained, where, state.energy)
    clock[Clock.STORED] = select(where, stored, clock[Clock.STORED])


@kernel
def solve_faces(runs, live):
    """Find the velocities after steps; return the masks solved and unsolved, as `Law.solve`.

    A step that is not solved is halved; it counts as unsolved if it is too short for that.
    """
    count = runs.state.count
    clock = runs.state.clock
    step = clock[Clock.STEP]
    delay = delay_of(runs.faces, step)
    solved, iterations = find_velocities(runs, step, delay, BALANCED, live)
    count[Count.ITERATIONS] += select(live, iterations, 0.0)
    failed = live & opposite(solved)
    count[Count.SHORTENED] += flag(failed)
    clock[Clock.STEP] = select(failed, 0.5 * step, step)
    if some(solved):
        record_joints(runs, step, solved)
    short = clock[Clock.STEP] < SHORTEST * runs.options.time_step
    return solved, short & opposite(solved)


@kernel
def accept_faces(runs, impulse, where):
    """Take a solved step of joints that give; return where the chain has collapsed."""
    state = runs.state
    work = runs.work
    record_base_work(runs, where)
    lost = False
    for j in range(state.slip.size):
        count_change(j, state, work, where)
        none = (work.contact[j, 0] < 0.5) & (work.contact[j, 1] < 0.5)
        lost = lost | none | (work.slide[j] != 0.0)
    take_step(runs, impulse, where)
    if some(lost):
        move_faces(runs.model, state.position, work)
    return follow_joints(runs.model, state, work, where, runs.options.loss_limit)


@kernel
def go_on_faces(runs, until, outcome):
    """Set the next steps of runs on joints that give, and the codes of those that end or wait.

    Writes: runs.state.clock.
    """
    state = runs.state
    faces = runs.faces
    options = runs.options
    clock = state.clock
    solved = outcome[0]
    time = clock[Clock.TIME]
    slides = False
    for j in range(state.slide.size):
        slides = slides | (state.slide[j] != 0.0)
    shortest = SLIDING_STEP * options.time_step
    longest = select(slides, shortest, options.time_step)
    step = smaller(2.0 * clock[Clock.STEP], longest)
    set_step(clock, step, until, solved)
    barely = ALMOST * options.time_step
    driven = time < until - options.follow - barely
    # A chain that nothing has moved rests as soon as the motion is over.
    lively = kinetic_energy(runs.model, state.velocity) >= faces.sway
    lively = lively | (clock[Clock.FASTEST] >= faces.still)
    moved = lively | (driven & (clock[Clock.LIVELY] > 0.0))
    since = select(solved & moved, time, clock[Clock.LIVELY])
    clock[Clock.LIVELY] = since
    calm = solved & opposite(driven) & ((time - since >= faces.calm) | (since == 0.0))
    over = solved & (time >= until - barely) & opposite(calm)
    most = options.first_steps + until * (MOST_STEPS / shortest)
    taken = state.count[Count.STEPS] + state.count[Count.SHORTENED]
    spent = (taken >= most) & opposite(calm)
    clock[Clock.CODE] = code_after(clock[Clock.CODE], outcome, over, spent, calm)


@kernel
def start_faces(runs, output):
    """Start a run from rest on its joints; return the code."""
    clock = runs.state.clock
    faces = runs.faces
    memory = runs.memory
    clock[Clock.STEP] = runs.options.time_step
    clock[Clock.NOTED] = runs.grounds.noted[int(clock[Clock.MOTION])]
    clock[Clock.STORED] = clock[Clock.STORED_FIRST] = faces.stored
    for j in range(memory.half.size):
        memory.touching[j] = faces.touching[j]
        memory.half[j] = faces.half[j]
        for i in range(3):
            memory.slip[j, i] = faces.slip[j, i]
    log_change(runs.state, 0.0, Cause.START, -1, Level.ALL_VOUSSOIRS, output)
    return Wait.GO


@kernel
def handle_faces(runs, output):
    """Let a run that pauses rest for good; return the code.

    Reads: runs.state.clock.
    Writes: runs.state.clock.
    """
    clock = runs.state.clock
    if clock[Clock.CODE] == Wait.PAUSE:
        clock[Clock.CODE] = Wait.IDLE
    return int(clock[Clock.CODE])


FACE = Law(
    pose=pose_faces,
    solve=solve_faces,
    accept=accept_faces,
    go_on=go_on_faces,
    start=start_faces,
    handle=handle_faces,
)


def new_face_runs(model: Model, faces: Faces, zeros=np.zeros) -> Runs:
    """Allocate one run on joints that give, or several with `lane_array` as `zeros`."""
    rows = dict.fromkeys(OF_BODIES, model.mass.size)
    return new_runs(
        FACE,
        model,
        zeros,
        faces=faces,
        memory=allocate(Memory, model, zeros),
        own=allocate(FaceWork, model, zeros, **rows),
    )
