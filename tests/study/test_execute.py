"""Batches on threads: the same results whatever their number, and signals survived."""

import errno
import io
import os
import re
import signal
import subprocess
import sys
import threading
import time

import dask.threaded
import numpy as np
import pandas as pd
import psutil
import pytest

from archfrag.errors import InputError, OutputError
from archfrag.motions import formats
from archfrag.motions.formats import read_apart
from archfrag.simulation.simulate import simulate
from archfrag.study.designs import Ida
from archfrag.study.file.schema import Method
from archfrag.study.runs import execute, workers
from archfrag.study.runs.execute import method_to_compile, run_batch
from archfrag.study.runs.store import Plan, gather, make_plan, read_part
from archfrag.study.steps import only_run
from archfrag.system import stoppable
from tests.study.small import ROOT, changed


def assert_same(results, expected):
    np.testing.assert_array_equal(results[0], expected[0])
    for name in set(results[1].dtype.names) - {"wall_time"}:
        np.testing.assert_array_equal(results[1][name], expected[1][name])


def cleared(study):
    """The same study without parts."""
    for path in study.work.glob("parts/*/*.npy"):
        path.unlink()
    return study


def test_a_worker_loads_nothing_that_is_heavy():
    code = "import archfrag.study.runs.workers, archfrag.simulation.simulate as _, sys"
    code += "; print(*sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    heavy = {"obspy", "matplotlib", "xarray", "netCDF4", "dask", "distributed"}
    assert not heavy & set(found.stdout.split()), found.stderr
    assert "archfrag.simulation.simulate" in found.stdout


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
    monkeypatch.setattr(
        "archfrag.study.runs.execute.kernels_are_compiled", lambda: False
    )
    monkeypatch.setattr("archfrag.study.runs.execute.warmup", warmup)
    monkeypatch.setattr(Ida, "size", lambda self, *shape: (estimate, "about"))
    monkeypatch.setattr(sys, "stderr", Terminal())
    study = copied.study.model_copy(update={"design": Ida(kind="ida")})
    log, _ = run_batch(study, workers=1)
    frames = sys.stderr.getvalue().replace("\r", "\n").splitlines()
    assert any(frame.startswith("compiling kernels: 5 s") for frame in frames)
    ready = re.compile("archfrag: kernels: (compiled|machine code made) in 5.0 s")
    assert any(map(ready.search, frames))
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
        (done.study.method, "time_stepping"),
        (Method(name="auto"), "auto"),
        (fine, "event_driven"),
    ):
        changes = {"arches": arches, "method": method}
        assert (
            method_to_compile(make_plan(done.study.model_copy(update=changes)))
            == expected
        )


@pytest.mark.parametrize("design", ["stripes", "ida"])
def test_threads_and_chunks_change_no_bit_and_start_no_process(
    copied, monkeypatch, design
):
    study = copied.study
    if design == "ida":
        study = study.model_copy(update={"design": Ida(kind="ida", checks=1)})
    graphs = []
    get = dask.threaded.get
    monkeypatch.setattr(
        "dask.threaded.get",
        lambda graph, *a, **k: [graphs.append(graph), get(graph, *a, **k)],
    )
    before = set(psutil.Process().children(recursive=True))
    found = []
    for threads, chunk in ((1, None), (2, 1), (16, 3)):
        changes = {"chunk": chunk, "workers": threads}
        log, table = run_batch(
            changed(cleared(study), "execution", **changes), quiet=True
        )
        assert (log["kept"], log["workers"]) == (0, threads)
        found.append(
            (*gather(copied.plan if design == "stripes" else make_plan(study)), table)
        )
    for each in found[1:]:
        assert_same(each, found[0])
        pd.testing.assert_frame_equal(
            each[3].drop(columns="wall_time"), found[0][3].drop(columns="wall_time")
        )
    assert set(psutil.Process().children(recursive=True)) <= before
    assert [len(graph) for graph in graphs] == [1, 2, 16]
    plan = make_plan(study)
    cases, rows = found[0][:2]
    for case, row in zip(cases, rows):
        motion = plan.motion(plan.records[case["record"]])
        given = study.method.model_dump(exclude={"name"})
        alone = simulate(
            plan.arch(case["arch"]),
            motion,
            plan.factors(cases[cases == case])[0],
            study.method.name,
            **given,
        )
        assert (alone.steps, alone.end_time) == (row["steps"], row["end_time"])
    parts = [len(read_part(path)) for path in make_plan(study).parts.glob("*.npy")]
    assert sum(parts) == len(found[0][0])
    assert max(parts) <= 3


