"""One command for a study: done, up to date, killed, resumed, beside each other."""

import hashlib
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd
import psutil
import pytest
import xarray as xr
from click.testing import CliRunner

from archfrag import kernel_cache
from archfrag.cli import main
from archfrag.study.workflow import snakefile
from tests.study.small import ROOT, TEXT, small_study, write_at2

# Long enough to be killed in the middle, by making each chunk one run.
SLOW = TEXT.replace("chunk: 2", "chunk: 1").replace("[0.1, 0.6, 1.2]", "[0.1, 0.3, 0.6, 0.9, 1.2]")


STARTED: list[subprocess.Popen] = []
# Breaks the step that prepares motions, as a mistake of ours would.
BROKEN = """
import sys
if "motions" in sys.argv:
    import archfrag.study.records

    def broken(study):
        raise ZeroDivisionError("a mistake of ours")

    archfrag.study.records.prepare_motions = broken
"""


def start(*arguments, env=MappingProxyType({})):
    """`archfrag run` as a user starts it, in a process group of its own."""
    process = subprocess.Popen(
        [sys.executable, "-m", "archfrag.cli", "run", *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, **env},
        # What runs behind a script is deaf to SIGINT; a user's command is not.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    STARTED.append(process)
    return process


@pytest.fixture(autouse=True)
def _nothing_goes_on():
    """End what a failed test left."""
    yield
    while STARTED:
        process = STARTED.pop()
        if process.poll() is None:
            kill_tree(process)


def run(*arguments, env=MappingProxyType({})):
    process = start(*arguments, env=env)
    stdout, stderr = process.communicate(timeout=600)
    return process.returncode, stdout, stderr


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def kill_tree(process):
    """SIGKILL for the full tree, however it has grouped itself."""
    with_children = [psutil.Process(process.pid)]
    with_children += with_children[0].children(recursive=True)
    os.killpg(process.pid, signal.SIGKILL)
    for member in with_children:
        try:
            member.kill()
        except psutil.NoSuchProcess:
            continue
    psutil.wait_procs(with_children, timeout=10)
    process.communicate()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Study file of an undisturbed run, what it printed, and the SHA-256 of its cube."""
    path = small_study(tmp_path_factory.mktemp("finished"), SLOW)
    code, stdout, stderr = run(path)
    assert code == 0, stderr
    return path, stdout, stderr, sha256(path.parent / "out" / "cube.nc")


def test_a_run_ends_with_a_report_and_a_line_for_each_step(finished):
    path, stdout, stderr, _ = finished
    out = path.parent / "out"
    assert stdout == f"report: {out / 'report.html'}\n"
    assert "A small study" in (out / "report.html").read_text()
    lines = [line for line in stderr.replace("\r", "\n").splitlines()
             if line.startswith("archfrag: ")]  # fmt: skip
    steps = [line.split()[1].rstrip(":") for line in lines]
    steps = [step for step in steps if step != "caution"]
    assert steps == ["motions", "batch", "cube", "fit", "fit", "report"]
    assert "simulations" in stderr
    assert "Building DAG" not in stderr
    assert {entry.name for entry in out.iterdir()} == {
        ".archfrag", "cube.nc", "curve-ring.svg", "curve-slab.svg", "fits.json", "report.html",
        "summary.json",
    }  # fmt: skip
    work = out / ".archfrag"
    for name in ("motions", "batch-0", "results"):
        assert (work / "logs" / f"{name}.log").read_text().startswith("archfrag: ")
        assert "max_rss" in (work / "benchmarks" / f"{name}.tsv").read_text()
    entries = json.loads((work / "run_log.json").read_text())
    assert entries[0]["runs"] == 20
    assert entries[0]["host"]


NOTHING = "archfrag: nothing to do: all results are up to date\n"


def written(folder):
    """All that is below a folder, with what a write would change."""
    places = [place for place in (folder, *folder.rglob("*")) if ".snakemake" not in place.parts]
    return {place: (place.stat().st_ino, place.stat().st_mtime_ns) for place in places}


def test_what_is_done_is_not_done_again(finished):
    """Nothing is written: results on a disk that allows none are results too."""
    path = finished[0]
    out = path.parent / "out"
    before = written(out)
    code, stdout, stderr = run(path)
    assert (code, stdout, stderr) == (0, f"report: {out / 'report.html'}\n", NOTHING)
    assert CliRunner().invoke(main, ["results", str(path)]).exit_code == 0
    assert written(out) == before


@pytest.mark.parametrize(
    ("asked", "shown"),
    [(["-n"], "batch "), (["--dag"], "digraph"), (["--report", "{}/report.html"], ""),
     (["--list-rules"], "motions")],
)  # fmt: skip
def test_what_asks_snakemake_only_changes_nothing(finished, tmp_path, asked, shown):
    """Of a study that is not done, without --cores; without a study an error names the option."""
    path, study = finished[0], tmp_path / "other.yaml"
    text = path.read_text().replace("[0.1, ", "[0.2, ").replace("output: out", "output: OUT")
    study.write_text(text.replace("OUT", str(path.parent / "out")).replace(
        "records/*", str(path.parent / "records" / "*")))  # fmt: skip
    before = written(path.parent)
    command = [sys.executable, "-m", "snakemake", "--snakefile", snakefile()]
    command += [each.format(tmp_path) for each in asked]
    done, none = (
        subprocess.run([*command, *more], cwd=tmp_path, capture_output=True, text=True)
        for more in (["--config", f"study={study}"], [])
    )
    assert done.returncode == 0, done.stderr
    assert shown in done.stdout + done.stderr
    assert written(path.parent) == before
    assert none.returncode == 1
    assert "no study is given; add --config study=FILE" in none.stdout + none.stderr
    assert run(path)[2] == NOTHING


def test_export_of_what_is_finished_and_of_nothing_else(finished, tmp_path):
    path, *_, cube = finished
    asked = ["export", str(path), "--format", "csv", "--out", str(tmp_path)]
    result = CliRunner().invoke(main, asked)
    assert result.exit_code == 0, result.output
    assert len(pd.read_csv(tmp_path / "small-runs.csv")) == 2 * 2 * 5
    assert cube in (tmp_path / "small-tables.json").read_text()
    made = {found: found.read_bytes() for found in tmp_path.iterdir()}
    late = CliRunner().invoke(main, [*asked, "--set", "intensity.levels=[0.1, 0.6]"])
    assert late.exit_code == 2
    assert "cube.nc: was made before these changed: levels" in late.stderr
    assert late.stderr.count("\n") == 1
    assert {found: found.read_bytes() for found in tmp_path.iterdir()} == made


def test_by_hand_snakemake_does_the_same(finished, tmp_path):
    path = finished[0]
    (path.parent / "out" / "cube.nc").write_bytes(b"")
    command = ["--cores", "1", "--config", f"study={os.path.relpath(path, tmp_path)}"]
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "--snakefile", snakefile(), *command], cwd=tmp_path,
        capture_output=True, text=True, timeout=600,
        env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "archfrag: cube: " in done.stdout
    assert "archfrag: motions: " not in done.stdout
    assert sha256(path.parent / "out" / "cube.nc") == finished[3]
    # Snakemake makes its own folder where it is started, before it knows of another.
    assert {entry.name for entry in tmp_path.iterdir()} <= {".snakemake"}
    assert run(path)[2] == NOTHING


TITLE = ("--set", "title=Another title")


def test_edits_and_another_record_with_an_older_date_are_noticed_and_named(finished):
    path = finished[0]
    out, record = path.parent / "out", path.parent / "records" / "wave1.AT2"
    before = sha256(out / "cube.nc")
    time_ = np.arange(150) * 0.01
    write_at2(record, 0.2 * np.sin(9.0 * time_) * np.sin(np.pi * time_ / 1.5), 0.01)
    os.utime(record, (1.0e9, 1.0e9))
    (out / "export").mkdir()
    (out / "export" / "small.xml").write_text("of the results before")
    code, _, stderr = run(path, *TITLE)
    assert code == 0, stderr
    assert f"{out / 'export'}: 1 file older than the results" in stderr
    shutil.rmtree(out / "export")
    assert f"archfrag: record {record} has changed (sha256 " in stderr
    assert "Another title" in (out / "report.html").read_text()
    assert sha256(out / "cube.nc") != before
    with xr.open_dataset(out / "cube.nc") as cube:
        assert cube["record_sha256"].sel(record="wave1").item() == sha256(record)
        assert json.loads(cube.attrs["archfrag_inputs_sha256"])["wave1.AT2"] == sha256(record)
    assert run(path, *TITLE)[::2] == (0, NOTHING)


def test_killed_three_times_and_resumed_gives_the_same_cube(finished, tmp_path):
    """The first kill is also one that is not resumed, and at work while another is started."""
    path = small_study(tmp_path, SLOW)
    out = tmp_path / "out"
    dice = random.Random(20)
    parts, resume = [], []
    work = out / ".archfrag"
    for sign in ("lock", "motions/*", "parts/*/*.npy"):
        process = start(path, *resume)
        while not list(work.glob(sign)):
            assert process.poll() is None, "it was done before it could be killed"
            time.sleep(0.02)
        who = f"process {process.pid} on {socket.gethostname()}"
        if not resume:
            assert run(path)[::2] == (
                4,
                f"archfrag: error: {out}: another run of study 'small' is at work here ({who}); "
                "wait for it or stop it\n",
            )
        time.sleep(dice.uniform(0.0, 0.5))
        kill_tree(process)
        if not resume:
            assert run(path)[::2] == (
                4,
                f"archfrag: error: {out}: an earlier run ({who}) was stopped in the middle; type "
                f"`archfrag run {path} --resume` to go on\n",
            )
        parts.append(len(list(work.glob("parts/*/*.npy"))))
        resume = ["--resume"]
    assert parts[-1] >= 1, "no run came so far that resuming meant anything"
    code, _, stderr = run(path, "--resume")
    assert code == 0, stderr
    assert sha256(out / "cube.nc") == finished[3]
    assert not list(out.rglob(".*.tmp"))


@pytest.mark.parametrize(
    ("number", "whom"),
    [(signal.SIGTERM, "parent"), (signal.SIGINT, "group"), (signal.SIGKILL, "parent")],
)
def test_a_stopped_run_takes_its_full_tree_with_it(tmp_path, number, whom):
    path = small_study(tmp_path, SLOW.replace("dt: 2.0e-3", "dt: 1.0e-5"))
    process = start(path)
    parts = tmp_path / "out" / ".archfrag" / "parts"
    while not list(parts.glob("*/plan-*")):
        assert process.poll() is None
        time.sleep(0.05)
    children = []
    while len(children) < 5:  # Snakemake, its shell, the batch, a worker and what tracks them
        assert process.poll() is None
        time.sleep(0.2)
        children = psutil.Process(process.pid).children(recursive=True)
    stopped = time.monotonic()
    (os.killpg if whom == "group" else os.kill)(process.pid, number)
    _, stderr = process.communicate(timeout=30)
    _, alive = psutil.wait_procs(children, timeout=5.0)
    took = time.monotonic() - stopped
    assert not alive
    if number == signal.SIGKILL:
        return
    assert took < 5.0
    assert process.returncode == 128 + number
    assert stderr.count("--resume") == 1
    assert stderr.endswith(
        f"archfrag: stopped by {number.name}; what is finished is kept, `archfrag run {path} "
        "--resume` goes on\n"
    )
    holder = json.loads((tmp_path / "out" / ".archfrag" / "lock").read_text())
    assert (holder["host"], holder["pid"]) == (socket.gethostname(), process.pid)


def test_a_failing_step_is_reported_once_with_its_exit_code(tmp_path):
    path = small_study(tmp_path, TEXT.replace("thickness: 1.5", "thickness: 0.3"))
    code, _, stderr = run(path)
    assert code == 3
    assert stderr.count("archfrag: error:") == 1
    assert "archfrag: error: arches[0] (ring): does not stand under its own weight" in stderr
    assert "Traceback" not in stderr


def test_a_copy_of_a_study_file_with_the_same_id_is_refused(finished):
    path = finished[0]
    before = sha256(path.parent / "out" / "cube.nc")
    copy = path.with_name("copy.yaml")
    copy.write_text(path.read_text().replace("thickness: 1.5", "thickness: 1.4"))
    code, _, stderr = run(copy)
    assert code == 4
    assert f"holds the results of {path}, which has the id 'small' too" in stderr
    assert stderr.count("\n") == 1
    assert sha256(path.parent / "out" / "cube.nc") == before
    moved = path.with_name("moved.yaml")
    path.rename(moved)
    assert run(moved, *TITLE)[0] == 0
    moved.rename(path)


def test_a_step_that_breaks_is_reported_with_the_log_that_holds_it(tmp_path):
    path = small_study(tmp_path)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "sitecustomize.py").write_text(BROKEN)
    code, _, stderr = run(path, env={"PYTHONPATH": str(tmp_path / "broken")})
    log = tmp_path / "out" / ".archfrag" / "logs" / "motions.log"
    assert code == 1
    assert stderr == (
        "archfrag: error: step motions failed: ZeroDivisionError: a mistake of ours; all of it is "
        f"in {log}\n"
    )
    assert "Traceback" in log.read_text()


def test_what_snakemake_states_is_reported_with_its_log(tmp_path):
    path = small_study(tmp_path)
    (tmp_path / "profile").mkdir()
    (tmp_path / "profile" / "config.yaml").write_text("executor: no-such-cluster\ncores: 1\n")
    code, _, stderr = run(path, "--profile", tmp_path / "profile")
    log = tmp_path / "out" / ".archfrag" / "logs" / "snakemake.log"
    assert code == 1
    assert stderr.startswith("archfrag: error: Snakemake failed: ")
    assert "no-such-cluster" in stderr
    assert str(log) in stderr
    assert "no-such-cluster" in log.read_text()


@pytest.mark.parametrize(
    ("override", "code", "message"),
    [
        ("motions.files=['nowhere/*']", 2, "motions.files[0]: no file matches"),
        ("output=small.yaml/out", 4, "cannot be written (Not a directory)"),
    ],
)
def test_bad_input_is_reported_before_anything_runs(
    tmp_path, monkeypatch, override, code, message
):
    path = small_study(tmp_path)
    monkeypatch.chdir(tmp_path)
    found, _, stderr = run(path, "--set", override)
    assert found == code
    assert message in stderr
    assert stderr.count("\n") == 1
    assert not list(tmp_path.rglob("motions.json"))


def test_records_of_ones_own_of_odd_names_and_a_home_that_cannot_be_written(tmp_path, monkeypatch):
    """The command of configs/own_records.yaml, from another folder."""
    folder = tmp_path / "a {b}\n'c'"
    small_study(folder)
    for number, name in enumerate(("{x} $HOME.AT2", "two\nlines.AT2")):
        os.rename(folder / "records" / f"wave{number}.AT2", folder / "records" / name)
    monkeypatch.chdir(folder / "records")
    code, _, stderr = run(
        ROOT / "configs" / "own_records.yaml", "--set", "motions.files=['*lines.AT2', none]",
        "--set", "motions.files.1='{x} $HOME.AT2'", "--set", "output=../mine", "--set",
        "intensity.levels=[0.3, 0.9]", "--set", "method.dt=2e-3", "--set", "method.follow=1",
        "--quiet", env={"HOME": "/dev/null", "NUMBA_CACHE_DIR": str(kernel_cache._base())},
    )  # fmt: skip
    assert (code, stderr) == (0, "")
    assert (folder / "mine" / "report.html").is_file()
