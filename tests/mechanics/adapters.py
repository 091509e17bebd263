"""The contact kernels as these tests call them; what a kernel is given and gives back is plain.

Tests speak of problems in the arrays below; names and layouts of the package stand here only.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from archfrag.mechanics.contact.blocks import EXACT
from archfrag.mechanics.contact.modes import ask_modes, solve_contact
from archfrag.mechanics.contact.path import new_path, solve_by_path
from archfrag.mechanics.contact.placing import move_faces, place_contacts
from archfrag.mechanics.mega_voussoirs.assemble import (
    assemble,
    gather_state,
    in_use,
    new_mega_voussoirs,
    split_state,
)
from archfrag.mechanics.mega_voussoirs.first_level import (
    centripetal_bias,
    four_hinges,
    solve_first_level,
)
from archfrag.mechanics.mega_voussoirs.second_level import (
    FORCE_0,
    FRICTION_MINUS,
    N_LAW,
    joint_reactions,
    solve_second_level,
)
from archfrag.mechanics.model import Model, model_of, new_work
from archfrag.mechanics.residual import contact_residual


class Mode(NamedTuple):
    """How a joint touches: at which corners, and the sense of the friction of its slip."""

    corners: tuple[int, ...]
    slip: int = 0  # 1: friction along the tangent, the later body moves against it; 0: sticks


OPEN = Mode(())
CLOSED = Mode((0, 1))
PLUS, MINUS = 1, -1


def set_modes(modes, contact, slide):
    """Write modes in the layout of the package."""
    for j, mode in enumerate(modes):
        contact[j] = [k in mode.corners for k in range(2)]
        slide[j] = mode.slip


def framed(values):
    """Rows of bodies between rows of the ground, which are zero."""
    return np.concatenate([0.0 * values[:1], values, 0.0 * values[:1]])


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
    sliding: np.ndarray  # (m,) sense of a slip in progress; 0: not known
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


def wrench_of(reaction, pivot):
    """Force and moment about the origin from force and moment about a pivot."""
    moment = reaction[:, 2] + pivot[:, 0] * reaction[:, 1] - pivot[:, 1] * reaction[:, 0]
    return np.column_stack([reaction[:, :2], moment])


def modes_of(work):
    return [
        Mode(tuple(int(k) for k in np.flatnonzero(contact)), int(slide))
        for contact, slide in zip(work.contact, work.slide)
    ]


def posed(problem):
    """Model, positions and workspace of a problem."""
    p, friction = problem, np.asarray(problem.friction, float)
    n_joint = friction.size
    rough = np.isinf(friction)
    model = Model(
        mass=framed(p.mass), inertia=framed(p.inertia),
        inverse_mass=framed(1.0 / p.mass), inverse_inertia=framed(1.0 / p.inertia),
        centroid=framed(p.centroid), corner=np.zeros((n_joint, 2, 2, 2)),
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
    set_modes(p.start, work.contact, work.slide)
    return model, position, work


def problem_in(model, position, work):
    """The problem that a workspace holds; as `posed`."""
    return Problem(
        model.mass[1:-1], model.inertia[1:-1], position[1:-1, :2].copy(), work.point.copy(),
        work.normal.copy(), work.side_normal[:, :, 0].copy(), work.side_normal[:, :, 1].copy(),
        work.candidate > 0.5, work.known.astype(int), work.bias.copy(), model.friction,
        work.free[1:-1].copy(), modes_of(work),
    )  # fmt: skip


def solution_in(solved, work):
    wrench = wrench_of(work.reaction, work.pivot)
    return Solution(bool(solved), work.solved[1:-1].copy(), wrench, modes_of(work))


def by_newton(problem):
    """Solution by the iteration on the modes alone."""
    model, position, work = posed(problem)
    for _ in range(8):
        solved, _, _, _ = solve_contact(model, position, work, True, 0.0, -1.0, EXACT)
        if solved:
            break
    return solution_in(solved, work)


def by_path(problem):
    """Solution found along solution paths, the iteration on the modes not tried first."""
    model, position, work = posed(problem)
    solved, _, _, _ = solve_by_path(model, position, work, new_path(model), True)
    return solution_in(solved, work)


def solve(problem):
    """Solution by the iteration on the modes, along solution paths where that finds none."""
    solution = by_newton(problem)
    return solution if solution.solved else by_path(problem)


def residual(problem, solution, rates, scale):
    """How far a solution is from the laws by the package's own measure.

    `rates` (m, 2, 2) are the relative velocities of the corners, counted over `scale`.
    """
    model, _, work = posed(problem)
    reaction, pivot = solution.wrench, work.pivot
    work.corner_rate[:], work.reaction[:, :2] = rates, reaction[:, :2]
    about = pivot[:, 0] * reaction[:, 1] - pivot[:, 1] * reaction[:, 0]
    work.reaction[:, 2] = reaction[:, 2] - about
    return contact_residual(model, work, scale, np.abs(reaction[:, :2]).max() or 1.0)


class Joint(NamedTuple):
    """A joint in its own axes, normal and tangent, and what it does and bears in a mode."""

    mode: Mode
    motion: tuple  # at its middle, of the later body: normal, tangential [m/s], rotation [rad/s]
    force: tuple  # on the later body: normal, tangential [N], moment about the middle [N m]
    friction: float = 0.5
    sliding: int = 0  # sense of a slip in progress
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
            work.corner_rate[j, c] = velocity + joint.motion[2] * np.array([-arm[1], arm[0]])
            for side in range(2):
                lean = joint.lean[side]
                work.side_normal[j, c, side] = _in_frame(np.cos(lean), np.sin(lean))
        work.reaction[j, :2], work.reaction[j, 2] = _in_frame(*joint.force[:2]), joint.force[2]
    changed = ask_modes(model, work, tolerance * scale, tolerance * force_scale)
    work.contact[:], work.slide[:] = work.asked_contact, work.asked_slide
    return modes_of(work), bool(changed)


def by_four_hinges(mass, inertia, centroid, hinge, corners, spin, free):
    """First level in closed form: whether it holds, accelerations, wrenches on later bodies."""
    point = np.repeat(hinge[:, None], 2, axis=1)
    for j, k in enumerate(corners):
        point[j, 1 - k] += [0.3, 0.8]
    none, corner = np.zeros((4, 2)), np.zeros((4, 2, 2))
    modes = [Mode((k,)) for k in corners]
    model, position, work = posed(Problem(
        mass, inertia, centroid, point, none, corner, corner, none, np.zeros(4), corner,
        np.ones(4), free, modes,
    ))  # fmt: skip
    velocity = np.zeros((5, 3))
    velocity[1:-1, 2] = spin
    possible = four_hinges(model, position, velocity, work)
    return bool(possible), *solution_in(possible, work)[1:3]


def views_of(mega):
    """Arrays of assembled mega-voussoirs cut to their size; as Python, for a kernel's are not."""
    return getattr(in_use, "py_func", in_use)(mega)


