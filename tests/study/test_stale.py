"""Inputs that change under a study: made again or refused, never mixed, whatever their dates."""

import os

import numpy as np
import pytest
from obspy import Trace

from archfrag.cli import main
from archfrag.errors import InputError, RecordError
from archfrag.study.file.records import load_prepared, load_record, prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.runs.plan import make_plan
from archfrag.study.runs.store import gather
from archfrag.study.steps import finish, make_step, stale_steps
from tests.study.small import TEXT, files_below, make_runs, small_study, write_at2

INDEX = "id,file,unit\nwave0,wave0.mseed,m/s2\n"


def prepared(folder, text=TEXT):
    """A study whose motions are prepared."""
    study = load_study(small_study(folder, text))
    prepare_motions(study)
    finish(study, "motions")
    assert stale_steps(study)[0][0] == "batch-0of1"
    return study


def older(path):
    """Give a file a date before all others, as unpacking an archive does."""
    os.utime(path, (1.0e9, 1.0e9))


def steps(path, *names):
    """Exit code and what the first of some steps states that fails, or the last."""
    from click.testing import CliRunner

    for name in names:
        quiet = ["--cores", "1", "--quiet"] if name == "batch" else []
        result = CliRunner().invoke(main, [name, str(path), *quiet])
        if result.exit_code != 0:
            break
    return result.exit_code, result.stderr


def test_a_record_more_or_less(tmp_path):
    study = prepared(tmp_path)
    more = write_at2(tmp_path / "records" / "more.AT2", np.sin(np.arange(150.0)), 0.01)
    older(more)
    assert stale_steps(study)[1] == [f"record {more} is new"]
    more.unlink()
    assert stale_steps(study)[0][0] == "batch-0of1"
    (tmp_path / "records" / "wave0.AT2").unlink()
    assert stale_steps(study)[1] == [f"record {tmp_path / 'records' / 'wave0.AT2'} is gone"]


def test_the_unit_in_the_index(tmp_path):
    path = small_study(
        tmp_path, TEXT.replace('files: ["records/*.AT2"]', "index: records/index.csv")
    )
    index = tmp_path / "records" / "index.csv"
    trace = Trace(np.sin(np.arange(150.0)), {"delta": 0.01, "channel": "HNE"})
    trace.write(str(tmp_path / "records" / "wave0.mseed"), format="MSEED")
    index.write_text(INDEX)
    study = load_study(path)
    first = prepare_motions(study)[0].factor
    finish(study, "motions")
    index.write_text(INDEX.replace("m/s2", "cm/s2"))
    older(index)
    stale, changed = stale_steps(study)
    assert stale[0] == "motions"
    assert changed[0].startswith(f"index {index} has changed (sha256 ")
    assert prepare_motions(study)[0].factor == pytest.approx(100 * first)


def test_files_that_change_places_are_noticed_and_touched_ones_are_not(tmp_path):
    """Two records of one name exchanged, and an index in the folder above."""
    for name, number in (("eq1", 1), ("eq2", 2)):
        (tmp_path / name).mkdir()
        write_at2(tmp_path / name / "H1.AT2", np.sin(number * np.arange(150.0)), 0.01)
    files = [tmp_path / name / "H1.AT2" for name in ("eq1", "eq2")]
    (tmp_path / "eq1" / "index.csv").write_text("id,file\none,H1.AT2\n")
    study = prepared(tmp_path, TEXT.replace('"records/*.AT2"', "eq1/H1.AT2, eq2/H1.AT2"))
    os.utime(files[0])
    assert stale_steps(study)[0][0] == "batch-0of1"
    os.rename(files[0], tmp_path / "between")
    os.rename(files[1], files[0])
    os.rename(tmp_path / "between", files[1])
    stale, changed = stale_steps(study)
    assert stale[0] == "motions"
    assert [line.split(" has changed")[0] for line in changed] == [f"record {f}" for f in files]
    prepare_motions(study)
    finish(study, "motions")
    os.rename(tmp_path / "eq1" / "index.csv", tmp_path / "index.csv")
    assert stale_steps(study)[1] == [
        f"index {tmp_path / 'eq1' / 'index.csv'} is gone", f"index {tmp_path / 'index.csv'} is new"
    ]  # fmt: skip


