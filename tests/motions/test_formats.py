"""Text formats of agencies: claims, one motion in each, headers, errors and refusals."""

import time
from pathlib import Path

import numpy as np
import obspy
import pytest
from obspy.core.util.base import ENTRY_POINTS, buffered_load_entry_point

from archfrag.errors import RecordError
from archfrag.motions.formats import OWN, plug_in, recognise
from archfrag.motions.read import read_horizontals, read_motion, read_vertical

from .helpers import FOURTH_LINES, at2_text, pga, refused, wave
from .samples import (
    KIKNET,
    MADE_UP,
    G,
    components,
    cosmos,
    dmg_pairs,
    dmg_v1,
    dmg_v2,
    dyna_text,
    geonet_text,
    knet_text,
    resorce_text,
    smc,
)

GRAVITY = 9.80665
EAST, UP, NORTH = components()
SAMPLES = np.round(200.0 * wave(), 1)
TEXTS = {
    f"{name}-{i}": (name, make())
    for name, makers in MADE_UP.items()
    for i, make in enumerate(makers)
}
every_text = pytest.mark.parametrize(("form", "text"), TEXTS.values(), ids=TEXTS)
ONE = {"N00E": SAMPLES}
RAMP = np.arange(400.0)


def put(folder, text, name="record.txt"):
    (folder / name).write_bytes(text.encode("latin-1"))
    return folder / name


def read_all(folder, text, **options):
    return read_horizontals(put(folder, text), **options)


def refuse(folder, text, *parts, name="record.txt"):
    path = put(folder, text, name)
    refused(lambda: read_horizontals(path), *parts, start=path)


class TestClaims:
    def test_no_file_of_obspy_and_no_other_content_is_claimed(self, tmp_path):
        for content in (
            b"",
            bytes(range(256)) * 20,
            b"ACCELERATION\n" * 50,
            b"\xff\xfe" * 3000,
            at2_text(EAST).replace("NPTS", "N").encode(),
        ):
            (tmp_path / "other").write_bytes(content)
            for path in (tmp_path / "other", tmp_path / "missing"):
                assert recognise(str(path), tuple(OWN)) is None
        files = [
            p
            for p in Path(obspy.__file__).parent.glob("**/tests/data/**/*")
            if p.is_file()
        ]
        assert [p for p in files if recognise(str(p), tuple(OWN))] == []

    @every_text
    def test_by_one_format_only(self, tmp_path, form, text):
        path = put(tmp_path, text)
        claims = []
        for name, point in ENTRY_POINTS["waveform"].items():
            group = f"obspy.plugin.waveform.{name}"
            test = buffered_load_entry_point(point.dist.name, group, "isFormat")
            try:
                claims += [name] if test(str(path)) else []
            except Exception:
                continue
        assert claims == [form]


class TestEachFormat:
    @every_text
    @pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
    def test_as_a_plug_in_of_obspy(self, tmp_path, form, text, end):
        path = put(tmp_path, text.replace("\n", end))
        plain = obspy.read(str(path))
        applied = obspy.read(str(path), apply_calib=True)
        with open(path, "rb") as file:
            from_buffer = obspy.read(file)
        for trace, other, third in zip(plain, applied, from_buffer, strict=True):
            assert (trace.stats._format, trace.stats.calib) == (form, 1.0)
            assert np.array_equal(trace.data, other.data)
            assert np.array_equal(trace.data, third.data)
            assert not trace.stats.record.errors

    @every_text
    def test_what_is_no_finite_number(self, tmp_path, form, text):
        lines = text[: text.find(" 400 POINTS OF VELOC")].splitlines()
        place = len(lines) - 2
        for word in ("NaN", "1_0", "******"):
            path = put(
                tmp_path, "\n".join([*lines[:place], f"   {word}", *lines[place + 1 :]])
            )
            with pytest.raises(
                RecordError, match=rf"line {place + 1}: .* is not a .*number"
            ):
                plug_in(form, "read")(path)

    @pytest.mark.parametrize(
        ("text", "rounding"),
        [
            (at2_text(EAST, 0.005), 0.5e-8 * GRAVITY),
            (dmg_v1(dt=0.005), 0.5e-6 * GRAVITY),
            (dmg_v2(dt=0.005), 0.5e-5),
            (cosmos(), 0.5e-6 * GRAVITY),
            (cosmos(2, 4, factor=G), 0.5e-7),
            (dmg_pairs(jitter=0.0), 0.5e-4 * GRAVITY),
            (smc(EAST), 0.5e-4),
            (smc(EAST, times=0.005 * np.arange(400)), 0.5e-4),
            (dyna_text(G * EAST), 1e-8),
            (resorce_text(GRAVITY * EAST), 1e-7),
            (geonet_text({"N00E": 10 * G * EAST}), 1e-4),
            # 0.25 µV a count, 1.25 V/g, gain 1: 5,000,000 counts a g.
            (cosmos(0, 50, factor=5e6, r21=0.25, r41=1.25, r46=1.0), GRAVITY * 1.8e-7),
            *(
                (at2_text(EAST, 0.005, fourth=line).rstrip("\n"), 1e-7)
                for line in FOURTH_LINES
            ),
        ],
    )
    def test_one_motion_to_the_rounding_of_its_columns(self, tmp_path, text, rounding):
        motion = read_all(tmp_path, text)[0]
        raw = motion.metadata.get("level") == "raw"
        expected = GRAVITY * (EAST - EAST.mean() if raw else EAST)
        assert motion.dt == 0.005
        assert np.abs(motion.acceleration - expected).max() < 1.1 * rounding
        assert any("ean removed" in step for step in motion.log) == raw


