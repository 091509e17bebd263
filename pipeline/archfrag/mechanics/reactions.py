"""First and second level: reactions of mega-voussoirs, then of the voussoirs inside them.

First level (Sinopoli, section 3.3): the boundary reactions of the mega-voussoirs. For three of
them with four hinges they follow in closed form from the rotation centre of the middle one (Eqs
29-33, `four_hinges`); for any other mechanism from the joints of the few bodies
(`archfrag.mechanics.mechanism.accelerate`).

The paper takes the whole reaction at the hinges C12 and C23 to point at the rotation centre C2.
That holds for the part in the plane orthogonal to the middle body's motion (Eqs 30-33). The part
along the velocity of the hinge, through which the outer bodies take or give power, follows from
their balance of moments about C1 and C3; without it the outer bodies would move without weight
and inertia.

Second level (section 3.4): inside a mega-voussoir the balance is propagated from joint to joint;
it gives the contact centre e of Eq 34, and with it new hinges and slides.
"""

import numpy as np

from archfrag.mechanics.compile import inlined, kernel
from archfrag.mechanics.laws import CORNER_STICK, MINUS, PLUS, closed_mode, cross

N_LAW = 4
# Lines to the rotation centre closer to parallel than this leave too few digits (sine).
PARALLEL = 1e-3


@kernel
def is_four_hinges(mode, n_mega):
    """Whether the joints are the four hinges, none sliding, of three mega-voussoirs."""
    hinges = 0
    for j in range(mode.size):
        hinges += mode[j] == CORNER_STICK[0] or mode[j] == CORNER_STICK[1]
    return n_mega == 3 and mode.size == 4 and hinges == 4


@inlined
def _hinge(contacts, j, mode):
    c = 0 if mode[j] == CORNER_STICK[0] else 1
    return contacts.point[j, c, 0], contacts.point[j, c, 1]


@inlined
def _driven(contacts, k, c1x, c1y, c12x, c12y, c3x, c3y, px, py, u1, u2, u3, a1, a3, w1, w2, w3):
    """Arm of a body from the hinge it turns about, its rates, and those of that hinge."""
    if k == 0:
        rx, ry = contacts.centroid[0, 0] - c1x, contacts.centroid[0, 1] - c1y
        return rx, ry, u1, a1, w1, 0.0, 0.0, 0.0, 0.0
    if k == 2:
        rx, ry = contacts.centroid[2, 0] - c3x, contacts.centroid[2, 1] - c3y
        return rx, ry, u3, a3, w3, 0.0, 0.0, 0.0, 0.0
    rx, ry = contacts.centroid[1, 0] - c12x, contacts.centroid[1, 1] - c12y
    bx, by = -a1 * py - w1 * w1 * px, a1 * px - w1 * w1 * py
    return rx, ry, u2, 0.0, w2, -u1 * py, u1 * px, bx, by


@kernel
def four_hinges(mass, inertia, velocity, free, contacts, work):
    """Accelerations and reactions of three bodies hinged to each other and to the ground.

    Parameters
    ----------
    mass, inertia : ndarray, (3,) [kg], [kg m2]
    velocity : ndarray, (3, 3)
    free : ndarray, (3, 3)
        Accelerations without reactions [m/s2], [rad/s2].
    contacts : Contacts
        Placed.
    work : ContactWork
        `mode` holds the hinges; `velocity` (accelerations), `reaction` and `pivot` (the
        hinges) are overwritten.

    Returns
    -------
    bool
        False where the rotation centre of the middle body is so far off that the reactions do
        not follow from it.
    """
    c1x, c1y = _hinge(contacts, 0, work.mode)
    c12x, c12y = _hinge(contacts, 1, work.mode)
    c23x, c23y = _hinge(contacts, 2, work.mode)
    c3x, c3y = _hinge(contacts, 3, work.mode)
    px, py = c12x - c1x, c12y - c1y
    qx, qy = c23x - c3x, c23y - c3y
    dx, dy = c23x - c12x, c23y - c12y
    length_p, length_q = np.sqrt(px * px + py * py), np.sqrt(qx * qx + qy * qy)
    sine = cross(px, py, qx, qy) / (length_p * length_q)
    if abs(sine) < PARALLEL:
        return False
    # The mechanism u: rates of the three bodies for which the hinges stay closed.
    u1, u2, u3 = cross(dx, dy, qx, qy), -cross(px, py, qx, qy), -cross(px, py, dx, dy)
    w1, w2, w3 = velocity[0, 2], velocity[1, 2], velocity[2, 2]
    # Centripetal terms (Eqs 17, 18), with no angular acceleration of the middle body.
    ex = w1 * w1 * px + w2 * w2 * dx - w3 * w3 * qx
    ey = w1 * w1 * py + w2 * w2 * dy - w3 * w3 * qy
    scale = cross(px, py, qx, qy)
    a1 = (ex * qx + ey * qy) / scale
    a3 = (ex * px + ey * py) / scale
    # Balance along the mechanism (Eq 28 with inertia) gives the one unknown acceleration.
    along = against = 0.0
    for k in range(3):
        rx, ry, u, a, w, vx, vy, bx, by = _driven(
            contacts, k, c1x, c1y, c12x, c12y, c3x, c3y, px, py, u1, u2, u3, a1, a3, w1, w2, w3
        )
        ux, uy = vx - u * ry, vy + u * rx
        gx = bx - a * ry - w * w * rx
        gy = by + a * rx - w * w * ry
        work.velocity[k, 0], work.velocity[k, 1], work.velocity[k, 2] = gx, gy, a
        along += mass[k] * (ux * ux + uy * uy) + inertia[k] * u * u
        against += mass[k] * (ux * (free[k, 0] - gx) + uy * (free[k, 1] - gy))
        against += inertia[k] * u * (free[k, 2] - a)
    rate = against / along
    for k in range(3):
        rx, ry, u, a, w, vx, vy, bx, by = _driven(
            contacts, k, c1x, c1y, c12x, c12y, c3x, c3y, px, py, u1, u2, u3, a1, a3, w1, w2, w3
        )
        work.velocity[k, 0] += rate * (vx - u * ry)
        work.velocity[k, 1] += rate * (vy + u * rx)
        work.velocity[k, 2] += rate * u
    _hinge_reactions(
        mass, inertia, free, contacts, work, c1x, c1y, c12x, c12y, c23x, c23y, c3x, c3y
    )
    return True


