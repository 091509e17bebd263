"""Signorini's and Coulomb's laws of a joint (Eqs 5, 6, 14, 20, 23-25), and its mode as a number.

What a joint bears, and how its corners part, is measured here for all that ask: the iteration on
the modes and the path of solutions (`contact`), the margins of events, the energy balance and the
residual. A joint has two corners, 0 (intrados) and 1 (extrados). Which of them touch, and whether
they stick or slide, is its mode: 0 open; 1 to 3 touching at corner 0, 4 to 6 at corner 1, 7 to 9
at both, each sticking, with friction along the tangent, or with friction against it.
"""

from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import fused, opposite
from archfrag.physics.numbers import choose, larger

OPEN = 0
CLOSED_STICK = 7
# Normals at a sliding corner: for friction along the tangent (Eq 23b), and against it (Eq 23a).
PLUS = 0
MINUS = 1
# Margins of a joint in a mechanism; those that do not concern it are infinite. Normal forces at
# both corners (at a corner that slides the force on it), Coulomb's law for a friction of either
# sense, gaps at both corners, end of a slip. Ties use some of them.
FORCE_0 = 0
FORCE_1 = 1
FRICTION_PLUS = 2
FRICTION_MINUS = 3
GAP_0 = 4
GAP_1 = 5
SLIP_END = 6
N_LAW = 7
SLIP_WEIGHT = 1e2


@inlined
def mode_number(contact_0, contact_1, slide):
    """Return the mode of a joint from its touching corners and the sense of its friction."""
    corners = int(contact_0) + 2 * int(contact_1)
    return 3 * corners - 2 + int(slide) % 3 if corners > 0 else OPEN


@inlined
def mode_of(j, joints):
    """Return the mode of joint j of a state, or of a workspace."""
    return mode_number(joints.contact[j, 0], joints.contact[j, 1], joints.slide[j])


@inlined
def corner_mode(corner, slide):
    """Return the mode of a joint that touches at `corner` only, with friction of sense `slide`."""
    return mode_number(1 - corner, corner, slide)


@inlined
def corners_of(mode):
    """Return whether a joint of mode `mode` touches at corner 0, and at corner 1."""
    corners = (mode + 2) // 3
    return corners & 1, corners >> 1


@inlined
def slide_of(mode):
    """Return the sense of friction: 1 along the tangent, -1 against it, 0 if the joint sticks."""
    sense = (mode + 2) % 3
    return 0.0 if mode == OPEN or sense == 0 else 3.0 - 2.0 * sense


@inlined
def function_of(mode):
    """Return the number of the function in `functions_if_open` that leads to `mode`.

    The mode is one of a joint that touches at one corner.
    """
    return 2 * corners_of(mode)[1] + (0 if slide_of(mode) > 0.0 else 1)


@inlined
def set_mode(work, j, mode):
    """Write a mode into ``work.contact`` and ``work.slide``."""
    work.contact[j, 0], work.contact[j, 1] = corners_of(mode)
    work.slide[j] = slide_of(mode)


@inlined
def touching(j, joints):
    """Return whether joint j of a state or a workspace touches at corner 0, and at corner 1."""
    return joints.contact[j, 0] > 0.5, joints.contact[j, 1] > 0.5


@inlined
def normal_of(j, work):
    """Return the common normal of a joint."""
    return work.normal[j, 0], work.normal[j, 1]


@inlined
def rate_of(j, k, work):
    """Return the relative velocity of a joint at a corner, with its bias [m/s]."""
    return work.corner_rate[j, k, 0], work.corner_rate[j, k, 1]


@inlined
def force_of(j, work):
    """Return the reaction on the body after a joint, without its moment."""
    return work.reaction[j, 0], work.reaction[j, 1]


@inlined
def along(n, v):
    """Return the component of the vector `v` along the normal `n`."""
    return n[0] * v[0] + n[1] * v[1]


@inlined
def cross(n, v):
    """Return the component of the vector `v` along the tangent: `n` rotated by +90 degrees."""
    return n[0] * v[1] - n[1] * v[0]


@inlined
def opening_rate(j, k, velocity, work):
    """Return the opening rate at corner `k` of joint `j`: the larger of those along its normals.

    The normals are those of Eqs 23a and 23b. `velocity` is the relative velocity of the faces at
    the corner, x and y.
    """
    x, y = velocity
    side = work.side_normal
    plus = fused(side[j, k, PLUS, 0], x, side[j, k, PLUS, 1] * y)
    return larger(plus, fused(side[j, k, MINUS, 0], x, side[j, k, MINUS, 1] * y))


@inlined
def side_of(j, k, side, work):
    """Return the contact normal at corner `k` of joint `j` for one sense of friction: x, y.

    A corner has two normals, since the faces of an open joint differ. `side` is PLUS for friction
    along the tangent (Eq 23b), MINUS for friction against it (Eq 23a).
    """
    return work.side_normal[j, k, side, 0], work.side_normal[j, k, side, 1]


@inlined
def slip_normal(j, k, backwards, work):
    """Return the normal at a sliding corner.

    `backwards` is where friction acts against the tangent.
    """
    return choose(backwards, side_of(j, k, MINUS, work), side_of(j, k, PLUS, work))


