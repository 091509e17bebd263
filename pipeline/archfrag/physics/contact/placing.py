"""Place joint faces and the contacts that they can make; for one run or four.

At an open joint the two faces have different normals and Signorini's law splits into Eqs 23a
and 23b of the paper: a vertex of either body may meet the other's face.
"""

import math

from archfrag.physics.contact.laws import MINUS, PLUS
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import opposite, select, some
from archfrag.physics.numbers import larger, sine_cosine, smaller

# Slip over joint length below which two vertices count as one point.
COINCIDENT = 1e-9
BEFORE = 0
AFTER = 1


@inlined
def later_vertex_meets(corner, slip):
    """Return whether the contact at a corner of a slipped joint is the later body's vertex (Eq
    23a).

    Slip towards the extrados moves the later body's intrados vertex over the earlier body's
    face, and the earlier body's extrados vertex under the later body's.
    """
    if corner == 0:
        return slip >= 0.0
    return slip < 0.0


@kernel
def move_faces(model, position, rotated, face, tangent):
    """Set corners and unit tangents of all joint faces for given positions of the bodies.

    Reads: model (corner, tangent), position, rotated.
    Writes: rotated, face, tangent.
    """
    for i in range(1, position.shape[0] - 1):
        rotated[i, 1], rotated[i, 0] = sine_cosine(position[i, 2])
    for j in range(face.shape[0]):
        for side in range(2):
            i = j + side
            c = rotated[i, 0]
            s = rotated[i, 1]
            for k in range(2):
                x = model.corner[j, side, k, 0]
                y = model.corner[j, side, k, 1]
                face[j, side, k, 0] = position[i, 0] + (c * x - s * y)
                face[j, side, k, 1] = position[i, 1] + (s * x + c * y)
            x = model.tangent[j, side, 0]
            y = model.tangent[j, side, 1]
            tangent[j, side, 0] = c * x - s * y
            tangent[j, side, 1] = s * x + c * y


@kernel
def place_contacts(model, slip, face, tangent, work):
    """Set contact points, pivots and normals of all joints from faces and slips [m].

    Reads: model.length, slip, face, tangent, work (point, side_normal).
    Writes: work (normal, pivot, point, side_normal).
    """
    point = work.point
    side_normal = work.side_normal
    for j in range(slip.shape[0]):
        ax = tangent[j, BEFORE, 0]
        ay = tangent[j, BEFORE, 1]
        bx = tangent[j, AFTER, 0]
        by = tangent[j, AFTER, 1]
        mx = ax + bx
        my = ay + by
        norm = math.sqrt(mx * mx + my * my)
        folded = norm < 1e-6
        size = 1.0 / select(folded, 1.0, norm)
        work.normal[j, 0] = select(folded, ay, my) * size
        work.normal[j, 1] = -select(folded, ax, mx) * size
        meet = abs(slip[j]) <= COINCIDENT * model.length[j]
        for k in range(2):
            later = later_vertex_meets(k, slip[j])
            for c in range(2):
                first = face[j, BEFORE, k, c]
                second = face[j, AFTER, k, c]
                vertex = select(later, second, first)
                point[j, k, c] = select(meet, 0.5 * (first + second), vertex)
            if k == 0:
                plus_a = later & opposite(meet)
                minus_a = later | meet
            else:
                plus_a = later | meet
                minus_a = later & opposite(meet)
            side_normal[j, k, PLUS, 0] = select(plus_a, ay, by)
            side_normal[j, k, PLUS, 1] = -select(plus_a, ax, bx)
            side_normal[j, k, MINUS, 0] = select(minus_a, ay, by)
            side_normal[j, k, MINUS, 1] = -select(minus_a, ax, bx)
        for c in range(2):
            work.pivot[j, c] = 0.5 * (point[j, 0, c] + point[j, 1, c])


@inlined
def corner_offset(j, k, face, tangent, slip):
    """Return the offset of the later face's corner from its place in contact [m]."""
    later = later_vertex_meets(k, slip)
    tx = select(later, tangent[j, BEFORE, 0], tangent[j, AFTER, 0])
    ty = select(later, tangent[j, BEFORE, 1], tangent[j, AFTER, 1])
    dx = face[j, AFTER, k, 0] - face[j, BEFORE, k, 0] - slip * tx
    dy = face[j, AFTER, k, 1] - face[j, BEFORE, k, 1] - slip * ty
    return dx, dy


@inlined
def corner_slip(j, dx, dy, first, tangent):
    """Return the slip of a joint whose corners are (dx, dy) apart, touching at corner 0 if `first`
    [m].
    """
    slip = tangent[j, BEFORE, 0] * dx + tangent[j, BEFORE, 1] * dy
    by_b = tangent[j, AFTER, 0] * dx + tangent[j, AFTER, 1] * dy
    return select((slip >= 0.0) ^ opposite(first), slip, by_b)


