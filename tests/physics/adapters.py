"""The contact kernels as these tests call them: problems posed in the package's own arrays.

A joint's axes: the normal points from the earlier body to the later one, the tangent is the normal
rotated by +90 degrees and runs from corner 0 to corner 1. Reactions act on the later body.
"""

from typing import NamedTuple

import numpy as np

from archbench.paper.arch import cross
from archfrag.physics.contact import laws
from archfrag.physics.contact.blocks import EXACT
from archfrag.physics.contact.modes import solve_contact
from archfrag.physics.contact.path import new_path, solve_by_path
from archfrag.physics.contact.placing import move_faces, place_contacts
from archfrag.physics.mega_voussoirs import assemble, first_level, second_level
from archfrag.physics.state import Model, Work, model_of, new_work
from archfrag.physics.status import Tie


class Mode(NamedTuple):
    """How a joint touches: at which corners, and the sense of the friction of its slip."""

    corners: tuple[int, ...]
    slip: int = (
        0  # 1: friction along the tangent, the later body moves against it; 0: sticks
    )


OPEN = Mode(())
CLOSED = Mode((0, 1))
PLUS = 1
MINUS = -1


def set_modes(modes, contact, slide):
    for j, mode in enumerate(modes):
        contact[j] = [k in mode.corners for k in range(2)]
        slide[j] = mode.slip


def modes_of(work):
    return [
        Mode(tuple(int(k) for k in np.flatnonzero(contact)), int(slide))
        for contact, slide in zip(work.contact, work.slide)
    ]


def framed(values):
    """Rows of bodies between rows of the ground, which are zero."""
    return np.concatenate([0.0 * values[:1], values, 0.0 * values[:1]])


class Problem(NamedTuple):
    """A contact problem; its velocities may stand for accelerations."""

    model: Model
    position: np.ndarray
    work: Work

    def copy(self, **changes):
        """The same in arrays of its own, with some arrays of the workspace replaced."""
        work = Work(*(part.copy() for part in self.work))._replace(**changes)
        return Problem(self.model, self.position.copy(), work)


class Solution(NamedTuple):
    """Motion, and reactions on the body after each joint: force, moment about the origin."""

    solved: bool
    velocity: np.ndarray  # (n, 3)
    wrench: np.ndarray  # (m, 3)
    modes: list


def pose(mass, inertia, centroid, friction, modes, free=0.0, **arrays):
    """A problem of any bodies (n) and joints (m) by arrays of `Work`; the others are zero."""
    mass, inertia, friction = (
        np.asarray(part, float) for part in (mass, inertia, friction)
    )
    n_joint = friction.size
    rough = np.isinf(friction)
    model = Model(
        body=None,
        bed=None,
        ahead=None,
        mass=framed(mass),
        inertia=framed(inertia),
        inverse_mass=framed(1.0 / mass),
        inverse_inertia=framed(1.0 / inertia),
        centroid=framed(np.asarray(centroid)),
        corner=np.zeros((n_joint, 2, 2, 2)),
        tangent=np.zeros((n_joint, 2, 2)),
        length=np.ones(n_joint),
        friction=friction,
        end=mass.size + 1,
        start=np.zeros((mass.size + 2, 3)),
        tie=np.zeros((0, len(Tie))),
        gravity=9.81,
        rounding=0.0,
        ray=np.stack(
            [np.where(rough, 0.0, 1.0), np.where(rough, 1.0, friction)], axis=1
        ),
    )
    position = np.zeros((mass.size + 2, 3))
    work = new_work(model)
    position[:, :2] = model.centroid
    work.free[1:-1] = free
    for name, values in arrays.items():
        getattr(work, name)[:] = values
    work.pivot[:] = work.point.mean(axis=1)
    set_modes(modes, work.contact, work.slide)
    return Problem(model, position, work)


def solution_of(problem, solved):
    """What a solver left in the workspace."""
    work = problem.work
    wrench = work.reaction.copy()
    wrench[:, 2] += cross(work.pivot, wrench[:, :2])
    return Solution(bool(solved), work.solved[1:-1].copy(), wrench, modes_of(work))


def by_newton(problem):
    """Solution by the iteration on the modes alone."""
    problem = problem.copy()
    tries = (solve_contact(*problem, True, 0.0, -1.0, EXACT)[0] for _ in range(8))
    return solution_of(problem, any(tries))


