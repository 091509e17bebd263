"""Tasks with time limits that are not done twice, and the command's refusals."""

import math
import os
import subprocess
import sys
import time
from contextlib import suppress

import psutil
import pytest

from archbench import runner
from archbench.page import gather
from archbench.runner import Bench, in_processes
from archfrag.errors import InputError


def task(seconds, path=None):
    """Start a process and sleep; or end at once where there is no time."""
    if seconds < 0:
        os._exit(3)
    if path:
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        path.write_text(str(child.pid))
    time.sleep(seconds)
    return seconds


def test_what_takes_too_long_is_ended_with_its_processes_and_all_else_is_done(tmp_path):
    child = tmp_path / "pid"
    tasks = {
        ("short",): (0.2,),
        ("long",): (600.0, child),
        ("dies",): (-1.0,),
        ("last",): (0.1,),
    }
    found = dict(in_processes(task, tasks, 2, 4.0, compiled=False))
    assert found == {
        ("short",): 0.2,
        ("long",): "not ended within 4 s",
        ("dies",): "its process ended by itself",
        ("last",): 0.1,
    }
    with suppress(psutil.NoSuchProcess):
        psutil.Process(int(child.read_text())).wait(20.0)


def test_finished_tasks_are_not_done_again_and_a_cut_line_is(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "sources", lambda: "one")
    asked = []

    def pretend(function, tasks, *_):
        asked.append([name for name, _ in tasks])
        return [(key, function(*task)) for key, task in tasks.items()]

    monkeypatch.setattr(runner, "in_processes", pretend)
    bench = Bench(tmp_path, report=lambda _: None)
    tasks = {("a", 1): (3, 4), ("b", 2): (6, 8)}
    assert bench.run("sums", math.hypot, tasks, 1.0) == {("a", 1): 5.0, ("b", 2): 10.0}
    file = tmp_path / "finished" / "sums-one.jsonl"
    file.write_text(file.read_text().splitlines()[0] + '\n[["b", 2], 7.8\n')
    bench.run("sums", math.hypot, tasks, 1.0)
    monkeypatch.setattr(runner, "sources", lambda: "other")
    bench.run("sums", math.hypot, tasks, 1.0)
    assert asked == [["a", "b"], ["b"], ["a", "b"]]


def test_an_unknown_name_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(
        InputError, match="no part 'sped'; allowed are speed, fragility"
    ):
        gather(["sped"], tmp_path / "out")
    with pytest.raises(InputError, match="'mujuco'; allowed are all, mujoco"):
        gather([], tmp_path / "out", solvers=["mujuco"])
    assert not (tmp_path / "out").exists()
