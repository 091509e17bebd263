"""Formats of agencies: ESM and ITACA, GeoNet, RESORCE, K-NET and KiK-net."""

import io
import warnings
from pathlib import Path

import numpy as np
import obspy
import pytest
from obspy.core.util.base import ENTRY_POINTS

import archfrag as af
from archfrag.errors import RecordError
from archfrag.motions.formats.blocks import is_geonet, read_geonet
from archfrag.motions.formats.keyed import is_dyna, is_resorce, read_dyna, read_knet, read_resorce
from archfrag.motions.formats.text import numbers
from archfrag.motions.measures import measure, pga, spectral_acceleration
from archfrag.motions.process import bandpass
from archfrag.motions.read import read_motion, read_motions

from .helpers import REAL_RECORDS, needs_real_records, real_rows, wave
from .layouts import KIKNET, dyna_text, geonet_text, itaca_text, kiknet_text, resorce_text

G = 9.80665
SAMPLES = np.round(200.0 * wave(), 1)
THREE = {"S16W": SAMPLES, "S74E": -0.5 * SAMPLES, "Up": 0.25 * SAMPLES}
GOOD = {
    "a.ASC": (dyna_text(SAMPLES), is_dyna, read_dyna, "DYNA"),
    "a.DAT": (itaca_text(SAMPLES), is_dyna, read_dyna, "DYNA"),
    "a.V1A": (geonet_text(THREE), is_geonet, read_geonet, "GEONET"),
    "a.V2A": (geonet_text(THREE, level="processed"), is_geonet, read_geonet, "GEONET"),
    "a.acc": (resorce_text(SAMPLES / 100.0), is_resorce, read_resorce, "RESORCE"),
}


def write(folder, text, name):
    path = folder / name
    path.write_bytes(text.encode("latin-1"))
    return path


