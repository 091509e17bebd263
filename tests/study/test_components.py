"""Records of a study: found, read, scaled and stored; their verticals, pairs and processing."""

import json
import shutil

import numpy as np
import pytest
from obspy import Stream, Trace

from archfrag.errors import InputError, RecordError
from archfrag.motions.measures import measure
from archfrag.motions.partners import partners
from archfrag.study.designs import CASE
from archfrag.study.file.prepared import load_prepared, load_record, prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.provenance import sha256_of
from archfrag.study.runs.store import make_plan
from archfrag.study.validate import check_study, suspicious
from tests.motions.helpers import at2_text, wave
from tests.motions.samples import geonet_text
from tests.study.small import ROOT, TEXT, cube_of, small_study, write_at2

G = 9.80665
FILES = 'files: ["records/*.AT2"]'
INDEX = ROOT / "records" / "index.csv"
CODES = {
    "000": ("Q-ELC000.AT2", 1.5),
    "090": ("Q-ELC090.AT2", 2.5),
    "UP": ("Q-ELC-UP.AT2", 4.0),
}


def study_with(tmp_path, motions, text=TEXT):
    """Three components of one record, in files of their own."""
    path = small_study(tmp_path, text.replace(FILES, motions))
    (tmp_path / "quake").mkdir(exist_ok=True)
    for code, (name, frequency) in CODES.items():
        samples = at2_text(0.2 * wave(frequency=frequency), component=code)
        (tmp_path / "quake" / name).write_text(samples)
    return load_study(path)


def stored(study):
    return {
        record.id: load_record(study.work, record) for record in prepare_motions(study)
    }


class TestVertical:
    def test_comes_from_the_file_beside_the_record_if_it_is_asked_for(self, tmp_path):
        files = 'files: ["quake/*.AT2"]'
        motions = stored(study_with(tmp_path, f"{files}\n  vertical: true"))
        assert set(motions) == {"Q-ELC000", "Q-ELC090"}
        for motion in motions.values():
            assert np.allclose(
                motion.vertical, 0.2 * G * wave(frequency=4.0), atol=1e-6
            )
            assert motion.facts.of_vertical.component == "UP"
            assert any(
                line.startswith("Vertical UP: Read from Q-ELC-UP")
                for line in motion.log
            )
        plain = stored(study_with(tmp_path, files)).values()
        assert [motion.vertical for motion in plain] == [None, None]
        with pytest.raises(
            RecordError, match=r"wave0\.AT2: record wave0 has no vertical comp"
        ) as why:
            stored(study_with(tmp_path, f"{FILES}\n  vertical: true"))
        assert "leave this record out, or ask for no such" in str(why.value)

    def test_rows_of_an_index_are_paired_by_event_and_station(self, tmp_path):
        study = study_with(tmp_path, "index: index.csv\n  vertical: true")
        names = {"a.AT2": "000", "b.AT2": "UP", "c.AT2": "090"}
        for name, code in names.items():
            (tmp_path / "quake" / CODES[code][0]).rename(tmp_path / "quake" / name)
        rows = [
            f"{name[0]},quake/{name},g,E1,S1,{code}\n" for name, code in names.items()
        ]
        head = "id,file,unit,event,station,component\n"
        (tmp_path / "index.csv").write_text(head + "".join(rows))
        motions = stored(study)
        assert list(motions) == ["a", "c"]
        assert np.allclose(
            motions["c"].vertical, 0.2 * G * wave(frequency=4.0), atol=1e-6
        )

    def test_is_in_the_same_file_and_left_out_unless_asked_for(self, tmp_path):
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
    @pytest.mark.parametrize(
        "names",
        [
            "quake1 quake2 quake3 quake4",
            "001 002",
            "max may",
            "000 090 180 270",
            "1 2 V",
            "S16W S16E",
            "20160824013632 20160824013722",
        ],
    )
    def test_names_that_are_alike_are_no_pair(self, names):
        assert partners([f"{name}.AT2" for name in names.split()]) == ({}, {})

    @pytest.mark.parametrize(
        "names",
        [
            "ARL090 ARL360",
            "A.EW2 A.NS2",
            "HI.A..HNE.D HI.A..HNN.D",
            "17_H1.cor 17_H2.cor",
            "C_S16W C_N74W",
            "a_x a_y",
        ],
    )
    def test_directions_at_right_angles_are(self, names):
        one, other = (f"{name}.AT2" for name in names.split())
        assert partners([one, other]) == ({one: other, other: one}, {})

    def test_rotd_needs_both_and_validate_names_them(self, tmp_path):
        text = TEXT.replace("PGA", "RotD50(PGA)")
        with pytest.raises(
            RecordError, match=r"has no transverse .* leave this record out, or ask"
        ):
            check_study(study_with(tmp_path, FILES, text))
        one, other = (CODES[code][0] for code in ("000", "090"))
        study = study_with(tmp_path, 'files: ["quake/*.AT2"]', text)
        named = check_study(study)["partners"]
        assert set(named[:2]) == {f"{one} with {other}", f"{other} with {one}"}
        assert "vertical component that is not used; motions.vertical: true" in named[2]
        assert any(f"from {other}" in line for line in stored(study)["Q-ELC000"].log)