@inlined
def _unbalanced(mass, inertia, free, work, k):
    """Force and moment about the centroid that the reactions of a body have to supply."""
    fx = mass[k] * (work.velocity[k, 0] - free[k, 0])
    fy = mass[k] * (work.velocity[k, 1] - free[k, 1])
    return fx, fy, inertia[k] * (work.velocity[k, 2] - free[k, 2])


@kernel
def _hinge_reactions(
    mass, inertia, free, contacts, work, c1x, c1y, c12x, c12y, c23x, c23y, c3x, c3y
):
    """Reactions at four hinges for given accelerations (Eqs 29-33)."""
    px, py = c12x - c1x, c12y - c1y
    qx, qy = c23x - c3x, c23y - c3y
    norm = np.sqrt(px * px + py * py)
    px, py = px / norm, py / norm
    f1x, f1y, m1 = _unbalanced(mass, inertia, free, work, 0)
    rx, ry = contacts.centroid[0, 0] - c1x, contacts.centroid[0, 1] - c1y
    # Moments of body 1 about C1: the part of the reaction on body 2 across p.
    t12 = -(m1 + cross(rx, ry, f1x, f1y)) / norm
    norm = np.sqrt(qx * qx + qy * qy)
    qx, qy = qx / norm, qy / norm
    f3x, f3y, m3 = _unbalanced(mass, inertia, free, work, 2)
    rx, ry = contacts.centroid[2, 0] - c3x, contacts.centroid[2, 1] - c3y
    t32 = -(m3 + cross(rx, ry, f3x, f3y)) / norm
    f2x, f2y, _ = _unbalanced(mass, inertia, free, work, 1)
    # What is left for the parts along p and q, which meet at C2 (Eq 33).
    fx = f2x + t12 * py + t32 * qy
    fy = f2y - t12 * px - t32 * qx
    sine = cross(px, py, qx, qy)
    r12 = cross(fx, fy, qx, qy) / sine
    r32 = cross(px, py, fx, fy) / sine
    r12x, r12y = r12 * px - t12 * py, r12 * py + t12 * px
    r32x, r32y = r32 * qx - t32 * qy, r32 * qy + t32 * qx
    reaction = work.reaction
    for j in range(4):
        reaction[j, 2] = 0.0
    reaction[0, 0], reaction[0, 1] = f1x + r12x, f1y + r12y
    reaction[1, 0], reaction[1, 1] = r12x, r12y
    reaction[2, 0], reaction[2, 1] = -r32x, -r32y
    reaction[3, 0], reaction[3, 1] = -(f3x + r32x), -(f3y + r32y)
    work.pivot[0, 0], work.pivot[0, 1] = c1x, c1y
    work.pivot[1, 0], work.pivot[1, 1] = c12x, c12y
    work.pivot[2, 0], work.pivot[2, 1] = c23x, c23y
    work.pivot[3, 0], work.pivot[3, 1] = c3x, c3y


