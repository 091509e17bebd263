"""The arch as a four-bar linkage: three mega-voussoirs, four pins, one angle.

Four hinges cut an arch that rests on rigid springings into three rigid bodies. With the pins at
the corners about which the joints open, bar ``k`` is the vector ``r_k`` from pin ``k`` to pin
``k + 1``, fixed to body ``k``, and the bars close::

    r_0 + r_1 + r_2 = d        d from the first pin to the last, both fixed to the ground

The one coordinate is the rotation of the first body, ``turn_0 = sense * q``, signed so that the
joints open for ``q > 0``; at ``q = 0`` the linkage is the arch. For a given q the third pin lies
where two circles meet, on the side on which it lies in the arch. Derivatives of the closure, with
``z`` a quarter turn and dashes for d/dq::

    sum_k turn_k' r_k = 0,     sum_k turn_k'' z r_k = sum_k turn_k'^2 r_k

give the rotations' first and second derivatives, and with them those of the centroids,
``x_k'``, ``x_k''``. The kinetic energy is ``M(q) q.^2 / 2`` with ``M = sum m |x'|^2 + I turn'^2``,
and Lagrange's equation for large rotations ::

    M q.. + (M'/2) q.^2 = - sum m (a_x x' + (g + a_y) y')

(Oppenheim 1992, Earthquake Engng Struct. Dyn. 21(11), 1005-1017; Clemente 1998, ibid. 27(5),
513-522). A chain with a free end has one hinge and one body: the rocking block (Housner
1963), of which all this is the case of no closure.
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.laws import CLOSED_STICK, STICK, corner_mode
from archfrag.mechanics.onset import HINGE_EXTRADOS, HINGE_INTRADOS, SLIDING

N_BAR = 3
N_PIN = 4
# A hinge whose joint would open slower than this part of the fastest does not open.
OPENS = 1e-9


class Linkage(NamedTuple):
    """One mechanism of a chain; bars and arms in the axes at rest."""

    count: np.ndarray  # type: ignore[assignment]  # (1,) int64 bodies that move: 3, 1; 0: none
    joint: np.ndarray  # (4,) int64 joint of each pin
    corner: np.ndarray  # (4,) int64 side on which the pin lies
    sense: np.ndarray  # (1,) sign of the first body's rotation that opens the joints
    pin: np.ndarray  # (4, 2) pins at rest [m]
    arm: np.ndarray  # (3, 2) centroid from the pin before it [m]
    mass: np.ndarray  # (3,) [kg]
    inertia: np.ndarray  # (3,) about the centroid [kg m2]
    mode: np.ndarray  # (n_joint,) int8 contact modes while it moves


class Pose(NamedTuple):
    """A configuration of a linkage and its derivatives with respect to q."""

    turn: np.ndarray  # (3,) rotations [rad]
    rate: np.ndarray  # (3,) first derivative
    curve: np.ndarray  # (3,) second derivative
    bar: np.ndarray  # (3, 2) [m]
    pin: np.ndarray  # (4, 2) [m]
    centroid: np.ndarray  # (3, 2) [m]
    slope: np.ndarray  # (3, 2) first derivative of the centroids [m]
    bend: np.ndarray  # (3, 2) second derivative [m]
    force: np.ndarray  # (4, 2) on the body after each pin [N]


@allocating
def new_linkage(n_joint):
    """Room for a mechanism of a chain with so many joints."""
    return Linkage(
        np.zeros(1, np.int64),
        np.zeros(N_PIN, np.int64),
        np.zeros(N_PIN, np.int64),
        np.ones(1),
        np.zeros((N_PIN, 2)),
        np.zeros((N_BAR, 2)),
        np.zeros(N_BAR),
        np.zeros(N_BAR),
        np.full(n_joint, CLOSED_STICK, np.int8),
    )


@allocating
def new_pose():
    """Room for a configuration."""
    return Pose(
        np.zeros(N_BAR),
        np.zeros(N_BAR),
        np.zeros(N_BAR),
        np.zeros((N_BAR, 2)),
        np.zeros((N_PIN, 2)),
        np.zeros((N_BAR, 2)),
        np.zeros((N_BAR, 2)),
        np.zeros((N_BAR, 2)),
        np.zeros((N_PIN, 2)),
    )


@kernel
def body_span(linkage, k, n_body):
    """First voussoir of body `k`, and the one after its last."""
    first = linkage.joint[k]
    return first, linkage.joint[k + 1] if linkage.count[0] == N_BAR else n_body


@kernel
def _read_hinges(mechanism, free_end, linkage):
    """Pins of a mechanism in bits of `mechanics.onset`; False if they make no linkage."""
    n = 0
    for j in range(mechanism.size):
        bits = mechanism[j]
        if bits == 0:
            continue
        if bits & SLIDING or bits == HINGE_INTRADOS | HINGE_EXTRADOS or n == N_PIN:
            return False
        linkage.joint[n] = j
        linkage.corner[n] = 0 if bits == HINGE_INTRADOS else 1
        n += 1
    return n == (1 if free_end else N_PIN)


@kernel
def build_linkage(chain, mechanism, linkage):
    """Make the linkage of an onset mechanism.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    mechanism : ndarray, (n_joint,) int8
        Bits of `archfrag.mechanics.onset`: joints that hinge or slide at the limit load.
    linkage : Linkage
        Overwritten.

    Returns
    -------
    bool
        False where the mechanism is none of a linkage: a joint slides, an arch has not four
        hinges, a free chain not one, or a joint would have to open about the side it closes on.
        ``linkage.count`` is then 0.
    """
    n_body = chain.mass.size
    free_end = chain.friction.size == n_body
    linkage.count[0] = 0
    if not _read_hinges(mechanism, free_end, linkage):
        return False
    n = 1 if free_end else N_BAR
    linkage.count[0] = n
    for k in range(1 if free_end else N_PIN):
        j, c = linkage.joint[k], linkage.corner[k]
        for d in range(2):
            if j < n_body:
                linkage.pin[k, d] = chain.centroid[j, d] + chain.face_after[j, c, d]
            else:
                linkage.pin[k, d] = chain.face_after[j, c, d]
        linkage.mode[j] = corner_mode(c, STICK)
    for k in range(n):
        first, end = body_span(linkage, k, n_body)
        mass = x = y = 0.0
        for i in range(first, end):
            mass += chain.mass[i]
            x += chain.mass[i] * chain.centroid[i, 0]
            y += chain.mass[i] * chain.centroid[i, 1]
        x, y = x / mass, y / mass
        inertia = 0.0
        for i in range(first, end):
            dx, dy = chain.centroid[i, 0] - x, chain.centroid[i, 1] - y
            inertia += chain.inertia[i] + chain.mass[i] * (dx * dx + dy * dy)
        linkage.mass[k] = mass
        linkage.inertia[k] = inertia
        linkage.arm[k, 0] = x - linkage.pin[k, 0]
        linkage.arm[k, 1] = y - linkage.pin[k, 1]
    if free_end:
        linkage.sense[0] = opening_turn(linkage.corner[0])
        return True
    return _find_sense(linkage)


@kernel
def opening_turn(corner):
    """Sign of the later body's relative rotation that opens a joint about a corner."""
    return -1.0 if corner == 0 else 1.0


