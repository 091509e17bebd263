"""Tasks with time limits that are not done twice, and the command's refusals."""

import hashlib
import html
import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pandas as pd
import psutil
import pytest

import archbench.page
from archbench import growth, runner
from archbench.page import compare, errors_table, gather, staleness, write_page
from archbench.runner import PARTS, Bench, in_processes, load_tables
from archfrag.errors import InputError
from archfrag.physics.kernels import cache
from archfrag.report.html import ERRORS


def task(seconds, path=None):
    """Start a process and sleep; or end at once where there is no time."""
    if seconds < 0:
        os._exit(3)
    if path:
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        path.write_text(str(child.pid))
    time.sleep(seconds)
    return seconds


def test_what_takes_too_long_is_ended_with_its_processes_and_all_else_is_done(tmp_path):
    child = tmp_path / "pid"
    tasks = {
        ("short",): (0.2,),
        ("long",): (600.0, child),
        ("dies",): (-1.0,),
        ("last",): (0.1,),
    }
    found = dict(in_processes(task, tasks, 2, 4.0, compiled=False))
    assert found == {
        ("short",): 0.2,
        ("long",): "not ended within 4 s",
        ("dies",): "its process ended by itself",
        ("last",): 0.1,
    }
    with suppress(psutil.NoSuchProcess):
        psutil.Process(int(child.read_text())).wait(20.0)


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """A bench whose tasks are done here, with the names of those that were asked for."""
    asked = []

    def pretend(function, tasks, *_):
        asked.append([name for name, _ in tasks])
        return [(key, function(*task)) for key, task in tasks.items()]

    monkeypatch.setattr(runner, "in_processes", pretend)
    return Bench(tmp_path, report=lambda _: None), asked


def test_finished_tasks_are_not_done_again_and_a_cut_line_is(bench, monkeypatch):
    bench, asked = bench
    monkeypatch.setattr(runner, "digest", lambda part: "one")
    tasks = {("a", 1): (3, 4), ("b", 2): (6, 8)}
    assert bench.run("sums", math.hypot, tasks, 1.0) == {("a", 1): 5.0, ("b", 2): 10.0}
    (file,) = (bench.output / "finished").glob("sums-one-*.jsonl")
    file.write_text(file.read_text().splitlines()[0] + '\n[["b", 2], 7.8\n')
    bench.run("sums", math.hypot, tasks, 1.0)
    monkeypatch.setattr(runner, "digest", lambda part: "other")
    bench.run("sums", math.hypot, tasks, 1.0)
    assert asked == [["a", "b"], ["b"], ["a", "b"]]


def test_a_part_ends_with_its_time_and_says_what_it_left_out(tmp_path):
    now = time.monotonic()
    bench = Bench(
        tmp_path, workers=1, report=lambda _: None, until=now + 20.0, seconds=20.0
    )
    tasks = {("first",): (0.1,), ("dies",): (-1.0,), ("late",): (600.0,)}
    found = bench.run("tasks", task, tasks, 300.0)
    assert found == {("first",): 0.1, ("dies",): "its process ended by itself"}
    assert time.monotonic() - now < 60.0
    assert bench.left_out == [
        ("1 of 3 tasks of tasks", "no time was left"),
        ("tasks: dies", "its process ended by itself"),
    ]


def test_every_part_without_time_says_what_it_left_out(tmp_path):
    for part in PARTS:
        until = time.monotonic() + 0.2
        bench = Bench(
            tmp_path, True, part, report=lambda _: None, until=until, seconds=0.2
        )
        bench.save(import_module(f"archbench.{part}").measure(bench))
        left = pd.read_csv(tmp_path / f"{part}_left_out.csv")
        assert left["why"].eq("no time was left").any()
    assert staleness(tmp_path) == ""
    assert PARTS["speed"].title in write_page(tmp_path).read_text()


def test_a_part_of_the_same_kernels_is_kept_and_one_of_others_is_not(
    tmp_path, monkeypatch
):
    solvers = {"pymunk": "7.3"}
    bench = Bench(tmp_path, part="knee", solvers=solvers, report=lambda _: None)
    assert not bench.is_measured()
    bench.leave_out("all", "a test")
    bench.save({"settings": pd.DataFrame({"a": [1.0]})})
    assert bench.is_measured()
    assert replace(bench, solvers={}).is_measured()
    assert not replace(bench, solvers={"pymunk": "8"}).is_measured()
    assert not replace(bench, quick=True).is_measured()
    assert (tmp_path / "knee_left_out.csv").read_text() == "what,why\nall,a test\n"
    for changed in ("digest", "own_digest"):
        with monkeypatch.context() as patch:
            patch.setattr(runner, changed, lambda part: "changed")
            assert not bench.is_measured()


def test_a_part_is_kept_by_what_it_follows_from(tmp_path, monkeypatch, request):
    """A kernel that is edited changes all parts but the bands, and a part's own module only it."""
    copy = shutil.copytree(runner.HOME, tmp_path / "archfrag")
    before = {part: runner.digest(part) for part in runner.PARTS}
    kernel = copy / "physics" / "collapse.py"
    request.addfinalizer(cache.digest_of_syntax.cache_clear)
    monkeypatch.setattr(runner, "HOME", copy)
    monkeypatch.setattr(cache, "HOME", copy)
    assert {part: runner.digest(part) for part in runner.PARTS} == before
    kernel.write_text(kernel.read_text() + "\n# a remark\n")
    cache.digest_of_syntax.cache_clear()
    assert runner.digest("speed") == before["speed"]
    cache.digest_of_syntax.cache_clear()
    kernel.write_text(kernel.read_text() + "\nCHANGED = 1\n")
    assert {part for part in runner.PARTS if runner.digest(part) == before[part]} == {
        "bands"
    }
    own = {part: runner.own_digest(part) for part in runner.PARTS}
    assert len(set(own.values())) == len(own)


