"""Contact residual: the distance of motions and reactions from the laws, for every method.

`state_residual` looks at what a method gives at one instant and at nothing inside the method:
positions, velocities and reactions. Gaps are measured over joint lengths, slip rates over the
speed of a fall through them, forces over the weight or the largest of them; the residual is the
smallest violation over the modes in which a joint can obey Signorini and Coulomb.
"""

import math

from archfrag.physics.contact import placing
from archfrag.physics.contact.laws import (
    MINUS,
    PLUS,
    closed_forces,
    cone_rays,
    opening_rate,
)
from archfrag.physics.kernels.kernel import inlined, kernel

# Corners closer than this, over the joint's length, touch.
TOUCHING = 1e-6


@inlined
def _approach(j, k, work, scale):
    """Return the rate at which a corner that may touch closes, by the law that is kept more nearly
    (Eq 5).
    """
    rate = opening_rate(
        j, k, work.corner_rate[j, k, 0], work.corner_rate[j, k, 1], work
    )
    return max(0.0, -rate) / scale if work.candidate[j, k] > 0.5 else 0.0


@inlined
def _arm(j, k, work):
    return work.point[j, k, 0] - work.pivot[j, 0], work.point[j, k, 1] - work.pivot[
        j, 1
    ]


@kernel
def _if_corner(j, k, model, work, scale, force):
    """Return the violation of the laws by a joint taken to bear at one corner (Eqs 5, 6, 20, 23).

    Reads: model.ray, work (candidate, corner_rate, known, pivot, point, reaction, side_normal).
    """
    px, py = _arm(j, k, work)
    qx, qy = _arm(j, 1 - k, work)
    length = math.sqrt((qx - px) ** 2 + (qy - py) ** 2)
    fx = work.reaction[j, 0] / force
    fy = work.reaction[j, 1] / force
    moment = work.reaction[j, 2] / force
    common = max(
        abs(moment - (px * fy - py * fx)) / length, _approach(j, 1 - k, work, scale)
    )
    ux = work.corner_rate[j, k, 0] / scale
    uy = work.corner_rate[j, k, 1] / scale
    size = 1.0 / math.sqrt(model.ray[j, 0] ** 2 + model.ray[j, 1] ** 2)
    n = work.side_normal[j, k, PLUS]
    m = work.side_normal[j, k, MINUS]
    hx, hy, lx, ly = cone_rays(j, model, n[0], n[1], m[0], m[1])
    best = math.inf
    outside = 0.0
    for side in range(2):
        sense = 1.0 - 2.0 * side
        nx = work.side_normal[j, k, side, 0]
        ny = work.side_normal[j, k, side, 1]
        rx, ry = (hx * size, hy * size) if side == PLUS else (lx * size, ly * size)
        beyond = rx * fy - ry * fx
        outside = max(outside, sense * beyond)
        if work.known[j] == -sense:
            continue
        wrong = 0.0 if work.known[j] == sense else max(0.0, sense * (nx * uy - ny * ux))
        tension = max(0.0, -(rx * fx + ry * fy))
        best = min(
            best, max(common, abs(beyond), tension, abs(nx * ux + ny * uy), wrong)
        )
    if work.known[j] == 0.0:
        best = min(best, max(common, outside, abs(ux), abs(uy)))
    return best


