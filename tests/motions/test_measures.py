"""Intensity measures against closed forms and independent integrators."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import StateSpace, lsim

from archfrag.errors import InputError, RecordError
from archfrag.motions import measures, spectra
from archfrag.motions.motion import Motion
from archfrag.motions.process import bandpass, cut, demean, displacement, velocity
from archfrag.motions.scale import scale_factor

from .helpers import wave

G = 9.80665
NAMES = ("PGA", "PGV", "Arias", "D5_95", "Sa(0.5)", "AvgSA(0.2,1.0)")


def sine(frequency=2.0, amplitude=3.0, duration=5.0, dt=0.001):
    time = np.arange(round(duration / dt) + 1) * dt
    return Motion(amplitude * np.sin(2.0 * np.pi * frequency * time), dt, id="sine")


class TestClosedForms:
    def test_peak_acceleration_is_the_largest_absolute_sample(self):
        assert measures.pga(Motion([0.0, 1.0, -4.0, 2.0], 0.01)) == 4.0

    def test_peak_velocity_of_a_sine(self):
        # v = A / w (1 - cos w t), from rest.
        assert measures.pgv(sine()) == pytest.approx(2.0 * 3.0 / (4.0 * np.pi), rel=1e-4)

    def test_arias_of_a_sine_of_whole_periods(self):
        expected = np.pi / (2.0 * G) * 3.0**2 / 2.0 * 5.0
        assert measures.arias(sine()) == pytest.approx(expected, rel=1e-6)

    def test_duration_of_constant_acceleration(self):
        assert measures.significant_duration(Motion(np.full(1001, 2.0), 0.01)) == pytest.approx(
            9.0
        )

    def test_duration_without_motion_is_zero(self):
        assert measures.significant_duration(Motion(np.zeros(10), 0.01)) == 0.0

    def test_resonance_of_a_long_sine(self):
        # Steady state at resonance: Sa = A / (2 z); transient gone after many cycles.
        motion = sine(frequency=2.0, amplitude=1.0, duration=30.0, dt=0.002)
        assert measures.spectral_acceleration(motion, 0.5)[0] == pytest.approx(10.0, rel=2e-3)

    def test_sudden_constant_acceleration(self):
        # u = a / w^2 (1 - exp(-z w t) (cos + z / sqrt(1 - z^2) sin)); the first peak is largest.
        damping = 0.05
        peak = 1.0 + np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2))
        spectrum = measures.spectral_acceleration(Motion(np.full(300, 2.0), 0.01), [0.5, 1.0])
        assert spectrum == pytest.approx(2.0 * peak, rel=2e-3)

    def test_very_stiff_oscillator_follows_the_ground(self):
        motion = Motion(wave(), 0.01)
        stiff = measures.spectral_acceleration(motion, 0.005)[0]
        assert stiff == pytest.approx(measures.pga(motion), rel=2e-3)

    def test_average_is_the_geometric_mean_of_ten_periods(self):
        motion = Motion(wave(), 0.01)
        spectrum = measures.spectral_acceleration(motion, np.geomspace(0.2, 1.0, 10))
        assert measures.measure(motion, "AvgSA(0.2,1.0)") == pytest.approx(
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
        assert measures.spectral_acceleration(coarse, 0.2) == pytest.approx(
            measures.spectral_acceleration(fine, 0.2), rel=1.5e-3
        )

    def test_free_vibration_after_the_record_counts(self):
        short = Motion([0.0, 5.0, 5.0, 0.0], 0.01)
        padded = Motion(np.concatenate((short.acceleration, np.zeros(500))), 0.01)
        assert measures.spectral_acceleration(short, 2.0) == pytest.approx(
            measures.spectral_acceleration(padded, 2.0), rel=1e-9
        )
        assert measures.spectral_acceleration(short, 2.0)[0] > 0.0


class TestNames:
    @pytest.mark.parametrize(
        ("name", "unit"),
        [("PGA", "m/s2"), ("PGV", "m/s"), ("Arias", "m/s"), ("D5_95", "s"), ("Sa(0.5)", "m/s2"),
         ("AvgSA(0.2,1.0)", "m/s2")],
    )  # fmt: skip
    def test_units(self, name, unit):
        assert measures.measure_unit(name) == unit

    def test_periods(self):
        assert measures.parse_measure("AvgSA(0.2, 1.0)").periods == (0.2, 1.0)

    @pytest.mark.parametrize(
        ("name", "sentence"),
        [
            (
                "pga",
                r"unknown intensity measure 'pga' \(did you mean PGA\?\); allowed are PGA, PGV",
            ),
            ("Sa", r"unknown intensity measure 'Sa'"),
            ("Sa(0)", r"'Sa\(0\)' needs 1 period\(s\) in seconds, each above 0$"),
            ("Sa(-1)", r"needs 1 period"),
            ("Sa(nan)", r"needs 1 period"),
            ("Sa(half)", r"needs 1 period"),
            ("Sa(0.1,0.2)", r"needs 1 period"),
            ("AvgSA(0.5)", r"needs 2 period"),
            ("AvgSA(1.0,0.2)", r"needs its shorter period first$"),
            (None, r"unknown intensity measure None"),
        ],
    )
    def test_wrong_name(self, name, sentence):
        with pytest.raises(InputError, match=sentence):
            measures.parse_measure(name)

    def test_wrong_damping(self):
        with pytest.raises(InputError, match=r"damping 1.5 must be in \[0, 1\)"):
            measures.spectral_acceleration(sine(), 0.5, damping=1.5)

    def test_wrong_period(self):
        with pytest.raises(InputError, match=r"periods \[0.5, 0.0\] must be positive"):
            measures.spectral_acceleration(sine(), [0.5, 0.0])


class TestScaling:
    @pytest.mark.parametrize("name", [n for n in NAMES if n != "D5_95"])
    @pytest.mark.parametrize("level", [0.02, 7.0])
    def test_scaled_motion_has_the_level(self, name, level):
        motion = Motion(wave(), 0.01)
        scaled = motion.scaled(scale_factor(motion, name, level))
        assert measures.measure(scaled, name) == pytest.approx(level, rel=1e-9)

    def test_vertical_is_scaled_too_and_the_factor_logged(self):
        scaled = Motion(wave(), 0.01, vertical=wave()).scaled(2.5)
        assert np.array_equal(scaled.vertical, 2.5 * wave())
        assert scaled.log[-1] == "Multiplied by 2.5."

    def test_zero_record(self):
        with pytest.raises(RecordError, match=r"still: PGA of the record is 0, so no factor can"):
            scale_factor(Motion(np.zeros(10), 0.01, id="still"), "PGA", 1.0)

    @pytest.mark.parametrize("level", [0.0, -1.0, float("nan"), float("inf")])
    def test_level_must_be_above_zero(self, level):
        with pytest.raises(
            InputError, match=rf"level {level} m/s2 of PGA must be a number above 0"
        ):
            scale_factor(Motion(wave(), 0.01), "PGA", level)

    def test_duration_cannot_be_scaled_to(self):
        with pytest.raises(InputError, match=r"'D5_95' does not change when a record is scaled"):
            scale_factor(Motion(wave(), 0.01), "D5_95", 5.0)

    @given(factor=st.floats(1e-3, 1e3), power=st.sampled_from([("PGA", 1), ("PGV", 1),
           ("Arias", 2), ("Sa(0.3)", 1), ("D5_95", 0)]))  # fmt: skip
    @settings(max_examples=25, deadline=None)
    def test_measures_grow_with_the_factor(self, factor, power):
        name, exponent = power
        motion = Motion(wave(100), 0.01)
        grown = measures.measure(motion.scaled(factor), name)
        assert grown == pytest.approx(measures.measure(motion, name) * factor**exponent, rel=1e-9)


class TestMotion:
    @pytest.mark.parametrize(
        ("arguments", "sentence"),
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
    def test_refused(self, arguments, sentence):
        with pytest.raises(RecordError, match=f"rec: .*{sentence}"):
            Motion(*arguments, **({} if len(arguments) > 2 else {"vertical": None}), id="rec")

    def test_own_copy_in_float64(self):
        values = np.array([0, 1, 2], dtype=np.int16)
        motion = Motion(values, 0.5)
        values[1] = 9
        assert motion.acceleration.dtype == np.float64
        assert motion.acceleration[1] == 1.0
        assert motion.duration == 1.0
        assert np.array_equal(motion.time, [0.0, 0.5, 1.0])

    @pytest.mark.parametrize("factor", [float("nan"), float("inf")])
    def test_factor_must_be_finite(self, factor):
        with pytest.raises(InputError, match=r"scale factor .* must be a finite number"):
            Motion(wave(), 0.01).scaled(factor)


class TestProcessing:
    def test_demean(self):
        motion = demean(Motion(wave() + 3.0, 0.01, vertical=wave() - 1.0))
        assert abs(motion.acceleration.mean()) < 1e-14
        assert abs(motion.vertical.mean()) < 1e-14
        assert motion.log[-1].startswith("Mean removed (3")

    def test_band_pass_keeps_what_is_inside_and_its_phase(self):
        time = np.arange(4000) * 0.01
        inside = np.sin(2.0 * np.pi * 1.0 * time)
        motion = Motion(inside + np.sin(2.0 * np.pi * 30.0 * time), 0.01, vertical=inside)
        filtered = bandpass(motion, 0.1, 10.0)
        middle = slice(1500, 2500)
        assert np.allclose(filtered.acceleration[middle], inside[middle], atol=0.02)
        assert np.allclose(filtered.vertical[middle], inside[middle], atol=0.02)
        assert filtered.log[-1].startswith("Band-pass 0.1 to 10 Hz")

    @pytest.mark.parametrize("corners", [(0.0, 10.0), (5.0, 1.0), (1.0, 50.0)])
    def test_corners_must_fit(self, corners):
        with pytest.raises(InputError, match=r"must satisfy 0 < lowest < highest < 50 Hz"):
            bandpass(Motion(wave(), 0.01), *corners)

    def test_cut(self):
        motion = cut(Motion(np.arange(101.0), 0.01, vertical=np.arange(101.0)), 0.2, 0.5)
        assert np.array_equal(motion.acceleration, np.arange(20.0, 51.0))
        assert np.array_equal(motion.vertical, motion.acceleration)

    @pytest.mark.parametrize("span", [(-0.1, 0.5), (0.5, 0.5), (2.0, 3.0)])
    def test_cut_must_leave_samples(self, span):
        with pytest.raises(InputError, match=r"cannot cut from .* the record lasts 1 s"):
            cut(Motion(np.arange(101.0), 0.01), *span)

    def test_velocity_and_displacement_of_constant_acceleration(self):
        motion = Motion(np.full(1001, 2.0), 0.001)
        assert velocity(motion)[-1] == pytest.approx(2.0, rel=1e-12)
        assert displacement(motion)[-1] == pytest.approx(1.0, rel=1e-5)
