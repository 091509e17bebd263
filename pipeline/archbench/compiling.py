"""What compiling costs: each method's kernels once from nothing, and loaded from the cache."""

import os
import resource
import subprocess
import sys
import tempfile
import time

import pandas as pd

from archbench.runner import Bench, Row
from archfrag.simulation.checks import available_methods

LIMIT = 900.0
QUICK = ("auto",)


def compile_method(method: str) -> Row:
    """Seconds by the clock and of all processors, of an empty cache and of a full one."""
    program = f"import archbench, archfrag.warmup as w; w.warmup({method!r})"
    row: Row = {"method": method}
    with tempfile.TemporaryDirectory() as cache:
        for state in ("empty", "full"):
            before, began = _processor_time(), time.perf_counter()
            subprocess.run(
                [sys.executable, "-c", program], check=True, capture_output=True,
                env={**os.environ, "NUMBA_CACHE_DIR": cache},
            )  # fmt: skip
            row[f"{state}_seconds"] = time.perf_counter() - began
            row[f"{state}_cpu_seconds"] = _processor_time() - before
    return row


def _processor_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Every method that can run here, one after the other."""
    tasks = {(name,): (name,) for name in (QUICK if bench.quick else sorted(available_methods()))}
    alone = bench.run("compiling", compile_method, tasks, LIMIT, workers=1)
    return {
        "methods": pd.DataFrame([each for each in alone.values() if not isinstance(each, str)])
    }
