"""COSMOS, CSMIP and SMC files in layouts of the agencies, with made-up numbers."""

import io
import time
from typing import ClassVar

import numpy as np
import pytest

from archfrag.errors import RecordError
from archfrag.motions.formats.blocks import read_smc
from archfrag.motions.formats.csmip import read_cosmos, read_dmg
from archfrag.motions.formats.text import numbers, on_even_steps
from archfrag.motions.read import read_motion, read_motions

from . import samples
from .samples import cosmos, dmg_pairs, dmg_v1, dmg_v2, smc

G = 9.80665
EAST, UP, NORTH = samples.components()


def put(folder, text, name="record.txt"):
    path = folder / name
    path.write_bytes(text.encode("latin-1"))
    return path


def read_all(folder, text, **options):
    return read_motions(put(folder, text), **options)


class TestOneMotionInEveryFormat:
    """Volumes of one motion agree to the rounding of their columns."""

    @pytest.mark.parametrize(
        ("text", "rounding"),
        [
            (dmg_v1(dt=0.005), 0.5e-6 * G),
            (dmg_v2(dt=0.005), 0.5e-5),
            (cosmos(), 0.5e-6 * G),
            (cosmos(2, 4, factor=980.665), 0.5e-7),
            (dmg_pairs(jitter=0.0), 0.5e-4 * G),
            (smc(EAST), 0.5e-4),
            (smc(EAST, times=0.005 * np.arange(400)), 0.5e-4),
        ],
        ids=["DMG 1", "DMG 2", "COSMOS 1", "COSMOS 2", "DMG pairs", "SMC 2", "SMC pairs"],
    )
    def test_samples(self, tmp_path, text, rounding):
        motion = read_all(tmp_path, text)[0]
        expected = G * (EAST - EAST.mean() if motion.metadata["level"] == "raw" else EAST)
        assert motion.dt == 0.005
        assert np.abs(motion.acceleration - expected).max() < 1.1 * rounding

    def test_corrected_and_uncorrected_volumes_are_told_apart(self, tmp_path):
        for text, level in (
            (dmg_v1(), "raw"), (dmg_pairs(), "raw"), (dmg_v2(), "processed"),
            (cosmos(), "raw"), (cosmos(2, 4, factor=980.665), "processed"),
            (smc(), "processed"), (smc(kind="1 UNCORRECTED ACCELEROGRAM"), "raw"),
        ):  # fmt: skip
            motion = read_all(tmp_path, text)[0]
            assert motion.metadata["level"] == level
            assert f"{level})." in motion.log[0]
            removed = [step for step in motion.log if "mean removed" in step]
            assert bool(removed) == (level == "raw")

    def test_counts_of_cosmos_by_the_sensitivities_of_its_header(self, tmp_path):
        # 0.25 µV a count, 1.25 V/g, gain 1: 5,000,000 counts a g.
        text = cosmos(0, 50, factor=5e6, r21=0.25, r41=1.25, r46=1.0)
        motion = read_all(tmp_path, text)[0]
        assert np.allclose(motion.acceleration, G * (EAST - EAST.mean()), atol=G * 2e-7)
        assert motion.metadata["unit_in_file"] == "counts"
        with pytest.raises(RecordError, match="the file holds counts and has the sensitivity"):
            read_all(tmp_path, text, unit="g")

    def test_counts_without_them_need_a_unit(self, tmp_path):
        with pytest.raises(RecordError, match="does not say the unit of its samples"):
            read_all(tmp_path, cosmos(0, 50, factor=5e6))


