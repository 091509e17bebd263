"""Batches here and in worker processes: the same results, losses and signals survived."""

import contextlib
import io
import os
import re
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import psutil
import pytest

from archfrag.errors import WorkerError
from archfrag.motions.formats import one_reader, read_apart
from archfrag.study.file.schema import Method
from archfrag.study.running import only_run, stoppable
from archfrag.study.runs import execute
from archfrag.study.runs.execute import method_to_compile, run_batch
from archfrag.study.runs.ida import Ida
from archfrag.study.runs.store import gather, make_plan, read_part
from tests.study.small import ROOT, changed


def assert_same(results, expected):
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


@contextlib.contextmanager
def killer(folder, every):
    """Kill workers once the first part is there: one of them, or whoever comes; given are all."""
    killed, stop = [], threading.Event()

    def kill():
        while not stop.wait(0.05) and (every or not killed):
            if list(folder.glob("parts/*/*.npy")):
                for process in worker_processes()[: None if every else 1]:
                    with contextlib.suppress(psutil.NoSuchProcess):
                        process.kill()
                        killed.append(process)

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    try:
        yield killed
    finally:
        stop.set()
        thread.join(10.0)


def cleared(study, step):
    """The same study without parts; with steps so short that there is time to kill somebody."""
    for path in study.work.glob("parts/*/*.npy"):
        path.unlink()
    return changed(study, "method", dt=step)


@pytest.mark.parametrize(
    ("code", "printed"),
    [
        (
            "import sys, archfrag.study.runs.execute, archfrag.simulate\n"
            "print({'obspy', 'matplotlib', 'xarray', 'netCDF4', 'dask'} & set(sys.modules))",
            "set()",
        ),
        (
            "import sys; from archfrag.study.running import without_dask\n"
            "for _ in range(2):\n"
            "    with without_dask():\n"
            "        import xarray; xarray.Dataset({'a': ('x', [1.0])}).to_netcdf(sys.argv[1])\n"
            "    print('dask' in sys.modules)\n"
            "    import dask.base\n",
            "False\nTrue",
        ),
    ],
    ids=["a worker", "a run without a scheduler, which hides dask from nobody else"],
)
def test_what_is_heavy_is_not_loaded(tmp_path, code, printed):
    asked = [sys.executable, "-c", code, tmp_path / "a.nc"]
    found = subprocess.run(asked, capture_output=True, text=True)
    assert found.stdout.strip() == printed, found.stderr


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


class Terminal(io.StringIO):
    """A terminal that shows each frame of a bar."""

    def isatty(self):
        return True


@pytest.mark.parametrize("estimate", [2, 30])
def test_the_bar_counts_from_the_first_run_to_an_estimate_that_stays(
    copied, monkeypatch, estimate
):
    def warmup(name, progress):
        progress("compiling kernels: 5 s")
        time.sleep(1.5)
        return 5.0

    class Bar(execute._Bar):
        def __init__(self, **options):
            super().__init__(**{**options, "mininterval": 0.01, "delay": 0.01})

    for part in copied.plan.parts.glob("*.npy"):
        part.unlink()
    monkeypatch.setattr(execute, "_Bar", Bar)
    monkeypatch.setattr("archfrag.warmup.kernels_are_compiled", lambda name: False)
    monkeypatch.setattr("archfrag.warmup.warmup", warmup)
    monkeypatch.setattr(Ida, "size", lambda self, *shape: (estimate, "about"))
    monkeypatch.setattr(sys, "stderr", Terminal())
    study = copied.study.model_copy(update={"design": Ida(kind="ida")})
    log, _ = run_batch(study, workers=1)
    frames = sys.stderr.getvalue().replace("\r", "\n").splitlines()
    assert any(frame.startswith("compiling kernels: 5 s") for frame in frames)
    assert "archfrag: kernels: compiled in 5.0 s" in frames
    bars = [frame for frame in frames if frame.startswith("simulations: ")]
    found = [re.search(r" (\d+)/(\d+) \[00:(\d+)<", frame) for frame in bars]
    shown = [tuple(map(int, each.groups())) for each in found]
    *before, last = shown
    assert {total for _, total, _ in before} == {2 * estimate}
    assert all(made < total for made, total, _ in before)
    assert last[:2] == (log["runs"],) * 2
    assert last[2] <= log["wall_time"] - 1.5
    assert not frames[-1].strip()


