"""Dynamics of the arch as a linkage: Lagrange's equation, pin forces, impact.

The equation of motion and its sources are those of `archfrag.mechanics.linkage`. Pin forces
follow from Newton's and Euler's laws of each body, which are one equation more than unknowns:
what is left of them checks Lagrange's equation at every step.
"""

import numpy as np

from archfrag.mechanics.compile import kernel
from archfrag.mechanics.kinematics import unit_tangent
from archfrag.mechanics.linkage import N_BAR, N_PIN, body_span, pose_linkage, rotate


@kernel
def inertia_of(linkage, pose):
    """Generalised mass M and half its derivative M'/2 [kg m2]."""
    mass = half = 0.0
    for k in range(linkage.count[0]):
        m, inertia = linkage.mass[k], linkage.inertia[k]
        sx, sy = pose.slope[k, 0], pose.slope[k, 1]
        mass += m * (sx * sx + sy * sy) + inertia * pose.rate[k] ** 2
        half += m * (sx * pose.bend[k, 0] + sy * pose.bend[k, 1])
        half += inertia * pose.rate[k] * pose.curve[k]
    return mass, half


@kernel
def first_moments(linkage, pose):
    """Sums of m x' and m y' [kg m]: generalised forces of unit accelerations."""
    sx = sy = 0.0
    for k in range(linkage.count[0]):
        sx += linkage.mass[k] * pose.slope[k, 0]
        sy += linkage.mass[k] * pose.slope[k, 1]
    return sx, sy


@kernel
def height_moment(linkage, pose):
    """Sum of m y over the bodies that move [kg m]."""
    total = 0.0
    for k in range(linkage.count[0]):
        total += linkage.mass[k] * pose.centroid[k, 1]
    return total


@kernel
def accelerate(linkage, pose, q, speed, gx, gy, gravity):
    """Lagrange's equation of motion.

    Parameters
    ----------
    linkage : Linkage
    pose : Pose
        Overwritten with the configuration.
    q, speed : float [rad], [rad/s]
    gx, gy, gravity : float
        Ground acceleration and gravity [m/s2].

    Returns
    -------
    acceleration : float
        Of q [rad/s2]; nan where the linkage does not reach.
    power : float
        Of the ground's inertia forces [W].
    """
    if not pose_linkage(linkage, q, pose):
        return np.nan, np.nan
    mass, half = inertia_of(linkage, pose)
    sx, sy = first_moments(linkage, pose)
    acceleration = -(half * speed * speed + gx * sx + (gravity + gy) * sy) / mass
    return acceleration, -speed * (gx * sx + gy * sy)


