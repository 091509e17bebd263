"""Ground motions as time stepping takes them: impulses over steps, and the end of rest."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.model import N_CLOCK, Clock, model_of
from archfrag.methods.time_stepping.motion import end_rest, grounds_of, kick_between

RNG = np.random.default_rng(2)
DT = 0.02
SAMPLES = RNG.normal(size=(3, 50))
# The second of two motions, and the first without a vertical component.
GROUNDS = grounds_of([(SAMPLES[0], None, 2.0 * DT), (SAMPLES[1], SAMPLES[2], DT)])
MODEL = model_of(af.Block(0.4, 1.0, friction=0.6).chain)._replace(gravity=10.0)


def clock_at(time, motion=0, factor=1.0):
    clock = np.zeros(N_CLOCK)
    clock[Clock.TIME], clock[Clock.MOTION], clock[Clock.FACTOR] = time, motion, factor
    return clock


class TestPiecewiseLinear:
    def test_kick_is_the_exact_integral(self):
        knots = np.arange(50) * DT
        for start, end in RNG.uniform(-0.1, 1.1, (50, 2)):
            kick = kick_between(GROUNDS, clock_at(0.0, 1, -1.5), start, end)
            grid = np.union1d(knots, [start, end])
            grid = grid[(grid >= min(start, end)) & (grid <= max(start, end))]
            inside = (grid[:-1] >= 0.0) & (grid[1:] <= knots[-1] + 1e-12)
            for found, samples in zip(kick, SAMPLES[1:]):
                values = np.interp(grid, knots, samples, left=0.0, right=0.0)
                pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(grid)
                expected = -1.5 * pieces[inside].sum() * np.sign(end - start)
                assert found == pytest.approx(expected, abs=1e-13)

    def test_no_vertical_component_gives_no_vertical_kick(self):
        kick = kick_between(GROUNDS, clock_at(0.0), 0.1, 0.5)
        assert abs(kick.x) > 1e-3
        assert kick.y == 0.0


class TestRestRange:
    def leaves(self, across, upward, plus, minus, time=0.0, factor=1.0):
        grounds = grounds_of([(across, upward, 0.5)])
        return end_rest(MODEL, grounds, clock_at(time, 0, factor), plus, minus)

    def test_leaves_where_the_line_between_samples_crosses_the_limit(self):
        wave = [0.0, 1.0, 3.0, 0.0]
        assert self.leaves(wave, None, 0.2, 0.2) == (pytest.approx(0.75), False)
        assert self.leaves(wave, None, 0.2, 0.2, factor=4.0) == (pytest.approx(0.25), False)
        assert self.leaves(wave, None, 0.2, 0.05, factor=-1.0) == (pytest.approx(0.25), False)
        assert self.leaves(wave, None, 0.2, 0.2, time=0.8) == (0.8, False)
        assert self.leaves(wave, None, 0.35, 0.2) == (1.5, True)

    def test_what_only_the_ground_held_up_leaves_when_the_record_ends(self):
        assert self.leaves([1.0, 1.0, 1.0], None, 0.2, -0.05) == (1.0, False)

    def test_upward_acceleration_widens_the_range(self):
        assert self.leaves([0.0, 2.5, 2.5], [0.0, 5.0, 5.0], 0.2, 0.2) == (1.0, True)
        leave, for_good = self.leaves([0.0, 1.5, 1.5], [0.0, -5.0, -5.0], 0.2, 0.2)
        assert leave < 0.5
        assert not for_good
