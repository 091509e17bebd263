"""The single block on the ground, formula by formula: Eqs 1 to 14 and 21 of Sinopoli's paper.

The Lagrangian coordinates are the place of the mass centre G and the rotation, each multiplied by
the square root of its mass or inertia, u = (sqrt(m) x, sqrt(m) y, sqrt(I) theta). In this metric
of kinetic energy 2T is the square of the velocity's length and no mass matrix is left in any
balance: velocities, accelerations, forces and impulses are vectors of one Euclidean space and are
kept as tuples of three floats. A force times a gradient operator is a generalised reaction.

The ground is the x axis of a frame that moves with it, t points along +x and n upwards; rotations
are positive counter-clockwise. The base runs from corner A, at the end towards -t, to corner B.
A ground that accelerates towards +t tips the block over A. The balance of a contact that lasts,
Eqs 15 to 20, is in `plane`; what is made of it all, starting motion, reactions in motion
and impact, in `motion`; the regions of starting motion in `regions`.
"""

import math
from typing import NamedTuple

from archfrag.mechanics.compile import kernel

# Corners by the end of the base at which they are; also minus the sense of a rotation about them.
CORNER_A = -1
CORNER_B = 1


class RigidBlock(NamedTuple):
    """A body with a flat base AB; any distribution of mass."""

    mass: float  # [kg]
    inertia: float  # about the mass centre G [kg m2]
    reach_a: float  # from corner A to the foot of G on the base [m]
    reach_b: float  # from the foot of G to corner B [m]
    rise: float  # of G above the base [m]


@kernel
def uniform_block(base, height, mass):
    """Rectangular block of uniform density: full lengths of its sides [m], mass [kg]."""
    inertia = mass * (base * base + height * height) / 12.0
    return RigidBlock(mass, inertia, 0.5 * base, 0.5 * base, 0.5 * height)


@kernel
def reach(block, side):
    """Distance along the base from the foot of G to a corner, CORNER_A or CORNER_B [m]."""
    return block.reach_a if side == CORNER_A else block.reach_b


@kernel
def rotated_arm(along, up, rotation):
    """Place relative to G in the ground frame of a point given in the block's own axes [m]."""
    c, s = math.cos(rotation), math.sin(rotation)
    return c * along - s * up, s * along + c * up


@kernel
def corner_arm(block, side, rotation):
    """Place of a corner of the base relative to G, (t, n) [m]."""
    return rotated_arm(side * reach(block, side), -block.rise, rotation)


@kernel
def dot(a, b):
    """Scalar product of two generalised vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def scaled(x, a):
    """x a of a generalised vector."""
    return x * a[0], x * a[1], x * a[2]


@kernel
def combine(x, a, y, b):
    """x a + y b of two generalised vectors."""
    return x * a[0] + y * b[0], x * a[1] + y * b[1], x * a[2] + y * b[2]


@kernel
def generalised(block, x, y, rotation):
    """Velocity or acceleration of G and rotation rate as a generalised vector."""
    root = math.sqrt(block.mass)
    return root * x, root * y, math.sqrt(block.inertia) * rotation


@kernel
def physical(block, vector):
    """Velocity or acceleration of G and rotation rate from a generalised vector."""
    root = math.sqrt(block.mass)
    return vector[0] / root, vector[1] / root, vector[2] / math.sqrt(block.inertia)


@kernel
def active_force(block, ground_x, ground_y, gravity):
    """Generalised force S of weight and a ground acceleration (k_s along +t, k_v upwards) [g]."""
    return generalised(block, -ground_x * gravity, -(1.0 + ground_y) * gravity, 0.0)


@kernel
def tangential_gradient(block, arm):
    """N_P,t, the direction of a point's tangential velocity (Eqs 1, 2); its arm from G [m]."""
    return 1.0 / math.sqrt(block.mass), 0.0, -arm[1] / math.sqrt(block.inertia)


@kernel
def normal_gradient(block, arm):
    """N_P,n, the generalised direction of a point's normal velocity (Eqs 1, 2)."""
    return 0.0, 1.0 / math.sqrt(block.mass), arm[0] / math.sqrt(block.inertia)


@kernel
def tangential_gradient_rate(block, arm, angular_velocity):
    """Time derivative of N_P,t while the block rotates (Eq 17)."""
    return 0.0, 0.0, -angular_velocity * arm[0] / math.sqrt(block.inertia)


@kernel
def normal_gradient_rate(block, arm, angular_velocity):
    """Time derivative of N_P,n while the block rotates (Eq 17)."""
    return 0.0, 0.0, -angular_velocity * arm[1] / math.sqrt(block.inertia)


@kernel
def point_velocity(n_t, n_n, velocity):
    """Tangential and normal velocity of a point from its gradient operator (Eqs 1, 2) [m/s]."""
    return dot(n_t, velocity), dot(n_n, velocity)


@kernel
def least_normal_velocity(block, velocity):
    """Least normal velocity along AB of a block standing flat (Eq 3) [m/s].

    A velocity is admissible where this is not negative. Normal velocities are linear along the
    base, so that one of its corners has the least.
    """
    at_a = dot(normal_gradient(block, corner_arm(block, CORNER_A, 0.0)), velocity)
    at_b = dot(normal_gradient(block, corner_arm(block, CORNER_B, 0.0)), velocity)
    return min(at_a, at_b)


@kernel
def generalised_reaction(n_t, n_n, tangential, normal):
    """Psi_t and Psi_n, a contact's reactions as generalised vectors (Eq 4).

    With impulses in place of forces these are Xi_t and Xi_n of Eqs 8 and 9.
    """
    return scaled(tangential, n_t), scaled(normal, n_n)


@kernel
def least_dissipation_excess(n_t, velocity, normal, tangential, friction):
    """Least value of Eq 7 over Coulomb's interval [W]; zero where the law holds."""
    rate = dot(n_t, velocity)
    return -friction * normal * abs(rate) - tangential * rate


@kernel
def balance(acceleration, active, psi_t, psi_n):
    """u" - S - Psi_t - Psi_n, what is missing from the dynamic balance (Eqs 10, 15)."""
    return combine(
        1.0, combine(1.0, acceleration, -1.0, active), -1.0, combine(1.0, psi_t, 1.0, psi_n)
    )


@kernel
def impulsive_balance(before, after, xi_t, xi_n, virtual):
    """Eq 11: virtual work of what is missing from the balance of an impact [J]."""
    return dot(balance(combine(1.0, after, -1.0, before), (0.0, 0.0, 0.0), xi_t, xi_n), virtual)


@kernel
def contact_centre(block, place):
    """e of a place along the base from the foot of G [m]: 0 at A and 1 at B (Eq 14)."""
    return (place + block.reach_a) / (block.reach_a + block.reach_b)
