"""Numbers without sense: what no ground does, what a header contradicts, what counts twice."""

import itertools
import re

import numpy as np
import obspy
import pytest

import archfrag as af
from archfrag.motions.formats.columns import Columns
from archfrag.motions.index import load_index
from archfrag.motions.measures import odd_samples
from archfrag.motions.partners import are_one, identity_of
from archfrag.motions.read import load_motion, read_channels, read_motion

from .helpers import (
    REAL_RECORDS,
    SHIPPED,
    at2_text,
    needs_real_records,
    put,
    refused,
    wave,
)
from .samples import cosmos, dmg_v1, dyna_text, geonet_text, knet_text

DT = 0.01


def motion(count=4000, seed=3):
    """Noise between 0.5 and 8 Hz that grows and dies away, of a peak of 1 m/s2."""
    white = np.fft.rfft(np.random.default_rng(seed).standard_normal(count))
    at = np.fft.rfftfreq(count, DT)
    noise = (
        np.fft.irfft(white * ((at > 0.5) & (at < 8.0)), count) * np.hanning(count) ** 2
    )
    return noise / np.abs(noise).max()


def changed(place, values, base=None):
    samples = motion() if base is None else base
    samples[place] = values
    return samples


class TestOddSamples:
    @pytest.mark.parametrize("place", [0, 40, 1500, 2000, 3999])
    @pytest.mark.parametrize(
        "values", [[3.0], [-3.0, -3.1], [3.0, -3.0], [3.0, 3.0, 3.0]]
    )
    def test_a_spike_is_named_wherever_it_is(self, place, values):
        first = min(place, 4000 - len(values))
        (text,) = odd_samples(changed(slice(first, first + len(values)), values), DT)
        assert text.startswith("its peak, 3")
        assert "m/s2 the peak is" not in text
        assert re.search(r"such sample\(s\) the peak is (0\.[6-9]|1)", text)

    def test_two_spikes_do_not_hide_each_other(self):
        samples = changed([700, 3100], [2.5, -2.6])
        (text,) = odd_samples(samples, DT)
        assert text.startswith(
            "its peak, 2.6 m/s2 at 31 s, stands alone: without 2 such"
        )

    def test_of_a_record_with_an_offset(self):
        samples = changed(50, 3.0) + 100.0
        assert any("stands alone" in text for text in odd_samples(samples, DT))

    @pytest.mark.parametrize(("low", "high"), [(-0.4, 0.4), (-2.0, 0.5), (-0.5, 2.0)])
    def test_tops_that_are_cut_off(self, low, high):
        (text,) = odd_samples(np.clip(motion(), low, high), DT)
        assert text.endswith(
            "stays at its largest value for 3 samples or more: did the instrument clip?"
        )

    @pytest.mark.parametrize("value", [0.0, 0.3])
    def test_a_part_without_change(self, value):
        (text,) = odd_samples(changed(slice(1900, 2000), value), DT)
        assert text == "it is constant for 1 s from 19 s on: is a part of it missing?"

    @pytest.mark.parametrize(
        "samples",
        [
            motion(),
            np.sin(0.1 * np.arange(2000)),
            np.repeat([0.0, 4.9, 0.0], [50, 30, 90]),
            np.zeros(100),
            np.array([0.0, 1.0]),
            np.r_[np.zeros(900), motion(), np.zeros(900)],
            np.round(motion(), 2),
        ],
    )
    def test_others_have_no_caution(self, samples):
        assert odd_samples(samples, DT) == []

    @needs_real_records
    def test_no_real_record_has_one(self):
        table = Columns(time=1, acceleration=2)
        files = [
            path
            for place in (REAL_RECORDS, SHIPPED / "real", SHIPPED / "near_source")
            for path in sorted(place.rglob("*"))
            if path.is_file()
            and path.suffix not in (".csv", ".md", ".xml")
            and path.name != ".gitattributes"
        ]
        count = 0
        for path in files:
            options = {"columns": table} if path.parent.name == "p695_txt" else {}
            channels, _ = read_channels(path, "g" if options else None, **options)
            count += len(channels)
            for channel in channels:
                assert not channel.cautions, path
                assert not channel.sensor, path
        assert count > 150

    def test_it_reaches_the_motion_and_the_vertical(self, tmp_path):
        flawed = changed(50, 0.4, 0.1 * wave(400))
        path = put(tmp_path, at2_text(flawed), "a.AT2")
        (caution,) = read_motion(path).metadata["cautions"]
        assert caution.startswith("channel 180: its peak, 3.92")
        both = dmg_v1((0.1 * wave(400), flawed), ("90 DEG", "UP"))
        cautions = read_motion(put(tmp_path, both, "b.V1")).metadata["cautions"]
        assert cautions == [caution.replace("180", "UP").replace("3.923", "3.923")]


