"""One step of Moreau's midpoint scheme, of one run or of four: pose, solve, accept.

`pose_step` and `accept_step` serve every law of joints; the rest of this module, and `at_impacts`,
is for rigid ones.

From the positions q and velocities v of one instant the bodies move on for half the step h. There
contacts are looked for (Moreau 1988, 1999; Jean 1999), and all forces act for the entire step:

    q_m = q + h/2 v,    M (w - v) = h f(q_m) + H(q_m) r,    q' = q_m + h/2 w

Displacement and impulse belong to the same step, whatever its length and that of its neighbours.
The kinetic energy changes by M (w - v) (v + w) / 2 and the potential energy by h m g (v + w) / 2.
To rounding their sum is the work of the ground and of the reactions at the mean velocities.

Signorini's law holds at the position from which the next step's middle is reached, as with Paoli
and Schatzman (2002, *SIAM J. Numer. Anal.* 40(2)): q' moved on along the velocities w, for half
the step where a corner touches, and for half the shortest step at most where it is open. With no
restitution a contact neither drifts nor penetrates. The curvature of the path has no part in the
law at q', so that a change of the step moves no contact.
"""

import math

from archfrag.physics.collapse import follow_joints
from archfrag.physics.contact import placing
from archfrag.physics.contact.ties import accept_pulls, aim_pulls
from archfrag.physics.energy import (
    kinetic_energy,
    record_calm,
    record_pulls,
    record_step,
)
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import opposite, select, some
from archfrag.physics.neighbours import end_of, row_of
from archfrag.physics.numbers import flag, larger, nearest, smaller
from archfrag.physics.state import Clock
from archfrag.physics.status import Count, Energy, Peak

# A corner takes part in a step if its gap could close within it at this many times the largest
# relative velocity of any joint: an impact elsewhere may throw it shut. Both corners of a joint
# get one normal if both could close at this many times the rates at which they do.
REACH = 5.0
# Overlap is corrected no faster than at the joint's own relative speed plus what gravity and
# this many times rotation do in a step: a deep one would throw the bodies apart.
SWING = 4.0
# An impact off the middle of its step leaves the corner a part of the rate at which it came. If
# that is more than COMPLETE, the impact goes on in the next step. ENDING and GOING_ON are values
# of `State.impact`.
COMPLETE = 0.001
ENDING = 1.0
GOING_ON = 2.0
# An impact this near to the middle of a step, over its length, need not be brought nearer.
CENTRED = 0.1
# The mean tension over a step is that of the middle plus this part of its change by the step.
MEAN = 0.25
# Steps after which overlaps are looked for if no corner opens or closes.
OVERLAP_INTERVAL = 8.0


@inlined
def _limited_bias(bx, by, nx, ny, limit):
    """Limit the rate at which a bias (bx, by) corrects overlap and slip to `limit` [m/s]."""
    inward = larger(-limit - (nx * bx + ny * by), 0.0)
    bx = bx + inward * nx
    by = by + inward * ny
    along = nx * by - ny * bx
    excess = along - smaller(larger(along, -limit), limit)
    return bx + excess * ny, by - excess * nx


@inlined
def normal_of(j, work):
    """Return the normal of joint j."""
    return work.normal[j, 0], work.normal[j, 1]


@inlined
def bend_of(j, k, model, velocity, work):
    """Return the acceleration of a corner's offset at constant velocities [m/s2].

    It is the centripetal one of both bodies, and that of Coriolis where a vertex slides on a face.
    """
    i = row_of(model, j, 0)
    m = row_of(model, j, 1)
    after = velocity[m, 2]
    before = velocity[i, 2]
    place = work.position
    px = work.point[j, k, 0]
    py = work.point[j, k, 1]
    hx = before * before * (px - place[i, 0]) - after * after * (px - place[m, 0])
    hy = before * before * (py - place[i, 1]) - after * after * (py - place[m, 1])
    nx, ny = normal_of(j, work)
    ux, uy = placing.corner_velocity(j, k, work.earlier, work)
    face = select(placing.later_vertex_meets(k, work.slip[j]), before, after)
    coriolis = 2.0 * face * (nx * uy - ny * ux)
    return hx + coriolis * nx, hy + coriolis * ny


