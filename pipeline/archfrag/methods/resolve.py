"""What follows an event: the contact problem of all voussoirs, by levels first.

At an impact it gives the velocities after it, otherwise the accelerations; in both cases the
contact modes from then on. What the two levels cannot settle is left to the general contact
problem, and counted.
"""

from typing import NamedTuple

import numpy as np

from archfrag.mechanics.acceleration import (
    admit_modes,
    centripetal_bias,
    find_touching,
    place_pivots,
    uniform_force,
)
from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.delassus import (
    Contacts,
    ContactWork,
    contact_work,
    velocity_scale,
)
from archfrag.mechanics.energy import kinetic_energy
from archfrag.mechanics.former_contact import newton_contact, path_contact
from archfrag.mechanics.kinematics import (
    clearance,
    empty_contacts,
    measure_slip,
    move_faces,
    place_contacts,
)
from archfrag.mechanics.laws import (
    CLOSED_STICK,
    OPEN,
    STICK,
    closed_mode,
    corner_mode,
    is_closed,
    slip_of,
    touches,
)
from archfrag.mechanics.levels import FewBodies, new_few_bodies, solve_levels
from archfrag.mechanics.mechanism import Mechanism, new_mechanism
from archfrag.mechanics.residuals import measure_state
from archfrag.mechanics.status import Count, Energy, Status

SOLVED = int(Status.STANDING)
# Corners this close, over the joint's length, touch; slower than this, over the speed of a fall
# through it, they stay.
TOUCHING = 1e-9
STAYING = 1e-8
# A slip slower than this part of it may end at once.
SLIPPING = 1e-6
# Accelerations beyond this many times gravity are no motion but a state in which rigid bodies
# with friction have none (Painleve).
IMPOSSIBLE = 300.0
# Where so many solution paths lead nowhere, time stepping takes over.
FEW_PATHS = 2
# Corners overlapping by more than this part of the joint's length are not closed by settling.
OVERLAP = 1e-6
# Relative velocities below this part of it are rounding: nothing is left to an impact.
PARTING = 1e-8


class Whole(NamedTuple):
    """All voussoirs at an event, with room for their contact problem."""

    position: np.ndarray  # (n_body, 3)
    velocity: np.ndarray  # (n_body, 3) before and after the event
    free: np.ndarray  # (n_body, 3)
    still: np.ndarray  # (n_body, 3) zeros
    before: np.ndarray  # (n_joint, 2, 2)
    after: np.ndarray  # (n_joint, 2, 2)
    length: np.ndarray  # (n_joint,)
    moved: np.ndarray  # (n_joint, 3)
    contacts: Contacts
    work: ContactWork
    mechanism: Mechanism
    bodies: FewBodies
    jam: np.ndarray  # (1,) int8: whether a corner without friction limit slid and has to stick


@allocating
def new_whole(n_body, n_joint, length):
    """Room for the events of a chain."""
    return Whole(
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_body, 3)),
        np.zeros((n_joint, 2, 2)),
        np.zeros((n_joint, 2, 2)),
        length,
        np.zeros((n_joint, 3)),
        empty_contacts(n_body, n_joint),
        contact_work(n_body, n_joint),
        new_mechanism(n_body, n_joint),
        new_few_bodies(n_body, n_joint),
        np.zeros(1, np.int8),
    )


@kernel
def place_whole(chain, whole, slip, mode):
    """Contacts of all joints where the voussoirs are.

    The slip of a joint without contact is measured at its nearer corner.
    """
    move_faces(chain, whole.position, whole.before, whole.after)
    for j in range(slip.size):
        corner = -1
        if mode[j] == OPEN:
            corner = 0
            gap = clearance(j, 0, whole.before, whole.after)
            if clearance(j, 1, whole.before, whole.after) < gap:
                corner = 1
        elif slip_of(mode[j]) != STICK:
            corner = 0 if touches(mode[j], 0) else 1
        if corner >= 0:
            slip[j] = measure_slip(j, corner, whole.before, whole.after)
            if abs(slip[j]) < TOUCHING * whole.length[j]:
                slip[j] = 0.0
    place_contacts(whole.position, whole.before, whole.after, slip, whole.length, whole.contacts)


