"""The contact problem: both laws and the balance of momentum, in states of every kind."""

import numpy as np
import pytest

from tests.mechanics.adapters import CLOSED, OPEN, Mode, Problem, residual, solve
from tests.mechanics.oracles import corner_rates
from tests.physics.random_states import KINDS, random_state


def scale_of(problem):
    """Largest relative velocity of corners that may touch, without reactions."""
    return np.abs(corner_rates(problem, problem.free)[problem.touching]).max()


def residual_of(problem, solution):
    """Residual of the laws, its velocities worked out apart from the solver."""
    rates = corner_rates(problem, solution.velocity)
    return residual(problem, solution, rates, scale_of(problem))


def one_block(friction, push, touching=(True, True)):
    """A block 1 m wide and high on the ground under gravity and a horizontal push [m/s2]."""
    up = np.array([0.0, 1.0])
    return Problem(
        mass=np.ones(1),
        inertia=np.full(1, 1 / 6),
        centroid=np.array([[0.0, 0.5]]),
        point=np.array([[[0.5, 0.0], [-0.5, 0.0]]]),
        normal=up[None],
        normal_plus=np.array([[up, up]]),
        normal_minus=np.array([[up, up]]),
        touching=np.array([touching]),
        sliding=np.zeros(1),
        bias=np.zeros((1, 2, 2)),
        friction=np.array([friction]),
        free=np.array([[push, -10.0, 0.0]]),
        start=[CLOSED],
    )


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


class TestCoulomb:
    """Coulomb's law is not the associated flow rule: sliding does not dilate."""

    def test_a_pushed_block_slides_without_rising(self):
        friction, push = 0.3, 5.0
        solution = solve(one_block(friction, push))
        (mode,) = solution.modes
        assert mode.corners == CLOSED.corners
        assert mode.slip != 0
        velocity = solution.velocity[0]
        assert velocity == pytest.approx([push - friction * 10.0, 0.0, 0.0], abs=1e-10)
        # The associated rule takes the motion nearest to the free one with v_n >= mu |v_t|: the
        # projection on the cone's edge (1, mu), which rises by mu times its slip.
        edge = np.array([1.0, friction]) / np.hypot(1.0, friction)
        associated = edge * (np.array([push, -10.0]) @ edge)
        assert associated[0] == pytest.approx(1.835, abs=1e-3)
        assert associated[1] == pytest.approx(0.550, abs=1e-3)
        assert velocity[0] == pytest.approx(2.0, abs=1e-9)

    def test_a_block_sticks_up_to_its_friction(self):
        for push, moves in ((2.99, False), (3.01, True)):
            velocity = solve(one_block(0.3, push)).velocity
            assert (abs(velocity[0, 0]) > 1e-6) == moves

    def test_infinite_friction_never_slides(self):
        assert np.abs(solve(one_block(np.inf, 9.0)).velocity).max() < 1e-10


class TestUnilateral:
    def test_a_lifted_block_leaves(self):
        solution = solve(one_block(0.3, 0.0).but(free=np.array([[0.0, 2.0, 0.0]])))
        assert solution.modes == [OPEN]
        assert np.abs(solution.wrench).max() == 0.0
        assert solution.velocity[0, 1] == 2.0

    def test_a_pushed_tall_block_tips_about_its_far_corner(self):
        solution = solve(one_block(2.0, 15.0))
        assert solution.velocity[0, 2] < -0.1
        assert solution.modes == [Mode((0,))]