HEADERS = {
    "at2": (
        at2_text(EAST),
        {
            "event": "Imperial Valley-02",
            "date": "5/19/1940",
            "station": "El Centro Array #9",
            "component": "180",
            "azimuth": 180.0,
        },
    ),
    "dmg": (
        dmg_v1(),
        {
            "event": "MADE-UP EARTHQUAKE",
            "date": "2018-01-02",
            "magnitude": 6.4,
            "station": "Made-up Town - First & Main",
            "azimuth": 90.0,
            "component": "90",
        },
    ),
    "dmg 2": (
        dmg_v2(),
        {
            "date": "1983-05-02",
            "magnitude": 6.5,
            "level": "processed",
            "station": "MADE-UP FAULT ZONE 14",
            "azimuth": 90.0,
        },
    ),
    "cosmos": (
        cosmos(),
        {
            "event": "Made-up Earthquake of Tue Aug 28, 2018 19:33 UTC",
            "date": "2018-08-28",
            "magnitude": 5.6,
            "azimuth": 360.0,
            "epicentral_km": 45.0,
            "station": "Made-up Town - First & Main",
            "component": "HNN",
            "level": "raw",
        },
    ),
    "smc": (
        smc(),
        {
            "event": "Made-up, CA",
            "date": "1989-10-18",
            "magnitude": 6.9,
            "station": "MADE-UP Array #2",
            "epicentral_km": 63.0,
            "azimuth": 133.0,
            "component": "133",
            "level": "processed",
        },
    ),
    "dyna": (
        dyna_text(SAMPLES, event_name="Åland, Αθήνα"),
        {
            "level": "processed",
            "event": "Åland, Αθήνα, XX-0001",
            "station": "ABC",
            "date": "2001-02-03",
            "magnitude": 5.1,
            "vs30_mps": 420.0,
            "epicentral_km": 12.3,
            "azimuth": 90.0,
            "start_time": "2001-02-03T04:05:10.250000Z",
        },
    ),
    "geonet": (
        geonet_text({"S16W": SAMPLES, "Up": SAMPLES}),
        {
            "level": "raw",
            "azimuth": 196.0,
            "event": "10 km east of Nowhere",
            "date": "2001-02-03",
            "magnitude": 6.25,
            "component": "S16W",
            "station": "ABCD",
            "epicentral_km": 21.0,
            "start_time": "2001-02-03T04:04:57.250000Z",
        },
    ),
    "resorce": (
        resorce_text(EAST),
        {
            "level": "processed",
            "component": "NS",
            "azimuth": 0.0,
            "date": "2001-02-03",
            "station": "Some - Where, Nowhere",
        },
    ),
}


