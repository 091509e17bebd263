"""Batches here and in worker processes: the same results, losses survived or reported."""

import contextlib
import subprocess
import sys
import threading
import time

import numpy as np
import psutil
import pytest

from archfrag.errors import WorkerError
from archfrag.study.file.members import Members
from archfrag.study.file.schema import Method
from archfrag.study.runs import execute
from archfrag.study.runs.design import CASE
from archfrag.study.runs.execute import chunks, kernels_needed, run_batch
from archfrag.study.runs.store import Plan, gather, make_plan, read_part


def assert_same(results, expected):
    """The same runs with the same results, however they were cut into parts."""
    np.testing.assert_array_equal(results[0], expected[0])
    for name in set(results[1].dtype.names) - {"wall_time"}:
        np.testing.assert_array_equal(results[1][name], expected[1][name])


def worker_processes():
    """Workers of this process; not the trackers of multiprocessing."""
    found = []
    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
    return found


class Killer(threading.Thread):
    """Kills workers as soon as the first part is there: one of them, or whoever comes."""

    def __init__(self, folder, every):
        super().__init__(daemon=True)
        self.folder, self.every, self.killed = folder, every, 0
        self.stop = threading.Event()

    def run(self):
        while not self.stop.is_set():
            if list(self.folder.glob("parts/*/*.npy")):
                for process in worker_processes()[: None if self.every else 1]:
                    with contextlib.suppress(psutil.NoSuchProcess):
                        process.kill()
                        self.killed += 1
                if self.killed and not self.every:
                    return
            time.sleep(0.05)


def cleared(done, step=None):
    """The same study without parts; with steps so short that there is time to kill somebody."""
    for path in done.study.work.glob("parts/*/*.npy"):
        path.unlink()
    method = done.study.method
    method = method if step is None else method.model_copy(update={"dt": step})
    return done.study.model_copy(update={"method": method})


@pytest.fixture
def _at_once(monkeypatch):
    """Workers are started for the first run."""
    monkeypatch.setattr(execute, "IN_PROCESS", 0.0)


def test_workers_import_neither_obspy_nor_matplotlib():
    code = (
        "import sys; import archfrag.study.runs.execute, archfrag.simulate; "
        "print([n for n in ('obspy', 'matplotlib', 'xarray', 'netCDF4', 'dask') "
        "if n in sys.modules])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]"


def test_finished_parts_are_kept_and_only_the_others_made(done, copied):
    kept, gone, torn = sorted(copied.plan.parts.glob("*.npy"))[:3]
    gone.unlink()
    torn.write_bytes(b"torn")
    before = kept.stat()
    log, table = run_batch(copied.study, quiet=True)
    assert (log["runs"], log["kept"]) == (12, 8)
    assert kept.stat().st_mtime_ns == before.st_mtime_ns
    assert_same(gather(copied.plan), gather(done.plan))
    assert table["arch"].tolist() == ["ring"] * 6 + ["slab"] * 6
    assert (table["wall_time"] > 0.0).all()
    log, _ = run_batch(copied.study, quiet=True)
    assert (log["kept"], log["workers"]) == (12, 0)


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        ({"name": "time_stepping"}, ["time_stepping"]),
        ({"name": "auto"}, ["auto"]),
        ({"name": "auto", "rtol": 1e-5}, ["event_driven"]),
    ],
)
def test_only_the_kernels_that_the_runs_need(done, method, expected):
    arches = Members(each for each in done.plan.arches if each.entry.build().n_voussoir > 2)
    study = done.study.model_copy(update={"method": Method(**method)})
    assert kernels_needed(Plan(study, arches, done.plan.records)) == expected


@pytest.mark.usefixtures("_at_once")
def test_workers_make_the_same_runs_and_one_that_is_killed_costs_nothing_but_time(copied):
    study = cleared(copied, 1e-4)
    killer = Killer(study.work, every=False)
    killer.start()
    log, _ = run_batch(study, workers=2, quiet=True)
    killer.join(10.0)
    assert (killer.killed, log["workers"]) == (1, 2)
    assert not worker_processes()
    plan = make_plan(study)
    disturbed = gather(plan)
    cleared(copied)
    run_batch(study, workers=1, quiet=True)
    assert_same(gather(plan), disturbed)


@pytest.mark.usefixtures("_at_once")
def test_workers_killed_again_and_again_end_the_batch(copied):
    study = cleared(copied, 1e-5)
    killer = Killer(study.work, every=True)
    killer.start()
    try:
        with pytest.raises(WorkerError, match="killed or ran out of memory 4 times") as caught:
            run_batch(study, workers=2, quiet=True)
    finally:
        killer.stop.set()
    assert caught.value.exit_code == 5
    parts = list(make_plan(study).parts.glob("*.npy"))
    assert 1 <= len([path for path in parts if read_part(path) is not None]) < 6


def test_a_scheduler_that_does_not_answer(copied, monkeypatch):
    monkeypatch.setattr(execute, "ANSWER_WITHIN", 0.5)
    next(copied.plan.parts.glob("*.npy")).unlink()
    execution = copied.study.execution.model_copy(update={"scheduler": "tcp://127.0.0.1:1"})
    study = copied.study.model_copy(update={"execution": execution})
    with pytest.raises(
        WorkerError, match=r"execution.scheduler: tcp://127.0.0.1:1 cannot be used"
    ):
        run_batch(study, quiet=True)


def test_chunks_are_of_one_arch_and_of_the_size_asked_for():
    cases = np.zeros(10, CASE)
    cases["arch"], cases["record"] = [0] * 7 + [3] * 3, np.arange(10)
    sizes = iter([2, 4, 8, 2, 2])
    found = list(chunks(cases, lambda: next(sizes)))
    assert [len(each) for each in found] == [2, 4, 1, 2, 1]
    np.testing.assert_array_equal(np.concatenate(found), cases)
