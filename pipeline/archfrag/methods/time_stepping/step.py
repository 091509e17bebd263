"""One step of Moreau-Jean time stepping, of one run or of four: pose, solve, accept.

Forces and contact directions are taken at the middle of the step, where Moreau's scheme looks
for contacts (Moreau 1988, 1999; Jean 1999), and Signorini's law is imposed on the position that
the step reaches, as Paoli and Schatzman do (2002, *SIAM J. Numer. Anal.* 40(2)): with no
restitution a contact neither drifts nor penetrates. Between impacts this is the Stoermer-Verlet
method with constraints, of second order and without numerical damping; an impact is caught
within its step.
"""

import math

from archfrag.mechanics.collapse import NOTED_GAP, RIGHT_ANGLE, SMALL, Loss
from archfrag.mechanics.compile import inlined, kernel
from archfrag.mechanics.contact.placing import (
    MINUS,
    PLUS,
    at_point,
    clearance,
    corner_offset,
    corner_slip,
    move_faces,
    place_contacts,
    relative_velocity,
)
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
    """Bias that makes the contact laws hold at the positions which a step reaches.

    Parameters
    ----------
    model : archfrag.mechanics.model.Model
    state : archfrag.mechanics.model.State
    work : archfrag.mechanics.model.Work
        With the contacts placed, and `next_face` where the present velocities lead; `bias` and
        `candidate` are overwritten, and the normals of joints that both corners may close in
        this step by themselves.
    step : number [s]
    """
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
    """Set up the contact problem of a step from a state; modes start from the state's.

    Parameters
    ----------
    model : archfrag.mechanics.model.Model
    state : archfrag.mechanics.model.State
    work : archfrag.mechanics.model.Work
        With the faces where the bodies are.
    kick : Kick
    step : number [s]
    """
    free_fall(model, state, work, kick)
    for i in range(1, state.position.shape[0] - 1):
        for c in range(3):
            work.position[i, c] = state.position[i, c] + step * state.velocity[i, c]
    place_contacts(model, state.slip, work.face, work.tangent, work)
    move_faces(model, work.position, work.turned, work.next_face, work.next_tangent)
    aim_contacts(model, state, work, step)
    for j in range(state.slip.shape[0]):
        work.touch[j, 0], work.touch[j, 1] = state.touch[j, 0], state.touch[j, 1]
        work.slide[j] = state.slide[j]


@inlined
def _mode_normal(j, work):
    """Normal and contact point, from the pivot, of a joint in its present mode."""
    at_0, at_1 = work.touch[j, 0] > 0.5, work.touch[j, 1] > 0.5
    second, back, side = at_1 & opposite(at_0), work.slide[j] < 0.0, work.side_normal
    nx = select(back, side[j, 0, MINUS, 0], side[j, 0, PLUS, 0])
    ny = select(back, side[j, 0, MINUS, 1], side[j, 0, PLUS, 1])
    nx = select(second, select(back, side[j, 1, MINUS, 0], side[j, 1, PLUS, 0]), nx)
    ny = select(second, select(back, side[j, 1, MINUS, 1], side[j, 1, PLUS, 1]), ny)
    nx = select(at_0 & at_1, work.normal[j, 0], nx)
    ny = select(at_0 & at_1, work.normal[j, 1], ny)
    px = select(second, work.point[j, 1, 0], work.point[j, 0, 0]) - work.pivot[j, 0]
    py = select(second, work.point[j, 1, 1], work.point[j, 0, 1]) - work.pivot[j, 1]
    return nx, ny, px, py


