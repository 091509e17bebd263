"""Contact problem by following its piecewise-linear solution path: what the Newton iteration
could not solve.

All joints are first pushed apart by an extra opening velocity, so that none touches and the
solution is known. The extra velocity is then taken back, tau from 0 to 1, and the solution is
followed exactly from piece to piece of the contact laws: at each break one joint changes its
mode. Where the laws are not monotone (friction) the path may turn back in tau; its direction
after a break is the one that leads into the new piece. This is Lemke's complementary pivoting
(Cottle, Pang and Stone, *The Linear Complementarity Problem*, ch. 4) written for the modes of a
chain, with a block-tridiagonal solution for each piece.
"""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.delassus import (
    apply_reactions,
    constrained_rest,
    corner_velocity,
    factorise,
    set_rows,
    substitute,
)
from archfrag.mechanics.laws import (
    CLOSED_STICK,
    MINUS,
    OPEN,
    PLUS,
    STICK,
    closed_mode,
    corner_mode,
    cross,
    friction_ray,
    is_closed,
    slip_of,
    touches,
)

PATH_FRICTION = 1e3
N_FUNCTION = 4


@kernel
def piece_functions(j, contacts, friction, work, value, target):
    """Linear functions that are non-negative on the piece of joint `j`, and what lies beyond.

    Parameters
    ----------
    value : ndarray, (4,)
        Overwritten. For an open joint: opening rates of corner 0 by the two normals, then those
        of corner 1; inf where there is no function.
    target : ndarray, (4,) int8
        Overwritten: mode on the other side of the function's zero.
    """
    mode = work.mode[j]
    mu = friction[j]
    value[:] = np.inf
    target[:] = mode
    if mode == OPEN:
        for c in range(2):
            if contacts.candidate[j, c]:
                ux, uy = corner_velocity(j, c, contacts, work)
                n = contacts.normal_plus[j, c]
                m = contacts.normal_minus[j, c]
                known = contacts.slip[j]
                for k in range(2):
                    sense = known if known != STICK else (PLUS if k == 0 else MINUS)
                    value[2 * c + k] = n[0] * ux + n[1] * uy
                    if sense == MINUS:
                        value[2 * c + k] = m[0] * ux + m[1] * uy
                    target[2 * c + k] = corner_mode(c, sense)
        return
    fx, fy = work.reaction[j, 0], work.reaction[j, 1]
    slip = slip_of(mode)
    if is_closed(mode):
        nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
        normal_force = fx * nx + fy * ny
        tangential = fy * nx - fx * ny
        px = contacts.point[j, 0, 0] - work.pivot[j, 0]
        py = contacts.point[j, 0, 1] - work.pivot[j, 1]
        difference = work.reaction[j, 2] / cross(px, py, nx, ny)
        value[0] = 0.5 * (normal_force + difference)
        target[0] = corner_mode(1, slip)
        value[1] = 0.5 * (normal_force - difference)
        target[1] = corner_mode(0, slip)
        if slip == STICK:
            value[2] = mu * normal_force - tangential
            target[2] = closed_mode(PLUS)
            value[3] = mu * normal_force + tangential
            target[3] = closed_mode(MINUS)
        elif contacts.slip[j] == 0:
            ux, uy = corner_velocity(j, 0, contacts, work)
            vx, vy = corner_velocity(j, 1, contacts, work)
            value[2] = -0.5 * slip * (nx * (uy + vy) - ny * (ux + vx))
            target[2] = CLOSED_STICK
        return
    corner = 0 if touches(mode, 0) else 1
    n = contacts.normal_plus[j, corner]
    m = contacts.normal_minus[j, corner]
    if slip == STICK:
        hx, hy = friction_ray(n[0], n[1], mu, PLUS)
        lx, ly = friction_ray(m[0], m[1], mu, MINUS)
        sense = 1.0 if cross(lx, ly, hx, hy) >= 0.0 else -1.0
        value[0] = -sense * cross(hx, hy, fx, fy)
        target[0] = corner_mode(corner, PLUS)
        value[1] = -sense * cross(fx, fy, lx, ly)
        target[1] = corner_mode(corner, MINUS)
    else:
        nx, ny = (n[0], n[1]) if slip == PLUS else (m[0], m[1])
        rx, ry = friction_ray(nx, ny, mu, slip)
        value[0] = fx * rx + fy * ry
        target[0] = OPEN
        if contacts.slip[j] == 0:
            ux, uy = corner_velocity(j, corner, contacts, work)
            value[1] = -slip * (nx * uy - ny * ux)
            target[1] = corner_mode(corner, STICK)
    other = 1 - corner
    if contacts.candidate[j, other]:
        ux, uy = corner_velocity(j, other, contacts, work)
        nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
        value[2] = nx * ux + ny * uy
        target[2] = closed_mode(STICK if np.isinf(mu) else slip)


