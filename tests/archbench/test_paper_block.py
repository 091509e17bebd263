"""The single block of the paper against the kernels, which know nothing of its closed forms.

The judge is the contact problem of a chain, posed on a chain of one body.
"""

import math
from collections import Counter

import numpy as np
import pytest
from tests.physics.adapters import Mode, pose, solve

from archbench.paper import block as paper
from archbench.paper.block import CORNER_A, CORNER_B, gradient, metric, uniform_block
from archbench.paper.regions import (
    impact_ratio,
    painleve_friction,
    rocking_friction,
    starting_region,
)
from archfrag.arch import STANDARD_GRAVITY as g

REST, SLIDE, ROCK, SLIDE_ROCK, LIFT_OFF = paper.Mechanism
RIGHT = 0  # a chain's corners of the base: intrados and extrados
LEFT = 1
BASE = CORNER_A, CORNER_B
NEAR = 1e-9
STILL = 2e-11


def random_block(rng):
    """Any body with a flat base and its mass centre above it."""
    reaches = rng.uniform(0.1, 1.0, 2)
    return paper.RigidBlock(
        rng.uniform(10, 1000), rng.uniform(5, 500), *reaches, rng.uniform(0.2, 2)
    )


def contact_answer(block, corners, rotation, free, friction, omega, slip):
    """The contact problem of a chain of one body that touches flat ground at `corners`."""
    point = np.zeros((1, 2, 2))
    touching = np.zeros((1, 2), bool)
    for corner, side in ((RIGHT, CORNER_B), (LEFT, CORNER_A)):
        point[0, corner] = paper.corner_arm(block, side, rotation)
        touching[0, corner] = side in corners
    up = np.array([[0.0, 1.0]])
    sense = int(np.sign(slip))
    both = np.stack([up, up], axis=1)
    return solve(
        pose(
            [block.mass],
            [block.inertia],
            np.zeros((1, 2)),
            [friction],
            [Mode(tuple(np.flatnonzero(touching[0])), sense)],
            free,
            point=point,
            normal=up,
            side_normal=np.stack([both, both], axis=2),
            candidate=touching,
            known=sense,
            bias=-(omega**2) * point,
        )
    )


def same_answer(found, answer, block, rotation, scale):
    assert answer.solved
    motion = answer.velocity[0]
    reaction = answer.wrench[0]
    size = np.sqrt(block.inertia)
    size /= math.sqrt(block.mass)
    expected = motion * [1.0, 1.0, size]
    assert [found.x, found.y, size * found.rotation] == pytest.approx(
        expected, abs=1e-9 * scale
    )
    force = block.mass * scale
    assert [found.tangential, found.normal] == pytest.approx(
        reaction[:2], abs=1e-9 * force
    )
    if found.normal > 1e-6 * force:
        place = found.centre * (block.reach_a + block.reach_b) - block.reach_a
        x, y = paper.arm_to(place, -block.rise, rotation)
        moment = x * found.normal - y * found.tangential
        assert moment == pytest.approx(reaction[2], abs=1e-9 * force * size)


class TestGradients:
    """Eqs 1 to 4 and 17: the metric of kinetic energy."""

    def test_gradient_maps_velocity_to_the_point_and_its_reaction_has_the_same_power(
        self,
    ):
        rng = np.random.default_rng(1)
        d = 1e-6
        for _ in range(50):
            block = random_block(rng)
            place = rng.uniform(-1, 1, 2)
            rotation = rng.uniform(-1, 1)
            x, y, tilt = rng.uniform(-1, 1, 3)
            arm = paper.arm_to(*place, rotation)
            velocity = metric(block) * [x, y, tilt]
            later, sooner = (
                paper.arm_to(*place, rotation + s * d * tilt) for s in (1, -1)
            )
            n = gradient(block, arm)
            moved = np.array([x, y]) + (later - sooner) / (2 * d)
            assert paper.point_velocity(n, velocity) == pytest.approx(moved, abs=1e-9)
            kinetic = block.mass * (x * x + y * y) + block.inertia * tilt * tilt
            assert velocity @ velocity == pytest.approx(kinetic)
            slope = (gradient(block, later) - gradient(block, sooner)) / (2 * d)
            assert paper.gradient_rate(block, arm, tilt) == pytest.approx(
                slope, abs=1e-8
            )
            psi = paper.generalised_reaction(n, [3.0, 7.0])
            assert psi @ velocity == pytest.approx([3.0, 7.0] * moved, abs=1e-7)

    def test_admissible_velocities_keep_the_whole_base_out_of_the_ground(self):
        rng = np.random.default_rng(4)
        signs = set()
        for _ in range(200):
            block, (x, y, tilt) = random_block(rng), rng.uniform(-1, 1, 3)
            places = np.linspace(-block.reach_a, block.reach_b, 50)
            least = paper.least_normal_velocity(block, metric(block) * [x, y, tilt])
            assert least == pytest.approx((y + places * tilt).min())
            signs.add(least > 0)
        assert signs == {True, False}


