"""The single block beside closed forms, the rocking equation and other solvers."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import archfrag as af
from archbench.paper.block import (
    CORNER_A,
    ROCK,
    active_force,
    rocking_acceleration,
    rocking_impact,
    starting_motion,
    uniform_block,
)
from archbench.paper.regions import painleve_friction
from tests.validation.scenes import falls, first_collapse, g, tilted

TOPIC = "Single block"
EXACT = {"rtol": 1e-11, "atol": 1e-13}
FINE = {"method": "event_driven", "rtol": 1e-7}


def least_friction(stays, low=0.0, high=5.0):
    """Least friction from which `stays` holds."""
    while high - low > 1e-10:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stays(middle) else (middle, high)
    return high


def free_rocking(half, alpha, tilt):
    """Histories of rotation and angular velocity, and the instants of impact."""
    width, height = 2 * half, 2 * half / math.tan(alpha)
    block, state = af.Block(width, height, friction=5.0), tilted(width, height, tilt)
    still = af.Motion(np.zeros(50001), 1e-4)
    run = af.simulate(block, still, initial=state, history=True, follow=0.0, **FINE)
    impacts = [change.time for change in run.mechanism if change.cause == "impact"]
    return run.history, impacts


def exact_rocking(half, alpha, tilt, swings):
    """Times of impact and amplitudes after them, by the rocking equation and Housner's ratio."""
    rate = 0.75 * g / (half / math.sin(alpha))

    def rocking(_, state):
        return [state[1], -rate * math.sin(alpha - state[0])]

    def lands(_, state):
        return state[0]

    def tops(_, state):
        return state[1]

    lands.terminal = tops.terminal = True
    lands.direction = tops.direction = -1.0
    ratio = 1.0 - 1.5 * math.sin(alpha) ** 2
    times, amplitudes, now = [], [], 0.0
    for _ in range(swings):
        fall = solve_ivp(rocking, (0.0, 20.0), [tilt, 0.0], events=lands, **EXACT)
        times.append(now + fall.t[-1])
        speed = -ratio * fall.y[1, -1]
        rise = solve_ivp(rocking, (0.0, 20.0), [0.0, speed], events=tops, **EXACT)
        now = times[-1] + rise.t[-1]
        tilt = rise.y[0, -1]
        amplitudes.append(tilt)
    return times, amplitudes


class TestClosedForms:
    @pytest.mark.parametrize("gamma", [0.5, 1.0, 2.0, 5.0])
    def test_rocking_needs_friction(self, validated, gamma):
        """Shenton's condition, found again by the contact problem."""
        block, load = uniform_block(1.0, gamma, 100.0), 1.5 / gamma
        found = least_friction(
            lambda mu: starting_motion(block, load, 0.0, mu, g).mechanism == ROCK
        )
        expected = (load * (4 + gamma**2) + 3 * gamma) / (3 * load * gamma + 1 + 4 * gamma**2)
        validated(
            f"h/b {gamma:g}, ground {load:g} g", "least friction to rock from rest", found,
            expected, "Shenton 1996", rel=1e-8,
        )  # fmt: skip

    @pytest.mark.parametrize("alpha", [0.05, 0.2, 0.4, 0.6])
    def test_impact(self, validated, alpha):
        block = uniform_block(math.tan(alpha), 1.0, 100.0)
        after = rocking_impact(block, CORNER_A, CORNER_A * 0.7, 0.0, math.inf)
        validated(
            f"slenderness {alpha:g} rad", "velocity ratio of an impact",
            after.rotation / (CORNER_A * 0.7), 1.0 - 1.5 * math.sin(alpha) ** 2,
            "Housner 1963", rel=1e-9,
        )  # fmt: skip

    @pytest.mark.parametrize("gamma", [1.0, 2.0, 5.0])
    def test_impact_needs_friction(self, validated, gamma):
        block = uniform_block(1.0, gamma, 100.0)
        found = least_friction(
            lambda mu: rocking_impact(block, CORNER_A, -0.7, 0.0, mu).mechanism == ROCK
        )
        validated(
            f"h/b {gamma:g}", "least friction of an impact without sliding", found,
            3 * gamma / (1 + 4 * gamma**2), "closed form: 3γ/(1 + 4γ²)", rel=1e-8,
        )  # fmt: skip

    def test_painleve(self, validated):
        least = min(
            painleve_friction(uniform_block(1.0, gamma, 1.0), CORNER_A, rotation)
            for gamma in np.geomspace(0.1, 10.0, 101)
            for rotation in np.linspace(-1.5, 1.5, 101)
        )
        validated(
            "uniform rectangle, any shape and rotation", "least friction of Painlevé's paradox",
            least, 4 / 3, "rigid-body dynamics", rel=1e-3,
        )  # fmt: skip

    def test_slide_under_a_rectangular_pulse(self, validated):
        friction, amplitude, duration = 0.3, 0.8, 0.4
        time = np.arange(0.0, duration + 0.01, 1e-4)
        push = af.Motion(np.where(time < duration - 1e-9, amplitude * g, 0.0), 1e-4)
        run = af.simulate(af.Block(4.0, 1.0, friction=friction), push, **FINE)
        excess = (amplitude - friction) * g
        expected = 0.5 * excess * duration**2 * (1.0 + excess / (friction * g))
        validated(
            "friction 0.3, 0.8 g for 0.4 s", "distance it slides", run.peak_displacement, expected,
            "Newmark 1965", rel=1e-3, unit="m",
        )  # fmt: skip


