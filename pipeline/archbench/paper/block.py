"""The single block on the ground: Eqs 1 to 21 of Sinopoli's paper.

The Lagrangian coordinates are the place of the mass centre G and the rotation, each multiplied by
the root of its mass or inertia, u = (sqrt(m) x, sqrt(m) y, sqrt(I) theta). In this metric of
kinetic energy 2T is the square of the velocity's length and no mass matrix is left in any
balance. The rows of a gradient (2, 3) are N_t and N_n of a contact point; arms are relative to G.

The ground is the x axis of a frame that moves with it, t points along +x and n upwards; rotations
are positive counter-clockwise. The base runs from corner A, at the end towards -t, to corner B.
A ground that accelerates towards +t tips the block over A.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
CORNER_A = -1  # also minus the sense of a rotation about them
CORNER_B = 1
NO_PROJECTIONS = np.zeros(2)
SAME = 1e-9


class RigidBlock(NamedTuple):
    """A body with a flat base AB; any distribution of mass."""

    mass: float  # [kg]
    inertia: float  # about the mass centre G [kg m2]
    reach_a: float  # from corner A to the foot of G on the base [m]
    reach_b: float  # from the foot of G to corner B [m]
    rise: float  # of G above the base [m]


class Mechanism(IntEnum):
    """How a block moves, or starts to move."""

    REST = 0  # the whole base stays
    SLIDE = 1  # the whole base slides
    ROCK = 2  # rotates about a corner that does not slide
    SLIDE_ROCK = 3  # rotates about a corner that slides
    LIFT_OFF = 4  # no reaction: the ground does not hold the block


REST, SLIDE, ROCK, SLIDE_ROCK, LIFT_OFF = Mechanism


class BlockMotion(NamedTuple):
    """Forces and accelerations of smooth dynamics; impulses and velocities after an impact."""

    mechanism: Mechanism
    solutions: int  # how many motions obey all laws; not one only in Painleve's paradox
    side: int  # CORNER_A or CORNER_B where contact is at a corner, 0 otherwise
    centre: float  # e of the contact centre (Eq 14) [1]; nan without a reaction
    tangential: float  # R_t [N], or I_t [N s]
    normal: float  # R_n [N], or I_n [N s]
    x: float  # of G along t [m/s2], or [m/s]
    y: float  # of G along n
    rotation: float  # [rad/s2], or [rad/s]
    slip: float  # of the contact along t [m/s2], or [m/s]


def uniform_block(base: float, height: float, mass: float) -> RigidBlock:
    """Rectangular block of uniform density: lengths of its sides [m], mass [kg]."""
    inertia = mass * (base * base + height * height) / 12.0
    return RigidBlock(mass, inertia, 0.5 * base, 0.5 * base, 0.5 * height)


def reach(block: RigidBlock, side: int) -> float:
    """Distance along the base from the foot of G to a corner [m]."""
    return block.reach_a if side == CORNER_A else block.reach_b


def arm_to(along: float, up: float, rotation: float) -> Array:
    """Place relative to G, (t, n), of a point given in the block's own axes [m]."""
    c = math.cos(rotation)
    s = math.sin(rotation)
    return np.array([c * along - s * up, s * along + c * up])


def corner_arm(block: RigidBlock, side: int, rotation: float) -> Array:
    """Place of a corner of the base relative to G [m]."""
    return arm_to(side * reach(block, side), -block.rise, rotation)


def metric(block: RigidBlock) -> Array:
    """Roots of mass, mass and inertia: u is metric times (x, y, theta)."""
    return np.sqrt([block.mass, block.mass, block.inertia])


def active_force(
    block: RigidBlock, ground_x: float, ground_y: float, gravity: float
) -> Array:
    """S of weight and a ground acceleration, k_s along +t and k_v upwards [g]."""
    return metric(block) * [-ground_x * gravity, -(1.0 + ground_y) * gravity, 0.0]


def gradient(block: RigidBlock, arm: Array) -> Array:
    """N_t and N_n: the generalised directions of a point's velocity (Eqs 1, 2)."""
    return np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]]]) / metric(block)


