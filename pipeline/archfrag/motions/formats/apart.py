"""Functions called in another process, which may end without harm to this one."""

import atexit
import contextlib
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from archfrag.system import every, psutil, start_python

CHECKED = 0.05  # between two looks at what the process uses [s]
CHILD = f"from {__name__} import answer_requests; answer_requests()"


class LimitedError(Exception):
    """A limited process has ended before it answered; the message says why."""


class Limited:
    """Another process of this Python that answers requests by a function, within limits.

    `function` is "module:name". The process starts with the first request. It is limited to
    `seconds` of processor time and `memory` bytes more for each.
    """

    def __init__(self, function: str, seconds: float, memory: float) -> None:
        self.function = function
        self.seconds = seconds
        self.memory = memory
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0  # number of the process that started it
        self._one_at_a_time = threading.Lock()

    def ask(self, request) -> Any:
        """Return the answer to a request; LimitedError if the process ends before it answers."""
        with self._one_at_a_time:
            ended = [""]
            try:
                process = self._running()
                with every(CHECKED, self._check(process, ended)):
                    _send(process, request)
                    answer = _received(process)
            except (EOFError, OSError, pickle.UnpicklingError):
                self.close()
                raise LimitedError(ended[0] or "it ended in a crash") from None
            except BaseException:  # Ctrl-C: the next request must not get this answer
                self.close()
                raise
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _running(self) -> "subprocess.Popen[bytes]":
        """Return the process, started if there is none of this process that lives."""
        if self._process is not None and self._owner == os.getpid():
            if self._process.poll() is None:
                return self._process
            self.close()
        self._owner = os.getpid()
        self._process = start_python("-c", CHILD, self.function, stdout=subprocess.PIPE)
        atexit.register(self.close)
        _received(self._process)  # once it is ready
        return self._process

    def _check(
        self, process: "subprocess.Popen[bytes]", ended: list[str]
    ) -> Callable[[], None]:
        """Return a function that ends the process beyond a limit, and tells `ended` why."""
        begun = _used(process)

        def check() -> None:
            seconds, memory = np.subtract(_used(process), begun)
            if seconds > self.seconds:
                ended[0] = f"it took more than {self.seconds:g} s of computing"
            elif memory > self.memory:
                ended[0] = f"it took more than {self.memory / 2**20:.0f} MiB"
            if ended[0]:
                process.kill()

        return check

    def close(self) -> None:
        """End the process, if it was started by this process and not by its parent."""
        atexit.unregister(self.close)
        process, self._process = self._process, None
        if process is not None and self._owner == os.getpid():
            process.kill()
            process.communicate()


def _send(process: "subprocess.Popen[bytes]", request) -> None:
    assert process.stdin is not None
    pickle.dump(request, process.stdin)
    process.stdin.flush()


def _received(process: "subprocess.Popen[bytes]") -> Any:
    assert process.stdout is not None
    return pickle.load(process.stdout)


def _used(process: "subprocess.Popen[bytes]") -> tuple[float, float]:
    """Return processor time [s] and memory [bytes] of a process; 0 if it has ended."""
    with contextlib.suppress(psutil.Error):
        found = psutil.Process(process.pid)
        return sum(found.cpu_times()[:2]), float(found.memory_info().rss)
    return 0.0, 0.0


def answer_requests() -> None:
    """Answer the requests to this process of `Limited` until its parent ends.

    The function that answers is named on the command line. The parent raises an error that is
    answered. It does not get what code in C prints.
    """
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nothing, stream)
    module, _, name = sys.argv[1].partition(":")
    answer: Callable[[Any], Any] = getattr(import_module(module), name)
    todo = queue.SimpleQueue[Any]()

    def receive() -> None:
        with contextlib.suppress(EOFError):
            while True:
                todo.put(pickle.load(requests))
        os._exit(0)

    threading.Thread(target=receive, daemon=True).start()
    answered: Any = "ready"
    while True:
        pickle.dump(answered, answers)
        answers.flush()
        try:
            answered = answer(todo.get())
        except Exception as error:
            answered = error
