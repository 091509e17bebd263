"""Contact dynamics of a chain with a table of bodies: Moreau-Jean steps, Gauss-Seidel.

Each corner of a joint may touch the face of the other body, with the normal of that face. A step
leaves no gap negative at its end, so that impacts are without restitution.
"""

from typing import NamedTuple

import numba
import numpy as np

from tests.validation.bridges.chains import bodies_of

OPEN = 1e-4  # gap over joint length beyond which a contact has opened
APPROACH = 1e-3  # speed above which its closing is an impact [m/s]
CONVERGED = 1e-13  # change of the impulses in a sweep over their size, both squared
MOST_SWEEPS = 20_000
DROP = 0.8  # a body that is so far down, or has turned so far, falls [m], [rad]
TURN = 1.2


class Found(NamedTuple):
    """What `contact_dynamics` finds; displacements are of centroids from rest."""

    peak: float  # largest displacement until the end or the fall [m]
    before: float  # largest displacement before the first impact [m]
    impact: float  # time of the first impact [s]; inf if none
    falls: bool
    unsolved: int  # steps whose sweeps have not converged


def contact_dynamics(chain, motion, factor=1.0, step=5e-4, follow=3.0):
    """Move a chain by a horizontal motion until `follow` [s] after it, or until a body falls."""
    n_body = chain.mass.size
    middle = step * (np.arange(int((motion.duration + follow) / step)) + 0.5)
    samples = motion.dt * np.arange(motion.acceleration.size)
    wave = np.interp(middle, samples, motion.acceleration, right=0.0)
    body = bodies_of(chain)
    body = np.where((body < 0) | (body >= n_body), n_body, body)
    inverse = np.zeros((n_body + 1, 3))
    inverse[:-1] = 1.0 / np.column_stack([chain.mass, chain.mass, chain.inertia])
    home = np.vstack([chain.centroid, np.zeros((1, 2))])
    face = np.stack([chain.face_before, chain.face_after], axis=1)
    given = inverse, home, body, face, chain.friction, chain.gravity
    return Found(*_move(*given, -factor * step * wave, step))


@numba.njit(cache=True)
def _turned(home, shift, point):
    """Return where a point of a body is, given in the body's frame."""
    c = np.cos(shift[2])
    s = np.sin(shift[2])
    x = home[0] + shift[0] + c * point[0] - s * point[1]
    y = home[1] + shift[1] + s * point[0] + c * point[1]
    return x, y


@numba.njit(cache=True)
def _set_contact(home, body, face, shift, corner, side, arm):
    """Set how a corner moves on the face of body `side`; return gap, length, whether on the face.

    `arm` (side, way, 3): rates of gap and slip by velocities of the body before and after.
    """
    owner = body[side]
    x0, y0 = _turned(home[owner], shift[owner], face[side, 0])
    x1, y1 = _turned(home[owner], shift[owner], face[side, 1])
    rival = body[1 - side]
    x, y = _turned(home[rival], shift[rival], face[1 - side, corner])
    length = np.hypot(x1 - x0, y1 - y0)
    tx = (x1 - x0) / length
    ty = (y1 - y0) / length
    for k in range(2):
        i = body[k]
        sign = 2.0 * k - 1.0
        rx = x - home[i, 0] - shift[i, 0]
        ry = y - home[i, 1] - shift[i, 1]
        for way in range(2):
            ax = ty if way == 0 else tx
            ay = -tx if way == 0 else ty
            arm[k, way, 0] = sign * ax
            arm[k, way, 1] = sign * ay
            arm[k, way, 2] = sign * (rx * ay - ry * ax)
    foot = (x - x0) * tx + (y - y0) * ty
    gap = ((x - x0) * ty - (y - y0) * tx) * (1.0 - 2.0 * side)
    return gap, length, -1e-9 < foot < length + 1e-9


@numba.njit(cache=True)
def _rate(arm, body, velocity, way):
    """Return the rate of gap (way 0) or slip (way 1) of a contact."""
    rate = 0.0
    for k in range(2):
        for q in range(3):
            rate += arm[k, way, q] * velocity[body[k], q]
    return rate


@numba.njit(cache=True)
def _push(arm, body, inverse, velocity, normal, shear):
    """Add what impulses of a contact do to the velocities of its bodies."""
    for k in range(2):
        i = body[k]
        for q in range(3):
            push = arm[k, 0, q] * normal + arm[k, 1, q] * shear
            velocity[i, q] += inverse[i, q] * push


