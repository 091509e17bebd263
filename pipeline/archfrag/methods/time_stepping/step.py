"""One step of Moreau-Jean time stepping, of one run or of four: pose, solve, accept.

Forces and contact directions are taken at the middle of the step, where Moreau's scheme looks
for contacts (Moreau 1988, 1999; Jean 1999), and Signorini's law is imposed on the position that
the step reaches, as Paoli and Schatzman do (2002, *SIAM J. Numer. Anal.* 40(2)): with no
restitution a contact neither drifts nor penetrates. Between impacts this is the Stoermer-Verlet
method with constraints, of second order and without numerical damping; an impact is caught
within its step.
"""

import math

from archfrag.mechanics.collapse import follow_joints
from archfrag.mechanics.compile import inlined, kernel
from archfrag.mechanics.contact.placing import (
    at_point,
    clearance,
    corner_offset,
    move_faces,
    place_contacts,
    relative_velocity,
)
from archfrag.mechanics.energy import record_step
from archfrag.mechanics.model import Clock
from archfrag.mechanics.numbers import flag, larger, nearest, opposite, select, smaller, some
from archfrag.mechanics.status import CollapseMode, Count, Energy, Peak

# A corner takes part in a step if its gap could close within it at this many times the largest
# relative velocity of any joint: an impact elsewhere may throw it shut. Both corners of a joint
# get one normal if both could close at this many times their own.
REACH = 5.0
# Overlap is corrected no faster than at the joint's own relative speed plus what gravity and
# this many times rotation do in a step: a deep one would throw the bodies apart.
SWING = 4.0
# Steps for which work at a new contact counts as that of an impact.
IMPACT_STEPS = 2.0
# So many steps after an impact the next one is apart from it.
QUIET = 2.0
# Steps between looks for overlaps.
OVERLAP_INTERVAL = 8.0
HINGING, SLIDING = float(CollapseMode.HINGING), float(CollapseMode.SLIDING)
LIFT_OFF = float(CollapseMode.LIFT_OFF)


@inlined
def _limited_bias(bx, by, nx, ny, limit):
    """Bias that corrects overlap, and slip, no faster than at a limit [m/s]."""
    inward = larger(-limit - (nx * bx + ny * by), 0.0)
    bx, by = bx + inward * nx, by + inward * ny
    along = nx * by - ny * bx
    excess = along - smaller(larger(along, -limit), limit)
    return bx + excess * ny, by - excess * nx


@inlined
def _own_speed(j, k, work):
    """Relative velocity of the two faces at a corner before the step."""
    px, py = work.point[j, k, 0] - work.pivot[j, 0], work.point[j, k, 1] - work.pivot[j, 1]
    return at_point(work.relative[j, 0], work.relative[j, 1], work.relative[j, 2], px, py)


@kernel
def aim_contacts(model, state, work, step):
    """Bias that makes the contact laws hold at the positions which a step reaches."""
    velocity, gravity = state.velocity, model.gravity
    relative_velocity(state.position, velocity, work.pivot, work.relative)
    fastest = 0.0
    for j in range(state.slip.shape[0]):
        for k in range(2):
            ux, uy = _own_speed(j, k, work)
            fastest = larger(fastest, abs(ux) + abs(uy))
    rate = 1.0 / step
    reach = REACH * step * (fastest + gravity * step)
    for j in range(state.slip.shape[0]):
        nx, ny = work.normal[j, 0], work.normal[j, 1]
        spin = larger(abs(velocity[j, 2]), abs(velocity[j + 1, 2]))
        slow = step * (gravity + SWING * model.length[j] * (spin * spin))
        closing = True
        for k in range(2):
            ex, ey = corner_offset(j, k, work.next_face, work.next_tangent, state.slip[j])
            tiny = abs(ex) + abs(ey) < model.rounding
            ex, ey = select(tiny, 0.0, ex), select(tiny, 0.0, ey)
            ux, uy = _own_speed(j, k, work)
            own = abs(ux) + abs(uy)
            bx, by = _limited_bias(ex * rate - ux, ey * rate - uy, nx, ny, slow + own)
            work.bias[j, k, 0], work.bias[j, k, 1] = bx, by
            gap = nx * ex + ny * ey
            work.candidate[j, k] = flag(gap < reach)
            closing = closing & (gap < REACH * step * (own + gravity * step))
        for k in range(2):
            for sense in range(2):
                x, y = work.side_normal[j, k, sense, 0], work.side_normal[j, k, sense, 1]
                work.side_normal[j, k, sense, 0] = select(closing, nx, x)
                work.side_normal[j, k, sense, 1] = select(closing, ny, y)


