"""Records of a study: found, read, scaled, stored."""

import numpy as np
import pytest

from archfrag.errors import InputError, RecordError, StudyError
from archfrag.motions.measures import measure
from archfrag.study.file.records import load_prepared, load_record, prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.files import sha256_of
from archfrag.study.runs.design import CASE
from archfrag.study.runs.store import make_plan
from tests.study.small import ROOT, TEXT, small_study, write_at2

FILES = 'files: ["records/*.AT2"]'
INDEX = ROOT / "records" / "index.csv"


def plan_factors(study, record):
    """Factors of one record at all levels, as the plan has them."""
    plan = make_plan(study)
    cases = np.zeros(len(plan.levels), CASE)
    cases["record"] = [each.id for each in plan.records].index(record.id)
    cases["level"] = plan.levels
    return plan.factors(cases)


def study_with(tmp_path, motions):
    return load_study(small_study(tmp_path, TEXT.replace(f"  {FILES}", f"  {motions}")))


@pytest.mark.parametrize("steps", ["[]", "[{trim: {arias: [0.2, 0.8]}}, {resample: {dt: 0.005}}]"])
@pytest.mark.parametrize("name", ["PGA", "PGV", "Arias", "Sa(0.5)", "AvgSA(0.2,1.0)"])
def test_factors_bring_the_record_as_processed_to_each_level(tmp_path, name, steps):
    text = TEXT.replace(FILES, f"{FILES}\n  processing: {steps}")
    unit = {"PGV": "m/s", "Arias": "m/s"}.get(name, "g")
    text = text.replace("measure: PGA", f'measure: "{name}"').replace("unit: g", f"unit: {unit}")
    study = load_study(small_study(tmp_path, text))
    for record in prepare_motions(study):
        motion = load_record(study.work, record)
        assert record.dt == motion.dt == pytest.approx(0.01 if steps == "[]" else 0.005)
        reached = [measure(motion.scaled(f), name) for f in plan_factors(study, record)]
        np.testing.assert_allclose(reached, study.intensity.si, rtol=1e-9)


def test_prepared_records_are_found_again_with_their_origin(tmp_path):
    study = load_study(small_study(tmp_path))
    prepared = prepare_motions(study)
    assert load_prepared(study) == prepared
    assert [record.id for record in prepared] == ["wave0", "wave1"]
    source = tmp_path / "records" / "wave1.AT2"
    assert prepared[1].source == "wave1.AT2"
    assert prepared[1].sha256 == sha256_of(source)
    motion = load_record(study.work, prepared[1])
    assert motion.id == "wave1"
    assert motion.dt == 0.01
    assert motion.metadata["file_sha256"] == sha256_of(source)


def test_shipped_records_are_selected_in_the_order_asked_for(tmp_path):
    study = study_with(tmp_path, f"{{index: {INDEX}, select: [syn-m70-r020, syn-m55-r010]}}")
    prepared = prepare_motions(study)
    assert [record.id for record in prepared] == ["syn-m70-r020", "syn-m55-r010"]
    assert [record.magnitude for record in prepared] == [7.0, 5.5]
    assert [record.distance for record in prepared] == [20.0, 10.0]


def made(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_at2(path, np.sin(np.arange(50.0)), 0.01)


def ids(study):
    return [record.id for record in prepare_motions(study)]


def test_two_records_of_one_name_are_distinguished_by_their_folders(tmp_path):
    """Wherever the study lies."""
    motions = 'files: ["records/*.AT2", "more/**/*.AT2", "H.AT2"]'
    for place in ("here", "there/again"):
        study = study_with(tmp_path / place, motions)
        for name in ("H", "more/wave1", "more/H", "more/1/H", "more/b/1/H", "more/other"):
            made(tmp_path / place / f"{name}.AT2")
        assert sorted(ids(study)) == [
            "H", "more+1+H", "more+H", "more+b+1+H", "more+wave1", "other", "records+wave1",
            "wave0",
        ]  # fmt: skip


def test_the_same_file_by_two_patterns_is_one_record(tmp_path):
    assert ids(study_with(tmp_path, 'files: ["records/*.AT2", "records/*.at2"]')) == [
        "wave0",
        "wave1",
    ]
    study = study_with(tmp_path, 'files: ["records/*", {path: "records/wave1.AT2", unit: g}]')
    with pytest.raises(StudyError) as caught:
        prepare_motions(study)
    assert str(caught.value) == (
        f"motions.files[1]: an entry before it matches {tmp_path / 'records' / 'wave1.AT2'} with "
        "another unit, inventory, columns or accept"
    )


@pytest.mark.parametrize(
    "pattern",
    ["*[!t]", "*.AT2", "*.at2", "ARL[2-4]60.At2", "a[r]L*", "[!a-fx-z]*.AT2", "?RL360.aT2"],
)
def test_patterns_match_in_any_case(tmp_path, pattern):
    study = study_with(tmp_path, f'files: ["data [1]/{pattern}"]')
    for name in ("ARL360.at2", "C.txt", "nis090.AT2", "nis090.XML", "index.csv"):
        made(tmp_path / "data [1]" / name)
    found = ids(study) if pattern != "[!a-fx-z]*.AT2" else ["ARL360", *ids(study)]
    expected = ["ARL360", "nis090"] if pattern[0] in "*[" else ["ARL360"]
    assert found == expected


def test_two_records_of_one_id_are_refused(tmp_path):
    name = "syn-m55-r010"
    made(tmp_path / "records" / f"{name}.AT2")
    with pytest.raises(RecordError, match=rf"\.AT2: the record id '{name}' already belongs to"):
        prepare_motions(study_with(tmp_path, f"{FILES}\n  index: {INDEX}"))


def test_motions_that_are_not_prepared_or_for_another_measure(tmp_path):
    study = load_study(small_study(tmp_path))
    with pytest.raises(InputError, match=r"motions\.json: the motions are not prepared yet"):
        load_prepared(study)
    prepare_motions(study)
    assert load_prepared(load_study(small_study(tmp_path), ["intensity.levels=[0.2]"]))
    other = load_study(small_study(tmp_path), ["intensity.measure=Sa(0.5)"])
    with pytest.raises(InputError, match="was made for other records or another measure"):
        load_prepared(other)
    (study.work / "motions.json").write_text("{")
    with pytest.raises(InputError, match=r"motions\.json: is damaged"):
        load_prepared(study)
