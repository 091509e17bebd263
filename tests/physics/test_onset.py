"""Onset of motion against both theorems of limit analysis."""

import math
from itertools import pairwise

import numpy as np
import pytest

import archfrag as af
from archbench.paper.arch import least_load, mechanism_of
from archfrag.errors import StabilityError
from tests.mechanics.adapters import CLOSED, Posed
from tests.mechanics.linkages import joined
from tests.validation.scenes import g, limit_analysis


def random_friction(rng, n, low):
    friction = rng.uniform(low, 1.1, n)
    friction[rng.random(n) < 0.3] = np.inf
    return friction


def random_ring(rng):
    n, thickness = int(rng.integers(2, 24)), rng.uniform(0.6, 3.5)
    return af.Arch.circular(
        10.0, thickness, rng.uniform(50.0, 180.0), n, random_friction(rng, n + 1, 0.3),
        dead_load=rng.uniform(0.0, 4e5, n) / n, sector=bool(rng.random() < 0.5),
    )  # fmt: skip


def random_column(rng):
    """A leaning, tapered stack of blocks with a free end."""
    n = int(rng.integers(1, 9))
    level = np.concatenate([[0.0], rng.uniform(0.3, 1.2, n).cumsum()])
    middle = rng.uniform(-0.06, 0.06) * level
    half = 0.5 - rng.uniform(0.0, 0.03) * level
    right, left = (
        np.stack([middle + side * half, level + rng.uniform(-0.05, 0.05, n + 1)], axis=1)
        for side in (1.0, -1.0)
    )
    return af.Arch.from_joints(right, left, random_friction(rng, n, 0.15), free_end=True)


def first_acceleration(arch, horizontal, vertical=0.0):
    """Largest acceleration of any voussoir under a steady ground acceleration [g]."""
    position = np.column_stack([arch.chain.centroid, np.zeros(arch.n_voussoir)])
    solution = Posed(
        arch.chain, position, 0.0 * position, [CLOSED] * arch.n_joint, horizontal * g, vertical * g
    ).by_contact_problem()
    assert solution.solved
    return np.abs(solution.velocity[:, :2]).max() / g


class TestStaticTheorem:
    """Rest is where forces in equilibrium, pressing and inside the cones, exist."""

    @pytest.mark.parametrize("kind", [random_ring, random_column])
    def test_onset_equals_the_linear_programme(self, kind):
        rng = np.random.default_rng(60)
        finite = standing = 0
        for _ in range(40):
            arch = kind(rng)
            start = af.onset(arch)
            expected = [limit_analysis(arch, sense) for sense in (1.0, -1.0)]
            if math.isnan(expected[0]):
                assert math.isnan(start.plus)
                assert not start.stands
                continue
            # Of ground acceleration towards +x the body force points towards -x.
            assert start.plus == pytest.approx(expected[0], rel=1e-7, abs=1e-9)
            assert -start.minus == pytest.approx(expected[1], rel=1e-7, abs=1e-9)
            assert start.stands == (expected[1] <= 0.0 <= expected[0])
            finite += math.isfinite(start.plus)
            standing += start.stands
        assert finite >= 20
        assert standing >= 12

    def test_depends_on_shape_alone(self):
        one = af.Arch.circular(10.0, 1.5, 157.5, 9, 0.6)
        two = af.Arch.circular(0.1, 0.015, 157.5, 9, 0.6, density=7800.0, depth=0.3)
        assert af.onset(two).plus == pytest.approx(af.onset(one).plus, rel=1e-9)


