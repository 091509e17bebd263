"""The law of a joint that gives: an elastic face without tension, with Coulomb's friction.

Where two faces overlap, each metre of the joint presses by its stiffness times the overlap. The
gap is linear along the joint, d0 + s d1 at a distance s from its middle, so that force and moment
follow from the moments of the part that overlaps, l_n, the integrals of s^n over it:

    N = -k (d0 l0 + d1 l1),    M = -k (d0 l1 + d1 l2),    t = -k_s l0 z,  |t| <= mu N

A joint that bears at points has sums over those that overlap in place of integrals: at both ends
with 1/2 of its length each, or with 1/4 at the ends and 1/2 in the middle.

Dashpots act where faces overlap already: there the law is asked for the gap a delay later. What
comes into contact in a step is asked at its own time, so that nothing presses before it touches.
"""

from typing import NamedTuple

from numpy import ndarray

from archfrag.physics.kernels.kernel import inlined
from archfrag.physics.kernels.primitives import select
from archfrag.physics.kernels.structs import struct
from archfrag.physics.numbers import larger, smaller

# A slope that counts as none, and a coefficient of friction that no joint overcomes.
FLAT = 1e-300
ROUGH = 1e6
ALONG = 0.0  # values of ``Faces.points``
ENDS = 2.0


@struct(slip=(3,))
class Faces(NamedTuple):
    """Constant data of joints that give."""

    stiffness: ndarray  # (n_joint,) of a metre of the joint [N/m2]
    shear: ndarray  # (n_joint,) the same along the tangent [N/m2]
    slip: (
        ndarray  # (n_joint, 3) elastic part of the slip of points where runs start [m]
    )
    touching: ndarray  # (n_joint,) length in contact where runs start [m]
    half: ndarray  # (n_joint,) half the length along which faces then lie opposite [m]
    stored: float  # elastic energy where runs start [J]
    delay: float  # dashpots over springs [s]
    points: float  # number of points at which a joint bears; zero: all along it
    calm: float  # time for which a chain must be still to be at rest [s]
    sway: float  # kinetic energy below which a chain is still [J]
    still: float  # speed of the fastest body below which a chain is still [m/s]


class Gaps(NamedTuple):
    """Gaps and slopes at which the law of a joint is asked."""

    d0: float  # gap of the part that comes into contact [m], and its slope
    d1: float
    e0: float  # gap of the part that has overlapped before [m], and its slope
    e1: float
    low: float  # ends of the part that has overlapped before [m]
    high: float
    ratio: float  # time at which d0 and d1 are taken over that of e0 and e1
    c0: float  # gap at the end of the step, by which shear acts [m], and its slope
    c1: float


class Bearing(NamedTuple):
    """Forces that a joint bears, and their derivatives by gap, slope and slip.

    The gap and the slope are those of the part that has overlapped before.
    """

    normal: float  # [N]
    moment: float  # of the normal stresses about the middle, those towards corner 1 positive [N m]
    shear: float  # on the body after, along the tangent [N]
    l0: float  # derivatives of normal force and moment over the stiffness [m], [m2], [m3]
    l1: float
    l2: float
    hold: float  # derivative of the shear by the slip if the joint sticks [N/m]
    rub_0: float  # derivatives of the shear by gap and slope if it slides [N/m], [N]
    rub_1: float
    held: tuple[float, float, float]  # length of each point at which a slip is held [m]
    most: tuple[
        float, float, float
    ]  # elastic slip of each point at which it slides [m]


@inlined
def places_of(half, points):
    """Return the length for which an outer point stands, and that of the middle point [m].

    `half` is half the joint's length; of two points (`points` ENDS) each stands for half.
    """
    share = 1.0 if points == ENDS else 0.5
    return share * half, 2.0 * (1.0 - share) * half


@inlined
def ends_of(d0, d1, half):
    """Return both ends of the part of a joint in which its faces overlap; equal if none does."""
    slope = select(abs(d1) < FLAT, FLAT, d1)
    zero = smaller(larger(-d0 / slope, -half), half)
    return select(slope > 0.0, -half, zero), select(slope > 0.0, zero, half)


@inlined
def moments_between(low, high):
    """Return the moments l0, l1, l2 of the part of a joint from `low` to `high`.

    They are zero if the ends cross.
    """
    high = larger(high, low)
    l1 = 0.5 * (high * high - low * low)
    return high - low, l1, (high * high * high - low * low * low) * (1.0 / 3.0)


@inlined
def overlap_moments(d0, d1, half, points):
    """Return the moments l0, l1, l2 of the part of a joint in which its faces overlap."""
    if points == ALONG:
        low, high = ends_of(d0, d1, half)
        return moments_between(low, high)
    outer, inner = places_of(half, points)
    first = select(d0 - half * d1 < 0.0, outer, 0.0)
    last = select(d0 + half * d1 < 0.0, outer, 0.0)
    middle = select(d0 < 0.0, inner, 0.0)
    return first + middle + last, half * (last - first), half * half * (first + last)