@inlined
def clearance(j, k, face, tangent):
    """Return the gap at a corner, by whichever of Eqs 23a and 23b applies [m]."""
    dx = face[j, AFTER, k, 0] - face[j, BEFORE, k, 0]
    dy = face[j, AFTER, k, 1] - face[j, BEFORE, k, 1]
    ax = tangent[j, BEFORE, 0]
    ay = tangent[j, BEFORE, 1]
    bx = tangent[j, AFTER, 0]
    by = tangent[j, AFTER, 1]
    slip = ax * dx + ay * dy
    gap_a = ay * dx - ax * dy
    gap_b = by * dx - bx * dy
    size = abs(face[j, BEFORE, 1, 0] - face[j, BEFORE, 0, 0])
    size += abs(face[j, BEFORE, 1, 1] - face[j, BEFORE, 0, 1])
    both = abs(slip) <= COINCIDENT * (abs(dx) + abs(dy) + size)
    one = select(later_vertex_meets(k, slip), gap_a, gap_b)
    return select(both, larger(gap_a, gap_b), one)


@inlined
def slip_and_gap(j, at_0, at_1, face, tangent):
    """Return the slip of a joint, at the nearer corner if none touches, and its gap [m]."""
    gap_0 = clearance(j, 0, face, tangent)
    gap_1 = clearance(j, 1, face, tangent)
    none = opposite(at_0 | at_1)
    first = (none & (gap_1 >= gap_0)) | at_0
    dx = select(first, _shift(j, 0, 0, face), _shift(j, 1, 0, face))
    dy = select(first, _shift(j, 0, 1, face), _shift(j, 1, 1, face))
    return corner_slip(j, dx, dy, first, tangent), smaller(gap_0, gap_1)


@inlined
def _shift(j, k, c, face):
    return face[j, AFTER, k, c] - face[j, BEFORE, k, c]


@kernel
def place_chain(model, position, joints, least, slip, work):
    """Place faces, slips [m] and contacts of all joints where the bodies are.

    `joints` has the modes and known slips. The slip of a joint that slides, or touches nowhere, is
    measured at the corner that touches, or at the nearer one; below `least` of the joint's length
    there is none.

    Writes: slip, work (face, normal, pivot, point, rotated, side_normal, tangent).
    """
    move_faces(model, position, work.rotated, work.face, work.tangent)
    for j in range(slip.shape[0]):
        at_0 = joints.contact[j, 0] > 0.5
        at_1 = joints.contact[j, 1] > 0.5
        moves = (joints.slide[j] != 0.0) | opposite(at_0 | at_1)
        slip[j] = joints.slip[j]
        if some(moves):
            found, _ = slip_and_gap(j, at_0, at_1, work.face, work.tangent)
            found = select(abs(found) < least * model.length[j], 0.0, found)
            slip[j] = select(moves, found, slip[j])
    place_contacts(model, slip, work.face, work.tangent, work)


@inlined
def at_point(vx, vy, rotation, px, py):
    """Return the velocity at a point (px, py) from the pivot, of a body that moves by (vx, vy,
    rotation).
    """
    return vx - rotation * py, vy + rotation * px


@inlined
def corner_velocity(j, k, relative, work):
    """Return the relative velocity of the two faces at a corner, from that at the pivot."""
    px = work.point[j, k, 0] - work.pivot[j, 0]
    py = work.point[j, k, 1] - work.pivot[j, 1]
    return at_point(relative[j, 0], relative[j, 1], relative[j, 2], px, py)


@inlined
def corner_rate_at(j, px, py, position, velocity):
    """Return the velocity at a point of the body after joint j relative to the one before it (Eq
    22).
    """
    w = velocity[j + 1, 2]
    v = velocity[j, 2]
    ux = velocity[j + 1, 0] - w * (py - position[j + 1, 1])
    uy = velocity[j + 1, 1] + w * (px - position[j + 1, 0])
    ux = ux - (velocity[j, 0] - v * (py - position[j, 1]))
    uy = uy - (velocity[j, 1] + v * (px - position[j, 0]))
    return ux, uy


@kernel
def relative_velocity(position, velocity, pivot, out):
    """Find the velocity of the body after each joint relative to that before it, at pivots (Eq
    22).

    Reads: position, velocity, pivot.
    Writes: out.
    """
    for j in range(pivot.shape[0]):
        out[j, 0], out[j, 1] = corner_rate_at(
            j, pivot[j, 0], pivot[j, 1], position, velocity
        )
        out[j, 2] = velocity[j + 1, 2] - velocity[j, 2]
