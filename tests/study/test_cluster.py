"""Runs on dask's workers: equal bits, without the study's folder; lost, late and other workers."""

import contextlib
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from distributed import Client, LocalCluster

from archfrag.errors import WorkerError
from archfrag.study.designs import Ida
from archfrag.study.provenance import PACKAGE
from archfrag.study.runs import workers as fan
from archfrag.study.runs.execute import run_batch
from archfrag.study.runs.store import Plan, gather, make_plan
from tests.study.small import changed

DASK = [sys.executable, "-m", "dask"]
WORKER = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "0"]
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


class Machines:
    """A scheduler of this machine, and workers that are started one by one."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "scheduler.json"
        self.workers = []
        (folder / "none").mkdir()  # the scheduler needs no archfrag
        (folder / "none" / "archfrag.py").write_text("raise ImportError")
        self.scheduler = subprocess.Popen(
            [
                *DASK,
                "scheduler",
                "--host",
                "127.0.0.1",
                "--port",
                "0",
                "--no-dashboard",
                "--scheduler-file",
                str(self.file),
            ],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(folder / "none")},
            **QUIET,
        )

    def start(self, package: Path = PACKAGE.parent) -> None:
        """Start a worker with this package."""
        self.workers.append(
            subprocess.Popen(
                [
                    *DASK,
                    "worker",
                    "--host",
                    "127.0.0.1",
                    "--scheduler-file",
                    str(self.file),
                    *WORKER,
                    "--local-directory",
                    str(self.file.parent),
                ],
                cwd=self.file.parent,
                env={**os.environ, "PYTHONPATH": str(package)},
                **QUIET,
            )
        )

    def wait(self, count: int) -> str:
        """Wait for the scheduler and some workers; its address."""
        end = time.monotonic() + 30.0
        while not self.file.is_file() and time.monotonic() < end:
            time.sleep(0.05)
        with Client(
            scheduler_file=str(self.file), set_as_default=False, timeout=30
        ) as client:
            if count:
                client.wait_for_workers(count, timeout=30)
            return client.scheduler.address


@pytest.fixture
def machines(tmp_path) -> Iterator[Machines]:
    started = Machines(tmp_path)
    try:
        yield started
    finally:
        for process in (*started.workers, started.scheduler):
            process.kill()
            process.wait()


@pytest.fixture
def far(monkeypatch):
    """Workers that cannot find the study's folder."""
    usual = Plan.with_motions

    def without_folder(plan):
        study = plan.study.model_copy(update={"output": "/nowhere"})
        return replace(usual(plan), study=study)

    monkeypatch.setattr(Plan, "with_motions", without_folder)


def without_runs(study):
    for path in study.work.glob("parts/*/*.npy"):
        path.unlink()
    return study


@contextlib.contextmanager
def after_the_first_part(study, act):
    """Act once a part is there, from another thread."""
    done = threading.Event()
    parts = make_plan(study).parts

    def watch():
        while not done.wait(0.02):
            if list(parts.glob("*.npy")):
                return act()

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()


def assert_same_as_here(study):
    """The runs that are stored are those of threads of this process."""
    plan = make_plan(study)
    found = gather(plan)
    run_batch(
        changed(without_runs(study), "execution", scheduler=None), workers=1, quiet=True
    )
    for one, other in zip(found[:2], gather(plan)):
        for name in set(one.dtype.names) - {"wall_time"}:
            np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize("design", ["stripes", "ida"])
def test_a_cluster_that_loses_a_worker_and_gets_another(
    copied, machines, far, capsys, design
):
    """By its address, and by its file; steps are so short that there is time to kill somebody."""
    study = changed(without_runs(copied.study), "method", dt=2e-4)
    for _ in range(2):
        machines.start()
    address = machines.wait(2)
    if design == "ida":
        address = str(machines.file)
        study = study.model_copy(update={"design": Ida(kind="ida", checks=2)})
    study = changed(study, "execution", scheduler=address)

    def lose():
        machines.workers[0].kill()
        machines.start()

    with after_the_first_part(study, lose):
        log, _ = run_batch(study)
    assert machines.workers[0].wait() == -9
    assert (log["kept"], log["workers"]) == (0, 2)
    assert f"archfrag: cluster {address}: 2 threads" in capsys.readouterr().err
    assert_same_as_here(study)


