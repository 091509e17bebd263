"""The contact problem between impacts: which corners touch, and what turning adds to their laws.

A contact that lasts constrains the relative acceleration of its points. Besides the unknown
accelerations of the bodies this contains terms of the second order in the velocities (Eqs
17-18): the centripetal accelerations of the material points, and where a vertex runs along a
turning face twice the product of both rates.
"""

from archfrag.mechanics.compile import kernel
from archfrag.mechanics.delassus import relative_velocity
from archfrag.mechanics.kinematics import clearance, vertex_on_earlier
from archfrag.mechanics.laws import (
    MINUS,
    OPEN,
    PLUS,
    STICK,
    closed_mode,
    corner_mode,
    is_closed,
    slip_of,
    touches,
)


@kernel
def place_pivots(contacts, pivot):
    """Middle of the two contact points of each joint, (n_joint, 2) [m], into `pivot`."""
    for j in range(pivot.shape[0]):
        pivot[j, 0] = 0.5 * (contacts.point[j, 0, 0] + contacts.point[j, 1, 0])
        pivot[j, 1] = 0.5 * (contacts.point[j, 0, 1] + contacts.point[j, 1, 1])


@kernel
def slip_normal(contacts, j, corner, closed, sense):
    """Normal at a corner for a slip of the given sense (Eq 23a or 23b)."""
    if closed:
        return contacts.normal[j, 0], contacts.normal[j, 1]
    if sense == MINUS:
        return contacts.normal_minus[j, corner, 0], contacts.normal_minus[j, corner, 1]
    return contacts.normal_plus[j, corner, 0], contacts.normal_plus[j, corner, 1]


@kernel
def centripetal_bias(contacts, mode, slip, velocity, bias):
    """What turning adds to the relative acceleration at each corner (Eqs 17, 18).

    Parameters
    ----------
    contacts : Contacts
        Placed; ``contacts.slip`` holds the sense of the slips under way.
    mode : ndarray, (n_joint,)
    slip : ndarray, (n_joint,) [m]
    velocity : ndarray, (n_body, 3)
    bias : ndarray, (n_joint, 2, 2)
        Overwritten [m/s2].
    """
    n_body = velocity.shape[0]
    for j in range(slip.size):
        sense = contacts.slip[j]
        for c in range(2):
            px, py = contacts.point[j, c, 0], contacts.point[j, c, 1]
            bx = by = ux = uy = 0.0
            before = after = 0.0
            if j < n_body:
                after = velocity[j, 2]
                rx, ry = px - contacts.centroid[j, 0], py - contacts.centroid[j, 1]
                bx -= after * after * rx
                by -= after * after * ry
                ux = velocity[j, 0] - after * ry
                uy = velocity[j, 1] + after * rx
            if j > 0:
                before = velocity[j - 1, 2]
                rx, ry = px - contacts.centroid[j - 1, 0], py - contacts.centroid[j - 1, 1]
                bx += before * before * rx
                by += before * before * ry
                ux -= velocity[j - 1, 0] - before * ry
                uy -= velocity[j - 1, 1] + before * rx
            if sense != STICK:
                nx, ny = slip_normal(contacts, j, c, is_closed(mode[j]), sense)
                place = slip[j] if slip[j] != 0.0 else -1.0 * sense
                face = before if vertex_on_earlier(c, place) else after
                twice = 2.0 * face * (nx * uy - ny * ux)
                bx += twice * nx
                by += twice * ny
            bias[j, c, 0] = bx
            bias[j, c, 1] = by


@kernel
def find_touching(
    before, after, length, velocity, mode, rate_limit, slip_limit, gap_limit, pivot, moved,
    contacts,
):  # fmt: skip
    """Which corners touch and stay, and which of them are sliding.

    Parameters
    ----------
    before, after : ndarray, (n_joint, 2, 2)
        Faces from `archfrag.mechanics.kinematics.move_faces`.
    length : ndarray, (n_joint,) [m]
    velocity : ndarray, (n_body, 3)
    mode : ndarray, (n_joint,)
        Corners in contact until now touch and stay, whatever the limits.
    rate_limit : float
        Relative velocities below this are none [m/s]; inf to look at positions only.
    slip_limit : float
        Slip rates below this may end at once [m/s].
    gap_limit : float
        Gaps below this part of a joint's length are none [1].
    pivot : ndarray, (n_joint, 2)
        Overwritten: middle of the contact points.
    moved : ndarray, (n_joint, 3)
        Overwritten: relative velocity at the pivots.
    contacts : Contacts
        Placed; `candidate` and `slip` are overwritten.
    """
    place_pivots(contacts, pivot)
    relative_velocity(contacts, velocity, pivot, moved)
    for j in range(length.size):
        sliding = 0.0
        for c in range(2):
            contacts.candidate[j, c] = 0
            held = touches(mode[j], c)
            if not held and clearance(j, c, before, after) > gap_limit * length[j]:
                continue
            rx = contacts.point[j, c, 0] - pivot[j, 0]
            ry = contacts.point[j, c, 1] - pivot[j, 1]
            ux = moved[j, 0] - moved[j, 2] * ry
            uy = moved[j, 1] + moved[j, 2] * rx
            plus = contacts.normal_plus[j, c, 0] * ux + contacts.normal_plus[j, c, 1] * uy
            minus = contacts.normal_minus[j, c, 0] * ux + contacts.normal_minus[j, c, 1] * uy
            if not held and max(plus, minus) > rate_limit:
                continue
            contacts.candidate[j, c] = 1
            along = contacts.normal[j, 0] * uy - contacts.normal[j, 1] * ux
            if abs(along) > abs(sliding):
                sliding = along
        contacts.slip[j] = STICK
        if abs(sliding) > slip_limit:
            contacts.slip[j] = MINUS if sliding > 0.0 else PLUS


@kernel
def admit_modes(contacts, mode):
    """Take from the modes what the touching corners do not allow.

    Parameters
    ----------
    contacts : Contacts
        With `candidate` and `slip` as from `find_touching`.
    mode : ndarray, (n_joint,) int8
        Changed in place: contact at a corner that does not touch is taken away, and a slip
        under way is kept.
    """
    for j in range(mode.size):
        sense = contacts.slip[j]
        corners = 0
        for c in range(2):
            if touches(mode[j], c) and contacts.candidate[j, c]:
                corners += 1 + c
        if corners == 0:
            mode[j] = OPEN
            continue
        kept = slip_of(mode[j]) if sense == STICK else sense
        mode[j] = closed_mode(kept) if corners == 3 else corner_mode(corners - 1, kept)


@kernel
def uniform_force(n_body, horizontal, vertical, gravity, free):
    """Accelerations without reactions, (n_body, 3), into `free` [m/s2]."""
    for i in range(n_body):
        free[i, 0] = -horizontal
        free[i, 1] = -gravity - vertical
        free[i, 2] = 0.0