@kernel
def find_forces(linkage, pose, speed, acceleration, gx, gy, gravity):
    """Forces at the pins, by Newton's and Euler's laws for each body, into ``pose.force``.

    Parameters
    ----------
    linkage : Linkage
    pose : Pose
        Posed.
    speed, acceleration : float [rad/s], [rad/s2]
    gx, gy, gravity : float [m/s2]

    Returns
    -------
    float
        What is left of the bodies' balance of moments, which is overdetermined by Lagrange's
        equation, over weight times the length of the bars: zero but for rounding.
    """
    n, force, bar = linkage.count[0], pose.force, pose.bar
    # Change of force from pin to pin, and moments about the pin after each bar.
    fx = fy = 0.0
    xx = xy = yy = rx = ry = 0.0
    weight = size = 0.0
    for k in range(n):
        bx = -linkage.mass[k] * (gx + pose.slope[k, 0] * acceleration + pose.bend[k, 0] * speed**2)
        by = pose.slope[k, 1] * acceleration + pose.bend[k, 1] * speed**2
        by = -linkage.mass[k] * (gravity + gy + by)
        spin = linkage.inertia[k] * (pose.rate[k] * acceleration + pose.curve[k] * speed**2)
        if n == 1:
            force[0, 0], force[0, 1] = -bx, -by
            return 0.0
        cx = pose.centroid[k, 0] - pose.pin[k + 1, 0]
        cy = pose.centroid[k, 1] - pose.pin[k + 1, 1]
        # bar x (F_0 + f) = m with F_0 unknown: normal equations of three rows.
        moment = cx * by - cy * bx - spin
        moment -= bar[k, 0] * fy - bar[k, 1] * fx
        px, py = -bar[k, 1], bar[k, 0]
        xx += px * px
        xy += px * py
        yy += py * py
        rx += px * moment
        ry += py * moment
        fx += bx
        fy += by
        force[k + 1, 0], force[k + 1, 1] = fx, fy
        weight += linkage.mass[k] * gravity
        size += abs(bar[k, 0]) + abs(bar[k, 1])
    det = xx * yy - xy * xy
    force[0, 0] = (rx * yy - ry * xy) / det
    force[0, 1] = (ry * xx - rx * xy) / det
    for k in range(1, N_PIN):
        force[k, 0] += force[0, 0]
        force[k, 1] += force[0, 1]
    worst = 0.0
    for k in range(N_BAR):
        cx = pose.centroid[k, 0] - pose.pin[k + 1, 0]
        cy = pose.centroid[k, 1] - pose.pin[k + 1, 1]
        bx, by = force[k + 1, 0] - force[k, 0], force[k + 1, 1] - force[k, 1]
        spin = linkage.inertia[k] * (pose.rate[k] * acceleration + pose.curve[k] * speed**2)
        moment = cx * by - cy * bx - spin
        moment -= bar[k, 0] * force[k, 1] - bar[k, 1] * force[k, 0]
        worst = max(worst, abs(moment))
    return worst / (weight * size)


@kernel
def pin_press(chain, linkage, pose, k):
    """Force that presses the joint of pin `k` together [N]; negative: a pull.

    Along the normal halfway between the joint's two faces.
    """
    j, n, n_body = linkage.joint[k], linkage.count[0], chain.mass.size
    ax, ay = unit_tangent(chain.face_before[j])
    bx, by = unit_tangent(chain.face_after[j])
    if k > 0:
        ax, ay = rotate(pose.turn[k - 1], ax, ay)
    if k < n and j < n_body:
        bx, by = rotate(pose.turn[k], bx, by)
    tx, ty = ax + bx, ay + by
    return (pose.force[k, 0] * ty - pose.force[k, 1] * tx) / np.sqrt(tx * tx + ty * ty)


@kernel
def carry(chain, linkage, pose, speed, position, velocity):
    """Positions and velocities of all voussoirs, carried by their bodies.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    linkage : Linkage
    pose : Pose
        Posed.
    speed : float [rad/s]
    position, velocity : ndarray, (n_body, 3)
        Overwritten.
    """
    n_body = chain.mass.size
    for i in range(n_body):
        position[i, 0], position[i, 1] = chain.centroid[i, 0], chain.centroid[i, 1]
        position[i, 2] = 0.0
        velocity[i, 0] = velocity[i, 1] = velocity[i, 2] = 0.0
    for k in range(linkage.count[0]):
        first, end = body_span(linkage, k, n_body)
        for i in range(first, end):
            dx = chain.centroid[i, 0] - linkage.pin[k, 0] - linkage.arm[k, 0]
            dy = chain.centroid[i, 1] - linkage.pin[k, 1] - linkage.arm[k, 1]
            x, y = rotate(pose.turn[k], dx, dy)
            spin = speed * pose.rate[k]
            position[i, 0] = pose.centroid[k, 0] + x
            position[i, 1] = pose.centroid[k, 1] + y
            position[i, 2] = pose.turn[k]
            velocity[i, 0] = speed * pose.slope[k, 0] - spin * y
            velocity[i, 1] = speed * pose.slope[k, 1] + spin * x
            velocity[i, 2] = spin


