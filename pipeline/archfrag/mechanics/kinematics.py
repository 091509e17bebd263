"""Where the joint faces are, and the contacts they make, for given positions of the bodies."""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.delassus import Contacts

COINCIDENT = 1e-9


@kernel
def move_faces(chain, position, before, after):
    """Corners of all joint faces in the ground frame.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    position : ndarray, (n_body, 3)
        Centroid [m] and rotation [rad].
    before, after : ndarray, (n_joint, 2, 2)
        Overwritten: corner, xy of the face on the body before and after each joint [m].
    """
    n_body = chain.mass.size
    n_joint = chain.friction.size
    for body in range(n_body):
        c = np.cos(position[body, 2])
        s = np.sin(position[body, 2])
        x = position[body, 0]
        y = position[body, 1]
        for k in range(2):
            fx, fy = chain.face_after[body, k, 0], chain.face_after[body, k, 1]
            after[body, k, 0] = x + c * fx - s * fy
            after[body, k, 1] = y + s * fx + c * fy
            if body + 1 < n_joint:
                fx, fy = chain.face_before[body + 1, k, 0], chain.face_before[body + 1, k, 1]
                before[body + 1, k, 0] = x + c * fx - s * fy
                before[body + 1, k, 1] = y + s * fx + c * fy
    for k in range(2):
        for c in range(2):
            before[0, k, c] = chain.face_before[0, k, c]
            if n_joint > n_body:
                after[n_body, k, c] = chain.face_after[n_body, k, c]


@allocating
def joint_lengths(chain):
    """Shorter of the two faces of each joint, (n_joint,) [m]."""
    n_joint = chain.friction.size
    length = np.empty(n_joint)
    for j in range(n_joint):
        a = chain.face_before[j, 1] - chain.face_before[j, 0]
        b = chain.face_after[j, 1] - chain.face_after[j, 0]
        length[j] = np.sqrt(min(a[0] * a[0] + a[1] * a[1], b[0] * b[0] + b[1] * b[1]))
    return length


@kernel
def unit_tangent(face):
    """Unit vector from the intrados to the extrados corner of a face."""
    tx = face[1, 0] - face[0, 0]
    ty = face[1, 1] - face[0, 1]
    norm = 1.0 / np.sqrt(tx * tx + ty * ty)
    return tx * norm, ty * norm


@kernel
def vertex_on_earlier(corner, slip):
    """Whether the contact at a corner of a slipped joint is the later body's vertex (23a).

    Slip towards the extrados carries the later body's intrados vertex over the earlier body's
    face, and the earlier body's extrados vertex under the later body's.
    """
    return (slip >= 0.0) == (corner == 0)


@kernel
def place_contacts(position, before, after, slip, length, contacts):
    """Contact points and normals of all joints.

    Parameters
    ----------
    position : ndarray, (n_body, 3)
    before, after : ndarray, (n_joint, 2, 2)
        From `move_faces`.
    slip : ndarray, (n_joint,) [m]
        Displacement of the later face along the tangent, where the joint is in contact.
    length : ndarray, (n_joint,) [m]
    contacts : Contacts
        `centroid`, `point`, `normal`, `normal_plus` and `normal_minus` are overwritten.
    """
    for body in range(position.shape[0]):
        contacts.centroid[body, 0] = position[body, 0]
        contacts.centroid[body, 1] = position[body, 1]
    for j in range(slip.size):
        ax, ay = unit_tangent(before[j])
        bx, by = unit_tangent(after[j])
        mx, my = ax + bx, ay + by
        norm = np.sqrt(mx * mx + my * my)
        if norm < 1e-6:
            mx, my, norm = ax, ay, 1.0
        contacts.normal[j, 0] = my / norm
        contacts.normal[j, 1] = -mx / norm
        meet = abs(slip[j]) <= COINCIDENT * length[j]
        for c in range(2):
            plus, minus = contacts.normal_plus[j, c], contacts.normal_minus[j, c]
            point = contacts.point[j, c]
            if meet:
                point[0] = 0.5 * (before[j, c, 0] + after[j, c, 0])
                point[1] = 0.5 * (before[j, c, 1] + after[j, c, 1])
                if c == 0:
                    plus[0], plus[1], minus[0], minus[1] = by, -bx, ay, -ax
                else:
                    plus[0], plus[1], minus[0], minus[1] = ay, -ax, by, -bx
            elif vertex_on_earlier(c, slip[j]):
                point[0], point[1] = after[j, c, 0], after[j, c, 1]
                plus[0], plus[1], minus[0], minus[1] = ay, -ax, ay, -ax
            else:
                point[0], point[1] = before[j, c, 0], before[j, c, 1]
                plus[0], plus[1], minus[0], minus[1] = by, -bx, by, -bx


@kernel
def corner_offset(j, corner, before, after, slip):
    """Displacement of the later face's corner from where its contact holds it [m]."""
    dx = after[j, corner, 0] - before[j, corner, 0]
    dy = after[j, corner, 1] - before[j, corner, 1]
    if slip[j] != 0.0:
        face = before[j] if vertex_on_earlier(corner, slip[j]) else after[j]
        tx, ty = unit_tangent(face)
        dx -= slip[j] * tx
        dy -= slip[j] * ty
    return dx, dy


@kernel
def measure_slip(j, corner, before, after):
    """Slip of a joint that touches at `corner` [m]."""
    dx = after[j, corner, 0] - before[j, corner, 0]
    dy = after[j, corner, 1] - before[j, corner, 1]
    ax, ay = unit_tangent(before[j])
    slip = ax * dx + ay * dy
    if not vertex_on_earlier(corner, slip):
        bx, by = unit_tangent(after[j])
        slip = bx * dx + by * dy
    return slip


@kernel
def clearance(j, corner, before, after):
    """Gap at a corner by Signorini's law: the larger of what 23a and 23b measure [m]."""
    dx = after[j, corner, 0] - before[j, corner, 0]
    dy = after[j, corner, 1] - before[j, corner, 1]
    ax, ay = unit_tangent(before[j])
    slip = ax * dx + ay * dy
    bx, by = unit_tangent(after[j])
    gap_a = ay * dx - ax * dy
    gap_b = by * dx - bx * dy
    size = abs(before[j, 1, 0] - before[j, 0, 0]) + abs(before[j, 1, 1] - before[j, 0, 1])
    if abs(slip) <= COINCIDENT * (abs(dx) + abs(dy) + size):
        return max(gap_a, gap_b)
    return gap_a if vertex_on_earlier(corner, slip) else gap_b


@allocating
def empty_contacts(n_body, n_joint):
    """Room for the contacts of a chain, all corners able to touch.

    Parameters
    ----------
    n_body, n_joint : int

    Returns
    -------
    Contacts
    """
    return Contacts(
        np.zeros((n_body, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        np.ones((n_joint, 2), np.int8),
        np.zeros(n_joint, np.int8),
        np.zeros((n_joint, 2, 2)),
    )
