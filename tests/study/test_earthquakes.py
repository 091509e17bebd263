"""Which records are of one earthquake, and which files are components of one record."""

import numpy as np
import pytest
from obspy import Stream, Trace, UTCDateTime

import archfrag as af
from archfrag.errors import RecordError
from archfrag.study.file.prepared import prepare_motions
from archfrag.study.file.schema import load_study
from tests.motions.helpers import at2_text, refused, wave
from tests.motions.samples import knet_text, resorce_text
from tests.study.small import TEXT, small_study

FILES = 'files: ["records/*.AT2"]'
START = UTCDateTime(2019, 3, 1)


def study_of(folder, motions, text=TEXT):
    return load_study(small_study(folder, text.replace(FILES, motions)))


def events(folder, motions):
    """Earthquakes of the records of a study by their ids."""
    return {
        record.id: record.event for record in prepare_motions(study_of(folder, motions))
    }


def seed(path, *codes, start=START, station="S"):
    """A miniSEED file of channels that differ."""
    header = {"network": "XX", "station": station, "delta": 0.01, "starttime": start}
    Stream(
        Trace(wave(frequency=1.0 + len(code) + i), {**header, "channel": code})
        for i, code in enumerate(codes)
    ).write(str(path), format="MSEED")


def columns(path, frequency, count=400):
    rows = zip(np.arange(count) * 0.01, wave(count, frequency=frequency))
    path.write_text("".join(f"{time:.2f} {value:.6f}\n" for time, value in rows))


SEED = "files: [{path: 'own/*.mseed', unit: m/s2}]"
TEXTS = "files: [{path: 'own/*.txt', unit: m/s2, columns: 'time=1,acceleration=2'}]"


@pytest.fixture
def own(tmp_path):
    (tmp_path / "own").mkdir()
    return tmp_path / "own"


class TestEarthquakes:
    def test_components_of_a_file_are_of_one(self, own):
        seed(own / "a.mseed", "HNE", "HNN", "BNE", "BNN")
        seed(own / "b.mseed", "HNE", "HNN", start=START + 1e5)
        seed(own / "c.mseed", "HNE", start=START + 2e5)
        found = events(own.parent, SEED)
        assert len(found) == 7
        assert (
            len({event for name, event in found.items() if name.startswith("a:")}) == 1
        )
        assert found["a:HNE"] != found["b:HNE"] == found["b:HNN"]
        assert found["c"] == ""

    def test_files_that_start_together_or_overlap_are_of_one(self, own):
        for name, later in (("a", 0.0), ("b", 3.0), ("c", 59.0), ("d", 400.0)):
            seed(
                own / f"{name}.mseed", "HNE", start=START + later, station=name.upper()
            )
        found = events(own.parent, SEED)
        assert set(found.values()) == {"earthquake of a", ""}
        assert found["d"] == ""

    def test_of_one_origin_time_and_borehole_sensors_are_named(self, own):
        counts = np.round(1e5 * wave(800)).astype(int)
        for name, number in (("A.NS1", 1), ("A.NS2", 4), ("B.NS2", 4)):
            (own / name).write_text(knet_text(counts, number))
        with pytest.raises(
            RecordError, match=r"A\.NS1: channel NS1 is in the borehole"
        ):
            prepare_motions(study_of(own.parent, 'files: ["own/*.NS?"]'))
        every = 'files: [{path: "own/*.NS?", accept: sensor}]'
        records = prepare_motions(study_of(own.parent, every))
        assert {record.event for record in records} == {"earthquake of A.NS1"}
        assert "channel NS1 is in the borehole" in records[0].waivers

    def test_the_origin_time_of_headers_without_a_name(self, own):
        for name in ("a", "b"):
            (own / f"{name}.acc").write_text(
                resorce_text(wave(frequency=len(name) + 1.0))
            )
        (own / "c.acc").write_text(resorce_text(wave()).replace("04:05:06", "14:05:06"))
        found = events(own.parent, 'files: ["own/*.acc"]')
        assert found == {"a": "earthquake of a", "b": "earthquake of a", "c": ""}

    def test_text_files_that_are_components_by_name_and_length(self, own):
        for i, name in enumerate(("k_N", "k_E", "m_N", "m_E")):
            columns(own / f"{name}.txt", 1.0 + i, 400 if name != "m_E" else 300)
        for number in (10, 100):
            columns(own / f"run{number}.txt", 0.01 * number + 5.0)
        found = events(own.parent, TEXTS)
        assert found.pop("k_N") == found.pop("k_E") == "earthquake of k_E"
        assert set(found.values()) == {""}

    def test_names_rule_and_are_lent_to_records_without_one(self, own):
        for name, later in (("a", 0.0), ("b", 1.0), ("c", 2.0), ("d", 1e5), ("e", 1e5)):
            seed(own / f"{name}.mseed", "HNE", start=START + later)
        rows = ["a,One", "b,Two", "c,", "d,Three", "e,"]
        lines = (f"{row[0]},own/{row[0]}.mseed,m/s2,{row[2:]}" for row in rows)
        (own.parent / "index.csv").write_text(
            "\n".join(["id,file,unit,event", *lines, ""])
        )
        found = events(own.parent, "index: index.csv")
        assert found == {"a": "One", "b": "Two", "c": "", "d": "Three", "e": "Three"}

    def test_motions_in_python_keep_what_shows_it(self, own, tmp_path):
        seed(own / "a.mseed", "HNE", "HNN")
        motions = list(af.read_motions(own / "a.mseed", unit="m/s2"))
        study = af.Study(af.Block(0.4, 2.0, 0.8), motions, levels=[0.2])
        path = study.to_file(tmp_path / "study.yaml")
        one, other = prepare_motions(load_study(path))
        assert one.event == other.event == "earthquake of a:HNE"

    def test_a_direction_in_the_title_of_at2_is_no_other_event(self, own):
        for code in ("180", "270"):
            text = at2_text(0.1 * wave(), component=code).split("\n")
            text[1] = f"El Centro {code}"
            (own / f"e{code}.AT2").write_text("\n".join(text))
        assert set(events(own.parent, 'files: ["own/*.AT2"]').values()) == {"El Centro"}


class TestNumberedFiles:
    ROTATED = TEXT.replace("PGA", "RotD50(PGA)")

    def test_numbers_that_differ_by_ninety_are_no_evidence(self, own):
        for number in (10, 100):
            columns(own / f"run{number}.txt", 0.01 * number + 1.0)
        study = study_of(own.parent, TEXTS, self.ROTATED)
        alike = (
            "has nearly the same name, but neither start, event and station nor length"
        )
        refused(lambda: prepare_motions(study), "run10", alike)
        for number in (10, 100):
            (own / f"run{number}.txt").rename(own / f"run{number:03d}.txt")
        assert len(prepare_motions(study)) == 2

    def test_azimuths_need_equal_lengths_or_starts(self, own):
        for code, count in (("000", 400), ("090", 380)):
            columns(own / f"q{code}.txt", 1.0, count)
        study = study_of(own.parent, TEXTS, self.ROTATED)
        with pytest.raises(RecordError, match=r"q090\.txt has nearly the same name"):
            prepare_motions(study)