@inlined
def press(d0, d1, half, stiffness, points):
    """Return the energy that the springs normal to a joint store [J], and its two derivatives.

    The derivatives by gap [N] and slope [N m] are -N and -M of `bear`.
    """
    l0, l1, l2 = overlap_moments(d0, d1, half, points)
    by_gap = stiffness * (d0 * l0 + d1 * l1)
    by_slope = stiffness * (d0 * l1 + d1 * l2)
    return 0.5 * (d0 * by_gap + d1 * by_slope), by_gap, by_slope


@inlined
def rub(normal, slip, size, material):
    """Return the shear of a contact, its two derivatives, and the elastic slip at which it slides.

    `size` is the length of the contact. The derivatives are that by the slip, and that by the
    pressing gap over the length. `material` is that of `bear`.
    """
    stiffness, shear, friction = material
    hold = shear * size
    along = -hold * slip
    most = smaller(friction, ROUGH) * normal
    slides = abs(along) > most
    sense = select(slides, select(along > 0.0, 1.0, -1.0), 0.0)
    pressed = sense * smaller(friction, ROUGH) * stiffness
    along = select(slides, sense * most, along)
    return along, select(slides, 0.0, hold), pressed, most / larger(hold, FLAT)


@inlined
def _bear_along(gaps, half, slip, touching, material):
    """Return the `Bearing` of a joint that bears all along it; arguments as of `bear`."""
    d0, d1, e0, e1, low, high, ratio, c0, c1 = gaps
    stiffness = material[0]
    first, last = ends_of(e0, e1, half)
    o0, o1, o2 = moments_between(larger(first, low), smaller(last, high))
    first, last = ends_of(d0, d1, half)
    n0, n1, n2 = moments_between(first, last)
    m0, m1, m2 = moments_between(larger(first, low), smaller(last, high))
    n0 = n0 - m0
    n1 = n1 - m1
    n2 = n2 - m2
    normal = -stiffness * (e0 * o0 + e1 * o1 + d0 * n0 + d1 * n1)
    moment = -stiffness * (e0 * o1 + e1 * o2 + d0 * n1 + d1 * n2)
    first, last = ends_of(c0, c1, half)
    held = smaller(last - first, touching)
    along, hold, pressed, most = rub(normal, slip[0], held, material)
    l0 = o0 + ratio * n0
    l1 = o1 + ratio * n1
    l2 = o2 + ratio * n2
    none = 0.0 * half
    rubs = pressed * l0, pressed * l1
    ends = (held, none, none), (most, none, none)
    return Bearing(normal, moment, along, l0, l1, l2, hold, *rubs, *ends)


@inlined
def _bear_at(place, size, gaps, slip, material):
    """Return the `Bearing` of one point of a joint, at `place` from its middle [m].

    `size` is the length for which the point stands [m].
    """
    d0, d1, e0, e1, low, high, ratio, _, _ = gaps
    old = (place >= low) & (place <= high) & (low < high)
    gap = select(old, e0 + place * e1, d0 + place * d1)
    size = select(gap < 0.0, size, 0.0)
    normal = -material[0] * size * gap
    along, hold, pressed, most = rub(normal, slip, size, material)
    l0 = select(old, size, ratio * size)
    l1 = place * l0
    rub_0 = pressed * l0
    rubs = rub_0, rub_0 * place
    forces = normal, place * normal, along
    return Bearing(*forces, l0, l1, place * l1, hold, *rubs, size, most)


@inlined
def bear(gaps, half, slip, touching, material, points):
    """Return the `Bearing` of a joint at some `Gaps`; `slip` is the elastic one of each point.

    `material` has the normal and the shear stiffness of a metre, and the coefficient of friction.

    A face that bears along its length has one slip, of the length `touching` that was in contact:
    what comes into contact has not slipped.
    """
    if points == ALONG:
        return _bear_along(gaps, half, slip, touching, material)
    outer, inner = places_of(half, points)
    a = _bear_at(-half, outer, gaps, slip[0], material)
    b = _bear_at(0.0 * half, inner, gaps, slip[1], material)
    c = _bear_at(half, outer, gaps, slip[2], material)
    return Bearing(
        a.normal + b.normal + c.normal,
        a.moment + c.moment,
        a.shear + b.shear + c.shear,
        a.l0 + b.l0 + c.l0,
        a.l1 + c.l1,
        a.l2 + c.l2,
        a.hold + b.hold + c.hold,
        a.rub_0 + b.rub_0 + c.rub_0,
        a.rub_1 + c.rub_1,
        (a.held, b.held, c.held),
        (a.most, b.most, c.most),
    )