def gradient_rate(block: RigidBlock, arm: Array, angular_velocity: float) -> Array:
    """Time derivatives of N_t and N_n while the block rotates (Eq 17)."""
    rates = [
        [0.0, 0.0, -angular_velocity * arm[0]],
        [0.0, 0.0, -angular_velocity * arm[1]],
    ]
    return np.array(rates) / metric(block)


def point_velocity(n: Array, velocity: Array) -> Array:
    """Tangential and normal velocity of the point of a gradient (Eqs 1, 2) [m/s]."""
    return n @ velocity


def least_normal_velocity(block: RigidBlock, velocity: Array) -> float:
    """Least normal velocity along AB of a block standing flat (Eq 3) [m/s].

    A velocity is admissible where it is not negative; one of the corners has the least.
    """
    sides = (CORNER_A, CORNER_B)
    return min(
        gradient(block, corner_arm(block, side, 0.0))[1] @ velocity for side in sides
    )


def generalised_reaction(n: Array, force: Array) -> Array:
    """Psi_t and Psi_n, (2, 3), of R_t and R_n (Eq 4); Xi_t and Xi_n of impulses (Eqs 8, 9)."""
    return np.asarray(force)[:, None] * n


def signorini(rate: float | Array, normal: float | Array) -> float | Array:
    """Violation of Signorini's law (Eqs 5, 8, 24): a contact opens or is compressed."""
    return np.abs(np.minimum(rate, normal))


def coulomb(slip: float, tangential: float, normal: float, friction: float) -> float:
    """Violation of Coulomb's law (Eqs 6, 9, 25), by the projection on the admissible frictions."""
    bound = friction * max(normal, 0.0)
    return abs(tangential - min(max(tangential - slip, -bound), bound))


def dissipation_excess(
    slip: float, tangential: float, normal: float, friction: float
) -> float:
    """Least value of Eq 7 over Coulomb's interval [W]; zero where the law holds."""
    return -friction * normal * abs(slip) - tangential * slip


def balance(acceleration: Array, active: Array, psi: Array) -> Array:
    """u" - S - Psi_t - Psi_n: what is missing from the dynamic balance (Eqs 10, 15)."""
    return acceleration - active - psi.sum(axis=0)


def impulsive_balance(before: Array, after: Array, xi: Array, virtual: Array) -> float:
    """Virtual work of what is missing from the balance of an impact (Eq 11) [J]."""
    return float(balance(after - before, np.zeros(3), xi) @ virtual)


def power(active: Array, velocity: Array) -> float:
    """S u' [W]: a motion starts only where it is not negative (Eq 12)."""
    return float(active @ velocity)


def least_load(block: RigidBlock, side: int, friction: float) -> float:
    """Least k_s / (1 + k_v) at which a motion starts (Eq 13): Eq 12 of rocking, or sliding."""
    rocking = rocking_mechanism(block, corner_arm(block, side, 0.0), 1.0)
    weight = active_force(block, 0.0, 0.0, 1.0)
    push = active_force(block, 1.0, -1.0, 1.0)
    return min(friction, abs(power(weight, rocking) / power(push, rocking)))


def contact_centre(block: RigidBlock, place: float) -> float:
    """e of a place along the base from the foot of G [m]: 0 at A and 1 at B (Eq 14)."""
    return (place + block.reach_a) / (block.reach_a + block.reach_b)


def rocking_mechanism(block: RigidBlock, arm: Array, angular_velocity: float) -> Array:
    """u'_A that rotates about a contact point; orthogonal to N_t and N_n (Eq 16)."""
    return metric(block) * angular_velocity * [arm[1], -arm[0], 1.0]


def contact_acceleration(
    n: Array, rate: Array, velocity: Array, acceleration: Array
) -> Array:
    """Acceleration of a contact point along t and n (Eq 17) [m/s2]."""
    return n @ acceleration + rate @ velocity


def _in_plane(n: Array, projections: Array) -> Array:
    """Components along N_t and N_n of the vector of plane pi with given projections on them."""
    return np.asarray(np.linalg.solve(n @ n.T, projections))


def centripetal_acceleration(n: Array, rate: Array, velocity: Array) -> Array:
    """u"_A,t and u"_A,n, (2, 3): the part of the acceleration that is known (Eq 18)."""
    return generalised_reaction(n, _in_plane(n, -rate @ velocity))