@numba.njit(cache=True)
def _balance(normal_rate, slip_rate, nn, nt, tt, friction):
    """Return the impulses of one contact, whose rates without them are given (Coulomb)."""
    if normal_rate >= 0.0:
        return 0.0, 0.0
    det = nn * tt - nt * nt
    normal = (nt * slip_rate - tt * normal_rate) / det
    shear = (nt * normal_rate - nn * slip_rate) / det
    if normal >= 0.0 and abs(shear) <= friction * normal:
        return normal, shear
    sense = np.sign(shear)
    normal = max(0.0, -normal_rate / (nn + sense * friction * nt))
    return normal, sense * friction * normal


@numba.njit(cache=True)
def _sweep(order, bodies, arm, yields, gap_rate, friction, inverse, velocity, impulse):
    """Balance each contact in turn; return the squares of changes and of impulses."""
    change = size = 0.0
    for c in order:
        body = bodies[c // 4]
        nn, nt, tt = yields[c]
        old, rubbed = impulse[c]
        rate = _rate(arm[c], body, velocity, 0) + gap_rate[c] - nn * old - nt * rubbed
        slip = _rate(arm[c], body, velocity, 1) - nt * old - tt * rubbed
        new, shear = _balance(rate, slip, nn, nt, tt, friction[c // 4])
        _push(arm[c], body, inverse, velocity, new - old, shear - rubbed)
        change += (new - old) ** 2 + (shear - rubbed) ** 2
        size += new**2 + shear**2
        impulse[c] = new, shear
    return change, size


@numba.njit(cache=True)
def _move(inverse, home, bodies, face, friction, gravity, gained, step):
    """Make all steps; see `contact_dynamics`."""
    n_contact = 4 * len(bodies)
    shift = np.zeros(inverse.shape)
    velocity = np.zeros(inverse.shape)
    impulse = np.zeros((n_contact, 2))
    arm = np.zeros((n_contact, 2, 2, 3))
    yields = np.zeros((n_contact, 3))
    gap_rate = np.zeros(n_contact)
    approach = np.zeros(n_contact)
    opened = np.zeros(n_contact, np.bool_)
    on_face = np.zeros(n_contact, np.bool_)
    peak = before = 0.0
    impact = np.inf
    unsolved = 0
    for number in range(len(gained)):
        for c in range(n_contact):
            j = c // 4
            place = c // 2 % 2, c % 2
            gap, length, on_face[c] = _set_contact(
                home, bodies[j], face[j], shift, *place, arm[c]
            )
            gap_rate[c] = gap / step
            opened[c] |= gap > OPEN * length
            approach[c] = -_rate(arm[c], bodies[j], velocity, 0)
            if not on_face[c]:
                impulse[c] = 0.0
            yields[c] = 0.0
            for k, q in np.ndindex(2, 3):
                normal, along = arm[c, k, :, q]
                own = inverse[bodies[j, k], q]
                yields[c, 0] += own * normal**2
                yields[c, 1] += own * normal * along
                yields[c, 2] += own * along**2
        velocity[:-1, 0] += gained[number]
        velocity[:-1, 1] -= gravity * step
        for c in range(n_contact):
            _push(
                arm[c], bodies[c // 4], inverse, velocity, impulse[c, 0], impulse[c, 1]
            )
        order = np.flatnonzero(on_face)
        for _ in range(MOST_SWEEPS):
            change, size = _sweep(
                order,
                bodies,
                arm,
                yields,
                gap_rate,
                friction,
                inverse,
                velocity,
                impulse,
            )
            if change <= CONVERGED * size:
                break
            order = order[::-1]
        unsolved += change > CONVERGED * size
        for c in range(n_contact):
            if opened[c] and impulse[c, 0] > 0.0:
                opened[c] = False
                if approach[c] > APPROACH:
                    impact = min(impact, number * step)
        shift += step * velocity
        for i in range(len(home) - 1):
            peak = max(peak, np.hypot(shift[i, 0], shift[i, 1]))
            if -shift[i, 1] > DROP or abs(shift[i, 2]) > TURN:
                return peak, before, impact, True, unsolved
        if np.isinf(impact):
            before = peak
    return peak, before, impact, False, unsolved
