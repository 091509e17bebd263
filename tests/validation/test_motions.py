"""Intensity measures, spectra, correlations and records beside closed forms and publications."""

import csv
import math
from pathlib import Path

import numpy as np
import obspy
import pytest
from scipy.signal import StateSpace, lsim

import archfrag as af
from archfrag.motions import target
from archfrag.motions.measures import measure, spectral_acceleration
from archfrag.motions.read import read_motion
from archfrag.motions.target import conditional_spectrum, correlation

G = 9.80665
RECORDS = Path(__file__).resolve().parents[3] / "shared" / "records"


def sine(amplitude, duration, dt):
    """Of 2 Hz."""
    time = np.arange(round(duration / dt) + 1) * dt
    return af.Motion(amplitude * np.sin(4.0 * np.pi * time), dt)


class TestMeasures:
    TOPIC = "Intensity measures and spectra"

    @pytest.mark.parametrize(
        ("name", "expected", "unit", "rel"),
        [
            ("PGV", 2.0 * 3.0 / (4.0 * np.pi), "m/s", 1e-4),
            ("PGD", 3.0 / (4.0 * np.pi) * 5.0, "m", 1e-4),
            ("Arias", np.pi / (2.0 * G) * 3.0**2 / 2.0 * 5.0, "m/s", 1e-6),
            ("CAV", 2.0 / np.pi * 3.0 * 5.0, "m/s", 2e-5),
        ],
    )
    def test_sine(self, validated, name, expected, unit, rel):
        case = "sine of 3 m/s², 2 Hz, 5 s"
        found = measure(sine(3.0, 5.0, 0.001), name)
        validated(case, name, found, expected, "closed form", rel=rel, unit=unit)

    def test_duration_and_oscillator(self, validated):
        case = "constant acceleration for 10 s"
        steady = af.Motion(np.full(1001, 2.0), 0.01)
        found = measure(steady, "D5_95")
        validated(case, "D5_95", found, 9.0, "closed form", rel=1e-9, unit="s")
        case = "sine of 1 m/s², 2 Hz, 30 s"
        source = "closed form: A/(2ζ)"
        found = spectral_acceleration(sine(1.0, 30.0, 0.002), 0.5)[0]
        validated(
            case, "Sa(0.5 s) at resonance", found, 10.0, source, rel=2e-3, unit="m/s²"
        )
        step = af.Motion(np.full(300, 2.0), 0.01)
        peak = 2.0 * (1.0 + math.exp(-math.pi * 0.05 / math.sqrt(1.0 - 0.05**2)))
        for period, found in zip((0.5, 1.0), spectral_acceleration(step, [0.5, 1.0])):
            case = "sudden 2 m/s²"
            name = f"Sa({period:g} s)"
            validated(case, name, found, peak, "closed form", rel=2e-3, unit="m/s²")

    @pytest.mark.parametrize("period", [0.2, 0.5, 1.0, 4.0])
    def test_spectrum_of_noise(self, validated, period):
        record = np.random.default_rng(3).standard_normal(2000) * np.hanning(2000)
        rate = 2.0 * np.pi / period
        system = StateSpace(
            [[0.0, 1.0], [-(rate**2), -0.1 * rate]],
            [[0.0], [-1.0]],
            [[1.0, 0.0]],
            [[0.0]],
        )
        fine = np.arange(16 * 1999 + 1) / 16.0
        samples = np.interp(fine, np.arange(2000), record)
        _, shift, _ = lsim(system, samples, 0.01 * fine, interp=True)
        found = spectral_acceleration(af.Motion(record, 0.01), period)[0]
        validated(
            "noise of 20 s under a window",
            f"Sa({period:g} s)",
            found,
            rate**2 * np.abs(shift).max(),
            "scipy lsim at a sixteenth of the step",
            rel=1e-3,
            unit="m/s²",
        )


