"""The contact problem solved by levels: mega-voussoirs first, then the joints inside them.

Equal to `former_contact.solve_contact` wherever reactions are unique, and cheaper: in
each round a linear problem of as many bodies as move relative to each other, then a balance
propagated from joint to joint (Sinopoli, sections 3.3 and 3.4). A further round is needed only
where a law is broken, that is where a cone is reached, a contact parts, or a new hinge opens.
It serves accelerations and impacts alike (Eqs 10 and 21).
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.acceleration import centripetal_bias
from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.delassus import (
    TOLERANCE,
    Contacts,
    ContactWork,
    assemble,
    contact_work,
    relative_velocity,
    solve_modes,
)
from archfrag.mechanics.kinematics import empty_contacts
from archfrag.mechanics.laws import CLOSED_STICK, CORNER_STICK, OPEN, cross, is_closed, touches
from archfrag.mechanics.mechanism import GROUND, assemble_mechanism
from archfrag.mechanics.newton import closed_forces, is_finite, propose_modes
from archfrag.mechanics.reactions import four_hinges, is_four_hinges

ROUNDS = 32
# The few bodies' linear problem is solved once; where more than this is left it is near singular.
ILL_CONDITIONED = 1e-10


class FewBodies(NamedTuple):
    """Room for a chain of mega-voussoirs."""

    position: np.ndarray  # (n_body, 3)
    velocity: np.ndarray  # (n_body, 3)
    free: np.ndarray  # (n_body, 3)
    contacts: Contacts
    work: ContactWork


@allocating
def new_few_bodies(n_body, n_joint):
    """Room for as many mega-voussoirs as a chain has voussoirs."""
    return FewBodies(
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        empty_contacts(n_body, n_joint),
        contact_work(n_body, n_joint),
    )


@allocating
def view_few(room, n, m):
    """The first `n` bodies and `m` joints of the room, without copying."""
    c, w = room.contacts, room.work
    contacts = Contacts(
        c.centroid[:n],
        c.point[:m],
        c.normal[:m],
        c.normal_plus[:m],
        c.normal_minus[:m],
        c.candidate[:m],
        c.slip[:m],
        c.bias[:m],
    )
    work = ContactWork(
        w.velocity[:n],
        w.reaction[:m],
        w.mode[:m],
        w.pivot[:m],
        w.relative[:m],
        w.delassus[:m],
        w.coupling[:m],
        w.size[:m],
        w.row[:m],
        w.column[:m],
        w.factor[:m],
        w.exchange[:m],
        w.lower[:m],
        w.upper[:m],
        w.unknown[:m],
        w.rest[:m],
        w.best_mode[:m],
    )
    return FewBodies(room.position[:n], room.velocity[:n], room.free[:n], contacts, work)


@kernel
def _gather(chain, mechanism, contacts, mode, turning, free, few):
    """Contacts, velocities and free accelerations (or velocities) of the mega-voussoirs."""
    for k in range(few.position.shape[0]):
        mass = mechanism.mass[k]
        first, last = mechanism.first[k], mechanism.last[k]
        for c in range(3):
            few.free[k, c] = 0.0
        x = y = 0.0
        for i in range(first, last + 1):
            m = chain.mass[i] / mass
            x += m * contacts.centroid[i, 0]
            y += m * contacts.centroid[i, 1]
            few.free[k, 0] += m * free[i, 0]
            few.free[k, 1] += m * free[i, 1]
        few.position[k, 0], few.position[k, 1] = x, y
        few.contacts.centroid[k, 0], few.contacts.centroid[k, 1] = x, y
        moment = 0.0
        for i in range(first, last + 1):
            rx, ry = contacts.centroid[i, 0] - x, contacts.centroid[i, 1] - y
            dx, dy = free[i, 0] - few.free[k, 0], free[i, 1] - few.free[k, 1]
            moment += chain.mass[i] * cross(rx, ry, dx, dy) + chain.inertia[i] * free[i, 2]
        few.free[k, 2] = moment / mechanism.inertia[k]
        rx, ry = x - contacts.centroid[first, 0], y - contacts.centroid[first, 1]
        few.velocity[k, 0] = turning[first, 0] - turning[first, 2] * ry
        few.velocity[k, 1] = turning[first, 1] + turning[first, 2] * rx
        few.velocity[k, 2] = turning[first, 2]
    for k in range(few.work.mode.size):
        j = mechanism.joint[k]
        few.work.mode[k] = mode[j]
        few.contacts.slip[k] = contacts.slip[j]
        for d in range(2):
            few.contacts.normal[k, d] = contacts.normal[j, d]
            few.contacts.candidate[k, d] = contacts.candidate[j, d]
            for e in range(2):
                few.contacts.point[k, d, e] = contacts.point[j, d, e]
                few.contacts.normal_plus[k, d, e] = contacts.normal_plus[j, d, e]
                few.contacts.normal_minus[k, d, e] = contacts.normal_minus[j, d, e]


@kernel
def spread(chain, mechanism, contacts, turning, free, few, work):
    """All voussoirs' accelerations, and reactions by the balance from joint to joint."""
    n_body = chain.mass.size
    n_joint = work.mode.size
    for i in range(n_body):
        k = mechanism.group[i]
        if k == GROUND:
            work.velocity[i, 0] = work.velocity[i, 1] = work.velocity[i, 2] = 0.0
            continue
        rx = contacts.centroid[i, 0] - few.position[k, 0]
        ry = contacts.centroid[i, 1] - few.position[k, 1]
        turn, square = few.work.velocity[k, 2], turning[i, 2] * turning[i, 2]
        work.velocity[i, 0] = few.work.velocity[k, 0] - turn * ry - square * rx
        work.velocity[i, 1] = few.work.velocity[k, 1] + turn * rx - square * ry
        work.velocity[i, 2] = turn
    for j in range(n_joint):
        work.pivot[j, 0] = 0.5 * (contacts.point[j, 0, 0] + contacts.point[j, 1, 0])
        work.pivot[j, 1] = 0.5 * (contacts.point[j, 0, 1] + contacts.point[j, 1, 1])
    for k in range(few.work.mode.size):
        j = mechanism.joint[k]
        fx, fy = few.work.reaction[k, 0], few.work.reaction[k, 1]
        rx = few.work.pivot[k, 0] - work.pivot[j, 0]
        ry = few.work.pivot[k, 1] - work.pivot[j, 1]
        work.reaction[j, 0], work.reaction[j, 1] = fx, fy
        work.reaction[j, 2] = few.work.reaction[k, 2] + cross(rx, ry, fx, fy)
        end = mechanism.joint[k + 1] if k + 1 < few.work.mode.size else n_joint
        for i in range(j, min(end - 1, n_joint - 1)):
            _carry(chain, contacts, free, work, i, i, i + 1, -1.0)
    for i in range(mechanism.joint[0] - 1, -1, -1):
        _carry(chain, contacts, free, work, i, i + 1, i, 1.0)
    relative_velocity(contacts, work.velocity, work.pivot, work.relative)


