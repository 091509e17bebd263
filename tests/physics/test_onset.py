"""Onset of motion against both theorems of limit analysis."""

import math
from itertools import pairwise

import numpy as np
import pytest

import archfrag as af
from archbench.paper.arch import least_load, mechanism_of
from archfrag.errors import StabilityError
from tests.physics.adapters import CLOSED, Posed
from tests.physics.linkages import joined
from tests.validation.scenes import g, limit_analysis


def random_friction(rng, n, low):
    friction = rng.uniform(low, 1.1, n)
    friction[rng.random(n) < 0.3] = np.inf
    return friction


def random_ring(rng):
    n = int(rng.integers(2, 24))
    thickness = rng.uniform(0.6, 3.5)
    return af.Arch.circular(
        10.0,
        thickness,
        rng.uniform(50.0, 180.0),
        n,
        random_friction(rng, n + 1, 0.3),
        dead_load=rng.uniform(0.0, 4e5, n) / n,
        sector=bool(rng.random() < 0.5),
    )


def random_column(rng):
    """A leaning, tapered stack of blocks with a free end."""
    n = int(rng.integers(1, 9))
    level = np.concatenate([[0.0], rng.uniform(0.3, 1.2, n).cumsum()])
    middle = rng.uniform(-0.06, 0.06) * level
    half = 0.5 - rng.uniform(0.0, 0.03) * level
    right, left = (
        np.stack(
            [middle + side * half, level + rng.uniform(-0.05, 0.05, n + 1)], axis=1
        )
        for side in (1.0, -1.0)
    )
    return af.Arch.from_joints(
        right, left, random_friction(rng, n, 0.15), free_end=True
    )


class TestStaticTheorem:
    """Rest is where forces in equilibrium, pressing and inside the cones, exist."""

    @pytest.mark.parametrize("kind", [random_ring, random_column])
    def test_onset_equals_the_linear_programme(self, kind):
        rng = np.random.default_rng(60)
        finite = standing = 0
        for _ in range(40):
            arch = kind(rng)
            start = af.onset(arch)
            # Of ground acceleration towards +x the body force points towards -x.
            expected = [limit_analysis(arch, sense) for sense in (1.0, -1.0)]
            assert [start.plus, -start.minus] == (
                pytest.approx(expected, rel=1e-7, abs=1e-9, nan_ok=True)
            )
            assert start.stands == (expected[1] <= 0.0 <= expected[0])
            finite += math.isfinite(start.plus)
            standing += start.stands
        assert finite >= 20
        assert standing >= 12


class TestKinematicTheorem:
    """At onset the weights do no net work on the mechanism that the hinges allow."""

    @pytest.mark.parametrize("sense", [1.0, -1.0])
    def test_work_on_the_four_hinges_gives_the_same_load(self, sense):
        rng = np.random.default_rng(8)
        tried = 0
        while tried < 25:
            n = int(rng.integers(5, 40))
            arch = af.Arch.circular(
                10.0,
                rng.uniform(1.1, 2.5),
                rng.uniform(90.0, 175.0),
                n,
                math.inf,
                dead_load=rng.uniform(0.0, 2e5, n),
            )
            start = af.onset(arch)
            chain = arch.chain
            hinges = start.hinges if sense > 0 else start.hinges_minus
            joints = [joint for joint, _ in hinges]
            if not start.stands or len(set(joints)) != 4:
                continue
            tried += 1
            place = np.array([getattr(arch, side)[joint] for joint, side in hinges])
            parts = [
                joined(chain, np.arange(*ends), chain.centroid)
                for ends in pairwise(joints)
            ]
            motion = mechanism_of(np.array([part[2] for part in parts]), place)
            value = start.plus if sense > 0 else -start.minus
            assert least_load(np.array([part[0] for part in parts]), motion) == (
                pytest.approx(value, rel=1e-8)
            )
            # A hinge at the extrados opens the intrados: its relative rotation has the other sign.
            opening = np.diff([0.0, *motion[:, 2], 0.0])
            side = np.array([1.0 if name == "extrados" else -1.0 for _, name in hinges])
            assert len(set(np.sign(opening * side))) == 1


@pytest.mark.parametrize("vertical", [-0.5, 0.0, 0.7])
def test_with_vertical_acceleration_the_range_of_rest_holds_for_the_ratio(vertical):
    """The contact problem starts to move at k_h / (1 + k_v)."""
    rng = np.random.default_rng(21)
    tried = 0
    while tried < 12:
        n = int(rng.integers(3, 30))
        arch = af.Arch.circular(
            10.0,
            rng.uniform(1.2, 2.5),
            rng.uniform(80.0, 170.0),
            n,
            rng.uniform(0.6, 1.2),
        )
        start = af.onset(arch)
        if not start.stands or not math.isfinite(start.plus):
            continue
        tried += 1
        rest = np.column_stack([arch.chain.centroid, np.zeros(n)])
        for part, moves in (
            (0.999, False),
            (-0.999, False),
            (1.001, True),
            (-1.001, True),
        ):
            load = part * start.plus * (1.0 + vertical) * g
            solution = Posed(
                arch.chain,
                rest,
                0.0 * rest,
                [CLOSED] * arch.n_joint,
                load,
                vertical * g,
            ).by_contact_problem()
            assert solution.solved
            largest = np.abs(solution.velocity[:, :2]).max() / g
            assert largest > 1e-6 if moves else largest < 1e-9


def test_thrust_line_crosses_joints_where_the_forces_before_them_have_no_moment():
    arch = af.Arch.circular(10.0, 1.5, 157.5, 9, 0.7)
    start = af.onset(arch)
    line = start.thrust_plus
    centre = arch.chain.centroid
    force = np.outer(arch.chain.mass * g, [-start.plus, -1.0])

    def moments(joint):
        """Of a unit force along x and along y at the first joint, and of the weights."""
        lever = line[0] - line[joint]
        arm = centre[:joint] - line[joint]
        load = arm[:, 0] * force[:joint, 1] - arm[:, 1] * force[:joint, 0]
        return [-lever[1], lever[0], load.sum()]

    rows = np.array([moments(joint) for joint in range(1, 10)])
    thrust = np.linalg.solve(rows[[2, 8], :2], -rows[[2, 8], 2])
    assert np.abs(rows @ [*thrust, 1.0]).max() < 1e-9 * np.abs(rows[:, 2]).max()
    assert thrust[1] > 0.0


RIGHT = np.array([[0.25, 0.0], [0.85, 3.0]])


@pytest.mark.parametrize(
    ("arch", "message"),
    [
        (
            af.Arch.circular(10.0, 0.95, 180.0, 27, 0.7, sector=False),
            r"27 voussoirs.* does not stand under its own weight; make it thicker",
        ),
        # Its centroid lies 0.05 m beyond its base's edge and 1.5 m above it.
        (
            af.Arch.from_joints(RIGHT, RIGHT - [0.5, 0.0], 1.0, free_end=True),
            r"between 0\.0333\d* and 0\.3667 g",
        ),
    ],
)
def test_an_arch_that_does_not_stand_is_one_message_of_simulate(arch, message):
    with pytest.raises(StabilityError, match=message) as caught:
        af.simulate(arch, af.Motion(np.zeros(10), 0.01))
    assert "\n" not in str(caught.value)