@inlined
def contact_of(j, work):
    """Return the normal and the contact point of a joint in its present mode: nx, ny, px, py."""
    at_0, at_1 = touching(j, work)
    second = at_1 & opposite(at_0)
    backwards = work.slide[j] < 0.0
    first = slip_normal(j, 0, backwards, work)
    at_corner = choose(second, slip_normal(j, 1, backwards, work), first)
    nx, ny = choose(at_0 & at_1, normal_of(j, work), at_corner)
    point = work.point
    end = point[j, 1, 0], point[j, 1, 1]
    px, py = choose(second, end, (point[j, 0, 0], point[j, 0, 1]))
    return nx, ny, px, py


@inlined
def closed_forces(j, work):
    """Return the normal forces at corners 0 and 1 of a closed joint, their sum, and the shear.

    The resultant acts at the contact centre: e of Eq 14 is the force at corner 1 over the sum.
    """
    axis = normal_of(j, work)
    force = force_of(j, work)
    normal = along(axis, force)
    px = work.point[j, 0, 0] - work.pivot[j, 0]
    py = work.point[j, 0, 1] - work.pivot[j, 1]
    difference = work.reaction[j, 2] / cross((px, py), axis)
    first = 0.5 * (normal + difference)
    return first, 0.5 * (normal - difference), normal, cross(axis, force)


@inlined
def cone_rays(j, model, after, before):
    """Return the edges of Coulomb's cones (Eq 20) about two normals.

    The first is along the tangent about the normal `after`, the second against it about `before`.
    """
    n = model.ray[j, 0]
    t = model.ray[j, 1]
    high = n * after[0] - t * after[1], n * after[1] + t * after[0]
    return high, (n * before[0] + t * before[1], n * before[1] - t * before[0])


@inlined
def cones_at(j, k, model, work):
    """Return the edges of Coulomb's cones at a corner, as `cone_rays`."""
    after = side_of(j, k, PLUS, work)
    return cone_rays(j, model, after, side_of(j, k, MINUS, work))


@kernel
def functions_if_open(j, work, value, target):
    """Write the functions of an open joint, and the modes beyond their zeros.

    They are the opening rates of corner 0 by its two normals, then those of corner 1 (Eqs 5, 23);
    a corner that cannot touch has none.

    Reads: work (candidate, corner_rate, known, side_normal).
    Writes: value, target.
    """
    for k in range(2):
        if work.candidate[j, k] < 0.5:
            continue
        for c in range(2):
            sense = work.known[j]
            if sense == 0.0:
                sense = 1.0 - 2.0 * c
            normal = slip_normal(j, k, sense < 0.0, work)
            value[2 * k + c] = along(normal, rate_of(j, k, work))
            target[2 * k + c] = corner_mode(k, sense)


@kernel
def functions_if_closed(j, model, work, value, target):
    """Write the functions of a closed joint, and the modes beyond their zeros.

    They are the normal forces at both corners; then Coulomb's limits in either sense if the joint
    sticks, or the slip rate if it slides.

    Reads: model.friction, work (corner_rate, known, normal, pivot, point, reaction, slide).
    Writes: value, target.
    """
    slide = work.slide[j]
    value[0], value[1], normal, tangential = closed_forces(j, work)
    target[0] = corner_mode(1, slide)
    target[1] = corner_mode(0, slide)
    if slide == 0.0:
        limit = model.friction[j] * normal
        value[2] = limit - tangential
        target[2] = CLOSED_STICK + 1
        value[3] = limit + tangential
        target[3] = CLOSED_STICK + 2
    elif work.known[j] == 0.0:
        ux = work.corner_rate[j, 0, 0] + work.corner_rate[j, 1, 0]
        uy = work.corner_rate[j, 0, 1] + work.corner_rate[j, 1, 1]
        value[2] = -0.5 * slide * cross(normal_of(j, work), (ux, uy))
        target[2] = CLOSED_STICK


@kernel
def functions_if_corner(j, model, work, value, target):
    """Write the functions of a joint at one corner, and the modes beyond their zeros.

    If it sticks, they are the distances from both edges of the cones; if it slides, the force
    along its ray and the slip rate. Then follows the opening rate of the other corner.

    Writes: value, target.
    """
    k = 0 if work.contact[j, 0] > 0.5 else 1
    slide = work.slide[j]
    force = force_of(j, work)
    high, low = cones_at(j, k, model, work)
    if slide == 0.0:
        sense = 1.0 if cross(low, high) >= 0.0 else -1.0
        value[0] = -sense * cross(high, force)
        target[0] = corner_mode(k, 1)
        value[1] = -sense * cross(force, low)
        target[1] = corner_mode(k, -1)
    else:
        value[0] = along(force, high if slide > 0.0 else low)
        target[0] = OPEN
        if work.known[j] == 0.0:
            normal = slip_normal(j, k, slide < 0.0, work)
            value[1] = -slide * cross(normal, rate_of(j, k, work))
            target[1] = corner_mode(k, 0)
    if work.candidate[j, 1 - k] > 0.5:
        value[2] = along(normal_of(j, work), rate_of(j, 1 - k, work))
        target[2] = mode_number(1, 1, slide)