@kernel
def _carry(chain, contacts, free, work, i, known, wanted, sense):
    """Reaction at one joint of a voussoir from that at its other one."""
    hx = sense * chain.mass[i] * (work.velocity[i, 0] - free[i, 0])
    hy = sense * chain.mass[i] * (work.velocity[i, 1] - free[i, 1])
    ht = sense * chain.inertia[i] * (work.velocity[i, 2] - free[i, 2])
    fx, fy = work.reaction[known, 0], work.reaction[known, 1]
    px, py = work.pivot[wanted, 0], work.pivot[wanted, 1]
    moment = work.reaction[known, 2]
    moment += cross(work.pivot[known, 0] - px, work.pivot[known, 1] - py, fx, fy)
    moment += ht + cross(contacts.centroid[i, 0] - px, contacts.centroid[i, 1] - py, hx, hy)
    work.reaction[wanted, 0] = fx + hx
    work.reaction[wanted, 1] = fy + hy
    work.reaction[wanted, 2] = moment


@kernel
def _solve_few(mechanism, slip, few):
    n, m = few.position.shape[0], few.work.mode.size
    if is_four_hinges(few.work.mode, n) and four_hinges(
        mechanism.mass, mechanism.inertia, few.velocity, few.free, few.contacts, few.work
    ):
        return True
    for k in range(m):
        mechanism.slip[k] = slip[mechanism.joint[k]]
    centripetal_bias(
        few.contacts, few.work.mode, mechanism.slip[:m], few.velocity, few.contacts.bias
    )
    assemble(mechanism.mass[:n], mechanism.inertia[:n], few.contacts, few.work)
    left = solve_modes(
        mechanism.mass[:n],
        mechanism.inertia[:n],
        few.contacts,
        mechanism.friction[:m],
        few.free,
        few.work,
        1.0,
        0.0,
        False,
    )
    scale = 0.0
    for k in range(n):
        scale = max(scale, abs(few.free[k, 0]), abs(few.free[k, 1]))
    return left <= ILL_CONDITIONED * scale