@inlined
def offset_of(j, k, model, work):
    """Return `corner_offset` in the middle of the step; zero if it is rounding [m]."""
    ex, ey = placing.corner_offset(j, k, work, work.slip[j])
    tiny = abs(ex) + abs(ey) < model.rounding
    return select(tiny, 0.0, ex), select(tiny, 0.0, ey)


@kernel
def aim_contacts(model, state, work, step, shortest):
    """Set the bias so that the contact laws hold where the next step looks for contacts.

    An offset e in the middle of the step becomes e + (h/2 + k) u + (h/8 + k/2) h b. It changes at
    the velocity u after the step for the rest of the step, h/2, and then for a time k; b is from
    `bend_of`.

    Writes: work (bias, candidate, side_normal).
    """
    velocity = state.velocity
    gravity = model.gravity
    fastest = 0.0
    for j in range(work.slip.size):
        for k in range(2):
            ux, uy = placing.corner_velocity(j, k, work.earlier, work)
            fastest = larger(fastest, abs(ux) + abs(uy))
    reach = REACH * step * (fastest + gravity * step)
    half = 0.5 * step
    for j in range(work.slip.size):
        nx, ny = normal_of(j, work)
        before = velocity[row_of(model, j, 0), 2]
        spin = larger(abs(before), abs(velocity[row_of(model, j, 1), 2]))
        slow = step * (gravity + SWING * model.length[j] * (spin * spin))
        closing = True
        for k in range(2):
            beyond = select(
                state.contact[j, k] > 0.5, half, smaller(half, 0.5 * shortest)
            )
            span = half + beyond
            rate = 1.0 / span
            bend = step * (0.125 * step + 0.5 * beyond)
            ex, ey = offset_of(j, k, model, work)
            hx, hy = bend_of(j, k, model, velocity, work)
            ex = ex + bend * hx
            ey = ey + bend * hy
            ux, uy = placing.corner_velocity(j, k, work.earlier, work)
            own = abs(ux) + abs(uy)
            bx, by = _limited_bias(ex * rate, ey * rate, nx, ny, slow + own)
            work.bias[j, k, 0] = bx
            work.bias[j, k, 1] = by
            gap = nx * (ex + span * ux) + ny * (ey + span * uy)
            work.candidate[j, k] = flag(gap < reach)
            nearing = abs(nx * ux + ny * uy)
            closing = closing & (gap < REACH * step * (nearing + gravity * step))
        side = work.side_normal
        for k in range(2):
            for sense in range(2):
                side[j, k, sense, 0] = select(closing, nx, side[j, k, sense, 0])
                side[j, k, sense, 1] = select(closing, ny, side[j, k, sense, 1])


@inlined
def free_fall(model, state, work, impulse, span):
    """Set ``work.free`` to the velocities without reactions after a time `span` [s].

    `impulse` is that of the ground motion in that time.
    """
    fall = impulse.y + span * model.gravity
    for i in range(1, end_of(model, state.position)):
        work.free[i, 0] = state.velocity[i, 0] - impulse.x
        work.free[i, 1] = state.velocity[i, 1] - fall
        work.free[i, 2] = state.velocity[i, 2]


@inlined
def move_to_middle(model, state, work, step):
    """Move bodies to the middle of a step."""
    for i in range(1, end_of(model, state.position)):
        for c in range(3):
            work.position[i, c] = (
                state.position[i, c] + 0.5 * step * state.velocity[i, c]
            )


@kernel
def go_to_middle(model, state, work, step):
    """Move bodies, faces and slips to the middle of a step."""
    move_to_middle(model, state, work, step)
    placing.place_chain(model, work.position, state, 0.0, work.slip, work)
    placing.relative_velocity(
        model, work.position, state.velocity, work.pivot, work.earlier
    )


