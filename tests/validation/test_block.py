"""The single block beside closed forms, the rocking equation and other solvers."""

import math

import numpy as np
import pytest

import archfrag as af
from archbench.exact import Rocking
from archbench.paper.block import (
    CORNER_A,
    ROCK,
    rocking_impact,
    starting_motion,
    uniform_block,
)
from archbench.paper.regions import painleve_friction
from tests.validation.scenes import falls, first_collapse, g, least, sampled, tilted

TOPIC = "Single block"
FINE = {"method": "event_driven", "rtol": 1e-7}


class TestClosedForms:
    @pytest.mark.parametrize("gamma", [0.5, 1.0, 2.0, 5.0])
    def test_friction_to_rock(self, validated, gamma):
        """Shenton's condition from rest, and that of an impact, by the contact problem."""
        block = uniform_block(1.0, gamma, 100.0)
        load = 1.5 / gamma
        found = least(
            lambda mu: starting_motion(block, load, 0.0, mu, g).mechanism == ROCK, 0, 5
        )
        expected = (load * (4 + gamma**2) + 3 * gamma) / (
            3 * load * gamma + 1 + 4 * gamma**2
        )
        case = f"h/b {gamma:g}, ground {load:g} g"
        validated(
            case,
            "least friction to rock from rest",
            found,
            expected,
            "Shenton 1996",
            rel=1e-8,
        )
        if gamma < 1.0:  # it does not rock on
            return
        found = least(
            lambda mu: rocking_impact(block, CORNER_A, -0.7, 0, mu)[0] == ROCK, 0, 5
        )
        case = f"h/b {gamma:g}"
        quantity = "least friction of an impact without sliding"
        expected = 3 * gamma / (1 + 4 * gamma**2)
        source = "closed form: 3γ/(1 + 4γ²)"
        validated(case, quantity, found, expected, source, rel=1e-8)

    def test_painleve(self, validated):
        smallest = min(
            painleve_friction(uniform_block(1.0, gamma, 1.0), CORNER_A, rotation)
            for gamma in np.geomspace(0.1, 10.0, 101)
            for rotation in np.linspace(-1.5, 1.5, 101)
        )
        validated(
            "uniform rectangle, any shape and rotation",
            "least friction of Painlevé's paradox",
            smallest,
            4 / 3,
            "rigid-body dynamics",
            rel=1e-3,
        )

    def test_slide_under_a_rectangular_pulse(self, validated):
        run = af.simulate(
            af.Block(4.0, 1.0, friction=0.3), sampled(lambda t: 0.8, 0.4), **FINE
        )
        expected = 0.5 * (0.8 - 0.3) * g * 0.4**2 * 0.8 / 0.3
        validated(
            "friction 0.3, 0.8 g for 0.4 s",
            "distance it slides",
            run.peak_displacement,
            expected,
            "Newmark 1965",
            rel=1e-3,
            unit="m",
        )


def free_rocking(half, alpha):
    """Histories of rotation and angular velocity from half the slenderness, times of impact."""
    width = 2 * half
    height = 2 * half / math.tan(alpha)
    run = af.simulate(
        af.Block(width, height, friction=5.0),
        af.Motion(np.zeros(50001), 1e-4),
        initial=tilted(width, height, 0.5 * alpha),
        history=True,
        follow=0.0,
        **FINE,
    )
    impacts = [change.time for change in run.mechanism if change.cause == "impact"]
    history = run.history
    return (
        history.time.values,
        history.rotation.values[:, 0],
        history.angular_velocity.values[:, 0],
        impacts,
    )


class TestFreeRocking:
    CASE = "half-width 0.5 m, slenderness 0.2 rad, from half of it"

    def test_motion(self, validated):
        time, rotation, _, impacts = free_rocking(0.5, 0.2)
        exact = Rocking(0.2, math.sqrt(0.75 * g / (0.5 / math.sin(0.2))))
        amplitudes = exact.amplitudes(0.1, 3)
        swings = [exact.quarter(0.1), *(2 * exact.quarter(each) for each in amplitudes)]
        source = "rocking equation, exact"
        small = "rocking equation of small angles"
        for k, reference in enumerate((0.42019, 0.35777, 0.30721)):
            name = f"time of impact {k + 1}"
            ended = sum(swings[: k + 1])
            validated(self.CASE, name, impacts[k], ended, source, rel=1e-5, unit="s")
            within = slice(*np.searchsorted(time, impacts[k : k + 2]))
            largest = np.abs(rotation[within]).max() / 0.2
            name = f"amplitude after impact {k + 1} over slenderness"
            validated(self.CASE, name, largest, amplitudes[k] / 0.2, source, rel=1e-4)
            validated(self.CASE, name, largest, reference, small, rel=1.5e-3)
        name = "period of the first swing"
        validated(self.CASE, name, 4 * impacts[0], 3.08096, small, rel=2e-3, unit="s")

    @pytest.mark.parametrize("width", [0.1, 0.2, 0.4])
    def test_velocity_ratio(self, validated, width):
        alpha = math.atan(width)
        time, _, speed, (impact, *_) = free_rocking(0.5 * width, alpha)
        before, after = np.searchsorted(time, [impact - 1e-9, impact + 1e-9]) - [1, 0]
        # The rates change by the rotational acceleration of some milliseconds in between.
        rate = 0.75 * g / math.hypot(0.5 * width, 0.5) * math.sin(alpha)
        first, second = (
            abs(speed[k]) + rate * abs(impact - time[k]) for k in (before, after)
        )
        validated(
            f"free rocking, b/h {width:g}",
            "velocity ratio of the first impact",
            second / first,
            1.0 - 1.5 * math.sin(alpha) ** 2,
            "Housner 1963",
            rel=1e-4,
        )


def one_sine(frequency, unit, samples=4000):
    """One period of a sine with an amplitude of `unit` [g]."""
    time = np.linspace(0.0, 2 * math.pi / frequency, samples + 1)
    return af.Motion(unit * g * np.append(np.sin(frequency * time[:-1]), 0.0), time[1])


class TestOverturning:
    QUANTITY = "least amplitude over α g"

    def test_one_sine_large_rotations(self, validated):
        alpha = 0.25
        p = 2.14
        sides = 1.5 * g / p**2 * np.array([math.sin(alpha), math.cos(alpha)])
        block = af.Block(*sides, friction=math.inf)
        sine = one_sine(5 * p, alpha)
        found = first_collapse(
            lambda a: falls(block, sine, scale=a, **FINE), 7.35, 7.6, 0.05
        )
        case = "one sine, ω/p 5, no impact, α 0.25"
        source = "rocking equation"
        validated(case, self.QUANTITY, found, 7.493, source, rel=1e-3)

    def test_other_solvers(self, validated):
        block = af.Block(0.2, 1.0, friction=0.8)
        sine = one_sine(4 * math.pi, 1.0)
        found = first_collapse(lambda a: falls(block, sine, scale=a), 0.27, 0.31, 0.005)
        for reference, source, allowed in (
            (0.2937, "rocking equation", 7e-4),
            (0.294, "LMGC90, MuJoCo, pymunk, Siconos at 0.5 ms", 1e-3),
        ):
            validated(
                "half-width 0.1 m, half-height 0.5 m, sine of 0.5 s",
                "least amplitude that overturns",
                found,
                reference,
                source,
                abs=allowed,
                unit="g",
            )
