"""Validation of the single block by published and computed values, and Painleve's paradox.

The rocking equation is integrated here, by scipy, from the block's kernels.
"""

import math

import numpy as np

from archfrag.arch import STANDARD_GRAVITY as g
from archfrag.mechanics.block.formulas import CORNER_A, uniform_block
from archfrag.mechanics.block.motion import (
    LIFT_OFF,
    REST,
    Solutions,
    corner_motion,
    rocking_impact,
)
from archfrag.mechanics.block.regions import (
    impact_ratio,
)

EXACT = {"rtol": 1e-11, "atol": 1e-13, "method": "DOP853"}


class TestHousner:
    def test_a_squat_block_stays_flat(self):
        squat = uniform_block(1.5, 1.0, 100.0)
        assert impact_ratio(squat, CORNER_A) < 0.0
        assert rocking_impact(squat, CORNER_A, -0.7, 0.0, math.inf).mechanism == REST
        least = squat.rise / squat.reach_a
        assert rocking_impact(squat, CORNER_A, -0.7, 0.0, 1.01 * least).mechanism == REST
        assert rocking_impact(squat, CORNER_A, -0.7, 0.0, 0.99 * least).slip > 0.0


class TestPainleve:
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
