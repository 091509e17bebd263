"""When a chain in motion may be taken to be at rest, and until when it stays so."""

import numpy as np

from archfrag.mechanics.acceleration import place_pivots, uniform_force
from archfrag.mechanics.collapse import note_gap, note_loss
from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.former_contact import newton_contact
from archfrag.mechanics.ground import acceleration_at, end_of_rest, rest_margin
from archfrag.mechanics.kinematics import clearance, measure_slip, move_faces, place_contacts
from archfrag.mechanics.laws import OPEN, STICK, corner_mode, touches
from archfrag.mechanics.onset import rest_limit
from archfrag.mechanics.status import Status

SOLVED = int(Status.STANDING)
CLOSED_GAP = 1e-7


@allocating
def rest_range(chain, position, joints, stepper):
    """Load factors between which a configuration would stay at rest, into ``stepper.rest``.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    position : ndarray, (n_body, 3)
    joints : archfrag.mechanics.collapse.JointState
    stepper : archfrag.methods.stepping.Stepper
        Its faces are those of `position`.

    Returns
    -------
    bool
        False if no load factor leaves it at rest.
    """
    contacts = stepper.contacts
    place_contacts(position, stepper.before, stepper.after, joints.slip, stepper.length, contacts)
    n_joint = joints.slip.size
    candidate = np.ones((n_joint, 2), np.int8)
    for j in range(n_joint):
        for c in range(2):
            if clearance(j, c, stepper.before, stepper.after) > CLOSED_GAP * stepper.length[j]:
                candidate[j, c] = 0
    centroid = position[:, :2].copy()
    for k in range(2):
        sense = 1.0 - 2.0 * k
        limit = rest_limit(
            chain.mass,
            centroid,
            contacts.point,
            contacts.normal,
            candidate,
            chain.friction,
            chain.gravity,
            sense,
        )
        if not limit.found:
            return False
        stepper.rest[k] = sense * limit.load_factor
    return True


@allocating
def rests(chain, ground, stepper, joints, position, time):
    """Whether the ground motion leaves a still chain at rest; the range into the stepper.

    Parameters
    ----------
    time : float [s]
        For the others see `rest_range`.

    Returns
    -------
    bool
    """
    if not rest_range(chain, position, joints, stepper):
        return False
    sampling = ground.time_step
    margin = rest_margin(
        acceleration_at(time, ground.horizontal, sampling),
        acceleration_at(time, ground.vertical, sampling),
        chain.gravity,
        stepper.rest[0],
        stepper.rest[1],
    )
    return margin > 0.0


@kernel
def leave_rest(chain, ground, rest, time):
    """Until when a chain at rest stays so.

    Parameters
    ----------
    chain : archfrag.mechanics.types.Chain
    ground : archfrag.mechanics.types.GroundMotion
    rest : ndarray, (2,)
        Limits of its rest range.
    time : float [s]

    Returns
    -------
    leave : float
        When it starts to move, or where the record ends [s].
    for_good : bool
        Whether it stays at rest for ever.
    """
    record_end = (ground.horizontal.size - 1) * ground.time_step
    leave = end_of_rest(time, ground, chain.gravity, rest[0], rest[1])
    if leave < record_end:
        return leave, False
    stays = rest_margin(0.0, 0.0, chain.gravity, rest[0], rest[1]) >= 0.0
    return max(time, record_end), stays


@kernel
def read_joints(chain, stepper, joints, position):
    """Slips and contact modes of all joints of an initial state, from positions alone.

    A joint that is open at both corners has been without contact since time zero.
    """
    before, after, length = stepper.before, stepper.after, stepper.length
    move_faces(chain, position, before, after)
    for j in range(joints.slip.size):
        first = clearance(j, 0, before, after)
        second = clearance(j, 1, before, after)
        nearer = 1 if second < first else 0
        joints.slip[j] = measure_slip(j, nearer, before, after)
        if abs(joints.slip[j]) < CLOSED_GAP * length[j]:
            joints.slip[j] = 0.0
        if min(first, second) > CLOSED_GAP * length[j]:
            joints.mode[j] = OPEN
            note_loss(j, 0.0, position, length, joints)
            note_gap(j, min(first, second) / length[j], joints)
        elif max(first, second) > CLOSED_GAP * length[j]:
            joints.mode[j] = joints.last_contact[j] = corner_mode(nearer, STICK)


@allocating
def rest_reactions(chain, ground, stepper, joints, position, time):
    """Reactions of a chain at rest, as forces, into ``stepper.work``; zero where none is found.

    Parameters
    ----------
    time : float
        Instant whose body force they balance [s].
    stepper : archfrag.methods.stepping.Stepper
        Its faces are those of `position`; for the others see `rest_range`.
    """
    contacts, work = stepper.contacts, stepper.work
    place_contacts(position, stepper.before, stepper.after, joints.slip, stepper.length, contacts)
    place_pivots(contacts, work.pivot)
    contacts.bias[:] = 0.0
    contacts.slip[:] = STICK
    for j in range(joints.mode.size):
        work.mode[j] = joints.mode[j]
        for c in range(2):
            contacts.candidate[j, c] = touches(joints.mode[j], c)
    uniform_force(
        position.shape[0],
        acceleration_at(time, ground.horizontal, ground.time_step),
        acceleration_at(time, ground.vertical, ground.time_step),
        chain.gravity,
        stepper.free,
    )
    solved, _ = newton_contact(
        chain.mass, chain.inertia, contacts, chain.friction, stepper.free, work
    )
    if solved != SOLVED:
        work.reaction[:] = 0.0