class TestHeaders:
    @pytest.mark.parametrize(("text", "facts"), HEADERS.values(), ids=HEADERS)
    def test_event_and_station_are_kept(self, tmp_path, text, facts):
        (tmp_path / "a.txt").write_text(text, encoding="utf-8")
        (motion, *_) = read_horizontals(tmp_path / "a.txt")
        assert facts.items() <= motion.metadata.items()
        if motion.vertical is not None:
            assert motion.metadata["of_vertical"]["component"] in ("Up", "UP", "HNZ")

    @pytest.mark.parametrize("text", [dmg_v1(), dmg_v2(), cosmos(), dmg_pairs()])
    def test_all_channels_with_the_vertical(self, tmp_path, text):
        motions = read_all(tmp_path, text)
        assert len({motion.id for motion in motions}) == 2
        assert all(
            np.corrcoef(motion.vertical, UP)[0, 1] > 0.9999 for motion in motions
        )
        assert np.corrcoef(motions[1].acceleration, NORTH)[0, 1] > 0.9999

    def test_channels_of_several_places_do_not_mix(self, tmp_path):
        bearings = (
            "90 DEG  LOCATION: DECK",
            "DOWN  LOCATION: DECK",
            "90 DEG  LOCATION: GROUND",
            "UP  LOCATION: GROUND",
        )
        file = put(tmp_path, dmg_v1((EAST, UP, NORTH, 2 * UP), bearings), "record")
        motions = read_horizontals(file, accept=("sensor",))
        assert [motion.id for motion in motions] == [
            "record:DECK.90",
            "record:GROUND.90",
        ]
        assert np.corrcoef(motions[0].vertical, -UP)[0, 1] > 0.9999
        assert np.corrcoef(motions[1].vertical, UP)[0, 1] > 0.9999
        (ground,) = read_horizontals(file)
        assert np.array_equal(ground.acceleration, motions[1].acceleration)
        caution = ground.metadata["cautions"][-1]
        assert caution.startswith(
            "channel 90, DOWN is in a structure by its header (DECK) and is"
        )
        same = read_all(tmp_path, dmg_v1((EAST, NORTH), ("90 DEG", "90 DEG")))
        assert [motion.id for motion in same] == ["record:1.90", "record:2.90"]

    @pytest.mark.parametrize("channel", KIKNET)
    def test_sensors_of_kiknet(self, tmp_path, channel):
        counts = np.round(1e5 * wave()).astype(int) + 5000
        path = put(
            tmp_path, knet_text(counts, KIKNET[channel], scale=8388608), f"A.{channel}"
        )
        read = read_vertical if channel.startswith("UD") else read_motion
        deep = channel[2] == "1"
        if deep:  # also under another name
            for file in (path, put(tmp_path, path.read_text(), "renamed.txt")):
                refused(
                    lambda file=file: read(file), "in the borehole", "accept sensor"
                )
        motion = read(path, accept=("sensor",) if deep else ())
        assert any("in the borehole" in step for step in motion.log) == deep
        assert pga(motion) == pytest.approx(0.2384, rel=1e-2)
        assert "errors" not in motion.metadata


class TestTimes:
    def test_unequal_steps_are_read_between_samples(self, tmp_path):
        motion = read_all(tmp_path, dmg_pairs(jitter=0.002))[0]
        assert motion.dt == 0.005
        assert any(
            "Samples at unequal steps of 0.003 to 0.007 s" in step
            for step in motion.log
        )
        times = 0.01 * np.arange(400)
        times[1::2] += 0.001
        motion = read_all(tmp_path, smc(times, times=times))[0]
        assert np.abs(motion.acceleration - GRAVITY * motion.time).max() < 2e-3

    def test_a_last_row_from_memory_is_left_out(self, tmp_path):
        assert read_all(tmp_path, smc(filler=8))[0].acceleration.size == 400
        refuse(tmp_path, smc(filler=9), "announces 400 samples", "holds 409")


