"""Intensity measures against closed forms and other integrators; stored motions; cautions."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from archfrag.errors import InputError
from archfrag.files import write_csv
from archfrag.motions.index import load_index
from archfrag.motions.measures import (
    measure,
    measures_of,
    parse_measure,
    sample_cautions,
    scale_factor,
    spectral_acceleration,
)
from archfrag.motions.motion import Motion, load_stored, store
from archfrag.motions.read import inspect_record, load_motion, read_horizontals
from archfrag.motions.selection import measure_records, read_flatfile
from archfrag.study.file.prepared import COMPARED

from .helpers import REAL_RECORDS, SHIPPED, at2_text, needs_real_records, refused, wave

G = 9.80665
WAVE = Motion(wave(), 0.01)
STILL = Motion(np.zeros(10), 0.01, id="still")
MASKED = np.ma.masked_array([0.1, 9.0], [0, 1])
SINE = Motion(wave(), 0.01, id="sine")


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
    (
        Motion(np.repeat([0.02 * G, 0.03 * G], [100, 101]), 0.01),
        "CAVstd",
        0.05005 * G,
        1e-9,
    ),
    (
        Motion(np.repeat([0.02 * G, 0.03 * G], [200, 101]), 0.01),
        "CAVstd",
        0.05005 * G,
        1e-9,
    ),
    (WAVE, "HI", sa_integral(0.1, 2.5, 1), 2e-3),
    (
        WAVE,
        "AvgSA(0.2,1.0)",
        spectral_acceleration(WAVE, np.geomspace(0.2, 1.0, 10)).prod() ** 0.1,
        1e-12,
    ),
    (
        Motion(0.6 * noise(), 0.01, transverse=0.8 * noise()),
        "RotD100(PGA)",
        np.abs(noise()).max(),
        1e-4,
    ),
]


@pytest.mark.parametrize(("motion", "name", "expected", "within"), CLOSED)
def test_closed_forms_that_the_validation_does_not_have(motion, name, expected, within):
    assert measure(motion, name) == pytest.approx(expected, rel=within, abs=1e-14)


def largest_response(record, dt, period):
    """Sa from scipy's first-order hold of the oscillator, at 500 points of a period or more."""
    w = 2.0 * np.pi / period
    finer = int(np.ceil(500 * dt / period)) + 3
    count = record.size + 1 + int(np.ceil(period / dt))
    fine = np.interp(
        np.arange(count * finer) / finer, np.arange(record.size + 1), [*record, 0.0]
    )
    oscillator = [-w * w], [1.0, 0.1 * w, w * w]
    numerator, denominator, _ = cont2discrete(oscillator, dt / finer, method="foh")
    return np.abs(lfilter(numerator.ravel(), denominator, fine)).max()


@pytest.mark.parametrize("count", [160, 163, 171, 32768])
def test_spectrum_of_a_record_that_ends_in_motion(count):
    record = np.random.default_rng(count).standard_normal(count)
    record[0] = 0.0
    periods = np.geomspace(0.02, 10.0, 24 if count < 1000 else 4)
    found, extended = (
        spectral_acceleration(Motion(samples, 0.01), periods)
        for samples in (record, np.append(record, np.zeros(40)))
    )
    expected = [largest_response(record, 0.01, period) for period in periods]
    assert found == pytest.approx(expected, rel=1e-3)
    assert found == pytest.approx(extended, rel=1e-9)


@pytest.mark.parametrize("period", [0.05, 0.4, 2.0])
def test_rotated_spectrum_is_that_of_each_direction(period):
    one = noise(seed=1)
    other = noise(seed=2)
    motion = Motion(one, 0.01, transverse=other)
    each = [
        spectral_acceleration(
            Motion(np.cos(a) * one + np.sin(a) * other, 0.01), period
        )[0]
        for a in np.deg2rad(np.arange(180))
    ]
    assert measure(motion, f"RotD50(Sa({period}))") == pytest.approx(
        np.median(each), rel=1e-8
    )
    assert measure(motion, f"RotD100(Sa({period}))") == pytest.approx(
        np.max(each), rel=1e-8
    )