class TestFreeRocking:
    CASE = "half-width 0.5 m, slenderness 0.2 rad, from half of it"

    def test_motion(self, validated):
        history, impacts = free_rocking(0.5, 0.2, 0.1)
        times, amplitudes = exact_rocking(0.5, 0.2, 0.1, 3)
        exact = "rocking equation, scipy DOP853"
        small = "rocking equation of small angles"
        rotation = np.abs(history.rotation.values[:, 0])
        for number in range(3):
            validated(
                self.CASE, f"time of impact {number + 1}", impacts[number], times[number],
                exact, rel=1e-5, unit="s",
            )  # fmt: skip
            within = slice(*np.searchsorted(history.time.values, impacts[number : number + 2]))
            largest = rotation[within].max() / 0.2
            name = f"amplitude after impact {number + 1} over slenderness"
            validated(self.CASE, name, largest, amplitudes[number] / 0.2, exact, rel=1e-4)
            reference = (0.42019, 0.35777, 0.30721)[number]
            validated(self.CASE, name, largest, reference, small, rel=1.5e-3)
        validated(
            self.CASE, "period of the first swing", 4 * impacts[0], 3.08096, small, rel=2e-3,
            unit="s",
        )  # fmt: skip

    @pytest.mark.parametrize("width", [0.1, 0.2, 0.4])
    def test_velocity_ratio_in_a_run(self, validated, width):
        alpha = math.atan(width)
        history, impacts = free_rocking(0.5 * width, alpha, 0.5 * alpha)
        after = np.searchsorted(history.time.values, impacts[0] + 1e-9)
        speed, time = history.angular_velocity.values[:, 0], history.time.values
        before = np.searchsorted(time, impacts[0] - 1e-9) - 1
        # The rates change by the rotational acceleration of some milliseconds in between.
        rate = 0.75 * g / math.hypot(0.5 * width, 0.5) * math.sin(alpha)
        first = abs(speed[before]) + rate * (impacts[0] - time[before])
        second = abs(speed[after]) + rate * (time[after] - impacts[0])
        validated(
            f"free rocking, b/h {width:g}", "velocity ratio of the first impact", second / first,
            1.0 - 1.5 * math.sin(alpha) ** 2, "Housner 1963", rel=1e-4,
        )  # fmt: skip


def one_sine(frequency, unit):
    """One period of a sine with an amplitude of `unit` [g]."""
    time = np.linspace(0.0, 2 * math.pi / frequency, 4001)
    return af.Motion(unit * g * np.append(np.sin(frequency * time[:-1]), 0.0), time[1])


