"""Validation of the single block by published and computed values, and Painleve's paradox.

The rocking equation is integrated here, by scipy, from the block's kernels.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

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
    impact_sticking_friction,
    painleve_friction,
    rocking_acceleration,
    rocking_friction,
    slender_rocking_acceleration,
    starting_region,
)

EXACT = {"rtol": 1e-11, "atol": 1e-13, "method": "DOP853"}


def slender(alpha, radius):
    """Uniform rectangle by the angle and length of its half diagonal."""
    return uniform_block(2 * radius * math.sin(alpha), 2 * radius * math.cos(alpha), 100.0)


def side_of(rotation):
    return CORNER_A if rotation > 0.0 else CORNER_B


def half_cycles(acceleration, rotation, rate, time, ratio, limit, count, end):
    """Rocking from a state, each piece until the block stands flat, tips over or time is up.

    `acceleration` takes time, rotation and corner. Yields (impacts so far, piece).
    """
    side = side_of(rotation if rotation else rate)
    for impacts in range(count + 1):

        def flat(_, state):
            return state[0]

        def over(_, state):
            return abs(state[0]) - limit

        flat.terminal, over.terminal = True, True
        flat.direction = side
        piece = solve_ivp(
            lambda t, s, side=side: (s[1], acceleration(t, s[0], side)),
            (time, end), (rotation, rate), events=(flat, over), dense_output=True, **EXACT,
        )  # fmt: skip
        yield impacts, piece
        if piece.t_events[1].size or not piece.t_events[0].size:
            return
        time, rotation = piece.t[-1], 0.0
        rate, side = piece.y[1, -1] * ratio, -side


def overturning(block, load, frequency, ratio, equation, limit, most):
    """Impacts before a block overturns under one sine of ground acceleration; None if it stands.

    Parameters
    ----------
    load : float
        Amplitude over g.
    frequency : float
        Circular [rad/s].
    equation : callable
        Angular acceleration by corner, rotation and ground acceleration over g.
    limit : float
        Rotation from which it does not return after the end of the sine [rad].
    most : int
        Impacts after which the block is taken to stand.
    """
    side = CORNER_A
    balance = -equation(side, 0.0, 0.0) / (equation(side, 0.0, 1.0) - equation(side, 0.0, 0.0))
    if load <= balance:
        return None
    start, end = math.asin(balance / load) / frequency, 2 * math.pi / frequency

    def acceleration(time, rotation, side):
        return equation(side, rotation, load * math.sin(frequency * time) if time < end else 0.0)

    rotation, rate, time, before = 1e-12, 0.0, start, 0
    for until in (end, end + 60.0):
        for impacts, piece in half_cycles(
            acceleration, rotation, rate, time, ratio, limit, most - before, until
        ):
            if piece.t_events[1].size:
                return before + impacts
            rotation, rate, time = piece.y[0, -1], piece.y[1, -1], piece.t[-1]
            if piece.t_events[0].size:
                rate, rotation = ratio * rate, 0.0
        before += impacts
        if before >= most:
            return None
    return None


def threshold(verdict, low, high, wanted):
    """Where `verdict` begins (or ends) to give `wanted` between two amplitudes."""
    at_low = verdict(low) == wanted
    assert (verdict(high) == wanted) != at_low
    while high - low > 2e-4:
        middle = 0.5 * (low + high)
        if (verdict(middle) == wanted) == at_low:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


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

    @pytest.mark.parametrize("gamma", [0.5, 1.0, 2.0, 5.0])
    def test_shentons_condition(self, gamma):
        block = uniform_block(1.0, gamma, 100.0)
        for load in np.linspace(1.01 / gamma, 3.0 / gamma, 20):
            least = (load * (4 + gamma**2) + 3 * gamma) / (3 * load * gamma + 1 + 4 * gamma**2)
            assert rocking_friction(block, CORNER_A, load) == pytest.approx(least, rel=1e-12)
            for friction, mechanism in ((0.999999, SLIDE_ROCK), (1.000001, ROCK)):
                start = starting_motion(block, load, 0.0, friction * least, g)
                assert start.mechanism == (mechanism if friction * least > 1 / gamma else SLIDE)
                region = starting_region(block, load, 0.0, friction * least)
                assert region == (start.mechanism, start.side)


class TestHousner:
    @pytest.mark.parametrize("alpha", [0.05, 0.2, 0.4, 0.6])
    def test_velocity_ratio(self, alpha):
        block = slender(alpha, 2.0)
        ratio = 1.0 - 1.5 * math.sin(alpha) ** 2
        assert impact_ratio(block, CORNER_A) == pytest.approx(ratio, rel=1e-12)
        for side in (CORNER_A, CORNER_B):
            after = rocking_impact(block, side, side * 0.7, 0.0, math.inf)
            assert (after.mechanism, after.side) == (ROCK, -side)
            assert after.rotation == pytest.approx(side * 0.7 * ratio, rel=1e-12)

    def test_a_squat_block_stays_flat(self):
        squat = uniform_block(1.5, 1.0, 100.0)
        assert impact_ratio(squat, CORNER_A) < 0.0
        assert rocking_impact(squat, CORNER_A, -0.7, 0.0, math.inf).mechanism == REST
        least = impact_sticking_friction(squat, CORNER_A)
        assert rocking_impact(squat, CORNER_A, -0.7, 0.0, 1.01 * least).mechanism == REST
        assert rocking_impact(squat, CORNER_A, -0.7, 0.0, 0.99 * least).slip > 0.0

    @pytest.mark.parametrize("gamma", [0.8, 1.0, 2.0, 5.0])
    def test_below_a_friction_the_impact_slides(self, gamma):
        block = uniform_block(1.0, gamma, 100.0)
        least = 3 * gamma / (1 + 4 * gamma**2)
        assert impact_sticking_friction(block, CORNER_A) == pytest.approx(least, rel=1e-12)
        assert rocking_friction(block, CORNER_A, 0.0) == pytest.approx(least, rel=1e-12)
        for friction in (1.000001 * least, 0.999999 * least, 0.5 * least):
            after = rocking_impact(block, CORNER_A, -0.7, 0.0, friction)
            assert (after.mechanism == ROCK) == (friction > least)
            assert after.mechanism in (ROCK, SLIDE_ROCK, SLIDE)
            assert abs(after.tangential) <= friction * after.normal * (1 + 1e-12)
            assert (after.slip > 0.0) == (friction < least)
            if friction < least:
                assert after.tangential == pytest.approx(-friction * after.normal)

    def test_free_rocking(self):
        alpha, gravity = 0.2, 9.81
        block = slender(alpha, 0.5 / math.sin(alpha))
        ratio = impact_ratio(block, CORNER_A)

        def acceleration(_, rotation, side):
            return slender_rocking_acceleration(block, side, rotation, 0.0, gravity)

        quarters, amplitudes = [], []
        for _, piece in half_cycles(acceleration, 0.5 * alpha, 0.0, 0.0, ratio, 9.0, 3, 99.0):
            quarters.append(piece.t[-1] - piece.t[0])
            time = np.linspace(piece.t[0], piece.t[-1], 20001)
            amplitudes.append(np.abs(piece.sol(time)[0]).max() / alpha)
        assert 4 * quarters[0] == pytest.approx(3.08096, abs=1e-5)
        assert amplitudes[1:] == pytest.approx([0.42019, 0.35777, 0.30721], abs=1e-4)
        p = math.sqrt(3 * gravity * math.sin(alpha) / (4 * 0.5))
        assert 4 * quarters[0] == pytest.approx(4 / p * math.acosh(2.0), rel=1e-9)


class TestOverturning:
    def test_one_sine_small_angle_without_impact(self):
        alpha = 0.1
        block = slender(alpha, 1.0)
        p = math.sqrt(0.75 * g)

        def equation(side, rotation, load):
            return slender_rocking_acceleration(block, side, rotation, load, g)

        def verdict(amplitude):
            return overturning(block, amplitude * alpha, 5 * p, 0.0, equation, 40 * alpha, 1)

        assert threshold(verdict, 6.9, 7.4, 0) == pytest.approx(7.168, rel=1e-3)

    @pytest.mark.parametrize(("impacts", "low", "high"), [(1, 2.7, 3.4), (0, 7.3, 7.7)])
    def test_of_the_arch_code_with_housners_ratio(self, impacts, low, high):
        alpha, p = 0.25, 2.14
        block = slender(alpha, 0.75 * g / p**2)
        ratio, frequency = impact_ratio(block, CORNER_A), 5 * p

        def equation(side, rotation, load):
            return rocking_acceleration(block, side, rotation, load, 0.0, g)

        def verdict(amplitude):
            return overturning(
                block, amplitude * alpha, frequency, ratio, equation, math.pi / 2, 3
            )

        limit = threshold(verdict, low, high, impacts)
        body = af.Block(2 * block.reach_a, 2 * block.rise, friction=math.inf)
        time = np.arange(0.0, 2 * math.pi / frequency + 1e-3, 2e-4)
        sine = np.where(time < 2 * math.pi / frequency, np.sin(frequency * time), 0.0)
        motion = af.Motion(alpha * g * sine, 2e-4)
        for factor in (0.995, 1.005):
            run = af.simulate(body, motion, scale=factor * limit, method="time_stepping", dt=2e-4)
            assert run.collapsed == (factor > 1.0)


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