def part_in_plane(vector: Array, mechanism: Array) -> Array:
    """Part of a vector orthogonal to a mechanism, as S^pi in Eq 19."""
    return vector - (vector @ mechanism) / (mechanism @ mechanism) * mechanism


def sticking_reaction(
    n: Array, active: Array, projections: Array = NO_PROJECTIONS
) -> Array:
    """R_t and R_n that hold a contact point, from the balance in plane pi (Eq 19) [N].

    `active` is S, for an impact the velocity before it (Eq 21); `projections` are what N_t and
    N_n measure on u" (Eq 18), zero for an impact.
    """
    return _in_plane(n, projections - n @ active)


def cone(n: Array, friction: float) -> Array:
    """N+ and N-, the boundaries of Coulomb's cone in plane pi (Eq 20)."""
    return n[1] + np.outer([friction, -friction], n[0])


def inside_cone(tangential: float, normal: float, friction: float) -> bool:
    """Whether a reaction is compressive and lies in Coulomb's cone (Eqs 5, 6, 20)."""
    return normal >= 0.0 and (
        math.isinf(friction) or abs(tangential) <= friction * normal
    )


def _sliding_reaction(
    n: Array, free: float, friction: float, sense: int
) -> Array | None:
    """R_t and R_n of a point that slides, on the cone; None in Painleve's paradox."""
    ray = np.array([-sense, 0.0] if math.isinf(friction) else [-friction * sense, 1.0])
    stiffness = ray @ n @ n[1]
    size = -free / stiffness if stiffness != 0.0 else -1.0
    return size * ray if size > 0.0 else None


def _flat(
    block: RigidBlock, active: Array, friction: float, sense: int, sliding: bool
) -> BlockMotion | None:
    """Rest (sense 0) or sliding of the whole base, where the laws admit it (Eqs 13, 14)."""
    x, y, rotation = active / metric(block)
    normal = -block.mass * y
    if not normal > 0.0 or (sense and math.isinf(friction)):
        return None
    tangential = -sense * friction * normal if sense else -block.mass * x
    slip = x + tangential / block.mass if sense else 0.0
    place = -(block.inertia * rotation + block.rise * tangential) / normal
    holds = sense or inside_cone(tangential, normal, friction)
    if not holds or not -block.reach_a <= place <= block.reach_b:
        return None
    if sense and not (sliding or sense * slip > 0.0):
        return None
    centre = contact_centre(block, place)
    kind = SLIDE if sense else REST
    return BlockMotion(kind, 1, 0, centre, tangential, normal, slip, 0.0, 0.0, slip)


def _corner(
    block: RigidBlock,
    side: int,
    rotation: float,
    active: Array,
    projections: Array,
    friction: float,
    sense: int,
    sliding: bool,
) -> BlockMotion | None:
    """Contact at one corner that sticks (sense 0) or slides, where the laws admit it."""
    n = gradient(block, corner_arm(block, side, rotation))
    if sense == 0:
        force = sticking_reaction(n, active, projections)
        if not inside_cone(force[0], force[1], friction):
            return None
    else:
        found = _sliding_reaction(n, n[1] @ active - projections[1], friction, sense)
        if found is None:
            return None
        force = found
    moved = active + generalised_reaction(n, force).sum(axis=0)
    slip = n[0] @ moved - projections[0] if sense else 0.0
    if sense and not (sliding or sense * slip > 0.0):
        return None
    kind = SLIDE_ROCK if sense else ROCK
    centre = contact_centre(block, side * reach(block, side))
    x, y, spin = moved / metric(block)
    return BlockMotion(kind, 1, side, centre, force[0], force[1], x, y, spin, slip)


