"""Records in both senses: motions mirrored, and equal verdicts of symmetric arches."""

import numpy as np
import pytest

from archfrag.errors import RecordError
from archfrag.study.file.prepared import load_record, prepare_motions
from archfrag.study.file.schema import load_study
from tests.study.small import TEXT, command, cube_of, small_study, write_at2

BOTH = TEXT.replace("  files:", "  both_senses: true\n  files:")


def test_symmetric_arches_have_equal_verdicts(tmp_path):
    levels = BOTH.replace("[0.1, 0.6, 1.2]", "[0.1, 0.5, 0.9, 1.8, 3.0]")
    study = load_study(small_study(tmp_path, levels))
    _, cube = cube_of(study)
    assert cube["record"].values.tolist() == [
        "wave0",
        "wave0-rev",
        "wave1",
        "wave1-rev",
    ]
    verdict = cube["verdict"].transpose("record", "arch", ...).values
    assert {0, 1} <= set(verdict.ravel().tolist())
    assert np.array_equal(verdict[::2], verdict[1::2])
    assert np.array_equal(cube["scale_factor"][::2], cube["scale_factor"][1::2])


def test_horizontals_are_reversed_and_the_event_is_shared(tmp_path):
    path = small_study(
        tmp_path,
        BOTH.replace("files:", "vertical: true\n  files:").replace(
            "records/*", "records/[ab]*"
        ),
    )
    wave = np.sin(np.arange(150) / 9.0)
    for name, quake in (("a", "One"), ("b", "Two")):
        for end, factor, direction in (("090", 0.3, "90"), ("-UP", 0.1, "UP")):
            file = write_at2(
                tmp_path / "records" / f"{name}{end}.AT2", factor * wave, 0.01
            )
            text = file.read_text().replace("Test,", f"{quake},")
            file.write_text(text.replace("Nowhere, 0", f"Nowhere, {direction}"))
    study = load_study(path, ["motions.select=[b090, a090]"])
    records = prepare_motions(study)
    assert [record.id for record in records] == ["b090", "b090-rev", "a090", "a090-rev"]
    assert [record.event for record in records] == ["Two", "Two", "One", "One"]
    one, other = (load_record(study.work, record) for record in records[:2])
    assert np.array_equal(one.acceleration, -other.acceleration)
    assert np.array_equal(one.vertical, other.vertical)
    assert other.log[-1] == "Horizontal components reversed."


def test_a_record_of_the_same_name_is_refused(tmp_path):
    path = small_study(tmp_path, BOTH)
    file = tmp_path / "records" / "wave0.AT2"
    file.with_name("wave0-rev.AT2").write_text(file.read_text())
    with pytest.raises(RecordError, match="'wave0-rev' already belongs to"):
        prepare_motions(load_study(path))
    assert command("validate", path).exit_code == 2