class TestHeaders:
    FACTS: ClassVar = {
        "dmg": (dmg_v1(), {"event": "MADE-UP EARTHQUAKE", "date": "2018-01-02", "magnitude": 6.4,
                "depth_km": 7.0, "event_latitude": 34.201, "event_longitude": -116.826,
                "station": "Made-up Town - First & Main", "station_latitude": 34.063,
                "station_longitude": -117.785, "azimuth": 90.0, "component": "90"}),
        "dmg 2": (dmg_v2(), {"date": "1983-05-02", "magnitude": 6.5, "depth_km": 9.0,
                  "station": "MADE-UP FAULT ZONE 14", "azimuth": 90.0}),
        "cosmos": (cosmos(), {"event": "Made-up Earthquake of Tue Aug 28, 2018 19:33 UTC",
                   "date": "2018-08-28", "magnitude": 5.6, "depth_km": 8.0, "azimuth": 360.0,
                   "epicentral_km": 45.0, "station": "Made-up Town - First & Main",
                   "station_latitude": 34.0625, "component": "HNN"}),
        "smc": (smc(), {"event": "Made-up, CA", "date": "1989-10-18", "magnitude": 6.9,
                "station": "MADE-UP Array #2", "epicentral_km": 63.0, "azimuth": 133.0,
                "event_latitude": 37.037, "component": "133"}),
    }  # fmt: skip

    @pytest.mark.parametrize("case", FACTS)
    def test_event_and_station_are_kept(self, tmp_path, case):
        text, facts = self.FACTS[case]
        motion = read_all(tmp_path, text)[0]
        assert {key: motion.metadata.get(key) for key in facts} == facts

    @pytest.mark.parametrize("text", [dmg_v1(), dmg_v2(), cosmos(), dmg_pairs()])
    def test_all_channels_with_the_vertical(self, tmp_path, text):
        motions = read_all(tmp_path, text)
        assert len(motions) == 2
        assert len({motion.id for motion in motions}) == 2
        for motion in motions:
            assert np.corrcoef(motion.vertical, UP)[0, 1] > 0.9999
        assert np.corrcoef(motions[1].acceleration, NORTH)[0, 1] > 0.9999
        assert motions[0].metadata["vertical_component"] in ("UP", "HNZ")

    def test_a_vertical_that_counts_downwards(self, tmp_path):
        text = dmg_v1(ways=("90 DEG", "DOWN", "360 DEG"))
        assert np.corrcoef(read_all(tmp_path, text)[0].vertical, -UP)[0, 1] > 0.9999

    def test_channels_of_several_places_do_not_mix(self, tmp_path):
        ways = ("90 DEG  LOCATION: DECK", "UP  LOCATION: DECK", "90 DEG  LOCATION: GROUND",
                "UP  LOCATION: GROUND")  # fmt: skip
        text = dmg_v1((EAST, UP, NORTH, 2 * UP), ways)
        motions = read_all(tmp_path, text)
        assert [motion.id for motion in motions] == ["record:DECK.90", "record:GROUND.90"]
        assert np.corrcoef(motions[0].vertical, UP)[0, 1] > 0.9999
        assert motions[1].vertical.max() == pytest.approx(2 * motions[0].vertical.max(), rel=1e-3)

    def test_channels_of_one_name_stay_apart(self, tmp_path):
        motions = read_all(tmp_path, dmg_v1((EAST, NORTH), ("90 DEG", "90 DEG")))
        assert [motion.id for motion in motions] == ["record:1.90", "record:2.90"]

    @pytest.mark.parametrize(("read", "text"), [
        (read_cosmos, cosmos()), (read_dmg, dmg_v2()), (read_smc, smc()),
    ])  # fmt: skip
    def test_open_buffers(self, read, text):
        trace = read(io.BytesIO(text.encode()))[0]
        assert trace.stats.npts == 400
        assert trace.stats.calib == 1.0


