"""When a chain in motion may be taken to be at rest, and until when it stays so."""

import numpy as np

from archfrag.mechanics.compile import allocating, kernel
from archfrag.mechanics.ground import acceleration_at, end_of_rest, rest_margin
from archfrag.mechanics.kinematics import clearance, measure_slip, move_faces, place_contacts
from archfrag.mechanics.onset import rest_limit

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
def read_slips(chain, stepper, joints, position):
    """Slips of all joints of an initial state, each at its nearer corner."""
    before, after = stepper.before, stepper.after
    move_faces(chain, position, before, after)
    for j in range(joints.slip.size):
        corner = 0
        if clearance(j, 1, before, after) < clearance(j, 0, before, after):
            corner = 1
        joints.slip[j] = measure_slip(j, corner, before, after)
        if abs(joints.slip[j]) < CLOSED_GAP * stepper.length[j]:
            joints.slip[j] = 0.0
