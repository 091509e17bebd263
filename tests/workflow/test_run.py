"""One command for a study: done, up to date, killed, resumed, in each other's way."""

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import time

import psutil
import pytest

from tests.study.small import TEXT, small_study

# Long enough to be killed in the middle, by making each chunk one run.
SLOW = TEXT.replace("chunk: 2", "chunk: 1").replace("[0.1, 0.6, 1.2]", "[0.1, 0.3, 0.6, 0.9, 1.2]")


def start(*arguments):
    """`archfrag run` as a user starts it, in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "archfrag.cli", "run", *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip


def run(*arguments):
    process = start(*arguments)
    stdout, stderr = process.communicate(timeout=170)
    return process.returncode, stdout, stderr


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def kill_tree(process):
    """SIGKILL for the whole tree, however it has grouped itself."""
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
    """Study file of an undisturbed run, and what it printed."""
    path = small_study(tmp_path_factory.mktemp("finished"), SLOW)
    code, stdout, stderr = run(path)
    assert code == 0, stderr
    return path, stdout, stderr


def test_a_run_ends_with_a_report_and_a_line_for_each_step(finished):
    path, stdout, stderr = finished
    out = path.parent / "out"
    assert stdout == f"report: {out / 'report.html'}\n"
    assert "A small study" in (out / "report.html").read_text()
    lines = [line for line in stderr.replace("\r", "\n").splitlines()
             if line.startswith("archfrag: ")]  # fmt: skip
    steps = [line.split()[1].rstrip(":") for line in lines]
    assert steps == ["motions", "batch", "cube", "fit", "fit", "report"]
    assert "simulations" in stderr
    assert "Building DAG" not in stderr
    assert (out / ".snakemake").is_dir()
    for name in ("motions", "batch-0", "cube", "fit", "report"):
        assert (out / "logs" / f"{name}.log").read_text().startswith("archfrag: ")
        assert "max_rss" in (out / "benchmarks" / f"{name}.tsv").read_text()
    entries = json.loads((out / "run_log.json").read_text())
    assert entries[0]["runs"] == 20
    assert entries[0]["host"]


def test_what_is_done_is_not_done_again_and_edits_are_noticed(finished):
    path, _, _ = finished
    out = path.parent / "out"
    before = (out / "cube.nc").stat().st_mtime_ns
    code, _, stderr = run(path)
    assert (code, stderr) == (0, "")
    assert (out / "cube.nc").stat().st_mtime_ns == before
    code, _, stderr = run(path, "--set", "title=Another title")
    assert code == 0
    assert "20 of them kept from before" in stderr
    assert "Another title" in (out / "report.html").read_text()
    code, _, stderr = run(path)
    assert code == 0


def test_killed_three_times_and_resumed_gives_the_same_cube(finished, tmp_path):
    path = small_study(tmp_path, SLOW)
    out = tmp_path / "out"
    dice = random.Random(20)
    resume: list[str] = []
    stages = []
    for _ in range(3):
        process = start(path, *resume)
        time.sleep(dice.uniform(1.5, 6.0))
        assert process.poll() is None, "it was done before it could be killed"
        kill_tree(process)
        stages.append((len(list(out.glob("parts/0*.npz"))), (out / "motions.json").exists()))
        resume = ["--resume"]
    assert stages[-1][1], "no run came so far that resuming meant anything"
    code, _, stderr = run(path, "--resume")
    assert code == 0, stderr
    assert sha256(out / "cube.nc") == sha256(finished[0].parent / "out" / "cube.nc")
    assert not list(out.rglob(".*.tmp"))


def test_an_interrupted_run_says_what_to_type(tmp_path):
    path = small_study(tmp_path, SLOW)
    process = start(path)
    locks = tmp_path / "out" / ".snakemake" / "locks"
    while not (locks.is_dir() and any(locks.iterdir())):
        assert process.poll() is None
        time.sleep(0.05)
    code, _, stderr = run(path)
    assert code == 4
    assert stderr == (
        f"archfrag: error: {tmp_path / 'out'}: another run of study 'small' is at work here; wait "
        "for it or stop it\n"
    )
    kill_tree(process)
    code, _, stderr = run(path)
    assert code == 4
    assert stderr == (
        f"archfrag: error: {tmp_path / 'out'}: an earlier run was stopped in the middle; type "
        f"`archfrag run {path} --resume` to go on\n"
    )


def test_a_failing_step_is_told_once_with_its_exit_code(tmp_path):
    path = small_study(tmp_path, TEXT.replace("thickness: 1.5", "thickness: 0.3"))
    code, _, stderr = run(path)
    assert code == 3
    assert stderr.count("archfrag: error:") == 1
    assert "archfrag: error: arches[0] (ring): does not stand under its own weight" in stderr
    assert "Traceback" not in stderr


def test_results_of_another_study_are_left_alone(finished, tmp_path):
    out = finished[0].parent / "out"
    before = sha256(out / "cube.nc")
    path = small_study(tmp_path, TEXT.replace("id: small", "id: other"))
    code, _, stderr = run(path, "--set", f"output={out}")
    assert code == 4
    assert "the cube of study 'small' is in the way of study 'other'" in stderr
    assert sha256(out / "cube.nc") == before


@pytest.mark.parametrize(
    ("override", "code", "sentence"),
    [
        ("metod.name=auto", 2, "metod is no known key; did you mean method?"),
        ("motions.files=['nowhere/*']", 2, "motions.files[0]: no file matches"),
        ("output=small.yaml/out", 4, "cannot be written (Not a directory)"),
    ],
)
def test_bad_input_is_told_before_anything_runs(tmp_path, monkeypatch, override, code, sentence):
    path = small_study(tmp_path)
    monkeypatch.chdir(tmp_path)
    found, _, stderr = run(path, "--set", override)
    assert found == code
    assert sentence in stderr
    assert stderr.count("\n") == 1
    assert not (tmp_path / "out" / "motions.json").exists()


def test_records_of_ones_own_by_one_command(tmp_path, monkeypatch):
    """The command of configs/own_records.yaml, from another folder."""
    from tests.study.small import ROOT

    small_study(tmp_path)
    monkeypatch.chdir(tmp_path)
    code, _, stderr = run(
        ROOT / "configs" / "own_records.yaml", "--set", "motions.files=['records/*.AT2']",
        "--set", "output=mine", "--set", "intensity.levels=[0.3, 0.9]", "--set", "method.dt=2e-3",
        "--set", "method.follow=1", "--quiet",
    )  # fmt: skip
    assert (code, stderr) == (0, "")
    assert (tmp_path / "mine" / "report.html").is_file()