@kernel
def _if_closed(j, model, work, scale, force):
    """Return the violation of the laws by a joint taken to bear at both corners (Eqs 5, 6).

    Reads: model.friction, work (corner_rate, known, normal, pivot, point, reaction).
    """
    nx = work.normal[j, 0]
    ny = work.normal[j, 1]
    force_0, force_1, normal, tangential = closed_forces(j, work)
    normal = normal / force
    tangential = tangential / force
    tension = max(0.0, -force_0 / force, -force_1 / force)
    parts = work.corner_rate[j]
    rate = max(
        abs(nx * parts[0, 0] + ny * parts[0, 1]),
        abs(nx * parts[1, 0] + ny * parts[1, 1]),
    )
    slip = nx * (parts[0, 1] + parts[1, 1]) - ny * (parts[0, 0] + parts[1, 0])
    common = max(tension, rate / scale)
    slip = 0.5 * slip / scale
    best = math.inf
    mu = model.friction[j]
    rough = math.isinf(mu)
    if work.known[j] == 0.0:
        outside = 0.0 if rough else max(0.0, abs(tangential) - mu * max(normal, 0.0))
        best = max(common, outside, abs(slip))
    for side in range(0 if rough else 2):
        sense = 1.0 - 2.0 * side
        if work.known[j] == -sense:
            continue
        wrong = 0.0 if work.known[j] == sense else max(0.0, sense * slip)
        best = min(best, max(common, abs(tangential - sense * mu * normal), wrong))
    return best


@kernel
def contact_residual(model, work, scale, force):
    """Return the largest violation of Signorini's and Coulomb's laws over the joints [1].

    From contacts, `candidate`, `known`, velocities of the corners in `corner_rate` and reactions;
    `scale` and `force` count as one in velocity and in force.
    """
    largest = 0.0
    for j in range(work.slide.size):
        fx = work.reaction[j, 0] / force
        fy = work.reaction[j, 1] / force
        px, py = _arm(j, 0, work)
        moment = work.reaction[j, 2] / force / (2.0 * math.sqrt(px * px + py * py))
        first = _approach(j, 0, work, scale)
        second = _approach(j, 1, work, scale)
        best = max(abs(fx), abs(fy), abs(moment), first, second)
        at_0 = work.candidate[j, 0] > 0.5
        at_1 = work.candidate[j, 1] > 0.5
        if at_0:
            best = min(best, _if_corner(j, 0, model, work, scale, force))
        if at_1:
            best = min(best, _if_corner(j, 1, model, work, scale, force))
        if at_0 and at_1:
            best = min(best, _if_closed(j, model, work, scale, force))
        largest = max(largest, best)
    return largest


@inlined
def _move_moments(work, sense):
    """Move the moments of reactions from the pivots to the origin, or back."""
    for j in range(work.slide.size):
        fx = work.reaction[j, 0]
        fy = work.reaction[j, 1]
        work.reaction[j, 2] += sense * (work.pivot[j, 0] * fy - work.pivot[j, 1] * fx)


@kernel
def state_residual(model, state, work):
    """Return the contact residual of one instant of a motion; as `contact_residual`.

    With the faces where the bodies are; contacts, `candidate`, `known` and `corner_rate` are
    overwritten.
    """
    length = model.length
    _move_moments(work, 1.0)
    placing.place_contacts(model, state.slip, work.face, work.tangent, work)
    _move_moments(work, -1.0)
    placing.relative_velocity(state.position, state.velocity, work.pivot, work.relative)
    force = 0.0
    for i in range(model.mass.size):
        force += model.gravity * model.mass[i]
    for j in range(length.size):
        fx = work.reaction[j, 0]
        fy = work.reaction[j, 1]
        force = max(force, abs(fx), abs(fy))
        nx = work.normal[j, 0]
        ny = work.normal[j, 1]
        work.known[j] = 0.0
        for k in range(2):
            work.candidate[j, k] = 1.0
            gap = placing.clearance(j, k, work.face, work.tangent) / length[j]
            if gap > TOUCHING or (fx == 0.0 and fy == 0.0):
                # Only the gap counts; how the faces slide past each other does not.
                work.corner_rate[j, k, 0] = gap * nx
                work.corner_rate[j, k, 1] = gap * ny
                continue
            ux, uy = placing.corner_velocity(j, k, work.relative, work)
            rate = (nx * uy - ny * ux) / math.sqrt(model.gravity * length[j])
            ex, ey = placing.corner_offset(j, k, work.face, work.tangent, state.slip[j])
            work.corner_rate[j, k, 0] = ex / length[j] - rate * ny
            work.corner_rate[j, k, 1] = ey / length[j] + rate * nx
    return contact_residual(model, work, 1.0, force)
