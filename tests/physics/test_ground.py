"""Ground motion: its exact impulse, where it is linear, and what of it a chain at rest bears."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

import archfrag as af
from archfrag.physics import ground
from archfrag.physics.state import Clock, model_of
from archfrag.physics.status import Energy
from archfrag.physics.steps.run import new_rigid_runs
from archfrag.physics.steps.step import record_base_work

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


def test_each_base_moves_by_its_own_acceleration():
    apart = np.random.default_rng(4).normal(size=(50, 3, 2))
    bases = ground.grounds_of([(SAMPLES[0], None, DT, apart)])
    model = MODEL._replace(mass=np.append(MODEL.mass, [0.0, 0.0]))
    runs = new_rigid_runs(model)._replace(grounds=bases)
    clock = runs.state.clock
    clock[Clock.FACTOR] = -1.5
    time = np.linspace(0.0, 49 * DT, 49 * 400 + 1)
    knots = DT * np.arange(50)
    waves = -1.5 * apart.reshape(50, 6).T
    fine = np.array([np.interp(time, knots, wave) for wave in waves])
    velocity = cumulative_trapezoid(fine, time, initial=0.0)
    path = cumulative_trapezoid(velocity, time, initial=0.0)
    for start, step in ((0.013, 0.02), (0.3, 0.004), (0.9, 0.07)):
        clock[Clock.TIME] = start
        clock[Clock.STEP] = step
        impulse = ground.move_ground(runs)
        assert impulse == ground.impulse_between(bases, clock, start, start + step)
        at = [start, start + 0.5 * step, start + step]
        first, middle, last = np.array([np.interp(at, time, each) for each in path]).T
        for found, expected in (
            (runs.work.position, middle),
            (runs.state.velocity, (middle - first) / (0.5 * step)),
            (runs.work.free, (last - middle) / (0.5 * step)),
        ):
            rows = found[2:, :2].ravel()
            assert rows == pytest.approx(expected, rel=1e-4, abs=1e-6)
            assert not found[:2].any()


def test_the_work_of_a_base_has_the_sign_of_its_side():
    """Two bodies stand on one base by the first joint and by the last."""
    arch = af.Arch.circular(5.0, 1.0, 120.0, voussoirs=2, friction=0.7)
    model = model_of(arch.chain)._replace(body=np.array([[3, 1], [1, 2], [2, 3]]))
    moves = ground.grounds_of([(SAMPLES[0], None, DT, np.ones((50, 1, 2)))])
    runs = new_rigid_runs(model)._replace(grounds=moves)
    runs.state.velocity[3, :2] = 1.0, 10.0
    runs.work.solved[3, :2] = 1.0, 30.0
    runs.work.reaction[:, :2] = [[5.0, 7.0], [9.0, 9.0], [2.0, 1.0]]
    record_base_work.py_func(runs, True)
    assert runs.state.energy[Energy.GROUND] == (5.0 - 2.0) * 1.0 + (7.0 - 1.0) * 20.0