@allocating
def _solve(chain, whole, slip, turning, scale, ledger):
    ledger.count[Count.LEVELS] += 1
    kept = whole.work.mode.copy()
    solved, rounds = solve_levels(
        chain,
        whole.contacts,
        slip,
        whole.length,
        turning,
        whole.free,
        scale,
        whole.mechanism,
        whole.bodies,
        whole.work,
    )
    if rounds > 1:
        ledger.count[Count.LEVEL_ITERATIONS] += 1
    if solved:
        return True
    ledger.count[Count.GENERAL] += 1
    whole.work.mode[:] = kept
    status, iterations = newton_contact(
        chain.mass, chain.inertia, whole.contacts, chain.friction, whole.free, whole.work
    )
    if status != SOLVED:
        status, more, _, _ = path_contact(
            chain.mass,
            chain.inertia,
            whole.contacts,
            chain.friction,
            whole.free,
            whole.work,
            FEW_PATHS,
        )
        iterations += more
        ledger.count[Count.PATHS] += 1
    ledger.count[Count.ITERATIONS] += iterations
    if status != SOLVED:
        return False
    for j in range(slip.size):
        # No solution path may turn round a slip that is under way.
        sense = whole.contacts.slip[j]
        if sense != STICK and whole.work.mode[j] != OPEN and slip_of(whole.work.mode[j]) != sense:
            return False
    return True


@allocating
def resolve_impact(chain, whole, slip, mode, joint, corner, ledger):
    """Velocities after an impact (Eqs 8, 9, 11 and 21).

    Parameters
    ----------
    chain : Chain
    whole : Whole
        At the instant; `velocity` is overwritten with that after the impact.
    slip : ndarray, (n_joint,) [m]
    mode : ndarray, (n_joint,) int8
        Changed to the contact modes of the velocities after it.
    joint, corner : int
        What closes, though its gap may not be exactly none; -1 if that is left to the gaps.
    ledger : Ledger
        The energy that the impact takes is booked.

    Returns
    -------
    bool
        False where no solution was found.
    """
    place_whole(chain, whole, slip, mode)
    contacts, work = whole.contacts, whole.work
    find_touching(
        whole.before, whole.after, whole.length, whole.velocity, mode, np.inf, np.inf, TOUCHING,
        work.pivot, whole.moved, contacts,
    )  # fmt: skip
    contacts.bias[:] = 0.0
    if joint >= 0:
        contacts.candidate[joint, corner] = 1
    for j in range(mode.size):
        contacts.slip[j] = STICK
        made = contacts.candidate[j, 0] + 2 * contacts.candidate[j, 1]
        work.mode[j] = OPEN
        if made == 3:
            work.mode[j] = 7
        elif made > 0:
            work.mode[j] = 1 + 3 * (made - 1)
    for i in range(chain.mass.size):
        for c in range(3):
            whole.free[i, c] = whole.velocity[i, c]
    place_pivots(contacts, work.pivot)
    scale = velocity_scale(contacts, whole.free, work)
    if scale > PARTING * np.sqrt(chain.gravity * np.max(whole.length)):
        if not _solve(chain, whole, slip, whole.still, scale, ledger):
            return False
        had = kinetic_energy(chain.mass, chain.inertia, whole.velocity)
        whole.velocity[:] = work.velocity
        left = kinetic_energy(chain.mass, chain.inertia, whole.velocity)
        ledger.energy[Energy.IMPACT] += left - had
    for j in range(mode.size):
        for c in range(2):
            if touches(work.mode[j], c) and not touches(mode[j], c):
                ledger.count[Count.IMPACTS] += 1
                break
        mode[j] = work.mode[j]
    return True


@allocating
def measure_event(chain, whole, slip, ledger):
    """Note how far the state that `resolve_accelerations` left is from the contact laws."""
    measure_state(
        chain, whole.position, whole.velocity, whole.before, whole.after, whole.length, slip,
        whole.work.reaction, whole.work.pivot, 1.0, whole.contacts, whole.work.relative,
        ledger.peak,
    )  # fmt: skip


