"""Contact residual: the distance of motions and reactions from the laws, for every method.

`state_residual` looks at what a method gives at one instant and at nothing inside the method:
positions, velocities and reactions. Gaps are measured over joint lengths, slip rates over the
speed of a fall through them, forces over the weight or the largest of them; the residual is the
smallest violation over the modes in which a joint can obey Signorini and Coulomb.
"""

import math

from archfrag.physics.contact import placing
from archfrag.physics.contact.laws import (
    along,
    closed_forces,
    cones_at,
    cross,
    force_of,
    normal_of,
    opening_rate,
    rate_of,
    side_of,
)
from archfrag.physics.kernels.kernel import inlined, kernel

# Corners closer than this, over the joint's length, touch.
TOUCHING = 1e-6


@inlined
def _approach(j, k, work, scale):
    """Return how fast a corner that may touch closes, over `scale` [1]; zero if it opens.

    Of the rates by Eqs 23a and 23b it is the one that closes less (Eq 5).
    """
    rate = opening_rate(j, k, rate_of(j, k, work), work)
    return max(0.0, -rate) / scale if work.candidate[j, k] > 0.5 else 0.0


@inlined
def _arm(j, k, work):
    """Return the vector from the pivot of joint `j` to its corner `k`."""
    point = work.point[j, k]
    return point[0] - work.pivot[j, 0], point[1] - work.pivot[j, 1]


@kernel
def _if_corner(j, k, model, work, scale, force):
    """Return the violation of the laws if joint `j` bears at corner `k` only [1].

    The laws are Eqs 5, 6, 20 and 23; `scale` and `force` are those of `contact_residual`.

    Reads: model.ray, work (candidate, corner_rate, known, pivot, point, reaction, side_normal).
    """
    arm = _arm(j, k, work)
    far = _arm(j, 1 - k, work)
    length = math.sqrt((far[0] - arm[0]) ** 2 + (far[1] - arm[1]) ** 2)
    fx, fy = force_of(j, work)
    push = fx / force, fy / force
    moment = work.reaction[j, 2] / force - cross(arm, push)
    common = max(abs(moment) / length, _approach(j, 1 - k, work, scale))
    ux, uy = rate_of(j, k, work)
    rate = ux / scale, uy / scale
    size = 1.0 / math.sqrt(model.ray[j, 0] ** 2 + model.ray[j, 1] ** 2)
    cones = cones_at(j, k, model, work)
    best = math.inf
    outside = 0.0
    for side in range(2):
        sense = 1.0 - 2.0 * side
        normal = side_of(j, k, side, work)
        ray = cones[side][0] * size, cones[side][1] * size
        beyond = cross(ray, push)
        outside = max(outside, sense * beyond)
        if work.known[j] == -sense:
            continue
        wrong = 0.0
        if work.known[j] != sense:
            wrong = max(0.0, sense * cross(normal, rate))
        tension = max(0.0, -along(ray, push))
        worst = max(common, abs(beyond), tension, abs(along(normal, rate)), wrong)
        best = min(best, worst)
    if work.known[j] == 0.0:
        best = min(best, max(common, outside, abs(rate[0]), abs(rate[1])))
    return best


@kernel
def _if_closed(j, model, work, scale, force):
    """Return the violation of the laws if joint `j` bears at both corners (Eqs 5, 6) [1].

    `scale` and `force` are those of `contact_residual`.

    Reads: model.friction, work (corner_rate, known, normal, pivot, point, reaction).
    """
    axis = normal_of(j, work)
    force_0, force_1, normal, tangential = closed_forces(j, work)
    normal = normal / force
    tangential = tangential / force
    tension = max(0.0, -force_0 / force, -force_1 / force)
    first = rate_of(j, 0, work)
    second = rate_of(j, 1, work)
    rate = max(abs(along(axis, first)), abs(along(axis, second)))
    slip = cross(axis, (first[0] + second[0], first[1] + second[1]))
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

    `work` has contacts, `candidate`, `known`, reactions, and velocities of corners in
    `corner_rate`. Violations are velocities over `scale`, and forces over `force`.
    """
    largest = 0.0
    for j in range(work.slide.size):
        fx, fy = force_of(j, work)
        px, py = _arm(j, 0, work)
        moment = work.reaction[j, 2] / force / (2.0 * math.sqrt(px * px + py * py))
        best = max(abs(fx / force), abs(fy / force), abs(moment))
        near = 0.0
        for k in range(2):
            best = max(best, _approach(j, k, work, scale))
            near += work.candidate[j, k]
        for k in range(2):
            if work.candidate[j, k] > 0.5:
                best = min(best, _if_corner(j, k, model, work, scale, force))
        if near > 1.5:
            best = min(best, _if_closed(j, model, work, scale, force))
        largest = max(largest, best)
    return largest


@inlined
def _move_moments(work, sense):
    """Move the moments of reactions from the pivots to the origin (`sense` 1), or back (-1)."""
    for j in range(work.slide.size):
        arm = work.pivot[j, 0], work.pivot[j, 1]
        work.reaction[j, 2] += sense * cross(arm, force_of(j, work))


@kernel
def state_residual(model, state, work):
    """Return the contact residual of the present instant of a motion [1], see `contact_residual`.

    `work` has the faces where the bodies are, and the forces in `reaction`; its contacts,
    `candidate`, `known` and `corner_rate` are overwritten.
    """
    length = model.length
    _move_moments(work, 1.0)
    placing.place_contacts(model, state.slip, work)
    _move_moments(work, -1.0)
    placing.relative_velocity(
        model, state.position, state.velocity, work.pivot, work.relative
    )
    force = 0.0
    for i in range(model.mass.size):
        force += model.gravity * model.mass[i]
    for j in range(length.size):
        fx, fy = force_of(j, work)
        force = max(force, abs(fx), abs(fy))
        nx, ny = normal_of(j, work)
        work.known[j] = 0.0
        for k in range(2):
            work.candidate[j, k] = 1.0
            gap = placing.clearance(j, k, work) / length[j]
            if gap > TOUCHING or (fx == 0.0 and fy == 0.0):
                # Only the gap counts; how the faces slide past each other does not.
                work.corner_rate[j, k, 0] = gap * nx
                work.corner_rate[j, k, 1] = gap * ny
                continue
            slip = cross((nx, ny), placing.corner_velocity(j, k, work.relative, work))
            rate = slip / math.sqrt(model.gravity * length[j])
            ex, ey = placing.corner_offset(j, k, work, state.slip[j])
            work.corner_rate[j, k, 0] = ex / length[j] - rate * ny
            work.corner_rate[j, k, 1] = ey / length[j] + rate * nx
    return contact_residual(model, work, 1.0, force)
