"""Assemble mega-voussoirs: one body for voussoirs that do not move relative to each other.

Voussoirs whose common joint is closed and sticks move as one body (Sinopoli, section 3.3). Such
mega-voussoirs in a row, with the ones that rest on the ground taken as ground, are again a chain
of rigid bodies, so that every kernel for a `Model` serves them too. A joint that has slid and
sticks keeps its slip.
"""

from typing import Any, NamedTuple

import numpy as np

from archfrag.physics.contact.laws import cross
from archfrag.physics.contact.placing import BEFORE, later_vertex_meets
from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.structs import place_of, struct, struct_at
from archfrag.physics.numbers import sine_cosine
from archfrag.physics.state import Model, State, Work, new_state, new_work
from archfrag.physics.status import TieState

GROUND = 0


# Arrays by whose lengths kernels count joints; and arrays by whose lengths they count bodies.
COUNTED = ("face", "slip", "pivot", "slide", "row", "unknown", "residual")
OF_MOTION = ("position", "velocity", "next_position", "next_velocity")
OF_BODIES = {"offset": (2,), "pull": (3,), **dict.fromkeys(OF_MOTION, (3,))}
OF_JOINTS = {"inner_point": (2, 2), "inner_normal": (2,), "inner_reaction": (3,)}


@struct(**OF_BODIES, **OF_JOINTS, tie=(len(TieState),), stretch=(2,))
class MegaVoussoirs(NamedTuple):
    """A chain of mega-voussoirs, in arrays as long as those of the voussoirs.

    The first rows of the arrays are used.
    """

    # (2,) int64: mega-voussoirs, joints between them
    count: np.ndarray  # type: ignore[assignment]
    first: np.ndarray  # (n_body + 2,) int64: row of the first voussoir of each
    last: np.ndarray  # (n_body + 2,) int64: row of its last one
    # (n_joint,) int64: number in the chain of each joint between mega-voussoirs
    joint: np.ndarray
    # (n_body + 2,) int64: row of each voussoir's mega-voussoir; of those that rest on a springing
    # GROUND or the last row in use
    group: np.ndarray
    offset: (
        np.ndarray
    )  # (n_body + 2, 2) from the centroid of its body, in the axes at rest [m]
    inner_point: np.ndarray  # (n_joint, 2, 2) contacts inside a body, as `offset` [m]
    inner_normal: np.ndarray  # (n_joint, 2) in the axes at rest
    inner_reaction: (
        np.ndarray
    )  # (n_joint, 3) in the axes at rest: x, y, moment about the centroid
    tie: np.ndarray  # (n_tie, len(TieState)) the memory of ``State.tie``
    stretch: np.ndarray  # (n_tie, 2) elongations [m] and their rates [m/s]
    pull: np.ndarray  # (n_body + 2, 3) forces of ties on voussoirs, as `inner_reaction`
    model: Model
    work: Work
    position: np.ndarray  # (n_body + 2, 3)
    velocity: np.ndarray  # (n_body + 2, 3)
    next_position: (
        np.ndarray
    )  # (n_body + 2, 3) where a step leads, or where it was looked at
    next_velocity: np.ndarray  # (n_body + 2, 3)
    cut: np.ndarray  # (n_joint + 1, n) int64, see `in_use`


def new_mega_voussoirs(model: Model, state: State | None = None) -> MegaVoussoirs:
    """Return the workspace for any mega-voussoirs of a chain, with the ties of `state`."""
    n_row = model.mass.size
    n_joint = model.friction.size
    given = model._asdict()
    arrays_of = {k: v for k, v in given.items() if isinstance(v, np.ndarray)}
    copies = given | {name: np.zeros_like(each) for name, each in arrays_of.items()}
    copies["tie"] = model.tie
    indices = {"count": np.zeros(2, np.int64), "joint": np.zeros(n_joint, np.int64)}
    indices |= {name: np.zeros(n_row, np.int64) for name in ("first", "last", "group")}
    arrays = {name: np.zeros((n_row, *shape)) for name, shape in OF_BODIES.items()}
    arrays |= {name: np.zeros((n_joint, *shape)) for name, shape in OF_JOINTS.items()}
    mega: Any = MegaVoussoirs(
        **arrays,
        **indices,
        tie=(state or new_state(model)).tie,
        stretch=np.zeros((len(model.tie), 2)),
        model=Model(**copies),
        work=new_work(model),
        cut=np.zeros((0, 0), np.int64),
    )
    size = mega.table.size + mega.work.table.size
    mega = mega._replace(cut=np.zeros((n_joint + 1, size), np.int64))
    _set_cut(mega)
    made: MegaVoussoirs = mega
    return made


