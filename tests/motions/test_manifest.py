"""Every real record that lies beside the repository, against the measures in its manifest."""

import csv

import numpy as np
import obspy
import pytest
from scipy.signal import cont2discrete, lfilter

from archfrag.motions.formats.waveform import OWN, TEXT, recognise
from archfrag.motions.measures import measure, pga
from archfrag.motions.process import bandpass
from archfrag.motions.read import read_motion

from .helpers import REAL_RECORDS, needs_real_records

G = 9.80665
FORMATS = {
    "at2": "AT2", "cosmos_v1": "COSMOS", "dmg_v1": "DMG", "dmg_v2": "DMG", "smc": "SMC",
    "knet": "KNET", "mseed": "MSEED", "esm_dyna": "DYNA", "geonet_v1a": "GEONET",
    "resorce_acc": "RESORCE",
}  # fmt: skip


def rows():
    if not (REAL_RECORDS / "manifest.csv").is_file():
        return []
    with open(REAL_RECORDS / "manifest.csv", newline="") as file:
        return list(csv.DictReader(file))


def named(row):
    return f"{row['file'].split('/')[-1]}-{row['channel_index']}"


def total_acceleration(motion, period, damping=0.05):
    """Largest total acceleration of an oscillator at samples, as the manifest has it [m/s2].

    That of `spectral_acceleration` is the pseudo-acceleration, between samples too: up to 4 %
    above it at 0.2 s.
    """
    rate = 2.0 * np.pi / period
    system = [2.0 * damping * rate, rate**2], [1.0, 2.0 * damping * rate, rate**2]
    numerator, denominator, _ = cont2discrete(system, motion.dt, method="foh")
    return np.abs(lfilter(numerator.ravel(), denominator, motion.acceleration)).max()


def motion_of(row):
    """The motion of a row, by the number of its channel in the file."""
    form = FORMATS[row["format"]]
    if form not in (*OWN, "KNET", "MSEED"):
        pytest.skip(f"the format {form} is not registered")
    path = REAL_RECORDS / row["file"]
    trace = obspy.read(str(path))[int(row["channel_index"])]
    motion = read_motion(path, component=trace.id)
    if form in TEXT:
        assert recognise(str(path), TEXT) == form
        assert motion.metadata["format"] == form
    return motion


@needs_real_records
@pytest.mark.parametrize("row", rows(), ids=named)
def test_measures(row):
    motion = motion_of(row)
    raw = row["processing_level"] == "raw"
    assert not motion.metadata.get("accepted")
    assert motion.metadata.get("level", "") in (("raw", "") if raw else ("processed", ""))
    assert motion.dt == pytest.approx(float(row["dt_s"]), rel=1e-9)
    assert motion.acceleration.size == pytest.approx(int(row["npts"]), abs=1)
    # The manifest rounds to 1e-4 g and 0.01 cm/s, which is more than 0.1 and 2 % of weak ones.
    assert pga(motion) / G == pytest.approx(float(row["PGA_g"]), rel=1e-3, abs=5.5e-5)
    velocity = measure(bandpass(motion, 0.1, 25.0) if raw else motion, "PGV")
    assert 100 * velocity == pytest.approx(float(row["PGV_cms"]), rel=0.02, abs=5.5e-3)
    for period, key in ((0.2, "Sa_0p2_g"), (1.0, "Sa_1p0_g")):
        assert total_acceleration(motion, period) / G == pytest.approx(
            float(row[key]), rel=0.02, abs=5.5e-5
        )
