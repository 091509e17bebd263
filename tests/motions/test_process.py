"""What each step of processing does to a motion."""

import numpy as np
import pytest
import scipy.signal
from scipy.signal import detrend

from archfrag.errors import RecordError
from archfrag.motions import process
from archfrag.motions.channel import azimuth_of_code
from archfrag.motions.measures import integral
from archfrag.motions.motion import Motion
from archfrag.motions.process import remove_response, rotate
from archfrag.motions.read import read_motion

from .helpers import REAL_RECORDS, needs_real_records, refused, wave


def pair(**metadata):
    return Motion(
        wave(), 0.01, transverse=2.0 * wave(frequency=3.0), metadata=metadata, id="m"
    )


def test_without_its_mean_and_its_line_as_by_scipy():
    samples = np.random.default_rng(0).standard_normal(3000) + np.linspace(
        -3.0, 5.0, 3000
    )
    assert abs(process.demean(Motion(samples, 0.01)).acceleration.mean()) < 1e-12
    motion = process.detrend(Motion(samples, 0.01, vertical=-samples))
    assert np.allclose(motion.acceleration, detrend(samples), rtol=0, atol=1e-11)
    assert np.allclose(motion.vertical, -motion.acceleration, rtol=0, atol=1e-11)


def test_baseline_takes_off_a_drift_of_its_order():
    motion = process.baseline(Motion(0.02 + 1e-5 * np.arange(4000), 0.01), order=2)
    assert np.abs(motion.acceleration).max() < 1e-6
    assert np.abs(integral(motion.acceleration, motion.dt)).max() < 1e-5


def test_taper():
    left = process.taper(
        Motion(np.ones(100), 0.01), fraction=0.1, side="left"
    ).acceleration
    assert left[[0, 5, 10, 99]] == pytest.approx([0.0, 0.5, 1.0, 1.0])


@pytest.mark.parametrize("causal", [False, True])
def test_bandpass_leaves_at_its_corners_what_one_or_two_passes_do(causal):
    impulse = np.zeros(20_001)
    impulse[10_000] = 1.0
    found = process.bandpass(
        Motion(impulse, 0.01), 0.5, 20.0, causal=causal
    ).acceleration
    gain = np.abs(np.fft.rfft(found))
    at = np.interp([0.05, 0.5, 3.0, 20.0], np.fft.rfftfreq(found.size, 0.01), gain)
    corner = 0.707 if causal else 0.5
    assert at == pytest.approx([0.0, corner, 1.0, corner], abs=2e-3)
    assert found[:10_000].any() != causal
    assert np.allclose(found, found[::-1], rtol=0, atol=1e-6) != causal
    short = process.bandpass(
        Motion(impulse[9_990:10_010], 0.01), 0.5, 20.0, causal=causal
    )
    assert short.acceleration.size == 20 + (not causal) * 2 * 600
    assert (found.size > 20_001) != causal


@pytest.mark.parametrize("order", [2, 4, 8])
def test_what_a_bandpass_spreads_beyond_the_record_stays(order):
    # A raw record that drifts a little: with ten times the zeros nothing changes.
    time = np.arange(3000) * 0.01
    raw = np.sin(9.0 * time) * np.exp(-0.2 * (time - 8.0) ** 2) + 0.02 * np.sin(
        0.15 * time
    )
    motion = Motion(
        raw, 0.01, id="raw", metadata={"start_time": "2001-01-01T00:01:00Z"}
    )
    found = process.bandpass(motion, 0.2, 20.0, order=order)
    pad = (found.acceleration.size - 3000) // 2
    assert pad == np.ceil(0.75 * order / (0.2 * 0.01))
    assert found.metadata["start_time"].startswith(
        f"2001-01-01T00:00:{60 - 0.01 * pad:04.1f}"
    )
    sections = scipy.signal.butter(
        order, [0.2, 20.0], "bandpass", fs=100.0, output="sos"
    )
    longer = Motion(
        scipy.signal.sosfiltfilt(sections, np.pad(raw, 10 * pad), padlen=0), 0.01
    )
    for name, off in (("PGA", 1e-4), ("PGV", 0.01), ("PGD", 0.02)):
        assert found.measures(name)[name] == pytest.approx(
            longer.measures(name)[name], rel=off
        )


def test_trim():
    motion = process.trim(Motion(np.arange(101.0), 0.01), times=(0.2, 0.5))
    assert np.array_equal(motion.acceleration, np.arange(20.0, 51.0))
    constant = Motion(np.full(1001, 2.0), 0.01)
    for margin, duration in ((0.0, 7.0), (0.5, 8.0)):
        kept = process.trim(constant, (0.1, 0.8), margin=margin)
        assert kept.duration == pytest.approx(duration)
    samples = np.zeros(1001)
    samples[[300, 700]] = 1.0, -2.0
    assert process.trim(Motion(samples, 0.01), (0.0, 1.0)).acceleration.size == 1001
    kept = process.trim(Motion(samples, 0.01), threshold_g=0.09, margin=0.1)
    assert kept.acceleration.size == 421


