"""Inelastic impacts with friction (Eqs 8, 9, 11, 21): what they leave, and what they take."""

import math

import numpy as np
import pytest

import archfrag as af
from tests.physics.adapters import CLOSED, Mode
from tests.physics.linkages import random_hinged_arch
from tests.physics.moving import Impact
from tests.physics.oracles import balance_error, law_violation

HEIGHT = 4.0


def kinetic(chain, velocity):
    return 0.5 * (
        chain.mass @ (velocity[:, :2] ** 2).sum(1) + chain.inertia @ velocity[:, 2] ** 2
    )


def landing(width, friction, spin=1.0):
    """A block that rotates about its corner 0, at x = width / 2, as corner 1 lands."""
    chain = af.Block(width, HEIGHT, friction=friction).chain
    position = np.array([[0.0, 0.5 * HEIGHT, 0.0]])
    velocity = spin * np.array([[-0.5 * HEIGHT, -0.5 * width, 1.0]])
    return chain, Impact(chain, position, velocity, [Mode((0,))], (0, 1))


class TestBlock:
    @pytest.mark.parametrize("width", [0.4, 1.0, 2.0, 4.0])
    def test_rocks_on_at_the_rate_of_housner(self, width):
        chain, impact = landing(width, friction=5.0)
        ratio = 1.0 - 1.5 * math.sin(math.atan(width / HEIGHT)) ** 2
        assert impact.solved
        assert impact.modes == [Mode((1,))]
        expected = ratio * np.array([-0.5 * HEIGHT, 0.5 * width, 1.0])
        assert impact.velocity[0] == pytest.approx(expected, rel=1e-10)
        before = kinetic(chain, impact.free)
        assert impact.energy == pytest.approx((ratio**2 - 1.0) * before, rel=1e-9)
        assert impact.joints_closed == 1

    def test_stops_where_it_is_too_squat_to_rock(self):
        """Beyond sin^2 = 2/3 Housner's ratio is negative: both corners press, nothing moves."""
        chain, impact = landing(6.0, friction=5.0)
        assert impact.modes == [CLOSED]
        assert impact.velocity[0] == pytest.approx(np.zeros(3), abs=1e-12)
        assert impact.energy == pytest.approx(-kinetic(chain, impact.free), rel=1e-12)

    def test_without_an_approaching_corner_nothing_happens(self):
        chain, impact = landing(1.0, friction=0.6, spin=-1.0)
        assert impact.velocity == pytest.approx(impact.free)
        assert impact.energy == pytest.approx(
            0.0, abs=1e-9 * kinetic(chain, impact.velocity)
        )


def colliding(seed, friction, count):
    """Arches at rest in their geometry, or on four hinges, whose voussoirs are all struck."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        arch, state = random_hinged_arch(rng, friction)
        chain = arch.chain
        (position, velocity, modes), n = state, chain.mass.size
        if number % 3 == 0:
            position = np.column_stack([chain.centroid, np.zeros(n)])
            modes = [CLOSED] * (n + 1)
        struck = (
            rng.normal(size=(n, 3)) * [1.0, 1.0, 0.3] * 10.0 ** rng.uniform(-2.0, 0.5)
        )
        if number % 3 == 1:  # one blow to a motion that its hinges allow
            struck = velocity * (1.0 + 0.2 * rng.normal(size=(n, 1)))
        yield chain, position, struck, modes


@pytest.mark.parametrize("friction", [0.3, 0.7, np.inf])
class TestArch:
    def test_obeys_the_laws_makes_no_energy_and_leaves_nothing_to_resolve(
        self, friction
    ):
        solved = moves = 0
        for chain, position, velocity, modes in colliding(21, friction, 120):
            impact = Impact(chain, position, velocity, modes)
            if not impact.solved:
                continue
            solved += 1
            assert impact.velocity == pytest.approx(impact.solution.velocity)
            assert law_violation(impact.problem, impact.solution) < 1e-9
            assert balance_error(impact.problem, impact.solution) < 1e-11
            before = kinetic(chain, velocity)
            after = kinetic(chain, impact.velocity)
            assert after <= before * (1.0 + 1e-12)
            assert impact.energy == pytest.approx(after - before, abs=1e-9 * before)
            moves += after > 1e-6 * before
            second = Impact(chain, position, impact.velocity, impact.modes)
            if np.isinf(friction):
                # A corner may slide where it compresses by nothing, and stick by a further
                # impulse.
                assert kinetic(chain, second.velocity) <= after * (1.0 + 1e-9)
            else:
                scale = np.abs(velocity).max()
                assert second.velocity == pytest.approx(
                    impact.velocity, abs=1e-8 * scale
                )
        assert solved >= 118
        assert moves >= 60
