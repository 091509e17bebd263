"""Records of a study: found, read, scaled, stored."""

import numpy as np
import pytest

from archfrag.errors import InputError, OutputError, RecordError, StudyError
from archfrag.motions.measures import measure
from archfrag.study.config import load_study
from archfrag.study.digests import sha256_of
from archfrag.study.records import load_prepared, load_record, prepare_motions
from tests.study.small import ROOT, TEXT, files, small_study, write_at2

FILES = 'files: ["records/*.AT2"]'
INDEX = ROOT / "records" / "index.csv"


def study_with(tmp_path, motions, **changes):
    text = TEXT.replace(f"  {FILES}", f"  {motions}")
    for old, new in changes.items():
        text = text.replace(old, new)
    assert motions in text
    return load_study(small_study(tmp_path, text))


@pytest.mark.parametrize("name", ["PGA", "PGV", "Arias", "Sa(0.5)", "AvgSA(0.2,1.0)"])
def test_factors_bring_the_record_to_each_level(tmp_path, name):
    unit = {"PGV": "m/s", "Arias": "m/s"}.get(name, "g")
    text = TEXT.replace("measure: PGA", f'measure: "{name}"').replace("unit: g", f"unit: {unit}")
    study = load_study(small_study(tmp_path, text))
    for record in prepare_motions(study):
        motion = load_record(study, record)
        reached = [measure(motion.scaled(factor), name) for factor in record.factors]
        np.testing.assert_allclose(reached, study.intensity.si, rtol=1e-9)


def test_prepared_records_are_found_again_with_their_origin(tmp_path):
    study = load_study(small_study(tmp_path))
    prepared = prepare_motions(study)
    assert load_prepared(study) == prepared
    assert [record.id for record in prepared] == ["wave0", "wave1"]
    source = tmp_path / "records" / "wave1.AT2"
    assert prepared[1].source == "wave1.AT2"
    assert prepared[1].sha256 == sha256_of(source)
    motion = load_record(study, prepared[1])
    assert motion.id == "wave1"
    assert motion.dt == 0.01
    assert motion.metadata["file_sha256"] == sha256_of(source)


def test_preparing_twice_gives_the_same_bytes(tmp_path):
    study = load_study(small_study(tmp_path))
    prepare_motions(study)
    (folder,) = (study.work / "motions").iterdir()
    first = files(folder)
    prepare_motions(study)
    assert files(folder) == first
    assert list((study.work / "motions").iterdir()) == [folder]
    assert set(first) == {"00000.npz", "00001.npz"}


def test_shipped_records_are_selected_in_the_order_asked_for(tmp_path):
    study = study_with(tmp_path, f"{{index: {INDEX}, select: [syn-m70-r020, syn-m55-r010]}}")
    prepared = prepare_motions(study)
    assert [record.id for record in prepared] == ["syn-m70-r020", "syn-m55-r010"]
    assert [record.magnitude for record in prepared] == [7.0, 5.5]
    assert [record.distance for record in prepared] == [20.0, 10.0]


def test_index_and_files_together_can_be_selected_from(tmp_path):
    study = study_with(
        tmp_path,
        f'{{index: {INDEX}, files: ["records/*.AT2"], select: [wave1, syn-m55-r010]}}',
    )
    assert [record.id for record in prepare_motions(study)] == ["wave1", "syn-m55-r010"]


def test_unknown_selected_id_is_refused_with_the_right_one(tmp_path):
    study = study_with(tmp_path, f"{{index: {INDEX}, select: [syn-m55-r01]}}")
    with pytest.raises(StudyError) as caught:
        prepare_motions(study)
    assert str(caught.value).startswith(
        "motions.select: 'syn-m55-r01' is no record of the study; did you mean syn-m55-r01"
    )


def test_missing_record_file(tmp_path):
    study = study_with(tmp_path, 'files: ["records/lost.AT2"]')
    with pytest.raises(RecordError) as caught:
        prepare_motions(study)
    assert str(caught.value) == (
        f"{tmp_path / 'records' / 'lost.AT2'}: there is no such record file"
    )


def test_pattern_without_files(tmp_path):
    study = study_with(tmp_path, 'files: ["nowhere/*.AT2"]')
    with pytest.raises(StudyError) as caught:
        prepare_motions(study)
    assert str(caught.value) == f"motions.files[0]: no file matches {tmp_path / 'nowhere/*.AT2'}"


def test_two_records_of_one_name(tmp_path):
    study = study_with(tmp_path, 'files: ["records/*.AT2", "more/wave1.AT2"]')
    (tmp_path / "more").mkdir()
    path = write_at2(tmp_path / "more" / "wave1.AT2", np.sin(np.arange(50.0)), 0.01)
    with pytest.raises(RecordError) as caught:
        prepare_motions(study)
    assert str(caught.value) == (
        f"{path}: the record id 'wave1' is that of {tmp_path / 'records' / 'wave1.AT2'} too; each "
        "record needs its own"
    )


def test_record_of_zeros_cannot_be_scaled(tmp_path):
    study = study_with(tmp_path, 'files: ["records/*.AT2"]')
    write_at2(tmp_path / "records" / "zero.AT2", np.zeros(50), 0.01)
    with pytest.raises(RecordError, match="zero: PGA of the record is 0, so no factor can bring"):
        prepare_motions(study)
    assert not (study.work / "motions.json").exists()


def test_motions_that_are_not_prepared_or_for_other_levels(tmp_path):
    study = load_study(small_study(tmp_path))
    with pytest.raises(InputError, match=r"motions\.json: the motions are not prepared yet"):
        load_prepared(study)
    prepare_motions(study)
    other = load_study(small_study(tmp_path), ["intensity.levels=[0.2]"])
    with pytest.raises(InputError, match="was made for other records or levels"):
        load_prepared(other)
    (study.work / "motions.json").write_text("{")
    with pytest.raises(InputError, match=r"motions\.json: is damaged"):
        load_prepared(study)


def test_disk_full_while_storing(tmp_path, full_disk):
    study = load_study(small_study(tmp_path))
    with full_disk(at=1), pytest.raises(OutputError, match=r"No space left on device"):
        prepare_motions(study)
    assert not (study.work / "motions.json").exists()
