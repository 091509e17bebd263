"""A part of a page made in a second process while this one makes another."""

import multiprocessing
import os
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

PATIENCE = 120.0  # with the second process, before its part is made here instead [s]


class Beside:
    """A call in a copy of this process where there is a core for it, or else in this one.

    Parameters
    ----------
    function : callable
    *arguments
        The copy has them as they are now; what `function` returns is sent back.
    """

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self._call = (function, arguments)
        self._process = None
        if _has_second_core():
            context = multiprocessing.get_context("fork")
            self._answer, sender = context.Pipe(duplex=False)
            self._process = context.Process(target=_send, args=(sender, *self._call), daemon=True)
            self._process.start()
            sender.close()

    def result(self) -> Any:
        """What the call returned; an exception in the copy is raised here by calling again."""
        function, arguments = self._call
        if self._process is not None:
            try:
                if self._answer.poll(PATIENCE):
                    return self._answer.recv()
            except EOFError:  # it ended without an answer
                pass
            finally:
                self._process.kill()
                self._process.join()
        return function(*arguments)


def _has_second_core() -> bool:
    # Elsewhere a copy of a process is not safe to go on, and a new one takes longer to start.
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1


def _send(sender: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    try:
        sender.send(function(*arguments))
        sender.close()
    finally:
        os._exit(0)  # nothing of the process that this is a copy of is to be ended twice