@inlined
def free_fall(model, state, work, kick):
    """Velocities without reactions, into ``work.free``."""
    fall = kick.y + kick.span * model.gravity
    for i in range(1, state.position.shape[0] - 1):
        work.free[i, 0] = state.velocity[i, 0] - kick.x
        work.free[i, 1] = state.velocity[i, 1] - fall
        work.free[i, 2] = state.velocity[i, 2]


@kernel
def pose_step(model, state, work, kick, step):
    """Set up the contact problem of a step from a state, but for the modes to start from."""
    free_fall(model, state, work, kick)
    for i in range(1, state.position.shape[0] - 1):
        for c in range(3):
            work.position[i, c] = state.position[i, c] + step * state.velocity[i, c]
    place_contacts(model, state.slip, work.face, work.tangent, work)
    move_faces(model, work.position, work.rotated, work.next_face, work.next_tangent)
    aim_contacts(model, state, work, step)


@inlined
def take_velocities(model, state, work, kick, where):
    """Take the solved velocities over, and record the work of the ground."""
    given = 0.0
    for i in range(1, state.position.shape[0] - 1):
        mean_x = 0.5 * (state.velocity[i, 0] + work.solved[i, 0])
        mean_y = 0.5 * (state.velocity[i, 1] + work.solved[i, 1])
        given -= model.mass[i] * (kick.x * mean_x + kick.y * mean_y)
        for c in range(3):
            state.velocity[i, c] = select(where, work.solved[i, c], state.velocity[i, c])
    state.energy[Energy.GROUND] += select(where, given, 0.0)


@inlined
def count_changes(state, work, where):
    """Count what joints do in a step, and remember new contacts."""
    count = state.count
    for j in range(state.slip.shape[0]):
        was_0, was_1 = state.touch[j, 0] > 0.5, state.touch[j, 1] > 0.5
        is_0, is_1 = work.touch[j, 0] > 0.5, work.touch[j, 1] > 0.5
        differs = (was_0 ^ is_0) | (was_1 ^ is_1) | (state.slide[j] != work.slide[j])
        differs = differs & where
        if some(differs):
            made = differs & ((is_0 & opposite(was_0)) | (is_1 & opposite(was_1)))
            opened = differs & ((was_0 & opposite(is_0)) | (was_1 & opposite(is_1)))
            slides = differs & (work.slide[j] != 0.0) & (state.slide[j] == 0.0)
            count[Count.IMPACTS] += flag(made)
            count[Count.OPENINGS] += flag(opened)
            count[Count.SLIDES] += flag(slides)
            count[Count.LOSSES] += flag(differs & opposite(is_0 | is_1))
            state.impact[j] = select(made, IMPACT_STEPS, state.impact[j])


