"""Intensity measures against closed forms and independent integrators."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import StateSpace, lsim

from archfrag.errors import InputError, RecordError
from archfrag.motions import measures, spectra
from archfrag.motions.measures import measure, measure_all, parse_measure, spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.motions.scale import scale_factor
from archfrag.motions.spectra import peaks_by_angle, response_spectrum

from .helpers import wave

G = 9.80665
NAMES = ("PGA", "PGV", "Arias", "D5_95", "Sa(0.5)", "AvgSA(0.2,1.0)")


def sine(frequency=2.0, amplitude=3.0, duration=5.0, dt=0.001):
    time = np.arange(round(duration / dt) + 1) * dt
    return Motion(amplitude * np.sin(2.0 * np.pi * frequency * time), dt, id="sine")


class TestClosedForms:
    def test_peak_velocity_of_a_sine(self):
        # v = A / w (1 - cos w t), from rest.
        assert measures.pgv(sine()) == pytest.approx(2.0 * 3.0 / (4.0 * np.pi), rel=1e-4)

    def test_arias_of_a_sine_of_full_periods(self):
        expected = np.pi / (2.0 * G) * 3.0**2 / 2.0 * 5.0
        assert measures.arias(sine()) == pytest.approx(expected, rel=1e-6)

    def test_duration_of_constant_acceleration(self):
        assert measures.significant_duration(Motion(np.full(1001, 2.0), 0.01)) == pytest.approx(
            9.0
        )

    def test_resonance_of_a_long_sine(self):
        # Steady state at resonance: Sa = A / (2 z); transient gone after many cycles.
        motion = sine(frequency=2.0, amplitude=1.0, duration=30.0, dt=0.002)
        assert spectral_acceleration(motion, 0.5)[0] == pytest.approx(10.0, rel=2e-3)

    def test_sudden_constant_acceleration(self):
        # u = a / w^2 (1 - exp(-z w t) (cos + z / sqrt(1 - z^2) sin)); the first peak is largest.
        damping = 0.05
        peak = 1.0 + np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2))
        spectrum = spectral_acceleration(Motion(np.full(300, 2.0), 0.01), [0.5, 1.0])
        assert spectrum == pytest.approx(2.0 * peak, rel=2e-3)

    def test_average_is_the_geometric_mean_of_ten_periods(self):
        motion = Motion(wave(), 0.01)
        spectrum = spectral_acceleration(motion, np.geomspace(0.2, 1.0, 10))
        assert measure(motion, "AvgSA(0.2,1.0)") == pytest.approx(
            spectrum.prod() ** 0.1, rel=1e-12
        )


def displacement_at_samples(record, dt, period, damping):
    oscillator = spectra._Oscillator(dt, period, damping)
    state, found = record[0] * oscillator.sudden, []
    for windows in spectra._windows(record):
        state = oscillator.put_states(windows, state)
        found += [u.ravel() for u in oscillator.responses(windows)]
    points = oscillator.gain.shape[1] // spectra._BLOCK
    return np.concatenate(found)[::points][: record.size]


class TestOscillator:
    @pytest.mark.parametrize("period", [0.05, 0.2, 1.0, 4.0])
    @pytest.mark.parametrize("damping", [0.0, 0.05, 0.5])
    def test_equals_an_independent_exact_integrator(self, period, damping):
        record = np.random.default_rng(3).standard_normal(300)  # starts away from zero
        frequency = 2.0 * np.pi / period
        ours = displacement_at_samples(record, 0.01, period, damping)
        system = StateSpace(
            [[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]],
            [[0.0], [-1.0]], [[1.0, 0.0]], [[0.0]],
        )  # fmt: skip
        _, reference, _ = lsim(system, record, np.arange(300) * 0.01, interp=True)
        assert np.allclose(ours, reference, rtol=0, atol=1e-10 * np.abs(reference).max())
        assert abs(ours[0]) < 1e-12 * np.abs(reference).max()

    def test_refinement_finds_the_peak_between_samples(self):
        coarse = Motion(wave(200, 0.05, 3.0), 0.05)
        fine_time = np.arange((200 - 1) * 50 + 1) / 50
        fine = Motion(np.interp(fine_time, np.arange(200), coarse.acceleration), 0.001)
        assert spectral_acceleration(coarse, 0.2) == pytest.approx(
            spectral_acceleration(fine, 0.2), rel=1.5e-3
        )

    def test_free_vibration_after_the_record_counts(self):
        short = Motion([0.0, 5.0, 5.0, 0.0], 0.01)
        padded = Motion(np.concatenate((short.acceleration, np.zeros(500))), 0.01)
        assert spectral_acceleration(short, 2.0) == pytest.approx(
            spectral_acceleration(padded, 2.0), rel=1e-9
        )
        assert spectral_acceleration(short, 2.0)[0] > 0.0


UNITS = {
    "PGA": "m/s2", "PGV": "m/s", "PGD": "m", "Arias": "m/s", "D5_95": "s", "Sa(0.5)": "m/s2",
    "SaAvg(0.2, 1.0)": "m/s2", "HI": "m", "ASI": "m/s", "FIV3(0.5)": "m/s",
    "RotD50(Sa(0.5))": "m/s2",
}  # fmt: skip
STILL = Motion(np.zeros(10), 0.01, id="still")


def test_units():
    assert {name: measures.measure_unit(name) for name in UNITS} == UNITS
    assert parse_measure("AvgSA(0.2, 1.0)").periods == (0.2, 1.0)


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: parse_measure("pga"), ["'pga' (did you mean PGA?)", "PGV"]),
        (lambda: parse_measure(None), ["None"]),
        (lambda: parse_measure("Sa(0)"), ["'Sa(0)'", "1 period"]),
        (lambda: parse_measure("Sa(nan)"), ["'Sa(nan)'", "1 period"]),
        (lambda: parse_measure("Sa(0.1,0.2)"), ["1 period"]),
        (lambda: parse_measure("AvgSA(0.5)"), ["2 period"]),
        (lambda: parse_measure("AvgSA(1.0,0.2)"), ["shorter period first"]),
        (lambda: parse_measure("RotD50(Arias)"), ["PGA, PGV or Sa(T)"]),
        (lambda: measure(sine(), "RotD50(PGA)"), ["sine", "two horizontal components"]),
        (lambda: spectral_acceleration(sine(), 0.5, damping=1.5), ["damping 1.5", "[0, 1)"]),
        (lambda: spectral_acceleration(sine(), [0.5, 0.0]), ["periods [0.5, 0.0]"]),
        (lambda: scale_factor(STILL, "PGA", 1.0), ["still: PGA of the record is 0"]),
        (lambda: scale_factor(sine(), "PGA", -1.0), ["level -1.0 m/s2 of PGA"]),
        (lambda: scale_factor(sine(), "PGA", float("nan")), ["level nan m/s2"]),
        (lambda: scale_factor(sine(), "D5_95", 5.0), ["'D5_95' does not change"]),
        (lambda: sine().scaled(float("inf")), ["scale factor inf"]),
    ],
)
def test_refusals(call, parts):
    with pytest.raises((InputError, RecordError)) as caught:
        call()
    for part in parts:
        assert part in str(caught.value)


class TestScaling:
    @pytest.mark.parametrize("name", [n for n in NAMES if n != "D5_95"])
    @pytest.mark.parametrize("level", [0.02, 7.0])
    def test_scaled_motion_has_the_level(self, name, level):
        motion = Motion(wave(), 0.01)
        scaled = motion.scaled(scale_factor(motion, name, level))
        assert measure(scaled, name) == pytest.approx(level, rel=1e-9)

    @given(factor=st.floats(1e-3, 1e3), power=st.sampled_from([("PGA", 1), ("PGV", 1),
           ("Arias", 2), ("Sa(0.3)", 1), ("D5_95", 0)]))  # fmt: skip
    @settings(max_examples=25, deadline=None)
    def test_measures_grow_with_the_factor(self, factor, power):
        name, exponent = power
        motion = Motion(wave(100), 0.01)
        grown = measure(motion.scaled(factor), name)
        assert grown == pytest.approx(measure(motion, name) * factor**exponent, rel=1e-9)


class TestMotion:
    @pytest.mark.parametrize(
        ("arguments", "reason"),
        [
            (([0.0, np.nan, 1.0], 0.01), r"acceleration has 1 sample\(s\) that are not finite"),
            (([0.0, 1.0, np.inf], 0.01), r"the first at index 2 \(inf\)"),
            (([], 0.01), r"acceleration has 0 sample\(s\); at least 2"),
            (([1.0], 0.01), r"acceleration has 1 sample\(s\); at least 2"),
            (([[1.0, 2.0]], 0.01), r"acceleration has shape \(1, 2\); one row"),
            ((["a", "b"], 0.01), r"acceleration must be a row of numbers"),
            (([0.0, 1.0], 0.0), r"time step dt = 0.0 s must be a positive number of seconds"),
            (([0.0, 1.0], -0.01), r"time step dt = -0.01 s must be a positive"),
            (([0.0, 1.0], float("nan")), r"time step dt = nan s must be a positive"),
            (([0.0, 1.0], "fast"), r"time step dt = fast s must be a positive"),
            (([0.0, 1.0], 0.01, [1.0, 2.0, 3.0]), r"vertical has 3 samples and the horizontal 2"),
            (([0.0, 1.0], 0.01, [1.0, np.nan]), r"vertical has 1 sample\(s\) that are not finite"),
        ],
    )
    def test_refused(self, arguments, reason):
        with pytest.raises(RecordError, match=f"rec: .*{reason}"):
            Motion(*arguments, **({} if len(arguments) > 2 else {"vertical": None}), id="rec")


def noise(count=2000, seed=1):
    ramp = np.sin(np.pi * np.arange(count) / (count - 1))
    return np.random.default_rng(seed).standard_normal(count) * ramp


class TestIntegrals:
    def test_displacement_of_a_sine(self):
        # d = A / w (t - sin(w t) / w), from rest: largest at the end, after full periods.
        w = 4.0 * np.pi
        assert measure(sine(), "PGD") == pytest.approx(3.0 / w * 5.0, rel=1e-4)

    def test_cumulative_absolute_velocity_of_a_ramp_through_zero_is_exact(self):
        assert measure(Motion([-1.0, 3.0], 2.0), "CAV") == pytest.approx(0.25 + 2.25, rel=1e-14)

    def test_standardised_leaves_out_quiet_seconds(self):
        quiet, loud = np.full(100, 0.02 * G), np.full(101, 0.03 * G)
        motion = Motion(np.concatenate((quiet, loud)), 0.01)
        # The window from 0 to 1 s ends with the first loud sample, and so counts.
        assert measure(motion, "CAVstd") == pytest.approx(measure(motion, "CAV"), rel=1e-12)
        assert measure(Motion(np.full(301, 0.0249 * G), 0.01), "CAVstd") == 0.0
        three = Motion(np.concatenate((np.full(200, 0.02 * G), loud)), 0.01)
        assert measure(three, "CAVstd") == pytest.approx(
            measure(three, "CAV") - 0.02 * G, rel=1e-9
        )

    def test_duration_to_three_quarters_of_constant_acceleration(self):
        assert measure(Motion(np.full(1001, 2.0), 0.01), "D5_75") == pytest.approx(7.0)

    def test_intensities_are_integrals_of_the_spectrum(self):
        motion = Motion(wave(), 0.01)
        fine = np.linspace(0.1, 2.5, 2001)
        velocities = spectral_acceleration(motion, fine) * fine / (2.0 * np.pi)
        assert measure(motion, "HI") == pytest.approx(np.trapezoid(velocities, fine), rel=2e-3)
        short = np.linspace(0.1, 0.5, 801)
        expected = np.trapezoid(spectral_acceleration(motion, short), short)
        assert measure(motion, "ASI") == pytest.approx(expected, rel=2e-3)

    def test_filtered_incremental_velocity_of_a_slow_sine(self):
        # Far below the corner the filter passes all; windows of 0.7 T around each crest gain
        # A / w 2 sin(0.35 w T), and the record has three crests.
        w, period = 2.0 * np.pi * 0.2, 0.5
        time = np.arange(15_001) * 0.001
        motion = Motion(2.0 * np.sin(w * time), 0.001)
        expected = 3.0 * 2.0 / w * 2.0 * np.sin(0.35 * period * w)
        assert measure(motion, f"FIV3({period})") == pytest.approx(expected, rel=2e-3)

    def test_several_measures_at_once_are_those_one_by_one(self):
        motion = Motion(noise(), 0.01)
        names = ["PGA", "HI", "Sa(0.3)", "AvgSA(0.2,1.0)", "SaAvg(0.2,1.0)", "SA(0.3)", "D5_75"]
        together = measure_all(motion, names)
        assert list(together) == names
        assert together == {name: measure(motion, name) for name in names}
        assert together["AvgSA(0.2,1.0)"] == together["SaAvg(0.2,1.0)"]
        assert together["SA(0.3)"] == together["Sa(0.3)"]


class TestRotated:
    def test_a_motion_along_one_line(self):
        samples = noise()
        motion = Motion(0.6 * samples, 0.01, across=0.8 * samples)
        largest = np.abs(samples).max()
        assert measure(motion, "RotD100(PGA)") == pytest.approx(largest, rel=1e-4)
        assert measure(motion, "RotD50(PGA)") == pytest.approx(largest * np.sqrt(0.5), rel=1e-2)

    @pytest.mark.parametrize("period", [0.05, 0.4, 2.0])
    def test_spectrum_is_that_of_each_direction(self, period):
        one, other = noise(seed=1), noise(seed=2)
        motion = Motion(one, 0.01, across=other)
        angles = np.deg2rad(np.arange(180))
        each = [
            response_spectrum(np.cos(a) * one + np.sin(a) * other, 0.01, period)[0] for a in angles
        ]
        assert measure(motion, f"RotD50(Sa({period}))") == pytest.approx(np.median(each), rel=1e-8)
        assert measure(motion, f"RotD100(Sa({period}))") == pytest.approx(np.max(each), rel=1e-8)

    def test_points_left_out_do_not_matter(self):
        points = np.random.default_rng(4).standard_normal((2, 5000)) * [[1.0], [0.05]]
        angles = np.deg2rad(np.arange(180))
        all_points = np.abs(points.T @ np.stack((np.cos(angles), np.sin(angles)))).max(axis=0)
        assert np.allclose(peaks_by_angle(*points), all_points, rtol=1e-14)


class TestRecords:
    @pytest.mark.parametrize("count", [2, 3, 16, 17, 33, 32769, 70000])
    def test_parts_of_a_record_join(self, count):
        record = np.concatenate((noise(count), np.zeros(40)))
        longer = np.concatenate((record, np.zeros(17)))
        periods = [0.02, 0.3, 3.0]
        assert response_spectrum(record, 0.01, periods) == pytest.approx(
            response_spectrum(longer, 0.01, periods), rel=2e-9
        )
