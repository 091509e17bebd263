"""Mega-voussoirs: a chain in as few bodies as move relative to each other.

Voussoirs whose common joint is closed and sticks move as one body (Sinopoli, section 3.3). Such
mega-voussoirs in a row, with the ones that rest on the ground taken as ground, are again a chain
of rigid bodies, so that everything that holds for a `Chain` holds for them. A joint that has slid
and sticks keeps its slip.
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.acceleration import centripetal_bias
from archfrag.mechanics.compile import allocating, inlined, kernel
from archfrag.mechanics.delassus import assemble, solve_modes
from archfrag.mechanics.kinematics import (
    measure_slip,
    move_faces,
    place_contacts,
    unit_tangent,
    vertex_on_earlier,
)
from archfrag.mechanics.laws import CLOSED_STICK, STICK, slip_of, touches
from archfrag.mechanics.types import Chain

GROUND = -1


class Mechanism(NamedTuple):
    """How voussoirs are grouped; arrays as long as the chain, of which the first are in use."""

    # (2,) int64: mega-voussoirs, joints between them
    count: np.ndarray  # type: ignore[assignment]
    first: np.ndarray  # (n_body,) int64: first voussoir of each mega-voussoir
    last: np.ndarray  # (n_body,) int64: last voussoir of each
    joint: np.ndarray  # (n_joint,) int64: joint of the chain that each of theirs is
    group: np.ndarray  # (n_body,) int64: mega-voussoir of each voussoir; GROUND if it rests
    offset: np.ndarray  # (n_body, 2) centroid from its mega-voussoir's, in the axes at rest [m]
    mass: np.ndarray  # (n_body,) [kg]
    inertia: np.ndarray  # (n_body,) about the centroid [kg m2]
    centroid: np.ndarray  # (n_body, 2) in the configuration at rest [m]
    face_before: np.ndarray  # (n_joint, 2, 2) [m]
    face_after: np.ndarray  # (n_joint, 2, 2) [m]
    friction: np.ndarray  # (n_joint,)
    mode: np.ndarray  # (n_joint,) int8
    slip: np.ndarray  # (n_joint,) [m]
    length: np.ndarray  # (n_joint,) [m]
    # Of joints that are closed and stick, in the axes at rest of the body they lie in.
    inner_point: np.ndarray  # (n_joint, 2, 2) from the mega-voussoir's centroid [m]
    inner_normal: np.ndarray  # (n_joint, 2)


@allocating
def new_mechanism(n_body, n_joint):
    """Room for any grouping of a chain.

    Parameters
    ----------
    n_body, n_joint : int

    Returns
    -------
    Mechanism
    """
    return Mechanism(
        np.zeros(2, np.int64),
        np.zeros(n_body, np.int64),
        np.zeros(n_body, np.int64),
        np.zeros(n_joint, np.int64),
        np.zeros(n_body, np.int64),
        np.zeros((n_body, 2)),
        np.zeros(n_body),
        np.zeros(n_body),
        np.zeros((n_body, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros(n_joint),
        np.zeros(n_joint, np.int8),
        np.zeros(n_joint),
        np.zeros(n_joint),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2)),
    )


@kernel
def group_voussoirs(mode, free_end, mechanism):
    """Join voussoirs across closed joints that stick; fills counts, `first`, `last`, `group`."""
    n_joint = mode.size
    n_body = mechanism.group.size
    n_mega_joint = 0
    for j in range(n_joint):
        if mode[j] != CLOSED_STICK:
            mechanism.joint[n_mega_joint] = j
            n_mega_joint += 1
    n_mega = n_mega_joint
    if not free_end:
        n_mega = max(n_mega_joint - 1, 0)
    mechanism.count[0] = n_mega
    mechanism.count[1] = n_mega_joint
    for i in range(n_body):
        mechanism.group[i] = GROUND
    for k in range(n_mega):
        first = mechanism.joint[k]
        last = mechanism.joint[k + 1] - 1 if k + 1 < n_mega_joint else n_body - 1
        mechanism.first[k] = first
        mechanism.last[k] = last
        for i in range(first, last + 1):
            mechanism.group[i] = k


@inlined
def _slipped(chain, j, slip):
    """Displacement of the later body by the slip of a closed joint, in the axes at rest."""
    if slip[j] == 0.0:
        return 0.0, 0.0
    tx, ty = unit_tangent(chain.face_before[j])
    return slip[j] * tx, slip[j] * ty


@kernel
def _place_at_rest(chain, slip, mechanism):
    """Centroids with the slips of closed joints, in the axes at rest, into `offset`."""
    n_body = chain.mass.size
    n_joint = slip.size
    sx = sy = 0.0
    for i in range(n_body):
        if i == 0 or mechanism.group[i] != mechanism.group[i - 1]:
            sx = sy = 0.0
        if mechanism.group[i] == GROUND or (
            i > 0 and mechanism.group[i] == mechanism.group[i - 1]
        ):
            dx, dy = _slipped(chain, i, slip)
            sx += dx
            sy += dy
        mechanism.offset[i, 0] = chain.centroid[i, 0] + sx
        mechanism.offset[i, 1] = chain.centroid[i, 1] + sy
    if n_joint > n_body and mechanism.count[1] > 0:
        # What rests on the far springing is held from there.
        sx = sy = 0.0
        for i in range(n_body - 1, mechanism.joint[mechanism.count[1] - 1] - 1, -1):
            dx, dy = _slipped(chain, i + 1, slip)
            sx -= dx
            sy -= dy
            mechanism.offset[i, 0] = chain.centroid[i, 0] + sx
            mechanism.offset[i, 1] = chain.centroid[i, 1] + sy


@kernel
def assemble_mechanism(chain, mode, slip, length, mechanism):
    """Masses and faces of the mega-voussoirs for given contact modes.

    Parameters
    ----------
    chain : Chain
    mode : ndarray, (n_joint,) int8
    slip, length : ndarray, (n_joint,) [m]
    mechanism : Mechanism
        Overwritten.

    Returns
    -------
    n_mega, n_mega_joint : int
    """
    n_body = chain.mass.size
    group_voussoirs(mode, slip.size == n_body, mechanism)
    _place_at_rest(chain, slip, mechanism)
    n_mega, n_mega_joint = mechanism.count[0], mechanism.count[1]
    for k in range(n_mega):
        mass = x = y = 0.0
        for i in range(mechanism.first[k], mechanism.last[k] + 1):
            mass += chain.mass[i]
            x += chain.mass[i] * mechanism.offset[i, 0]
            y += chain.mass[i] * mechanism.offset[i, 1]
        x /= mass
        y /= mass
        inertia = 0.0
        for i in range(mechanism.first[k], mechanism.last[k] + 1):
            mechanism.offset[i, 0] -= x
            mechanism.offset[i, 1] -= y
            rx, ry = mechanism.offset[i, 0], mechanism.offset[i, 1]
            inertia += chain.inertia[i] + chain.mass[i] * (rx * rx + ry * ry)
        mechanism.mass[k] = mass
        mechanism.inertia[k] = inertia
        mechanism.centroid[k, 0] = x
        mechanism.centroid[k, 1] = y
    for k in range(n_mega_joint):
        j = mechanism.joint[k]
        mechanism.mode[k] = mode[j]
        mechanism.slip[k] = slip[j]
        mechanism.length[k] = length[j]
        mechanism.friction[k] = chain.friction[j]
        for c in range(2):
            for d in range(2):
                mechanism.face_before[k, c, d] = chain.face_before[j, c, d]
                mechanism.face_after[k, c, d] = chain.face_after[j, c, d]
                if j > 0:
                    mechanism.face_before[k, c, d] += mechanism.offset[j - 1, d]
                if j < n_body:
                    mechanism.face_after[k, c, d] += mechanism.offset[j, d]
    _place_inner_joints(chain, mode, slip, mechanism)
    return n_mega, n_mega_joint


@kernel
def _place_inner_joints(chain, mode, slip, mechanism):
    n_body = chain.mass.size
    for j in range(slip.size):
        if mode[j] != CLOSED_STICK:
            continue
        tx, ty = unit_tangent(chain.face_before[j])
        mechanism.inner_normal[j, 0] = ty
        mechanism.inner_normal[j, 1] = -tx
        for c in range(2):
            later = vertex_on_earlier(c, slip[j])
            body = j if later else j - 1
            for d in range(2):
                place = chain.face_after[j, c, d] if later else chain.face_before[j, c, d]
                if 0 <= body < n_body:
                    place += mechanism.offset[body, d]
                mechanism.inner_point[j, c, d] = place


@kernel
def gather_state(chain, mechanism, position, velocity, mega_position, mega_velocity):
    """Positions and velocities of mega-voussoirs from those of their voussoirs.

    Centre of mass, momentum and moment of momentum are kept; the rotation is that of the first
    voussoir.

    Parameters
    ----------
    chain : Chain
    mechanism : Mechanism
        Assembled.
    position, velocity : ndarray, (n_body, 3)
    mega_position, mega_velocity : ndarray, (>= n_mega, 3)
        Overwritten.
    """
    for k in range(mechanism.count[0]):
        x = y = vx = vy = turning = 0.0
        for i in range(mechanism.first[k], mechanism.last[k] + 1):
            m = chain.mass[i]
            x += m * position[i, 0]
            y += m * position[i, 1]
            vx += m * velocity[i, 0]
            vy += m * velocity[i, 1]
        mass = mechanism.mass[k]
        x, y, vx, vy = x / mass, y / mass, vx / mass, vy / mass
        for i in range(mechanism.first[k], mechanism.last[k] + 1):
            rx, ry = position[i, 0] - x, position[i, 1] - y
            turning += chain.inertia[i] * velocity[i, 2]
            turning += chain.mass[i] * (rx * (velocity[i, 1] - vy) - ry * (velocity[i, 0] - vx))
        mega_position[k, 0] = x
        mega_position[k, 1] = y
        mega_position[k, 2] = position[mechanism.first[k], 2]
        mega_velocity[k, 0] = vx
        mega_velocity[k, 1] = vy
        mega_velocity[k, 2] = turning / mechanism.inertia[k]


@kernel
def farthest_regrouped(mechanism, length, mega_position, position):
    """How far grouping voussoirs into mega-voussoirs moves any of them [m].

    Parameters
    ----------
    mechanism : Mechanism
    length : float
        By which rotations are multiplied [m].
    mega_position : ndarray, (>= n_mega, 3)
        From `gather_state`.
    position : ndarray, (n_body, 3)
        Of the voussoirs before.

    Returns
    -------
    float
    """
    farthest = 0.0
    for i in range(position.shape[0]):
        k = mechanism.group[i]
        rx, ry = mechanism.offset[i, 0], mechanism.offset[i, 1]
        x, y, turn = rx, ry, 0.0
        if k != GROUND:
            turn = mega_position[k, 2]
            c, s = np.cos(turn), np.sin(turn)
            x = mega_position[k, 0] + c * rx - s * ry
            y = mega_position[k, 1] + s * rx + c * ry
        away = abs(x - position[i, 0]) + abs(y - position[i, 1])
        farthest = max(farthest, away, length * abs(turn - position[i, 2]))
    return farthest


@kernel
def split_state(mechanism, mega_position, mega_velocity, position, velocity):
    """Positions and velocities of all voussoirs from those of the mega-voussoirs.

    Parameters
    ----------
    mechanism : Mechanism
    mega_position, mega_velocity : ndarray, (>= n_mega, 3)
    position, velocity : ndarray, (n_body, 3)
        Overwritten.
    """
    for i in range(position.shape[0]):
        k = mechanism.group[i]
        rx, ry = mechanism.offset[i, 0], mechanism.offset[i, 1]
        if k == GROUND:
            position[i, 0], position[i, 1], position[i, 2] = rx, ry, 0.0
            velocity[i, 0] = velocity[i, 1] = velocity[i, 2] = 0.0
            continue
        c, s = np.cos(mega_position[k, 2]), np.sin(mega_position[k, 2])
        x, y = c * rx - s * ry, s * rx + c * ry
        turning = mega_velocity[k, 2]
        position[i, 0] = mega_position[k, 0] + x
        position[i, 1] = mega_position[k, 1] + y
        position[i, 2] = mega_position[k, 2]
        velocity[i, 0] = mega_velocity[k, 0] - turning * y
        velocity[i, 1] = mega_velocity[k, 1] + turning * x
        velocity[i, 2] = turning


@allocating
def few_bodies(mechanism, gravity):
    """The mega-voussoirs as a chain of their own: views, no copies."""
    n, m = mechanism.count[0], mechanism.count[1]
    return Chain(
        mechanism.mass[:n],
        mechanism.inertia[:n],
        mechanism.centroid[:n],
        mechanism.face_before[:m],
        mechanism.face_after[:m],
        mechanism.friction[:m],
        gravity,
    )


@kernel
def pose(chain, position, mode, slip, length, before, after, contacts):
    """Faces, slips under way and contacts of a chain, where `position` has them.

    ``slip`` is measured anew at the joints that slide; ``contacts.slip`` is set to the sense of
    their slips.
    """
    move_faces(chain, position, before, after)
    for j in range(slip.size):
        sense = slip_of(mode[j])
        contacts.slip[j] = sense
        if sense != STICK:
            slip[j] = measure_slip(j, 0 if touches(mode[j], 0) else 1, before, after)
    place_contacts(position, before, after, slip, length, contacts)


@kernel
def accelerate(chain, velocity, slip, free, contacts, work):
    """Accelerations and reactions of a posed chain in the modes of ``work.mode``.

    The equations of motion of a chain of few bodies (Eq 26) with its joints' laws as equations;
    the joints are eliminated as in `archfrag.mechanics.delassus`.

    Parameters
    ----------
    chain : Chain
    velocity : ndarray, (n_body, 3)
    slip : ndarray, (n_joint,) [m]
    free : ndarray, (n_body, 3)
        Accelerations without reactions [m/s2].
    contacts : Contacts
        From `pose`; `bias` is overwritten.
    work : ContactWork
        On return `velocity` holds the accelerations and `reaction` the reactions.

    Returns
    -------
    bool
        False where the mechanism is hyperstatic: its reactions are not unique.
    """
    centripetal_bias(contacts, work.mode, slip, velocity, contacts.bias)
    assemble(chain.mass, chain.inertia, contacts, work)
    left = solve_modes(
        chain.mass, chain.inertia, contacts, chain.friction, free, work, 1.0, 0.0, False
    )
    return np.isfinite(left)
