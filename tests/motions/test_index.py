"""Rows of an index that leave something to the file."""

import numpy as np
import pytest
from obspy import Stream, Trace

from archfrag.errors import RecordError
from archfrag.motions.index import load_index
from archfrag.motions.read import load_motion

from .helpers import at2_text


def test_the_component_listed_is_the_one_read(tmp_path):
    traces = [
        Trace(np.full(50, value) * np.hanning(50), {"channel": code, "delta": 0.01})
        for code, value in (("HNE", 1.0), ("HNN", 2.0))
    ]
    Stream(traces).write(str(tmp_path / "two.mseed"), format="MSEED")
    rows = "id,file,unit,component\na,two.mseed,m/s2,HNN\nb,two.mseed,m/s2,\nc,two.mseed,m/s2,X\n"
    (tmp_path / "selected.csv").write_text(rows)
    named, first, wrong = load_index(tmp_path / "selected.csv")
    assert load_motion(named).acceleration.max() == pytest.approx(2.0, rel=1e-2)
    assert load_motion(first).acceleration.max() == pytest.approx(1.0, rel=1e-2)
    with pytest.raises(RecordError, match=r"there is no horizontal component 'X'"):
        load_motion(wrong)


def test_a_file_with_one_component_may_call_it_otherwise(tmp_path):
    (tmp_path / "one.AT2").write_text(at2_text(np.hanning(50), component="180"))
    (tmp_path / "selected.csv").write_text("id,file,unit,component\na,one.AT2,g,H1\n")
    assert load_motion(load_index(tmp_path / "selected.csv")[0]).metadata["component"] == "H1"


@pytest.mark.parametrize("name", ["index.csv", "selected.csv"])
def test_an_empty_unit_is_never_guessed(tmp_path, name):
    Trace(np.hanning(50), {"channel": "HNE", "delta": 0.01}).write(
        str(tmp_path / "one.mseed"), format="MSEED"
    )
    (tmp_path / "two.AT2").write_text(at2_text(np.hanning(50)))
    (tmp_path / name).write_text("id,file,unit\na,one.mseed,\nb,two.AT2,\n")
    silent, stated = load_index(tmp_path / name)
    with pytest.raises(RecordError, match=r"the file does not state the unit of its samples"):
        load_motion(silent)
    assert load_motion(stated).acceleration.max() == pytest.approx(9.8, rel=1e-2)