@kernel
def _find_sense(linkage):
    """Sense in which all four joints open; False where there is none."""
    rate_1, rate_2 = _bar_rates(linkage.pin)
    if not np.isfinite(rate_1 + rate_2):
        linkage.count[0] = 0
        return False
    fastest = max(1.0, abs(rate_1), abs(rate_2))
    first = linkage.sense[0] = opening_turn(linkage.corner[0])
    for k in range(1, N_PIN):
        if k == 1:
            relative = rate_1 - 1.0
        elif k == 2:
            relative = rate_2 - rate_1
        else:
            relative = -rate_2
        if first * relative * opening_turn(linkage.corner[k]) <= OPENS * fastest:
            linkage.count[0] = 0
            return False
    return True


@kernel
def _bar_rates(pin):
    """Rotations of the second and third bar for a unit one of the first; inf where in line."""
    ax, ay = pin[1, 0] - pin[0, 0], pin[1, 1] - pin[0, 1]
    bx, by = pin[2, 0] - pin[1, 0], pin[2, 1] - pin[1, 1]
    cx, cy = pin[3, 0] - pin[2, 0], pin[3, 1] - pin[2, 1]
    wide = bx * cy - by * cx
    return (cx * ay - cy * ax) / wide, (ax * by - ay * bx) / wide


@kernel
def _turn_between(old_x, old_y, new_x, new_y):
    """Angle from one vector to another [rad]."""
    return np.arctan2(old_x * new_y - old_y * new_x, old_x * new_x + old_y * new_y)


@kernel
def rotate(angle, x, y):
    c, s = np.cos(angle), np.sin(angle)
    return c * x - s * y, s * x + c * y


