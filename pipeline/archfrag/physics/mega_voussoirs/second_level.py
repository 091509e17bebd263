"""Second level: the balance propagated from joint to joint inside mega-voussoirs (section 3.4).

It gives the contact centre e of Eq 34 at every joint that is closed and sticks, and with it new
hinges and slides. Reactions are kept in the axes at rest of the body that they lie in, with the
moment about its centroid, where the places of its voussoirs do not change.
"""

import math

from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.mega_voussoirs.first_level import cross

# Laws of a joint; margins of those that do not concern it are infinite. Normal forces at both
# corners (at a corner that slides the force on it), Coulomb's law for a friction of either sense,
# gaps at both corners, end of a slip.
FORCE_0 = 0
FORCE_1 = 1
FRICTION_PLUS = 2
FRICTION_MINUS = 3
GAP_0 = 4
GAP_1 = 5
SLIP_END = 6
N_LAW = 7


@inlined
def _joint_margins(model, mega, j, fx, fy, moment, per_weight, value):
    """Set the margins of Signorini's and Coulomb's laws at one closed joint.

    The forces at the two corners are those whose resultant acts at the contact centre of Eq 34:
    e = force at corner 1 over their sum.
    """
    mega.inner_reaction[j, 0] = fx
    mega.inner_reaction[j, 1] = fy
    mega.inner_reaction[j, 2] = moment
    normal = (mega.inner_normal[j, 0], mega.inner_normal[j, 1])
    force = (fx, fy)
    first = mega.inner_point[j, 0, 0], mega.inner_point[j, 0, 1]
    second = mega.inner_point[j, 1, 0], mega.inner_point[j, 1, 1]
    half = cross((first[0] - second[0], first[1] - second[1]), normal)
    value[j, FORCE_0] = per_weight * (moment - cross(second, force)) / half
    value[j, FORCE_1] = -per_weight * (moment - cross(first, force)) / half
    if not math.isinf(model.friction[j]):
        bound = model.friction[j] * (fx * normal[0] + fy * normal[1])
        shear = fy * normal[0] - fx * normal[1]
        value[j, FRICTION_PLUS] = per_weight * (bound - shear)
        value[j, FRICTION_MINUS] = per_weight * (bound + shear)


@inlined
def _boundary(mega, k, position):
    """Return the reaction between mega-voussoirs k and k + 1, its moment about `position`."""
    work = mega.work
    force = work.reaction[k, 0], work.reaction[k, 1]
    arm = work.pivot[k, 0] - position[0], work.pivot[k, 1] - position[1]
    return force[0], force[1], work.reaction[k, 2] + cross(arm, force)


@kernel
def solve_second_level(model, mega, position, velocity, ground, per_weight, value):
    """Set the margins of the contact laws at all joints inside mega-voussoirs (Eqs 34-35).

    After `solve_first_level`, of joints that are closed and stick: forces at both corners, and
    Coulomb's law if friction is limited, into `value` (n_joint, N_LAW). `model` is that of the
    voussoirs, `position` and `velocity` are those of the mega-voussoirs; forces are multiplied by
    `per_weight` [1/N]. ``mega.inner_reaction`` is overwritten.

    Writes: mega.inner_reaction, value.
    """
    n_row = mega.group.size
    work = mega.work
    offset = mega.offset
    pull = mega.pull
    ground_x = ground[0]
    body_y = ground[1] + model.gravity
    for k in range(1, mega.count[0] + 1):
        c = work.rotated[k, 0]
        s = work.rotated[k, 1]
        x, y, moment = _boundary(mega, k - 1, (position[k, 0], position[k, 1]))
        fx = c * x + s * y
        fy = c * y - s * x
        x = work.solved[k, 0] + ground_x
        y = work.solved[k, 1] + body_y
        ahead_x = c * x + s * y
        ahead_y = c * y - s * x
        angular = work.solved[k, 2]
        square = velocity[k, 2] * velocity[k, 2]
        for i in range(mega.first[k], mega.last[k]):
            x = offset[i, 0]
            y = offset[i, 1]
            hx = model.mass[i] * (ahead_x - angular * y - square * x)
            hy = model.mass[i] * (ahead_y + angular * x - square * y)
            fx = fx - hx + pull[i, 0]
            fy = fy - hy + pull[i, 1]
            moment -= cross((x, y), (hx, hy)) + model.inertia[i] * angular - pull[i, 2]
            _joint_margins(model, mega, i, fx, fy, moment, per_weight, value)
    if mega.count[1] == 0:
        return
    # Voussoirs that rest on the ground before the first joint, and behind the last.
    fx, fy, moment = _boundary(mega, 0, (0.0, 0.0))
    for i in range(mega.joint[0], 0, -1):
        hx = model.mass[i] * ground_x
        hy = model.mass[i] * body_y
        fx = fx + hx - pull[i, 0]
        fy = fy + hy - pull[i, 1]
        moment += cross((offset[i, 0], offset[i, 1]), (hx, hy)) - pull[i, 2]
        _joint_margins(model, mega, i - 1, fx, fy, moment, per_weight, value)
    if model.friction.size == n_row - 2:
        return
    last = mega.count[1] - 1
    end = mega.count[0] + 1
    fx, fy, moment = _boundary(mega, last, (position[end, 0], position[end, 1]))
    ahead_x = ground_x + work.solved[end, 0]
    ahead_y = body_y + work.solved[end, 1]
    for i in range(mega.joint[last] + 1, n_row - 1):
        hx = model.mass[i] * ahead_x
        hy = model.mass[i] * ahead_y
        fx = fx - hx + pull[i, 0]
        fy = fy - hy + pull[i, 1]
        moment -= cross((offset[i, 0], offset[i, 1]), (hx, hy)) - pull[i, 2]
        _joint_margins(model, mega, i, fx, fy, moment, per_weight, value)


@kernel
def joint_reactions(mega, work):
    """Set the reactions of all joints after both levels, about the pivots of `work`.

    Writes: work.reaction.
    """
    k = 0
    for j in range(work.reaction.shape[0]):
        if k < mega.count[1] and mega.joint[k] == j:
            x, y, moment = _boundary(mega, k, (work.pivot[j, 0], work.pivot[j, 1]))
            k += 1
        else:
            c = mega.work.rotated[mega.group[j], 0]
            s = mega.work.rotated[mega.group[j], 1]
            x = mega.inner_reaction[j, 0]
            y = mega.inner_reaction[j, 1]
            moment = mega.inner_reaction[j, 2]
            px = 0.5 * (mega.inner_point[j, 0, 0] + mega.inner_point[j, 1, 0])
            py = 0.5 * (mega.inner_point[j, 0, 1] + mega.inner_point[j, 1, 1])
            moment -= cross((px, py), (x, y))
            x, y = c * x - s * y, s * x + c * y
        work.reaction[j, 0] = x
        work.reaction[j, 1] = y
        work.reaction[j, 2] = moment
