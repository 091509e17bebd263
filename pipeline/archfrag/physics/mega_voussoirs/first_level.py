"""First level: accelerations of mega-voussoirs and the reactions between them (section 3.3).

For three of them on four hinges they follow in closed form from the rotation centre of the middle
one (Eqs 29-33); for any other mechanism from its joints' laws as equations (Eq 26).

The paper takes the full reaction at the hinges C12 and C23 to point at the rotation centre C2.
That holds for the part in the plane orthogonal to the middle body's motion (Eqs 30-33). The part
along the velocity of the hinge, through which the outer bodies take or give power, follows from
their balance of moments about C1 and C3; without it the outer bodies would move without weight
and inertia.
"""

import math

from archfrag.physics.contact import blocks, placing
from archfrag.physics.contact.laws import (
    cross,
    normal_of,
    slip_normal,
    touching,
)
from archfrag.physics.contact.ties import pull_mega_voussoirs
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.numbers import copy_rows

# Lines to the rotation centre closer to parallel than this leave too little accuracy (sine).
PARALLEL = 1e-3
# Where more than this part of gravity is left of the equations they are near singular.
ILL_CONDITIONED = 1e-7


@inlined
def _from(a, b):
    return b[0] - a[0], b[1] - a[1]


@inlined
def _arm(centre, position, k):
    return position[k, 0] - centre[0], position[k, 1] - centre[1]


@kernel
def centripetal_bias(model, position, velocity, slips, sense, work):
    """Set ``work.bias``: what rotations add to relative accelerations (Eqs 17, 18).

    These are the centripetal accelerations of the material points and, where a vertex runs along a
    rotating face, twice the product of both rates. `sense` is the sense of friction of slips in
    progress, zero where there is none.

    Writes: work.bias.
    """
    for j in range(work.slide.shape[0]):
        before = velocity[j, 2]
        after = velocity[j + 1, 2]
        for k in range(2):
            px = work.point[j, k, 0]
            py = work.point[j, k, 1]
            ax = px - position[j + 1, 0]
            ay = py - position[j + 1, 1]
            bx = px - position[j, 0]
            by = py - position[j, 1]
            x = before * before * bx - after * after * ax
            y = before * before * by - after * after * ay
            if sense[j] != 0.0:
                nx, ny = slip_normal(j, k, sense[j] < 0.0, work)
                at_0, at_1 = touching(j, work)
                if at_0 and at_1:
                    nx, ny = normal_of(j, work)
                slip = placing.corner_rate_at(j, px, py, model, position, velocity)
                place = slips[j] if slips[j] != 0.0 else -sense[j]
                face = before if placing.later_vertex_meets(k, place) else after
                twice = 2.0 * face * cross((nx, ny), slip)
                x = x + twice * nx
                y = y + twice * ny
            work.bias[j, k, 0] = x
            work.bias[j, k, 1] = y


@kernel
def is_four_hinges(work, n_row):
    """Return whether the joints are four hinges of three mega-voussoirs, none of which slides.

    Reads: work (contact, slide).
    """
    if n_row != 5 or work.slide.shape[0] != 4:
        return False
    for j in range(4):
        if work.contact[j, 0] + work.contact[j, 1] != 1.0 or work.slide[j] != 0.0:
            return False
    return True


@inlined
def _hinge(j, work):
    k = 0 if work.contact[j, 0] > 0.5 else 1
    return work.point[j, k, 0], work.point[j, k, 1]


@inlined
def _perpendicular(rate, arm):
    """Return the velocity at the end of an arm that rotates at `rate`."""
    return -rate * arm[1], rate * arm[0]


@inlined
def _known(base, rate, acceleration, arm, k, work):
    """Set the acceleration of body `k` that does not depend on the one unknown.

    `base` is the acceleration of a point of the body, and `arm` leads from there to the centroid.
    `rate` and `acceleration` are those of the rotation.
    """
    x, y = _perpendicular(acceleration, arm)
    work.solved[k, 0] = base[0] + x - rate * rate * arm[0]
    work.solved[k, 1] = base[1] + y - rate * rate * arm[1]
    work.solved[k, 2] = acceleration


@inlined
def _powers(model, work, k, u, x, y):
    """Return the inertia of body `k` along the mechanism, and the power of its unbalanced force.

    This is Eq 28. The body moves at (x, y) and rotates at `u` if the mechanism moves at one.
    """
    inertia = model.mass[k] * (x * x + y * y) + model.inertia[k] * u * u
    fx = work.free[k, 0] - work.solved[k, 0]
    fy = work.free[k, 1] - work.solved[k, 1]
    spin = model.inertia[k] * u * (work.free[k, 2] - work.solved[k, 2])
    return inertia, model.mass[k] * (x * fx + y * fy) + spin


