"""Second level: the balance propagated from joint to joint inside mega-voussoirs (section 3.4).

It gives the contact centre e of Eq 34 at every joint that is closed and sticks, and with it new
hinges and slides. Reactions are kept in the axes at rest of the body that they lie in, with the
moment about its centroid, where the places of its voussoirs do not change.
"""

import math

from archfrag.physics.contact.laws import (
    FORCE_0,
    FORCE_1,
    FRICTION_MINUS,
    FRICTION_PLUS,
    along,
    cross,
    force_of,
)
from archfrag.physics.contact.placing import inwards, outwards
from archfrag.physics.kernels.kernel import inlined, kernel


@inlined
def _joint_margins(model, mega, j, fx, fy, moment, per_weight, value):
    """Set the margins of Signorini's and Coulomb's laws at closed joint `j`, for its reaction.

    The forces at the two corners are those whose resultant acts at the contact centre of Eq 34: e
    = force at corner 1 over their sum.
    """
    mega.inner_reaction[j, 0] = fx
    mega.inner_reaction[j, 1] = fy
    mega.inner_reaction[j, 2] = moment
    normal = mega.inner_normal[j]
    force = (fx, fy)
    first = mega.inner_point[j, 0]
    second = mega.inner_point[j, 1]
    half = cross((first[0] - second[0], first[1] - second[1]), normal)
    margin = value[j]
    margin[FORCE_0] = per_weight * (moment - cross(second, force)) / half
    margin[FORCE_1] = -per_weight * (moment - cross(first, force)) / half
    if not math.isinf(model.friction[j]):
        bound = model.friction[j] * along(force, normal)
        shear = cross(normal, force)
        margin[FRICTION_PLUS] = per_weight * (bound - shear)
        margin[FRICTION_MINUS] = per_weight * (bound + shear)


@inlined
def _boundary(mega, k, position):
    """Return the reaction at joint `k` of the mega-voussoirs: x, y, and moment.

    The moment is that about `position`, (x, y).
    """
    work = mega.work
    force = force_of(k, work)
    arm = work.pivot[k, 0] - position[0], work.pivot[k, 1] - position[1]
    return force[0], force[1], work.reaction[k, 2] + cross(arm, force)


@inlined
def _propagate(model, mega, places, wrench, motion, per_weight, value):
    """Set the margins at joints from a body's boundary inwards, by balance of its voussoirs.

    `places` has the first voussoir, the one behind the last, and the sense, 1 or -1. `wrench` is
    the reaction at the boundary: x, y, moment about the centroid. `motion` is the acceleration of
    the body: x, y, that of the rotation, and the square of the rate.
    """
    first, last, sense = places
    fx, fy, moment = wrench
    ahead_x, ahead_y, angular, square = motion
    for i in range(first, last, sense):
        x = mega.offset[i, 0]
        y = mega.offset[i, 1]
        pull = mega.pull[i]
        hx = model.mass[i] * (ahead_x - angular * y - square * x)
        hy = model.mass[i] * (ahead_y + angular * x - square * y)
        fx = fx - sense * hx + sense * pull[0]
        fy = fy - sense * hy + sense * pull[1]
        spin = cross((x, y), (hx, hy)) + model.inertia[i] * angular
        moment -= sense * (spin - pull[2])
        joint = i if sense > 0 else i - 1
        _joint_margins(model, mega, joint, fx, fy, moment, per_weight, value)


@kernel
def solve_second_level(model, mega, position, velocity, ground, per_weight, value):
    """Set the margins of the contact laws at all joints inside mega-voussoirs (Eqs 34-35).

    This follows `solve_first_level`. At joints that are closed and stick the margins are the
    forces at both corners and, if friction is limited, those of Coulomb's law; they go into
    `value`, (n_joint, N_LAW). `model` is that of the voussoirs, `position` and `velocity` are
    those of the mega-voussoirs; forces are multiplied by `per_weight` [1/N].
    ``mega.inner_reaction`` is overwritten.

    Writes: mega.inner_reaction, value.
    """
    n_row = mega.group.size
    solved = mega.work.solved
    x = ground[0]
    y = ground[1] + model.gravity
    for k in range(1, mega.count[0] + 1):
        fx, fy, moment = _boundary(mega, k - 1, position[k])
        fx, fy = inwards(mega.work, k, fx, fy)
        ahead_x, ahead_y = inwards(mega.work, k, solved[k, 0] + x, solved[k, 1] + y)
        motion = ahead_x, ahead_y, solved[k, 2], velocity[k, 2] * velocity[k, 2]
        places = mega.first[k], mega.last[k], 1
        _propagate(model, mega, places, (fx, fy, moment), motion, per_weight, value)
    if mega.count[1] == 0:
        return
    # Voussoirs that rest on the ground before the first joint, and behind the last.
    wrench = _boundary(mega, 0, (0.0, 0.0))
    places = mega.joint[0], 0, -1
    _propagate(model, mega, places, wrench, (x, y, 0.0, 0.0), per_weight, value)
    if model.friction.size == n_row - 2:
        return
    last = mega.count[1] - 1
    end = mega.count[0] + 1
    wrench = _boundary(mega, last, position[end])
    motion = x + solved[end, 0], y + solved[end, 1], 0.0, 0.0
    places = mega.joint[last] + 1, n_row - 1, 1
    _propagate(model, mega, places, wrench, motion, per_weight, value)


@kernel
def joint_reactions(mega, work):
    """Set the reactions of all joints after both levels, about the pivots of `work`.

    Writes: work.reaction.
    """
    k = 0
    for j in range(work.reaction.shape[0]):
        if k < mega.count[1] and mega.joint[k] == j:
            x, y, moment = _boundary(mega, k, work.pivot[j])
            k += 1
        else:
            wrench = mega.inner_reaction[j]
            point = mega.inner_point[j]
            px = 0.5 * (point[0, 0] + point[1, 0])
            py = 0.5 * (point[0, 1] + point[1, 1])
            moment = wrench[2] - cross((px, py), wrench)
            x, y = outwards(mega.work, mega.group[j], wrench[0], wrench[1])
        work.reaction[j, 0] = x
        work.reaction[j, 1] = y
        work.reaction[j, 2] = moment
