"""How far motions and reactions are from the contact laws: one measure for every method."""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.delassus import relative_velocity, velocity_scale
from archfrag.mechanics.laws import MINUS, PLUS, cross, friction_ray


@kernel
def _corner_free(contacts, j, corner, ux, uy):
    if not contacts.candidate[j, corner]:
        return 0.0
    plus = contacts.normal_plus[j, corner, 0] * ux + contacts.normal_plus[j, corner, 1] * uy
    minus = contacts.normal_minus[j, corner, 0] * ux + contacts.normal_minus[j, corner, 1] * uy
    return max(0.0, -max(plus, minus))


@allocating
def joint_residual(j, contacts, friction, relative, reaction, pivot, scale, force_scale):
    """Smallest violation over the ways in which a joint can obey Signorini and Coulomb.

    Parameters
    ----------
    j : int
    contacts : archfrag.mechanics.contact.Contacts
    friction : ndarray, (n_joint,)
    relative : ndarray, (n_joint, 3)
        Relative velocity (or acceleration) at `pivot`, without bias.
    reaction : ndarray, (n_joint, 3)
        Force and moment about `pivot` on the body after the joint.
    pivot : ndarray, (n_joint, 2)
    scale, force_scale : float
        What counts as one in velocity and in force.

    Returns
    -------
    float
        Dimensionless; zero where the laws hold exactly.
    """
    ux = np.empty(2)
    uy = np.empty(2)
    px = np.empty(2)
    py = np.empty(2)
    free = np.empty(2)
    for c in range(2):
        px[c] = contacts.point[j, c, 0] - pivot[j, 0]
        py[c] = contacts.point[j, c, 1] - pivot[j, 1]
        ux[c] = (relative[j, 0] - relative[j, 2] * py[c] + contacts.bias[j, c, 0]) / scale
        uy[c] = (relative[j, 1] + relative[j, 2] * px[c] + contacts.bias[j, c, 1]) / scale
        free[c] = _corner_free(contacts, j, c, ux[c], uy[c])
    fx = reaction[j, 0] / force_scale
    fy = reaction[j, 1] / force_scale
    length = np.sqrt((px[1] - px[0]) ** 2 + (py[1] - py[0]) ** 2)
    moment = reaction[j, 2] / force_scale / length
    mu = friction[j]
    known = contacts.slip[j]

    best = max(max(abs(fx), abs(fy)), abs(moment), free[0], free[1])

    for c in range(2):
        if not contacts.candidate[j, c]:
            continue
        arm = abs(moment - (px[c] * fy - py[c] * fx) / length)
        common = max(arm, free[1 - c])
        ax, ay = contacts.normal_plus[j, c, 0], contacts.normal_plus[j, c, 1]
        bx, by = contacts.normal_minus[j, c, 0], contacts.normal_minus[j, c, 1]
        hx, hy = friction_ray(ax, ay, mu, PLUS)
        lx, ly = friction_ray(bx, by, mu, MINUS)
        norm_h = np.sqrt(hx * hx + hy * hy)
        norm_l = np.sqrt(lx * lx + ly * ly)
        if known == 0:
            outside = max(0.0, cross(hx, hy, fx, fy) / norm_h, cross(fx, fy, lx, ly) / norm_l)
            best = min(best, max(common, outside, abs(ux[c]), abs(uy[c])))
        for slip in (PLUS, MINUS):
            if known == -slip:
                continue
            nx, ny, rx, ry, norm = ax, ay, hx, hy, norm_h
            if slip == MINUS:
                nx, ny, rx, ry, norm = bx, by, lx, ly, norm_l
            off_ray = abs(cross(rx, ry, fx, fy)) / norm
            pull = max(0.0, -(rx * fx + ry * fy) / norm)
            gap_rate = abs(nx * ux[c] + ny * uy[c])
            wrong = 0.0 if known == slip else max(0.0, slip * (nx * uy[c] - ny * ux[c]))
            best = min(best, max(common, off_ray, pull, gap_rate, wrong))

    if contacts.candidate[j, 0] and contacts.candidate[j, 1]:
        nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
        normal_force = nx * fx + ny * fy
        tangential = nx * fy - ny * fx
        half = cross(px[0], py[0], nx, ny) / length
        difference = moment / half
        pull = max(0.0, -0.5 * (normal_force + difference), -0.5 * (normal_force - difference))
        gap_rate = max(abs(nx * ux[0] + ny * uy[0]), abs(nx * ux[1] + ny * uy[1]))
        slip_rate = 0.5 * (nx * (uy[0] + uy[1]) - ny * (ux[0] + ux[1]))
        common = max(pull, gap_rate)
        if known == 0:
            bound = np.inf if np.isinf(mu) else mu * max(normal_force, 0.0)
            outside = max(0.0, abs(tangential) - bound)
            best = min(best, max(common, outside, abs(slip_rate)))
        if not np.isinf(mu):
            for slip in (PLUS, MINUS):
                if known == -slip:
                    continue
                off_ray = abs(tangential - slip * mu * normal_force)
                wrong = 0.0 if known == slip else max(0.0, slip * slip_rate)
                best = min(best, max(common, off_ray, wrong))
    return best


@allocating
def contact_residual(contacts, friction, relative, reaction, pivot, scale, force_scale):
    """Largest `joint_residual` of a chain.

    See `joint_residual` for the parameters.

    Returns
    -------
    float
        Dimensionless.
    """
    largest = 0.0
    for j in range(reaction.shape[0]):
        value = joint_residual(
            j, contacts, friction, relative, reaction, pivot, scale, force_scale
        )
        largest = max(largest, value)
    return largest


@allocating
def solution_residual(contacts, friction, free, work, least_scale):
    """Largest residual of a contact problem as `work` holds it.

    Parameters
    ----------
    contacts : Contacts
    friction : ndarray, (n_joint,)
    free : ndarray, (n_body, 3)
        Velocities or accelerations without reactions.
    work : ContactWork
        ``work.relative`` is overwritten.
    least_scale : float
        Velocity or acceleration that counts as one where nothing would move faster.

    Returns
    -------
    float
        Dimensionless; 0 without any reaction.
    """
    scale = max(velocity_scale(contacts, free, work), least_scale)
    force_scale = 0.0
    for j in range(work.mode.size):
        force_scale = max(force_scale, abs(work.reaction[j, 0]), abs(work.reaction[j, 1]))
    if force_scale == 0.0:
        return 0.0
    relative_velocity(contacts, work.velocity, work.pivot, work.relative)
    return contact_residual(
        contacts, friction, work.relative, work.reaction, work.pivot, scale, force_scale
    )