def test_friction_of_a_sliding_contact_dissipates_most():
    rng = np.random.default_rng(5)
    for _ in range(200):
        slip = rng.uniform(-2, 2)
        normal = rng.uniform(0, 10)
        friction = rng.uniform(0, 1)
        right = -math.copysign(friction * normal, slip)
        assert paper.coulomb(slip, right, normal, friction) == 0.0
        least = paper.dissipation_excess(slip, right, normal, friction)
        assert least == pytest.approx(0.0, abs=1e-12)
        for other in rng.uniform(-friction * normal, friction * normal, 20):
            assert paper.dissipation_excess(slip, other, normal, friction) < 0.0
            assert paper.coulomb(slip, other, normal, friction) > 0.0


class TestPlane:
    """Eqs 16 to 20 and Figs 4 to 7."""

    def test_reactions_hold_the_contact_point_and_close_the_balance_in_the_plane(self):
        rng = np.random.default_rng(7)
        for _ in range(50):
            block = random_block(rng)
            omega = rng.uniform(-2, 2)
            arm = paper.corner_arm(
                block, rng.choice([CORNER_A, CORNER_B]), rng.uniform(-0.5, 0.5)
            )
            n = gradient(block, arm)
            rate = paper.gradient_rate(block, arm, omega)
            mechanism = paper.rocking_mechanism(block, arm, omega)
            assert n @ mechanism == pytest.approx((0, 0), abs=1e-12)
            known = paper.centripetal_acceleration(n, rate, mechanism).sum(axis=0)
            expected = omega**2 * metric(block) * [*arm, 0.0]
            assert known == pytest.approx(expected, abs=1e-9)
            held = paper.contact_acceleration(n, rate, mechanism, known)
            assert held == pytest.approx((0.0, 0.0), abs=1e-9)
            active = paper.active_force(block, *rng.uniform(-0.5, 0.5, 2), g)
            force = paper.sticking_reaction(n, active, -rate @ mechanism)
            psi = paper.generalised_reaction(n, force)
            moved = paper.contact_acceleration(
                n, rate, mechanism, active + psi.sum(axis=0)
            )
            assert moved == pytest.approx((0.0, 0.0), abs=1e-9)
            left = known - paper.part_in_plane(active, mechanism)
            assert left == pytest.approx(psi.sum(axis=0), abs=1e-7)

    def test_cone_holds_the_reactions_that_friction_allows(self):
        n = gradient(uniform_block(0.4, 1.0, 1.0), np.array([-0.2, -0.5]))
        edges = paper.cone(n, 0.6)
        assert edges == pytest.approx(np.array([n[1] + 0.6 * n[0], n[1] - 0.6 * n[0]]))
        for t, inside in ((0.59, True), (-0.59, True), (0.61, False)):
            assert paper.inside_cone(t, 1.0, 0.6) is inside
        assert not paper.inside_cone(0.0, -1.0, 0.6)


def borders(block, friction, load):
    """Distance from the borders of the regions in units of k_s / (1 + k_v) and mu."""
    base = 2.0 * block.reach_a
    tipping = rocking_friction(block, CORNER_A, load)
    return min(
        abs(load - min(friction, base)),
        abs(friction - tipping) if load >= base else math.inf,
        abs(friction - base) if load >= friction else math.inf,
    )