class TestTimes:
    def test_unequal_steps_are_read_between_samples(self, tmp_path):
        motion = read_all(tmp_path, dmg_pairs(jitter=0.002))[0]
        assert motion.dt == 0.005
        assert any("Samples at unequal steps of 0.003 to 0.007 s" in step for step in motion.log)

    def test_a_straight_line_is_kept(self):
        times = np.array([0.0, 0.011, 0.02, 0.02, 0.031, 0.05])
        values, step, sentence = on_even_steps(np.column_stack((times, 3.0 * times)).ravel(), "a")
        assert step == 0.01
        assert np.allclose(values, 0.03 * np.arange(6))
        assert "6 to 6 samples" in sentence

    @pytest.mark.parametrize(
        ("times", "sentence"),
        [
            ([0.0, 0.01, 0.005, 0.02], r"must increase; 0\.005 s at sample 2 does not"),
            ([0.0, 0.0, 0.0], "must increase"),
            ([0.0, 1e-6, 2e-6, 1e9], "too uneven"),
        ],
    )
    def test_impossible_times(self, times, sentence):
        with pytest.raises(RecordError, match=sentence):
            on_even_steps(np.repeat(times, 2), "a")

    def test_a_last_row_from_memory_is_left_out(self, tmp_path):
        motion = read_all(tmp_path, smc(filler=8))[0]
        assert motion.acceleration.size == 400
        assert "Row beyond the 400 numbers that the header counts left out." in motion.log
        with pytest.raises(RecordError, match=r"announces 400 samples .* the file holds 409"):
            read_all(tmp_path, smc(filler=9))

    @pytest.mark.parametrize(
        ("text", "count"),
        [(cosmos(r61=-999.0), 400), (cosmos(r62=77.0), 400)],
    )
    def test_steps_of_a_cosmos_header(self, tmp_path, text, count):
        motion = read_all(tmp_path, text)[0]
        assert (motion.dt, motion.acceleration.size) == (0.005, count)
        assert ("faults" in motion.metadata) == ("77.000000" in text)


class TestFaults:
    def faults(self, folder, text, **options):
        motion = read_all(folder, text, **options)[0]
        for fault in motion.metadata.get("faults", ()):
            assert f"Fault: {fault}." in motion.log
        return motion.metadata.get("faults", [])

    @pytest.mark.parametrize("text", [dmg_v1(), dmg_v2(), dmg_pairs(), cosmos(), smc(),
                                      cosmos(2, 4, factor=980.665)])  # fmt: skip
    def test_none_in_good_files(self, tmp_path, text):
        assert self.faults(tmp_path, text) == []

    def test_unequal_channels(self, tmp_path):
        text = dmg_v1((EAST, UP[:-1], NORTH))
        assert self.faults(tmp_path, text) == [
            "the channels of the file have unequal numbers of samples (90 400, UP 399, 360 400)"
        ]

    @pytest.mark.parametrize("text", [dmg_v1(total=6), cosmos(total=6)])
    def test_missing_channels(self, tmp_path, text):
        assert self.faults(tmp_path, text) == ["the header counts 6 channels, the file holds 3"]

    @pytest.mark.parametrize("text", [dmg_v1(), dmg_v2(), cosmos(), dmg_pairs()])
    def test_no_end(self, tmp_path, text):
        cut = text[: text.upper().rindex("END")].rstrip("/&- \n") + "\n"
        assert "no end-of-data line" in read_all(tmp_path, cut)[1].metadata["faults"][0]

    def test_an_offset_larger_than_the_motion(self, tmp_path):
        (fault,) = self.faults(tmp_path, smc(EAST + 0.3))
        assert fault.startswith("the offset of the samples, 294.2, is larger than their motion")

    @pytest.mark.parametrize(
        "make",
        [lambda p: dmg_v2(peak=p), lambda p: smc(peak=p), lambda p: cosmos(r63=p / 980.665),
         lambda p: dmg_v1(channels=(EAST, EAST), peak=p / 980.665)],
        ids=["DMG 2", "SMC", "COSMOS", "DMG 1"],
    )  # fmt: skip
    def test_a_peak_that_is_not_the_samples(self, tmp_path, make):
        peak = 980.665 * np.abs(EAST).max()
        (fault, *_) = self.faults(tmp_path, make(1.06 * peak), accept=["header"])
        assert fault.startswith("the header states a peak of ")
        with pytest.raises(
            RecordError, match=r"channel \w+: the header states a peak of .* with hea"
        ):
            read_all(tmp_path, make(2.0 * peak))
        assert read_all(tmp_path, make(2.0 * peak), accept=["header"])[0].metadata["accepted"]

    def test_two_places_of_one_station(self, tmp_path):
        fault = self.faults(tmp_path, dmg_v1().replace("34.063N", "34.063S"))[0]
        assert fault.startswith("latitude of the station is -34.063 in the text of the header")

    @pytest.mark.parametrize("text", [dmg_v1(), dmg_v2(), cosmos(), smc(), dmg_pairs()])
    def test_cut_off(self, tmp_path, text):
        # Within the samples of the last channel.
        count = (text.rfind("ACCEL DATA") if "ACCEL DATA" in text else len(text)) + 1500
        cut = text[: min(count, len(text) - 1000)]
        with pytest.raises(RecordError, match=r"announces 400 samples .* the file holds only \d+"):
            read_all(tmp_path, cut)
        assert len(read_all(tmp_path, cut, accept=["samples"])) >= 1

    @pytest.mark.parametrize(
        ("text", "sentence"),
        [
            (smc(kind="3 VELOCITY"), r"line 1: an accelerogram \(type 1 or 2\) is needed"),
            (smc(kind="5 RESPONSE SPECTRA"), r"line 1: an accelerogram"),
            (smc(count=1), r"line 14: '1' samples are announced; a record has 2 to"),
            (cosmos().replace("1       1       2     120", "1       2       2     120"),
             "none of the channels of the file is an acceleration"),
            (cosmos(r61=0.0), "time step 0 s must be a positive number"),
            (cosmos(r33=-999.0, r61=-999.0), "the header states no time step"),
            (cosmos().replace("   400 accel", "   4x0 accel"), "'4x0' samples are announced"),
            (cosmos().replace(" 100 Real-header", " 999999 Real-header"), "999999 real-header"),
            (dmg_v1().replace("100 pts/sec", "0 pts/sec"), "time step 0 s must be a positive"),
            (dmg_v1().replace("at 100 pts/sec", ""), "no time step is stated"),
            (dmg_v2().replace("SPACED AT  0.020", "SPACED AT  nan"), "time step nan"),
            (dmg_v1().replace("-0.0", "-0,0", 1), r"line \d+: '.*' is not a number"),
            (dmg_v1() + "PROSE AFTER ALL\n", "a line that begins .UN.CORRECTED ACCELEROGRAM"),
        ],
    )  # fmt: skip
    def test_one_sentence(self, tmp_path, text, sentence):
        path = put(tmp_path, text)
        with pytest.raises(RecordError, match=sentence) as caught:
            read_motion(path)
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)