@kernel
def four_hinges(model, position, velocity, work):
    """Solve for accelerations and reactions of three bodies with four hinges.

    `work` has contacts, modes, and the accelerations without reactions in `free`. Return False if
    the rotation centre of the middle body is so far off that the reactions do not follow from it.

    Writes: work (reaction, solved).
    """
    c1 = _hinge(0, work)
    c12 = _hinge(1, work)
    c23 = _hinge(2, work)
    c3 = _hinge(3, work)
    p = _from(c1, c12)
    q = _from(c3, c23)
    d = _from(c12, c23)
    area = cross(p, q)
    if abs(area) < PARALLEL * math.hypot(p[0], p[1]) * math.hypot(q[0], q[1]):
        return False
    # The rotation centre C2, where the lines C1 C12 and C3 C23 meet (Fig 10), and the rates of
    # the bodies about C1, C2 and C3 for which the hinges stay closed.
    c13 = _from(c1, c3)
    along_p = cross(c13, q) / area
    along_q = cross(c13, p) / area
    centres = c1, (c1[0] + along_p * p[0], c1[1] + along_p * p[1]), c3
    rates = 1.0 - along_p, 1.0, 1.0 - along_q
    # Centripetal terms (Eqs 17, 18), with no angular acceleration of the middle body.
    w1 = velocity[1, 2]
    w2 = velocity[2, 2]
    w3 = velocity[3, 2]
    ex = w1 * w1 * p[0] + w2 * w2 * d[0] - w3 * w3 * q[0]
    ey = w1 * w1 * p[1] + w2 * w2 * d[1] - w3 * w3 * q[1]
    a1 = (ex * q[0] + ey * q[1]) / area
    a3 = (ex * p[0] + ey * p[1]) / area
    x, y = _perpendicular(a1, p)
    still = 0.0, 0.0
    ahead = x - w1 * w1 * p[0], y - w1 * w1 * p[1]
    _known(still, w1, a1, _arm(c1, position, 1), 1, work)
    _known(ahead, w2, 0.0, _arm(c12, position, 2), 2, work)
    _known(still, w3, a3, _arm(c3, position, 3), 3, work)
    # Balance along the mechanism (Eq 28 with inertia) gives the one unknown acceleration.
    inertia = power = 0.0
    for k in range(1, 4):
        x, y = _perpendicular(rates[k - 1], _arm(centres[k - 1], position, k))
        m, f = _powers(model, work, k, rates[k - 1], x, y)
        inertia += m
        power += f
    rate = power / inertia
    for k in range(1, 4):
        x, y = _perpendicular(rates[k - 1], _arm(centres[k - 1], position, k))
        work.solved[k, 0] += rate * x
        work.solved[k, 1] += rate * y
        work.solved[k, 2] += rate * rates[k - 1]
    _hinge_reactions(model, position, (c1, c12, c23, c3), work)
    return True


@inlined
def _unbalanced(model, work, k):
    """Return the force (x, y) that the reactions on body `k` must supply, and its moment.

    The moment is that about the centroid.
    """
    x = model.mass[k] * (work.solved[k, 0] - work.free[k, 0])
    y = model.mass[k] * (work.solved[k, 1] - work.free[k, 1])
    return (x, y), model.inertia[k] * (work.solved[k, 2] - work.free[k, 2])


@inlined
def _set_reaction(j, hinge, x, y, work):
    work.reaction[j, 0] = x
    work.reaction[j, 1] = y
    arm = hinge[0] - work.pivot[j, 0], hinge[1] - work.pivot[j, 1]
    work.reaction[j, 2] = cross(arm, (x, y))


