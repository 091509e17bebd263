"""Signorini's and Coulomb's laws of a joint (Eqs 5, 6, 14, 20, 23-25), and its mode as a number.

What a joint bears, and how its corners part, is measured here for all that ask: the iteration on
the modes and the path of solutions (`contact`), the margins of events, the energy balance and the
residual. A joint has two corners, 0 (intrados) and 1 (extrados). Which of them touch, and whether
they stick or slide, is its mode: 0 open; 1 to 3 touching at corner 0, 4 to 6 at corner 1, 7 to 9
at both, each sticking, with friction along the tangent, or with friction against it.
"""

from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import fused, opposite, select
from archfrag.physics.numbers import larger

OPEN = 0
CLOSED_STICK = 7
# Faces on whose side a slip is held: of friction along the tangent (Eq 23b), and against it (23a).
PLUS = 0
MINUS = 1


@inlined
def mode_number(contact_0, contact_1, slide):
    """Return the mode of a joint from its touching corners and the sense of its friction."""
    corners = int(contact_0) + 2 * int(contact_1)
    sense = 0 if slide == 0.0 else (1 if slide > 0.0 else 2)
    return 3 * corners - 2 + sense if corners > 0 else OPEN


@inlined
def corner_mode(corner, slide):
    """Return the mode of a joint that touches at one corner only."""
    return mode_number(1 - corner, corner, slide)


@inlined
def corners_of(mode):
    """Return whether a joint of this mode touches at corner 0, and at corner 1."""
    corners = (mode + 2) // 3
    return corners & 1, corners >> 1


@inlined
def slide_of(mode):
    """Return the sense of friction: 1 along the tangent, -1 against it, 0 if the joint sticks."""
    sense = (mode + 2) % 3
    return 0.0 if mode == OPEN or sense == 0 else (1.0 if sense == 1 else -1.0)


@inlined
def set_mode(work, j, mode):
    """Write a mode into ``work.contact`` and ``work.slide``."""
    work.contact[j, 0], work.contact[j, 1] = corners_of(mode)
    work.slide[j] = slide_of(mode)


@inlined
def opening_rate(j, k, ux, uy, work):
    """Return the opening rate of a corner: the larger of Eqs 23a and 23b."""
    side = work.side_normal
    plus = fused(side[j, k, PLUS, 0], ux, side[j, k, PLUS, 1] * uy)
    minus = fused(side[j, k, MINUS, 0], ux, side[j, k, MINUS, 1] * uy)
    return larger(plus, minus)


@inlined
def slip_normal(j, k, backwards, work):
    """Return the normal at a sliding corner; `backwards` is against the tangent."""
    side = work.side_normal
    nx = select(backwards, side[j, k, MINUS, 0], side[j, k, PLUS, 0])
    ny = select(backwards, side[j, k, MINUS, 1], side[j, k, PLUS, 1])
    return nx, ny


@inlined
def contact_of(j, work):
    """Return normal and contact point of a joint in its present mode; nx, ny, px, py."""
    at_0 = work.contact[j, 0] > 0.5
    at_1 = work.contact[j, 1] > 0.5
    closed = at_0 & at_1
    second = at_1 & opposite(at_0)
    backwards = work.slide[j] < 0.0
    ax, ay = slip_normal(j, 0, backwards, work)
    bx, by = slip_normal(j, 1, backwards, work)
    nx = select(closed, work.normal[j, 0], select(second, bx, ax))
    ny = select(closed, work.normal[j, 1], select(second, by, ay))
    px = select(second, work.point[j, 1, 0], work.point[j, 0, 0])
    py = select(second, work.point[j, 1, 1], work.point[j, 0, 1])
    return nx, ny, px, py


