"""The contact problem: both laws and the balance of momentum, in states of every kind."""

import itertools

import numpy as np
import pytest

from archfrag.mechanics.delassus import assemble, solve_modes, velocity_scale
from archfrag.mechanics.former_contact import COMPLIANCE, Contacts, contact_work, solve_contact
from archfrag.mechanics.laws import CLOSED_MINUS, CLOSED_PLUS, CLOSED_STICK, OPEN, touches
from tests.physics.random_states import KINDS, problem_residual, random_state

SOLVED = 0


def solve(state):
    """Solve one state; its work and the residual of the laws, measured apart from the solver."""
    mass, inertia, contacts, friction, free, mode = state
    work = contact_work(mass.size, friction.size)
    work.mode[:] = mode
    status, _, breaks, compliant = solve_contact(mass, inertia, contacts, friction, free, work)
    return work, status, breaks, compliant, residual_of(state, work)


def residual_of(state, work):
    _, _, contacts, friction, free, _ = state
    return problem_residual(contacts, friction, free, work)


def one_block(friction, push, candidate=(1, 1)):
    """A block 1 m wide and high on the ground under gravity and a horizontal push [m/s2]."""
    up = np.array([0.0, 1.0])
    contacts = Contacts(
        centroid=np.array([[0.0, 0.5]]),
        point=np.array([[[0.5, 0.0], [-0.5, 0.0]]]),
        normal=up[None],
        normal_plus=np.array([[up, up]]),
        normal_minus=np.array([[up, up]]),
        candidate=np.array([candidate], np.int8),
        slip=np.zeros(1, np.int8),
        bias=np.zeros((1, 2, 2)),
    )
    free = np.array([[push, -10.0, 0.0]])
    mode = np.array([CLOSED_STICK], np.int8)
    return np.ones(1), np.full(1, 1 / 6), contacts, np.array([friction]), free, mode


class TestSignoriniAndCoulomb:
    @pytest.mark.parametrize("kind", KINDS)
    def test_both_laws_hold_in_random_states(self, kind):
        rng = np.random.default_rng(KINDS.index(kind))
        compliant_uses = 0
        for _ in range(2500):
            n = int(rng.integers(2, 82)) if rng.random() < 0.6 else int(rng.integers(2, 12))
            friction = rng.uniform(0.2, 1.2) if rng.random() < 0.8 else np.inf
            _, status, _, compliant, residual = solve(random_state(rng, n, friction, kind))
            compliant_uses += compliant
            assert status == SOLVED
            assert compliant or residual <= 1e-10
        assert compliant_uses <= 2

    def test_the_measure_sees_a_broken_law(self):
        rng = np.random.default_rng(3)
        state = random_state(rng, 9, 0.7, "hinged")
        work, *_, residual = solve(state)
        assert residual < 1e-10
        work.reaction[4, 1] *= 1.001
        assert residual_of(state, work) > 1e-7
        work, *_ = solve(state)
        work.velocity[3, 0] += 1e-3
        assert residual_of(state, work) > 1e-6

    def test_momentum_balances(self):
        rng = np.random.default_rng(4)
        for kind in KINDS:
            state = random_state(rng, 12, 0.6, kind)
            mass, inertia, contacts, _, free, _ = state
            work, *_ = solve(state)
            for i in range(12):
                force = work.reaction[i] - work.reaction[i + 1]
                moment = force[2]
                for j, sign in ((i, 1.0), (i + 1, -1.0)):
                    arm = work.pivot[j] - contacts.centroid[i]
                    moment += sign * (arm[0] * work.reaction[j, 1] - arm[1] * work.reaction[j, 0])
                gain = work.velocity[i] - free[i]
                expected = [force[0] / mass[i], force[1] / mass[i], moment / inertia[i]]
                size = np.abs(work.reaction).max() / mass[i]
                assert gain == pytest.approx(expected, abs=1e-9 * size)

    @pytest.mark.parametrize(("n", "states"), [(2, 40), (3, 8)])
    def test_answers_for_short_chains_are_among_all_mode_combinations(self, n, states):
        """No state without a solution: of every one, trying all cases finds what was found."""
        rng = np.random.default_rng(6)
        several = 0
        for trial in range(states):
            state = random_state(rng, n, rng.uniform(0.2, 1.2), KINDS[trial % 4])
            mass, inertia, contacts, friction, free, _ = state
            work, status, *_ = solve(state)
            assert status == SOLVED
            found = work.velocity.copy()
            other = contact_work(n, n + 1)
            assemble(mass, inertia, contacts, other)
            scale = velocity_scale(contacts, free, other)
            possible = [
                [
                    m
                    for m in range(10)
                    if all(contacts.candidate[j, c] or not touches(m, c) for c in range(2))
                ]
                for j in range(n + 1)
            ]
            answers = []
            for modes in itertools.product(*possible):
                other.mode[:] = modes
                left = solve_modes(
                    mass, inertia, contacts, friction, free, other, scale, COMPLIANCE, True
                )
                if left < 1e-8 * scale and residual_of(state, other) < 1e-8:
                    answers.append(other.velocity.copy())
            near = [np.abs(answer - found).max() < 1e-6 * scale for answer in answers]
            assert any(near)
            several += not all(near)
        # Coulomb friction may leave more than one motion; it must be the exception.
        assert several <= 0.1 * states


class TestCoulomb:
    """Coulomb's law is not the associated flow rule: sliding does not dilate."""

    def test_a_pushed_block_slides_without_rising(self):
        friction, push = 0.3, 5.0
        work, *_ = solve(one_block(friction, push))
        assert work.mode[0] in (CLOSED_PLUS, CLOSED_MINUS)
        assert work.velocity[0] == pytest.approx([push - friction * 10.0, 0.0, 0.0], abs=1e-10)
        # The associated rule takes the motion nearest to the free one with v_n >= mu |v_t|: the
        # projection on the cone's edge (1, mu), which rises by mu times its slip.
        edge = np.array([1.0, friction]) / np.hypot(1.0, friction)
        associated = edge * (np.array([push, -10.0]) @ edge)
        assert associated[0] == pytest.approx(1.835, abs=1e-3)
        assert associated[1] == pytest.approx(0.550, abs=1e-3)
        assert work.velocity[0, 0] == pytest.approx(2.0, abs=1e-9)

    def test_a_block_sticks_up_to_its_friction(self):
        for push, moves in ((2.99, False), (3.01, True)):
            work, *_ = solve(one_block(0.3, push))
            assert (abs(work.velocity[0, 0]) > 1e-6) == moves

    def test_infinite_friction_never_slides(self):
        work, *_ = solve(one_block(np.inf, 9.0))
        assert np.abs(work.velocity).max() < 1e-10


class TestUnilateral:
    def test_a_lifted_block_leaves(self):
        mass, inertia, contacts, friction, free, mode = one_block(0.3, 0.0)
        free[0, 1] = 2.0
        work, *_ = solve((mass, inertia, contacts, friction, free, mode))
        assert work.mode[0] == OPEN
        assert np.abs(work.reaction).max() == 0.0
        assert work.velocity[0, 1] == 2.0

    def test_a_pushed_tall_block_tips_about_its_far_corner(self):
        work, *_ = solve(one_block(2.0, 15.0))
        assert work.velocity[0, 2] < -0.1
        assert work.mode[0] == 1