@kernel
def _solve_at(mass, inertia, contacts, free_velocity, work, value, target, friction):
    for j in range(work.mode.size):
        work.reaction[j, 0] = work.reaction[j, 1] = work.reaction[j, 2] = 0.0
    apply_reactions(mass, inertia, contacts, free_velocity, work)
    constrained_rest(contacts, work)
    substitute(work, work.unknown)
    for j in range(work.mode.size):
        for a in range(work.size[j]):
            for c in range(3):
                work.reaction[j, c] += work.unknown[j, a] * work.column[j, a, c]
    apply_reactions(mass, inertia, contacts, free_velocity, work)
    for j in range(work.mode.size):
        piece_functions(j, contacts, friction, work, value[j], target[j])


@allocating
def follow_path(
    mass,
    inertia,
    contacts,
    friction,
    free_velocity,
    work,
    scale,
    compliance,
    attempt,
    limit,
):
    """Follow the solution from all joints open to the problem's own.

    Parameters
    ----------
    mass, inertia : ndarray, (n_body,) [kg], [kg m2]
    contacts : Contacts
        Its bias is changed on the way and restored.
    friction : ndarray, (n_joint,)
    free_velocity : ndarray, (n_body, 3)
    work : ContactWork
        Assembled; on return its modes are those at the path's end.
    scale : float
        Largest relative velocity without reactions.
    compliance : float
        Of the contact rows, relative: it keeps the pieces of hyperstatic joints regular.
    attempt : int
        Chooses other opening velocities, and with them another path to the same problem.
    limit : int
        Breaks allowed.

    Returns
    -------
    reached : bool
    breaks : int
    """
    n_joint = work.mode.size
    bias = contacts.bias.copy()
    friction = np.minimum(friction, PATH_FRICTION)
    opening = np.zeros((n_joint, 2, 2))
    seed = np.uint32(88172645 + 7919 * attempt)
    for j in range(n_joint):
        work.mode[j] = OPEN
        for c in range(2):
            seed ^= seed << np.uint32(13)
            seed ^= seed >> np.uint32(17)
            seed ^= seed << np.uint32(5)
            size = scale * (4.0 + 4.0 * (seed >> np.uint32(8)) / 16777216.0)
            nx = contacts.normal_plus[j, c, 0] + contacts.normal_minus[j, c, 0]
            ny = contacts.normal_plus[j, c, 1] + contacts.normal_minus[j, c, 1]
            norm = np.sqrt(nx * nx + ny * ny)
            if norm < 1e-3:
                nx, ny, norm = contacts.normal[j, 0], contacts.normal[j, 1], 1.0
            opening[j, c, 0] = size * nx / norm
            opening[j, c, 1] = size * ny / norm
    at_start = np.empty((n_joint, N_FUNCTION))
    at_end = np.empty((n_joint, N_FUNCTION))
    target = np.empty((n_joint, N_FUNCTION), np.int8)
    tau = 0.0
    direction = 1.0
    crossed_joint = -1
    crossed_from = -1
    reached = False
    breaks = 0
    while breaks < limit:
        set_rows(contacts, friction, work)
        if not factorise(work, compliance):
            break
        contacts.bias[:] = bias + opening
        _solve_at(mass, inertia, contacts, free_velocity, work, at_start, target, friction)
        contacts.bias[:] = bias
        _solve_at(mass, inertia, contacts, free_velocity, work, at_end, target, friction)
        if crossed_joint >= 0:
            direction = 0.0
            for k in range(N_FUNCTION):
                if target[crossed_joint, k] == crossed_from:
                    slope = at_end[crossed_joint, k] - at_start[crossed_joint, k]
                    direction = 1.0 if slope > 0.0 else -1.0
            if work.mode[crossed_joint] == OPEN:
                c = 0 if touches(crossed_from, 0) else 1
                k = 2 * c + (0 if slip_of(crossed_from) == PLUS else 1)
                slope = at_end[crossed_joint, k] - at_start[crossed_joint, k]
                direction = 1.0 if slope > 0.0 else -1.0
            if direction == 0.0:
                break
        distance = np.inf
        next_joint = -1
        next_mode = OPEN
        for j in range(n_joint):
            if work.mode[j] == OPEN:
                for c in range(2):
                    if not contacts.candidate[j, c]:
                        continue
                    far = -np.inf
                    chosen = -1
                    stays = False
                    same = True
                    for k in range(2 * c, 2 * c + 2):
                        slope = (at_end[j, k] - at_start[j, k]) * direction
                        value = at_start[j, k] + tau * (at_end[j, k] - at_start[j, k])
                        just_left = j == crossed_joint and target[j, k] == crossed_from
                        if just_left and slope > 0.0:
                            stays = True
                            continue
                        if slope >= 0.0:
                            if value > 0.0:
                                stays = True
                            continue
                        step = max(-value / slope, 0.0) if value > 0.0 else 0.0
                        if step > far:
                            far = step
                            chosen = k
                    if stays or chosen < 0:
                        continue
                    n = contacts.normal_plus[j, c]
                    m = contacts.normal_minus[j, c]
                    same = contacts.slip[j] == STICK
                    same = same and abs(n[0] - m[0]) + abs(n[1] - m[1]) < 1e-12
                    if far < distance:
                        distance = far
                        next_joint = j
                        next_mode = target[j, chosen]
                        if same:
                            next_mode = -1 - c
                continue
            for k in range(N_FUNCTION):
                if at_end[j, k] == np.inf:
                    continue
                if j == crossed_joint and target[j, k] == crossed_from:
                    continue
                slope = (at_end[j, k] - at_start[j, k]) * direction
                if slope >= 0.0:
                    continue
                value = at_start[j, k] + tau * (at_end[j, k] - at_start[j, k])
                step = max(-value / slope, 0.0)
                if step < distance:
                    distance = step
                    next_joint = j
                    next_mode = target[j, k]
        if direction > 0.0 and tau < 1.0 and tau + distance >= 1.0:
            reached = True
            break
        if direction < 0.0 and tau > 1.0 and tau - distance <= 1.0:
            reached = True
            break
        if next_joint < 0:
            break
        tau += direction * distance
        if next_mode < 0:
            c = -next_mode - 1
            contacts.bias[:] = bias + (1.0 - tau) * opening
            _solve_at(mass, inertia, contacts, free_velocity, work, at_start, target, friction)
            ux, uy = corner_velocity(next_joint, c, contacts, work)
            n = contacts.normal_plus[next_joint, c]
            slipping = n[0] * uy - n[1] * ux
            next_mode = corner_mode(c, MINUS if slipping > 0.0 else PLUS)
        crossed_joint = next_joint
        crossed_from = work.mode[next_joint]
        work.mode[next_joint] = next_mode
        breaks += 1
    contacts.bias[:] = bias
    return reached, breaks