def sac(folder, **header):
    trace = obspy.Trace(
        0.5 * wave(400).astype("f4"), {"delta": 0.01, "station": "A", "channel": "HNE"}
    )
    trace.write(str(folder / "a.sac"), "SAC")
    content = bytearray((folder / "a.sac").read_bytes())
    floats = {"depmin": 1, "depmax": 2, "e": 6, "stdp": 34}
    integers = {"iftype": 85, "idep": 86, "leven": 105, "iqual": 93}
    for key, value in header.items():
        kind, place = ("<f4", floats[key]) if key in floats else ("<i4", integers[key])
        content[4 * place : 4 * place + 4] = np.array([value], kind).tobytes()
    return put(folder, bytes(content), "a.sac")


class TestHeadersAreRead:
    @pytest.mark.parametrize(
        ("header", "part"),
        [
            ({"iftype": 2}, "a spectrum (real and"),
            ({"iftype": 3}, "a spectrum (amplitude"),
            ({"iftype": 4}, "pairs of x and y"),
            ({"iftype": 51}, "a surface over x and y"),
            ({"leven": 0}, "unequal steps"),
            ({"idep": 7}, "a velocity"),
            ({"depmax": 5.0}, "states a peak of 5, the samples have 0.4"),
            ({"e": 39.9}, "a length of 39.9 s, 400 samples at 0.01 s last 3.99 s"),
            ({"stdp": 100.0}, "is 100 m below the surface by its SAC header"),
        ],
    )
    def test_of_sac(self, tmp_path, header, part):
        assert read_motion(sac(tmp_path), "m/s2").dt == 0.01
        refused(lambda: read_motion(sac(tmp_path, **header), "m/s2"), part)

    def test_of_sac_quality(self, tmp_path):
        (caution,) = read_motion(sac(tmp_path, iqual=47), "m/s2").metadata["cautions"]
        assert caution == "the header of channel HNE states glitches (IQUAL)"

    @pytest.mark.parametrize(
        ("code", "what"),
        [
            ("HHE", "a seismometer"),
            ("BDF", "a pressure gauge"),
            ("HJ1", "a rotational sensor"),
            ("LFN", "a magnetometer"),
            ("HNE", ""),
            ("DWN", ""),
            ("HGE", ""),
        ],
    )
    def test_of_the_instrument_by_its_code(self, tmp_path, code, what):
        trace = obspy.Trace(wave(400), {"delta": 0.01, "station": "A", "channel": code})
        trace.write(str(tmp_path / "a.mseed"), "MSEED")
        if what:
            refused(lambda: read_motion(tmp_path / "a.mseed", "m/s2"), what)
        elif code != "DWN":
            assert read_motion(tmp_path / "a.mseed", "m/s2").dt == 0.01

    @pytest.mark.parametrize(
        ("text", "part"),
        [
            (
                lambda: dyna_text(98.0 * wave(400), duration_s="20.0"),
                "a length of 20 s, 400 samples",
            ),
            (
                lambda: dyna_text(98.0 * wave(400), sensor_depth_m="70"),
                "70 m below the surface",
            ),
            (
                lambda: cosmos(r62=40.0),
                "a length of 40 s, 400 samples at 0.005 s last 1.995 s",
            ),
            (
                lambda: geonet_text({"S16W": 980.0 * wave(400)}).replace(
                    "Duration 2.", "Duration 22."
                ),
                "a length of 22",
            ),
            (
                lambda: dmg_v1(
                    (0.1 * wave(400),), ("90 DEG  LOCATION: ROOF - CENTER",)
                ),
                "structure",
            ),
            (
                lambda: dmg_v1((0.1 * wave(400),), ("90 DEG  LOCATION: 13TH FLOOR",)),
                "structure",
            ),
            (lambda: knet_text(np.round(1e5 * wave()).astype(int), 1), "borehole"),
        ],
    )
    def test_of_text_formats(self, tmp_path, text, part):
        refused(lambda: read_motion(put(tmp_path, text(), "record.txt")), part)

    def test_of_a_late_trigger(self, tmp_path):
        text = dyna_text(98.0 * wave(400), **{"late/normal_triggered": "LT"})
        (caution,) = read_motion(put(tmp_path, text)).metadata["cautions"]
        assert "triggered late" in caution

    @pytest.mark.parametrize(
        "place", ["GROUND FLOOR", "FREEFIELD", "1ST FLOOR", "BASEMENT"]
    )
    def test_a_sensor_on_the_ground_is_read(self, tmp_path, place):
        text = dmg_v1((0.1 * wave(400),), (f"90 DEG  LOCATION: {place}",))
        assert "cautions" not in read_motion(put(tmp_path, text)).metadata