def by_path(problem):
    """Solution found along solution paths, the iteration on the modes not tried first."""
    problem = problem.copy()
    return solution_of(
        problem, solve_by_path(*problem, new_path(problem.model), True)[0]
    )


def solve(problem):
    """Solution by the iteration on the modes, along solution paths where that finds none."""
    solution = by_newton(problem)
    return solution if solution.solved else by_path(problem)


def by_four_hinges(mass, inertia, centroid, hinge, corners, spin, free):
    """First level in closed form: accelerations, and wrenches on later bodies."""
    point = np.repeat(hinge[:, None], 2, axis=1)
    for j, k in enumerate(corners):
        point[j, 1 - k] += [0.3, 0.8]
    modes = [Mode((k,)) for k in corners]
    problem = pose(mass, inertia, centroid, np.ones(4), modes, free, point=point)
    velocity = framed(np.column_stack([0.0 * spin, 0.0 * spin, spin]))
    solved = first_level.four_hinges(
        problem.model, problem.position, velocity, problem.work
    )
    return solution_of(problem, solved)


def views_of(mega):
    """Arrays of assembled mega-voussoirs cut to their size; as Python, for a kernel's are not."""
    n = mega.count[0] + 2
    m = mega.count[1]
    cut = {name: getattr(mega.work, name)[:m] for name in assemble.COUNTED}
    cut |= {name: getattr(mega.work, name)[:n] for name in ("free", "solved")}
    bodies = ("position", "velocity", "next_position", "next_velocity")
    return mega._replace(
        work=mega.work._replace(**cut),
        **{name: getattr(mega, name)[:n] for name in bodies},
    )


class Posed:
    """A chain in a state: the contact problem of its accelerations, and its two levels."""

    def __init__(self, chain, position, velocity, modes, horizontal, vertical=0.0):
        self.given = chain, position, velocity, horizontal, vertical
        self.model = model = model_of(chain)
        self.work, self.slip = work, slip = (
            new_work(model),
            np.zeros(chain.friction.size),
        )
        self.position = framed(position)
        self.velocity = framed(velocity)
        move_faces(model, self.position, work)
        place_contacts(model, slip, work)
        set_modes(modes, work.contact, work.slide)
        work.candidate[:] = work.contact
        work.known[:] = work.slide
        work.free[1:-1] = -horizontal, -chain.gravity - vertical, 0.0
        first_level.centripetal_bias(
            model, self.position, self.velocity, slip, work.known, work
        )
        self.modes, self.problem = modes, Problem(model, self.position, work).copy()

    def with_modes(self, modes):
        """The same state in other modes."""
        return Posed(*self.given[:3], modes, *self.given[3:])

    def by_contact_problem(self):
        """Solution on the full chain."""
        return solve(self.problem)

    def by_levels(self):
        """Solution by both levels in the modes given; its margins stay in ``self.value``."""
        model = self.model
        work = self.work
        mega = assemble.new_mega_voussoirs(self.model)
        assemble.assemble(model, work.contact, work.slide, self.slip, mega)
        assemble.gather_state(model, self.position, self.velocity, mega)
        mega = views_of(mega)
        state = mega, mega.position, mega.velocity, (*self.given[3:], 0.0, 0.0)
        solved = mega.count[0] > 0 and first_level.solve_first_level(
            *state, 1e-3 * model.gravity
        )
        self.value = np.full((self.slip.size, laws.N_LAW), np.nan)
        second_level.solve_second_level(model, *state, 1.0, self.value)
        second_level.joint_reactions(mega, work)
        # Accelerations of all voussoirs from those of the mega-voussoirs.
        place = 0.0 * self.position
        assemble.split_state(mega, mega.position, mega.work.solved, place, work.solved)
        for i in np.flatnonzero(mega.group):
            k = mega.group[i]
            arm = self.position[i, :2] - mega.position[k, :2]
            work.solved[i, :2] -= mega.velocity[k, 2] ** 2 * arm
        return solution_of(Problem(model, self.position, work), solved)

    def margins(self):
        """Forces at both corners and margins of Coulomb's law of either sense, (m, 4) [N].

        They are nan at joints between mega-voussoirs. Also the least of them.
        """
        assert self.by_levels().solved
        value = self.value[:, laws.FORCE_0 : laws.FRICTION_MINUS + 1]
        inside = np.isfinite(value[:, 0])
        if np.isinf(self.model.friction).all():
            value[inside, 2:] = np.inf
        return value, value[inside].min(initial=np.inf)