def test_a_page_of_other_kernels_says_so_in_its_first_line(tmp_path, monkeypatch):
    for part in PARTS:
        Bench(tmp_path, part=part, report=lambda _: None).save({})
    assert staleness(tmp_path) == ""
    page = write_page(tmp_path).read_text()
    assert "Not all figures" not in page
    today = runner.digest
    changed = {part: f"{today(part)}{'x' * (part == 'knee')}" for part in PARTS}
    for module in (archbench.page, runner):
        monkeypatch.setattr(module, "digest", changed.__getitem__)
    (tmp_path / "growth_about.json").unlink()
    said = staleness(tmp_path)
    assert said == (
        "Not all figures are of today (of other kernels than today's: Knee; not measured "
        "yet: Growth with the number of voussoirs)."
    )
    body = write_page(tmp_path).read_text().partition("</style>")[2]
    assert body.strip().startswith(f"<p><strong>{html.escape(said, quote=False)}")


def test_an_unknown_name_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InputError, match="no part 'sped'; allowed are all, quick, sp"):
        gather(["sped"], tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("parts", "hours", "minutes"), [(["growth"], 1.0, 3.75), (["growth"], None, 15.0)]
)
def test_a_part_has_its_share_of_the_hours(
    parts, hours, minutes, tmp_path, monkeypatch
):
    given = []
    monkeypatch.setattr(growth, "measure", lambda bench: given.append(bench) or {})
    gather(parts, tmp_path, 1, hours=hours)
    assert [bench.seconds for bench in given] == [60.0 * minutes]


DATA = Path(__file__).parents[2] / "docs" / "evidence" / "data"


def test_tables_of_the_page_name_their_kernels_and_its_chart_its_table():
    for path in DATA.glob("*_about.json"):
        about = json.loads(path.read_text())
        assert re.fullmatch("[0-9a-f]{40}", about["commit"])
        assert re.fullmatch("[0-9a-f]{12}|[0-9a-f]{40}", about["kernels"])
    drawn = (DATA.parents[1] / "images" / "evidence.svg").read_text()
    errors = Path(ERRORS).read_bytes()
    source = hashlib.sha256((DATA / "speed_points.csv").read_bytes() + errors)
    assert source.hexdigest() in drawn, "python docs/evidence/make.py draws it anew"


def test_errors_of_the_report_are_those_of_the_page():
    tables = {part: load_tables(DATA, part) for part in PARTS}
    known = errors_table(tables).set_index(["kind", "what"])
    shown = pd.read_csv(ERRORS, dtype={"what": str}).set_index(["kind", "what"])
    assert {*shown.index.get_level_values(0)} == {
        "auto",
        "time_stepping",
        "joints",
        "spans",
    }
    pd.testing.assert_frame_equal(shown, known.loc[shown.index], rtol=6e-3)


def test_a_page_is_written_without_the_default(tmp_path):
    """A part whose time was over may lack any setting."""
    for name in ("speed_points", "fragility_curves", "knee_settings"):
        table = pd.read_csv(DATA / f"{name}.csv")
        part = table[(table["method"] != "auto") | (table["value"] != 1e-3)]
        part.to_csv(tmp_path / f"{name}.csv", index=False)
    assert "Cost against error" in write_page(tmp_path).read_text()


def test_a_quick_measurement_has_the_figures_of_the_page(tmp_path):
    """The growth of all methods, and where they fail: ratios, whatever the machine."""
    gather(["quick", "growth", "stability"], tmp_path)
    found = compare(DATA, tmp_path)
    assert set(found["part"]) == {"growth", "stability"}
    assert found["agree"].all(), f"{staleness(DATA)}\n{found.to_string()}"


def test_a_quick_measurement_that_differs_is_seen(tmp_path):
    for name in ("growth_runs.csv", "stability_cells.csv", "speed_points.csv"):
        shutil.copy(DATA / name, tmp_path)
    assert compare(DATA, tmp_path)["agree"].all()
    runs = pd.read_csv(DATA / "growth_runs.csv")
    runs.loc[runs["method"] == "auto", "seconds"] *= 2.1
    runs.to_csv(tmp_path / "growth_runs.csv")
    cells = pd.read_csv(DATA / "stability_cells.csv")
    cells.loc[cells["method"] == "penalty", "kind"] = "diverged"
    cells.to_csv(tmp_path / "stability_cells.csv")
    points = pd.read_csv(DATA / "speed_points.csv")
    points.loc[points["method"] == "pymunk", "seconds"] *= 0.4
    points.to_csv(tmp_path / "speed_points.csv")
    found = compare(DATA, tmp_path).set_index(["part", "figure"])["agree"]
    assert not found["growth"].any()
    for part, other in (("stability", "penalty"), ("speed", "pymunk")):
        assert found[part][~found[part]].index.tolist() == [other]