@inlined
def set_step(clock, step, until, where):
    """Set the size of the next step, where `where` holds; it ends at `until` at the latest [s]."""
    left = until - clock[Clock.TIME]
    step = select((left > 0.0) & (left < step), left, step)
    clock[Clock.STEP] = select(where, step, clock[Clock.STEP])


@inlined
def is_centred(clock, step):
    """Return whether an impact is expected in the middle of the next step."""
    return abs(clock[Clock.IMPACT] - (clock[Clock.TIME] + 0.5 * step)) <= CENTRED * step


@inlined
def time_before(state, step):
    """Return the time from the beginning of a step to an impact in its middle [s].

    It is zero if none is expected there.
    """
    return select(is_centred(state.clock, step), 0.5 * step, 0.0 * step)


@kernel
def carry_on(model, state, work, span):
    """Let the reactions of the last step act on ``work.free`` for a time `span`, until an impact.

    Else joints that the impact opens would bear nothing in that time, and the impact would take
    what the ground gives against them: a part of the energy of the order of the step, each time.

    Writes: work.free.
    """
    for j in range(state.slip.size):
        fx = span * state.force[j, 0]
        fy = span * state.force[j, 1]
        for side, sense in ((1, 1.0), (0, -1.0)):
            end = row_of(model, j, side)
            px = work.pivot[j, 0] - work.position[end, 0]
            py = work.pivot[j, 1] - work.position[end, 1]
            moment = span * state.force[j, 2] + px * fy - py * fx
            work.free[end, 0] += sense * model.inverse_mass[end] * fx
            work.free[end, 1] += sense * model.inverse_mass[end] * fy
            work.free[end, 2] += sense * model.inverse_inertia[end] * moment


@kernel
def pose_contacts(runs, step):
    """Set up the contact problem of a step, without initial modes."""
    model = runs.model
    state = runs.state
    work = runs.work
    go_to_middle(model, state, work, step)
    aim_pulls(model, state, work, step, MEAN)
    span = time_before(state, step)
    if some(span > 0.0):
        carry_on(model, state, work, span)
    aim_contacts(model, state, work, step, runs.options.time_step)


@kernel
def pose_step(runs, impulse):
    """Pose the next step, after `archfrag.physics.ground.move_ground`."""
    step = runs.state.clock[Clock.STEP]
    free_fall(runs.model, runs.state, runs.work, impulse, step)
    runs.law.pose(runs, step)


@inlined
def _mean_velocity(i, state, work):
    """Return the mean velocity of a centroid in a solved step."""
    x = 0.5 * (state.velocity[i, 0] + work.solved[i, 0])
    return x, 0.5 * (state.velocity[i, 1] + work.solved[i, 1])


@inlined
def record_base_work(runs, where):
    """Record the work of bases that move relative to the left one."""
    if runs.grounds.far.shape[0] == 0:
        return
    model = runs.model
    state = runs.state
    work = runs.work
    for j in range(state.slip.size):
        for side, sense in ((0, 1.0), (1, -1.0)):
            i = row_of(model, j, side)
            if i >= model.end:
                x, y = _mean_velocity(i, state, work)
                given = work.reaction[j, 0] * x + work.reaction[j, 1] * y
                state.energy[Energy.GROUND] += select(where, sense * given, 0.0)


@inlined
def _is_complete(j, model, state, work):
    """Return whether the impact at joint `j` is complete.

    It is if no touching corner still closes, or opens again, at a rate that counts.
    """
    nx, ny = normal_of(j, work)
    step = state.clock[Clock.STEP]
    fall = model.gravity * step
    complete = True
    for k in range(2):
        ux, uy = placing.corner_velocity(j, k, work.earlier, work)
        came = larger(abs(nx * ux + ny * uy), fall)
        ex, ey = offset_of(j, k, model, work)
        hx, hy = bend_of(j, k, model, state.velocity, work)
        off = nx * ex + ny * ey - 0.125 * step * step * (nx * hx + ny * hy)
        complete = complete & (
            (work.contact[j, k] < 0.5) | (abs(off) <= COMPLETE * came * step)
        )
    return complete


