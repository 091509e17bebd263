"""The arch as a four-bar linkage: three mega-voussoirs, four pins, one angle.

Four hinges cut an arch that rests on rigid springings into three rigid bodies. With the pins at
the corners about which the joints open, bar ``k`` is the vector ``r_k`` from pin ``k`` to pin
``k + 1``, fixed to body ``k``, and the bars close::

    r_0 + r_1 + r_2 = d        d from the first pin to the last, both fixed to the ground

The one coordinate is the rotation of the first body, ``sense * q``, signed so that the joints open
for ``q > 0``; at ``q = 0`` the linkage is the arch (Oppenheim 1992). For a given q the third pin
lies where two circles meet. A chain with a free end has one hinge and one body: the rocking block
(Housner 1963). Points and vectors of the plane are complex numbers.
"""

import cmath
from typing import NamedTuple

import numpy as np

from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import struct
from archfrag.physics.onset import HINGE_EXTRADOS, HINGE_INTRADOS
from archfrag.physics.state import Model

# A hinge whose joint would open slower than this part of the fastest does not open.
OPENS = 1e-9


@struct()
class Linkage(NamedTuple):
    """One mechanism of a chain."""

    joint: (
        np.ndarray
    )  # (n_bar + 1,) int64 joint of each pin; of a free chain, behind the end
    sense: float  # sign of the first body's rotation that opens the joints
    rest: np.ndarray  # (n_bar + 1,) complex: pins at rest [m]
    sine: np.ndarray  # (n_bar - 1,) of the angles at the inner pins at rest, signed
    contact: (
        np.ndarray
    )  # (n_joint, 2) one where a corner is in contact while it moves, else zero


@inlined
def cross(a, b):
    """Vector product of two vectors of the plane."""
    return a.real * b.imag - a.imag * b.real


def linkage_of(model: Model, mechanism: np.ndarray) -> Linkage | None:
    """The linkage of an onset mechanism: bits (n_joint,) of `archfrag.physics.onset`.

    None if a joint slides, an arch has not four hinges, a free chain not one, or a joint would
    have to open about the side it closes on.
    """
    n_body = model.mass.size - 2
    joint = np.flatnonzero(mechanism)
    free_end = model.friction.size == n_body
    intrados = mechanism[joint] == HINGE_INTRADOS
    hinges = intrados | (mechanism[joint] == HINGE_EXTRADOS)
    if joint.size != (1 if free_end else 4) or not hinges.all():
        return None
    contact = np.ones((model.friction.size, 2))
    contact[joint, intrados.astype(int)] = 0.0
    place = model.corner[joint, 1, 1 - intrados] + model.centroid[joint + 1]
    rest = place[:, 0] + 1j * place[:, 1]
    # A joint opens about its extrados where the later body rotates forwards.
    opening = np.where(intrados, -1.0, 1.0)
    sense = float(opening[0])
    if free_end:
        end = np.append(joint, n_body)
        return Linkage(end, sense, np.append(rest, rest), np.zeros(0), contact)
    a, b, c = bars = np.diff(rest)
    area = np.array([(b.conj() * c).imag, (c.conj() * a).imag, (a.conj() * b).imag])
    rate = sense * area / area[0]
    opens = opening * np.diff(rate, prepend=0.0, append=0.0)
    if not (opens > OPENS * np.abs(rate).max()).all():
        return None
    unit = bars / np.abs(bars)
    sine = np.ascontiguousarray((unit[1:] * unit[:-1].conj()).imag)
    return Linkage(joint, sense, rest, sine, contact)


@kernel
def inner_sine(linkage, state, k):
    """Sine of the angle between the bars before and after pin k, signed (k = 1, 2)."""
    rest = linkage.rest
    joint = linkage.joint
    a = (rest[k] - rest[k - 1]) * cmath.exp(1j * state.position[joint[k - 1] + 1, 2])
    b = (rest[k + 1] - rest[k]) * cmath.exp(1j * state.position[joint[k] + 1, 2])
    return cross(a, b) / (abs(a) * abs(b))


@inlined
def _propagate(model, linkage, k, pin, moves, angle, spin, state):
    """Place the voussoirs of a body about its first pin; place and velocity of the second."""
    rotated = cmath.exp(1j * angle)
    for i in range(linkage.joint[k] + 1, linkage.joint[k + 1] + 1):
        arm = complex(model.centroid[i, 0], model.centroid[i, 1]) - linkage.rest[k]
        place = pin + rotated * arm
        speed = moves + 1j * spin * rotated * arm
        state.position[i, 0] = place.real
        state.position[i, 1] = place.imag
        state.velocity[i, 0] = speed.real
        state.velocity[i, 1] = speed.imag
        state.position[i, 2] = angle
        state.velocity[i, 2] = spin
    bar = rotated * (linkage.rest[k + 1] - linkage.rest[k])
    return pin + bar, moves + 1j * spin * bar


@kernel
def place_linkage(model, linkage, q, speed, state):
    """Positions and velocities of all voussoirs, into `state`, for a coordinate and its rate.

    Returns False where the bars do not reach: the linkage has been stretched straight before.
    """
    rest = linkage.rest
    sense = linkage.sense
    for i in range(1, state.position.shape[0] - 1):
        for c in range(3):
            state.position[i, c] = model.centroid[i, c] if c < 2 else 0.0
            state.velocity[i, c] = 0.0
    spin = sense * speed
    pin, moves = _propagate(model, linkage, 0, rest[0], 0j, sense * q, spin, state)
    if rest.size == 2:
        return True
    a = pin - rest[0]
    b = rest[2] - rest[1]
    c = rest[3] - rest[2]
    d = rest[3] - pin
    square = abs(d) ** 2
    along = 0.5 * (abs(b) ** 2 - abs(c) ** 2 + square) / square
    aside = abs(b) ** 2 / square - along * along
    if not aside > 0.0:
        return False
    aside = -(aside**0.5) if cross(b, c) > 0.0 else aside**0.5
    second = d * complex(along, aside)
    third = d - second
    # The bars close: the sum of spin times bar vanishes.
    wide = spin / cross(second, third)
    angle = cmath.phase(second / b)
    rate = wide * cross(third, a)
    pin, moves = _propagate(model, linkage, 1, pin, moves, angle, rate, state)
    angle = cmath.phase(third / c)
    rate = wide * cross(a, second)
    _propagate(model, linkage, 2, pin, moves, angle, rate, state)
    return True


def speed_after_impact(mass: np.ndarray, unit: np.ndarray, before: np.ndarray) -> float:
    """Speed at which a linkage leaves the undeformed shape after an impact there [rad/s].

    All impulses but those at its pins are inside its three bodies, so that in its own motion the
    momentum gained does no work: the impulse balance of the three bodies, four pin impulses and
    one speed in nine equations, with the impulses eliminated (De Lorenzis, DeJong and Ochsendorf
    2007, Earthquake Engng Struct. Dyn. 36, 2119-2136). All arrays are (n_body, 3): masses and
    inertias, velocities of the new linkage at unit speed, and velocities before the impact. The
    speed is not positive where the mechanism would have to close.
    """
    return float((mass * unit * before).sum() / (mass * unit * unit).sum())
