"""How far motions and reactions are from the contact laws: one measure for every method.

`state_residual` looks at what a method says of one instant and at nothing inside the method:
positions, velocities and reactions. Gaps are measured over joint lengths, slip rates over the
speed of a fall through them, forces over the weight or the largest of them; the residual is the
smallest violation over the ways in which a joint can obey Signorini and Coulomb.
"""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.delassus import relative_velocity
from archfrag.mechanics.kinematics import clearance, corner_offset, place_contacts
from archfrag.mechanics.laws import MINUS, PLUS, STICK, cross, friction_ray
from archfrag.mechanics.status import Peak

# Corners closer than this, over the joint's length, touch.
TOUCHING = 1e-6


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
    contacts : archfrag.mechanics.former_contact.Contacts
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
def state_residual(
    chain, position, velocity, before, after, length, slip, reaction, pivot, span, contacts,
    relative,
):  # fmt: skip
    """How far one instant of a motion is from the contact laws.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    position, velocity : ndarray, (n_body, 3)
    before, after : ndarray, (n_joint, 2, 2)
        Faces there.
    length : ndarray, (n_joint,) [m]
    slip : ndarray, (n_joint,)
        Slip at which each joint sticks or last slid [m].
    reaction : ndarray, (n_joint, 3)
        Force and moment about `pivot` on the body after the joint, or impulses over `span`.
    pivot : ndarray, (n_joint, 2) [m]
    span : float
        One, or the duration of a step whose impulses `reaction` holds [s].
    contacts : archfrag.mechanics.former_contact.Contacts
        Workspace, overwritten.
    relative : ndarray, (n_joint, 3)
        Workspace, overwritten.

    Returns
    -------
    float
        Dimensionless; zero where the laws hold exactly.
    """
    place_contacts(position, before, after, slip, length, contacts)
    relative_velocity(contacts, velocity, pivot, relative)
    force_scale = 0.0
    for i in range(chain.mass.size):
        force_scale += chain.gravity * chain.mass[i] * span
    for j in range(length.size):
        force_scale = max(force_scale, abs(reaction[j, 0]), abs(reaction[j, 1]))
        speed = np.sqrt(chain.gravity * length[j])
        nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
        contacts.slip[j] = STICK
        bears = reaction[j, 0] != 0.0 or reaction[j, 1] != 0.0
        for c in range(2):
            contacts.candidate[j, c] = 1
            gap = clearance(j, c, before, after) / length[j]
            if gap > TOUCHING or not bears:
                # Only the gap counts; how the faces slide past each other does not.
                contacts.bias[j, c, 0] = gap * nx
                contacts.bias[j, c, 1] = gap * ny
                continue
            rx = contacts.point[j, c, 0] - pivot[j, 0]
            ry = contacts.point[j, c, 1] - pivot[j, 1]
            ux = relative[j, 0] - relative[j, 2] * ry
            uy = relative[j, 1] + relative[j, 2] * rx
            rate = (nx * uy - ny * ux) / speed
            ex, ey = corner_offset(j, c, before, after, slip)
            contacts.bias[j, c, 0] = ex / length[j] - rate * ny
            contacts.bias[j, c, 1] = ey / length[j] + rate * nx
    relative[:] = 0.0
    return contact_residual(
        contacts, chain.friction, relative, reaction, pivot, 1.0, force_scale
    )  # fmt: skip


@kernel
def deepest_overlap(before, after, length):
    """Deepest overlap of two neighbours at a corner, over the joint's length; 0 if none."""
    deepest = 0.0
    for j in range(length.size):
        for c in range(2):
            deepest = max(deepest, -clearance(j, c, before, after) / length[j])
    return deepest


@allocating
def measure_state(
    chain, position, velocity, before, after, length, slip, reaction, pivot, span, contacts,
    relative, peak,
):  # fmt: skip
    """Note residual and overlap of one instant in `peak`; arguments as `state_residual`."""
    residual = state_residual(
        chain, position, velocity, before, after, length, slip, reaction, pivot, span, contacts,
        relative,
    )  # fmt: skip
    peak[Peak.RESIDUAL] = max(peak[Peak.RESIDUAL], residual)
    peak[Peak.OVERLAP] = max(peak[Peak.OVERLAP], deepest_overlap(before, after, length))
