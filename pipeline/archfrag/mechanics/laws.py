"""Signorini's and Coulomb's laws at one joint, one formula per function.

A joint has two corners, 0 (intrados) and 1 (extrados). Which of them touch, and whether they
stick or slide, is its *mode*. Vectors are written in the ground frame and belong to the body
after the joint relative to the body before it; the tangent is the normal rotated by +90 degrees.

At an open joint the two faces have different normals and Signorini's law splits into Eqs 23a
and 23b. Where two vertices meet, the first holds for slip that brings the later body's vertex
over the earlier body's face, the second for the opposite slip; sticking needs a reaction inside
both Coulomb cones. So a corner has a normal for either direction of slip, `normal_plus` and
`normal_minus`; at a closed joint and at a vertex inside a face they are one.
"""

import math

from archfrag.mechanics.compile import kernel

OPEN = 0
CORNER_STICK = (1, 4)
CORNER_PLUS = (2, 5)
CORNER_MINUS = (3, 6)
CLOSED_STICK = 7
CLOSED_PLUS = 8
CLOSED_MINUS = 9

STICK = 0
PLUS = 1
MINUS = -1


@kernel
def corner_mode(corner, slip):
    """Mode of a joint that touches at one corner only."""
    return 1 + 3 * corner + (0 if slip == STICK else (1 if slip == PLUS else 2))


@kernel
def closed_mode(slip):
    """Mode of a joint that touches at both corners."""
    return CLOSED_STICK + (0 if slip == STICK else (1 if slip == PLUS else 2))


@kernel
def signorini_violation(gap_rate, normal_force):
    """Amount by which Signorini's law (Eq 5) fails, both arguments made dimensionless.

    The natural residual: zero exactly where ``0 <= gap_rate`` and ``0 <= normal_force`` and
    one of them is zero.
    """
    return abs(min(gap_rate, normal_force))


@kernel
def coulomb_violation(slip_rate, normal_force, tangential_force, friction):
    """Amount by which Coulomb's law (Eq 6) fails, arguments made dimensionless.

    The natural residual of the projection of ``tangential_force - slip_rate`` on the interval
    of admissible friction forces.
    """
    if math.isinf(friction):
        return abs(slip_rate) if normal_force > 0.0 else abs(tangential_force)
    bound = friction * max(normal_force, 0.0)
    trial = tangential_force - slip_rate
    return abs(tangential_force - min(max(trial, -bound), bound))
