"""Units, components and what is refused unless accepted: from a file to a motion."""

import json
from functools import partial

import numpy as np
import obspy
import pytest
import scipy.signal
from obspy import Stream, Trace, UTCDateTime

from archfrag.errors import RecordError
from archfrag.motions.calibrate import ACCEPTABLE
from archfrag.motions.formats.columns import Columns
from archfrag.motions.index import load_index
from archfrag.motions.measures import measure
from archfrag.motions.read import load_motion, read_horizontals, read_motion

from .fdsn_server import SENSITIVITY, station_xml
from .helpers import (
    REAL_RECORDS,
    at2_text,
    manifest,
    needs_real_records,
    pga,
    refused,
    wave,
)
from .samples import knet_text

G = 9.80665
RAMP = np.arange(400.0)
COUNTS = np.round(4000.0 * wave())
QUIET = 0.1 * wave()


def trace(channel="HNE", data=COUNTS, dt=0.01, start=0.0):
    header = {"network": "IV", "station": "NEAR", "channel": channel, "delta": dt}
    return Trace(
        np.asarray(data), {**header, "starttime": UTCDateTime(2020, 1, 1) + start}
    )


def write(path, *traces, form="MSEED", **options):
    Stream(traces).write(str(path), format=form, **options)
    return path


def put(path, text):
    path.write_text(text)
    return path


def knet(folder, counts, **options):
    return put(folder / "AOM.EW", knet_text(counts, **options))


def at2(folder, samples=QUIET, name="a.AT2", **options):
    return put(folder / name, at2_text(samples, **options))


def text_record(folder, form, kept):
    """A record of 400 samples in one of obspy's text formats, cut off after some of its rows."""
    path = write(folder / f"a.{form.lower()}", trace(data=0.1 * wave()), form=form)
    return put(path, "\n".join(path.read_text().splitlines()[: 1 + kept]) + "\n")


class TestUnits:
    @pytest.mark.parametrize(
        ("form", "unit", "factor"),
        [
            ("MSEED", "m/s2", 1.0),
            ("SAC", "cm/s2", 0.01),
            ("GSE2", "gal", 0.01),
            ("SLIST", "mm/s2", 1e-3),
            ("MSEED", "g", G),
        ],
    )
    def test_asked_for_where_the_file_states_none(self, tmp_path, form, unit, factor):
        kind = "f4" if form == "SAC" else "i4"
        path = write(tmp_path / "record", trace(data=COUNTS.astype(kind)), form=form)
        motion = read_motion(path, unit=unit, accept=["pga"])
        assert np.allclose(motion.acceleration, factor * COUNTS, rtol=1e-6, atol=1e-9)

    @pytest.mark.parametrize("name", ["record.xml", "IV.NEAR.xml"])
    def test_counts_are_demeaned_by_a_station_xml_in_the_folder(self, tmp_path, name):
        path = write(tmp_path / "record.mseed", trace(data=COUNTS + 5000))
        (tmp_path / name).write_bytes(station_xml(["NEAR"]))
        motion = read_motion(path)
        assert np.allclose(
            motion.acceleration, (COUNTS - COUNTS.mean()) / SENSITIVITY, atol=1e-12
        )
        assert any("Mean removed" in step for step in motion.log)
        given = read_motion(path, inventory=tmp_path / name)
        assert np.array_equal(given.acceleration, motion.acceleration)

    def test_knet_scale_factor_is_applied_once_and_the_offset_removed(self, tmp_path):
        counts = np.round(1e5 * wave()).astype(int) + 400_000
        motion = read_motion(knet(tmp_path, counts))
        expected = (counts - counts.mean()) * 0.01 * 2000.0 / 8_000_000
        assert np.allclose(motion.acceleration, expected, rtol=1e-9, atol=1e-12)
        assert motion.id == "AOM.EW"

    def test_unit_from_an_index_in_the_folder_above(self, tmp_path):
        (tmp_path / "data").mkdir()
        path = write(tmp_path / "data" / "record.mseed", trace())
        put(tmp_path / "index.csv", "a,b\n1,2\n")
        assert read_motion(path, unit="gal").id == "record"
        put(
            tmp_path / "index.csv", "id,file,unit,Mw\nfirst,data/record.mseed,gal,6.5\n"
        )
        motion = read_motion(path)
        assert np.allclose(motion.acceleration, COUNTS * 0.01)
        assert (motion.id, motion.metadata["Mw"]) == ("first", 6.5)


