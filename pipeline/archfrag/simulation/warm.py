"""Compiling ahead of a run: on a second core, with a message that says how long it takes."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding
from numba.core import config

from archfrag.kernel_cache import use_kernel_cache

# What the compilation of a method takes on two cores [s].
EXPECTED = 80.0
TICK = 1.0
_HELPER = """
import sys
from archfrag.simulate import compile_in_second_process
compile_in_second_process(sys.argv[1:])
"""


def _stamp(folder: Path, method: str) -> Path:
    # Machine code is for one kind of processor; a home folder may serve several.
    return folder / f"compiled-{method}-{llvmlite.binding.get_host_cpu_name()}"


def are_compiled(methods: Sequence[str]) -> bool:
    """Whether a complete warm-up of each method has been made with the kernels as they are."""
    folder = use_kernel_cache()
    return folder is not None and all(_stamp(folder, name).is_file() for name in methods)


@contextlib.contextmanager
def compiling(
    methods: Sequence[str], progress: Callable[[str], Any] | None = None
) -> Iterator[None]:
    """Around what compiles the kernels of some methods: help, messages, and a stamp at the end."""
    compiled = are_compiled(methods) or bool(config.DISABLE_JIT)  # type: ignore[attr-defined]
    started, expected = time.perf_counter(), EXPECTED * len(methods)

    def report() -> None:
        passed = time.perf_counter() - started
        text = f"compiling kernels, once: {passed:.0f} s of about {expected:.0f} s"
        if progress is not None:
            progress("loading kernels" if compiled else text)

    report()
    with contextlib.ExitStack() as stack:
        if not compiled:
            stack.enter_context(every(TICK, report))
            stack.enter_context(_helper(methods))
        yield
    folder = use_kernel_cache()
    if compiled or folder is None:
        return
    for name in methods:
        with contextlib.suppress(OSError):  # only the next message depends on it
            _stamp(folder, name).touch()


@contextlib.contextmanager
def every(seconds: float, call: Callable[[], Any]) -> Iterator[None]:
    """Call something again and again, from another thread, as long as the block lasts."""
    ended = threading.Event()

    def tick() -> None:
        while not ended.wait(seconds):
            call()

    ticker = threading.Thread(target=tick, daemon=True)
    ticker.start()
    try:
        yield
    finally:
        ended.set()
        ticker.join()


@contextlib.contextmanager
def _helper(methods: Sequence[str]) -> Iterator[None]:
    """A second process that compiles what the first needs late; none on one core.

    It only fills the cache: what it does not do, or does not end, the first process does.
    """
    cores = config.NUMBA_DEFAULT_NUM_THREADS  # type: ignore[attr-defined]
    if cores < 2 or use_kernel_cache() is None or not sys.executable:
        yield
        return
    package = str(Path(__file__).resolve().parents[2])
    found = [package, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    try:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", _HELPER, *methods],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(found)},
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    except OSError:
        yield
        return
    try:
        yield
    finally:
        process.kill()
        process.communicate()


def end_with_parent() -> None:
    """End this process when the other end of its standard input is closed, by whatever end."""

    def watch() -> None:
        sys.stdin.buffer.read()
        os._exit(0)

    threading.Thread(target=watch, daemon=True).start()
