"""Contact problems solved by either solver: laws, balance, and states without a solution."""

import numpy as np
import pytest

from archbench.paper.arch import cross
from archfrag.physics.residual import contact_residual
from tests.physics.adapters import PLUS, Mode, by_newton, by_path, pose
from tests.physics.linkages import KINDS, random_state
from tests.physics.oracles import balance_error, corner_rates, law_violation, scale_of

FRICTION = (0.2, 0.4, 0.8, 1.2, np.inf)
SLIDING = Mode((0,), PLUS)


def random_problem(rng, n, kind):
    """A random state; accelerations in motion with what rotating adds to the laws of a joint."""
    problem = random_state(rng, n, FRICTION[rng.integers(len(FRICTION))], kind)
    if kind in ("resting", "impact"):
        return problem
    bias = rng.uniform(-1.0, 1.0, (n + 1, 1, 2)) * np.ones((1, 2, 1))
    across = rng.uniform(-0.5, 0.5, (n + 1, 2, 1)) * problem.work.normal[:, None]
    return problem.copy(bias=bias + across)


def rod(friction, lift=0.0, mode=SLIDING):
    """The end of a steep thin rod that slides on the ground against its friction PLUS.

    The normal acceleration of the end by a unit force on the cone is
    ``1 + 3 cos a (cos a - mu sin a)``, a = 60 degrees: negative beyond mu = 1.35 (Painleve).
    """
    up = np.array([0.0, 1.0])
    return pose(
        [1.0],
        [1.0 / 3.0],
        [[-np.cos(np.pi / 3.0), np.sin(np.pi / 3.0)]],
        [friction],
        [mode],
        [0.0, lift - 10.0, 0.0],
        point=[[[0.0, 0.0], [-0.1, 0.0]]],
        normal=up,
        side_normal=up,
        candidate=[1.0, 0.0],
        known=PLUS,
    )


def measured(problem, solution):
    """Residual of the laws by the package's measure, its velocities worked out apart from it."""
    model, _, work = problem.copy()
    force = solution.wrench[:, :2]
    work.corner_rate[:] = corner_rates(problem, solution.velocity)
    work.reaction[:] = solution.wrench
    work.reaction[:, 2] -= cross(work.pivot, force)
    return contact_residual(model, work, scale_of(problem), np.abs(force).max() or 1.0)


def test_the_package_s_measure_sees_a_broken_law():
    problem = random_state(np.random.default_rng(3), 9, 0.7, "hinged")
    solution = by_newton(problem)
    assert measured(problem, solution) < 1e-10
    wrench = solution.wrench.copy()
    velocity = solution.velocity.copy()
    wrench[4, 1] *= 1.001
    velocity[3, 0] += 1e-3
    assert measured(problem, solution._replace(wrench=wrench)) > 1e-7
    assert measured(problem, solution._replace(velocity=velocity)) > 1e-6


@pytest.mark.parametrize("kind", KINDS)
class TestLaws:
    def test_hold_with_the_balance_and_the_motion_is_that_of_the_iteration_on_modes(
        self, kind
    ):
        rng = np.random.default_rng(60 + KINDS.index(kind))
        compared = other = 0
        for _ in range(200):
            problem = random_problem(rng, int(rng.integers(2, 40)), kind)
            solution = by_path(problem)
            iterated = by_newton(problem)
            assert solution.solved
            assert law_violation(problem, solution) < 1e-10
            assert measured(problem, solution) < 1e-10
            assert balance_error(problem, solution) < 1e-12
            if iterated.solved:
                compared += 1
                assert law_violation(problem, iterated) < 1e-10
                apart = np.abs(iterated.velocity - solution.velocity).max()
                other += apart > 1e-7 * scale_of(problem)
        assert compared >= 100
        # Under friction two motions may both obey the laws: at impacts 7 % of 500 problems.
        assert other <= 0.1 * compared


@pytest.mark.parametrize(
    ("friction", "solvable"), [(1.3, True), (1.4, False), (4.0, False)]
)
def test_a_state_without_a_solution_is_reported_as_one(friction, solvable):
    problem = rod(friction)
    assert by_path(problem).solved == by_newton(problem).solved == solvable
    # At any friction it has one without contact.
    lifted = by_path(rod(friction, lift=11.0, mode=Mode(())))
    assert lifted.solved
    assert lifted.velocity[0] == pytest.approx([0.0, 1.0, 0.0])
