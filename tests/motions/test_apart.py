"""A function in another process: its answers, its limits and its end."""

import os
import subprocess
import sys
import time

import psutil
import pytest

from archfrag.motions.formats import apart
from archfrag.motions.formats.apart import Limited, LimitedError

WORKER = """
import ctypes, os, sys, time
def answer(request):
    match request:
        case "crash":
            os._exit(3)
        case "compute":
            while True:
                pass
        case "sleep":
            open(os.environ["READY"], "w").close()
            time.sleep(60.0)
        case "memory":
            kept = []
            while True:
                kept.append(bytearray(2**22))
        case "error":
            raise ValueError("refused")
        case "print":
            os.write(1, b"noise")
    return request
"""


@pytest.fixture
def worker(tmp_path, monkeypatch):
    (tmp_path / "worker_of_test.py").write_text(WORKER, encoding="utf-8")
    places = filter(None, (str(tmp_path), os.environ.get("PYTHONPATH")))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(places))
    monkeypatch.setenv("READY", str(tmp_path / "ready"))
    made = Limited("worker_of_test:answer", 2.0, 50 * 2**20)
    yield made
    made.close()


def test_a_limited_process_answers_one_request_after_another(worker):
    for request in ("print", 2, ["x"]):
        assert worker.ask(request) == request
    with pytest.raises(ValueError, match="refused"):
        worker.ask("error")
    assert worker.ask(3) == 3


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        ("crash", "it ended in a crash"),
        ("compute", "more than 2 s of computing"),
        ("memory", "more than 50 MiB"),
    ],
)
def test_what_ends_a_limited_process_is_told_and_the_next_one_answers(
    worker, request_, why
):
    with pytest.raises(LimitedError, match=why):
        worker.ask(request_)
    assert worker.ask("again") == "again"


def test_a_limited_process_ends_with_the_one_that_started_it(worker, tmp_path):
    code = (
        "from archfrag.motions.formats.apart import Limited\n"
        "Limited('worker_of_test:answer', 60, 1e9).ask('sleep')"
    )
    first = subprocess.Popen([sys.executable, "-c", code])
    while not (tmp_path / "ready").exists():
        assert first.poll() is None
        time.sleep(0.1)
    (helper,) = psutil.Process(first.pid).children()
    first.kill()
    first.wait()
    assert psutil.wait_procs([helper], timeout=5.0)[1] == []


def test_an_answer_that_was_not_waited_for_is_not_the_next_one(worker, monkeypatch):
    """Ctrl-C in a notebook comes between a request and its answer."""
    worker.ask("first")
    receive = apart._received

    def interrupted(process):
        raise KeyboardInterrupt

    monkeypatch.setattr(apart, "_received", interrupted)
    with pytest.raises(KeyboardInterrupt):
        worker.ask("second")
    monkeypatch.setattr(apart, "_received", receive)
    assert worker.ask("third") == "third"


def test_a_process_that_was_killed_while_it_waited_is_no_fault_of_the_next_request(
    worker,
):
    worker.ask("first")
    worker._process.kill()
    worker._process.wait()
    assert worker.ask("second") == "second"


@pytest.mark.posix
def test_a_fork_has_a_process_of_its_own_and_leaves_that_of_its_parent(worker):
    """As in a pool of `multiprocessing` by fork: both would read the same answers."""
    worker.ask("first")
    before = worker._process.pid
    child = os.fork()
    if child == 0:
        good = worker.ask("child") == "child" and worker._process.pid != before
        worker.close()
        os._exit(0 if good else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert worker.ask("parent") == "parent"
    assert worker._process.pid == before
