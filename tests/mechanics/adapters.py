"""The contact kernels as these tests call them; what a kernel is given and gives back is plain.

Tests speak of problems in the arrays below; names and layouts of the package stand here only.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.acceleration import centripetal_bias, uniform_force
from archfrag.mechanics.contact.blocks import EXACT, Precision, solve_modes
from archfrag.mechanics.contact.modes import ask_modes, solve_contact, velocity_scale
from archfrag.mechanics.contact.path import (
    PATHS,
    SOFT_PATHS,
    follow_path,
    new_path,
    solve_by_path,
)
from archfrag.mechanics.contact.placing import relative_velocity
from archfrag.mechanics.delassus import contact_work
from archfrag.mechanics.delassus import velocity_scale as former_scale
from archfrag.mechanics.former_contact import solve_contact as former_contact
from archfrag.mechanics.kinematics import (
    empty_contacts,
    joint_lengths,
    move_faces,
    place_contacts,
)
from archfrag.mechanics.levels import new_few_bodies, solve_levels, view_few
from archfrag.mechanics.mechanism import assemble_mechanism, gather_state, new_mechanism
from archfrag.mechanics.model import Model, new_work
from archfrag.mechanics.reactions import four_hinges, inner_margins
from archfrag.mechanics.status import Status
from archfrag.methods.few_bodies import evaluate, new_few_room, view_motion


class Mode(NamedTuple):
    """How a joint touches: at which corners, and the sense of the friction of its slip."""

    corners: tuple[int, ...]
    slip: int = 0  # 1: friction along the tangent, the later body moves against it; 0: sticks


OPEN = Mode(())
CLOSED = Mode((0, 1))
PLUS, MINUS = 1, -1


def encode(mode):
    """Number of a mode in the package."""
    slip = {0: 0, 1: 1, -1: 2}[mode.slip]
    if len(mode.corners) == 2:
        return 7 + slip
    return 1 + 3 * mode.corners[0] + slip if mode.corners else 0


MODES = {encode(m): m for m in (OPEN, *(
    Mode(corners, slip) for corners in ((0,), (1,), (0, 1)) for slip in (0, PLUS, MINUS)
))}  # fmt: skip


def encode_all(modes):
    return np.array([encode(mode) for mode in modes], np.int8)


def decode_all(numbers):
    return [MODES[int(number)] for number in numbers]


@dataclass(frozen=True)
class Problem:
    """One contact problem of n bodies and m joints; velocities stand for accelerations too."""

    mass: np.ndarray  # (n,)
    inertia: np.ndarray  # (n,)
    centroid: np.ndarray  # (n, 2)
    point: np.ndarray  # (m, 2, 2) corner, xy
    normal: np.ndarray  # (m, 2) of a closed joint
    normal_plus: np.ndarray  # (m, 2, 2) corner, xy: for slip PLUS
    normal_minus: np.ndarray  # (m, 2, 2) for slip MINUS
    touching: np.ndarray  # (m, 2) bool: corners that may touch
    sliding: np.ndarray  # (m,) sense of a slip under way; 0: not known
    bias: np.ndarray  # (m, 2, 2) corner, xy: added to the relative velocity
    friction: np.ndarray  # (m,)
    free: np.ndarray  # (n, 3) velocities without reactions
    start: list  # modes to start from

    def but(self, **changes):
        return replace(self, **changes)


class Solution(NamedTuple):
    """Motion, and reactions on the body after each joint: force, moment about the origin."""

    solved: bool
    velocity: np.ndarray  # (n, 3)
    wrench: np.ndarray  # (m, 3)
    modes: list


def problem_of(state):
    """Problem of a state of `tests.physics.random_states`."""
    mass, inertia, contacts, friction, free, mode = state
    return Problem(
        mass, inertia, contacts.centroid, contacts.point, contacts.normal, contacts.normal_plus,
        contacts.normal_minus, contacts.candidate.astype(bool), contacts.slip, contacts.bias,
        friction, free, decode_all(mode),
    )  # fmt: skip


def wrench_of(reaction, pivot):
    """Force and moment about the origin from force and moment about a pivot."""
    moment = reaction[:, 2] + pivot[:, 0] * reaction[:, 1] - pivot[:, 1] * reaction[:, 0]
    return np.column_stack([reaction[:, :2], moment])


def solution_of(solved, work):
    """Solution in the layout that mega-voussoirs use."""
    wrench = wrench_of(work.reaction, work.pivot)
    return Solution(bool(solved), work.velocity.copy(), wrench, decode_all(work.mode))


def modes_of(work):
    return [
        Mode(tuple(int(k) for k in np.flatnonzero(touch)), int(slide))
        for touch, slide in zip(work.touch, work.slide)
    ]


def _framed(values):
    """Rows of bodies between rows of the ground, which are zero."""
    return np.concatenate([0.0 * values[:1], values, 0.0 * values[:1]])


def posed(problem):
    """Model, positions and workspace of a problem."""
    p, friction = problem, np.asarray(problem.friction, float)
    n_joint = friction.size
    rough = np.isinf(friction)
    model = Model(
        mass=_framed(p.mass), inertia=_framed(p.inertia),
        inverse_mass=_framed(1.0 / p.mass), inverse_inertia=_framed(1.0 / p.inertia),
        centroid=_framed(p.centroid), corner=np.zeros((n_joint, 2, 2, 2)),
        tangent=np.zeros((n_joint, 2, 2)), length=np.ones(n_joint), friction=friction,
        ray=np.stack([np.where(rough, 0.0, 1.0), np.where(rough, 1.0, friction)], axis=1),
        gravity=9.81, rounding=0.0,
    )  # fmt: skip
    position = np.zeros((p.mass.size + 2, 3))
    position[:, :2] = model.centroid
    work = new_work(model)
    work.point[:], work.normal[:] = p.point, p.normal
    work.pivot[:] = p.point.mean(axis=1)
    work.side_normal[:] = np.stack([p.normal_plus, p.normal_minus], axis=2)
    work.candidate[:], work.known[:], work.bias[:] = p.touching, p.sliding, p.bias
    work.free[1:-1] = p.free
    for j, mode in enumerate(p.start):
        work.touch[j] = [k in mode.corners for k in range(2)]
        work.slide[j] = mode.slip
    return model, position, work


def _solved(solved, work):
    wrench = wrench_of(work.reaction, work.pivot)
    return Solution(bool(solved), work.solved[1:-1].copy(), wrench, modes_of(work))


def by_newton(problem):
    """Solution by the iteration on the modes alone."""
    model, position, work = posed(problem)
    patience = 100 + 4 * problem.friction.size
    solved, _, _ = solve_contact(model, position, work, True, (False, 0.0, 0.0), patience, EXACT)
    return _solved(solved, work)


def by_path(problem):
    """Solution found along solution paths, the iteration on the modes not tried first."""
    model, position, work = posed(problem)
    solved, compliant, _, _ = solve_by_path(
        model, position, work, new_path(model), PATHS, SOFT_PATHS
    )
    return _solved(solved and not compliant, work)


def path_end(problem, attempt, compliance):
    """What stands at the end of one solution path, of slightly compliant joints."""
    model, position, work = posed(problem)
    relative_velocity(position, work.free, work.pivot, work.relative)
    path = new_path(model)
    path.bias[:] = work.bias
    scale = velocity_scale(work)
    reached, _ = follow_path(position, work, path, scale, compliance, attempt)
    precision = Precision(compliance, 1e-11, np.inf)
    solve_modes(path.model, position, work, scale, precision)
    return _solved(reached, work)


class Joint(NamedTuple):
    """A joint in its own axes, normal and tangent, and what it does and bears in a mode."""

    mode: Mode
    motion: tuple  # at its middle, of the later body: normal, tangential [m/s], rotation [rad/s]
    force: tuple  # on the later body: normal, tangential [N], moment about the middle [N m]
    friction: float = 0.5
    sliding: int = 0  # sense of a slip under way
    touching: tuple = (True, True)
    lean: tuple = (0.0, 0.0)  # angles of the normals for slip PLUS and MINUS [rad]
    half: float = 0.5  # half its length [m]


AXES = 0.3  # Angle of the joints' axes to the frame's [rad].


def _in_frame(normal, tangential):
    c, s = np.cos(AXES), np.sin(AXES)
    return np.array([-s * tangential + c * normal, c * tangential + s * normal])


def proposed(joints, scale=1.0, force_scale=1.0, tolerance=1e-9):
    """Modes that joints ask for, and whether any asks for another."""
    m = len(joints)
    friction = np.array([joint.friction for joint in joints])
    problem = Problem(
        np.ones(m), np.ones(m), np.zeros((m, 2)), np.zeros((m, 2, 2)), np.zeros((m, 2)),
        np.zeros((m, 2, 2)), np.zeros((m, 2, 2)), np.array([j.touching for j in joints]),
        np.array([j.sliding for j in joints]), np.zeros((m, 2, 2)), friction, np.zeros((m, 3)),
        [joint.mode for joint in joints],
    )  # fmt: skip
    model, _, work = posed(problem)
    for j, joint in enumerate(joints):
        work.pivot[j] = 3.0, 2.0 + j
        work.normal[j] = _in_frame(1.0, 0.0)
        velocity = _in_frame(*joint.motion[:2])
        for c in range(2):
            arm = _in_frame(0.0, (2 * c - 1) * joint.half)
            work.point[j, c] = work.pivot[j] + arm
            work.parting[j, c] = velocity + joint.motion[2] * np.array([-arm[1], arm[0]])
            for side in range(2):
                lean = joint.lean[side]
                work.side_normal[j, c, side] = _in_frame(np.cos(lean), np.sin(lean))
        work.reaction[j, :2], work.reaction[j, 2] = _in_frame(*joint.force[:2]), joint.force[2]
    changed = ask_modes(model, work, tolerance * scale, tolerance * force_scale)
    work.touch[:], work.slide[:] = work.asked_touch, work.asked_slide
    return modes_of(work), bool(changed)


def by_four_hinges(mass, inertia, centroid, hinge, corners, spin, free):
    """First level in closed form: whether it holds, accelerations, forces at the hinges."""
    contacts, work = empty_contacts(3, 4), contact_work(3, 4)
    contacts.centroid[:] = centroid
    for j, c in enumerate(corners):
        contacts.point[j, c], contacts.point[j, 1 - c] = hinge[j], hinge[j] + [0.3, 0.8]
        work.mode[j] = encode(Mode((c,)))
    velocity = np.zeros((3, 3))
    velocity[:, 2] = spin
    possible = four_hinges(mass, inertia, velocity, free, contacts, work)
    return bool(possible), work.velocity.copy(), work.reaction[:, :2].copy(), work.pivot.copy()


class Posed:
    """A chain in a state: the contact problem of its accelerations, and its two levels."""

    def __init__(self, chain, position, velocity, modes, horizontal, vertical=0.0):
        n, m = chain.mass.size, chain.friction.size
        self.given = chain, position, velocity, horizontal, vertical
        self.chain = chain
        self.mode = encode_all(modes)
        self.length, self.slip = joint_lengths(chain), np.zeros(m)
        self.contacts, self.free = empty_contacts(n, m), np.zeros((n, 3))
        before, after = np.zeros((2, m, 2, 2))
        move_faces(chain, position, before, after)
        place_contacts(position, before, after, self.slip, self.length, self.contacts)
        for j, mode in enumerate(modes):
            self.contacts.slip[j] = mode.slip
            self.contacts.candidate[j] = [c in mode.corners for c in range(2)]
        uniform_force(n, horizontal, vertical, chain.gravity, self.free)
        centripetal_bias(self.contacts, self.mode, self.slip, velocity, self.contacts.bias)
        self.mechanism, self.bodies = new_mechanism(n, m), new_few_bodies(n, m)

    def with_modes(self, modes):
        """The same state in other modes."""
        chain, position, velocity, horizontal, vertical = self.given
        return Posed(chain, position, velocity, modes, horizontal, vertical)

    def problem(self):
        chain = self.chain
        return problem_of(
            (chain.mass, chain.inertia, self.contacts, chain.friction, self.free, self.mode)
        )

    def by_levels(self):
        """Solution by both levels, and how many rounds it took."""
        work = contact_work(self.chain.mass.size, self.slip.size)
        work.mode[:] = self.mode
        work.pivot[:] = self.contacts.point.mean(axis=1)
        scale = former_scale(self.contacts, self.free, work)
        solved, rounds = solve_levels(
            self.chain, self.contacts, self.slip, self.length, self.given[2], self.free, scale,
            self.mechanism, self.bodies, work,
        )  # fmt: skip
        return solution_of(solved, work), rounds

    def by_contact_problem(self):
        """Solution on the full chain."""
        chain, work = self.chain, contact_work(self.chain.mass.size, self.slip.size)
        work.mode[:] = self.mode
        status, *_, compliant = former_contact(
            chain.mass, chain.inertia, self.contacts, chain.friction, self.free, work
        )
        return solution_of(status == Status.STANDING and not compliant, work)

    def margins(self):
        """Second level: forces at both corners and margins of Coulomb's law of either sense.

        Returns
        -------
        value : ndarray, (n_joint, 4) [N]
            nan at joints between mega-voussoirs.
        least : float
        """
        chain, n_joint = self.chain, self.slip.size
        n, m = assemble_mechanism(chain, self.mode, self.slip, self.length, self.mechanism)
        bodies = view_few(self.bodies, n, m)
        gather_state(chain, self.mechanism, *self.given[1:3], bodies.position, bodies.velocity)
        room = new_few_room(chain.mass.size, n_joint)
        few = view_motion(self.mechanism, chain.gravity, bodies, room)
        assert evaluate(few, few.position, few.velocity, *self.given[3:])
        value = np.full((n_joint, 4), np.nan)
        least = inner_margins(
            chain, self.mechanism, few.position, few.velocity, few.work, self.given[3],
            self.given[4] + chain.gravity, 1.0, value,
        )  # fmt: skip
        return value, least
