"""Batches on dask workers: same results for any number of them, losses survived or reported."""

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import psutil
import pytest

from archfrag.errors import WorkerError
from archfrag.study import batch as batch_module
from archfrag.study.batch import kernels_needed, run_batch
from archfrag.study.bundles import LONGEST, SHORTEST, Bundles
from archfrag.study.config import Method
from archfrag.study.plan import make_plan
from archfrag.study.store import Gathered, read_part
from tests.study.small import make_runs


def parts_of(folder):
    return {path.name: path.read_bytes() for path in folder.glob("parts/*/*.npy")}


def assert_same(results, expected):
    """The same runs with the same results, however they were cut into parts."""
    np.testing.assert_array_equal(results.cases, expected.cases)
    for name, values in expected.table.items():
        np.testing.assert_array_equal(results.table[name], values)


def worker_processes():
    """Processes that dask started for this one; not the trackers of multiprocessing."""
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
                if not self.every:
                    return
            time.sleep(0.05)


def take_four(bundles):
    """In the place of `Bundles.take`: bundles of four, whatever they take."""
    return tuple(bundles._waiting.popleft() for _ in range(min(4, len(bundles._waiting))))


def test_workers_stay_small(done):
    assert len(done.log.peak_memory) >= 1
    assert max(done.log.peak_memory.values()) < 400.0


def test_workers_import_neither_obspy_nor_matplotlib():
    code = (
        "import sys; import archfrag.study.worker, archfrag.simulate, distributed.nanny; "
        "print([n for n in ('obspy', 'matplotlib', 'xarray', 'netCDF4') if n in sys.modules])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]"


# What another user of the machine would do: ask whatever listens for code to be run.
ATTACK = """
import os, sys, distributed
from distributed import Client
import distributed.comm.tcp
if os.getuid() == 0:
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
for port in sys.argv[1:]:
    for scheme in ("tcp", "tls"):
        try:
            with Client(f"{scheme}://127.0.0.1:{port}", timeout=1, set_as_default=False) as client:
                print("user", os.getuid(), "ran code as", *client.run(os.getuid).values())
        except Exception as error:
            print("refused", type(error).__name__, file=sys.stderr)
print("tried as", os.getuid())
"""


def test_the_local_scheduler_runs_nobody_else_s_code(done):
    """As another user where this one may become one, as the superuser can; else as oneself."""
    with batch_module._client(done.study, 1) as client:
        assert list(client.run(os.getpid).values()) != []
        ports = {
            str(connection.laddr.port)
            for process in (psutil.Process(), *worker_processes())
            for connection in process.net_connections("tcp")
            if connection.status == psutil.CONN_LISTEN
        }
        scheduler = client.scheduler.address.rsplit(":", 1)[1]
        assert scheduler in ports
        found = subprocess.run(
            [sys.executable, "-c", ATTACK, scheduler], capture_output=True, text=True, cwd="/",
            timeout=60,
        )  # fmt: skip
        answers = [_asked_by_http(port) for port in ports]
    expected = 65534 if os.getuid() == 0 else os.getuid()
    assert found.stdout == f"tried as {expected}\n", found.stderr
    assert found.stderr.count("refused") == 2
    assert not any(b"200 OK" in answer for answer in answers)


def _asked_by_http(port):
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", int(port)), 2) as s:
        s.settimeout(2)
        s.sendall(b"GET /info/main/workers.html HTTP/1.0\r\n\r\n")
        return s.recv(1000)
    return b""


def test_finished_parts_are_kept_and_only_the_others_made(done, copied):
    kept, gone, torn = sorted(copied.plan.parts.glob("*.npy"))[:3]
    gone.unlink()
    torn.write_bytes(b"torn")
    os.utime(kept, (1, 1))
    log = run_batch(copied.study, workers=2, quiet=True)
    assert (log.runs, log.kept) == (12, 8)
    assert kept.stat().st_mtime == 1
    assert_same(Gathered(copied.plan).read(), Gathered(done.plan).read())


def test_nothing_to_do_starts_no_workers(copied, monkeypatch):
    monkeypatch.setattr(batch_module, "_client", None)
    log = run_batch(copied.study, quiet=True)
    assert (log.kept, log.workers) == (12, 0)


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        ({"name": "time_stepping"}, ["time_stepping"]),
        ({"name": "auto"}, ["auto"]),
        ({"name": "auto", "rtol": 1e-5}, ["event_driven"]),
    ],
)
def test_only_the_kernels_that_the_runs_need(done, method, expected):
    arches = tuple(entry for entry in done.study.arches if entry.build().n_voussoir > 2)
    study = done.study.model_copy(update={"arches": arches})
    methods = (Method(**method).model_dump(),)
    assert kernels_needed(study, replace(done.plan, methods=methods)) == expected