@kernel
def place_pins(linkage, q, pose):
    """Rotations, bars and pins for a coordinate q.

    Returns
    -------
    bool
        False where the bars do not reach: the linkage has been stretched straight before.
    """
    rest, pin, turn, bar = linkage.pin, pose.pin, pose.turn, pose.bar
    turn[0] = linkage.sense[0] * q
    pin[0, 0], pin[0, 1] = rest[0, 0], rest[0, 1]
    if linkage.count[0] == 1:
        return True
    px, py = rest[1, 0] - rest[0, 0], rest[1, 1] - rest[0, 1]
    bar[0, 0], bar[0, 1] = rotate(turn[0], px, py)
    pin[1, 0], pin[1, 1] = pin[0, 0] + bar[0, 0], pin[0, 1] + bar[0, 1]
    pin[3, 0], pin[3, 1] = rest[3, 0], rest[3, 1]
    bx, by = rest[2, 0] - rest[1, 0], rest[2, 1] - rest[1, 1]
    cx, cy = rest[3, 0] - rest[2, 0], rest[3, 1] - rest[2, 1]
    dx, dy = pin[3, 0] - pin[1, 0], pin[3, 1] - pin[1, 1]
    b2, c2, d2 = bx * bx + by * by, cx * cx + cy * cy, dx * dx + dy * dy
    along = 0.5 * (b2 - c2 + d2) / d2
    aside = b2 / d2 - along * along
    if not aside > 0.0:
        return False
    aside = np.sqrt(aside)
    if bx * cy - by * cx > 0.0:
        aside = -aside
    bar[1, 0], bar[1, 1] = along * dx - aside * dy, along * dy + aside * dx
    bar[2, 0], bar[2, 1] = dx - bar[1, 0], dy - bar[1, 1]
    pin[2, 0], pin[2, 1] = pin[1, 0] + bar[1, 0], pin[1, 1] + bar[1, 1]
    turn[1] = _turn_between(bx, by, bar[1, 0], bar[1, 1])
    turn[2] = _turn_between(cx, cy, bar[2, 0], bar[2, 1])
    return True


@kernel
def pose_linkage(linkage, q, pose):
    """Configuration for a coordinate q, with the derivatives of rotations and centroids.

    Parameters
    ----------
    linkage : Linkage
    q : float [rad]
    pose : Pose
        Overwritten, but for the forces.

    Returns
    -------
    bool
        As `place_pins`.
    """
    if not place_pins(linkage, q, pose):
        return False
    n, rate, curve, bar = linkage.count[0], pose.rate, pose.curve, pose.bar
    rate[0], curve[0] = linkage.sense[0], 0.0
    if n == N_BAR:
        rate_1, rate_2 = _bar_rates(pose.pin)
        rate[1], rate[2] = rate[0] * rate_1, rate[0] * rate_2
        wx = wy = 0.0
        for k in range(N_BAR):
            wx += rate[k] * rate[k] * bar[k, 0]
            wy += rate[k] * rate[k] * bar[k, 1]
        # The quarter turn of `z r_k` taken back: (wx, wy) becomes (wy, -wx).
        wide = bar[1, 0] * bar[2, 1] - bar[1, 1] * bar[2, 0]
        curve[1] = (wy * bar[2, 1] + wx * bar[2, 0]) / wide
        curve[2] = -(bar[1, 0] * wx + bar[1, 1] * wy) / wide
    vx = vy = ax = ay = 0.0
    for k in range(n):
        x, y = rotate(pose.turn[k], linkage.arm[k, 0], linkage.arm[k, 1])
        t, tt, square = rate[k], curve[k], rate[k] * rate[k]
        pose.centroid[k, 0], pose.centroid[k, 1] = pose.pin[k, 0] + x, pose.pin[k, 1] + y
        pose.slope[k, 0], pose.slope[k, 1] = vx - t * y, vy + t * x
        pose.bend[k, 0] = ax - tt * y - square * x
        pose.bend[k, 1] = ay + tt * x - square * y
        if n == N_BAR:
            x, y = bar[k, 0], bar[k, 1]
            vx -= t * y
            vy += t * x
            ax -= tt * y + square * x
            ay += tt * x - square * y
    return True


@kernel
def relative_turn(linkage, pose, k):
    """Rotation of the body after pin `k` relative to the one before it [rad]."""
    turn = pose.turn[k] if k < linkage.count[0] else 0.0
    return turn - pose.turn[k - 1] if k > 0 else turn


@kernel
def straightness(pose, k):
    """Sine of the angle between the bars before and after pin `k`, signed (k = 1, 2)."""
    ax, ay = pose.bar[k - 1, 0], pose.bar[k - 1, 1]
    bx, by = pose.bar[k, 0], pose.bar[k, 1]
    return (ax * by - ay * bx) / np.sqrt((ax * ax + ay * ay) * (bx * bx + by * by))