@inlined
def _law_margins(j, fx, fy, moment, mechanism, friction, share, value):
    """Second level at one closed joint: what is left of Signorini's and Coulomb's laws.

    The forces at the two corners are those whose resultant acts at the contact centre of Eq 34:
    e = force at corner 1 over their sum.
    """
    nx, ny = mechanism.inner_normal[j, 0], mechanism.inner_normal[j, 1]
    x0, y0 = mechanism.inner_point[j, 0, 0], mechanism.inner_point[j, 0, 1]
    x1, y1 = mechanism.inner_point[j, 1, 0], mechanism.inner_point[j, 1, 1]
    half = cross(x0 - x1, y0 - y1, nx, ny)
    value[j, 0] = share * (moment - cross(x1, y1, fx, fy)) / half
    value[j, 1] = -share * (moment - cross(x0, y0, fx, fy)) / half
    value[j, 2] = np.inf
    value[j, 3] = np.inf
    if not np.isinf(friction):
        bound = friction * (fx * nx + fy * ny)
        shear = fy * nx - fx * ny
        value[j, 2] = share * (bound - shear)
        value[j, 3] = share * (bound + shear)


@kernel
def inner_target(k):
    """Contact mode that a closed joint takes where its law `k` of `inner_margins` ends."""
    if k == 0:
        return CORNER_STICK[1]
    if k == 1:
        return CORNER_STICK[0]
    return closed_mode(PLUS if k == 2 else MINUS)


@kernel
def inner_margins(chain, mechanism, position, velocity, work, push_x, push_y, share, value):
    """Second level: margins of the contact laws at all joints inside mega-voussoirs (Eqs 34-35).

    Parameters
    ----------
    chain : Chain
        The voussoirs.
    mechanism : Mechanism
    position, velocity : ndarray, (>= n_mega, 3)
        Of the mega-voussoirs.
    work : ContactWork
        Of the mega-voussoirs: accelerations in `velocity`, boundary reactions in `reaction`.
    push_x, push_y : float
        Acceleration that the ground takes from the bodies, gravity included [m/s2].
    share : float
        What margins are multiplied by; one over the weight makes them dimensionless.
    value : ndarray, (n_joint, 4)
        Overwritten for closed joints that stick: force at corner 0, at corner 1, Coulomb's margin
        for slip PLUS and MINUS.

    Returns
    -------
    worst : float
        The smallest of them; inf if there is no such joint.
    """
    n_body = chain.mass.size
    n_mega, n_mega_joint = mechanism.count[0], mechanism.count[1]
    worst = np.inf
    for k in range(n_mega):
        c, s = np.cos(position[k, 2]), np.sin(position[k, 2])
        fx, fy = work.reaction[k, 0], work.reaction[k, 1]
        rx, ry = work.pivot[k, 0] - position[k, 0], work.pivot[k, 1] - position[k, 1]
        moment = work.reaction[k, 2] + cross(rx, ry, fx, fy)
        fx, fy = c * fx + s * fy, c * fy - s * fx
        gx, gy = work.velocity[k, 0] + push_x, work.velocity[k, 1] + push_y
        gx, gy = c * gx + s * gy, c * gy - s * gx
        turn, square = work.velocity[k, 2], velocity[k, 2] * velocity[k, 2]
        for i in range(mechanism.first[k], mechanism.last[k]):
            x, y = mechanism.offset[i, 0], mechanism.offset[i, 1]
            hx = chain.mass[i] * (gx - turn * y - square * x)
            hy = chain.mass[i] * (gy + turn * x - square * y)
            fx -= hx
            fy -= hy
            moment -= cross(x, y, hx, hy) + chain.inertia[i] * turn
            _law_margins(i + 1, fx, fy, moment, mechanism, chain.friction[i + 1], share, value)
            for law in range(N_LAW):
                worst = min(worst, value[i + 1, law])
    if n_mega_joint == 0:
        return worst
    j = mechanism.joint[0]
    fx, fy = work.reaction[0, 0], work.reaction[0, 1]
    moment = work.reaction[0, 2] + cross(work.pivot[0, 0], work.pivot[0, 1], fx, fy)
    for i in range(j - 1, -1, -1):
        hx, hy = chain.mass[i] * push_x, chain.mass[i] * push_y
        fx += hx
        fy += hy
        moment += cross(mechanism.offset[i, 0], mechanism.offset[i, 1], hx, hy)
        _law_margins(i, fx, fy, moment, mechanism, chain.friction[i], share, value)
        for law in range(N_LAW):
            worst = min(worst, value[i, law])
    if value.shape[0] == n_body:
        return worst
    k = n_mega_joint - 1
    fx, fy = work.reaction[k, 0], work.reaction[k, 1]
    moment = work.reaction[k, 2] + cross(work.pivot[k, 0], work.pivot[k, 1], fx, fy)
    for i in range(mechanism.joint[k], n_body):
        hx, hy = chain.mass[i] * push_x, chain.mass[i] * push_y
        fx -= hx
        fy -= hy
        moment -= cross(mechanism.offset[i, 0], mechanism.offset[i, 1], hx, hy)
        _law_margins(i + 1, fx, fy, moment, mechanism, chain.friction[i + 1], share, value)
        for law in range(N_LAW):
            worst = min(worst, value[i + 1, law])
    return worst