@pytest.mark.parametrize(("checks", "expected"), [(None, 150), (7, 127)])
def test_a_search_is_expected_to_check_as_many_runs_as_it_has_records(checks, expected):
    assert Ida(kind="ida", checks=checks).size(30, 15) == (expected, "about")


def test_only_the_kernels_that_the_runs_need(done):
    arches = done.study.arches[:1]
    fine = Method(name="auto", rtol=1e-5)
    for method, expected in (
        (done.study.method, "time_stepping"), (Method(name="auto"), "auto"), (fine, "event_driven")
    ):  # fmt: skip
        changes = {"arches": arches, "method": method}
        assert method_to_compile(make_plan(done.study.model_copy(update=changes))) == expected


def test_workers_make_the_same_runs_and_one_that_is_killed_costs_only_time(copied, monkeypatch):
    monkeypatch.setattr(execute, "IN_PROCESS", 0.0)  # workers are started for the first run
    study = cleared(copied.study, 1e-4)
    with killer(study.work, every=False) as killed:
        log, _ = run_batch(study, workers=2, quiet=True)
    assert (len(killed), log["workers"]) == (1, 2)
    assert not worker_processes()
    plan = make_plan(study)
    disturbed = gather(plan)
    run_batch(cleared(study, 1e-4), workers=1, quiet=True)
    assert_same(gather(plan), disturbed)


def test_workers_killed_again_and_again_end_the_batch(copied, monkeypatch):
    monkeypatch.setattr(execute, "IN_PROCESS", 0.0)
    study = cleared(copied.study, 1e-5)
    killed = pytest.raises(WorkerError, match="killed or ran out of memory 4 times")
    with killer(study.work, every=True), killed as caught:
        run_batch(study, workers=2, quiet=True)
    assert caught.value.exit_code == 5
    parts = list(make_plan(study).parts.glob("*.npy"))
    assert 1 <= len([path for path in parts if read_part(path) is not None]) < 6


def test_a_scheduler_that_does_not_answer(copied, monkeypatch):
    monkeypatch.setattr(execute, "ANSWER_WITHIN", 0.5)
    next(copied.plan.parts.glob("*.npy")).unlink()
    study = changed(copied.study, "execution", scheduler="tcp://127.0.0.1:1")
    with pytest.raises(WorkerError, match=r"execution.scheduler: tcp://.*cannot be used"):
        run_batch(study, quiet=True)


class TestStop:
    def test_the_first_signal_raises_and_the_others_are_ignored(self):
        before = signal.getsignal(signal.SIGTERM)

        def be_stopped_thrice():
            try:
                os.kill(os.getpid(), signal.SIGTERM)
                time.sleep(5.0)
            finally:
                os.kill(os.getpid(), signal.SIGINT)
                os.kill(os.getpid(), signal.SIGTERM)

        with pytest.raises(SystemExit) as stopped, stoppable():
            be_stopped_thrice()
        assert stopped.value.code == 128 + signal.SIGTERM
        assert signal.getsignal(signal.SIGTERM) == before

    def test_code_that_does_not_return_is_ended(self):
        """A hash of many rounds stands for a compiler."""
        code = (
            "import hashlib; from archfrag.study import running; running.GRACE = 0.5\n"
            "with running.stoppable():\n"
            "    print('ready', flush=True)\n"
            "    hashlib.pbkdf2_hmac('sha256', b'a', b'b', 2**31 - 1)\n"
        )
        process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)  # until the hash has begun
        process.send_signal(signal.SIGTERM)
        assert process.wait(5.0) == 128 + signal.SIGTERM
        process.communicate()


def test_a_file_system_without_locks_does_without(copied, monkeypatch):
    def none(*_):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr("fcntl.flock", none)
    with only_run(copied.study), only_run(copied.study):
        pass


def test_one_process_reads_all_records_and_does_not_hold_the_lock(copied):
    path = next((ROOT / "records" / "synthetic").glob("*.mseed"))
    before = set(psutil.Process().children())
    with only_run(copied.study), one_reader():
        read_apart(str(path))
        (reader,) = set(psutil.Process().children()) - before
        read_apart(str(path))
        assert set(psutil.Process().children()) - before == {reader}
        assert str(copied.study.work / "lock") not in [file.path for file in reader.open_files()]
    assert not reader.is_running()
