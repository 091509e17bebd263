"""Validation of the single block by published and computed values, and Painleve's paradox.

The rocking equation is integrated here, by scipy, from the block's kernels.
"""

import math

import numpy as np
import pytest

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY as g
from archfrag.mechanics.block.formulas import CORNER_A, CORNER_B, RigidBlock, uniform_block
from archfrag.mechanics.block.motion import (
    LIFT_OFF,
    REST,
    ROCK,
    SLIDE,
    SLIDE_ROCK,
    Solutions,
    corner_motion,
    rocking_impact,
    starting_motion,
)
from archfrag.mechanics.block.regions import (
    impact_ratio,
    painleve_friction,
    rocking_friction,
)

EXACT = {"rtol": 1e-11, "atol": 1e-13, "method": "DOP853"}


class TestOnset:
    @pytest.mark.parametrize(("base", "friction"), [(0.2, 0.5), (0.2, 0.15), (0.5, 0.3)])
    def test_rest_rule(self, base, friction):
        block = uniform_block(base, 1.0, 100.0)
        limit = min(base, friction)
        for load in (-limit, -0.5 * limit, 0.0, 0.999999 * limit):
            assert starting_motion(block, load, 0.0, friction, g).mechanism == REST
        for load in (-1.000001 * limit, 1.000001 * limit):
            moves = starting_motion(block, load, 0.0, friction, g).mechanism
            assert moves == (ROCK if base < friction else SLIDE)
        found = af.onset(af.Block(base, 1.0, friction=friction))
        assert found.plus == pytest.approx(limit, rel=1e-12)


class TestHousner:
    def test_a_squat_block_stays_flat(self):
        squat = uniform_block(1.5, 1.0, 100.0)
        assert impact_ratio(squat, CORNER_A) < 0.0
        assert rocking_impact(squat, CORNER_A, -0.7, 0.0, math.inf).mechanism == REST
        least = squat.rise / squat.reach_a
        assert rocking_impact(squat, CORNER_A, -0.7, 0.0, 1.01 * least).mechanism == REST
        assert rocking_impact(squat, CORNER_A, -0.7, 0.0, 0.99 * least).slip > 0.0

    @pytest.mark.parametrize("gamma", [0.8, 1.0, 2.0, 5.0])
    def test_below_a_friction_the_impact_slides(self, gamma):
        block = uniform_block(1.0, gamma, 100.0)
        least = 3 * gamma / (1 + 4 * gamma**2)
        assert rocking_friction(block, CORNER_A, 0.0) == pytest.approx(least, rel=1e-12)
        for friction in (1.000001 * least, 0.999999 * least, 0.5 * least):
            after = rocking_impact(block, CORNER_A, -0.7, 0.0, friction)
            assert (after.mechanism == ROCK) == (friction > least)
            assert after.mechanism in (ROCK, SLIDE_ROCK, SLIDE)
            assert abs(after.tangential) <= friction * after.normal * (1 + 1e-12)
            assert (after.slip > 0.0) == (friction < least)
            if friction < least:
                assert after.tangential == pytest.approx(-friction * after.normal)


class TestPainleve:
    def test_impossible_below_four_thirds_for_a_rectangle(self):
        least = min(
            painleve_friction(uniform_block(1.0, gamma, 1.0), side, rotation)
            for gamma in np.geomspace(0.1, 10.0, 101)
            for rotation in np.linspace(-1.5, 1.5, 101)
            for side in (CORNER_A, CORNER_B)
        )
        assert least + 1e-12 >= 4 / 3
        assert least == pytest.approx(4 / 3, abs=1e-3)
        assert painleve_friction(uniform_block(1.0, 2.0, 1.0), CORNER_A, 0.0) == pytest.approx(
            4 / 3
        )
        assert (
            painleve_friction(uniform_block(1.0, 2.0, 1.0), CORNER_A, math.atan(0.5)) == math.inf
        )

    def motions(self, friction, count):
        rng = np.random.default_rng(41)
        for _ in range(count):
            block = uniform_block(1.0, rng.uniform(1.8, 2.2), 1.0)
            slip = rng.choice([-1.0, 1.0])
            yield corner_motion(
                block, CORNER_A, rng.uniform(0, 0.01), rng.uniform(-6, 6), slip,
                rng.uniform(-1, 1), 0.0, friction, g,
            )  # fmt: skip

    def test_every_state_has_one_motion_below_and_some_none_or_two_above(self):
        below = [found.solutions for found in self.motions(1.3333, 3000)]
        assert set(below) == {Solutions.ONE}
        above = list(self.motions(1.36, 3000))
        assert {found.solutions for found in above} == set(Solutions)
        for found in above:
            if found.solutions != Solutions.ONE:
                assert found.mechanism == LIFT_OFF
                assert math.isnan(found.centre)

    def test_mass_near_the_centre_brings_it_earlier(self):
        dense = RigidBlock(1.0, 0.02, 0.5, 0.5, 0.5)
        assert painleve_friction(dense, CORNER_A, 0.0) < 4 / 3