@kernel
def _worst_loss(contacts, work):
    """Of the joints that ask to lose their only contact the one that pulls most; -1 if none."""
    worst_joint = -1
    worst = -np.inf
    for j in range(work.mode.size):
        if work.best_mode[j] == OPEN and work.mode[j] != OPEN and not is_closed(work.mode[j]):
            corner = 0 if touches(work.mode[j], 0) else 1
            fx, fy = work.reaction[j, 0], work.reaction[j, 1]
            nx = contacts.normal_plus[j, corner, 0] + contacts.normal_minus[j, corner, 0]
            ny = contacts.normal_plus[j, corner, 1] + contacts.normal_minus[j, corner, 1]
            pull = -(fx * nx + fy * ny)
            if pull > worst:
                worst_joint, worst = j, pull
    return worst_joint


@kernel
def _take_changes(contacts, friction, work):
    """Modes of the next round.

    Inside a mega-voussoir the thrust leaves many joints at once where it leaves one far: only
    the joint where it is farthest outside changes, to a hinge rather than to no contact. Of the
    hinges that pull only the one that pulls most is lost. The next round shows what is left.
    """
    worst_joint = -1
    worst = 0.0
    n_joint = work.mode.size
    loss = _worst_loss(contacts, work)
    for j in range(n_joint + 1):
        if j < n_joint and work.mode[j] == CLOSED_STICK:
            if work.best_mode[j] != CLOSED_STICK:
                force_0, force_1, tangential = closed_forces(j, contacts, work)
                violation = -min(force_0, force_1)
                if not np.isinf(friction[j]):
                    bound = friction[j] * max(force_0 + force_1, 0.0)
                    violation = max(violation, abs(tangential) - bound)
                if worst_joint < 0 or violation > worst:
                    worst_joint, worst = j, violation
            continue
        if worst_joint >= 0:
            mode = work.best_mode[worst_joint]
            if mode == OPEN:
                force_0, force_1, _ = closed_forces(worst_joint, contacts, work)
                mode = CORNER_STICK[0 if force_0 > force_1 else 1]
            work.mode[worst_joint] = mode
            worst_joint = -1
        if j < n_joint and (loss < 0 or work.best_mode[j] != OPEN or j == loss):
            work.mode[j] = work.best_mode[j]


@allocating
def solve_levels(chain, contacts, slip, length, turning, free, scale, mechanism, room, work):
    """First and second level, from the modes in ``work.mode``.

    Parameters
    ----------
    chain : Chain
    contacts : Contacts
        Of all joints: placed, `candidate` and `slip` as from
        `archfrag.mechanics.acceleration.find_touching`, `bias` for all voussoirs.
    slip, length : ndarray, (n_joint,) [m]
    turning : ndarray, (n_body, 3)
        Velocities whose centripetal terms count: the present ones for accelerations, zeros
        for impacts.
    free : ndarray, (n_body, 3)
        Accelerations (or velocities) without reactions.
    scale : float
        Largest relative acceleration (or velocity) of a joint without reactions.
    mechanism : Mechanism
        Overwritten: the grouping of the solution.
    room : FewBodies
    work : ContactWork
        ``work.mode`` is where the search starts; holds the solution on return.

    Returns
    -------
    solved : bool
        False where the rounds do not settle, or reactions are not unique: then the general
        contact problem has to be solved.
    rounds : int
    """
    for number in range(ROUNDS):
        n, m = assemble_mechanism(chain, work.mode, slip, length, mechanism)
        if m == 0 or n == 0:
            return False, number + 1
        few = view_few(room, n, m)
        _gather(chain, mechanism, contacts, work.mode, turning, free, few)
        if not _solve_few(mechanism, slip, few):
            return False, number + 1
        spread(chain, mechanism, contacts, turning, free, few, work)
        force_scale = 0.0
        for j in range(work.mode.size):
            force_scale = max(force_scale, abs(work.reaction[j, 0]), abs(work.reaction[j, 1]))
        if force_scale == 0.0:
            force_scale = 1.0
        changed, _ = propose_modes(contacts, chain.friction, work, scale, force_scale, TOLERANCE)
        if changed == 0:
            return is_finite(work.velocity), number + 1
        _take_changes(contacts, chain.friction, work)
    return False, ROUNDS
