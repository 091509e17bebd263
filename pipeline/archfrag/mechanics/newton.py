"""Newton (active-set) iteration on the modes of the joints."""

import numpy as np
from numba import njit

from archfrag.mechanics.delassus import TOLERANCE, corner_velocity, solve_modes
from archfrag.mechanics.laws import (
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


@njit(cache=True)
def corner_clearance(j, corner, contacts, work):
    """Rate at which a corner opens: the larger of what 23a and 23b measure."""
    ux, uy = corner_velocity(j, corner, contacts, work)
    plus = contacts.normal_plus[j, corner, 0] * ux + contacts.normal_plus[j, corner, 1] * uy
    minus = contacts.normal_minus[j, corner, 0] * ux + contacts.normal_minus[j, corner, 1] * uy
    return max(plus, minus)


@njit(cache=True)
def revise(j, contacts, friction, work, scale, force_scale):
    """Mode that joint `j` asks for, given the solution for the present modes.

    Returns
    -------
    mode : int
    violation : float
        By how much the present mode breaks a law; 0 if it holds [1].
    """
    mode = work.mode[j]
    mu = friction[j]
    fx, fy = work.reaction[j, 0], work.reaction[j, 1]
    known = contacts.slip[j]
    if is_closed(mode):
        nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
        normal_force = fx * nx + fy * ny
        tangential = fy * nx - fx * ny
        px0 = contacts.point[j, 0, 0] - work.pivot[j, 0]
        py0 = contacts.point[j, 0, 1] - work.pivot[j, 1]
        half = cross(px0, py0, nx, ny)
        difference = work.reaction[j, 2] / half
        force_0 = 0.5 * (normal_force + difference)
        force_1 = 0.5 * (normal_force - difference)
        slip = slip_of(mode)
        violation = 0.0
        if slip == STICK:
            excess = abs(tangential) - mu * max(normal_force, 0.0)
            if excess > TOLERANCE * force_scale:
                slip = PLUS if tangential > 0.0 else MINUS
                violation = excess / force_scale
        elif known == 0:
            ux, uy = corner_velocity(j, 0, contacts, work)
            wrong = slip * (nx * uy - ny * ux)
            if wrong > TOLERANCE * scale:
                slip = STICK
                violation = wrong / scale
        keep_0 = force_0 >= -TOLERANCE * force_scale
        keep_1 = force_1 >= -TOLERANCE * force_scale
        if keep_0 and keep_1:
            return closed_mode(slip), violation
        violation = max(violation, -min(force_0, force_1) / force_scale)
        if keep_0:
            return corner_mode(0, slip), violation
        if keep_1:
            return corner_mode(1, slip), violation
        return OPEN, violation
    if mode == OPEN:
        worst = -1
        violation = 0.0
        count = 0
        for corner in range(2):
            if contacts.candidate[j, corner]:
                clearance = corner_clearance(j, corner, contacts, work)
                if clearance < -TOLERANCE * scale:
                    count += 1
                    if -clearance / scale > violation:
                        violation = -clearance / scale
                        worst = corner
        if worst < 0:
            return OPEN, 0.0
        if count == 2:
            return closed_mode(known), violation
        return corner_mode(worst, known), violation
    corner = 0 if touches(mode, 0) else 1
    slip = slip_of(mode)
    plus_x, plus_y = contacts.normal_plus[j, corner, 0], contacts.normal_plus[j, corner, 1]
    minus_x, minus_y = contacts.normal_minus[j, corner, 0], contacts.normal_minus[j, corner, 1]
    violation = 0.0
    if slip == STICK:
        high_x, high_y = friction_ray(plus_x, plus_y, mu, PLUS)
        low_x, low_y = friction_ray(minus_x, minus_y, mu, MINUS)
        above = cross(high_x, high_y, fx, fy) / np.sqrt(high_x * high_x + high_y * high_y)
        below = cross(fx, fy, low_x, low_y) / np.sqrt(low_x * low_x + low_y * low_y)
        worst = max(above, below)
        if worst > TOLERANCE * force_scale:
            violation = worst / force_scale
            pull = fx * (plus_x + minus_x) + fy * (plus_y + minus_y) <= 0.0
            if pull:
                return OPEN, violation
            slip = PLUS if above >= below else MINUS
    else:
        nx = plus_x if slip == PLUS else minus_x
        ny = plus_y if slip == PLUS else minus_y
        ray_x, ray_y = friction_ray(nx, ny, mu, slip)
        push = (fx * ray_x + fy * ray_y) / np.sqrt(ray_x * ray_x + ray_y * ray_y)
        if push < -TOLERANCE * force_scale:
            return OPEN, -push / force_scale
        if known == 0:
            ux, uy = corner_velocity(j, corner, contacts, work)
            wrong = slip * (nx * uy - ny * ux)
            if wrong > TOLERANCE * scale:
                slip = STICK
                violation = wrong / scale
    other = 1 - corner
    if contacts.candidate[j, other]:
        clearance = corner_clearance(j, other, contacts, work)
        if clearance < -TOLERANCE * scale:
            return closed_mode(slip), max(violation, -clearance / scale)
    return corner_mode(corner, slip), violation


@njit(cache=True)
def active_set(
    mass, inertia, contacts, friction, free_velocity, work, scale, compliance, limit, exact
):
    """Newton iteration on the modes, from those in ``work.mode``.

    While it converges every joint takes the mode it asks for; where that goes round in circles
    a changing half of them does, and in the end only the one that breaks its law most.

    Returns
    -------
    converged : bool
    iterations : int
    """
    n_joint = work.mode.size
    seed = np.uint32(2463534242)
    all_until = 8 + n_joint // 4
    half_until = limit - limit // 4
    for iteration in range(limit):
        left = solve_modes(
            mass, inertia, contacts, friction, free_velocity, work, scale, compliance, exact
        )
        force_scale = 0.0
        for j in range(n_joint):
            force_scale = max(force_scale, abs(work.reaction[j, 0]), abs(work.reaction[j, 1]))
        if force_scale == 0.0:
            force_scale = 1.0
        worst = 0.0
        worst_joint = -1
        changed = 0
        for j in range(n_joint):
            mode, violation = revise(j, contacts, friction, work, scale, force_scale)
            if violation > worst:
                worst = violation
                worst_joint = j
            work.best_mode[j] = mode
            if violation > 0.0:
                changed += 1
        if changed == 0:
            return left < np.inf, iteration + 1
        for j in range(n_joint):
            if work.best_mode[j] == work.mode[j]:
                continue
            if iteration >= half_until:
                take = j == worst_joint
            elif iteration >= all_until:
                seed ^= seed << np.uint32(13)
                seed ^= seed >> np.uint32(17)
                seed ^= seed << np.uint32(5)
                take = j == worst_joint or (seed & np.uint32(65536)) != 0
            else:
                take = True
            if take:
                work.mode[j] = work.best_mode[j]
    return False, limit