def slow(done, step):
    """The same study with steps so short that there is time to kill somebody."""
    for path in done.study.work.glob("parts/*/*.npy"):
        path.unlink()
    method = done.study.method.model_copy(update={"dt": step})
    return done.study.model_copy(update={"method": method})


def test_a_killed_worker_costs_nothing_but_time(copied):
    study = slow(copied, 1e-4)
    killer = Killer(study.work, every=False)
    killer.start()
    run_batch(study, workers=2, quiet=True)
    killer.join(10.0)
    assert killer.killed == 1
    plan = make_plan(study)
    disturbed = Gathered(plan).read()
    # In this process, where nobody is killed and no workers have to start.
    for path in plan.parts.glob("*.npy"):
        path.unlink()
    make_runs(plan)
    assert_same(Gathered(plan).read(), disturbed)


def test_workers_killed_again_and_again_end_the_batch(copied, monkeypatch):
    monkeypatch.setattr(batch_module, "PATIENCE", 4.0)
    study = slow(copied, 1e-5)
    killer = Killer(study.work, every=True)
    killer.start()
    try:
        with pytest.raises(WorkerError) as caught:
            run_batch(study, workers=2, quiet=True)
    finally:
        killer.stop.set()
    assert caught.value.exit_code == 5
    assert "killed" in str(caught.value)
    assert str(caught.value).endswith(
        "finished parts are kept, the same command with --resume goes on"
    )
    parts = list(make_plan(study).parts.glob("*.npy"))
    assert 1 <= len([path for path in parts if read_part(path) is not None]) < 6


def test_a_scheduler_that_does_not_answer(copied, monkeypatch):
    monkeypatch.setattr(batch_module, "ANSWER_WITHIN", 0.5)
    next(copied.plan.parts.glob("*.npy")).unlink()
    execution = copied.study.execution.model_copy(update={"scheduler": "tcp://127.0.0.1:1"})
    study = copied.study.model_copy(update={"execution": execution})
    with pytest.raises(
        WorkerError, match=r"execution.scheduler: tcp://127.0.0.1:1 cannot be used"
    ):
        run_batch(study, quiet=True)


def test_disk_full_in_a_worker_is_reported_and_keeps_the_finished_parts(copied):
    """A folder in the place of a part stands for any failing write in another process."""
    from archfrag.errors import OutputError

    blocked, *others = copied.study.work.glob("parts/*/*.npy")
    for path in (blocked, *others):
        path.unlink()
    blocked.mkdir()

    with pytest.raises(OutputError) as caught:
        run_batch(copied.study, workers=1, quiet=True)
    assert str(caught.value).startswith(f"{blocked}: cannot be written (")


@pytest.mark.parametrize("in_process", [None, 1e-9])
def test_workers_are_started_if_a_batch_takes_longer_and_change_no_part(
    copied, monkeypatch, in_process
):
    study = copied.study.model_copy(
        update={"execution": copied.study.execution.model_copy(update={"workers": None})}
    )
    monkeypatch.setattr(Bundles, "take", take_four)
    before = parts_of(copied.study.work)
    for path in copied.plan.parts.glob("*.npy"):
        path.unlink()
    if in_process is None:
        monkeypatch.setattr(batch_module, "_client", None)
    else:
        monkeypatch.setattr(batch_module, "IN_PROCESS", in_process)
    log = run_batch(study, workers=1, quiet=True)
    assert (log.runs, log.kept, log.workers) == (12, 0, 1)
    assert len(log.peak_memory) == (1 if in_process is None else 2)
    assert parts_of(copied.study.work) == before


LENGTHS, KINDS = [3.0] * 600, [0] * 300 + [1] * 300


def dealt(workers, wall, lengths=LENGTHS, rates=None):
    """Bundles as they are taken by workers that are done with each at once."""
    bundles = Bundles(lengths, KINDS, workers, {} if rates is None else rates)
    taken = []
    while bundle := bundles.take():
        taken.append(bundle)
        bundles.learn((chunk, wall(chunk)) for chunk in bundle)
    return taken


@pytest.mark.parametrize("workers", [1, 2, 40])
@pytest.mark.parametrize("wall", [1e-9, 1e-4, 0.01, 0.3, 100.0])
def test_each_chunk_is_dealt_out_once_in_order(workers, wall):
    taken = [chunk for bundle in dealt(workers, lambda chunk: wall) for chunk in bundle]
    assert taken == list(range(600))


def test_bundles_are_short_at_the_end():
    wall = [0.05 * len(bundle) for bundle in dealt(2, lambda chunk: 0.05)]
    assert max(wall) == pytest.approx(LONGEST)
    assert wall[-1] <= SHORTEST + 1e-9
    # None is longer than what the other worker has to do with what is left then.
    assert all(wall[i] <= sum(wall[i:]) / 2 + SHORTEST for i in range(len(wall)))
