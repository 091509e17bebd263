"""Inputs, keys and code that change under a study: results are made again, never mixed."""

import contextlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

from archfrag.errors import ArchfragError, InputError, RecordError
from archfrag.study.file.prepared import load_prepared, load_record, prepare_motions
from archfrag.study.file.schema import StudyKeys, load_study
from archfrag.study.provenance import finished_folder, out_of_date
from archfrag.study.runs.store import gather, make_plan
from archfrag.study.steps import changed_since, make_step
from archfrag.study.yaml_text import read_keys
from tests.study.small import (
    TEXT,
    command,
    dumped,
    files_below,
    make_runs,
    small_study,
    write_at2,
)


def prepared(folder, text=TEXT):
    study = load_study(small_study(folder, text))
    prepare_motions(study)
    assert changed_since(study) == (True, [])
    return study


def test_every_input_counts_by_its_content_and_place_and_not_by_its_date(tmp_path):
    """A record, an index, an inventory: new, changed, gone; two records exchanged."""
    text = TEXT.replace(
        '"records/*.AT2"', '{path: "records/*.AT2", inventory: stations.xml}'
    )
    (tmp_path / "stations.xml").write_text("<one/>")
    study = prepared(tmp_path, text)
    records = tmp_path / "records"
    one = records / "wave0.AT2"
    two = records / "wave1.AT2"

    def changed_by(*changes):
        for path, content in changes:
            if content is None:
                path.unlink()
            else:  # with a date before all others, as unpacking an archive gives
                path.write_bytes(content)
                os.utime(path, (1.0e9, 1.0e9))
        ready, changed = changed_since(study)
        assert ready != bool(changed)
        return changed

    contents = {path: path.read_bytes() for path in (one, two)}
    more = records / "more.AT2"
    index = records / "index.csv"
    own = records / "wave0.xml"
    write_at2(more, np.sin(np.arange(150.0)), 0.01)
    assert changed_by() == [f"record {more} is new"]
    assert changed_by((more, None)) == []
    assert changed_by((one, None)) == [f"record {one} is gone"]
    exchanged = changed_by((one, contents[two]), (two, contents[one]))
    assert exchanged == [f"record {path} has changed" for path in (one, two)]
    assert changed_by(*contents.items()) == []
    for path, kind in (
        (index, "index"),
        (tmp_path / "index.csv", "index"),
        (own, "inventory"),
    ):
        assert changed_by((path, b"id,file\n")) == [f"{kind} {path} is new"]
        assert changed_by((path, None)) == []
    inventory = tmp_path / "stations.xml"
    assert changed_by((inventory, b"<two/>")) == [f"inventory {inventory} has changed"]
    with pytest.raises(RecordError, match=r"stations\.xml: there is no such file"):
        changed_by((inventory, None))


def test_what_only_the_cube_states_is_noticed(tmp_path):
    """Another name of the same unit; a column of a table that gives what is the default."""
    table = tmp_path / "table.csv"
    table.write_text("id,width,depth\none,0.4,1.0\n")
    many = "  - {id: many, table: table.csv, profile: block, height: 2, friction: .inf}\nmotions:"
    text = TEXT.replace("motions:", many).replace("unit: g", "unit: gal")
    path = small_study(tmp_path, text.replace("[0.1, 0.6, 1.2]", "[100, 600]"))
    assert command("run", path, "--quiet").exit_code == 0
    assert finished_folder(path, *read_keys(path)) == tmp_path / "out"
    assert out_of_date(load_study(path, ["intensity.unit=cm/s2"]), "cube")
    table.write_text("id,width\none,0.4\n")
    assert finished_folder(path, *read_keys(path)) is None


def test_new_motions_take_the_place_of_old_ones_together_or_not_at_all(done, tmp_path):
    """One record replaced, another damaged: the old motions stay, and results are theirs."""
    path = small_study(tmp_path)
    assert command("motions", path).exit_code == 0
    study = load_study(path)
    plan = make_plan(study)
    before = files_below(tmp_path / "out")
    write_at2(tmp_path / "records" / "wave0.AT2", np.sin(np.arange(150.0)), 0.01)
    (tmp_path / "records" / "wave1.AT2").write_text("garbage")
    failed = command("motions", path)
    assert (failed.exit_code, "wave1.AT2" in failed.stderr) == (2, True)
    assert before.items() <= files_below(tmp_path / "out").items()
    assert make_plan(study) == plan
    make_runs(study)
    own, others = (
        gather(plan)[1]["steps"].tolist() for plan in (make_plan(study), done.plan)
    )
    assert own == others
    small_study(tmp_path)
    write_at2(tmp_path / "records" / "wave0.AT2", np.sin(np.arange(150.0)), 0.01)
    assert command("motions", path).exit_code == 0
    assert make_plan(study) != plan
    with pytest.raises(InputError, match="6 of 12 runs are missing"):
        gather(make_plan(study))
    assert len(list((tmp_path / "out" / ".archfrag" / "motions").iterdir())) == 2