@pytest.mark.parametrize("name", GOOD)
class TestEachFormat:
    @pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
    def test_as_a_plug_in_of_obspy(self, tmp_path, name, end):
        text, _, _, form = GOOD[name]
        stream = obspy.read(str(write(tmp_path, text.replace("\n", end), name)))
        assert {trace.stats._format for trace in stream} == {form}
        assert [trace.stats.calib for trace in stream] == [1.0] * len(stream)
        factor = 0.01 if name == "a.acc" else 1.0
        assert np.allclose(stream[0].data, SAMPLES * factor, atol=1e-9)
        record = stream[0].stats.record
        assert (record.announced, record.vertical, "faults" in record) == (400, False, False)
        assert stream[0].stats.delta == 0.005

    def test_open_buffer(self, name):
        text, is_format, _, form = GOOD[name]
        buffer = io.BytesIO(text.encode())
        assert is_format(buffer)
        assert obspy.read(buffer)[0].stats._format == form

    def test_tabs_mixed_line_ends_and_no_last_one(self, tmp_path, name):
        text, _, read, _ = GOOD[name]
        head, samples = text[: len(text) // 2], text[len(text) // 2 :]
        changed = head.replace("\n", "\r\n") + samples.rstrip("\n")
        if name in ("a.ASC", "a.DAT"):
            changed = changed.replace(": ", ":\t").replace("     ", "\t")
        for trace, plain in zip(
            read(write(tmp_path, changed, name)), read(io.BytesIO(text.encode()))
        ):
            assert np.array_equal(trace.data, plain.data)

    def test_what_is_not_finite_or_no_number(self, tmp_path, name):
        text, _, read, _ = GOOD[name]
        lines = text.splitlines()
        number = len(lines) - 1
        for word, kind in (("NaN", "finite "), ("-inf", "finite "), ("1_0", ""), ("*****", "")):
            spoiled = "\n".join([*lines[: number - 1], f"   {word}", *lines[number:]])
            with pytest.raises(RecordError) as caught:
                read(write(tmp_path, spoiled, name))
            assert str(caught.value) == (
                f"{tmp_path / name}, line {number}: {word!r} is not a {kind}number"
            )

    def test_cut_anywhere(self, tmp_path, name):
        text = GOOD[name][0]
        path = tmp_path / name
        for end in range(0, len(text) - 30, 211):
            path.write_text(text[:end])
            with pytest.raises(RecordError) as caught:
                read_motions(path)
            assert str(caught.value).startswith(str(path))
            assert "\n" not in str(caught.value)

    def test_other_formats_and_prose_are_not_claimed(self, tmp_path, name):
        is_format = GOOD[name][1]
        others = [text for text, other, _, _ in GOOD.values() if other is not is_format]
        others += ["", "\n", "EVENT", "Corrected accelerogram\nSite A\n", "x\n" * 50]
        assert not any(is_format(io.BytesIO(text.encode())) for text in others)
        assert not is_format(tmp_path / "missing")


def test_nothing_of_obspys_own_test_data_is_claimed():
    files = [p for p in Path(obspy.__file__).parent.rglob("tests/data/**/*") if p.is_file()]
    if len(files) < 500:
        pytest.skip("obspy's test data is not installed")
    claimed = [p for p in files if is_dyna(p) or is_geonet(p) or is_resorce(p)]
    assert claimed == []
    assert {"DYNA", "GEONET", "RESORCE"} <= set(ENTRY_POINTS["waveform"])


@pytest.mark.parametrize(
    ("line", "width", "expected"),
    [
        ("-1.3724600E-07-2.6835700E-07 3.5E-01", None, [-1.37246e-7, -2.68357e-7, 0.35]),
        (" .1000D-01\t-.2d+00", None, [0.01, -0.2]),
        ("1000.5001001.500-100.000", 8, [1000.5, 1001.5, -100.0]),
        ("  0.1D+1        -0.2D+1 ", 8, [1.0, -2.0]),
    ],
)
def test_numbers_that_run_together_and_fortrans_exponents(line, width, expected):
    assert numbers([line], 1, "a", width=width).tolist() == expected


class TestDyna:
    def test_what_the_header_says(self):
        stats = read_dyna(io.BytesIO(dyna_text(SAMPLES).encode()))[0].stats
        record = dict(stats.record)
        assert record.pop("header").startswith("EVENT_NAME: NOWHERE\nEVENT_ID")
        assert (stats.station, stats.network) == ("ABC", "XX")
        assert stats.starttime == obspy.UTCDateTime(2001, 2, 3, 4, 5, 10, 250000)
        assert record == {
            "unit": "cm/s2", "level": "processed", "announced": 400, "event": "NOWHERE",
            "date": "2001-02-03", "magnitude": 5.1, "depth_km": 8.5, "event_latitude": 41.5,
            "event_longitude": -13.25, "station": "ABC", "station_latitude": 41.6,
            "station_longitude": -13.3, "vs30_mps": 420.0, "epicentral_km": 12.3,
            "component": "HNE", "azimuth": 90.0, "vertical": False
        }  # fmt: skip

    def test_the_header_of_itaca_1(self):
        record = read_dyna(io.BytesIO(itaca_text(SAMPLES).encode()))[0].stats.record
        assert (record.component, record.azimuth, record.level) == ("WE", 90.0, "raw")
        assert (record.magnitude, record.vs30_mps, record.date) == (5.2, 610.0, "1999-04-05")
        upward = read_dyna(io.BytesIO(itaca_text(SAMPLES, "UP").encode()))[0].stats.record
        assert upward.vertical
        assert "azimuth" not in upward

    def test_dates_of_afad(self):
        text = dyna_text(
            SAMPLES,
            event_date_yyyymmdd="2001/02/03",
            date_time_first_sample_yyyymmdd_hhmmss="03/02/2001 04:05:10.300",
            low_cut_frequency_hz="",
            high_cut_frequency_hz="",
        )
        stats = read_dyna(io.BytesIO(text.encode()))[0].stats
        assert (stats.record.date, "level" in stats.record) == ("2001-02-03", False)
        assert stats.starttime == obspy.UTCDateTime(2001, 2, 3, 4, 5, 10, 300000)

    @pytest.mark.parametrize(("kept", "left"), [(1, 0), (2, 1)])
    def test_cut_after_the_first_samples(self, tmp_path, kept, left):
        lines = dyna_text(SAMPLES).splitlines()
        path = write(tmp_path, "\n".join(lines[: len(lines) - 400 + kept]), "a.ASC")
        sentence = rf"a\.ASC: channel XX\.ABC\.\.HNE holds {left} sample\(s\) that can be used; 2"
        with pytest.raises(RecordError, match=sentence):
            read_motion(path, accept=["samples", "pga", "header"])

    def test_names_in_other_alphabets(self, tmp_path):
        text = dyna_text(SAMPLES, event_name="Åland, Αθήνα")
        (tmp_path / "a.ASC").write_text(text, encoding="utf-8")
        assert read_motion(tmp_path / "a.ASC").metadata["event"] == "Åland, Αθήνα"

    def test_as_a_motion(self, tmp_path):
        motion = read_motion(write(tmp_path, dyna_text(SAMPLES), "a.ASC"))
        assert pga(motion) == pytest.approx(np.abs(SAMPLES).max() / 100.0)
        assert motion.metadata["unit_in_file"] == "cm/s2"
        assert motion.metadata["station"] == "ABC"
        assert any("unit cm/s2 from the DYNA header" in step for step in motion.log)

    @pytest.mark.parametrize(
        ("changes", "sentence"),
        [
            ({"unit": "cm/s"}, r"line 22: unknown unit 'cm/s' of acceleration; allowed are m/s2"),
            ({"data_type": "VELOCITY"}, r"line 27: an acceleration is needed, this is 'VELOCITY'"),
            ({"units": None}, r"a\.ASC: the header gives no UNITS$"),
            ({"ndata": ""}, r"line 20: the header gives no NDATA$"),
            ({"ndata": "-5"}, r"line 20: '-5' samples are announced; a record has 2 to"),
            ({"ndata": "1e99"}, r"line 20: '1e99' samples are announced; a record has 2"),
            ({"sampling_interval_s": "0"}, r"line 19: time step 0 s must be a positive number"),
            ({"sampling_interval_s": "nan"}, r"line 19: time step nan s must be a positive"),
            ({"user5": "\nUSER5: "}, r"line 29: USER5 is there a second time$"),
            ({"user5": "\nspoiled"}, r"line 29: 'spoiled' is not a number$"),
            ({"count": 500}, r"announces 500 samples of channel HNE, the file holds only 400; to"),
        ],
    )
    def test_bad_headers(self, tmp_path, changes, sentence):
        path = write(tmp_path, dyna_text(SAMPLES, **changes), "a.ASC")
        with pytest.raises(RecordError, match=sentence) as caught:
            read_motion(path)
        assert str(caught.value).startswith(str(path))


class TestGeonet:
    def test_what_the_header_says(self):
        stream = read_geonet(io.BytesIO(GOOD["a.V1A"][0].encode()))
        records = [dict(trace.stats.record) for trace in stream]
        assert [r["component"] for r in records] == ["S16W", "S74E", "Up"]
        assert [r.get("azimuth") for r in records] == [196.0, 106.0, None]
        assert [r["vertical"] for r in records] == [False, False, True]
        stats = stream[0].stats
        assert stats.starttime == obspy.UTCDateTime(2001, 2, 3, 4, 4, 57, 250000)
        first = records[0]
        assert first.pop("header").count("\n") == 25
        assert first == {
            "unit": "mm/s2", "level": "raw", "announced": 400, "component": "S16W",
            "vertical": False, "azimuth": 196.0, "event": "10 km east of Nowhere",
            "date": "2001-02-03", "magnitude": 6.25, "depth_km": 9.0, "event_latitude": -41.6,
            "event_longitude": -172.5, "station": "ABCD", "station_latitude": -41.5,
            "station_longitude": 172.25, "epicentral_km": 21.0
        }  # fmt: skip

    @pytest.mark.parametrize("name", ["a.V1A", "a.V2A"])
    def test_three_components_of_one_instrument(self, tmp_path, name):
        one, two = read_motions(write(tmp_path, GOOD[name][0], name))
        assert (one.id, two.id) == ("a:S16W", "a:S74E")
        for motion, factor in ((one, 1.0), (two, -0.5)):
            assert np.allclose(motion.acceleration, factor * SAMPLES / 1000.0, atol=1e-4)
            assert np.allclose(motion.vertical, 0.25 * SAMPLES / 1000.0, atol=1e-4)
            assert motion.metadata["vertical_component"] == "Up"

    def test_processed_and_raw_volumes_are_told_apart(self):
        levels = [
            read_geonet(io.BytesIO(GOOD[name][0].encode()))[0].stats.record.level
            for name in ("a.V1A", "a.V2A")
        ]
        assert levels == ["raw", "processed"]

    @pytest.mark.parametrize(
        ("component", "azimuth"),
        [("N10E", 10.0), ("N80W", 280.0), ("S00W", 180.0), ("S90E", 90.0), ("N00E", 0.0)],
    )
    def test_bearings(self, component, azimuth):
        text = geonet_text({component: SAMPLES})
        assert read_geonet(io.BytesIO(text.encode()))[0].stats.record.azimuth == azimuth

    def test_a_line_missing_in_a_processed_volume(self, tmp_path):
        lines = GOOD["a.V2A"][0].splitlines()
        path = write(tmp_path, "\n".join(lines[:40] + lines[41:]), "a.V2A")
        sentence = (
            r"channel S16W must hold 400 accelerations, 400 velocities and 400 displacements by "
            r"its header; it holds 1190 numbers$"
        )
        with pytest.raises(RecordError, match=sentence):
            read_motions(path)

    def test_unequal_channels(self, tmp_path):
        text = geonet_text({"N00E": SAMPLES, "N90E": SAMPLES[:-3], "Up": SAMPLES})
        motions = read_motions(write(tmp_path, text, "a.V1A"))
        said = (
            "Fault: the channels of the file have unequal numbers of samples "
            "(N00E 400, N90E 397, Up 400)."
        )
        assert all(said in motion.log for motion in motions)
        assert motions[1].acceleration.size == 397

    def test_too_few_samples(self, tmp_path):
        path = write(tmp_path, geonet_text({"N00E": SAMPLES}, count=500), "a.V1A")
        with pytest.raises(
            RecordError, match="announces 500 samples of channel N00E, the file ho"
        ):
            read_motions(path)
        assert read_motions(path, accept=["samples"])[0].acceleration.size == 400

    def test_a_header_that_is_cut_off(self, tmp_path):
        lines = GOOD["a.V1A"][0].splitlines()
        path = write(tmp_path, "\n".join(lines[:90]), "a.V1A")
        with pytest.raises(RecordError, match=r"line 67: a component has 26 header lines and the"):
            read_motions(path)


class TestResorce:
    def test_what_the_header_says(self):
        stats = read_resorce(io.BytesIO(GOOD["a.acc"][0].encode()))[0].stats
        record = dict(stats.record)
        assert record.pop("header").count("\n") == 9
        assert stats.station == "1234"
        assert record == {
            "unit": "m/s2", "level": "processed", "announced": 400, "component": "NS",
            "vertical": False, "azimuth": 0.0, "date": "2001-02-03",
            "station": "Some - Where, Nowhere"
        }  # fmt: skip

    @pytest.mark.parametrize(
        ("old", "new", "sentence"),
        [
            (
                "Accelaration",
                "Velocity",
                r"line 10: an acceleration is needed, this is 'Velocity'",
            ),
            ("in m/s/s", "in cm/s", r"line 10: unknown unit 'cm/s' of acceleration"),
            (": 400", ": 4x", r"Number of Data: '4x' samples are announced; a record has"),
            (": 0.005", ": -1", r"Time Increment: time step -1 s must be a positive number"),
            (": 400", ": 500", r"announces 500 samples of channel NS, the file holds only 400"),
        ],
    )
    def test_bad_headers(self, tmp_path, old, new, sentence):
        path = write(tmp_path, GOOD["a.acc"][0].replace(old, new), "a.acc")
        with pytest.raises(RecordError, match=sentence):
            read_motion(path)


class TestKiknet:
    COUNTS = np.round(1e5 * wave()).astype(int)

    @pytest.mark.parametrize("channel", KIKNET)
    def test_channels_and_sensors(self, tmp_path, channel):
        path = write(tmp_path, kiknet_text(self.COUNTS, channel), f"ABCH01.{channel}")
        (trace,) = read_knet(path)
        record = trace.stats.record
        assert (trace.stats.channel, record.component) == (channel, channel)
        assert record.sensor == ("borehole" if channel.endswith("1") else "surface")
        assert record.vertical == channel.startswith("UD")
        assert record.get("azimuth") == {"N": 0.0, "E": 90.0}.get(channel[0])
        assert "faults" not in record
        assert (record.level, record.magnitude, record.date) == ("raw", 5.4, "2011-06-30")

    def test_a_borehole_is_named_in_the_log(self, tmp_path):
        for channel, said in (("EW1", True), ("EW2", False)):
            path = write(tmp_path, kiknet_text(self.COUNTS, channel), f"ABCH01.{channel}")
            motion = read_motion(path)
            assert motion.id == f"ABCH01.{channel}"
            sentence = f"Channel {channel} is in the borehole, not at the surface."
            assert (sentence in motion.log) == said
            assert pga(motion) == pytest.approx(0.2384, rel=1e-2)

    def test_vertical_of_the_same_sensor(self, tmp_path):
        paths = {
            channel: write(tmp_path, kiknet_text(self.COUNTS, channel), f"a.{channel}")
            for channel in KIKNET
        }
        motion = read_motion(paths["EW2"], vertical=paths["UD2"])
        assert motion.metadata["vertical_component"] == "UD2"

    def test_a_peak_that_contradicts_the_counts(self, tmp_path):
        path = write(tmp_path, kiknet_text(self.COUNTS, "EW2", peak=23.0), "a.EW2")
        assert any("the header states a peak of 23 gal" in step for step in read_motion(path).log)

    def test_a_header_without_its_end(self, tmp_path):
        text = kiknet_text(self.COUNTS, "EW2").replace("Memo.", "Memx.")
        with pytest.raises(RecordError, match=r"a\.EW2: "):
            read_motion(write(tmp_path, text, "a.EW2"))


MAKERS = {
    "a.ASC": lambda x, peak: dyna_text(x, peak=peak),
    "a.V1A": lambda x, peak: geonet_text({"N00E": x}, peak=peak),
    "a.acc": lambda x, peak: resorce_text(x, peak=peak),
}


class TestHiddenFaults:
    @pytest.mark.parametrize("name", MAKERS)
    def test_a_peak_that_contradicts_the_samples(self, tmp_path, name):
        peak = float(np.abs(SAMPLES).max())
        scaled = SAMPLES / (100.0 if name == "a.acc" else 1.0)
        peak = float(np.abs(scaled).max())
        for factor, said in ((1.0, False), (1.005, False), (-1.0, False), (1.02, True)):
            path = write(tmp_path, MAKERS[name](scaled, factor * peak), name)
            log = read_motion(path).log
            assert any("the header states a peak of" in step for step in log) == said

    @pytest.mark.parametrize("name", MAKERS)
    def test_an_offset_larger_than_the_motion(self, tmp_path, name):
        for offset, said in ((0.0, False), (0.5, False), (1.2, True)):
            samples = SAMPLES + np.round(offset * np.abs(SAMPLES).max(), 1)
            path = write(tmp_path, MAKERS[name](samples / 100.0, None), name)
            assert (
                any("the offset of the samples" in step for step in read_motion(path).log) == said
            )

    def test_they_survive_the_process_that_reads_large_files(self, tmp_path, monkeypatch):
        monkeypatch.setattr("archfrag.motions.channels._LARGE", 100)
        path = write(tmp_path, geonet_text({"S16W": SAMPLES}, peak=208.0), "a.V1A")
        motion = read_motions(path)[0]
        assert any("the header states a peak of 208 mm/s2" in step for step in motion.log)
        assert (motion.metadata["station"], motion.metadata["component"]) == ("ABCD", "S16W")


KINDS = ("esm_dyna", "geonet_v1a", "resorce_acc", "knet")
ROWS = [row for kind in KINDS for row in real_rows(kind)]


@needs_real_records
class TestRealRecords:
    """Against the manifest, which rounds to 1e-4 g, 0.01 cm/s and 1e-4 m/s."""

    @pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['file']}:{row['component']}")
    def test_measures(self, row):
        motions = read_motions(REAL_RECORDS / row["file"])
        motion = motions[int(row["channel_index"])]
        assert motion.acceleration.size == int(row["npts"])
        assert motion.dt == float(row["dt_s"])
        raw = row["processing_level"] == "raw"
        if raw:
            held = motion.acceleration
            motion = af.Motion(held - held.mean(), motion.dt)
        assert pga(motion) / G == pytest.approx(float(row["PGA_g"]), rel=1e-3, abs=5.1e-5)
        filtered = bandpass(motion, 0.1, 25.0) if raw else motion
        velocity = 100.0 * measure(filtered, "PGV")
        assert velocity == pytest.approx(float(row["PGV_cms"]), rel=2e-2, abs=5.1e-3)
        assert measure(motion, "D5_95") == pytest.approx(float(row["D5_95_s"]), abs=0.011)
        for value, key in zip(spectral_acceleration(motion, (0.2, 1.0)), ("0p2", "1p0")):
            assert value / G == pytest.approx(float(row[f"Sa_{key}_g"]), rel=2e-2, abs=5.1e-5)

    def test_the_headers_contradict_none_of_them(self):
        files = [path for kind in KINDS for path in (REAL_RECORDS / kind).iterdir()]
        assert len(files) == 11
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            streams = [
                read_knet(p) if p.parent.name == "knet" else obspy.read(str(p)) for p in files
            ]
        assert [t for stream in streams for t in stream if "faults" in t.stats.record] == []

    def test_no_other_file_is_claimed(self):
        folders = {is_dyna: "esm_dyna", is_geonet: "geonet_v1a", is_resorce: "resorce_acc"}
        files = [path for path in REAL_RECORDS.rglob("*") if path.is_file()]
        for is_format, folder in folders.items():
            claimed = {path.parent.name for path in files if is_format(path)}
            assert claimed == {folder}


def test_a_start_that_no_calendar_can_name_is_left_out(tmp_path):
    text = geonet_text({"N00E": SAMPLES})
    hours = text.replace("       3       4\n", "       3 9999999\n", 1)
    assert hours != text
    motion = read_motion(write(tmp_path, hours, "a.V1A"))
    assert "start_time" not in motion.metadata


def test_what_is_quoted_from_a_file_is_cut(tmp_path):
    path = write(tmp_path, resorce_text(SAMPLES / 1000.0, count="4" * 5000), "a.acc")
    with pytest.raises(RecordError) as caught:
        read_motion(path)
    assert str(caught.value).startswith(str(path))
    assert len(str(caught.value)) < 1000
