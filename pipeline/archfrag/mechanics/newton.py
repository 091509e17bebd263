"""Newton (active-set) iteration on the modes of the joints."""

import numpy as np

from archfrag.mechanics.compile import inlined, kernel
from archfrag.mechanics.delassus import corner_velocity, solve_modes
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


@inlined
def _unclosed(j, corner, contacts, work):
    """Opening rate of a corner: the larger of what 23a and 23b measure."""
    ux, uy = corner_velocity(j, corner, contacts, work)
    plus = contacts.normal_plus[j, corner, 0] * ux + contacts.normal_plus[j, corner, 1] * uy
    minus = contacts.normal_minus[j, corner, 0] * ux + contacts.normal_minus[j, corner, 1] * uy
    return max(plus, minus)


@inlined
def closed_forces(j, contacts, work):
    """Normal forces at both corners of a closed joint, and the tangential force [N]."""
    fx, fy = work.reaction[j, 0], work.reaction[j, 1]
    nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
    push = fx * nx + fy * ny
    px = contacts.point[j, 0, 0] - work.pivot[j, 0]
    py = contacts.point[j, 0, 1] - work.pivot[j, 1]
    difference = work.reaction[j, 2] / cross(px, py, nx, ny)
    return 0.5 * (push + difference), 0.5 * (push - difference), fy * nx - fx * ny


@kernel
def propose_modes(contacts, friction, work, scale, force_scale, tolerance):
    """Mode that every joint asks for, given the solution for the present modes.

    Parameters
    ----------
    contacts, friction, work
        As in `archfrag.mechanics.former_contact.solve_contact`; ``work.best_mode`` is overwritten.
    scale, force_scale : float
        What counts as one in velocity and in force.
    tolerance : float
        Violation of a law that is taken for rounding [1].

    Returns
    -------
    changed : int
        Joints whose present mode breaks a law.
    worst_joint : int
        The one that breaks its law most; -1 if none does.
    """
    slack = tolerance * scale
    slack_force = tolerance * force_scale
    changed = 0
    worst_joint = -1
    worst = 0.0
    for j in range(work.mode.size):
        mode = work.mode[j]
        mu = friction[j]
        known = contacts.slip[j]
        violation = 0.0
        if mode == OPEN:
            deepest = -1
            count = 0
            for corner in range(2):
                if contacts.candidate[j, corner]:
                    rate = _unclosed(j, corner, contacts, work)
                    if rate < -slack:
                        count += 1
                        if -rate / scale > violation:
                            violation = -rate / scale
                            deepest = corner
            if count == 2:
                mode = closed_mode(STICK if np.isinf(mu) else known)
            elif count == 1:
                mode = corner_mode(deepest, known)
        elif is_closed(mode):
            nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
            force_0, force_1, tangential = closed_forces(j, contacts, work)
            slip = slip_of(mode)
            if slip == STICK:
                excess = -1.0
                if not np.isinf(mu):
                    excess = abs(tangential) - mu * max(force_0 + force_1, 0.0)
                if excess > slack_force:
                    slip = PLUS if tangential > 0.0 else MINUS
                    violation = excess / force_scale
            elif known == 0:
                ux, uy = corner_velocity(j, 0, contacts, work)
                wrong = slip * (nx * uy - ny * ux)
                if wrong > slack:
                    slip = STICK
                    violation = wrong / scale
            keep_0 = force_0 >= -slack_force
            keep_1 = force_1 >= -slack_force
            if keep_0 and keep_1:
                mode = closed_mode(slip)
            else:
                violation = max(violation, -min(force_0, force_1) / force_scale)
                if keep_0:
                    mode = corner_mode(0, slip)
                elif keep_1:
                    mode = corner_mode(1, slip)
                else:
                    mode = OPEN
        else:
            fx, fy = work.reaction[j, 0], work.reaction[j, 1]
            corner = 0 if touches(mode, 0) else 1
            slip = slip_of(mode)
            plus_x, plus_y = contacts.normal_plus[j, corner, 0], contacts.normal_plus[j, corner, 1]
            minus_x = contacts.normal_minus[j, corner, 0]
            minus_y = contacts.normal_minus[j, corner, 1]
            lost = False
            if slip == STICK:
                high_x, high_y = friction_ray(plus_x, plus_y, mu, PLUS)
                low_x, low_y = friction_ray(minus_x, minus_y, mu, MINUS)
                norm = 1.0 if np.isinf(mu) else np.sqrt(1.0 + mu * mu)
                above = cross(high_x, high_y, fx, fy) / norm
                below = cross(fx, fy, low_x, low_y) / norm
                outside = max(above, below)
                if outside > slack_force:
                    violation = outside / force_scale
                    lost = fx * (plus_x + minus_x) + fy * (plus_y + minus_y) <= 0.0
                    slip = PLUS if above >= below else MINUS
            else:
                nx = plus_x if slip == PLUS else minus_x
                ny = plus_y if slip == PLUS else minus_y
                ray_x, ray_y = friction_ray(nx, ny, mu, slip)
                norm = 1.0 if np.isinf(mu) else np.sqrt(1.0 + mu * mu)
                push = (fx * ray_x + fy * ray_y) / norm
                if push < -slack_force:
                    violation = -push / force_scale
                    lost = True
                elif known == 0:
                    ux, uy = corner_velocity(j, corner, contacts, work)
                    wrong = slip * (nx * uy - ny * ux)
                    if wrong > slack:
                        slip = STICK
                        violation = wrong / scale
            mode = OPEN
            if not lost:
                mode = corner_mode(corner, slip)
                other = 1 - corner
                if contacts.candidate[j, other]:
                    rate = _unclosed(j, other, contacts, work)
                    if rate < -slack:
                        mode = closed_mode(STICK if np.isinf(mu) else slip)
                        violation = max(violation, -rate / scale)
        work.best_mode[j] = mode
        if violation > 0.0:
            changed += 1
            if violation > worst:
                worst = violation
                worst_joint = j
    return changed, worst_joint


@kernel
def is_finite(velocity):
    """Whether no velocity, (n_body, 3), has overflowed; comparisons with nan would pass."""
    total = 0.0
    for i in range(velocity.shape[0]):
        total += abs(velocity[i, 0]) + abs(velocity[i, 1]) + abs(velocity[i, 2])
    return np.isfinite(total)


@kernel
def active_set(
    mass,
    inertia,
    contacts,
    friction,
    free_velocity,
    work,
    scale,
    compliance,
    tolerance,
    limit,
    exact,
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
        changed, worst_joint = propose_modes(
            contacts, friction, work, scale, force_scale, tolerance
        )
        if changed == 0:
            good = not exact or left <= tolerance * scale
            return good and is_finite(work.velocity), iteration + 1
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