@pytest.mark.parametrize("dt", [0.005, 0.02, 0.0075])
def test_resampling_keeps_a_sine_that_both_can_hold(dt):
    def packet(time, frequency):
        envelope = np.exp(-(((time - 20.0) / 5.0) ** 2))
        return np.sin(2.0 * np.pi * frequency * time) * envelope

    time = np.arange(4001) * 0.01
    motion = process.resample(Motion(packet(time, 10.0), 0.01), dt)
    assert motion.dt == pytest.approx(dt)
    assert np.abs(motion.acceleration - packet(motion.time, 10.0)).max() < 1e-4
    high = process.resample(Motion(packet(time, 35.0), 0.01), 0.02)
    assert np.abs(high.acceleration).max() < 1e-3


def test_all_components_are_changed_alike_and_nothing_given_is():
    samples = np.random.default_rng(0).standard_normal(500)
    motion = Motion(samples, 0.01, vertical=samples, transverse=samples)
    for step in (
        process.demean,
        process.detrend,
        process.taper,
        process.baseline,
        lambda m: process.bandpass(m, 0.1, 20.0),
        lambda m: process.resample(m, 0.02),
        lambda m: process.trim(m, times=(0.2, 0.5)),
    ):
        changed = step(motion)
        assert len(changed.log) == 1
        assert np.array_equal(changed.vertical, changed.transverse)
        assert all(np.array_equal(part, samples) for part in motion.components.values())


@pytest.mark.parametrize("azimuth", [30.0, 90.0])
@pytest.mark.parametrize(("code", "apart"), [("090", 90.0), ("060", 60.0)])
def test_to_an_azimuth(azimuth, code, apart):
    north = wave()
    east = 2.0 * wave(frequency=3.0)
    direction, apart = np.deg2rad([azimuth, apart])
    facts = {"component": "000", "of_transverse": {"component": code}}
    other = np.cos(apart) * north + np.sin(apart) * east
    rotated = rotate(
        Motion(north, 0.01, transverse=other, metadata=facts), azimuth=azimuth
    )
    expected = np.cos(direction) * north + np.sin(direction) * east
    assert np.allclose(rotated.acceleration, expected, rtol=0, atol=1e-14)
    assert rotated.metadata["azimuth"] == azimuth
    if code == "090":
        by_angle = rotate(pair(), angle=azimuth)
        assert np.allclose(by_angle.acceleration, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("code", "azimuth"),
    [
        ("E", 90.0),
        ("NS2", 0.0),
        ("HNN", 0.0),
        ("270", 270.0),
        ("360", 0.0),
        ("N45W", 315.0),
        ("X", None),
        ("H1", None),
        ("HN1", None),
        ("", None),
        ("S30W", 210.0),
    ],
)
def test_azimuth_of_a_code(code, azimuth):
    assert azimuth_of_code(code) == azimuth


ALONE = Motion(wave(), 0.01, id="m")


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda m: process.bandpass(m, 5.0, 1.0), ["m: ", "5.0 and 1.0 Hz", "50 Hz"]),
        (
            lambda m: process.trim(m, times=(-0.1, 0.5)),
            ["m: ", "-0.1 s to 0.5 s", "3.99 s"],
        ),
        (
            lambda m: process.resample(m, 0.00314159265),
            ["0.01 to 0.00314159 s is no ratio"],
        ),
        (
            lambda m: process.trim(m, threshold_g=0.9),
            ["no sample reaches", "8.82598 m/s2"],
        ),
        (lambda m: rotate(m), ["one of azimuth and angle"]),
        (lambda m: rotate(ALONE, angle=1.0), ["m: rotate needs two horizontal"]),
        (lambda m: rotate(pair(component="H1"), azimuth=1.0), ["'H1' is not known"]),
        (
            lambda m: rotate(
                pair(component="000", of_transverse={"component": "180"}), azimuth=1.0
            ),
            ["0 and 180 degrees", "too close to each other"],
        ),
    ],
)
def test_refusals(call, parts):
    refused(lambda: call(pair()), *parts)


@needs_real_records
def test_a_response_is_flat_where_an_accelerometer_is(tmp_path):
    folder = REAL_RECORDS / "mseed"
    path = folder / "CI.CLC..HNE.mseed"
    table = folder / "CI.CLC.xml"
    motion = read_motion(path, inventory=table)
    removed = remove_response(motion, path, table)
    low = [process.bandpass(m, 0.1, 5.0).acceleration for m in (motion, removed)]
    # What is left is the delay of the instrument, some milliseconds.
    assert np.abs(low[1] - low[0]).max() < 0.05 * np.abs(low[0]).max()
    assert removed.log[-1].startswith(
        "Response removed by StationXML (obspy, water level 60"
    )
    for given, reason in (
        (None, "has no StationXML by which to remove its response"),
        (folder / "CI.CCC.xml", r"CI\.CLC\.\.HNE cannot be rem"),
    ):
        with pytest.raises(RecordError, match=reason):
            remove_response(motion, tmp_path / "x.mseed", given)
