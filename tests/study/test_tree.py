"""Processes of a run: stopped once, ended together, and the lock that states who held it."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time

import psutil
import pytest

from archfrag.errors import OutputError
from archfrag.study import tree
from archfrag.study.config import load_study
from archfrag.study.tree import only_run
from tests.study.small import small_study

# A process that ignores what asks it to end, with a child that does too.
STUBBORN = """
import os, signal, time
for number in (signal.SIGTERM, signal.SIGINT):
    signal.signal(number, signal.SIG_IGN)
if os.fork() and os.fork():
    print("ready", flush=True)
time.sleep(60)
"""


@pytest.fixture
def study(tmp_path):
    study = load_study(small_study(tmp_path))
    study.work.mkdir(parents=True)
    return study


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

        with pytest.raises(tree.Stopped, match="stopped by SIGTERM"), tree.stoppable():
            be_stopped_thrice()
        assert signal.getsignal(signal.SIGTERM) == before


def test_processes_that_will_not_end_are_ended(monkeypatch):
    monkeypatch.setattr(tree, "_PATIENCE", 0.3)
    leader = tree.start([sys.executable, "-c", STUBBORN], stdout=subprocess.PIPE, text=True)
    assert leader.stdout.readline() == "ready\n"
    children = psutil.Process(leader.pid).children(recursive=True)
    assert len(children) == 2
    started = time.monotonic()
    tree.end(leader)
    assert time.monotonic() - started < 3.0
    assert leader.returncode == -signal.SIGKILL
    assert not any(c.is_running() and c.status() != psutil.STATUS_ZOMBIE for c in children)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not end a child")
def test_a_process_ends_with_the_one_that_started_it():
    code = (
        "import os, signal, sys; from archfrag.study import tree; "
        "print(tree.start([sys.executable, '-c', 'import time; time.sleep(60)']).pid, flush=True);"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert found.returncode == -signal.SIGKILL
    with contextlib.suppress(psutil.NoSuchProcess):
        psutil.Process(int(found.stdout)).wait(5.0)


def test_a_process_that_ended_but_was_not_waited_for_is_gone():
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    started = psutil.Process(process.pid).create_time()
    assert tree.is_alive(process.pid, started)
    assert not tree.is_alive(process.pid, started - 60.0)
    process.kill()
    deadline = time.monotonic() + 5.0
    while tree.is_alive(process.pid, started):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.communicate()


class TestLock:
    def test_an_error_frees_it_and_a_stop_leaves_the_name(self, study):
        with pytest.raises(OutputError), only_run(study):
            raise OutputError("disk full")
        assert (study.work / "lock").read_bytes() == b""
        with pytest.raises(tree.Stopped), only_run(study):
            raise tree.Stopped(signal.SIGTERM)
        with only_run(study) as lock:
            assert lock.stopped == f"process {os.getpid()} on {socket.gethostname()}"

    @pytest.mark.parametrize("field", ["pid", "started"])
    def test_a_process_that_is_gone_or_of_another_boot_holds_nothing(self, study, field):
        holder = tree.identity() | {field: 4_000_000 if field == "pid" else 1.0e9}
        (study.work / "lock").write_text(json.dumps(holder))
        with only_run(study) as lock:
            assert lock.stopped == f"process {holder['pid']} on {holder['host']}"

    def test_where_the_system_has_no_locks_the_process_is_looked_for(self, study, monkeypatch):
        monkeypatch.setattr(tree, "_take", lambda file: None)
        (study.work / "lock").write_text(json.dumps(tree.identity()))
        with pytest.raises(OutputError, match="is at work here"), only_run(study):
            pass
        (study.work / "lock").write_text(json.dumps(tree.identity() | {"started": 1.0e9}))
        with only_run(study) as lock:
            assert lock.stopped

    def test_a_run_on_another_host_is_there_as_long_as_it_reports_so(self, study):
        path = study.work / "lock"
        path.write_text(json.dumps(tree.identity() | {"host": "elsewhere"}))
        with pytest.raises(OutputError, match=r"\(process \d+ on elsewhere\)"), only_run(study):
            pass
        for seconds in (1.0e5, -100.0):  # a date to come is of a clock that is wrong
            path.write_text(json.dumps(tree.identity() | {"host": "elsewhere"}))
            os.utime(path, (time.time() + seconds,) * 2)
            with only_run(study) as lock:
                assert lock.stopped.endswith("on elsewhere")
        path.write_text(json.dumps(tree.identity() | {"host": "elsewhere"}))
        os.utime(path, (time.time() - 100.0,) * 2)
        with only_run(study) as lock:
            assert lock.stopped.endswith("on elsewhere")
            os.utime(path, (1.0, 1.0))
            lock.beat()
            assert path.stat().st_mtime > 1.0e9
