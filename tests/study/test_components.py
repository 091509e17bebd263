"""Components of a study's records: verticals, pairs, and what is done to them."""

import json
import shutil

import numpy as np
import pytest

from archfrag.errors import RecordError
from archfrag.motions.partners import partners
from archfrag.study.checks import check_study, uncorrected
from archfrag.study.file.records import load_record, prepare_motions
from archfrag.study.file.schema import load_study
from tests.motions.helpers import at2_text, wave
from tests.motions.samples import geonet_text
from tests.study.small import TEXT, cube_of, small_study

G = 9.80665
FILES = 'files: ["records/*.AT2"]'
CODES = {"000": ("Q-ELC000.AT2", 1.5), "090": ("Q-ELC090.AT2", 2.5), "UP": ("Q-ELC-UP.AT2", 4.0)}


def study_with(tmp_path, motions, text=TEXT):
    """Three components of one record, in files of their own."""
    path = small_study(tmp_path, text.replace(FILES, motions))
    (tmp_path / "quake").mkdir(exist_ok=True)
    for code, (name, frequency) in CODES.items():
        samples = at2_text(0.2 * wave(frequency=frequency), component=code)
        (tmp_path / "quake" / name).write_text(samples)
    return load_study(path)


def stored(study):
    return {record.id: load_record(study.work, record) for record in prepare_motions(study)}


class TestVertical:
    def test_comes_from_the_file_beside_the_record_if_it_is_asked_for(self, tmp_path):
        files = 'files: ["quake/*.AT2"]'
        motions = stored(study_with(tmp_path, f"{files}\n  vertical: true"))
        assert set(motions) == {"Q-ELC000", "Q-ELC090"}
        for motion in motions.values():
            assert np.allclose(motion.vertical, 0.2 * G * wave(frequency=4.0), atol=1e-6)
            assert motion.metadata["vertical_component"] == "UP"
            assert any(line.startswith("Vertical UP: Read from Q-ELC-UP") for line in motion.log)
        plain = stored(study_with(tmp_path, files)).values()
        assert [motion.vertical for motion in plain] == [None, None]
        with pytest.raises(RecordError, match=r"wave0\.AT2: record wave0 has no vertical comp"):
            stored(study_with(tmp_path, f"{FILES}\n  vertical: true"))

    def test_rows_of_an_index_are_paired_by_event_and_station(self, tmp_path):
        study = study_with(tmp_path, "index: index.csv\n  vertical: true")
        names = {"a.AT2": "000", "b.AT2": "UP", "c.AT2": "090"}
        for name, code in names.items():
            (tmp_path / "quake" / CODES[code][0]).rename(tmp_path / "quake" / name)
        rows = [f"{name[0]},quake/{name},g,E1,S1,{code}\n" for name, code in names.items()]
        head = "id,file,unit,event,station,component\n"
        (tmp_path / "index.csv").write_text(head + "".join(rows))
        motions = stored(study)
        assert list(motions) == ["a", "c"]
        assert np.allclose(motions["c"].vertical, 0.2 * G * wave(frequency=4.0), atol=1e-6)

    def test_is_in_the_same_file_and_left_out_unless_asked_for(self, tmp_path):
        from obspy import Stream, Trace

        header = {"delta": 0.01, "network": "XX", "station": "S"}
        Stream(
            Trace(wave(frequency=f), header={**header, "channel": code})
            for code, f in (("HNE", 1.0), ("HNN", 2.0), ("HNZ", 3.0))
        ).write(str(tmp_path / "three.mseed"), format="MSEED")
        files = "files: [{path: three.mseed, unit: m/s2}]"
        plain = stored(study_with(tmp_path, files))
        assert [motion.vertical for motion in plain.values()] == [None, None]
        assert "Vertical component left out." in plain["three:HNE"].log
        both = stored(study_with(tmp_path, f"{files}\n  vertical: true"))
        assert np.allclose(both["three:HNN"].vertical, wave(frequency=3.0))