def test_what_only_the_cube_states_is_noticed(tmp_path):
    """Another name of the same unit; a column of a table that gives what is the default."""
    table = tmp_path / "table.csv"
    table.write_text("id,width,depth\none,0.4,1.0\n")
    many = (
        "  - {id: many, table: table.csv, profile: block, height: 2.0, friction: .inf}\nmotions:"
    )
    text = TEXT.replace("motions:", many).replace("unit: g", "unit: gal")
    study = prepared(tmp_path, text.replace("[0.1, 0.6, 1.2]", "[100, 600]"))
    for step in ("batch-0of1", "cube"):
        make_step(study, step, print)
    assert stale_steps(study)[0] == ["fit", "report"]
    unit = load_study(tmp_path / "small.yaml", ["intensity.unit=cm/s2"])
    assert stale_steps(unit)[0] == ["cube", "fit", "report"]
    table.write_text("id,width\none,0.4\n")
    assert stale_steps(load_study(tmp_path / "small.yaml"))[0] == ["cube", "fit", "report"]


@pytest.mark.parametrize("named", [False, True])
def test_an_inventory(tmp_path, named):
    (tmp_path / "records").mkdir()
    inventory = tmp_path / ("stations.xml" if named else "records/wave0.xml")
    inventory.write_text("<one/>")
    entry = '{path: "records/*.AT2", inventory: stations.xml}' if named else '"records/*.AT2"'
    study = prepared(tmp_path, TEXT.replace('"records/*.AT2"', entry))
    inventory.write_text("<two/>")
    older(inventory)
    stale, changed = stale_steps(study)
    assert stale[0] == "motions"
    assert changed[0].startswith(f"inventory {inventory} has changed (sha256 ")
    inventory.unlink()
    if named:
        with pytest.raises(RecordError, match=r"stations\.xml cannot be read"):
            stale_steps(study)
    else:
        assert stale_steps(study)[1] == [f"inventory {inventory} is gone"]


def test_new_motions_take_the_place_of_old_ones_together_or_not_at_all(done, tmp_path):
    """One record replaced, another damaged: the old motions stay, and results are theirs."""
    path = small_study(tmp_path)
    assert steps(path, "motions")[0] == 0
    study = load_study(path)
    digest, before = make_plan(study).digests, files_below(tmp_path / "out")
    write_at2(tmp_path / "records" / "wave0.AT2", np.sin(np.arange(150.0)), 0.01)
    (tmp_path / "records" / "wave1.AT2").write_text("garbage")
    code, messages = steps(path, "motions")
    assert code == 2
    assert "wave1.AT2" in messages
    assert before.items() <= files_below(tmp_path / "out").items()
    assert make_plan(study).digests == digest
    make_runs(study)
    assert (
        gather(make_plan(study)).table["steps"].tolist()
        == gather(done.plan).table["steps"].tolist()
    )
    small_study(tmp_path)
    write_at2(tmp_path / "records" / "wave0.AT2", np.sin(np.arange(150.0)), 0.01)
    assert steps(path, "motions")[0] == 0
    assert make_plan(study).digests != digest
    with pytest.raises(InputError, match="6 of 12 runs of iteration 1 are missing"):
        gather(make_plan(study))
    assert len(list((tmp_path / "out" / ".archfrag" / "motions").iterdir())) == 2


def test_two_stored_motions_swapped_by_hand(copied):
    one, two = (copied.study.work / record.file for record in load_prepared(copied.study))
    content = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(content)
    message = f"{one}: is not the motion that was prepared of record 'wave0', but missing"
    with pytest.raises(InputError) as caught:
        make_plan(copied.study)
    assert str(caught.value).startswith(message)
    stale, changed = stale_steps(copied.study)
    assert stale[0] == "motions"
    assert changed[0].startswith(message)
    with pytest.raises(InputError, match="is not the motion that was prepared"):
        load_record(copied.study.work, copied.plan.records[0])
    prepare_motions(copied.study)
    assert make_plan(copied.study).digests == copied.plan.digests


def test_steps_of_another_study_or_other_code_are_out_of_date(copied, monkeypatch):
    study = copied.study
    finish(study, "motions")
    make_step(study, "batch-0of1", print)
    assert stale_steps(study)[0] == ["cube", "fit", "report"]
    next(copied.plan.parts.glob("*.npy")).unlink()
    assert stale_steps(study)[0][0] == "batch-0of1"
    monkeypatch.setattr("archfrag.study.runs.plan.kernel_hash", lambda: "edited")
    assert stale_steps(study)[0][0] == "batch-0of1"
    other = study.model_copy(
        update={"intensity": study.intensity.model_copy(update={"levels": (0.1, 0.2)})}
    )
    stale, (changed,) = stale_steps(other)
    assert stale[0] == "batch-0of1"
    assert changed.endswith("batch-0of1.csv: was made before these changed: archfrag, levels")