@pytest.mark.parametrize(
    "name", ["PGA", "PGV", "Arias", "SA(0.3)", "SaAvg(0.2, 1.0)", "FIV3(0.5)"]
)
def test_scaled_motion_has_the_level(name):
    scaled = WAVE.scaled(scale_factor(WAVE, name, 7.0))
    assert measure(scaled, name) == pytest.approx(7.0, rel=1e-9)


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: parse_measure("pga"), ["unknown intensity measure 'pga'", "PGA, PGV"]),
        (lambda: parse_measure("Sa(0)"), ["'Sa(0)'", "1 period"]),
        (lambda: parse_measure("AvgSA(1.0,0.2)"), ["shorter period first"]),
        (lambda: parse_measure("RotD50(RotD100(PGA))"), ["is rotated twice"]),
        (lambda: parse_measure("FIV3"), ["unknown", "FIV3(T)"]),
        (lambda: parse_measure("Sa_avg2(0.2,1.0)"), ["needs 1 period"]),
        (lambda: measure(SINE, "RotD50(PGA)"), ["sine", "two horizontal components"]),
        (lambda: scale_factor(STILL, "PGA", 1.0), ["still: PGA of the record is 0"]),
        (lambda: scale_factor(SINE, "D5_95", 5.0), ["'D5_95' does not grow"]),
        (lambda: SINE.scaled(float("inf")), ["scale factor inf"]),
        (
            lambda: Motion([0.0, np.nan, 1.0], 0.01, id="rec"),
            ["rec: ", "not finite", "index 1"],
        ),
        (lambda: Motion([[1.0, 2.0]], 0.01), ["a row of 2, not (1, 2)"]),
        (lambda: Motion([0.0, 1.0], "fast"), ["dt and samples", "must be numbers"]),
        (
            lambda: Motion([0.0, 1.0], 0.01, [1.0, 2.0, 3.0]),
            ["vertical must be a row of 2"],
        ),
        (
            lambda: Motion([0.1, 1j], 0.01),
            ["acceleration has complex samples; all must be real"],
        ),
        (lambda: Motion([0.1, 1.0], 0.01, MASKED), ["vertical has masked samples"]),
    ],
)
def test_refusals(call, parts):
    refused(call, *parts)


@pytest.mark.parametrize(
    "motion",
    [
        Motion(wave() * np.pi, 0.01),
        Motion(wave(50), 1.0 / 3.0, vertical=wave(50)),
    ],
)
def test_what_is_stored_comes_back_exactly(tmp_path, motion):
    for name in ("a.npz", "again.npz"):
        store(tmp_path / name, motion)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "again.npz").read_bytes()
    stored = load_stored(tmp_path / "a.npz", dt=motion.dt)
    assert np.array_equal(motion.acceleration, stored.acceleration)
    assert (stored.vertical is None) == (motion.vertical is None)
    assert motion.vertical is None or np.array_equal(motion.vertical, stored.vertical)


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda path: None, "No such file"),
        (lambda path: path.write_text("something else"), "not a motion stored"),
        (lambda path: np.savez(path, x=np.zeros(3)), "not a motion stored"),
    ],
)
def test_a_damaged_file(tmp_path, damage, reason):
    damage(tmp_path / "motion.npz")
    with pytest.raises(InputError, match=reason):
        load_stored(tmp_path / "motion.npz", dt=0.01)