def test_two_stored_motions_swapped_by_hand(copied):
    one, two = (
        copied.study.work / record.stored for record in load_prepared(copied.study)
    )
    first = one.read_bytes()
    second = two.read_bytes()
    one.write_bytes(second)
    two.write_bytes(first)
    ready, changed = changed_since(copied.study)
    assert not ready
    message = (
        f"{one}: the prepared motion of record 'wave0' is missing, changed or damaged"
    )
    assert changed[0].startswith(message)
    with pytest.raises(InputError, match="missing, changed or damaged"):
        load_record(copied.study.work, copied.plan.records[0])
    prepare_motions(copied.study)
    assert make_plan(copied.study) == copied.plan


def test_results_of_another_study_or_other_code_are_out_of_date(
    copied, tmp_path, monkeypatch
):
    study = copied.study
    path = tmp_path / "copy" / "small.yaml"
    asked = ("export", path, "--format", "csv")
    assert "cube.nc: is missing, or no step of this" in command(*asked).stderr
    for step in ("cube", "fit"):
        make_step(study, step, print)
    assert command(*asked).exit_code == 0
    next(copied.plan.parts.glob("*.npy")).unlink()
    assert "runs are missing or damaged" in command("cube", path).stderr
    levels = command(*asked, "--set", "intensity.levels=[0.1, 0.2]")
    monkeypatch.setattr("archfrag.study.provenance.code", lambda: "edited")
    for result, what in ((levels, "intensity"), (command(*asked), "code")):
        assert result.exit_code == 2
        assert f"cube.nc: was made before these changed: {what}; `arch" in result.stderr
    assert changed_since(study)[0] is False


EVERY = Path(__file__).with_name("every.yaml").read_text()
HAZARD = "PGA [g],rate\n0.01,0.1\n0.1,0.01\n0.5,0.001\n2.0,0.0001\n"
TABLE = "id,width,height,owner\none,0.4,2.0,me\ntwo,0.5,2.1,you\n"
SAME = ("output", "execution")  # where it runs, and where results go, changes no result


def leaves(value, here=()):
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        if isinstance(inner, dict | list | tuple) and inner:
            yield from leaves(inner, (*here, key))
        else:
            yield (*here, key), inner


def without_none(value):
    if isinstance(value, dict):
        return {k: without_none(v) for k, v in value.items() if v is not None}
    return [without_none(v) for v in value] if isinstance(value, list) else value


def others(value):
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int | float):
        return [value * 1.01, value * 0.99, value + 1, value - 1, value + 0.01, 0.5, 1]
    if isinstance(value, str):
        return [value + "x", "cm/s2", "PGV", "latin_hypercube", "left", "penalty"]
    return [0.5, 1, 0.01, True, "x", "cm/s2", [0.1], {"PGA": 0.1}, [0.1] * 7, [1.0] * 5]


def with_each_key_changed(path):
    """For each key its name and the study with another value in the first place that can."""
    seen = set()
    plain = load_study(path).model_dump(mode="json")
    for place, value in leaves(plain):
        name = ".".join("*" if isinstance(key, int) else key for key in place)
        for other in others(value):
            if other == value or name in seen:
                continue
            new = json.loads(json.dumps(plain))
            inner = new
            for key in place[:-1]:
                inner = inner[key]
            inner[place[-1]] = other
            with contextlib.suppress(ArchfragError, ValueError):
                copy = path.with_name("changed.yaml")
                copy.write_text(dumped(StudyKeys.model_validate(without_none(new))))
                study = load_study(copy)
                seen.add(name)
                yield name, study


def test_each_change_of_a_key_is_seen(tmp_path):
    path = small_study(tmp_path, EVERY, "every.yaml")
    (tmp_path / "hazard.csv").write_text(HAZARD)
    for name in ("table.csv", "other.csv"):
        (tmp_path / name).write_text(TABLE)
    path.write_text(dumped(load_study(path)))
    for step in ("motions", "batch", "cube", "fit", "report"):
        done = command(step, path, *["--quiet"] * (step == "batch"))
        assert done.exit_code == 0, done.output
    assert out_of_date(load_study(path), "cube", "fit", "report") == ""
    seen = set()
    for name, study in with_each_key_changed(path):
        seen.add(name)
        if not name.startswith("output"):
            stale = out_of_date(study, "cube", "fit")
            assert bool(stale) == (not name.startswith(SAME)), name
    assert len(seen) > 70, sorted(seen)