def contact_problem(
    block: RigidBlock,
    active: Array,
    friction: float,
    slip: float,
    side: int = 0,
    rotation: float = 0.0,
    projections: Array = NO_PROJECTIONS,
) -> BlockMotion:
    """The motion that obeys all laws, of a block on its base or about a corner (Eqs 12 to 21).

    Starting motion, motion and impact are one problem: S, or the velocity before an impact
    (Eq 21), and the reactions that the laws add to it. Every mechanism is tried. `slip` is that of
    the contact in progress along t [m/s], 0 if there is none and for an impact; `side` is the
    corner in contact, 0 for the base; `projections` are as for `sticking_reaction`.
    """
    corners = (side,) if side else (CORNER_A, CORNER_B)
    gaps = [
        gradient(block, corner_arm(block, each, rotation))[1] @ active
        for each in corners
    ]
    found: list[BlockMotion | None] = []
    if min(gaps) - projections[1] >= 0.0:
        found.append(_without_reaction(block, active, 1))
    for sense in (0, 1, -1):
        if slip != 0.0 and sense * slip <= 0.0:
            continue
        if not side:
            found.append(_flat(block, active, friction, sense, slip != 0.0))
        for each in corners:
            motion = _corner(
                block, each, rotation, active, projections, friction, sense, slip != 0.0
            )
            if side or (motion and each * motion.rotation < 0.0):
                found.append(motion)
    answers = [motion for motion in found if motion is not None]
    if not answers:
        return _without_reaction(block, active, 0)
    first = answers[0]
    speed = math.sqrt(active @ active / block.mass) + np.abs(projections).sum()
    apart = [
        abs(a.x - first.x) + abs(a.y - first.y) + abs(a.slip - first.slip)
        for a in answers
    ]
    return first._replace(solutions=2 if max(apart) > SAME * speed else 1)


def _without_reaction(block: RigidBlock, active: Array, solutions: int) -> BlockMotion:
    x, y, rotation = active / metric(block)
    slip = x + block.rise * rotation
    return BlockMotion(LIFT_OFF, solutions, 0, math.nan, 0.0, 0.0, x, y, rotation, slip)


def starting_motion(
    block: RigidBlock, ground_x: float, ground_y: float, friction: float, gravity: float
) -> BlockMotion:
    """Which motion starts from rest, and with what reactions (section 2.4, Eqs 12 to 20).

    Examples
    --------
    >>> from archbench.paper.block import starting_motion, uniform_block
    >>> block = uniform_block(0.2, 1.0, 400.0)
    >>> for k_s, mu in ((0.1, 0.5), (0.25, 0.5), (0.25, 0.18), (0.25, 0.201), (-0.25, 0.5)):
    ...     start = starting_motion(block, k_s, 0.0, mu, 9.80665)
    ...     print(start.mechanism.name, round(float(start.centre), 3))
    REST 0.25
    ROCK 0.0
    SLIDE 0.05
    SLIDE_ROCK 0.0
    ROCK 1.0
    """
    return contact_problem(
        block, active_force(block, ground_x, ground_y, gravity), friction, 0.0
    )


def corner_motion(
    block: RigidBlock,
    side: int,
    rotation: float,
    angular_velocity: float,
    slip: float,
    active: Array,
    friction: float,
) -> BlockMotion:
    """Accelerations and reactions while a block rotates about a corner (Eqs 15 to 20).

    The rotation is positive about A and negative about B [rad].
    """
    rate = gradient_rate(block, corner_arm(block, side, rotation), angular_velocity)
    known = -rate @ (metric(block) * [0.0, 0.0, angular_velocity])
    return contact_problem(block, active, friction, slip, side, rotation, known)


def rocking_impact(
    block: RigidBlock, side: int, angular_velocity: float, slip: float, friction: float
) -> BlockMotion:
    """Impact at the end of a rocking about a corner (Eqs 8, 9, 11, 21).

    Angular velocity (closing: negative for A, positive for B) and slip of the corner are those
    before it. ROCK, SLIDE_ROCK: the block goes on about one corner. REST, SLIDE: both stay.
    """
    before = rocking_mechanism(block, corner_arm(block, side, 0.0), angular_velocity)
    return contact_problem(
        block, before + metric(block) * [slip, 0.0, 0.0], friction, 0.0
    )


def rocking_acceleration(
    block: RigidBlock, side: int, rotation: float, active: Array
) -> float:
    """Angular acceleration about a corner that sticks: Eq 15 along the mechanism [rad/s2]."""
    rotating = rocking_mechanism(block, corner_arm(block, side, rotation), 1.0)
    return power(active, rotating) / float(rotating @ rotating)
