"""The contact problem: both laws and the balance of momentum, in states of every kind."""

import numpy as np
import pytest

from tests.mechanics.adapters import residual, solve
from tests.mechanics.oracles import corner_rates
from tests.physics.random_states import KINDS, random_state


def scale_of(problem):
    """Largest relative velocity of corners that may touch, without reactions."""
    return np.abs(corner_rates(problem, problem.free)[problem.touching]).max()


def residual_of(problem, solution):
    """Residual of the laws, its velocities worked out apart from the solver."""
    rates = corner_rates(problem, solution.velocity)
    return residual(problem, solution, rates, scale_of(problem))


class TestSignoriniAndCoulomb:
    @pytest.mark.parametrize("kind", KINDS)
    def test_both_laws_hold_in_random_states(self, kind):
        rng = np.random.default_rng(KINDS.index(kind))
        for _ in range(2500):
            n = int(rng.integers(2, 82)) if rng.random() < 0.25 else int(rng.integers(2, 12))
            friction = rng.uniform(0.2, 1.2) if rng.random() < 0.8 else np.inf
            problem = random_state(rng, n, friction, kind)
            solution = solve(problem)
            assert solution.solved
            assert residual_of(problem, solution) <= 1e-10

    def test_the_measure_sees_a_broken_law(self):
        rng = np.random.default_rng(3)
        problem = random_state(rng, 9, 0.7, "hinged")
        solution = solve(problem)
        assert residual_of(problem, solution) < 1e-10
        wrench, velocity = solution.wrench.copy(), solution.velocity.copy()
        wrench[4, 1] *= 1.001
        velocity[3, 0] += 1e-3
        assert residual_of(problem, solution._replace(wrench=wrench)) > 1e-7
        assert residual_of(problem, solution._replace(velocity=velocity)) > 1e-6