def test_a_header_line_without_end_takes_no_time(tmp_path):
    text = dmg_v1().replace("HYPOCENTER", "9" * 2000 + " HYPOCENTER")
    begun = time.process_time()
    assert len(read_all(tmp_path, text)) == 2
    assert time.process_time() - begun < 0.5


class TestNumbers:
    @pytest.mark.parametrize(
        ("lines", "width", "expected"),
        [
            (["1.0 2.0", "", "3.0"], None, [1, 2, 3]),
            (["1.0\t2.0\t", "3.0 "], 9, [1, 2, 3]),
            (["1.0D+00 2.0d-1"], None, [1, 0.2]),
            (["1234567812345678", "      -1"], 8, [12345678, 12345678, -1]),
            (["-2378638-2378638"], 8, [-2378638, -2378638]),
            (["30.00012.345"], 6, [30.0, 12.345]),
            ([" 1.2714E+1-3.5253E+0"], 10, [12.714, -3.5253]),
        ],
    )
    def test_in_columns_or_parted(self, lines, width, expected):
        found = numbers(lines, 1, "a", expected=len(expected), width=width)
        assert np.array_equal(found, np.array(expected, dtype=float))

    @pytest.mark.parametrize("word", ["1_0", "nan", "inf", "1e999", "0x10", "½", "--1", "1.2.3"])
    def test_what_is_none(self, word):
        with pytest.raises(RecordError, match=r"a, line 8: .* is not a (finite )?number"):
            numbers(["1.0", word], 7, "a", width=9)
