"""Cautions on motions by their samples."""

import numpy as np
import pytest

from archfrag.motions.cautions import sample_cautions
from archfrag.motions.index import load_index
from archfrag.motions.read import inspect_record, load_motion, read_horizontals

from .helpers import REAL_RECORDS, SHIPPED, at2_text, needs_real_records, wave

LONG = wave(2000)
PEAK = np.abs(LONG).max()
BOW = np.sin(np.linspace(0.0, 2.0 * np.pi, 2000))


@pytest.mark.parametrize(
    ("samples", "parts"),
    [
        (LONG, []),
        (LONG + 0.17 * PEAK, ["its mean is 0.1", "its velocity at the end is 1 of PGV"]),
        (LONG + 0.005 * PEAK, ["its velocity at the end is 0."]),
        (LONG + 0.05 * BOW, ["its velocity on average is 0."]),
        (LONG[:1010], ["of its peak within its last 0.3 s: the record ends while it shakes"]),
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
    (errors,) = (channel["errors"] for channel in inspect_record(tmp_path / "a.AT2")["channels"])
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
    for folder in ("cosmos_v1", "dmg_v1", "dmg_v2", "geonet_v1a", "knet", "mseed", "smc"):
        for path in sorted((REAL_RECORDS / folder).iterdir()):
            for motion in read_horizontals(path) if path.suffix != ".xml" else ():
                assert "cautions" not in motion.metadata
                if sample_cautions(motion.acceleration, motion.dt):
                    found.add(motion.id)
    assert found == {"LA116TH:360"}