def test_flatfile_has_its_columns_and_values(tmp_path):
    facts = {"file": "a.AT2", "event": "Quake, 1999", "Mw": 6.5, "component": "090"}
    known = Motion(wave(), 0.01, id="known", metadata=facts)
    pair = Motion(wave(), 0.01, id="pair", transverse=wave(frequency=3.0))
    table = measure_records([known, pair], periods=[0.1, 1.0])
    assert list(table.columns[:14]) == [
        "record",
        "file",
        "event",
        "station",
        "magnitude",
        "distance_km",
        "vs30_mps",
        "component",
        "scale",
        "dt_s",
        "PGA_g",
        "PGV_cms",
        "PGD_cm",
        "T0.100S",
    ]
    assert table["T1.000S"][0] == pytest.approx(
        measure(known, "Sa(1.0)") / G, rel=1e-12
    )
    write_csv(tmp_path / "flat.csv", [table], float_format="%.6g")
    again = read_flatfile(tmp_path / "flat.csv")
    assert list(again.columns) == list(table.columns)
    assert (again["event"][0], again["component"][0]) == ("Quake, 1999", "090")
    assert again["PGV_cms"].tolist() == pytest.approx(
        table["PGV_cms"].tolist(), rel=1e-5
    )
    with pytest.raises(
        InputError, match=r"0.1001 s must have no more than three decimals"
    ):
        measure_records([], periods=[0.1, 0.1001])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a,b\n1,2\n", "has no column 'record'"),
        ("", "the flatfile cannot be read as CSV"),
        ("record,magnitude\nx,big\n", "could not convert string"),
    ],
)
def test_no_flatfile(tmp_path, text, reason):
    (tmp_path / "flat.csv").write_text(text)
    with pytest.raises(InputError, match=reason):
        read_flatfile(tmp_path / "flat.csv")


LONG = wave(2000)
PEAK = np.abs(LONG).max()
BOW = np.sin(np.linspace(0.0, 2.0 * np.pi, 2000))


@pytest.mark.parametrize(
    ("samples", "parts"),
    [
        (LONG, []),
        (
            LONG + 0.17 * PEAK,
            ["its mean is 0.1", "its velocity at the end is 1 of PGV"],
        ),
        (LONG + 0.005 * PEAK, ["its velocity at the end is 0."]),
        (LONG + 0.05 * BOW, ["its velocity on average is 0."]),
        (
            LONG[:1010],
            ["of its peak within its last 0.3 s: the record ends while it shakes"],
        ),
        (np.append(LONG, LONG[1000:1100]), ["within its last 0.63 s"]),
        (np.sin(np.linspace(0.0, 2.0 * np.pi, 101)), []),
        (np.zeros(100), []),
    ],
)
def test_offset_drift_and_end(samples, parts):
    found = sample_cautions(samples, 0.01)
    assert all(any(part in text for text in found) for part in parts), found
    assert bool(found) == bool(parts), found


def test_inspect_shows_them(tmp_path):
    (tmp_path / "a.AT2").write_text(at2_text(0.1 * (LONG + 0.17)))
    (errors,) = (
        channel["errors"] for channel in inspect_record(tmp_path / "a.AT2")["channels"]
    )
    assert errors[0].startswith("its mean is 0.1")


def test_none_for_the_shipped_records():
    for folder in (SHIPPED, SHIPPED / "near_source"):
        for entry in load_index(folder):
            motion = load_motion(entry)
            assert sample_cautions(motion.acceleration, motion.dt) == [], entry.id
            assert "cautions" not in motion.metadata


@needs_real_records
def test_of_real_records_only_that_of_a_film_that_drifts():
    found = set()
    for folder in (
        "cosmos_v1",
        "dmg_v1",
        "dmg_v2",
        "geonet_v1a",
        "knet",
        "mseed",
        "smc",
    ):
        for path in sorted((REAL_RECORDS / folder).iterdir()):
            for motion in read_horizontals(path) if path.suffix != ".xml" else ():
                assert "cautions" not in motion.metadata
                if sample_cautions(motion.acceleration, motion.dt):
                    found.add(motion.id)
    assert found == {"LA116TH:360"}


def test_measures_of_several_motions_are_those_of_each():
    """To the last bit, whatever stands beside a motion: unlike sizes, lengths and time steps."""
    motions = [
        Motion(size * noise(count, count), step, id=str(count))
        for size, count, step in (
            (1.0, 300, 0.01),
            (1e-4, 900, 0.01),
            (5.0, 40, 0.01),
            (1.0, 500, 0.02),
            (0.0, 9, 0.02),
            (2.0, 700, 0.02),
            (3.0, 60, 0.005),
        )
    ]
    names = (*COMPARED, "Sa(0.05)")
    each = [{name: measure(motion, name) for name in names} for motion in motions]
    assert measures_of(motions, names) == each
    assert measures_of(motions, ("PGA",))[1] == {"PGA": motions[1].pga}
