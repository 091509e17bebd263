"""Measures beyond the classical ones, in closed form or by an independent formula."""

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.motions.flatfile import measure_records, read_flatfile, write_flatfile
from archfrag.motions.measures import measure, measure_all, parse_measure, spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.motions.spectra import peaks_by_angle, response_spectrum

from .helpers import REAL_RECORDS, needs_real_records, wave
from .test_measures import G, sine


def noise(count=2000, seed=1):
    ramp = np.sin(np.pi * np.arange(count) / (count - 1))
    return np.random.default_rng(seed).standard_normal(count) * ramp


class TestClosedForms:
    def test_displacement_of_a_sine(self):
        # d = A / w (t - sin(w t) / w), from rest: largest at the end, after whole periods.
        w = 4.0 * np.pi
        assert measure(sine(), "PGD") == pytest.approx(3.0 / w * 5.0, rel=1e-4)

    def test_cumulative_absolute_velocity_of_a_sine(self):
        assert measure(sine(), "CAV") == pytest.approx(2.0 / np.pi * 3.0 * 5.0, rel=2e-5)

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

    def test_durations_cross_parts_of_a_long_record(self):
        motion = Motion(np.full(200_001, 2.0), 0.001)
        assert measure(motion, "D5_95") == pytest.approx(180.0, rel=1e-6)

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

    def test_velocity(self):
        motion = Motion(np.zeros(2000), 0.01, across=noise())
        alone = Motion(noise(), 0.01)
        assert measure(motion, "RotD100(PGV)") == pytest.approx(measure(alone, "PGV"), rel=1e-9)

    def test_one_component_is_not_enough(self):
        with pytest.raises(InputError, match=r"^m: RotD50 needs two horizontal components, and"):
            measure(Motion(noise(), 0.01, id="m"), "RotD50(PGA)")

    def test_of_what_can_be_rotated(self):
        with pytest.raises(InputError, match=r"'RotD50\(Arias\)' must be of PGA, PGV or Sa\(T\)"):
            parse_measure("RotD50(Arias)")


class TestSpectrum:
    @pytest.mark.parametrize("count", [2, 3, 16, 17, 33, 32769, 70000])
    def test_parts_of_a_record_join(self, count):
        record = np.concatenate((noise(count), np.zeros(40)))
        longer = np.concatenate((record, np.zeros(17)))
        periods = [0.02, 0.3, 3.0]
        assert response_spectrum(record, 0.01, periods) == pytest.approx(
            response_spectrum(longer, 0.01, periods), rel=2e-9
        )

    def test_more_samples_on_the_same_lines_change_nothing(self):
        record = noise(400)
        fine = np.interp(np.arange(399 * 8 + 1) / 8, np.arange(400), record)
        periods = np.geomspace(0.02, 5.0, 30)
        assert response_spectrum(record, 0.02, periods) == pytest.approx(
            response_spectrum(fine, 0.0025, periods), rel=1.5e-3
        )

    @needs_real_records
    def test_agrees_with_pyrotd(self):
        pyrotd = pytest.importorskip("pyrotd", reason="pyrotd is not installed")
        from scipy.signal import resample_poly

        from archfrag.motions.read import read_motion

        pyrotd.processes = 1
        motion = read_motion(REAL_RECORDS / "at2" / "RSN6_IMPVALL.I_I-ELC180.AT2")
        # Without the quiet after the record its transform would wrap around; on a fine step both
        # ideas of what lies between samples are the same.
        fine = resample_poly(motion.acceleration, 5, 1)
        padded = np.concatenate((fine, np.zeros(3 * fine.size)))
        periods = np.geomspace(0.02, 10.0, 100)
        theirs = pyrotd.calc_spec_accels(motion.dt / 5, padded, 1.0 / periods, 0.05).spec_accel
        assert response_spectrum(fine, motion.dt / 5, periods) == pytest.approx(theirs, rel=5e-3)


class TestFlatfile:
    def test_columns_and_values(self, tmp_path):
        facts = {"file": "a.AT2", "event": "Quake, 1999", "Mw": 6.5, "component": "090",
                 "pulse": True}  # fmt: skip
        known = Motion(noise(), 0.01, id="known", metadata=facts)
        pair = Motion(noise(seed=3), 0.01, id="pair", across=noise(seed=4))
        table = measure_records([known, pair], periods=[0.1, 1.0])
        assert list(table.columns[:14]) == [
            "record", "file", "event", "station", "magnitude", "distance_km", "vs30_mps",
            "component", "scale", "dt_s", "PGA_g", "PGV_cms", "PGD_cm", "T0.100S",
        ]  # fmt: skip
        assert table["T1.000S"][0] == pytest.approx(measure(known, "Sa(1.0)") / G, rel=1e-12)
        assert table["RotD50_T0.100S"].isna().tolist() == [True, False]
        write_flatfile(tmp_path / "flat.csv", table)
        again = read_flatfile(tmp_path / "flat.csv")
        assert list(again.columns) == list(table.columns)
        assert again["event"][0] == "Quake, 1999"
        assert again["component"][0] == "090"
        assert again["pulse"].isna().tolist() == [False, True]
        assert bool(again["pulse"][0]) is True
        assert again["PGV_cms"].tolist() == pytest.approx(table["PGV_cms"].tolist(), rel=1e-5)

    def test_two_processes_give_the_same(self):
        motions = [Motion(noise(300, seed), 0.01, id=str(seed)) for seed in range(5)]
        alone = measure_records(motions, [0.2])
        assert measure_records(iter(motions), [0.2], workers=2).equals(alone)

    @pytest.mark.parametrize(
        ("text", "sentence"),
        [("a,b\n1,2\n", "has no column 'record'"), ("", "cannot be read as a flatfile in CSV"),
         ("record,magnitude\nx,big\n", "Unable to parse string")],
    )  # fmt: skip
    def test_no_flatfile(self, tmp_path, text, sentence):
        path = tmp_path / "flat.csv"
        path.write_text(text)
        with pytest.raises(InputError, match=sentence):
            read_flatfile(path)

    def test_missing_flatfile(self, tmp_path):
        with pytest.raises(InputError, match="there is no such flatfile"):
            read_flatfile(tmp_path / "flat.csv")

    def test_periods_that_would_share_a_column(self):
        with pytest.raises(InputError, match="must differ in their first three decimals"):
            measure_records([], periods=[0.1, 0.1001])
