"""Inputs that change under a study: made again or refused, never mixed, whatever the dates say."""

import json
import os

import numpy as np
import pytest
from archfrag.study.parts import read_part
from obspy import Trace

from archfrag.cli import main
from archfrag.errors import InputError
from archfrag.study.config import load_study
from archfrag.study.cube import gather
from archfrag.study.digests import sha256_of
from archfrag.study.plan import make_plan
from archfrag.study.records import load_prepared, prepare_motions
from archfrag.study.steps import finish, stale_steps
from archfrag.study.worker import run_chunk
from tests.study.small import TEXT, small_study, write_at2

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
    """Exit code and what the first of some steps says that fails, or the last."""
    from click.testing import CliRunner

    for name in names:
        quiet = ["--workers", "1", "--quiet"] if name == "batch" else []
        result = CliRunner().invoke(main, [name, str(path), *quiet])
        if result.exit_code != 0:
            break
    return result.exit_code, result.stderr


def contents(folder):
    """All files below a folder with their contents."""
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_another_record_of_an_older_date(tmp_path):
    study = prepared(tmp_path)
    record = tmp_path / "records" / "wave1.AT2"
    before = sha256_of(record)
    write_at2(record, np.sin(np.arange(150.0)), 0.01)
    older(record)
    stale, changed = stale_steps(study)
    assert stale[0] == "motions"
    assert changed == [
        f"record {record} has changed (sha256 {before[:12]}, now {sha256_of(record)[:12]})"
    ]
    assert prepare_motions(study)[1].sha256 == sha256_of(record)


def test_a_record_more_or_less(tmp_path):
    study = prepared(tmp_path)
    more = write_at2(tmp_path / "records" / "more.AT2", np.sin(np.arange(150.0)), 0.01)
    older(more)
    assert stale_steps(study)[1] == [f"record {more} is new"]
    more.unlink()
    assert stale_steps(study)[0][0] == "batch-0of1"
    (tmp_path / "records" / "wave0.AT2").unlink()
    assert stale_steps(study)[1] == [f"record {tmp_path / 'records' / 'wave0.AT2'} is gone"]


def test_records_that_are_only_elsewhere(tmp_path):
    study = prepared(tmp_path)
    os.rename(tmp_path / "records", tmp_path / "moved")
    study = load_study(tmp_path / "small.yaml", [f"motions.files=['{tmp_path}/moved/*.AT2']"])
    assert stale_steps(study)[1] == ["the study asks for other records or levels"]


def test_the_unit_in_the_index(tmp_path):
    path = small_study(
        tmp_path, TEXT.replace('files: ["records/*.AT2"]', "index: records/index.csv")
    )
    index = tmp_path / "records" / "index.csv"
    trace = Trace(np.sin(np.arange(150.0)), {"delta": 0.01, "channel": "HNE"})
    trace.write(str(tmp_path / "records" / "wave0.mseed"), format="MSEED")
    index.write_text(INDEX)
    study = load_study(path)
    first = prepare_motions(study)[0].factors
    finish(study, "motions")
    index.write_text(INDEX.replace("m/s2", "cm/s2"))
    older(index)
    stale, changed = stale_steps(study)
    assert stale[0] == "motions"
    assert changed[0].startswith(f"index {index} has changed (sha256 ")
    np.testing.assert_allclose(np.array(prepare_motions(study)[0].factors), 100 * np.array(first))


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
    assert stale_steps(study)[1] == [f"inventory {inventory} is gone"]


def test_new_motions_take_the_place_of_old_ones_together_or_not_at_all(done, tmp_path):
    """One record replaced, another damaged: the old motions stay, and results are theirs."""
    path = small_study(tmp_path)
    assert steps(path, "motions")[0] == 0
    study = load_study(path)
    identity, before = make_plan(study).identity, contents(tmp_path / "out")
    write_at2(tmp_path / "records" / "wave0.AT2", np.sin(np.arange(150.0)), 0.01)
    (tmp_path / "records" / "wave1.AT2").write_text("garbage")
    code, said = steps(path, "motions")
    assert code == 2
    assert "wave1.AT2" in said
    assert contents(tmp_path / "out") == before
    assert make_plan(study).identity == identity == done.plan.identity
    run_chunk(str(done.plan.path), 0)
    plan = make_plan(study)
    plan.part(0).parent.mkdir()
    plan.timing(0).parent.mkdir()
    plan.save()
    run_chunk(str(plan.path), 0)
    assert plan.part(0).read_bytes() == done.plan.part(0).read_bytes()
    small_study(tmp_path)
    write_at2(tmp_path / "records" / "wave0.AT2", np.sin(np.arange(150.0)), 0.01)
    assert steps(path, "motions")[0] == 0
    assert make_plan(study).identity != identity
    assert len(list((tmp_path / "out" / ".archfrag" / "motions").iterdir())) == 1


def test_two_stored_motions_swapped_by_hand(copied):
    one, two = (copied.study.work / record.file for record in load_prepared(copied.study))
    content = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(content)
    sentence = f"{one}: is not the motion that was prepared of record 'wave0', but missing"
    with pytest.raises(InputError) as caught:
        make_plan(copied.study)
    assert str(caught.value).startswith(sentence)
    stale, changed = stale_steps(copied.study)
    assert stale[0] == "motions"
    assert changed[0].startswith(sentence)
    for chunk in range(6):
        copied.plan.part(chunk).unlink()
    copied.plan.save()
    with pytest.raises(InputError, match="is not the motion that was prepared"):
        run_chunk(str(copied.plan.path), 0)
    prepare_motions(copied.study)
    assert make_plan(copied.study).identity == copied.plan.identity


def test_a_manifest_edited_by_hand_takes_no_part_of_the_old_one(copied):
    path = copied.study.work / "motions.json"
    manifest = json.loads(path.read_text())
    stored = copied.study.work / manifest["records"][0]["file"]
    stored.write_bytes((copied.study.work / manifest["records"][1]["file"]).read_bytes())
    manifest["records"][0]["prepared"] = manifest["records"][1]["prepared"]
    path.write_text(json.dumps(manifest))
    plan = make_plan(copied.study)
    os.rename(copied.plan.part(0), plan.part(0))
    assert read_part(plan, 0) is None
    with pytest.raises(InputError, match="6 of 6 parts are missing or damaged"):
        gather(plan)


def test_steps_of_another_study_or_other_code_are_out_of_date(copied, monkeypatch):
    study = copied.study
    for step in ("motions", "batch-0of1"):
        finish(study, step)
    assert stale_steps(study)[0] == ["cube", "fit", "report"]
    copied.plan.part(2).unlink()
    assert stale_steps(study)[0][0] == "batch-0of1"
    monkeypatch.setattr("archfrag.study.plan.kernel_hash", lambda: "edited")
    assert stale_steps(study)[0][0] == "batch-0of1"
    other = study.model_copy(
        update={"intensity": study.intensity.model_copy(update={"levels": (0.1, 0.2)})}
    )
    assert stale_steps(other)[1] == ["the study asks for other records or levels"]