@kernel
def settle(chain, whole, mode, slow):
    """End what an impact left so slow that its own end is as good as reached.

    A joint that rocks from corner to corner loses a fixed part of its rate at each impact and
    is closed after infinitely many of them, in a finite time; a slip ends by friction in a time
    in proportion to its rate. Those that are left below `slow` are taken to be over.

    Parameters
    ----------
    chain : Chain
    whole : Whole
        After `resolve_impact`.
    mode : ndarray, (n_joint,) int8
        Changed where a joint is taken to be closed, or to stick.
    slow : float
        Opening rate of a corner after an impact at the other one, or slip rate [m/s].

    Returns
    -------
    bool
        Whether any mode was changed: then the velocities have to be brought onto the modes.
    """
    contacts, work = whole.contacts, whole.work
    changed = False
    for j in range(mode.size):
        if mode[j] == OPEN:
            continue
        nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
        if not is_closed(mode[j]):
            other = 1 if touches(mode[j], 0) else 0
            gap = clearance(j, other, whole.before, whole.after)
            if contacts.candidate[j, other] and gap > -OVERLAP * whole.length[j]:
                rx = contacts.point[j, other, 0] - work.pivot[j, 0]
                ry = contacts.point[j, other, 1] - work.pivot[j, 1]
                ux = work.relative[j, 0] - work.relative[j, 2] * ry
                uy = work.relative[j, 1] + work.relative[j, 2] * rx
                if nx * ux + ny * uy < slow:
                    rough = np.isinf(chain.friction[j])
                    mode[j] = CLOSED_STICK if rough else closed_mode(slip_of(mode[j]))
                    changed = True
        slip_rate = abs(nx * work.relative[j, 1] - ny * work.relative[j, 0])
        if slip_of(mode[j]) != STICK and slip_rate < slow:
            corner = 0 if touches(mode[j], 0) else 1
            mode[j] = CLOSED_STICK if is_closed(mode[j]) else corner_mode(corner, STICK)
            changed = True
    return changed


@allocating
def resolve_accelerations(chain, whole, slip, mode, ground_x, ground_y, ledger):
    """Contact modes from now on, from the accelerations (Eqs 15-19, 29-35).

    Parameters
    ----------
    chain : Chain
    whole : Whole
        At the instant; ``work`` holds accelerations and reactions on return.
    slip : ndarray, (n_joint,) [m]
    mode : ndarray, (n_joint,) int8
        Where the search starts; changed to the modes from now on.
    ground_x, ground_y : float
        Ground acceleration from now on [m/s2].
    ledger : Ledger

    Returns
    -------
    bool
        False where no solution was found.
    """
    place_whole(chain, whole, slip, mode)
    contacts, work = whole.contacts, whole.work
    falling = np.sqrt(chain.gravity * np.max(whole.length))
    find_touching(
        whole.before, whole.after, whole.length, whole.velocity, mode, STAYING * falling,
        SLIPPING * falling, TOUCHING, work.pivot, whole.moved, contacts,
    )  # fmt: skip
    for j in range(mode.size):
        work.mode[j] = mode[j]
        if np.isinf(chain.friction[j]):
            if contacts.slip[j] != STICK:
                whole.jam[0] = 1
            contacts.slip[j] = STICK
            if is_closed(mode[j]):
                work.mode[j] = CLOSED_STICK
    admit_modes(contacts, work.mode)
    uniform_force(chain.mass.size, ground_x, ground_y, chain.gravity, whole.free)
    centripetal_bias(contacts, work.mode, slip, whole.velocity, contacts.bias)
    place_pivots(contacts, work.pivot)
    scale = velocity_scale(contacts, whole.free, work)
    scale = max(scale, chain.gravity)
    if not _solve(chain, whole, slip, whole.velocity, scale, ledger):
        return False
    for i in range(chain.mass.size):
        if abs(work.velocity[i, 0]) + abs(work.velocity[i, 1]) > IMPOSSIBLE * chain.gravity:
            return False
    for j in range(mode.size):
        if slip_of(work.mode[j]) != STICK and slip_of(mode[j]) == STICK:
            ledger.count[Count.SLIDES] += 1
        opened = is_closed(mode[j]) and not is_closed(work.mode[j])
        if opened or (mode[j] != OPEN and work.mode[j] == OPEN):
            ledger.count[Count.OPENINGS] += 1
        mode[j] = work.mode[j]
    return True