class TestSelection:
    TOPIC = "Targets of record selection"
    # Figure 4 of the paper as digitised in pygmm's own tests (MIT).
    FIGURE_4 = (
        (0.5, 0.0100194, 0.681997),
        (0.5, 0.049796, 0.59341),
        (0.5, 0.099442, 0.47521),
        (0.5, 0.20032, 0.672082),
        (0.5, 0.74873, 0.854452),
        (0.5, 1.9892, 0.516177),
        (0.5, 9.9058, 0.112522),
        (10.0, 0.019795, 0.054988),
        (10.0, 0.074206, 0.015245),
        (10.0, 0.149147, 0.000766),
        (10.0, 0.49277, 0.111672),
        (10.0, 2.4883, 0.51624),
    )
    PERIODS = (0.01, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0)
    MEDIAN = (0.4791, 0.5333, 0.7122, 1.1067, 0.7518, 0.3614, 0.1379, 0.0480)
    DEVIATION = (0.2360, 0.2696, 0.3111, 0.0, 0.4507, 0.5760, 0.6412, 0.6658)

    def test_correlation(self, validated):
        figure = "Baker and Jayaram 2008, figure 4"
        table = "Bradley 2010, table I"
        for first, second, expected, source in (
            *((*values, figure) for values in self.FIGURE_4),
            (0.05, 1.0, 0.42, table),
            (0.5, 1.0, 0.75, table),
        ):
            case = f"ln Sa({first:g} s) and ln Sa({second:.3g} s)"
            found = correlation(first, second)
            validated(case, "correlation", found, expected, source, abs=5e-3)

    def test_conditional_spectrum(self, validated, monkeypatch):
        median = np.array(
            [0.2858, 0.3276, 0.4503, 0.5914, 0.4653, 0.2582, 0.1131, 0.0440]
        )
        sd = np.array([0.4985, 0.4941, 0.4985, 0.5326, 0.6078, 0.6430, 0.6628, 0.6699])
        monkeypatch.setattr(target, "predict", lambda *_: (np.log(median), sd, ()))
        near = (7.0, 12.0, 400.0)
        found = conditional_spectrum(near, 1.1067, 0.2, self.PERIODS)
        case = "given Sa(0.2 s) = 1.1067 g"
        source = "pygmm's tests (MIT)"
        for number, period in enumerate(self.PERIODS):
            name = f"Sa({period:g} s)"
            median = found.median[number]
            deviation = found.sd[number]
            expected = self.MEDIAN[number]
            validated(
                case, f"median {name}", median, expected, source, rel=1e-3, unit="g"
            )
            expected = self.DEVIATION[number]
            validated(
                case, f"dispersion of {name}", deviation, expected, source, abs=2e-4
            )


@pytest.mark.skipif(
    not (RECORDS / "manifest.csv").is_file(),
    reason="../shared/records is not beside the repository",
)
class TestRecords:
    """Against measurements by an independent reader, rounded to 1e-4 g and 0.01 cm/s."""

    TOPIC = "Records as read"
    FILES = (
        "at2/RSN6_IMPVALL.I_I-ELC180.AT2",
        "at2/RSN77_SFERN_PUL164.AT2",
        "at2/CPM000.AT2",
        "at2/Rinaldi228.AT2",
        "at2/ARL360.at2",
        "dmg_v2/CHAN15.V2",
        "dmg_v2/MTWILSON.V2",
        "smc/np01002p_4225c_a.smc",
        "resorce_acc/16837_H2.cor.acc",
        "esm_dyna/HI.ARS1..HNN.D.20190728.160908.C.ACC.ASC",
    )

    @pytest.mark.parametrize("name", FILES)
    def test_peaks(self, validated, name):
        with (RECORDS / "manifest.csv").open(newline="") as file:
            row = next(row for row in csv.DictReader(file) if row["file"] == name)
        path = RECORDS / name
        trace = obspy.read(str(path))[int(row["channel_index"])]
        motion = read_motion(path, component=trace.id)
        case = f"{row['event']}, {row['station']}, {row['component']} ({row['format']})"
        source = "independent reader"
        peak = float(row["PGA_g"])
        speed = float(row["PGV_cms"])
        found = measure(motion, "PGA") / G
        validated(case, "PGA", found, peak, source, rel=1e-3, abs=5.5e-5, unit="g")
        found = 100.0 * measure(motion, "PGV")
        validated(case, "PGV", found, speed, source, rel=2e-2, abs=5.5e-3, unit="cm/s")