class TestRegions:
    """Three forms of the same answer: regions, the block's problem, the chain's."""

    def agree(self, block, ground_x, ground_y, friction):
        """The motion of a block of unit height that stood flat, by all of them."""
        region = starting_region(block, ground_x, ground_y, friction)
        start = paper.starting_motion(block, ground_x, ground_y, friction, 1.0)
        assert (start.mechanism, start.solutions) == (region, 1)
        free = [-ground_x, -1.0 - ground_y, 0.0]
        answer = contact_answer(block, BASE, 0.0, free, friction, 0.0, 0.0)
        x, y, rotation = answer.velocity[0]
        rocks = block.reach_a * abs(rotation) > STILL
        slides = abs(x + 0.5 * rotation) > STILL
        found = np.array([[REST, SLIDE], [ROCK, SLIDE_ROCK]])[int(rocks), int(slides)]
        assert answer.solved
        assert region == (
            LIFT_OFF if y - block.reach_a * abs(rotation) > STILL else found
        )
        return region

    @pytest.mark.parametrize("base", [0.2, 0.7, 2.5])
    @pytest.mark.parametrize("ground_y", [0.0, 0.35])
    def test_inside_and_right_up_to_their_borders(self, base, ground_y):
        rng = np.random.default_rng(3)
        seen = Counter()
        block = uniform_block(base, 1.0, 2000.0)
        reach = 2.5 * max(base, 0.4)
        for load, friction in rng.uniform([-reach, 0.0], [reach, reach], (150, 2)):
            if borders(block, friction, abs(load)) > NEAR:
                seen[
                    self.agree(block, load * (1.0 + ground_y), ground_y, friction)
                ] += 1
        assert set(seen) == {REST, SLIDE, ROCK, SLIDE_ROCK}
        for _ in range(10):
            low = base * rng.uniform(0.02, 0.98)
            high = base * rng.uniform(1.02, 4.0)
            curve = rocking_friction(block, CORNER_A, high)
            for load, friction, across in (
                (low, low, (1, -1)),
                (base, high, (1, 0)),
                (high, base, (0, 1)),
                (high, curve, (0, 1)),
            ):
                for shift in (-3 * NEAR, 3 * NEAR):
                    ground_x = (
                        rng.choice([-1, 1])
                        * (load + shift * across[0])
                        * (1.0 + ground_y)
                    )
                    self.agree(block, ground_x, ground_y, friction + shift * across[1])

    def test_least_load_is_the_end_of_the_region_of_rest(self):
        rng = np.random.default_rng(6)
        for _ in range(50):
            block = random_block(rng)
            friction = rng.uniform(0.05, 2.0)
            load = paper.least_load(block, CORNER_A, friction)
            for part, rests in ((0.999, True), (1.001, False)):
                assert (
                    paper.starting_motion(block, part * load, 0.0, friction, g)[0]
                    == REST
                ) is rests

    def test_nothing_holds_a_block_whose_ground_falls_faster_than_itself(self):
        for ground_y in (-1.2, -3.0):
            assert (
                self.agree(uniform_block(0.5, 1.0, 1.0), 0.3, ground_y, 0.5) == LIFT_OFF
            )


