"""Ground motion between its samples: exact impulses, and where it leaves the rest range."""

import numpy as np
import pytest

from archfrag.mechanics.ground import (
    acceleration_at,
    cumulative_impulse,
    end_of_rest,
    impulse_between,
)
from archfrag.mechanics.types import GroundMotion

RNG = np.random.default_rng(2)
SAMPLES = RNG.normal(size=50)
DT = 0.02


class TestPiecewiseLinear:
    def test_impulse_is_the_exact_integral(self):
        cumulative = cumulative_impulse(SAMPLES, DT)
        knots = np.arange(SAMPLES.size) * DT
        for start, end in RNG.uniform(-0.1, 1.1, (50, 2)):
            grid = np.union1d(knots, [start, end])
            grid = grid[(grid >= min(start, end)) & (grid <= max(start, end))]
            values = np.interp(grid, knots, SAMPLES, left=0.0, right=0.0)
            inside = (grid[:-1] >= 0.0) & (grid[1:] <= knots[-1] + 1e-12)
            pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(grid)
            expected = pieces[inside].sum() * np.sign(end - start)
            found = impulse_between(start, end, SAMPLES, cumulative, DT)
            assert found == pytest.approx(expected, abs=1e-13)

    def test_acceleration_is_zero_outside_the_record(self):
        assert acceleration_at(-1e-9, SAMPLES, DT) == 0.0
        assert acceleration_at(49.001 * DT, SAMPLES, DT) == 0.0
        assert acceleration_at(3.5 * DT, SAMPLES, DT) == pytest.approx(SAMPLES[3:5].mean())


class TestRestRange:
    def test_leaves_where_the_line_between_samples_crosses_the_limit(self):
        ground = GroundMotion(np.array([0.0, 1.0, 3.0, 0.0]), np.zeros(4), 0.5)
        assert end_of_rest(0.0, ground, 10.0, 0.2, 0.2) == pytest.approx(0.75)
        assert end_of_rest(0.0, ground, 10.0, 0.35, 0.2) == np.inf

    def test_upward_acceleration_widens_the_range(self):
        up = GroundMotion(np.array([0.0, 2.5, 2.5]), np.array([0.0, 5.0, 5.0]), 0.5)
        assert end_of_rest(0.0, up, 10.0, 0.2, 0.2) == np.inf
        down = GroundMotion(np.array([0.0, 1.5, 1.5]), np.array([0.0, -5.0, -5.0]), 0.5)
        assert end_of_rest(0.0, down, 10.0, 0.2, 0.2) < 0.5
