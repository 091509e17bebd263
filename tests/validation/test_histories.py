"""Whole histories of blocks and a frame beside separate integrations of the rocking equation."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import archfrag as af
from archbench.exact import Rocking
from tests.validation.scenes import first_collapse, g, rocking

TOPIC = "Rocking histories"
FINE = {"method": "event_driven", "rtol": 1e-8}
RECORDS = Path(__file__).parents[2] / "records" / "near_source" / "synthetic"


def one_sine(frequency, amplitude, samples=400):
    """One period of a sine [g]."""
    sine = np.sin(np.linspace(0.0, 2.0 * math.pi, samples + 1)[:-1])
    step = 2.0 * math.pi / frequency / samples
    return af.Motion(amplitude * g * np.append(sine, 0.0), step)


def block(alpha, p):
    """A block of this slenderness and p, and its exact twin."""
    diagonal = 1.5 * g / p**2
    sides = diagonal * math.sin(alpha), diagonal * math.cos(alpha)
    return af.Block(*sides, friction=math.inf), Rocking(alpha, p)


def separate(twin, motion, ratio=None):
    """Times and rotations by another integration, until 20 s after the motion."""
    given = motion.acceleration, motion.dt, twin.alpha, twin.frequency**2, ratio or twin.ratio
    rotation = rocking(*given, 20.0)
    return motion.dt * np.arange(rotation.size), rotation


def test_random_pulses(validated):
    """500 one-sine pulses, from hardly any motion to what overturns without an impact."""
    generator, wrong, fell, error = np.random.default_rng(33), [], 0, []
    for case in range(500):
        alpha, p, ratio, level = generator.uniform([0.05, 1.0, 1.0, 0.1], [0.3, 5.0, 8.0, 1.1])
        amplitude = math.tan(alpha) * max(level * without_impact(ratio), 1.02)
        arch, twin = block(alpha, p)
        motion = one_sine(ratio * p, amplitude)
        run = af.simulate(arch, motion, **FINE)
        peak = np.abs(separate(twin, motion)[1]).max()
        fell += run.collapsed is True
        if (run.collapsed is True) != (peak > 0.5 * math.pi):
            wrong.append((case, alpha, p, ratio, amplitude))
        elif not run.collapsed:
            error.append(abs(run.peak_rotation - peak) / alpha)
    print(fell, "of 500 fell; peaks differ at most by", sorted(error)[-3:])
    assert 100 < fell < 400
    case, source = "500 one-sine pulses, α 0.05 to 0.3", "rocking equation"
    validated(case, f"verdicts that differ {wrong or ''}".strip(), len(wrong), 0, source)
    far = np.sum(np.array(error) > 1e-4)
    validated(case, "peak rotations that differ by more than α / 10,000", far, 0, source)


def without_impact(ratio):
    """Least A whose sine of W = omega/p overturns a slender block before any impact.

    y = x - 1 obeys y'' = y + A sin(W t) from y = -1, y' = 0 where A sin(W t) = 1, and the block
    falls if y + y' > 0 at the end: (y + y')' = y + y' + A sin(W t) has a closed solution.
    """

    def short(amplitude):
        start = math.asin(1.0 / amplitude)
        rest = amplitude * ratio * math.exp((start - 2.0 * math.pi) / ratio)
        return ratio * math.sqrt(amplitude**2 - 1.0) - rest - ratio**2

    return brentq(short, 1.0 + 1e-12, 100.0)


def overturns(amplitude, frequency, ratio):
    """Whether a sine overturns a slender block, by closed solutions between its impacts.

    After the sine y² - y'² stays, and the next impact is at the speed of its root below 1.
    """
    start, end, side = math.asin(1.0 / amplitude) / frequency, 2.0 * math.pi / frequency, 1.0
    y, rate = -1.0, 0.0

    def state(time):  # y and y' at a time after `start`
        wave = side * amplitude / (1.0 + frequency**2) * np.exp(1j * frequency * time)
        first = side * amplitude / (1.0 + frequency**2) * np.exp(1j * frequency * start)
        own, pace = y + first.imag, rate + frequency * first.real
        even, odd = np.cosh(time - start), np.sinh(time - start)
        return (own * even + pace * odd - wave.imag,
                own * odd + pace * even - frequency * wave.real)  # fmt: skip

    while True:
        time = np.linspace(start, end, 2000)
        below = np.flatnonzero(state(time)[0][2:] < -1.0)
        if not below.size:
            break
        first = below[0] + 2
        hit = brentq(lambda t: state(t)[0] + 1.0, time[first - 1], time[first])
        rate, start, y, side = -ratio * state(hit)[1], hit, -1.0, -side
    y, rate = state(end)
    return y + rate > 0.0 or ratio**2 * (rate**2 - y**2 + 1.0) > 1.0


@pytest.mark.parametrize("frequency", [1.5, 2, 3, 4, 5, 6, 7, 8])
def test_overturning_spectrum(validated, frequency):
    arch, twin = block(0.02, 2.0)
    motion = one_sine(2.0 * frequency, 0.02)
    directly = without_impact(frequency)
    sooner = first_collapse(
        lambda a: overturns(a, frequency, twin.ratio), 1.01, directly, 0.01, 1e-6
    )
    for name, expected, most in (("no impact", directly, 0), ("one impact", sooner, 1)):

        def falls(scale, most=most):
            run = af.simulate(arch, motion, scale=scale, **FINE)
            return run.collapsed and run.events["impacts"] == most

        found = first_collapse(falls, 0.98 * expected, 1.02 * expected, 0.004 * expected)
        validated(
            f"one sine, ω/p {frequency:g}, {name}, α 0.02", "least amplitude over α g", found,
            expected, "closed form for slender blocks", rel=5e-3,
        )  # fmt: skip


@pytest.mark.parametrize("period", [2, 2.5, 3, 4, 5, 6, 7, 8])
def test_rocking_spectrum(validated, period):
    motion = af.read_motion(RECORDS / "e1-r1.mseed")
    arch, twin = block(0.2, 2.0 * math.pi / period)
    peak = np.abs(separate(twin, motion)[1]).max() / 0.2
    found = af.simulate(arch, motion, **FINE).peak_rotation / 0.2
    validated(
        f"record e1-r1, 2π/p {period:g} s, α 0.2", "peak rotation over α", found, peak,
        "rocking equation", rel=1e-3,
    )  # fmt: skip


@pytest.mark.parametrize("height", [0.3, 2.0])
def test_frame(validated, height):
    """Two columns that carry a beam: a solitary column of another p and ratio.

    A beam of 2 gamma column masses stands on the upper corners, so it translates by 2 R theta'.
    Its and the columns' kinetic and potential energies give p² (1 + 2 gamma) / (1 + 3 gamma) in
    the place of p². An impact keeps the momentum along the motion that follows it: the sum of
    I + m R² cos(2 alpha) of each column and of 4 m R² cos(2 alpha) of the beam, over its value
    for alpha = 0 (as Makris and Vassiliou 2013).
    """
    alpha, half_diagonal = 0.2, 2.0
    b, h = half_diagonal * math.sin(alpha), half_diagonal * math.cos(alpha)
    left = np.array([[-b, 0], [b, 0], [b, 2 * h], [-b, 2 * h]])
    right = left + [3.0, 0.0]
    beam = np.array([[-b, 2 * h], [3 + b, 2 * h], [3 + b, 2 * h + height], [-b, 2 * h + height]])
    ground = [left[:2], right[:2]]
    frame = af.Arch.from_polygons([left, beam, right], friction=math.inf, ground=ground)
    gamma = height * (3 + 2 * b) / (8 * b * h)
    square = 0.75 * g / half_diagonal * (1 + 2 * gamma) / (1 + 3 * gamma)
    ratio = 1 - 1.5 * math.sin(alpha) ** 2 + 3 * gamma * math.cos(2 * alpha)
    motion = one_sine(4.0 * math.pi, 0.55)
    twin = Rocking(alpha, math.sqrt(square))
    time, expected = separate(twin, motion, ratio / (1 + 3 * gamma))
    run = af.simulate(frame, motion, history=True, **FINE)
    assert run.events["impacts"] >= 5
    found = -np.array(
        [np.interp(time, run.history.time, each) for each in run.history.rotation.T[[0, 2]]]
    )
    np.testing.assert_allclose(found, [expected, expected], rtol=0.0, atol=1e-4 * alpha)
    validated(
        f"frame of two columns, γ {gamma:.3g}", "peak rotation over α",
        np.abs(found).max() / alpha, np.abs(expected).max() / alpha,
        "rocking equation of the frame", rel=1e-3,
    )  # fmt: skip