class TestProcessing:
    def test_rotation_makes_one_motion_of_two_files(self, tmp_path):
        steps = "vertical: true\n  processing: [{rotate: {azimuth: 90}}]"
        study = study_with(tmp_path, f'files: ["q*/Q-ELC0*.AT2"]\n  {steps}')
        ((name, motion),) = stored(study).items()
        assert name == "Q-ELC0"
        assert np.allclose(
            motion.acceleration, 0.2 * G * wave(frequency=2.5), atol=1e-6
        )
        assert motion.vertical is not None
        shutil.copytree(
            tmp_path / "quake", tmp_path / "quiet"
        )  # files of the same names
        assert sorted(name[:5] for name in stored(study)) == ["quake", "quiet"]

    def test_choice_of_components(self, tmp_path):
        files = 'files: ["quake/Q-ELC0*.AT2"]\n  processing: [{choose: {components: ["%s"]}}]'
        assert list(stored(study_with(tmp_path, files % "090"))) == ["Q-ELC090"]
        with pytest.raises(
            RecordError, match=r"\(000\): has none of the components 180 that"
        ):
            prepare_motions(study_with(tmp_path, files % "180"))

    def test_cautions_on_a_motion_follow_from_its_samples_after_processing(
        self, tmp_path
    ):
        drifting = 50.0 * wave(2400, 0.005) + 10.0 * np.sin(
            np.linspace(0.0, 2.0 * np.pi, 2400)
        )

        def cautions(more):
            study = study_with(
                tmp_path, f'files: ["quake/Q-ELC000.AT2", raw.V1A]{more}'
            )
            (tmp_path / "raw.V1A").write_text(
                geonet_text({"S16W": drifting, "Up": drifting})
            )
            checked = list(check_study(study)["cautions"])
            assert checked == list(suspicious(prepare_motions(study)))
            return checked

        (checked,) = cautions("")
        assert checked.startswith("raw: its velocity on average is ")
        assert "of PGV: the baseline drifts" in checked
        assert cautions("\n  processing: [{bandpass: {lowest: 0.5}}]") == []


def test_the_cube_states_processing_and_verticals(tmp_path):
    text = TEXT.replace("levels: [0.1, 0.6, 1.2]", "levels: [0.1]")
    motions = 'files: ["quake/Q-ELC000.AT2"]\n  vertical: true\n  processing: [demean]'
    _, cube = cube_of(study_with(tmp_path, motions, text))
    assert cube.attrs["vertical_component"] == "used"
    assert cube["record_vertical"].values.tolist() == [1]
    steps = json.loads(cube.attrs["archfrag_processing"])
    assert steps == [{"step": "demean", "settings": {}}]


@pytest.mark.parametrize(
    "steps", ["[]", "[{trim: {arias: [0.2, 0.8]}}, {resample: {dt: 0.005}}]"]
)
@pytest.mark.parametrize(
    "name",
    ["PGA", "PGV", "Arias", "Sa(0.5)", "AvgSA(0.2,1.0)", "Sa_avg2(0.5)", "FIV3(0.3)"],
)
def test_factors_bring_the_record_as_processed_to_each_level(tmp_path, name, steps):
    text = TEXT.replace(FILES, f"{FILES}\n  processing: {steps}")
    unit = {"PGV": "m/s", "Arias": "m/s", "FIV3(0.3)": "m/s"}.get(name, "g")
    text = text.replace("measure: PGA", f'measure: "{name}"').replace(
        "unit: g", f"unit: {unit}"
    )
    study = load_study(small_study(tmp_path, text))
    prepare_motions(study)
    plan = make_plan(study)
    for number, record in enumerate(plan.records):
        motion = load_record(study.work, record)
        cases = np.zeros(len(plan.levels), CASE)
        cases["record"] = number
        cases["level"] = plan.levels
        assert record.dt == motion.dt == pytest.approx(0.01 if steps == "[]" else 0.005)
        reached = [
            measure(motion.scaled(factor), name) for factor in plan.factors(cases)
        ]
        np.testing.assert_allclose(reached, study.intensity.si, rtol=1e-9)