@inlined
def _hinge_reactions(model, position, hinge, work):
    """Set the reactions at four hinges for given accelerations (Eqs 29-33)."""
    c1, c12, c23, c3 = hinge
    p = _from(c1, c12)
    q = _from(c3, c23)
    size_p = math.hypot(p[0], p[1])
    size_q = math.hypot(q[0], q[1])
    p = (p[0] / size_p, p[1] / size_p)
    q = (q[0] / size_q, q[1] / size_q)
    f1, m1 = _unbalanced(model, work, 1)
    f2, _ = _unbalanced(model, work, 2)
    f3, m3 = _unbalanced(model, work, 3)
    # Moments of the outer bodies about C1 and C3: the parts across p and q.
    t12 = -(m1 + cross(_arm(c1, position, 1), f1)) / size_p
    t32 = -(m3 + cross(_arm(c3, position, 3), f3)) / size_q
    # What is left for the parts along p and q, which meet at C2 (Eq 33).
    left = f2[0] + t12 * p[1] + t32 * q[1], f2[1] - t12 * p[0] - t32 * q[0]
    sine = cross(p, q)
    r12 = cross(left, q) / sine
    r32 = cross(p, left) / sine
    x12 = r12 * p[0] - t12 * p[1]
    y12 = r12 * p[1] + t12 * p[0]
    x32 = r32 * q[0] - t32 * q[1]
    y32 = r32 * q[1] + t32 * q[0]
    _set_reaction(0, c1, f1[0] + x12, f1[1] + y12, work)
    _set_reaction(1, c12, x12, y12, work)
    _set_reaction(2, c23, -x32, -y32, work)
    _set_reaction(3, c3, -(f3[0] + x32), -(f3[1] + y32), work)


@kernel
def pose(mega, position):
    """Place faces, slips and contacts of mega-voussoirs at `position`."""
    work = mega.work
    placing.place_chain(mega.model, position, work, 0.0, work.slip, work)


@inlined
def set_free(model, ground, free):
    """Set `free` to the accelerations without reactions; the last row is the far springing's.

    `ground` is the ground acceleration as `ground_after` returns it.
    """
    for i in range(1, free.shape[0] - 1):
        free[i, 0] = -ground[0]
        free[i, 1] = -model.gravity - ground[1]
        free[i, 2] = 0.0
    free[-1, 0] = ground[2]
    free[-1, 1] = ground[3]


@kernel
def solve_first_level(mega, position, velocity, ground, scale):
    """Solve for accelerations and reactions of mega-voussoirs under a ground acceleration.

    `ground` is that of `archfrag.physics.ground.ground_after`. Accelerations and reactions are
    left in ``work.solved`` and ``work.reaction``; accelerations of `scale` [m/s2] count as one.
    Return False if the equations have no solution.
    """
    model = mega.model
    work = mega.work
    pose(mega, position)
    set_free(model, ground, work.free)
    pull_mega_voussoirs(mega, position, velocity)
    moves = ground[2] != 0.0 or ground[3] != 0.0
    moves = moves or velocity[-1, 0] != 0.0 or velocity[-1, 1] != 0.0
    four = not moves and is_four_hinges(work, position.shape[0])
    if four and four_hinges(model, position, velocity, work):
        return True
    centripetal_bias(model, position, velocity, work.slip, work.slide, work)
    left = blocks.solve_modes(model, position, work, scale, blocks.EXACT, 0)
    return left <= ILL_CONDITIONED * model.gravity


@kernel
def project(mega, position, velocity, enough, limit):
    """Project positions and velocities onto the contacts, after `pose` at `position`.

    Both are projected in the metric of kinetic energy, in the directions that the joints
    constrain: along friction cones a projection could gain energy. `enough` has a distance [m] and
    a rate [m/s]; up to these nothing is done. If a body would move farther than `limit` [m], with
    rotations times the length of the first joint, nothing is changed and False is returned.
    """
    model = mega.model
    work = mega.work
    apart = 0.0
    blocks.set_rows(model, position, work)
    work.bias[:] = 0.0
    work.free[:] = 0.0
    copy_rows(velocity, work.solved, 0, position.shape[0])
    rate = blocks.measure_residual(model, position, work)
    for j in range(work.slide.shape[0]):
        for k in range(2):
            ex, ey = placing.corner_offset(j, k, work, work.slip[j])
            work.bias[j, k, 0] = ex
            work.bias[j, k, 1] = ey
            apart = max(apart, work.contact[j, k] * (abs(ex) + abs(ey)))
        for a in range(3):
            for d in range(4):
                work.column[j, a, d] = work.row[j, a, d]
    if apart <= enough[0] and rate <= enough[1]:
        return True
    blocks.factorise(model, work, blocks.EXACT.compliance)
    blocks.correct(model, position, work, math.inf)
    farthest = 0.0
    for i in range(1, position.shape[0] - 1):
        shift = abs(work.solved[i, 0]) + abs(work.solved[i, 1])
        farthest = max(farthest, shift, model.length[0] * abs(work.solved[i, 2]))
    if not farthest <= limit:
        return False
    for i in range(position.shape[0]):
        for c in range(3):
            position[i, c] += work.solved[i, c]
    copy_rows(velocity, work.free, 0, position.shape[0])
    work.bias[:] = 0.0
    blocks.correct(model, position, work, math.inf)
    copy_rows(work.solved, velocity, 0, position.shape[0])
    return True