def _set_cut(mega) -> None:
    """Set ``mega.cut``: for each number of joints, a table of the same arrays cut to that size."""
    own = mega.table
    work = mega.work.table
    n_row = mega.group.size
    n_joint = mega.joint.size
    for m in range(n_joint + 1):
        n = (m if n_joint == n_row - 2 else max(m - 1, 0)) + 2
        row = mega.cut[m]
        row[: own.size] = own
        row[own.size :] = work
        row[place_of(mega, "work")] = row[own.size :].ctypes.data
        for name in OF_MOTION:
            row[place_of(mega, name) + 1] = n
        for name in ("free", "solved"):
            row[own.size + place_of(mega.work, name) + 1] = n
        for name in COUNTED:
            row[own.size + place_of(mega.work, name) + 1] = m


@inlined
def in_use(mega):
    """Return a view of `mega` whose arrays are cut to the size of the assembled chain."""
    return struct_at(mega.cut, mega.count[1], mega)


@inlined
def is_rigid(j, contact, slide):
    """Return whether a joint is closed and sticks."""
    return contact[j, 0] > 0.5 and contact[j, 1] > 0.5 and slide[j] == 0.0


@inlined
def _group(model, contact, slide, mega):
    """Join voussoirs across rigid joints: set ``mega.group`` and what follows from it."""
    n_row = mega.group.size
    n_joint = slide.size
    m = 0
    for j in range(n_joint):
        if not is_rigid(j, contact, slide):
            mega.joint[m] = j
            m += 1
    n = m if n_joint == n_row - 2 else max(m - 1, 0)
    mega.count[0] = n
    mega.count[1] = m
    for i in range(n_row):
        mega.group[i] = GROUND if m == 0 or i <= mega.joint[0] else n + 1
    for k in range(1, n + 1):
        mega.first[k] = mega.joint[k - 1] + 1
        mega.last[k] = mega.joint[k] if k < m else n_row - 2
        for i in range(mega.first[k], mega.last[k] + 1):
            mega.group[i] = k


@inlined
def _place_at_rest(model, slip, mega):
    """Set ``mega.offset`` to the centroids at rest, moved by the slips of rigid joints."""
    n_row = mega.group.size
    offset = mega.offset
    x = y = 0.0
    for i in range(1, n_row - 1):
        if mega.group[i] == mega.group[i - 1]:
            x += slip[i - 1] * model.tangent[i - 1, BEFORE, 0]
            y += slip[i - 1] * model.tangent[i - 1, BEFORE, 1]
        else:
            x = y = 0.0
        offset[i, 0] = model.centroid[i, 0] + x
        offset[i, 1] = model.centroid[i, 1] + y
    if slip.size == n_row - 1 and mega.count[1] > 0:
        # What rests on the far springing is held from there.
        x = y = 0.0
        for i in range(n_row - 2, mega.joint[mega.count[1] - 1], -1):
            x -= slip[i] * model.tangent[i, BEFORE, 0]
            y -= slip[i] * model.tangent[i, BEFORE, 1]
            offset[i, 0] = model.centroid[i, 0] + x
            offset[i, 1] = model.centroid[i, 1] + y


@inlined
def _sum_masses(model, mega):
    """Set masses, inertias and centroids; make offsets count from the common centroids."""
    out = mega.model
    offset = mega.offset
    for k in range(1, mega.count[0] + 1):
        mass = x = y = inertia = 0.0
        for i in range(mega.first[k], mega.last[k] + 1):
            mass += model.mass[i]
            x += model.mass[i] * offset[i, 0]
            y += model.mass[i] * offset[i, 1]
        x = x / mass
        y = y / mass
        for i in range(mega.first[k], mega.last[k] + 1):
            own = offset[i]
            own[0] -= x
            own[1] -= y
            square = own[0] * own[0] + own[1] * own[1]
            inertia += model.inertia[i] + model.mass[i] * square
        out.mass[k] = mass
        out.inertia[k] = inertia
        out.inverse_mass[k] = 1.0 / mass
        out.inverse_inertia[k] = 1.0 / inertia
        out.centroid[k, 0] = x
        out.centroid[k, 1] = y


@inlined
def _place_joints(model, contact, slide, slip, mega):
    """Set the joints between and inside mega-voussoirs, in the axes at rest."""
    out = mega.model
    work = mega.work
    k = 0
    for j in range(slip.size):
        if is_rigid(j, contact, slide):
            mega.inner_normal[j, 0] = model.tangent[j, BEFORE, 1]
            mega.inner_normal[j, 1] = -model.tangent[j, BEFORE, 0]
            for c in range(2):
                side = 1 if later_vertex_meets(c, slip[j]) else 0
                for d in range(2):
                    place = model.corner[j, side, c, d] + mega.offset[j + side, d]
                    mega.inner_point[j, c, d] = place
            continue
        work.slip[k] = slip[j]
        work.slide[k] = slide[j]
        out.length[k] = model.length[j]
        out.friction[k] = model.friction[j]
        for c in range(2):
            out.ray[k, c] = model.ray[j, c]
            work.contact[k, c] = contact[j, c]
            work.candidate[k, c] = 1.0
            for side in range(2):
                out.tangent[k, side, c] = model.tangent[j, side, c]
                for d in range(2):
                    place = model.corner[j, side, c, d] + mega.offset[j + side, d]
                    out.corner[k, side, c, d] = place
        k += 1


