"""Compiling ahead: in two processes, each kernel once, and never again."""

import collections
import json
import os
import subprocess
import sys
import time

import psutil
import pytest

from archfrag.errors import InputError
from archfrag.simulate import expected_compile_time, kernels_are_compiled, warmup

# Kernels of which `auto` needs more than one version for the calls of other kernels, with the
# number and the argument that differs.
SEVERAL = {}
WARM = """
import collections, json, sys
from numba.core import event
from numba.core.dispatcher import Dispatcher
compiled = []
class Listener(event.Listener):
    def on_start(self, e):
        compiled.append(e.data["dispatcher"].py_func.__qualname__)
    def on_end(self, e):
        pass
event.register("numba:compile", Listener())
from archfrag.simulate import warmup
said = []
warmup(sys.argv[1], said.append)
from archfrag.mechanics.compile import use_kernel_cache
print(json.dumps([compiled, said, str(use_kernel_cache())]))
"""


@pytest.fixture(scope="module")
def warm():
    warmup("auto")
    done = subprocess.run(
        [sys.executable, "-c", WARM, "auto"], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


class TestOnce:
    def test_a_second_process_compiles_nothing(self, warm):
        compiled, said, _ = warm
        assert compiled == []
        assert said == ["loading kernels"]
        assert kernels_are_compiled("auto")
        assert expected_compile_time("auto") > 1.0
