"""PEER AT2 as a waveform plug-in of obspy."""

import io

import numpy as np
import obspy
import pytest
from obspy import Stream, Trace

from archfrag.errors import RecordError
from archfrag.motions.formats.keyed import is_at2, read_at2

from .helpers import FOURTH_LINES, REAL_RECORDS, at2_text, needs_real_records, real_rows

SAMPLES = np.array([0.1234567, -0.02, 3e-7, 0.0, 0.25, -0.3333333, 0.01])


def write(folder, text, name="record.AT2"):
    path = folder / name
    path.write_bytes(text.encode("latin-1"))
    return path


class TestReading:
    @pytest.mark.parametrize("fourth", FOURTH_LINES)
    @pytest.mark.parametrize("end", ["\n", "\r\n"])
    def test_headers_of_every_age(self, tmp_path, fourth, end):
        path = write(tmp_path, at2_text(SAMPLES, 0.005, fourth=fourth, end=end))
        for stream in (obspy.read(str(path)), obspy.read(str(path), format="AT2")):
            trace = stream[0]
            assert trace.stats._format == "AT2"
            assert trace.stats.delta == 0.005
            assert np.allclose(trace.data, SAMPLES, rtol=1e-7, atol=0)

    def test_samples_stay_in_the_unit_of_the_file_and_calib_is_one(self, tmp_path):
        path = write(tmp_path, at2_text(SAMPLES))
        plain = obspy.read(str(path))[0]
        applied = obspy.read(str(path), apply_calib=True)[0]
        assert plain.stats.record.unit == "g"
        assert plain.stats.calib == 1.0
        assert np.array_equal(plain.data, applied.data)

    def test_event_station_and_component_are_kept(self, tmp_path):
        details = obspy.read(str(write(tmp_path, at2_text(SAMPLES))))[0].stats.record
        assert details.event == "Imperial Valley-02"
        assert details.date == "5/19/1940"
        assert details.station == "El Centro Array #9"
        assert details.component == "180"

    def test_station_of_an_older_header(self, tmp_path):
        text = at2_text(SAMPLES).replace(
            "Imperial Valley-02, 5/19/1940, El Centro Array #9, 180",
            "CAPE MENDOCINO 04/25/92 1806, RIO DELL OVERPASS FF, 270 (CDMG STATION 89324)",
        )
        details = read_at2(write(tmp_path, text))[0].stats.record
        assert (details.event, details.station) == (
            "CAPE MENDOCINO 04/25/92 1806",
            "RIO DELL OVERPASS FF",
        )
        assert details.component == "270"

    def test_lower_case_ending_and_no_last_newline(self, tmp_path):
        path = write(tmp_path, at2_text(SAMPLES).rstrip("\n"), "record.at2")
        assert obspy.read(str(path))[0].stats.npts == SAMPLES.size

    def test_open_buffer(self):
        buffer = io.BytesIO(at2_text(SAMPLES).encode())
        assert is_at2(buffer)
        assert obspy.read(buffer)[0].stats.npts == SAMPLES.size

    @pytest.mark.parametrize(
        ("row", "expected"),
        [
            ("-.1234567E-03-.2345678E-02 .5000000E+00", [-1.234567e-4, -2.345678e-3, 0.5]),
            ("0.1000000E-030.2000000E-02-0.300000E-01", [1e-4, 2e-3, -0.03]),
            ("  .1000000D-01  .2000000d+00  -.300000D-02", [0.01, 0.2, -0.003]),
            ("-0.001234-0.002345 0.003456", [-0.001234, -0.002345, 0.003456]),
            ("1.0E-003 2.0E-003 3.0E-003", [1e-3, 2e-3, 3e-3]),
        ],
    )
    def test_numbers_that_run_together(self, tmp_path, row, expected):
        header = at2_text(SAMPLES, count=3).splitlines()[:4]
        path = write(tmp_path, "\n".join([*header, row]))
        assert np.array_equal(read_at2(path)[0].data, expected)

    @needs_real_records
    @pytest.mark.parametrize("row", real_rows("at2"), ids=lambda row: row["file"])
    def test_real_files(self, row):
        trace = obspy.read(str(REAL_RECORDS / row["file"]))[0]
        assert trace.stats._format == "AT2"
        assert trace.stats.npts == int(row["npts"])
        assert trace.stats.delta == pytest.approx(float(row["dt_s"]), rel=1e-12)
        assert abs(trace.data).max() == pytest.approx(float(row["PGA_g"]), rel=1e-3)


