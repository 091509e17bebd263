"""Contact problems solved along paths: laws, balance, the other solver, all combinations."""

import itertools

import numpy as np
import pytest

from tests.mechanics.adapters import (
    PLUS,
    Mode,
    Problem,
    Solution,
    by_newton,
    by_path,
)
from tests.mechanics.oracles import (
    Dense,
    balance_error,
    corner_rates,
    law_violation,
    possible_modes,
)
from tests.physics.random_states import KINDS, random_state

FRICTION = (0.2, 0.4, 0.8, 1.2, np.inf)


def random_problem(rng, n, kind, mu=None):
    """A random state; accelerations in motion with what rotating adds to the laws of a joint."""
    if mu is None:
        mu = FRICTION[rng.integers(len(FRICTION))]
    problem = random_state(rng, n, mu, kind)
    if kind in ("resting", "impact"):
        return problem
    bias = rng.uniform(-1.0, 1.0, (n + 1, 1, 2)) * np.ones((1, 2, 1))
    bias = bias + rng.uniform(-0.5, 0.5, (n + 1, 2, 1)) * problem.normal[:, None]
    return problem.but(bias=bias)


def scale_of(problem):
    return np.abs(corner_rates(problem, problem.free)[problem.touching]).max()


def answers_of(problem):
    """Motions of all combinations of modes that obey the laws, dense."""
    dense = Dense(problem)
    every = [possible_modes(problem, j) for j in range(problem.friction.size)]
    found = []
    for modes in itertools.product(*every):
        velocity, wrench = dense.solve(modes)
        solution = Solution(True, velocity, wrench, modes)
        if law_violation(problem, solution, 1e-6, dense.matrix) < 1e-6:
            found.append(velocity)
    return found


def rod(friction, lift=0.0):
    """The end of a steep thin rod that slides on the ground against its friction PLUS.

    The normal acceleration of the end by a unit force on the cone is
    ``1 + 3 cos a (cos a - mu sin a)``, a = 60 degrees: negative beyond mu = 1.35 (Painleve).
    """
    along = np.array([np.cos(np.pi / 3.0), np.sin(np.pi / 3.0)])
    up = np.array([0.0, 1.0])
    return Problem(
        mass=np.ones(1),
        inertia=np.full(1, 1.0 / 3.0),
        centroid=np.array([along * [-1.0, 1.0]]),
        point=np.array([[[0.0, 0.0], [-0.1, 0.0]]]),
        normal=up[None],
        normal_plus=np.array([[up, up]]),
        normal_minus=np.array([[up, up]]),
        touching=np.array([[True, False]]),
        sliding=np.array([PLUS]),
        bias=np.zeros((1, 2, 2)),
        friction=np.array([friction]),
        free=np.array([[0.0, lift - 10.0, 0.0]]),
        start=[Mode((0,), PLUS)],
    )


@pytest.mark.parametrize("kind", KINDS)
class TestLaws:
    def test_hold_with_the_balance_and_the_motion_is_that_of_the_iteration_on_modes(self, kind):
        rng = np.random.default_rng(60 + KINDS.index(kind))
        compared = other = 0
        for _ in range(150):
            problem = random_problem(rng, int(rng.integers(2, 40)), kind)
            solution, iterated = by_path(problem), by_newton(problem)
            assert solution.solved
            assert law_violation(problem, solution) < 1e-10
            assert balance_error(problem, solution) < 1e-12
            if iterated.solved:
                compared += 1
                assert law_violation(problem, iterated) < 1e-10
                apart = np.abs(iterated.velocity - solution.velocity).max()
                other += apart > 1e-7 * scale_of(problem)
        assert compared >= 75
        # Under friction two motions may both obey the laws: at impacts 7 % of 500 problems.
        assert other <= 0.1 * compared


class TestEnumeration:
    """Short chains, where every combination of modes can be tried."""

    @pytest.mark.parametrize(("n", "trials"), [(2, 24), (3, 8)])
    def test_the_motion_is_among_those_of_all_combinations(self, n, trials):
        rng = np.random.default_rng(80 + n)
        several = 0
        for trial in range(trials):
            kind = KINDS[1 + trial % 3] if n == 3 else KINDS[trial % 4]
            problem = random_problem(rng, n, kind)
            solution, answers = by_path(problem), answers_of(problem)
            assert solution.solved
            near = [
                np.abs(answer - solution.velocity).max() < 1e-5 * scale_of(problem)
                for answer in answers
            ]
            assert any(near)
            several += not all(near)
        assert several <= 0.1 * trials

    @pytest.mark.parametrize(("friction", "solutions"), [(1.3, 1), (1.4, 0), (4.0, 0)])
    def test_a_state_without_a_solution_is_reported_as_one(self, friction, solutions):
        problem = rod(friction)
        assert len(answers_of(problem)) == solutions
        assert by_path(problem).solved == by_newton(problem).solved == bool(solutions)
        # At any friction it has one without contact.
        lifted = by_path(rod(friction, lift=11.0).but(start=[Mode(())]))
        assert lifted.solved
        assert lifted.velocity[0] == pytest.approx([0.0, 1.0, 0.0])