def test_runs_wait_for_the_first_worker_and_a_lost_scheduler_is_a_message(
    copied, machines, far, capsys
):
    study = changed(
        without_runs(copied.study), "execution", scheduler=machines.wait(0), chunk=1
    )
    late = threading.Timer(1.0, machines.start)
    late.start()
    with (
        after_the_first_part(study, machines.scheduler.kill),
        pytest.raises(
            WorkerError, match="the scheduler is gone; finished parts are kept"
        ),
    ):
        run_batch(changed(study, "method", dt=1e-4))
    assert "no worker yet; runs begin when one comes" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (
            "study/runs/store.py",
            '"verdict"] = verdicts_of(results.status)',
            '"verdict"] = np.ones(len(results.status))',
            "a worker on .* runs archfrag .* numba .*; the study is run by "
            "archfrag .*; install the "
            "same code for all workers",
        ),
        (
            "study/runs/store.py",
            "class Plan:",
            "class Planned:",
            "a worker failed: NameError: .*; all workers must have archfrag",
        ),
        (
            "study/runs/workers.py",
            "def make_runs(",
            "def make(",
            "a worker failed: AttributeError: .*; all workers must have archfrag",
        ),
    ],
    ids=["other results", "no plan", "no function"],
)
def test_a_worker_with_other_code_makes_no_run(
    copied, machines, file, old, new, message
):
    other = machines.file.parent / "other" / "archfrag"
    shutil.copytree(PACKAGE, other, ignore=shutil.ignore_patterns("__pycache__"))
    text = (other / file).read_text()
    assert old in text
    (other / file).write_text(text.replace(old, new))
    machines.start(other.parent)
    study = changed(without_runs(copied.study), "execution", scheduler=machines.wait(1))
    with pytest.raises(WorkerError, match=message):
        run_batch(study, quiet=True)
    assert not list(study.work.glob("parts/*/*.npy"))


def test_a_client_that_is_current_makes_the_runs_and_an_adaptive_cluster_grows(
    copied, far, monkeypatch, capsys
):
    used = []
    for kind in (fan.Threads, fan.Cluster):
        monkeypatch.setattr(
            fan,
            kind.__name__,
            lambda *a, kind=kind: used.append(kind.__name__) or kind(*a),
        )
    study = changed(copied.study, "execution", workers=None)
    options = {"processes": False, "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(n_workers=0, threads_per_worker=2, **options) as cluster:
        cluster.adapt(minimum=0, maximum=1, interval="50ms")
        with Client(cluster):
            log, _ = run_batch(without_runs(study))
            run_batch(
                without_runs(study), workers=1, quiet=True
            )  # threads that are asked for
    run_batch(without_runs(study), quiet=True)  # the client is gone
    assert (log["runs"], log["kept"]) == (12, 0)
    assert log["workers"] in (
        1,
        2,
    )  # there was none at first; at the end it may have gone again
    said = capsys.readouterr().err
    assert "no worker yet; runs begin when one comes" in said
    assert "dashboard" not in said  # which may be off
    assert used == ["Cluster", "Threads", "Threads"]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("tcp://127.0.0.1:1", "execution.scheduler: tcp://127.0.0.1:1 cannot be used"),
        ("nonsense://a", "execution.scheduler: nonsense://a cannot be used"),
        ("/nowhere/scheduler.json", "scheduler.json cannot be used: .*No such file"),
        (__file__ + ".json", "cannot be used"),
    ],
)
def test_a_scheduler_that_does_not_answer(
    copied, monkeypatch, tmp_path, given, message
):
    monkeypatch.setattr(fan, "ANSWER_WITHIN", 0.5)
    if given.startswith(__file__):
        given = str(tmp_path / "scheduler.json")
        Path(given).write_text("{}")
    study = changed(without_runs(copied.study), "execution", scheduler=given)
    with pytest.raises(WorkerError, match=message):
        run_batch(study, quiet=True)
