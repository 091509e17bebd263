"""Place joint faces and the contacts that they can make; for one run or four.

At an open joint the two faces have different normals and Signorini's law splits into Eqs 23a
and 23b of the paper: a vertex of either body may meet the other's face.
"""

import math

from archfrag.physics.contact.laws import MINUS, PLUS, along, cross, touching
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import opposite, select, some
from archfrag.physics.neighbours import row_of
from archfrag.physics.numbers import choose, larger, sine_cosine, smaller

# Slip over joint length below which two vertices count as one point.
COINCIDENT = 1e-9
BEFORE = 0
AFTER = 1


@inlined
def later_vertex_meets(corner, slip):
    """Return whether the contact at a corner of a slipped joint is the later body's vertex.

    If it is, Eq 23a applies. Slip towards the extrados moves the later body's intrados vertex over
    the earlier body's face, and the earlier body's extrados vertex under the later body's.
    """
    if corner == 0:
        return slip >= 0.0
    return slip < 0.0


@kernel
def move_faces(model, position, work):
    """Set corners and unit tangents of all joint faces for given positions of the bodies.

    Reads: model (body, corner, tangent), position, work (face, rotated).
    Writes: work (face, rotated, tangent).
    """
    face = work.face
    for i in range(1, position.shape[0] - 1):
        work.rotated[i, 1], work.rotated[i, 0] = sine_cosine(position[i, 2])
    for j in range(face.shape[0]):
        for side in range(2):
            i = row_of(model, j, side)
            for k in range(2):
                x = model.corner[j, side, k, 0]
                x, y = outwards(work, i, x, model.corner[j, side, k, 1])
                face[j, side, k, 0] = position[i, 0] + x
                face[j, side, k, 1] = position[i, 1] + y
            x = model.tangent[j, side, 0]
            x, y = outwards(work, i, x, model.tangent[j, side, 1])
            work.tangent[j, side, 0] = x
            work.tangent[j, side, 1] = y


@inlined
def inwards(work, i, x, y):
    """Turn a vector from the fixed axes to the rest axes of body `i`.

    `outwards` is the inverse.
    """
    c = work.rotated[i, 0]
    s = work.rotated[i, 1]
    return c * x + s * y, c * y - s * x


@inlined
def outwards(work, i, x, y):
    """Turn a vector from the rest axes of body `i` to the fixed axes.

    `inwards` is the inverse.
    """
    c = work.rotated[i, 0]
    s = work.rotated[i, 1]
    return c * x - s * y, s * x + c * y


@inlined
def tangent_of(j, side, work):
    """Return the unit tangent of a face of joint `j`; `side` is BEFORE or AFTER."""
    return work.tangent[j, side, 0], work.tangent[j, side, 1]


@kernel
def place_contacts(model, slip, work):
    """Set contact points, pivots and normals of all joints from faces and slips [m].

    Reads: model.length, slip, work (face, point, side_normal, tangent).
    Writes: work (normal, pivot, point, side_normal).
    """
    point = work.point
    side_normal = work.side_normal
    for j in range(slip.shape[0]):
        ax, ay = tangent_of(j, BEFORE, work)
        bx, by = tangent_of(j, AFTER, work)
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
                first = work.face[j, BEFORE, k, c]
                second = work.face[j, AFTER, k, c]
                vertex = select(later, second, first)
                point[j, k, c] = select(meet, 0.5 * (first + second), vertex)
            # Where vertices coincide, that of the body whose face the slip runs along counts.
            apart = later & opposite(meet)
            for side in (PLUS, MINUS):
                before = apart if side == k else later | meet
                x, y = choose(before, (ay, ax), (by, bx))
                side_normal[j, k, side, 0] = x
                side_normal[j, k, side, 1] = -y
        for c in range(2):
            work.pivot[j, c] = 0.5 * (point[j, 0, c] + point[j, 1, c])


@inlined
def corner_offset(j, k, work, slip):
    """Return how far the later face's corner is from its place in contact (x, y) [m].

    That place is the one at `slip` [m].
    """
    later = later_vertex_meets(k, slip)
    tx, ty = choose(later, tangent_of(j, BEFORE, work), tangent_of(j, AFTER, work))
    dx, dy = _shift(j, k, work)
    return dx - slip * tx, dy - slip * ty


@inlined
def _shift(j, k, work):
    """Return the vector from the earlier face's corner `k` to the later one's."""
    face = work.face
    dx = face[j, AFTER, k, 0] - face[j, BEFORE, k, 0]
    return dx, face[j, AFTER, k, 1] - face[j, BEFORE, k, 1]


@inlined
def corner_slip(j, shift, first, work):
    """Return the slip of joint `j`, which touches at corner 0 if `first`, else at corner 1 [m].

    `shift` is the vector between the two faces' corners there.
    """
    slip = along(tangent_of(j, BEFORE, work), shift)
    by_after = along(tangent_of(j, AFTER, work), shift)
    return select((slip >= 0.0) ^ opposite(first), slip, by_after)