@inlined
def count_change(j, state, work, where):
    """Count the changes of joint j in a step; return whether a corner closes."""
    count = state.count
    was_0 = state.contact[j, 0] > 0.5
    was_1 = state.contact[j, 1] > 0.5
    is_0 = work.contact[j, 0] > 0.5
    is_1 = work.contact[j, 1] > 0.5
    differs = (was_0 ^ is_0) | (was_1 ^ is_1) | (state.slide[j] != work.slide[j])
    differs = differs & where
    made = differs & ((is_0 & opposite(was_0)) | (is_1 & opposite(was_1)))
    if some(differs):
        opened = differs & ((was_0 & opposite(is_0)) | (was_1 & opposite(is_1)))
        slides = differs & (work.slide[j] != 0.0) & (state.slide[j] == 0.0)
        count[Count.IMPACTS] += flag(made)
        count[Count.OPENINGS] += flag(opened)
        count[Count.SLIDES] += flag(slides)
        count[Count.LOSSES] += flag(opened & opposite(is_0 | is_1))
    return made


@kernel
def count_changes(model, state, work, where):
    """Count changes of joints in a step, and mark impacts that go on after it.

    Writes: state (count, impact).
    """
    for j in range(state.slip.size):
        hits = where & (state.impact[j] > 0.5)
        hits = hits | count_change(j, state, work, where)
        if some(hits):
            going_on = select(_is_complete(j, model, state, work), ENDING, GOING_ON)
            state.impact[j] = select(hits, going_on, state.impact[j])


@inlined
def speed_of(i, velocity, length):
    """Return the speed of body i, rotation times joint length included [m/s]."""
    straight = abs(velocity[i, 0]) + abs(velocity[i, 1])
    return larger(straight, length * abs(velocity[i, 2]))


@kernel
def record_motion(model, state, where):
    """Record the largest displacement, rotation and kinetic energy, and the present largest speed.

    Return where positions are not finite.

    Writes: state (clock, energy, peak).
    """
    farthest = fastest = 0.0
    rotation = state.peak[Peak.ROTATION]
    length = model.length[0]
    spoiled = farthest
    position = state.position
    start = model.start
    for i in range(1, end_of(model, state.position)):
        dx = position[i, 0] - start[i, 0]
        dy = position[i, 1] - start[i, 1]
        farthest = larger(farthest, dx * dx + dy * dy)
        rotation = larger(rotation, abs(position[i, 2] - start[i, 2]))
        fastest = larger(fastest, speed_of(i, state.velocity, length))
        spoiled += 0.0 * (dx + dy + position[i, 2])
    peak = state.peak
    peak[Peak.ROTATION] = select(where, rotation, peak[Peak.ROTATION])
    far = larger(peak[Peak.DISPLACEMENT], math.sqrt(farthest))
    peak[Peak.DISPLACEMENT] = select(where, far, peak[Peak.DISPLACEMENT])
    kinetic = kinetic_energy(model, state.velocity)
    had = state.energy[Energy.LARGEST_KINETIC]
    most = select(where, larger(had, kinetic), had)
    state.energy[Energy.LARGEST_KINETIC] = most
    state.clock[Clock.FASTEST] = select(where, fastest, state.clock[Clock.FASTEST])
    record_calm(model, state, kinetic, where)
    return where & (spoiled != 0.0)


@kernel
def record_overlap(model, state, work, where):
    """Record the deepest overlap of two neighbours at a corner, over the joint's length.

    Reads: model.length, state (peak, slip), work (face, tangent).
    Writes: state.peak.
    """
    deepest = state.peak[Peak.OVERLAP]
    for j in range(state.slip.size):
        for k in range(2):
            depth = -placing.clearance(j, k, work) * (1.0 / model.length[j])
            deepest = select(where & (depth > deepest), depth, deepest)
    state.peak[Peak.OVERLAP] = deepest