@inlined
def closed_forces(j, work):
    """Return normal forces at both corners of a closed joint, their sum, and the shear.

    The resultant acts at the contact centre: e of Eq 14 is the second over the sum.
    """
    nx = work.normal[j, 0]
    ny = work.normal[j, 1]
    fx = work.reaction[j, 0]
    fy = work.reaction[j, 1]
    normal = fx * nx + fy * ny
    tangential = fy * nx - fx * ny
    px = work.point[j, 0, 0] - work.pivot[j, 0]
    py = work.point[j, 0, 1] - work.pivot[j, 1]
    difference = work.reaction[j, 2] / (px * ny - py * nx)
    return 0.5 * (normal + difference), 0.5 * (normal - difference), normal, tangential


@inlined
def cone_rays(j, model, ax, ay, bx, by):
    """Return the edges of Coulomb's cones (Eq 20): along the tangent, and against it."""
    n = model.ray[j, 0]
    t = model.ray[j, 1]
    high_x = n * ax - t * ay
    high_y = n * ay + t * ax
    low_x = n * bx + t * by
    low_y = n * by - t * bx
    return high_x, high_y, low_x, low_y


@kernel
def functions_if_open(j, work, value, target):
    """Write the opening rates of corner 0 by the two normals, then those of corner 1 (Eqs 5, 23).

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
            nx, ny = slip_normal(j, k, sense < 0.0, work)
            value[2 * k + c] = (
                nx * work.corner_rate[j, k, 0] + ny * work.corner_rate[j, k, 1]
            )
            target[2 * k + c] = corner_mode(k, sense)


@kernel
def functions_if_closed(j, model, work, value, target):
    """Write normal forces at both corners, then Coulomb's limits of either sense, or the slip
    rate.

    Reads: model.friction, work (corner_rate, known, normal, pivot, point, reaction, slide).
    Writes: value, target.
    """
    nx = work.normal[j, 0]
    ny = work.normal[j, 1]
    slide = work.slide[j]
    value[0], value[1], normal, tangential = closed_forces(j, work)
    target[0], target[1] = corner_mode(1, slide), corner_mode(0, slide)
    if slide == 0.0:
        limit = model.friction[j] * normal
        value[2] = limit - tangential
        target[2] = CLOSED_STICK + 1
        value[3] = limit + tangential
        target[3] = CLOSED_STICK + 2
    elif work.known[j] == 0.0:
        ux = work.corner_rate[j, 0, 0] + work.corner_rate[j, 1, 0]
        uy = work.corner_rate[j, 0, 1] + work.corner_rate[j, 1, 1]
        value[2] = -0.5 * slide * (nx * uy - ny * ux)
        target[2] = CLOSED_STICK


@kernel
def functions_if_corner(j, model, work, value, target):
    """Write margins of the cones about both normals, or force and slip rate; then the other
    corner.

    Writes: value, target.
    """
    k = 0 if work.contact[j, 0] > 0.5 else 1
    other = 1 - k
    slide = work.slide[j]
    n = work.side_normal[j, k, PLUS]
    m = work.side_normal[j, k, MINUS]
    fx = work.reaction[j, 0]
    fy = work.reaction[j, 1]
    hx, hy, lx, ly = cone_rays(j, model, n[0], n[1], m[0], m[1])
    if slide == 0.0:
        sense = 1.0 if lx * hy - ly * hx >= 0.0 else -1.0
        value[0], target[0] = -sense * (hx * fy - hy * fx), corner_mode(k, 1)
        value[1], target[1] = -sense * (fx * ly - fy * lx), corner_mode(k, -1)
    else:
        nx, ny = slip_normal(j, k, slide < 0.0, work)
        value[0] = fx * hx + fy * hy if slide > 0.0 else fx * lx + fy * ly
        target[0] = OPEN
        if work.known[j] == 0.0:
            ux = work.corner_rate[j, k, 0]
            uy = work.corner_rate[j, k, 1]
            value[1], target[1] = -slide * (nx * uy - ny * ux), corner_mode(k, 0)
    if work.candidate[j, other] > 0.5:
        nx = work.normal[j, 0]
        ny = work.normal[j, 1]
        value[2] = (
            nx * work.corner_rate[j, other, 0] + ny * work.corner_rate[j, other, 1]
        )
        target[2] = mode_number(1, 1, slide)