class TestComponents:
    def test_every_horizontal_with_the_vertical(self, tmp_path):
        north = trace("HNN", data=-COUNTS)
        vertical = trace("HNZ", data=RAMP)
        path = write(tmp_path / "three.mseed", trace(), north, vertical)
        read = {"unit": "m/s2", "accept": ["pga"]}
        first = read_motion(path, **read)
        motions = read_horizontals(path, **read)
        assert "Horizontal HNE taken, the first of HNE, HNN." in first.log
        assert [m.id for m in motions] == ["three:HNE", "three:HNN"]
        assert all(np.array_equal(m.vertical, RAMP) for m in (first, *motions))
        for name in ("HNN", "n", "IV.NEAR..HNN"):
            found = read_motion(path, component=name, **read)
            assert np.array_equal(found.acceleration, -COUNTS)

    @pytest.mark.parametrize(
        ("count", "start", "kept", "their"),
        [
            (300, 0.0, slice(0, 300), slice(0, 300)),
            (400, 0.5, slice(50, 400), slice(0, 350)),
        ],
    )
    def test_cut_to_the_time_in_common(self, tmp_path, count, start, kept, their):
        vertical = trace("HNZ", data=RAMP[:count], start=start)
        motion = read_motion(
            write(tmp_path / "a", trace(), vertical), unit="gal", accept=["pga"]
        )
        assert np.allclose(motion.acceleration, 0.01 * COUNTS[kept])
        assert np.allclose(motion.vertical, 0.01 * RAMP[their])
        assert any(step.startswith("Cut to the") for step in motion.log)

    @pytest.mark.parametrize(("code", "sign"), [("UP", 1.0), ("DWN", -1.0)])
    def test_vertical_from_its_own_file_counts_upwards(self, tmp_path, code, sign):
        path = at2(tmp_path, wave(), "h.AT2")
        motion = read_motion(
            path, vertical=at2(tmp_path, wave(), "v.AT2", component=code)
        )
        assert np.array_equal(motion.vertical, sign * motion.acceleration)

    def test_split_but_gapless_traces_are_joined(self, tmp_path):
        parts = trace(data=COUNTS[:150]), trace(data=COUNTS[150:], start=1.5)
        motion = read_motion(write(tmp_path / "split.mseed", *parts), unit="mm/s2")
        assert np.array_equal(motion.acceleration, 1e-3 * COUNTS)

    def test_the_component_that_an_index_lists(self, tmp_path):
        traces = [trace("HNE", np.hanning(50)), trace("HNN", 2.0 * np.hanning(50))]
        write(tmp_path / "two.mseed", *traces)
        write(tmp_path / "three.mseed", *traces)
        at2(tmp_path, np.hanning(50), "one.AT2")
        text = (
            "id,file,unit,component\na,two.mseed,m/s2,HNN\nb,two.mseed,m/s2,\n"
            "c,two.mseed,m/s2,X\nd,one.AT2,,H1\ne,three.mseed,,\n"
        )
        entries = load_index(put(tmp_path / "selected.csv", text))
        named, first, alone = (load_motion(entries[row]) for row in (0, 1, 3))
        assert (pga(named), pga(first)) == pytest.approx((2.0, 1.0), rel=1e-2)
        assert alone.metadata["component"] == "H1"
        for row, reason in (
            (2, "no horizontal component 'X'"),
            (4, "not state the unit"),
        ):
            with pytest.raises(RecordError, match=reason):
                load_motion(entries[row])


def cut(folder, size):
    path = write(folder / "a", trace(data=wave()), reclen=512)
    path.write_bytes(path.read_bytes()[:size])
    return path