class TestOtherFormats:
    @pytest.mark.parametrize("form", ["MSEED", "SAC", "GSE2", "SLIST", "TSPAIR", "WAV"])
    def test_are_not_claimed(self, tmp_path, form):
        path = tmp_path / f"other.{form.lower()}"
        trace = Trace(np.arange(50, dtype=np.int32), header={"station": "A", "channel": "HNE"})
        Stream([trace]).write(str(path), format=form)
        assert not is_at2(path)
        assert obspy.read(str(path))[0].stats._format == form

    @pytest.mark.parametrize(
        "text",
        [
            "",
            "one line",
            at2_text(SAMPLES).replace("ACCELERATION TIME SERIES IN UNITS OF G",
                                      "VELOCITY TIME SERIES IN UNITS OF CM/S"),
            at2_text(SAMPLES).replace("NPTS", "N"),
            "\n".join(["text"] * 10),
        ],
        ids=["empty", "short", "velocity", "no count", "prose"],
    )  # fmt: skip
    def test_neither_is_other_text(self, tmp_path, text):
        assert not is_at2(write(tmp_path, text))

    def test_nor_a_file_that_is_not_there(self, tmp_path):
        assert not is_at2(tmp_path / "missing.AT2")

    @needs_real_records
    def test_nor_any_real_file_of_another_format(self):
        others = [p for p in REAL_RECORDS.rglob("*") if p.is_file() and p.parent.name != "at2"]
        assert len(others) > 50
        assert [p.name for p in others if is_at2(p)] == []


GOOD = at2_text(SAMPLES)
BAD = {
    "header only": ("\n".join(GOOD.splitlines()[:4]), r"ends after 4 line\(s\)$"),
    "empty": ("", r"the file is empty$"),
    "unknown unit": (
        at2_text(SAMPLES, unit="FURLONGS"),
        r"line 3: unknown unit 'FURLONGS' of acceleration; allowed are m/s2, cm/s2, gal, mm/s2",
    ),
    "no unit": (GOOD.replace(" IN UNITS OF G", ""), r"line 3: unknown unit 'none'"),
    "velocity": (GOOD.replace("ACCELERATION", "VELOCITY"), r"line 3: an acceleration is needed"),
    "zero dt": (at2_text(SAMPLES, dt=0.0), r"line 4: time step 0 s must be a positive"),
    "negative dt": (at2_text(SAMPLES, dt=-0.01), r"line 4: time step -0.01 s must be"),
    "no samples announced": (at2_text(SAMPLES, count=0), r"line 4: '0' samples are"),
    "no count": (GOOD.replace("NPTS", "N"), r"line 4: .* \(NPTS\)"),
    "not a number": (GOOD.replace("3.0000000E-07", "   spoiled"), r"line 5: 'spoiled' is not"),
    "nan": (GOOD.replace("1.0000000E-02", "          NaN"), r"line 6: 'NaN' is not a finite"),
    "overflow": (GOOD.replace("1.0000000E-02", "1.0E+999"), r"line 6: '1.0E\+999' is not"),
    "stars": (GOOD.replace("-2.0000000E-02", "*" * 14), r"line 5: '\*{14}' is not a number$"),
    "run together without a seam": (
        at2_text(SAMPLES[:2]).replace("  1.2345670E-01 -2.0000000E-02", "0.0012340.002345"),
        r"line 5: '0.0012340.002345' is not a number$",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_file_gives_one_sentence_with_its_name(tmp_path, case):
    text, sentence = BAD[case]
    path = write(tmp_path, text, "spoiled.AT2")
    with pytest.raises(RecordError, match=sentence) as caught:
        obspy.read(str(path), format="AT2")
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