@inlined
def contact_works(state, work, part):
    """Work done at the joints over a step, by the law that explains it.

    Parameters
    ----------
    state : archfrag.mechanics.model.State
    work : archfrag.mechanics.model.Work
        With relative velocities before the step in `earlier`, after it in `relative`.
    part : number
        Of the kick that acts up to the instant of the positions.

    Returns
    -------
    friction, impact, stray : number
        Stray is what neither law explains: the energy balance error [J].
    before : number
        What of it has been done up to the instant of the positions [J].
    hits : mask
        Where an impact is going on.
    """
    friction = impact = stray = before = 0.0
    hits = False
    for j in range(state.slip.shape[0]):
        fx, fy, moment = work.reaction[j, 0], work.reaction[j, 1], work.reaction[j, 2]
        ux, uy, u = work.earlier[j, 0], work.earlier[j, 1], work.earlier[j, 2]
        vx, vy, v = work.relative[j, 0], work.relative[j, 1], work.relative[j, 2]
        start, finish = fx * ux + fy * uy + moment * u, fx * vx + fy * vy + moment * v
        fresh = state.impact[j] > 0.0
        hits = hits | fresh
        impact += select(fresh, 0.5 * (start + finish), 0.0)
        slides = opposite(fresh) & ((work.slide[j] != 0.0) | (state.slide[j] != 0.0))
        if some(slides):
            nx, ny, px, py = _mode_normal(j, work)
            tangential = fy * nx - fx * ny
            ax, ay = at_point(ux, uy, u, px, py)
            bx, by = at_point(vx, vy, v, px, py)
            a = select(slides, tangential * (ay * nx - ax * ny), 0.0)
            b = select(slides, tangential * (by * nx - bx * ny), 0.0)
            friction += 0.5 * (a + b)
            start, finish = start - a, finish - b
        stray += select(fresh, 0.0, 0.5 * (start + finish))
        before += select(fresh, 0.0, part * (start + 0.5 * part * (finish - start)))
    return friction, impact, stray, before, hits


@inlined
def record_work(friction, impact, stray, at_instant, where, energy):
    """Works of all joints over one step [J].

    An impact at one joint and the friction that it causes at others belong together: only what
    both give in sum is the integrator's error. `at_instant` is the error within the step, where
    velocities and positions belong to one instant.
    """
    most = larger(energy[Energy.STRAY_PEAK], abs(energy[Energy.STRAY] + at_instant))
    energy[Energy.STRAY_PEAK] = select(where, most, energy[Energy.STRAY_PEAK])
    makes = friction + impact > 0.0
    energy[Energy.FRICTION] += select(where & opposite(makes), friction, 0.0)
    energy[Energy.IMPACT] += select(where & opposite(makes), impact, 0.0)
    stray += select(makes, friction + impact, 0.0)
    energy[Energy.STRAY] += select(where, stray, 0.0)


@inlined
def _lift(model, state, work):
    """Mass times the change of vertical velocity in a step, of all bodies [N s]."""
    total = 0.0
    for i in range(1, state.position.shape[0] - 1):
        total += model.mass[i] * (work.solved[i, 1] - state.velocity[i, 1])
    return total


@inlined
def change_of_step(model, state, work, step, previous):
    """Work that weight and height, weighed apart, leave where the step changes [J].

    To be asked before the solved velocities are taken over.
    """
    return 0.25 * model.gravity * (step - previous) * _lift(model, state, work)


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
def _record_energy(model, state, work, step, previous, where):
    """Works of a solved step, before its velocities are taken over."""
    relative_velocity(state.position, state.velocity, work.pivot, work.earlier)
    part = previous / (previous + step)
    friction, impact, stray, before, hits = contact_works(state, work, part)
    lift = 0.25 * model.gravity * _lift(model, state, work)
    stray += (step - previous) * lift
    before = select(hits, -state.energy[Energy.STRAY], before - part * previous * lift)
    record_work(friction, impact, stray, before, where, state.energy)


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
def _note_loss(j, model, state, lost, rotation, time):
    """Remember the state in which joint j loses its contact."""
    state.lost_since[j] = select(lost, time, state.lost_since[j])
    by_slip = abs(state.slip[j]) * (1.0 / model.length[j])
    state.lost_slip[j] = select(lost, by_slip, state.lost_slip[j])
    state.lost_rotation[j] = select(lost, abs(rotation), state.lost_rotation[j])


@inlined
def loss_mode(j, state):
    """How joint j moved when it lost its contact: archfrag.mechanics.status.CollapseMode."""
    slip, rotation = state.lost_slip[j], state.lost_rotation[j]
    little = (larger(slip, rotation) < SMALL) & (state.bore_face[j] > 0.5)
    return select(little, LIFT_OFF, select(slip > rotation, SLIDING, HINGING))


@inlined
def note_gap(j, state, gap, where):
    """Remember a gap, over the joint's length, at both corners of joint j."""
    loss = state.loss
    loss[Loss.WIDEST] = select(where & (gap > loss[Loss.WIDEST]), gap, loss[Loss.WIDEST])
    first = where & (gap > NOTED_GAP) & (loss[Loss.TIME] != loss[Loss.TIME])
    if some(first):
        loss[Loss.TIME] = select(first, state.lost_since[j], loss[Loss.TIME])
        loss[Loss.JOINT] = select(first, float(j), loss[Loss.JOINT])
        loss[Loss.MODE] = select(first, loss_mode(j, state), loss[Loss.MODE])