@inlined
def clearance(j, k, work):
    """Return the gap at corner `k` of joint `j`, by whichever of Eqs 23a and 23b applies [m]."""
    shift = _shift(j, k, work)
    before = tangent_of(j, BEFORE, work)
    slip = along(before, shift)
    gap_a = cross(shift, before)
    gap_b = cross(shift, tangent_of(j, AFTER, work))
    face = work.face
    size = abs(face[j, BEFORE, 1, 0] - face[j, BEFORE, 0, 0])
    size += abs(face[j, BEFORE, 1, 1] - face[j, BEFORE, 0, 1])
    both = abs(slip) <= COINCIDENT * (abs(shift[0]) + abs(shift[1]) + size)
    one = select(later_vertex_meets(k, slip), gap_a, gap_b)
    return select(both, larger(gap_a, gap_b), one)


@inlined
def slip_and_gap(j, at_0, at_1, work):
    """Return the slip of joint `j`, and the smaller gap of its corners [m].

    `at_0` and `at_1` are whether corners 0 and 1 touch. The slip is that at a corner that touches;
    if none does, at the nearer one.
    """
    gap_0 = clearance(j, 0, work)
    gap_1 = clearance(j, 1, work)
    first = (opposite(at_0 | at_1) & (gap_1 >= gap_0)) | at_0
    shift = choose(first, _shift(j, 0, work), _shift(j, 1, work))
    return corner_slip(j, shift, first, work), smaller(gap_0, gap_1)


@inlined
def least_gap(j, work):
    """Return the smaller of the gaps of a joint's corners [m]."""
    return smaller(clearance(j, 0, work), clearance(j, 1, work))


@kernel
def place_chain(model, position, joints, least, slip, work):
    """Place faces, slips [m] and contacts of all joints where the bodies are.

    `joints` has the modes and known slips. The slip of a joint that slides, or touches nowhere, is
    measured at the corner that touches, or else at the nearer one; below `least` times the joint's
    length it counts as zero.

    Writes: slip, work (face, normal, pivot, point, rotated, side_normal, tangent).
    """
    move_faces(model, position, work)
    for j in range(slip.shape[0]):
        at_0, at_1 = touching(j, joints)
        moves = (joints.slide[j] != 0.0) | opposite(at_0 | at_1)
        slip[j] = joints.slip[j]
        if some(moves):
            found, _ = slip_and_gap(j, at_0, at_1, work)
            found = select(abs(found) < least * model.length[j], 0.0, found)
            slip[j] = select(moves, found, slip[j])
    place_contacts(model, slip, work)


@inlined
def at_point(vx, vy, rotation, px, py):
    """Return the velocity of a moving body at a point (px, py) from the pivot.

    At the pivot the body moves by (vx, vy, rotation).
    """
    return vx - rotation * py, vy + rotation * px


@inlined
def corner_velocity(j, k, relative, work):
    """Return the relative velocity of the two faces at a corner, from that at the pivot."""
    px = work.point[j, k, 0] - work.pivot[j, 0]
    py = work.point[j, k, 1] - work.pivot[j, 1]
    return at_point(relative[j, 0], relative[j, 1], relative[j, 2], px, py)


@inlined
def _velocity_at(i, px, py, position, velocity):
    """Return the velocity of body `i` at the point (px, py)."""
    x = px - position[i, 0]
    y = py - position[i, 1]
    return at_point(velocity[i, 0], velocity[i, 1], velocity[i, 2], x, y)


@inlined
def corner_rate_at(j, px, py, model, position, velocity):
    """Return the velocity of the body after joint `j` relative to the one before it (Eq 22).

    It is that at the point (px, py).
    """
    ax, ay = _velocity_at(row_of(model, j, 1), px, py, position, velocity)
    bx, by = _velocity_at(row_of(model, j, 0), px, py, position, velocity)
    return ax - bx, ay - by


@inlined
def turn_of(j, model, of):
    """Return the rotation of the body after joint `j` less that of the one before it.

    Column 2 of `of` has rotations or their rates.
    """
    return of[row_of(model, j, 1), 2] - of[row_of(model, j, 0), 2]


@kernel
def relative_velocity(model, position, velocity, pivot, out):
    """Find the velocity of the body after each joint relative to the one before it (Eq 22).

    Velocities at the pivots and rates of rotation go into `out`, (n_joint, 3).

    Reads: model.body, position, velocity, pivot.
    Writes: out.
    """
    for j in range(pivot.shape[0]):
        out[j, 0], out[j, 1] = corner_rate_at(
            j, pivot[j, 0], pivot[j, 1], model, position, velocity
        )
        out[j, 2] = turn_of(j, model, velocity)