TWO = "\n".join(f"{0.01 * i:.2f} {value:.5f}" for i, value in enumerate(wave(400)))
ONE = "\n".join(f"{value:.5f}" for value in wave(400))


class TestLinesBeforeColumns:
    @pytest.mark.parametrize(
        ("head", "part"),
        [
            ("# acceleration (cm/s^2)", "COLUMNS header states 'cm/s2'"),
            ("# Acc. in units of G", "states 'g'"),
            ("# accel [gals]", "states 'gal'"),
            ("# accel [cm/s²]", "states 'cm/s2'"),
            ("# accel (mg)", "an acceleration in another unit"),
            ("# accel, ft/s2: unit = ft/s2", "another unit"),
            ("# velocity [m/s]", "'velocity'"),
            ("# DT = 0.005 sec", "state a step of 0.005 s, 0.01 s is used"),
            ("# Sampling rate 200 Hz", "a step of 0.005 s"),
            ("# sample_rate_hz: 50", "0.02 s"),
            ("# NPTS= 4000", "announces 4000 samples"),
            ("400", "400 is how many numbers follow"),
            ("400\n0.01", "400 is how many numbers follow"),
        ],
    )
    def test_are_compared_with_what_is_given(self, tmp_path, head, part):
        path = put(tmp_path, f"{head}\n{ONE}\n")
        refused(lambda: read_motion(path, "m/s2", columns=Columns(dt=0.01)), part)

    @pytest.mark.parametrize(
        "head",
        [
            "# acceleration (m/s/s), 400 samples at 0.01 s",
            "# Gubbio (PG), filtered 0.1-50 Hz",
            "# Sampling Freq(Hz) 100Hz",
            "# DT= .01 NPTS= 400",
            "# Vs30 760 (m/s)",
        ],
    )
    def test_that_agree_pass(self, tmp_path, head):
        path = put(tmp_path, f"{head}\n{ONE}\n")
        assert read_motion(path, "m/s2", columns=Columns(dt=0.01)).pga == pytest.approx(
            1, abs=0.01
        )

    def test_state_the_unit_if_none_is_given(self, tmp_path):
        path = put(tmp_path, f"time [s]  acceleration [cm/s2]\n{TWO}\n")
        read = read_motion(path, columns=Columns(time=1, acceleration=2, skip=1))
        assert read.pga == pytest.approx(0.01, rel=0.01)

    def test_of_geocsv_are_those_of_the_column(self, tmp_path):
        path = put(
            tmp_path,
            "# field_unit: s, M/S**2, M\n" + TWO.replace("\n", " 7\n") + " 7\n",
        )
        refused(
            lambda: read_motion(path, "g", columns=Columns(time=1, acceleration=2)),
            "'m/s2'",
        )

    def test_of_tspair_are_times(self, tmp_path):
        trace = obspy.Trace(
            wave(400), {"delta": 0.01, "station": "A", "channel": "HNE"}
        )
        trace.write(str(tmp_path / "a.txt"), "TSPAIR")
        text = (tmp_path / "a.txt").read_text()
        assert read_motion(tmp_path / "a.txt", "m/s2").dt == 0.01
        put(tmp_path, text.replace(" 100 sps", " 200 sps"))
        refused(
            lambda: read_motion(tmp_path / "a.txt", "m/s2"),
            "0.01 s apart, its header states",
        )