class Posed:
    """A chain in a state: the contact problem of its accelerations, and its two levels."""

    def __init__(self, chain, position, velocity, modes, horizontal, vertical=0.0, slip=None):
        self.given = chain, position, velocity, horizontal, vertical, slip
        self.model = model = model_of(chain)
        self.work = work = new_work(model)
        self.slip = np.zeros(chain.friction.size) if slip is None else slip
        self.position, self.velocity = framed(position), framed(velocity)
        move_faces(model, self.position, work.rotated, work.face, work.tangent)
        place_contacts(model, self.slip, work.face, work.tangent, work)
        set_modes(modes, work.contact, work.slide)
        work.candidate[:], work.known[:] = work.contact, work.slide
        work.free[1:-1] = -horizontal, -chain.gravity - vertical, 0.0
        centripetal_bias(self.position, self.velocity, self.slip, work.known, work)
        self.start = problem_in(model, self.position, work)

    def with_modes(self, modes):
        """The same state in other modes."""
        chain, position, velocity, horizontal, vertical, slip = self.given
        return Posed(chain, position, velocity, modes, horizontal, vertical, slip)

    def problem(self):
        return self.start

    def by_contact_problem(self):
        """Solution on the full chain."""
        return solve(self.start)

    def by_levels(self):
        """Solution by both levels in the modes given; its margins stay in ``self.value``.

        Returns
        -------
        Solution
        """
        horizontal, vertical = self.given[3:5]
        model, work, mega = self.model, self.work, new_mega_voussoirs(self.model)
        assemble(model, work.contact, work.slide, self.slip, mega)
        gather_state(model, self.position, self.velocity, mega)
        mega = views_of(mega)
        solved = mega.count[0] > 0 and solve_first_level(
            mega, mega.position, mega.velocity, horizontal, vertical, 1e-3 * model.gravity
        )
        self.value = np.full((self.slip.size, N_LAW), np.nan)
        solve_second_level(
            model, mega, mega.position, mega.velocity, horizontal, vertical, 1.0, self.value
        )
        joint_reactions(mega, work)
        self._accelerations(mega)
        return solution_in(solved, work)

    def _accelerations(self, mega):
        """Accelerations of all voussoirs from those of the mega-voussoirs."""
        work, place = self.work, np.zeros_like(self.position)
        split_state(mega, mega.position, mega.work.solved, place, work.solved)
        for i in np.flatnonzero(mega.group):
            k = mega.group[i]
            arm = self.position[i, :2] - mega.position[k, :2]
            work.solved[i, :2] -= mega.velocity[k, 2] ** 2 * arm

    def margins(self):
        """Second level: forces at both corners and margins of Coulomb's law of either sense.

        Returns
        -------
        value : ndarray, (n_joint, 4) [N]
            nan at joints between mega-voussoirs.
        least : float
        """
        assert self.by_levels().solved
        value = self.value[:, FORCE_0 : FRICTION_MINUS + 1]
        inside = np.isfinite(value[:, 0])
        if np.isinf(self.model.friction).all():
            value[inside, 2:] = np.inf
        return value, value[inside].min(initial=np.inf)
