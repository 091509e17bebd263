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
import numpy as np
from numba.core import config

from archfrag.arch import Arch
from archfrag.kernel_cache import use_kernel_cache
from archfrag.motions.motion import Motion
from archfrag.simulate import check_stands, onset, simulate, simulate_many
from archfrag.simulation.checks import check_method, method_names

# What the compilation of a method takes on two cores [s].
EXPECTED = 80.0
TICK = 1.0
_HELPER = """
import sys
from archfrag.warmup import compile_in_second_process
compile_in_second_process(sys.argv[1:])
"""


def warmup(method: str | None = None, progress: Callable[[str], object] | None = None) -> float:
    """Compile the kernels, or load them from the cache, once for this machine; seconds it took.

    Two processes divide the work where there are two cores.

    Parameters
    ----------
    method : str, optional
        Method to compile for; all installed methods if not given. `InputError` if there is none.
    progress : callable, optional
        Called with a message such as "loading kernels" or "compiling kernels, once: 12 s of
        about 80 s", first at once, then about every second from another thread.

    Examples
    --------
    >>> from archfrag.warmup import kernels_are_compiled, warmup
    >>> warmup("time_stepping") > 0.0
    True
    >>> kernels_are_compiled("time_stepping")
    True
    """
    started = time.perf_counter()
    names, arch = _methods_of(method), _smallest_arch()
    with compiling(names, progress):
        for name in names:
            _move_once(name)
        check_stands(arch)
        onset(arch)
    return time.perf_counter() - started


def kernels_are_compiled(method: str | None = None) -> bool:
    """Whether `warmup` has only to load kernels; `method` as there."""
    stamps = _stamps(_methods_of(method))
    return bool(stamps) and all(stamp.is_file() for stamp in stamps)


def compile_in_second_process(methods: Sequence[str]) -> None:
    """What the second process of a warm-up compiles: what the first, in its order, needs late."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    check_stands(_smallest_arch())
    if len(methods) == 1:
        # One run alone, while the other process makes the kernels of four.
        simulate(_smallest_arch(), Motion(np.zeros(3), dt=0.01), method="time_stepping")
        methods = []
    for name in reversed(methods):
        _move_once(name)
    onset(_smallest_arch())


def _end_with_parent() -> None:
    """End this process when the other end of its standard input is closed, by whatever end."""
    sys.stdin.buffer.read()
    os._exit(0)


def _methods_of(method: str | None) -> tuple[str, ...]:
    return method_names() if method is None else (check_method(method).name,)


def _smallest_arch() -> Arch:
    return Arch.circular(10.0, 1.5, 157.5, voussoirs=3, friction=0.7)


def _move_once(method: str) -> None:
    arch, motion = _smallest_arch(), Motion(np.zeros(3), dt=0.01)
    if check_method(method).load_many is not None:
        # The kernels of events, which auto may need, are those of event_driven.
        simulate_many(arch, motion, [1.0], method=method)
        simulate(arch, motion, method=method)
        return
    # With an initial state the kernels that see whether an arch stands are not needed first.
    at_rest = np.zeros((arch.n_voussoir, 3))
    simulate(arch, motion, method=method, initial=(at_rest, at_rest))


def _stamps(methods: Sequence[str]) -> list[Path]:
    """Files that a complete warm-up of each method leaves beside the kernels; none without cache.

    Machine code is for one kind of processor; a home folder may serve several.
    """
    folder, processor = use_kernel_cache(), llvmlite.binding.get_host_cpu_name()
    return [folder / f"compiled-{name}-{processor}" for name in methods if folder is not None]


@contextlib.contextmanager
def compiling(
    methods: Sequence[str], progress: Callable[[str], Any] | None = None
) -> Iterator[None]:
    """Around what compiles the kernels of some methods: help, messages, and a stamp at the end."""
    stamps, started = _stamps(methods), time.perf_counter()
    compiled = bool(stamps) and all(stamp.is_file() for stamp in stamps)
    compiled |= bool(config.DISABLE_JIT)  # type: ignore[attr-defined]

    def report() -> None:
        passed, expected = time.perf_counter() - started, EXPECTED * len(methods)
        text = f"compiling kernels, once: {passed:.0f} s of about {expected:.0f} s"
        if progress is not None:
            progress("loading kernels" if compiled else text)

    report()
    if compiled:
        yield
        return
    with every(TICK, report), _helper(methods):
        yield
    for stamp in stamps:
        with contextlib.suppress(OSError):  # only the next message depends on it
            stamp.touch()


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
    package = str(Path(__file__).resolve().parents[1])
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