def with_xml(folder, station="NEAR"):
    (folder / "a.xml").write_bytes(station_xml([station]))
    return write(folder / "a.mseed", trace())


NAN = np.where(RAMP == 17, np.nan, wave())


@pytest.mark.parametrize(
    ("make", "options", "parts"),
    [
        (lambda f: f / "missing.AT2", {}, ["no such file"]),
        (lambda f: put(f / "a.AT2", ""), {}, ["is empty"]),
        (
            lambda f: put(f / "a", "no record at all"),
            {},
            ["not recognised", "--columns time=1"],
        ),
        (lambda f: cut(f, 4000), {"unit": "g"}, ["truncated MSEED"]),
        (
            lambda f: write(f / "a", trace(data=NAN)),
            {"unit": "g"},
            ["NEAR..HNE", "index 17"],
        ),
        (
            lambda f: write(f / "a", trace(), trace(start=10.0)),
            {"unit": "g"},
            ["a gap of"],
        ),
        (
            lambda f: write(f / "a", trace()),
            {},
            ["does not state the unit", "m/s2, cm/s2, gal"],
        ),
        (at2, {"unit": "m/s2"}, ["'m/s2'", "'g'"]),
        (lambda f: knet(f, np.arange(200)), {"unit": "gal"}, ["'gal'", "scale factor"]),
        (lambda f: write(f / "a", trace("HNZ")), {"unit": "g"}, ["only the vertical"]),
        (
            lambda f: write(f / "a", trace("ABC"), trace("ABD")),
            {"unit": "g"},
            ["'ABC', 'ABD'"],
        ),
        (with_xml, {"unit": "g"}, ["'g'", "counts"]),
        (lambda f: with_xml(f, "FAR"), {}, ["no response for channel IV.NEAR..HNE"]),
        (
            lambda f: write(f / "a", trace(), trace("HNZ", dt=0.02)),
            {"unit": "gal", "accept": ["pga"]},
            ["0.02 s"],
        ),
        (at2, {"accept": ["dt"]}, ["'dt'", "pga, time_step, samples, header"]),
    ],
)
def test_refusals(tmp_path, make, options, parts):
    path = make(tmp_path)
    refused(lambda: read_motion(path, **options), *parts, start=tmp_path)


def acceptable(path, word, *parts, **options):
    """The record is refused with these parts in the message, and read if the word is accepted."""
    others = [other for other in ACCEPTABLE if other != word]
    remedy = f"--accept {word} on the command line"
    for accept in ((), others):
        read = partial(read_motion, path, accept=accept, **options)
        refused(read, *parts, remedy, start=f"{path}: ")
    motion = read_motion(path, accept=[word], **options)
    assert motion.metadata["accepted"]
    assert set(motion.metadata["accepted"]) <= set(motion.log)
    json.dumps(dict(motion.metadata))
    return motion


