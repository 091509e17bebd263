"""Every real record that lies beside the repository, against the measures in its manifest."""

import obspy
import pytest

from archfrag.motions.formats.columns import Columns
from archfrag.motions.measures import measure
from archfrag.motions.process import bandpass
from archfrag.motions.read import read_motion

from .helpers import REAL_RECORDS, manifest, pga

G = 9.80665
ROWS = [*manifest(), *manifest("manifest_p695.csv")]


def motion_of(row):
    """The motion of a row, by the number of its channel in the file."""
    path = REAL_RECORDS / row["file"]
    if "processing_level" not in row:
        return read_motion(path, "g", columns=Columns(time=1, acceleration=2))
    trace = obspy.read(str(path))[int(row["channel_index"])]
    return read_motion(path, component=trace.id)


@pytest.mark.skipif(not ROWS, reason="the real records of ../shared/records are not there")
@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['file']}-{row.get('channel_index')}")
def test_measures(row):
    motion = motion_of(row)
    form = row.get("format", "columns").upper()
    assert motion.metadata["format"] in (form, *form.split("_"))
    raw = row.get("processing_level") == "raw"
    assert not motion.metadata.get("accepted")
    assert motion.metadata.get("level", "") in (("raw", "") if raw else ("processed", ""))
    assert motion.dt == pytest.approx(float(row["dt_s"]), rel=1e-9)
    assert motion.acceleration.size == pytest.approx(int(row["npts"]), abs=1)
    # The manifest rounds to 1e-4 g and 0.01 cm/s, which is more than 0.1 and 2 % of weak ones.
    assert pga(motion) / G == pytest.approx(float(row["PGA_g"]), rel=1e-3, abs=5.5e-5)
    velocity = measure(bandpass(motion, 0.1, 25.0) if raw else motion, "PGV")
    assert 100 * velocity == pytest.approx(float(row["PGV_cms"]), rel=0.02, abs=5.5e-3)
    # The manifest has the total acceleration at samples, up to 4 % below the pseudo-acceleration.
    for period, key in ((0.2, "Sa_0p2_g"), (1.0, "Sa_1p0_g")):
        expected = pytest.approx(float(row[key]), rel=0.05, abs=5.5e-5)
        assert measure(motion, f"Sa({period})") / G == expected