@kernel
def follow_joints(model, state, work, where, loss_limit):
    """Bring modes, slips and what joints remember up to the positions that a step has reached.

    Parameters
    ----------
    model : archfrag.mechanics.model.Model
    state : archfrag.mechanics.model.State
    work : archfrag.mechanics.model.Work
        With the solution of the step, and the faces where it has led.
    where : mask
        Runs that have made the step.
    loss_limit : float
        Gap of a joint without contact, over its length, beyond which its loss is final [1].

    Returns
    -------
    mask
        Where a joint cannot come to bear again: the chain has collapsed.
    """
    time = state.clock[Clock.TIME]
    fallen = False
    for j in range(state.slip.shape[0]):
        is_0, is_1 = work.touch[j, 0] > 0.5, work.touch[j, 1] > 0.5
        none = where & opposite(is_0 | is_1)
        slides = where & (work.slide[j] != 0.0)
        rotation = state.position[j + 1, 2] - state.position[j, 2]
        if some(none | slides):
            unit = 1.0 / model.length[j]
            had = (state.touch[j, 0] > 0.5) | (state.touch[j, 1] > 0.5)
            _note_loss(j, model, state, none & had, rotation, time)
            gap_0 = clearance(j, 0, work.face, work.tangent)
            gap_1 = clearance(j, 1, work.face, work.tangent)
            first = select(none, flag(gap_1 >= gap_0), flag(is_0)) > 0.5
            dx = select(first, _shift(work, j, 0, 0), _shift(work, j, 1, 0))
            dy = select(first, _shift(work, j, 0, 1), _shift(work, j, 1, 1))
            slip = corner_slip(j, dx, dy, first, work.tangent)
            state.slip[j] = select(none | slides, slip, state.slip[j])
            gap = smaller(gap_0, gap_1) * unit
            note_gap(j, state, gap, none)
            fallen = fallen | (none & (gap > loss_limit))
        fallen = fallen | (where & (abs(state.slip[j]) >= model.length[j]))
        fallen = fallen | (where & (abs(rotation) >= RIGHT_ANGLE))
        bears = where & (is_0 | is_1)
        state.bore_face[j] = select(bears, flag(is_0 & is_1), state.bore_face[j])
        state.touch[j, 0] = select(where, work.touch[j, 0], state.touch[j, 0])
        state.touch[j, 1] = select(where, work.touch[j, 1], state.touch[j, 1])
        state.slide[j] = select(where, work.slide[j], state.slide[j])
    return fallen


@inlined
def _shift(work, j, k, c):
    return work.face[j, 1, k, c] - work.face[j, 0, k, c]


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
    take_velocities(model, state, work, kick, where)
    for i in range(1, state.position.shape[0] - 1):
        for c in range(3):
            moved = state.position[i, c] + step * state.velocity[i, c]
            state.position[i, c] = select(where, moved, state.position[i, c])
    for j in range(state.slip.shape[0]):
        state.impact[j] = select(where, larger(state.impact[j] - 1.0, 0.0), state.impact[j])
    move_faces(model, state.position, work.turned, work.face, work.tangent)
    fallen = follow_joints(model, state, work, where, loss_limit)
    broken = record_motion(model, state, where)
    clock[Clock.TIME] = select(where, clock[Clock.TIME] + step, clock[Clock.TIME])
    clock[Clock.MOVING] += select(where, step, 0.0)
    clock[Clock.PREVIOUS] = select(where, step, previous)
    clock[Clock.SPAN] = select(where, kick.span, clock[Clock.SPAN])
    count[Count.STEPS] += flag(where)
    eighth = count[Count.STEPS] * (1.0 / OVERLAP_INTERVAL)
    looks = where & (eighth == nearest(eighth))
    if some(looks):
        record_overlap(model, state, work, looks)
    return fallen, broken


@kernel
def accept_step(model, state, work, kick, where, loss_limit):
    """Make a step whose contact problem is solved, and record what it did.

    Parameters
    ----------
    model : archfrag.mechanics.model.Model
    state : archfrag.mechanics.model.State
    work : archfrag.mechanics.model.Work
    kick : Kick
    where : mask
        Runs that make it.
    loss_limit : float
        See `follow_joints`.

    Returns
    -------
    fallen, broken : mask
        Where the chain has collapsed, and where its state is not finite.
    """
    clock = state.clock
    count_changes(state, work, where)
    _record_energy(model, state, work, clock[Clock.STEP], clock[Clock.PREVIOUS], where)
    return make_step(model, state, work, kick, where, loss_limit)