def test_what_two_arches_have_in_common_is_made_once(copied):
    one = copied.study.arches[0]
    twins = [one, one.model_copy(update={"id": "twin"})]
    for design in (copied.study.design, Ida(kind="ida", checks=0)):
        study = cleared(
            copied.study.model_copy(update={"arches": twins, "design": design})
        )
        log, table = run_batch(study, workers=3, quiet=True)
        stored = [len(read_part(path)) for path in make_plan(study).parts.glob("*.npy")]
        assert (log["runs"], log["kept"], sum(stored)) == (
            len(table),
            0,
            len(table) / 2,
        )
        own = [table[table["arch"] == each.id]["steps"].tolist() for each in twins]
        assert own[0] == own[1]


def test_an_error_of_a_run_ends_the_batch_at_once(copied, monkeypatch):
    def fail(*_, **__):
        raise InputError("this arch has no key stone")

    monkeypatch.setattr(workers.Stream, "go_on", fail)
    for threads in (1, 4):
        with pytest.raises(InputError, match="this arch has no key stone"):
            run_batch(cleared(copied.study), workers=threads, quiet=True)


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_among_runs_that_share_lanes_ends_all_threads(
    copied, monkeypatch, threads
):
    begun = set(threading.enumerate())
    known = Plan.ground

    def ground(self, arch, record, factor):
        if arch == 1 and record == 1:
            raise InputError("this record is gone")
        return known(self, arch, record, factor)

    monkeypatch.setattr(Plan, "ground", ground)
    with pytest.raises(InputError, match="this record is gone"):
        run_batch(
            changed(cleared(copied.study), "execution", chunk=2, workers=threads),
            quiet=True,
        )
    until = time.monotonic() + 20.0
    while set(threading.enumerate()) - begun and time.monotonic() < until:
        time.sleep(0.05)
    assert not set(threading.enumerate()) - begun


def test_ctrl_c_in_python_returns_at_once_and_ends_no_process(copied, monkeypatch):
    """A thread that waits stands for a kernel."""
    begun = threading.Event()
    end = threading.Event()

    def wait(*_, **__):
        begun.set()
        end.wait(20.0)
        raise InputError("too late")

    def interrupt():
        begun.wait(20.0)
        os.kill(os.getpid(), signal.SIGINT)

    # Processes that a shell starts in the background ignore it.
    monkeypatch.setattr(workers.Stream, "go_on", wait)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    presser = threading.Thread(target=interrupt)
    presser.start()
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        run_batch(cleared(copied.study), workers=2, quiet=True)
    assert time.monotonic() - started < 10.0
    assert not end.is_set()
    end.set()
    presser.join()
    signal.signal(signal.SIGINT, before)


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
            "import hashlib; from archfrag import system; system.GRACE = 0.5\n"
            "with system.stoppable():\n"
            "    print('ready', flush=True)\n"
            "    hashlib.pbkdf2_hmac('sha256', b'a', b'b', 2**31 - 1)\n"
        )
        process = subprocess.Popen(
            [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
        )
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)  # until the hash has begun
        process.send_signal(signal.SIGTERM)
        assert process.wait(5.0) == 128 + signal.SIGTERM
        process.communicate()


def test_a_file_system_that_grants_no_locks_does_without(copied, monkeypatch):
    def none(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", none)
    with only_run(copied.study), only_run(copied.study):
        pass


@pytest.mark.filterwarnings("ignore:flock not supported")
def test_a_file_system_without_locks_has_one_run_at_a_time_too(copied, monkeypatch):
    def none(*_):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr("fcntl.flock", none)
    with (
        only_run(copied.study),
        pytest.raises(OutputError, match="another run of study"),
        only_run(copied.study),
    ):
        pass
    with only_run(copied.study):
        pass


def test_one_process_reads_all_records_and_does_not_hold_the_lock(copied):
    path = next((ROOT / "records" / "synthetic").glob("*.mseed"))
    formats.READER.close()
    before = set(psutil.Process().children())
    with only_run(copied.study):
        read_apart(str(path))
        (reader,) = set(psutil.Process().children()) - before
        read_apart(str(path))
        assert set(psutil.Process().children()) - before == {reader}
        assert str(copied.study.work / "lock") not in [
            file.path for file in reader.open_files()
        ]
    formats.READER.close()
    assert not reader.is_running()