class TestIndex:
    def rows(
        self, folder, *rows, head="id,file,unit,component,Mw,distance_km,Vs30_mps"
    ):
        for name in ("one.AT2", "two.AT2"):
            put(folder, at2_text(0.1 * wave(400), component="180"), name)
        return put(folder, "\n".join([head, *rows]) + "\n", "own.csv")

    @pytest.mark.parametrize(
        ("row", "part"),
        [
            ("a,one.AT2,,,100,,", "Mw = 100 is impossible; it must be 0 to 10"),
            ("a,one.AT2,,,-3,,", "Mw = -3"),
            ("a,one.AT2,,,,-1,", "distance_km = -1"),
            ("a,one.AT2,,,,50000,", "distance_km = 50000"),
            ("a,one.AT2,,,,,0", "Vs30_mps = 0"),
        ],
    )
    def test_an_impossible_number_is_refused(self, tmp_path, row, part):
        refused(lambda: load_index(self.rows(tmp_path, row)), part)

    @pytest.mark.parametrize(
        ("row", "part"),
        [
            (
                "a,one.AT2,,,9.9,,",
                "Mw = 9.9: usual are 3 to 9.6; is it a moment magnitude?",
            ),
            ("a,one.AT2,,,6,12000,", "distance_km = 1.2e+04 km"),
            ("a,one.AT2,,,6,12,2.5", "Vs30_mps = 2.5"),
        ],
    )
    def test_an_unusual_one_is_asked_about(self, tmp_path, row, part):
        (entry,) = load_index(self.rows(tmp_path, row))
        assert any(part in text for text in load_motion(entry).metadata["cautions"])

    @pytest.mark.parametrize(
        "rows",
        [
            ("a,one.AT2,,,,,", "b,one.AT2,,,,,"),
            ("a,one.AT2,,,,,", "b,./one.AT2,,,,,"),
            ("a,one.AT2,,180,,,", "b,one.AT2,,180,,,"),
        ],
    )
    def test_a_component_counts_once(self, tmp_path, rows):
        refused(
            lambda: load_index(self.rows(tmp_path, *rows)),
            "ids 'a' and 'b' are of one file",
        )

    @pytest.mark.parametrize("listed", ["ZZZ", "90", "NS1E", "foo", "HNE?"])
    def test_a_component_that_the_file_has_not_is_refused(self, tmp_path, listed):
        (entry,) = load_index(self.rows(tmp_path, f"a,one.AT2,,{listed},,,"))
        refused(
            lambda: load_motion(entry),
            f"no horizontal component {listed!r}; there is 180",
        )

    @pytest.mark.parametrize("listed", ["180", "S", "H1", "X", ""])
    def test_and_one_in_other_words_is_read(self, tmp_path, listed):
        (entry,) = load_index(self.rows(tmp_path, f"a,one.AT2,,{listed},,,"))
        assert load_motion(entry).dt == 0.01

    def test_of_windows_and_of_excel(self, tmp_path):
        (tmp_path / "sub").mkdir()
        put(tmp_path / "sub", at2_text(wave(400)), "a.AT2")
        path = put(tmp_path, "sep=;\r\nid;file;unit\r\na;sub\\a.AT2;\r\n", "own.csv")
        (entry,) = load_index(path)
        assert load_motion(entry).dt == 0.01


class TestTwins:
    def made(self, **about):
        facts = {
            "station": "ABC",
            "component": "HNE",
            "start_time": "2001-01-01T00:00:00Z",
        }
        return af.Motion(
            about.pop("samples", motion()), DT, id="m", metadata={**facts, **about}
        )

    @pytest.mark.parametrize(
        ("about", "one"),
        [
            ({}, True),
            ({"samples": motion(seed=4)}, True),
            ({"component": "90"}, True),
            ({"samples": motion(seed=4), "component": "HNN"}, False),
            ({"samples": motion(seed=4), "station": "DEF"}, False),
            ({"samples": motion(seed=4), "trace": "X.ABC.10.HNE"}, False),
            ({"samples": motion(seed=4), "start_time": "2001-01-01T00:00:30Z"}, True),
            ({"samples": motion(seed=4), "start_time": "2001-01-01T03:00:00Z"}, False),
            (
                {
                    "samples": motion(seed=4),
                    "start_time": "",
                    "level": "raw",
                    "event": "e",
                },
                False,
            ),
            ({"samples": 2.0 * motion(), "station": ""}, False),
            ({"station": "", "component": ""}, True),
        ],
    )
    def test_are_copies_and_versions_of_one_component(self, about, one):
        pair = identity_of(self.made()), identity_of(self.made(**about))
        assert are_one(*pair) == are_one(*pair[::-1]) == one

    @pytest.mark.parametrize(
        ("level", "one"), [("processed", True), ("raw", False), ("", False)]
    )
    def test_without_a_time_are_versions_of_one_event(self, level, one):
        about = {"start_time": "", "event": "Quake 1999"}
        first = self.made(**about, level="raw")
        other = self.made(**about, level=level, samples=motion(seed=4))
        assert are_one(identity_of(first), identity_of(other)) == one

    @needs_real_records
    def test_are_not_found_among_real_records(self):
        motions = af.read_motions(SHIPPED / "real" / "index.csv")
        facts = list(map(identity_of, motions))
        assert not any(
            are_one(one, other) for one, other in itertools.combinations(facts, 2)
        )
