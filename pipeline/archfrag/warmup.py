"""Compiling ahead of a run: on a second core, with a message that says how long it takes."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import llvmlite.binding
import numpy as np
from numba.core import config

from archfrag.arch import Arch
from archfrag.kernel_cache import use_kernel_cache
from archfrag.motions.motion import Motion
from archfrag.simulate import simulate, simulate_many
from archfrag.simulation.checks import check_method, method_names

# What the compilation of a method takes on two cores [s].
EXPECTED = 80.0
TICK = 1.0


def warmup(method: str | None = None, progress: Callable[[str], object] | None = None) -> float:
    """Compile the kernels, or load them from the cache, once for this machine; seconds it took.

    Two processes divide the work where there are two cores. `method` is that to compile for; all
    installed methods if not given. `progress` is called with a message such as "loading kernels"
    or "compiling kernels (first run only): 12 s of about 80 s", first at once, then about every
    second from another thread.
    """
    started, methods = time.perf_counter(), _methods_of(method)
    compiled = kernels_are_compiled(method) or bool(config.DISABLE_JIT)  # type: ignore[attr-defined]

    def report() -> None:
        passed, expected = time.perf_counter() - started, EXPECTED * len(methods)
        text = f"compiling kernels (first run only): {passed:.0f} s"
        text += f" of about {expected:.0f} s" if passed <= expected else ""
        if progress is not None:
            progress("loading kernels" if compiled else text)

    report()
    with contextlib.ExitStack() as meanwhile:
        if not compiled:
            meanwhile.enter_context(every(TICK, report))
            meanwhile.enter_context(_second_process(methods))
        _compile(methods)
    with contextlib.suppress(OSError):  # only the next message depends on stamps
        for stamp in () if compiled else _stamps(method):
            stamp.touch()
    return time.perf_counter() - started


def kernels_are_compiled(method: str | None = None) -> bool:
    """Whether `warmup` has only to load kernels; `method` as there."""
    stamps = _stamps(method)
    return bool(stamps) and all(stamp.is_file() for stamp in stamps)


def _methods_of(method: str | None) -> tuple[str, ...]:
    return method_names() if method is None else (check_method(method).name,)


def _stamps(method: str | None) -> list[Path]:
    """Files that a complete warm-up of each method leaves beside the kernels; none without cache.

    Machine code is for one kind of processor; a home folder may serve several.
    """
    folder, processor = use_kernel_cache(), llvmlite.binding.get_host_cpu_name()
    names = _methods_of(method)
    return [folder / f"compiled-{name}-{processor}" for name in names if folder is not None]


def _compile(methods: Sequence[str], second: bool = False) -> None:
    """Call the kernels of some methods; a second process begins with what the first needs late."""
    arch = Arch.circular(10.0, 1.5, 157.5, voussoirs=3, friction=0.7)
    motion, calls = Motion(np.zeros(3), dt=0.01), list[Callable[[], object]]()
    for method in methods:
        if check_method(method).load_many is not None:
            calls.append(partial(simulate_many, arch, motion, [1.0], method=method))
        # The kernels of events, which auto may need, are those of event_driven.
        calls.append(partial(simulate, arch, motion, method=method))
    for call in reversed(calls) if second else calls:
        call()


@contextlib.contextmanager
def every(seconds: float, call: Callable[[], object]) -> Iterator[None]:
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
def _second_process(methods: Sequence[str]) -> Iterator[None]:
    """A process that compiles what this one needs late; none on one core.

    It only fills the cache: what it does not do, or does not end, this process does.
    """
    cores = config.NUMBA_DEFAULT_NUM_THREADS  # type: ignore[attr-defined]
    places, process = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH")], None
    if cores > 1 and use_kernel_cache() is not None:
        with contextlib.suppress(OSError):
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "archfrag.warmup", *methods],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, places))},
                stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
    try:
        yield
    finally:
        if process is not None:
            process.kill()
            process.communicate()


def _end_with_parent() -> None:
    """End this process when the other end of its standard input is closed, by whatever end."""
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _compile(sys.argv[1:], second=True)