class TestPairs:
    """Files that each hold one component, by their names."""

    @pytest.mark.parametrize(
        "names", ["quake1 quake2 quake3 quake4", "001 002", "max may", "000 090 180 270", "1 2 V",
                  "S16W S16E", "20160824013632 20160824013722"],
    )  # fmt: skip
    def test_names_that_are_alike_are_no_pair(self, names):
        assert partners([f"{name}.AT2" for name in names.split()]) == ({}, {})

    @pytest.mark.parametrize(
        "names", ["ARL090 ARL360", "A.EW2 A.NS2", "HI.A..HNE.D HI.A..HNN.D", "17_H1.cor 17_H2.cor",
                  "C_S16W C_N74W", "a_x a_y"],
    )  # fmt: skip
    def test_directions_at_right_angles_are(self, names):
        one, other = (f"{name}.AT2" for name in names.split())
        assert partners([one, other]) == ({one: other, other: one}, {})

    def test_rotd_needs_both_and_validate_names_them(self, tmp_path):
        text = TEXT.replace("PGA", "RotD50(PGA)")
        with pytest.raises(RecordError, match="record wave0 has no other horizontal component"):
            check_study(study_with(tmp_path, FILES, text))
        one, other = (CODES[code][0] for code in ("000", "090"))
        study = study_with(tmp_path, 'files: ["quake/*.AT2"]', text)
        named = check_study(study)["partners"]
        assert set(named) == {f"{one} with {other}", f"{other} with {one}"}
        assert any(f"from {other}" in line for line in stored(study)["Q-ELC000"].log)


class TestProcessing:
    def test_rotation_makes_one_motion_of_two_files(self, tmp_path):
        steps = "vertical: true\n  processing: [{rotate: {azimuth: 90}}]"
        study = study_with(tmp_path, f'files: ["q*/Q-ELC0*.AT2"]\n  {steps}')
        ((name, motion),) = stored(study).items()
        assert name == "Q-ELC0"
        assert np.allclose(motion.acceleration, 0.2 * G * wave(frequency=2.5), atol=1e-6)
        assert motion.vertical is not None
        shutil.copytree(tmp_path / "quake", tmp_path / "quiet")  # files of the same names
        assert sorted(name[:5] for name in stored(study)) == ["quake", "quiet"]

    def test_choice_of_components(self, tmp_path):
        files = 'files: ["quake/Q-ELC0*.AT2"]\n  processing: [{choose: {components: ["%s"]}}]'
        assert list(stored(study_with(tmp_path, files % "090"))) == ["Q-ELC090"]
        with pytest.raises(RecordError, match=r"\(000\): has none of the components 180 that"):
            prepare_motions(study_with(tmp_path, files % "180"))

    def test_raw_records_that_nothing_corrects_are_a_caution(self, tmp_path):
        samples = 100.0 * np.sin(0.1 * np.arange(400))

        def cautions(more):
            study = study_with(tmp_path, f'files: ["quake/Q-ELC000.AT2", raw.V1A]{more}')
            text = geonet_text({"S16W": samples, "Up": samples})
            (tmp_path / "raw.V1A").write_text(text)
            checked = check_study(study)["cautions"]
            prepare_motions(study)
            return checked[-1:], list(uncorrected(study))

        (checked,), after = cautions("")
        assert after == [checked]
        assert checked.startswith("1 of 2 records raw, as recorded (")
        assert cautions("\n  processing: [{bandpass: {lowest: 0.2}}]")[1] == []


def test_the_cube_states_processing_and_verticals(tmp_path):
    text = TEXT.replace("levels: [0.1, 0.6, 1.2]", "levels: [0.1]")
    motions = 'files: ["quake/Q-ELC000.AT2"]\n  vertical: true\n  processing: [demean]'
    _, cube = cube_of(study_with(tmp_path, motions, text))
    assert cube.attrs["vertical_component"] == "used"
    assert cube["record_vertical"].values.tolist() == [1]
    steps = json.loads(cube.attrs["archfrag_processing"])
    assert steps == [{"step": "demean", "settings": {}}]