class TestAccept:
    def test_peak(self, tmp_path):
        shape = wave() / np.abs(wave()).max()
        for peak in (5.1, 9e-6, 0.0):
            path = at2(tmp_path, peak * shape)
            acceptable(path, "pga", "channel 180", f"{peak:.4g} g", "1e-05 to 5 g")
        for peak in (4.99, 1.01e-5):
            assert "accepted" not in read_motion(at2(tmp_path, peak * shape)).metadata
        traces = trace(data=0.1 * wave()), trace("HNZ", data=100.0 * wave())
        path = write(tmp_path / "a.mseed", *traces)
        assert acceptable(path, "pga", "HNZ", "99.11 g", unit="g").vertical is not None
        acceptable(
            at2(tmp_path, 0.05 * wave(), unit="MM/S2"), "pga", "by its unit mm/s2"
        )

    def test_time_step(self, tmp_path):
        for dt in (9e-5, 0.11):
            path = at2(tmp_path, dt=dt, fourth="NPTS= {count:6d}, DT= {dt} SEC")
            motion = acceptable(path, "time_step", f"{dt:g} s", "0.0001 to 0.1 s")
            assert motion.dt == pytest.approx(dt)
        for limit in (1e-4, 0.1):  # which SAC holds in single precision
            single = trace(data=np.float32(0.1 * wave()), dt=limit)
            sac = write(tmp_path / "a.sac", single, form="SAC")
            assert read_motion(sac, unit="g").dt == pytest.approx(limit, rel=1e-6)

    @pytest.mark.parametrize(
        ("make", "announced", "held"),
        [
            (lambda f: text_record(f, "SLIST", 30), 400, 180),
            (lambda f: text_record(f, "TSPAIR", 200), 400, 200),
            (lambda f: knet(f, np.round(1e4 * wave()).astype(int), length=5), 500, 400),
            (lambda f: at2(f, count=500), 500, 400),
            (lambda f: at2(f, count=300), 300, 400),
        ],
    )
    def test_number_of_samples(self, tmp_path, make, announced, held):
        path = make(tmp_path)
        unit = "g" if path.suffix in (".slist", ".tspair") else None
        parts = f"announces {announced} samples", f"{held}"
        assert acceptable(path, "samples", *parts, unit=unit).acceleration.size == held

    def test_a_number_that_breaks_off_is_left_out(self, tmp_path):
        path = at2(tmp_path)
        text = put(path, path.read_text()[:3000]).read_text()
        assert text[-1].isdigit()
        held = len(" ".join(text.splitlines()[4:]).split())
        motion = acceptable(path, "samples", f"holds only {held}")
        assert motion.acceleration.size == held - 1

    def test_in_an_index(self, tmp_path):
        path = at2(tmp_path, 10.0 * wave(), count=500)
        index = put(
            tmp_path / "index.csv", "id,file,unit,accept\nstrong,a.AT2,g,pga samples\n"
        )
        for motion in (load_motion(load_index(index)[0]), read_motion(path)):
            assert len(motion.metadata["accepted"]) == 2
        put(index, "id,file,unit,accept\nstrong,a.AT2,g,all\n")
        with pytest.raises(RecordError, match=r"index\.csv, line 2: accept 'all'"):
            load_index(index)


@needs_real_records
@pytest.mark.parametrize(
    "row", manifest(), ids=lambda row: f"{row['file']}-{row.get('channel_index')}"
)
def test_real_records_have_the_measures_of_their_manifests(row):
    path = REAL_RECORDS / row["file"]
    raw = row.get("processing_level") == "raw"
    if "processing_level" in row:
        channel = obspy.read(str(path))[int(row["channel_index"])]
        motion = read_motion(path, component=channel.id)
    else:
        motion = read_motion(path, "g", columns=Columns(time=1, acceleration=2))
    form = row.get("format", "columns").upper()
    assert motion.metadata["format"] in (form, *form.split("_"))
    assert not motion.metadata.get("accepted")
    assert motion.metadata.get("level", "") in (
        ("raw", "") if raw else ("processed", "")
    )
    assert motion.dt == pytest.approx(float(row["dt_s"]), rel=1e-9)
    assert motion.acceleration.size == pytest.approx(int(row["npts"]), abs=1)
    # The manifest rounds to 1e-4 g and 0.01 cm/s, which is more than 0.1 and 2 % of weak ones.
    assert pga(motion) / G == pytest.approx(float(row["PGA_g"]), rel=1e-3, abs=5.5e-5)
    if raw:  # the manifest's filter is without zeros before and after a record
        band = scipy.signal.butter(
            4, [0.1, 25.0], "bandpass", fs=1.0 / motion.dt, output="sos"
        )
        filtered = motion.changed(partial(scipy.signal.sosfiltfilt, band), "")
    velocity = measure(filtered if raw else motion, "PGV")
    assert 100 * velocity == pytest.approx(float(row["PGV_cms"]), rel=0.02, abs=5.5e-3)
    # The manifest has the total acceleration at samples, up to 4 % below the pseudo-acceleration.
    for period, key in ((0.2, "Sa_0p2_g"), (1.0, "Sa_1p0_g")):
        expected = pytest.approx(float(row[key]), rel=0.05, abs=5.5e-5)
        assert measure(motion, f"Sa({period})") / G == expected