def test_prepared_records_are_found_again_with_their_origin(tmp_path):
    study = study_with(tmp_path, FILES)
    with pytest.raises(
        InputError, match=r"motions\.json: the motions are not prepared yet"
    ):
        load_prepared(study)
    prepared = prepare_motions(study)
    assert load_prepared(study) == prepared
    assert [record.id for record in prepared] == ["wave0", "wave1"]
    digest = sha256_of(tmp_path / "records" / "wave1.AT2")
    assert (prepared[1].file, prepared[1].file_sha256) == ("wave1.AT2", digest)
    motion = load_record(study.work, prepared[1])
    assert (motion.id, motion.dt, motion.metadata["file_sha256"]) == (
        "wave1",
        0.01,
        digest,
    )
    assert load_prepared(load_study(small_study(tmp_path), ["intensity.levels=[0.2]"]))
    other = load_study(small_study(tmp_path), ["intensity.measure=Sa(0.5)"])
    with pytest.raises(
        InputError, match="was made for other records or another measure"
    ):
        load_prepared(other)
    (study.work / "motions.json").write_text("{")
    with pytest.raises(InputError, match=r"motions\.json: is damaged"):
        load_prepared(study)


def test_shipped_records_are_selected_in_order_and_ids_occur_once(tmp_path):
    study = study_with(
        tmp_path, f"index: {INDEX}\n  select: [syn-m70-r020, syn-m55-r010]"
    )
    prepared = prepare_motions(study)
    found = [(record.id, record.magnitude, record.distance_km) for record in prepared]
    assert found == [("syn-m70-r020", 7.0, 20.0), ("syn-m55-r010", 5.5, 10.0)]
    write(tmp_path / "records", "syn-m55-r010.AT2")
    message = r"\.AT2: the record id 'syn-m55-r010' already belongs to"
    with pytest.raises(RecordError, match=message):
        prepare_motions(study_with(tmp_path, f"{FILES}\n  index: {INDEX}"))


def write(folder, *names):
    for path in (folder / name for name in names):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_at2(path, np.sin(np.arange(50.0)), 0.01)


def ids(study):
    return [record.id for record in prepare_motions(study)]


def test_two_records_of_one_name_are_distinguished_by_their_folders(tmp_path):
    motions = 'files: ["records/*.AT2", "more/**/*.AT2", "H.AT2"]'
    for place in ("here", "there/again"):
        study = study_with(tmp_path / place, motions)
        more = [f"more/{name}.AT2" for name in ("wave1", "H", "1/H", "b/1/H", "other")]
        write(tmp_path / place, "H.AT2", *more)
        distinct = "H more+1+H more+H more+b+1+H more+wave1 other records+wave1 wave0"
        assert sorted(ids(study)) == distinct.split()


def test_the_same_file_by_two_patterns_is_one_record(tmp_path):
    both = study_with(tmp_path, 'files: ["records/*.AT2", "records/*.at2"]')
    assert ids(both) == ["wave0", "wave1"]
    study = study_with(
        tmp_path, 'files: ["records/*", {path: "records/wave1.AT2", unit: g}]'
    )
    with pytest.raises(
        InputError, match=r"motions\.files\[1\]: an earlier entry matches .*1"
    ):
        prepare_motions(study)


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("*[!t]", "ARL360 nis090"),
        ("*.AT2", "ARL360 nis090"),
        ("ARL[2-4]60.At2", "ARL360"),
        ("a[r]L*", "ARL360"),
        ("[!a-fx-z]*.AT2", "nis090"),
        ("?RL360.aT2", "ARL360"),
    ],
)
def test_patterns_match_in_any_case(tmp_path, pattern, found):
    study = study_with(tmp_path, f'files: ["data [1]/{pattern}"]')
    names = "ARL360.at2", "C.txt", "nis090.AT2", "nis090.XML", "index.csv"
    write(tmp_path / "data [1]", *names)
    assert ids(study) == found.split()