@kernel
def _pass_joint(chain, i, position, ax, ay, spin, reaction, mid, onward):
    """Reaction on the far side of voussoir `i` from that on its near side.

    `onward` from joint ``i`` to ``i + 1``, else back; `ax`, `ay` with gravity and the ground's.
    """
    near, far, sign = (i, i + 1, 1.0) if onward else (i + 1, i, -1.0)
    x, y = position[i, 0], position[i, 1]
    fx, fy = reaction[near, 0], reaction[near, 1]
    gx, gy = fx - sign * chain.mass[i] * ax, fy - sign * chain.mass[i] * ay
    moment = reaction[near, 2] - sign * chain.inertia[i] * spin
    moment += (mid[near, 0] - x) * fy - (mid[near, 1] - y) * fx
    moment -= (mid[far, 0] - x) * gy - (mid[far, 1] - y) * gx
    reaction[far, 0], reaction[far, 1], reaction[far, 2] = gx, gy, moment


@kernel
def joint_reactions(chain, linkage, pose, position, speed, acceleration, gx, gy, mid, reaction):
    """Reactions at all joints of a linkage in motion, voussoir by voussoir from its pins.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    linkage : Linkage
    pose : Pose
        Posed, with the forces at its pins.
    position : ndarray, (n_body, 3)
        Of all voussoirs.
    speed, acceleration : float [rad/s], [rad/s2]
    gx, gy : float [m/s2]
    mid : ndarray, (n_joint, 2)
        Middles of the joints [m].
    reaction : ndarray, (n_joint, 3)
        Overwritten: force on the voussoir after each joint and moment about its middle.
    """
    n_body, n_joint = chain.mass.size, reaction.shape[0]
    start = linkage.joint[0]
    fx, fy = pose.force[0, 0], pose.force[0, 1]
    reaction[start, 0], reaction[start, 1] = fx, fy
    arm_x, arm_y = pose.pin[0, 0] - mid[start, 0], pose.pin[0, 1] - mid[start, 1]
    reaction[start, 2] = arm_x * fy - arm_y * fx
    upward = chain.gravity + gy
    for back in range(start):
        i = start - 1 - back
        _pass_joint(chain, i, position, gx, upward, 0.0, reaction, mid, False)
    for k in range(linkage.count[0]):
        first, end = body_span(linkage, k, n_body)
        turning = speed * pose.rate[k]
        spin = pose.rate[k] * acceleration + pose.curve[k] * speed * speed
        ax = gx + pose.slope[k, 0] * acceleration + pose.bend[k, 0] * speed * speed
        ay = upward + pose.slope[k, 1] * acceleration + pose.bend[k, 1] * speed * speed
        for i in range(first, end):
            if i + 1 >= n_joint:
                return
            dx = position[i, 0] - pose.centroid[k, 0]
            dy = position[i, 1] - pose.centroid[k, 1]
            own_x = ax - spin * dy - turning * turning * dx
            own_y = ay + spin * dx - turning * turning * dy
            _pass_joint(chain, i, position, own_x, own_y, spin, reaction, mid, True)
    if linkage.count[0] == N_BAR:
        for i in range(linkage.joint[N_BAR], n_body):
            _pass_joint(chain, i, position, gx, upward, 0.0, reaction, mid, True)


@kernel
def speed_after_impact(chain, unit, before):
    """Speed at which a linkage leaves the undeformed shape after an impact there.

    All impulses but those at its pins are inside its three bodies, so that in every admissible
    virtual motion, that is in its own, the momentum gained does no work: this is the impulse
    balance of the three bodies, four pin impulses and one speed in nine equations, with the
    impulses eliminated (De Lorenzis, DeJong and Ochsendorf 2007, Earthquake Engng Struct. Dyn.
    36, 2119-2136).

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    unit : ndarray, (n_body, 3)
        Velocities of the voussoirs at the undeformed shape by the linkage after the impact at
        unit speed.
    before : ndarray, (n_body, 3)
        Velocities before the impact.

    Returns
    -------
    float
        [rad/s]; not positive where the mechanism would have to close.
    """
    shared = own = 0.0
    for i in range(chain.mass.size):
        m, inertia = chain.mass[i], chain.inertia[i]
        shared += m * (unit[i, 0] * before[i, 0] + unit[i, 1] * before[i, 1])
        shared += inertia * unit[i, 2] * before[i, 2]
        own += m * (unit[i, 0] ** 2 + unit[i, 1] ** 2) + inertia * unit[i, 2] ** 2
    return shared / own
