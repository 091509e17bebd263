"""Compiling ahead: each kernel once, in two processes, and never again."""

import collections
import contextlib
import json
import os
import subprocess
import sys
import time

import psutil
import pytest

from archfrag import warmup as warm
from archfrag.warmup import kernels_are_compiled, warmup

COUNT = """
import json, sys
from numba.core import event
compiled = []
class Listener(event.Listener):
    def on_start(self, e):
        compiled.append(e.data["dispatcher"].py_func.__qualname__)
    def on_end(self, e):
        pass
event.register("numba:compile", Listener())
from archfrag.warmup import warmup
from archfrag.mechanics.compile import read_version
from archfrag.kernel_cache import use_kernel_cache
messages = []
warmup("auto", messages.append)
from archfrag.mechanics import onset
from archfrag.methods.time_stepping import run
tops = (run.run_four, onset.rest_limit)
waiting = [name for top in tops for sig in top.overloads
           for name in read_version(top._cache.path(sig, top.targetctx))[2]]
versions = {}
while waiting:
    name = waiting.pop()
    if name not in versions:
        where, sig, called, _ = read_version(use_kernel_cache() / name)
        kind = " of four" if "Lanes" in str(sig) else ""
        kernel = name.split(".")[1].rsplit("-", 1)[0]
        versions[name] = where.split(":")[0] + ":" + kernel + kind
        waiting += called
print(json.dumps([compiled, messages, sorted(versions.values())]))
"""


def python(code, **environment):
    command, env = [sys.executable, "-c", code], {**os.environ, **environment}
    return subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout


def test_a_second_process_compiles_nothing_and_each_kernel_is_in_one_version():
    warmup("auto")
    assert kernels_are_compiled("auto")
    compiled, messages, versions = json.loads(python(COUNT))
    assert compiled == []
    assert messages == ["loading kernels"]
    count = collections.Counter(versions)
    assert len(count) > 80
    assert {kernel: n for kernel, n in count.items() if n > 1} == {}


def test_messages_compiling_then_loading(tmp_path, monkeypatch):
    """With a cache in which nothing is compiled yet."""
    monkeypatch.setattr(warm, "use_kernel_cache", lambda: tmp_path)
    monkeypatch.setattr(warm, "TICK", 0.02)
    monkeypatch.setattr(warm, "_second_process", lambda methods: contextlib.nullcontext())
    monkeypatch.setattr(warm, "_compile", lambda methods: time.sleep(0.3))
    messages = []
    warmup("auto", messages.append)
    assert len(messages) > 3
    assert set(messages) == {"compiling kernels, once: 0 s of about 80 s"}
    assert kernels_are_compiled("auto")
    assert not kernels_are_compiled("event_driven")
    messages.clear()
    warmup("auto", messages.append)
    assert messages == ["loading kernels"]


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
