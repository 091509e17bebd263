"""Compiling ahead, in two processes, and never again."""

import contextlib
import json
import os
import subprocess
import sys
import time

import psutil
import pytest

from archfrag import warmup as warm

COUNT = """
import contextlib
import json
from numba.core import event
compiled, messages = [], []
class Listener(event.Listener):
    def on_start(self, e):
        compiled.append(e.data["dispatcher"].py_func.__qualname__)
    def on_end(self, e):
        pass
event.register("numba:compile", Listener())
from archfrag.warmup import warmup
warmup("auto", messages.append)
print(json.dumps([compiled, messages]))
"""


def test_a_second_process_compiles_nothing():
    warm.warmup("auto")
    assert warm.kernels_are_compiled("auto")
    printed = subprocess.check_output([sys.executable, "-c", COUNT])
    assert json.loads(printed) == [[], ["loading kernels"]]


def test_messages_compiling_then_loading(tmp_path, monkeypatch):
    """In a cache in which nothing is compiled yet, without a second process."""
    monkeypatch.setattr(warm, "use_kernel_cache", lambda: tmp_path)
    monkeypatch.setattr(warm, "TICK", 0.02)
    monkeypatch.setattr(warm, "_second_process", lambda methods: contextlib.nullcontext())
    monkeypatch.setattr(warm, "EXPECTED", 0.1)
    monkeypatch.setattr(warm, "_compile", lambda methods: time.sleep(0.3))
    messages = []
    for _ in range(2):
        warm.warmup("auto", messages.append)
    assert messages[0] == "compiling kernels (first run only): 0 s of about 0 s"
    assert messages[-2] == "compiling kernels (first run only): 0 s"  # longer than expected
    assert messages[-1] == "loading kernels"
    assert warm.kernels_are_compiled("auto")
    assert not warm.kernels_are_compiled("event_driven")


@pytest.mark.skipif(warm.config.NUMBA_DEFAULT_NUM_THREADS < 2, reason="only with two cores")
def test_a_second_process_ends_with_a_first_one_that_is_killed(tmp_path):
    first = subprocess.Popen(
        [sys.executable, "-c", "from archfrag.warmup import warmup; warmup('auto')"],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
    )
    try:
        helpers = []
        until = time.monotonic() + 60.0
        while not list(tmp_path.rglob("*.lock")) or not helpers:
            assert time.monotonic() < until
            helpers = psutil.Process(first.pid).children()
            time.sleep(0.05)
    finally:
        first.kill()
        first.wait()
    _, alive = psutil.wait_procs(helpers, timeout=20.0)
    assert not alive
