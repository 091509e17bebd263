"""Runs that may never end: in processes of their own, ended when their time is up."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any


@dataclass
class _Worker:
    process: BaseProcess
    pipe: Connection
    task: int | None = None
    due: float = float("inf")


def in_watched_processes(
    function: Callable[..., Any],
    tasks: Iterable[tuple[Any, ...]],
    workers: int,
    limit: float,
    prepare: Callable[[], Any] | None = None,
) -> list[Any]:
    """Results of ``function(*task)`` in the order of tasks; None for those that took too long.

    Parameters
    ----------
    function : callable
        At the top level of a module; raises nothing.
    tasks : iterable of tuple
    workers : int
        Processes.
    limit : float
        Longest time for one task [s]; the process is then ended and another takes its place.
    prepare : callable, optional
        Called in each process before its first task, outside the limit: to load kernels.

    Raises
    ------
    RuntimeError
        If a process ends by itself: a task that raised, or a crash.

    Examples
    --------
    >>> from archfrag.evidence.stability.watch import in_watched_processes
    >>> in_watched_processes(divmod, [(7, 2), (9, 4)], workers=1, limit=60.0)
    [(3, 1), (2, 1)]
    """
    tasks = list(tasks)
    results: list[Any] = [None] * len(tasks)
    waiting = list(range(len(tasks)))[::-1]
    staff = [_start(function, prepare) for _ in range(min(workers, len(tasks)))]
    try:
        left = len(tasks)
        while left:
            nearest = min(worker.due for worker in staff)
            span = None if nearest == float("inf") else max(0.0, nearest - time.monotonic())
            ready = wait([worker.pipe for worker in staff], span)
            for k, worker in enumerate(staff):
                if worker.pipe in ready:
                    left -= _take(worker, results)
                elif time.monotonic() >= worker.due:
                    left -= 1
                    _end(worker)
                    staff[k] = worker = _start(function, prepare)
                    continue
                else:
                    continue
                if waiting:
                    worker.task = waiting.pop()
                    worker.due = time.monotonic() + limit
                    worker.pipe.send(tasks[worker.task])
    finally:
        for worker in staff:
            _end(worker)
    return results


def _take(worker: _Worker, results: list[Any]) -> int:
    """What a worker says: that it is ready (0 tasks done), or a result (1)."""
    try:
        answer = worker.pipe.recv()
    except EOFError:
        raise RuntimeError(f"the process of task {worker.task} ended by itself") from None
    done = worker.task is not None
    if worker.task is not None:
        results[worker.task] = answer
    worker.task, worker.due = None, float("inf")
    return int(done)


def _start(function: Callable[..., Any], prepare: Callable[[], Any] | None) -> _Worker:
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, function, prepare), daemon=True)
    process.start()
    theirs.close()
    return _Worker(process, ours)


def _end(worker: _Worker) -> None:
    worker.pipe.close()
    worker.process.kill()
    worker.process.join()


def _serve(
    pipe: Connection, function: Callable[..., Any], prepare: Callable[[], Any] | None
) -> None:
    if prepare is not None:
        prepare()
    pipe.send(None)
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        pipe.send(function(*task))