@inlined
def take_step(runs, impulse, where):
    """Take solved velocities and the positions that they reach; record the work of the ground.

    ``work.reaction`` changes from impulses into the mean forces over the step.
    """
    state = runs.state
    work = runs.work
    step = state.clock[Clock.STEP]
    given = 0.0
    for i in range(1, state.position.shape[0]):
        for c in range(3):
            moved = work.position[i, c] + 0.5 * step * work.solved[i, c]
            state.position[i, c] = select(where, moved, state.position[i, c])
        x, y = _mean_velocity(i, state, work)
        given -= runs.model.mass[i] * (impulse.x * x + impulse.y * y)
        for c in range(3):
            state.velocity[i, c] = select(
                where, work.solved[i, c], state.velocity[i, c]
            )
    state.energy[Energy.GROUND] += select(where, given, 0.0)
    for j in range(state.slip.size):
        state.slip[j] = select(where, work.slip[j], state.slip[j])
        for c in range(3):
            work.reaction[j, c] = work.reaction[j, c] / step


@kernel
def make_step(runs, impulse, where):
    """Take a solved step of rigid joints; return where the chain has collapsed."""
    model = runs.model
    state = runs.state
    work = runs.work
    step = state.clock[Clock.STEP]
    take_step(runs, impulse, where)
    changes = False
    hit = 0.0 * step
    for j in range(state.slip.size):
        hit = larger(hit, state.impact[j])
    for j in range(state.slip.size):
        state.impact[j] = select(
            where, larger(state.impact[j] - 1.0, 0.0), state.impact[j]
        )
        for k in range(2):
            changes = changes | (work.contact[j, k] != state.contact[j, k])
        for c in range(3):
            steady = select(hit > 0.0, 0.0, work.reaction[j, c])
            state.force[j, c] = select(where, steady, state.force[j, c])
    placing.move_faces(model, state.position, work)
    yielded, unexplained = accept_pulls(model, state, work, step, where)
    if model.tie.shape[0] > 0:
        record_pulls(state, yielded, unexplained, where)
    collapsed = follow_joints(model, state, work, where, runs.options.loss_limit)
    eighth = (state.count[Count.STEPS] + 1.0) * (1.0 / OVERLAP_INTERVAL)
    # Faces that have turned past a right angle or left each other have no overlap that counts.
    looks = where & opposite(collapsed) & (changes | (eighth == nearest(eighth)))
    if some(looks):
        record_overlap(model, state, work, looks)
    return collapsed


@kernel
def add_carried(state, work, span):
    """Add the impulses of `carry_on` to those of the step; with ``-span`` take them away again.

    Reads: state (force, slip).
    Writes: work.reaction.
    """
    for j in range(state.slip.size):
        for c in range(3):
            work.reaction[j, c] += span * state.force[j, c]


@kernel
def accept_contacts(runs, impulse, where):
    """Take a step whose contact problem is solved; return where the chain has collapsed.

    What acted before an impact in its middle works, too.
    """
    state = runs.state
    work = runs.work
    count_changes(runs.model, state, work, where)
    span = time_before(state, state.clock[Clock.STEP])
    if some(span > 0.0):  # what acted before the impact works too
        add_carried(state, work, span)
    record_step(state, work, where)
    record_base_work(runs, where)
    if some(span > 0.0):
        add_carried(state, work, -span)
    return make_step(runs, impulse, where)


@inlined
def pass_time(state, where):
    """Let the time of a step pass, and count it."""
    clock = state.clock
    step = clock[Clock.STEP]
    clock[Clock.TIME] = select(where, clock[Clock.TIME] + step, clock[Clock.TIME])
    clock[Clock.MOVING] += select(where, step, 0.0)
    state.count[Count.STEPS] += flag(where)


@kernel
def accept_step(runs, impulse, where):
    """Accept a solved step; return where the chain has collapsed, and where it is broken.

    It is broken where positions are not finite. ``work.reaction`` changes from impulses into the
    mean forces over the step.
    """
    collapsed = runs.law.accept(runs, impulse, where)
    broken = record_motion(runs.model, runs.state, where)
    pass_time(runs.state, where)
    return collapsed, broken
