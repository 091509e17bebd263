"""Runs on workers of a real dask scheduler: equal bits, a lost worker, workers of other code."""

import contextlib
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from archfrag.errors import WorkerError
from archfrag.study.files import PACKAGE
from archfrag.study.runs.execute import run_batch
from archfrag.study.runs.store import gather, make_plan
from tests.study.small import changed

DASK = [sys.executable, "-m", "dask"]
WORKER = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "0"]


@contextlib.contextmanager
def cluster(folder: Path, packages: list[Path]) -> Iterator[tuple[str, list[subprocess.Popen]]]:
    """Start a scheduler and a worker with the package of each folder; its address, the workers."""
    known = folder / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    started = [subprocess.Popen(
        [*DASK, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
         "--scheduler-file", str(known)], **quiet,
    )]  # fmt: skip
    try:
        for package in packages:
            started.append(subprocess.Popen(
                [*DASK, "worker", "--host", "127.0.0.1", "--scheduler-file", str(known), *WORKER,
                 "--local-directory", str(folder)],
                env={**os.environ, "PYTHONPATH": str(package)}, **quiet,
            ))  # fmt: skip
        yield f"file://{known}", started[1:]
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


def address_in(known: str, workers: int) -> str:
    """Wait for the workers; the scheduler's address."""
    from distributed import Client

    path, end = Path(known.removeprefix("file://")), time.monotonic() + 30.0
    while not path.is_file() and time.monotonic() < end:
        time.sleep(0.05)
    with Client(scheduler_file=str(path), set_as_default=False, timeout=30) as client:
        client.wait_for_workers(workers, timeout=30)
        return client.scheduler.address


def without_runs(study, known, workers):
    """The study without its parts, its steps so short that there is time to kill a worker."""
    for path in study.work.glob("parts/*/*.npy"):
        path.unlink()
    address = address_in(known, workers)
    return changed(changed(study, "method", dt=2e-4), "execution", scheduler=address)


def test_runs_of_a_cluster_that_loses_a_worker_are_those_of_this_machine(copied, tmp_path):
    with cluster(tmp_path, [PACKAGE.parent] * 2) as (known, workers):
        study = without_runs(copied.study, known, 2)
        plan, done = make_plan(study), threading.Event()

        def kill_one():
            while not done.wait(0.02):
                if list(plan.parts.glob("*.npy")):
                    workers[0].kill()
                    return

        killer = threading.Thread(target=kill_one)
        killer.start()
        try:
            log, _ = run_batch(study, quiet=True)
        finally:
            done.set()
            killer.join()
    assert workers[0].returncode == -9
    assert (log["runs"], log["kept"], log["workers"]) == (12, 0, 2)
    far = gather(plan)
    for path in plan.parts.glob("*.npy"):
        path.unlink()
    run_batch(changed(study, "execution", scheduler=None), workers=1, quiet=True)
    here = gather(plan)
    np.testing.assert_array_equal(far[0], here[0])
    for name in set(here[1].dtype.names) - {"wall_time"}:
        np.testing.assert_array_equal(far[1][name], here[1][name])


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("study/runs/store.py", '"verdict": np.minimum(results.status, Verdict.SOLVER_FAILURE)',
         '"verdict": np.ones(len(results.status))',
         "a worker on .* runs archfrag .* numba .*; the study is run by archfrag .*; install the "
         "same code for all workers"),
        ("study/runs/execute.py", "    code: tuple[str, str],\n", "",
         "a worker failed: TypeError: .*; all workers must have archfrag"),
    ],
    ids=["other results", "another version"],
)  # fmt: skip
def test_a_worker_with_other_code_makes_no_run(copied, tmp_path, file, old, new, message):
    other = tmp_path / "other" / "archfrag"
    shutil.copytree(PACKAGE, other, ignore=shutil.ignore_patterns("__pycache__"))
    text = (other / file).read_text()
    assert old in text
    (other / file).write_text(text.replace(old, new))
    with cluster(tmp_path, [other.parent]) as (known, _):
        study = without_runs(copied.study, known, 1)
        with pytest.raises(WorkerError, match=message):
            run_batch(study, quiet=True)
    assert not list(study.work.glob("parts/*/*.npy"))
