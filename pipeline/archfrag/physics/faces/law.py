"""The law of a joint that gives: an elastic face without tension, with Coulomb's friction.

Where two faces overlap, each metre of the joint presses by its stiffness times the overlap. The
gap is linear along the joint, d0 + s d1 at a distance s from its middle, so that force and moment
follow from the moments of the part that overlaps, l_n, the integrals of s^n over it:

    N = -k (d0 l0 + d1 l1),    M = -k (d0 l1 + d1 l2),    t = -k_s l0 z,  |t| <= mu N

A joint that bears at points has sums over those that overlap in place of integrals: at both ends
with 1/2 of its length each, or with 1/4 at the ends and 1/2 in the middle.
"""

from typing import NamedTuple

import numpy as np

from archfrag.physics.kernels.kernel import inlined
from archfrag.physics.kernels.primitives import select
from archfrag.physics.kernels.structs import struct
from archfrag.physics.numbers import larger, smaller

# A slope that is none, and friction that no joint overcomes.
FLAT, ROUGH = 1e-300, 1e6
ALONG, ENDS = 0.0, 2.0  # values of ``Faces.points``


@struct(slip=(3,))
class Faces(NamedTuple):
    """Constant data of joints that give."""

    stiffness: np.ndarray  # (n_joint,) of a metre of the joint [N/m2]
    shear: np.ndarray  # (n_joint,) the same along the tangent [N/m2]
    slip: np.ndarray  # (n_joint, 3) elastic part of the slip of points where runs start [m]
    touching: np.ndarray  # (n_joint,) length in contact there [m]
    stored: float  # elastic energy there [J]
    delay: float  # dashpots over springs [s]
    points: float  # at which a joint bears; zero: all along it


class Bearing(NamedTuple):
    """What a joint bears, and how that changes with gap, slope and slip."""

    normal: float  # [N]
    moment: float  # of the normal stresses about the middle, those towards corner 1 positive [N m]
    shear: float  # on the body after, along the tangent [N]
    l0: float  # moments of the part in contact [m], [m2], [m3]
    l1: float
    l2: float
    hold: float  # of the shear by the slip where the joint sticks [N/m]
    rub_0: float  # of the shear by gap and slope where it slides [N/m], [N]
    rub_1: float


@inlined
def places_of(half, points):
    """Return the distance of the outer points from the middle, and weights of outer and middle."""
    share = 1.0 if points == ENDS else 0.5
    return share * half, 2.0 * (1.0 - share) * half


@inlined
def overlap_moments(d0, d1, half, points):
    """Return the moments of the part of a joint in which its faces overlap; l0, l1, l2."""
    if points == ALONG:
        slope = select(abs(d1) < FLAT, FLAT, d1)
        zero = smaller(larger(-d0 / slope, -half), half)
        low = select(slope > 0.0, -half, zero)
        high = select(slope > 0.0, zero, half)
        l1 = 0.5 * (high * high - low * low)
        return high - low, l1, (high * high * high - low * low * low) * (1.0 / 3.0)
    outer, inner = places_of(half, points)
    first = select(d0 - half * d1 < 0.0, outer, 0.0)
    last = select(d0 + half * d1 < 0.0, outer, 0.0)
    middle = select(d0 < 0.0, inner, 0.0)
    return first + middle + last, half * (last - first), half * half * (first + last)


@inlined
def rub(normal, slip, hold, friction):
    """Return the shear of a contact, and the sense of its friction if it slides, else zero."""
    along, most = -hold * slip, smaller(friction, ROUGH) * normal
    slides = abs(along) > most
    sense = select(slides, select(along > 0.0, 1.0, -1.0), 0.0)
    return select(slides, sense * most, along), sense


@inlined
def bear(d0, d1, half, slip, touching, material, points):
    """Return what a joint bears with the gap d0 + s d1; `slip` is the elastic one of each point.

    `material` has the normal and the shear stiffness of a metre, and the coefficient of friction.

    A face that bears along its length has one slip, of the length `touching` that was in contact:
    what comes into contact has not slipped.
    """
    stiffness, shear, friction = material
    l0, l1, l2 = overlap_moments(d0, d1, half, points)
    normal, moment = -stiffness * (d0 * l0 + d1 * l1), -stiffness * (d0 * l1 + d1 * l2)
    pressed = smaller(friction, ROUGH) * stiffness
    if points == ALONG:
        hold = shear * smaller(l0, touching)
        along, sense = rub(normal, slip[0], hold, friction)
        hold = select(sense != 0.0, 0.0, hold)
        sense = sense * pressed
        return Bearing(normal, moment, along, l0, l1, l2, hold, sense * l0, sense * l1)
    outer, inner = places_of(half, points)
    along = hold = rub_0 = rub_1 = 0.0 * half
    for i in range(3):
        place, size = half * (i - 1.0), inner if i == 1 else outer
        gap = d0 + place * d1
        size = select(gap < 0.0, size, 0.0)
        part, sense = rub(-stiffness * size * gap, slip[i], shear * size, friction)
        along += part
        hold += select(sense != 0.0, 0.0, shear * size)
        rub_0 += sense * pressed * size
        rub_1 += sense * pressed * size * place
    return Bearing(normal, moment, along, l0, l1, l2, hold, rub_0, rub_1)