@inlined
def record_motion(model, state, where):
    """Peaks of displacement, rotation and kinetic energy; where positions are not finite."""
    farthest = fastest = energy = 0.0
    rotation, length = state.peak[Peak.ROTATION], model.length[0]
    spoiled = farthest
    for i in range(1, state.position.shape[0] - 1):
        dx = state.position[i, 0] - model.centroid[i, 0]
        dy = state.position[i, 1] - model.centroid[i, 1]
        ux, uy, w = state.velocity[i, 0], state.velocity[i, 1], state.velocity[i, 2]
        farthest = larger(farthest, dx * dx + dy * dy)
        rotation = larger(rotation, abs(state.position[i, 2]))
        speed = larger(abs(ux) + abs(uy), length * abs(w))
        fastest = larger(fastest, speed)
        energy += model.mass[i] * (ux * ux + uy * uy) + model.inertia[i] * (w * w)
        spoiled += 0.0 * (dx + dy + state.position[i, 2])
    peak = state.peak
    peak[Peak.ROTATION] = select(where, rotation, peak[Peak.ROTATION])
    far = larger(peak[Peak.DISPLACEMENT], math.sqrt(farthest))
    peak[Peak.DISPLACEMENT] = select(where, far, peak[Peak.DISPLACEMENT])
    most = larger(state.energy[Energy.LARGEST_KINETIC], 0.5 * energy)
    state.energy[Energy.LARGEST_KINETIC] = select(
        where, most, state.energy[Energy.LARGEST_KINETIC]
    )
    state.clock[Clock.FASTEST] = select(where, fastest, state.clock[Clock.FASTEST])
    return where & (spoiled != 0.0)


@inlined
def record_overlap(model, state, work, where):
    """Deepest overlap of two neighbours at a corner, over the joint's length."""
    deepest = state.peak[Peak.OVERLAP]
    for j in range(state.slip.shape[0]):
        for k in range(2):
            depth = -clearance(j, k, work.face, work.tangent) * (1.0 / model.length[j])
            deepest = select(where & (depth > deepest), depth, deepest)
    state.peak[Peak.OVERLAP] = deepest


@inlined
def make_step(model, state, work, kick, where, loss_limit):
    """Take solved velocities and the positions that they reach over; as `accept_step`."""
    clock, count = state.clock, state.count
    step, previous = clock[Clock.STEP], clock[Clock.PREVIOUS]
    lift = 0.0
    for i in range(1, state.position.shape[0] - 1):
        lift += model.mass[i] * (work.solved[i, 1] - state.velocity[i, 1])
        for c in range(3):
            later = kick.early * (work.solved[i, c] - state.velocity[i, c])
            moved = state.position[i, c] + step * (work.solved[i, c] - later)
            state.position[i, c] = select(where, moved, state.position[i, c])
    state.energy[Energy.BALANCE_ERROR] -= select(
        where, kick.early * step * model.gravity * lift, 0.0
    )
    take_velocities(model, state, work, kick, where)
    for j in range(state.slip.shape[0]):
        state.impact[j] = select(where, larger(state.impact[j] - 1.0, -QUIET), state.impact[j])
    move_faces(model, state.position, work.rotated, work.face, work.tangent)
    fallen = follow_joints(model, state, work, where, loss_limit)
    broken = record_motion(model, state, where)
    clock[Clock.TIME] = select(where, clock[Clock.TIME] + step, clock[Clock.TIME])
    clock[Clock.MOVING] += select(where, step, 0.0)
    behind = previous + 2.0 * (step - kick.span)
    clock[Clock.PREVIOUS] = select(where, behind, previous)
    clock[Clock.SPAN] = select(where, kick.span, clock[Clock.SPAN])
    count[Count.STEPS] += flag(where)
    eighth = count[Count.STEPS] * (1.0 / OVERLAP_INTERVAL)
    looks = where & (eighth == nearest(eighth))
    if some(looks):
        record_overlap(model, state, work, looks)
    return fallen, broken


@kernel
def accept_step(model, state, work, kick, where, loss_limit):
    """Make a step whose contact problem is solved, and record what it did; fallen, broken."""
    clock = state.clock
    count_changes(state, work, where)
    lag = larger(clock[Clock.PREVIOUS], 0.0)
    ahead = 2.0 * (kick.span - clock[Clock.PREVIOUS]) + lag
    record_step(model, state, work, ahead, lag, where)
    return make_step(model, state, work, kick, where, loss_limit)
