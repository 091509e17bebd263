"""Ground motion: its exact impulse, where it is linear, and what of it a chain at rest bears."""

import numpy as np
import pytest

import archfrag as af
from archfrag.physics import ground
from archfrag.physics.state import Clock, model_of

DT = 0.02
SAMPLES = np.random.default_rng(2).normal(size=(3, 50))
# The second of two motions, and the first without a vertical component.
GROUNDS = ground.grounds_of(
    [(SAMPLES[0], None, 2.0 * DT), (SAMPLES[1], SAMPLES[2], DT)]
)
MODEL = model_of(af.Block(0.4, 1.0, friction=0.6).chain)._replace(gravity=10.0)


def clock_at(time, motion=0, factor=1.0):
    clock = np.zeros(len(Clock))
    clock[Clock.TIME] = time
    clock[Clock.MOTION] = motion
    clock[Clock.FACTOR] = factor
    return clock


def test_impulse_is_the_exact_integral_of_either_component():
    knots = np.arange(50) * DT
    rng = np.random.default_rng(3)
    for start, end in rng.uniform(-0.1, 1.1, (50, 2)):
        given = ground.impulse_between(GROUNDS, clock_at(0.0, 1, -1.5), start, end)
        grid = np.union1d(knots, [start, end])
        grid = grid[(grid >= min(start, end)) & (grid <= max(start, end))]
        inside = (grid[:-1] >= 0.0) & (grid[1:] <= knots[-1] + 1e-12)
        for found, samples in zip(given, SAMPLES[1:]):
            values = np.interp(grid, knots, samples, left=0.0, right=0.0)
            pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(grid)
            expected = -1.5 * pieces[inside].sum() * np.sign(end - start)
            assert found == pytest.approx(expected, abs=1e-13)
    alone = ground.impulse_between(GROUNDS, clock_at(0.0), 0.1, 0.5)
    assert abs(alone.x) > 1e-3
    assert alone.y == 0.0


def test_acceleration_is_linear_up_to_the_next_bend_of_either_component():
    x = np.array([0.0, 1.0, 2.0, 3.0, 1.0, -1.0, -1.0])
    knots = 0.5 * np.arange(7)
    y = np.array([0.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0])
    both = ground.grounds_of([(SAMPLES[0], None, 1.0), (x, y, 0.5)])
    alone = ground.one_of(both, 1, 2.0)
    assert list(both.next_break[50:]) == list(alone.next_break) == [2, 2, 3, 5, 5, 6, 6]
    for time in np.random.default_rng(2).uniform(0.0, 3.0, 200):
        now = ground.segment_at(time, alone)
        assert now.end >= time
        for later in np.linspace(time, now.end, 5):
            expected = [2.0 * np.interp(later, knots, wave) for wave in (x, y)]
            ahead = later - time
            found = [now.x + now.slope_x * ahead, now.y + now.slope_y * ahead]
            assert found == pytest.approx(expected)
    assert ground.segment_at(3.0, alone)[:5] == (np.inf, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("x", "y", "limits", "given", "expected"),
    [
        ([0, 1, 3, 0], None, (0.2, 0.2), {}, (0.75, False)),  # between two samples
        ([0, 1, 3, 0], None, (0.2, 0.2), {"factor": 4.0}, (0.25, False)),
        ([0, 1, 3, 0], None, (0.2, 0.05), {"factor": -1.0}, (0.25, False)),
        ([0, 1, 3, 0], None, (0.2, 0.2), {"time": 0.8}, (0.8, False)),
        ([0, 1, 3, 0], None, (0.35, 0.2), {}, (1.5, True)),
        (
            [1, 1, 1],
            None,
            (0.2, -0.05),
            {},
            (1.0, False),
        ),  # only the ground holds it up
        (
            [0, 2.5, 2.5],
            [0, 5, 5],
            (0.2, 0.2),
            {},
            (1.0, True),
        ),  # upward: a wider range
        ([0, 1.5, 1.5], [0, -5, -5], (0.2, 0.2), {}, (0.4, False)),
        # The ground falls faster than an arch of any range.
        ([9, 9, 9], [0, -20, -20], (np.inf, np.inf), {}, (0.25, False)),
    ],
)
def test_rest_ends_where_the_load_leaves_its_range(x, y, limits, given, expected):
    grounds = ground.grounds_of([(x, y, 0.5)])
    clock = clock_at(given.get("time", 0.0), 0, given.get("factor", 1.0))
    leave, for_good = ground.end_rest(MODEL, grounds, clock, *limits)
    assert for_good is expected[1]
    assert leave == pytest.approx(expected[0])