class TestContactProblem:
    """The block's own answers against the chain's, over random states."""

    def test_reactions_in_motion_about_a_corner(self):
        rng = np.random.default_rng(21)
        seen = Counter()
        for _ in range(800):
            block = random_block(rng)
            side = int(rng.choice([CORNER_A, CORNER_B]))
            rotation = -side * rng.uniform(0, 1.2)
            omega = rng.uniform(-4, 4)
            slip = rng.choice([0.0, 1.0, -1.0]) * rng.uniform(0.1, 2)
            ground = rng.uniform(-1.5, 1.5, 2) * (1.0, 0.6)
            friction = rng.uniform(0, 1.2) if rng.random() < 0.9 else math.inf
            active = paper.active_force(block, *ground, g)
            found = paper.corner_motion(
                block, side, rotation, omega, slip, active, friction
            )
            seen[found.mechanism, found.solutions] += 1
            if found.solutions != 1:
                assert friction > painleve_friction(block, side, rotation)
                continue
            if slip and math.isinf(friction):
                continue
            free = g * np.array([-ground[0], -1.0 - ground[1], 0.0])
            answer = contact_answer(
                block, (side,), rotation, free, friction, omega, slip
            )
            arm = math.hypot(paper.reach(block, side), block.rise)
            same_answer(found, answer, block, rotation, 2 * g + omega**2 * arm)
        assert all(seen[kind, 1] > 50 for kind in (ROCK, SLIDE_ROCK, LIFT_OFF)), seen

    @pytest.mark.parametrize("slips", [0.0, 1.0, -1.0])
    def test_start_and_sliding_on_the_whole_base(self, slips):
        rng = np.random.default_rng(22)
        seen = set()
        for _ in range(300):
            block = random_block(rng)
            ground = rng.uniform(-1.5, 1.5, 2) * (1.0, 0.8)
            friction = rng.uniform(0, 1.2)
            active = paper.active_force(block, *ground, g)
            found = paper.contact_problem(block, active, friction, slips)
            if found.solutions != 1:
                continue
            seen.add(found.mechanism)
            free = active / metric(block)
            answer = contact_answer(block, BASE, 0.0, free, friction, 0.0, slips)
            same_answer(found, answer, block, 0.0, 2 * g)
        assert seen >= (
            {SLIDE, SLIDE_ROCK, LIFT_OFF} if slips else set(paper.Mechanism)
        )

    @pytest.mark.parametrize("flat", [True, False])
    def test_impacts_and_what_they_take(self, flat):
        rng = np.random.default_rng(23)
        seen = Counter()
        lost = []
        for _ in range(600):
            block = random_block(rng)
            friction = rng.uniform(0, 1.2)
            before = rng.normal(size=3) * (1.0, 0.5, 2.0) - (0.0, 0.5, 0.0)
            start = metric(block) * before
            side = 0
            rotation = 0.0
            if not flat:
                side = int(rng.choice([CORNER_A, CORNER_B]))
                rotation = -side * rng.uniform(0, 1.2)
            found = paper.contact_problem(block, start, friction, 0.0, side, rotation)
            seen[found.mechanism] += 1
            end = metric(block) * found[6:9]
            change = 0.5 * (end @ end - start @ start)
            assert change <= 1e-12
            if found.solutions != 1 or math.isnan(found.centre):
                continue
            corners = (side,) if side else BASE
            answer = contact_answer(
                block, corners, rotation, before, friction, 0.0, 0.0
            )
            same_answer(found, answer, block, rotation, np.abs(before).max())
            place = found.centre * (block.reach_a + block.reach_b) - block.reach_a
            n = gradient(block, paper.arm_to(place, -block.rise, rotation))
            xi = paper.generalised_reaction(n, found[4:6])
            virtual = np.array([0.3, 0.1, -0.7])
            assert paper.impulsive_balance(start, end, xi, virtual) == pytest.approx(
                0, abs=1e-8
            )
            rate = n[1] @ end if side or found.mechanism in (REST, SLIDE) else 0.0
            assert paper.signorini(rate, found.normal) == pytest.approx(0.0, abs=1e-8)
            lost.append(change)
        kinds = (
            (REST, SLIDE, ROCK, SLIDE_ROCK, LIFT_OFF)
            if flat
            else (ROCK, SLIDE_ROCK, LIFT_OFF)
        )
        assert all(seen[kind] > 3 for kind in kinds), seen
        assert min(lost) < -1.0

    def test_a_squat_block_stays_flat(self):
        squat = uniform_block(1.5, 1.0, 100.0)
        assert impact_ratio(squat, CORNER_A) < 0.0
        least = squat.rise / squat.reach_a
        for friction in (math.inf, 1.01 * least):
            assert (
                paper.rocking_impact(squat, CORNER_A, -0.7, 0.0, friction).mechanism
                == REST
            )
        assert paper.rocking_impact(squat, CORNER_A, -0.7, 0.0, 0.99 * least).slip > 0.0

    @pytest.mark.parametrize(
        ("friction", "solutions"), [(1.3333, {1}), (1.36, {0, 1, 2})]
    )
    def test_painleve_states_have_one_motion_below_and_some_none_or_two_above(
        self, friction, solutions
    ):
        rng = np.random.default_rng(41)
        seen = set()
        for _ in range(1500):
            block = uniform_block(1.0, rng.uniform(1.8, 2.2), 1.0)
            rotation = rng.uniform(0, 0.01)
            omega = rng.uniform(-6, 6)
            slip = rng.choice([-1, 1])
            active = paper.active_force(block, rng.uniform(-1, 1), 0.0, g)
            found = paper.corner_motion(
                block, CORNER_A, rotation, omega, slip, active, friction
            )
            seen.add(found.solutions)
            assert found.solutions == 1 or found.mechanism == LIFT_OFF
        assert seen == solutions
