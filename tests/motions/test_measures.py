"""Intensity measures against closed forms and independent integrators."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from archfrag.motions.measures import (
    measure,
    parse_measure,
    scale_factor,
    spectral_acceleration,
)
from archfrag.motions.motion import Motion

from .helpers import refused, wave

G = 9.80665
WAVE = Motion(wave(), 0.01)
STILL = Motion(np.zeros(10), 0.01, id="still")


def sine(frequency=2.0, amplitude=3.0, duration=5.0, dt=0.001):
    time = np.arange(round(duration / dt) + 1) * dt
    return Motion(amplitude * np.sin(2.0 * np.pi * frequency * time), dt, id="sine")


SINE = sine()


def noise(count=2000, seed=1):
    ramp = np.sin(np.pi * np.arange(count) / (count - 1))
    return np.random.default_rng(seed).standard_normal(count) * ramp


def sa_integral(low, high, power):
    """Integral of Sa (T / 2 pi)^power over periods."""
    grid = np.linspace(low, high, 1601)
    spectrum = spectral_acceleration(WAVE, grid) * (grid / (2.0 * np.pi)) ** power
    return np.trapezoid(spectrum, grid)


CLOSED = [
    (Motion([-1.0, 3.0], 2.0), "CAV", 0.25 + 2.25, 1e-14),  # a ramp through zero
    (Motion(np.full(301, 0.0249 * G), 0.01), "CAVstd", 0.0, 0.0),
    # The window from 0 to 1 s ends with the first loud sample, and so counts.
    (Motion(np.repeat([0.02 * G, 0.03 * G], [100, 101]), 0.01), "CAVstd", 0.05005 * G, 1e-9),
    (Motion(np.repeat([0.02 * G, 0.03 * G], [200, 101]), 0.01), "CAVstd", 0.05005 * G, 1e-9),
    (WAVE, "HI", sa_integral(0.1, 2.5, 1), 2e-3),
    (WAVE, "AvgSA(0.2,1.0)",
     spectral_acceleration(WAVE, np.geomspace(0.2, 1.0, 10)).prod() ** 0.1, 1e-12),
    (Motion(0.6 * noise(), 0.01, transverse=0.8 * noise()), "RotD100(PGA)",
     np.abs(noise()).max(), 1e-4),
]  # fmt: skip


@pytest.mark.parametrize(("motion", "name", "expected", "within"), CLOSED)
def test_closed_forms_that_the_validation_does_not_have(motion, name, expected, within):
    assert measure(motion, name) == pytest.approx(expected, rel=within, abs=1e-14)


def largest_response(record, dt, period):
    """Sa from scipy's first-order hold of the oscillator, at 500 points of a period or more."""
    w, finer = 2.0 * np.pi / period, int(np.ceil(500 * dt / period)) + 3
    count = record.size + 1 + int(np.ceil(period / dt))
    fine = np.interp(np.arange(count * finer) / finer, np.arange(record.size + 1), [*record, 0.0])
    oscillator = [-w * w], [1.0, 0.1 * w, w * w]
    numerator, denominator, _ = cont2discrete(oscillator, dt / finer, method="foh")
    return np.abs(lfilter(numerator.ravel(), denominator, fine)).max()


@pytest.mark.parametrize("count", [160, 163, 171, 32768])
def test_spectrum_of_a_record_that_ends_in_motion(count):
    record = np.random.default_rng(count).standard_normal(count)
    record[0] = 0.0
    periods = np.geomspace(0.02, 10.0, 24 if count < 1000 else 4)
    found, extended = (spectral_acceleration(Motion(samples, 0.01), periods)
                       for samples in (record, np.append(record, np.zeros(40))))  # fmt: skip
    expected = [largest_response(record, 0.01, period) for period in periods]
    assert found == pytest.approx(expected, rel=1e-3)
    assert found == pytest.approx(extended, rel=1e-9)


@pytest.mark.parametrize("period", [0.05, 0.4, 2.0])
def test_rotated_spectrum_is_that_of_each_direction(period):
    one, other = noise(seed=1), noise(seed=2)
    motion = Motion(one, 0.01, transverse=other)
    each = [spectral_acceleration(Motion(np.cos(a) * one + np.sin(a) * other, 0.01), period)[0]
            for a in np.deg2rad(np.arange(180))]  # fmt: skip
    assert measure(motion, f"RotD50(Sa({period}))") == pytest.approx(np.median(each), rel=1e-8)
    assert measure(motion, f"RotD100(Sa({period}))") == pytest.approx(np.max(each), rel=1e-8)


def test_either_spelling():
    for one, other in (("AvgSA(0.2,1.0)", "SaAvg(0.2, 1.0)"), ("Sa(0.3)", "SA(0.3)")):
        assert measure(WAVE, one) == measure(WAVE, other) > 0.0


POWERS = {"PGA": 1, "PGV": 1, "Arias": 2, "Sa(0.3)": 1, "AvgSA(0.2,1.0)": 1, "D5_95": 0}


@pytest.mark.parametrize("name", [name for name, power in POWERS.items() if power])
def test_scaled_motion_has_the_level(name):
    scaled = WAVE.scaled(scale_factor(WAVE, name, 7.0))
    assert measure(scaled, name) == pytest.approx(7.0, rel=1e-9)


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: parse_measure("pga"), ["unknown intensity measure 'pga'", "PGA, PGV"]),
        (lambda: parse_measure("Sa(0)"), ["'Sa(0)'", "1 period"]),
        (lambda: parse_measure("AvgSA(1.0,0.2)"), ["shorter period first"]),
        (lambda: parse_measure("RotD50(Arias)"), ["PGA, PGV or Sa(T)"]),
        (lambda: measure(SINE, "RotD50(PGA)"), ["sine", "two horizontal components"]),
        (lambda: scale_factor(STILL, "PGA", 1.0), ["still: PGA of the record is 0"]),
        (lambda: scale_factor(SINE, "D5_95", 5.0), ["'D5_95' does not grow"]),
        (lambda: SINE.scaled(float("inf")), ["scale factor inf"]),
        (lambda: Motion([0.0, np.nan, 1.0], 0.01, id="rec"), ["rec: ", "not finite", "index 1"]),
        (lambda: Motion([[1.0, 2.0]], 0.01), ["a row of 2, not (1, 2)"]),
        (lambda: Motion([0.0, 1.0], "fast"), ["dt and samples", "must be numbers"]),
        (
            lambda: Motion([0.0, 1.0], 0.01, [1.0, 2.0, 3.0]),
            ["vertical must be a row of 2, not (3,)"],
        ),
    ],
)
def test_refusals(call, parts):
    refused(call, *parts)