class TestKinematicTheorem:
    """At onset the weights do no net work on the mechanism that the hinges allow."""

    @pytest.mark.parametrize("sense", [1.0, -1.0])
    def test_work_on_the_four_hinges_gives_the_same_load(self, sense):
        rng = np.random.default_rng(8)
        tried = 0
        while tried < 25:
            n = int(rng.integers(5, 40))
            arch = af.Arch.circular(
                10.0, rng.uniform(1.1, 2.5), rng.uniform(90.0, 175.0), n, math.inf,
                dead_load=rng.uniform(0.0, 2e5, n),
            )  # fmt: skip
            start = af.onset(arch)
            hinges = start.hinges if sense > 0 else start.hinges_minus
            value = start.plus if sense > 0 else -start.minus
            if not start.stands or len({joint for joint, _ in hinges}) != 4:
                continue
            tried += 1
            corners = {"intrados": arch.intrados, "extrados": arch.extrados}
            place = np.array([corners[side][joint] for joint, side in hinges])
            joints, chain = [joint for joint, _ in hinges], arch.chain
            parts = [joined(chain, np.arange(*ends), chain.centroid) for ends in pairwise(joints)]
            centroid = np.array([part[2] for part in parts])
            motion = mechanism_of(centroid, place)
            assert least_load(np.array([part[0] for part in parts]), motion) == (
                pytest.approx(value, rel=1e-8)
            )
            # A hinge at the extrados opens the intrados: its relative rotation has the other sign.
            opening = np.diff([0.0, *motion[:, 2], 0.0])
            side = np.array([1.0 if name == "extrados" else -1.0 for _, name in hinges])
            assert len(set(np.sign(opening * side))) == 1


class TestDirectionOfTheBodyForce:
    """With vertical acceleration the range of rest holds for k_h / (1 + k_v)."""

    @pytest.mark.parametrize("vertical", [-0.5, 0.0, 0.7])
    def test_contact_problem_starts_to_move_at_the_limit(self, vertical):
        rng = np.random.default_rng(21)
        tried = 0
        while tried < 12:
            n = int(rng.integers(3, 30))
            arch = af.Arch.circular(
                10.0, rng.uniform(1.2, 2.5), rng.uniform(80.0, 170.0), n, rng.uniform(0.6, 1.2)
            )
            start = af.onset(arch)
            if not start.stands or not math.isfinite(start.plus):
                continue
            tried += 1
            limit = start.plus * (1.0 + vertical)
            assert first_acceleration(arch, 0.999 * limit, vertical) < 1e-9
            assert first_acceleration(arch, -0.999 * limit, vertical) < 1e-9
            assert first_acceleration(arch, 1.001 * limit, vertical) > 1e-6
            assert first_acceleration(arch, -1.001 * limit, vertical) > 1e-6


class TestThrustLine:
    def test_crosses_each_joint_where_the_forces_before_it_have_no_moment(self):
        arch = af.Arch.circular(10.0, 1.5, 157.5, 9, 0.7)
        start = af.onset(arch)
        line, centre = start.thrust_plus, arch.chain.centroid
        force = np.outer(arch.chain.mass * g, [-start.plus, -1.0])

        def moments(joint):
            """Of a unit force along x and along y at the first joint, and of the weights."""
            lever = line[0] - line[joint]
            arm = centre[:joint] - line[joint]
            load = arm[:, 0] * force[:joint, 1] - arm[:, 1] * force[:joint, 0]
            return [-lever[1], lever[0], load.sum()]

        rows = np.array([moments(joint) for joint in range(1, 10)])
        thrust = np.linalg.solve(rows[[2, 8], :2], -rows[[2, 8], 2])
        left = rows[:, :2] @ thrust + rows[:, 2]
        assert np.abs(left).max() < 1e-9 * np.abs(rows[:, 2]).max()
        assert thrust[1] > 0.0


class TestArchThatDoesNotStand:
    def test_is_a_clear_message_of_simulate(self):
        thin = af.Arch.circular(10.0, 0.95, 180.0, 27, 0.7, sector=False)
        still = af.Motion(np.zeros(10), 0.01)
        with pytest.raises(StabilityError) as caught:
            af.simulate(thin, still)
        message = str(caught.value)
        assert message.count("\n") == 0
        assert "does not stand under its own weight; make it thicker" in message
        assert "27 voussoirs" in message

    def test_a_leaning_column_gives_what_would_hold_it(self):
        right = np.array([[0.25, 0.0], [0.85, 3.0]])
        column = af.Arch.from_joints(right, right - [0.5, 0.0], 1.0, free_end=True)
        start = af.onset(column)
        assert not start.stands
        # Its centroid lies 0.05 m beyond its base's edge and 1.5 m above it.
        assert -start.minus == pytest.approx(0.05 / 1.5, rel=1e-9)
        with pytest.raises(StabilityError, match=r"between 0\.0333\d* and 0\.3667 g"):
            af.simulate(column, af.Motion(np.zeros(10), 0.01))