@kernel
def assemble(model, contact, slide, slip, mega):
    """Set masses and faces of the mega-voussoirs, `mega`, for given contact modes and slips."""
    _group(model, contact, slide, mega)
    _place_at_rest(model, slip, mega)
    _sum_masses(model, mega)
    _place_joints(model, contact, slide, slip, mega)
    # The far springing stands where a body may have been before.
    end = mega.count[0] + 1
    out = mega.model
    work = mega.work
    out.mass[end] = out.inverse_mass[end] = out.inverse_inertia[end] = 0.0
    for i in range(1, mega.group.size - 1):  # what rests on it
        out.mass[end] += model.mass[i] if mega.group[i] == end else 0.0
    work.rotated[end, 0] = 1.0
    work.rotated[end, 1] = 0.0
    mega.position[end] = mega.velocity[end] = work.free[end] = 0.0
    mega.next_position[end] = mega.next_velocity[end] = work.solved[end] = 0.0


@kernel
def gather_state(model, position, velocity, mega):
    """Set positions and velocities of mega-voussoirs from those of their voussoirs.

    Centre of mass, momentum and moment of momentum are kept; the rotation is that of the first
    voussoir. Position and velocity of the far springing are copied.

    Writes: mega (next_position, next_velocity, position, velocity).
    """
    end = mega.count[0] + 1
    for c in range(3):
        mega.position[end, c] = mega.next_position[end, c] = position[-1, c]
        mega.velocity[end, c] = mega.next_velocity[end, c] = velocity[-1, c]
    for k in range(1, mega.count[0] + 1):
        x = y = vx = vy = spin = 0.0
        mass = mega.model.mass[k]
        for i in range(mega.first[k], mega.last[k] + 1):
            m = model.mass[i] / mass
            x = x + m * position[i, 0]
            y = y + m * position[i, 1]
            vx = vx + m * velocity[i, 0]
            vy = vy + m * velocity[i, 1]
        for i in range(mega.first[k], mega.last[k] + 1):
            arm = position[i, 0] - x, position[i, 1] - y
            moment = cross(arm, (velocity[i, 0] - vx, velocity[i, 1] - vy))
            spin += model.inertia[i] * velocity[i, 2]
            spin += model.mass[i] * moment
        mega.position[k, 0] = x
        mega.position[k, 1] = y
        mega.position[k, 2] = position[mega.first[k], 2]
        mega.velocity[k, 0] = vx
        mega.velocity[k, 1] = vy
        mega.velocity[k, 2] = spin / mega.model.inertia[k]


@kernel
def split_state(mega, mega_position, mega_velocity, position, velocity):
    """Set positions and velocities of all voussoirs from those of the mega-voussoirs.

    Those of the far springing are copied.

    Reads: mega (count, group, offset), mega_position, mega_velocity.
    Writes: position, velocity.
    """
    end = mega.count[0] + 1
    for k in range(3):
        position[-1, k] = mega_position[end, k]
        velocity[-1, k] = mega_velocity[end, k]
    s = 0.0
    c = 1.0
    turned = GROUND
    for i in range(1, position.shape[0] - 1):
        k = mega.group[i]
        rx = mega.offset[i, 0]
        ry = mega.offset[i, 1]
        if k == GROUND:
            position[i, 0] = rx
            position[i, 1] = ry
            position[i, 2] = 0.0
            velocity[i] = 0.0
            continue
        if k != turned:
            s, c = sine_cosine(mega_position[k, 2])
            turned = k
        x = c * rx - s * ry
        y = s * rx + c * ry
        spin = mega_velocity[k, 2]
        position[i, 0] = mega_position[k, 0] + x
        position[i, 1] = mega_position[k, 1] + y
        position[i, 2] = mega_position[k, 2]
        velocity[i, 0] = mega_velocity[k, 0] - spin * y
        velocity[i, 1] = mega_velocity[k, 1] + spin * x
        velocity[i, 2] = spin


@kernel
def farthest_move(model, old, new):
    """Return the largest move of any voussoir, with rotations times the first joint's length [m].

    Reads: model.length, old, new.
    """
    farthest = 0.0
    for i in range(1, old.shape[0] - 1):
        away = abs(new[i, 0] - old[i, 0]) + abs(new[i, 1] - old[i, 1])
        farthest = max(farthest, away, model.length[0] * abs(new[i, 2] - old[i, 2]))
    return farthest