class TestFaults:
    @pytest.mark.parametrize(
        ("text", "fault"),
        [
            (
                dmg_v1((EAST, UP[:-1], NORTH)),
                "numbers of samples (90 400, UP 399, 360 400)",
            ),
            (
                geonet_text({"N00E": SAMPLES, "N90E": SAMPLES[:-3]}),
                "(N00E 400, N90E 397)",
            ),
            (cosmos(total=6), "the header counts 6 channels, the file holds 3"),
            (
                smc(EAST + 0.3),
                "the offset of the samples, 294.2, is larger than their motion",
            ),
        ],
    )
    def test_contradictions_are_logged(self, tmp_path, text, fault):
        motion = read_all(tmp_path, text)[0]
        assert [f for f in motion.metadata["errors"] if fault in f]
        assert [
            step for step in motion.log if step.startswith("Error in") and fault in step
        ]

    @pytest.mark.parametrize("text", [dmg_v1(), dmg_v2(), cosmos(), dmg_pairs()])
    def test_no_end(self, tmp_path, text):
        cut = text[: text.upper().rindex("END")].rstrip("/&- \n") + "\n"
        assert "no end-of-data line" in read_all(tmp_path, cut)[1].metadata["errors"][0]
        short = text[: text.upper().rindex("END") - 1500]
        if "VELOC DATA" not in text:
            refuse(tmp_path, short, "announces 400 samples", "holds only")
        assert read_all(tmp_path, short, accept=["samples"])

    @pytest.mark.parametrize(
        "make",
        [
            lambda p: dmg_v2(peak=p),
            lambda p: smc(peak=p),
            lambda p: cosmos(r63=p / G),
            lambda p: dmg_v1((EAST, EAST), peak=p / G),
            lambda p: dyna_text(G * EAST, peak=p),
            lambda p: resorce_text(EAST, peak=p / G),
            lambda p: geonet_text({"N00E": np.round(G * EAST, 1)}, peak=p),
        ],
    )
    def test_a_peak_that_is_not_the_samples(self, tmp_path, make):
        peak = G * np.abs(EAST).max()
        good, odd, wrong = (
            read_all(tmp_path, make(factor * peak), accept=["header"])[0].metadata
            for factor in (1.004, 1.06, 2.0)
        )
        assert "errors" not in good
        assert "the header states a peak of" in odd["errors"][0]
        assert wrong["accepted"]
        refuse(
            tmp_path,
            make(2.0 * peak),
            "the header states a peak of",
            "accept` with header",
        )


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("\n".join(at2_text(EAST).splitlines()[:4]), ["ends after 4 line(s)"]),
        (
            at2_text(EAST, unit="FURLONGS"),
            ["line 3", "'FURLONGS'", "m/s2, cm/s2, gal, mm/s2"],
        ),
        (
            at2_text(EAST).replace("ACCELERATION", "VELOCITY"),
            ["line 3", "acceleration"],
        ),
        (at2_text(EAST).replace("NPTS", "N"), ["line 4", "NPTS"]),
        (smc(kind="3 VELOCITY"), ["line 1", "an accelerogram (type 1 or 2)"]),
        (smc(times=np.where(RAMP == 2, 0.5, RAMP)), ["2 is at 0.5 s"]),
        (smc(times=0.0 * RAMP), ["must increase"]),
        (smc(times=np.where(RAMP == 399, 1e9, 1e-6 * RAMP)), ["too uneven"]),
        (
            cosmos().replace("1       1       2     120", "1       2       2     120"),
            ["none of the channels"],
        ),
        (cosmos(0, 50, factor=5e6), ["does not state the unit"]),
        (
            cosmos().replace(" 100 Real-header", " 999999 Real-header"),
            ["999999 real-header"],
        ),
        (dmg_v1().replace("at 100 pts/sec", ""), ["no time step above 0 s"]),
        (dmg_v1() + "PROSE AFTER ALL\n", ["(UN)CORRECTED ACCELEROGRAM"]),
        (dyna_text(SAMPLES, data_type="VELOCITY"), ["DATA_TYPE", "'VELOCITY'"]),
        (dyna_text(SAMPLES, user5="\nUSER5: "), ["line 29", "USER5", "a second time"]),
        (
            "\n".join(
                line
                for i, line in enumerate(geonet_text(ONE, raw=False).splitlines())
                if i != 40
            ),
            ["channel N00E must hold 400 accelerations", "it holds 1190"],
        ),
    ],
)
def test_refusals(tmp_path, text, parts):
    refuse(tmp_path, text, *parts, name="a.AT2" if "PEER" in text[:9] else "record.txt")


def test_a_header_line_without_end_takes_no_time(tmp_path):
    begun = time.process_time()
    read_all(tmp_path, dmg_v1().replace("HYPOCENTER", "9" * 2000 + " HYPOCENTER"))
    refuse(tmp_path, cosmos() + "(Format v" * 20_000)
    assert time.process_time() - begun < 1.0