def impacts_before_overturning(block, load, frequency, ratio):
    """How often a block impacts under one sine of `load` [g] before it tips; None if it stands."""
    end = 2 * math.pi / frequency

    def rates(time, state, side):
        ground = load * math.sin(frequency * time) if time < end else 0.0
        return state[1], rocking_acceleration(
            block, side, state[0], active_force(block, ground, 0.0, g)
        )

    def flat(_, state, side):
        return state[0]

    def over(_, state, side):
        return abs(state[0]) - 0.5 * math.pi

    flat.terminal = over.terminal = True
    # It starts to rock where the sine reaches its slenderness.
    time = math.asin(block.reach_a / block.rise / load) / frequency
    side, impacts, state = CORNER_A, 0, (1e-12 * -CORNER_A, 0.0)
    while time < 60.0 and impacts < 3:
        flat.direction = side
        until = end if time < end else time + 60.0
        found = solve_ivp(rates, (time, until), state, args=(side,), events=(flat, over), **EXACT)
        time, state = found.t[-1], found.y[:, -1]
        if found.t_events[1].size:
            return impacts
        if found.t_events[0].size:
            impacts, side = impacts + 1, -side
            state = (1e-12 * -side, ratio * state[1])
    return None


class TestOverturning:
    def test_one_sine_small_angle(self, validated):
        """Without impact it falls to the other side than after one."""
        alpha = 0.02
        block = af.Block(2 * math.sin(alpha), 2 * math.cos(alpha), friction=math.inf)
        sine = one_sine(5 * math.sqrt(0.75 * g), alpha)

        def side(scale):
            run = af.simulate(block, sine, scale=scale, history=True, **FINE)
            return math.copysign(1.0, run.history.rotation.values[-1, 0])

        without = side(7.5)
        found = first_collapse(lambda scale: side(scale) == without, 6.9, 7.5, 0.1)
        validated(
            "one sine, ω/p 5, no impact, small angle", "least amplitude over α g", found, 7.168,
            "Zhang and Makris 2001; rocking equation", rel=3e-3,
        )  # fmt: skip

    @pytest.mark.parametrize(("low", "high", "expected"), [(2.9, 3.2, 3.033), (6.6, 6.9, 6.739)])
    def test_one_impact(self, validated, low, high, expected):
        """Ends of the range of amplitudes that overturn after one impact, by our accelerations."""
        alpha, p = 0.25, 2.14
        radius = 0.75 * g / p**2
        block = uniform_block(2 * radius * math.sin(alpha), 2 * radius * math.cos(alpha), 1.0)

        def after_one_impact(amplitude):
            return impacts_before_overturning(block, amplitude * alpha, 5 * p, 0.9) == 1

        begins = after_one_impact(high)
        assert after_one_impact(low) != begins
        while high - low > 2e-4:
            middle = 0.5 * (low + high)
            if after_one_impact(middle) == begins:
                high = middle
            else:
                low = middle
        validated(
            "one sine, ω/p 5, one impact of ratio 0.9, α 0.25",
            f"{'least' if begins else 'largest'} amplitude over α g", high, expected,
            "rocking equation", rel=1e-3,
        )  # fmt: skip

    def test_one_sine_large_rotations(self, validated):
        alpha, p = 0.25, 2.14
        radius = 0.75 * g / p**2
        block = af.Block(
            2 * radius * math.sin(alpha), 2 * radius * math.cos(alpha), friction=math.inf
        )
        sine = one_sine(5 * p, alpha)
        found = first_collapse(lambda a: falls(block, sine, scale=a, **FINE), 7.35, 7.6, 0.05)
        validated(
            "one sine, ω/p 5, no impact, α 0.25", "least amplitude over α g", found, 7.493,
            "rocking equation", rel=1e-3,
        )  # fmt: skip

    def test_other_solvers(self, validated):
        block = af.Block(0.2, 1.0, friction=0.8)
        sine = one_sine(4 * math.pi, 1.0)
        found = first_collapse(lambda a: falls(block, sine, scale=a), 0.27, 0.31, 0.005)
        case = "half-width 0.1 m, half-height 0.5 m, sine of 0.5 s"
        validated(
            case, "least amplitude that overturns", found, 0.2937, "rocking equation", abs=7e-4,
            unit="g",
        )  # fmt: skip
        validated(
            case, "least amplitude that overturns", found, 0.294,
            "LMGC90, MuJoCo, pymunk, Siconos at 0.5 ms", abs=1e-3, unit="g",
        )  # fmt: skip
