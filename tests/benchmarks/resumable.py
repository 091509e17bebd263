"""Many runs in processes of their own: kept one by one as they end, so that a run may resume.

A kernel that never returns, or that takes its process with it, costs one run and is said.
"""

import csv
import multiprocessing
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

HUNG, CRASHED, ERROR = "HUNG", "CRASHED", "ERROR"
Row = dict[str, Any]
Key = tuple[str, ...]
CONTEXT = multiprocessing.get_context("spawn")


@dataclass
class Worker:
    """One process, and the run that it is busy with."""

    process: SpawnProcess
    channel: Connection
    task: Any = None
    began: float = 0.0


def kept_rows(path: Path) -> list[Row]:
    """Rows that a file holds so far; none without the file, and no row that was cut off."""
    if not path.exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if None not in row.values()]


def run_all(
    tasks: Iterable[Any],
    work: Callable[[Any], Row],
    path: Path,
    fields: Sequence[str],
    keys: Sequence[str],
    *,
    warm: Callable[[], object] | None = None,
    workers: int = 1,
    limit: float = 600.0,
) -> list[Row]:
    """Do what is not yet kept in a file, each finished run written at once.

    Parameters
    ----------
    tasks : iterable
        Each with the attributes named by `keys`, whose text tells it from all others.
    work : callable
        Of one task, in another process: values by field. Importable by name.
    path : Path
        CSV; its folder is made.
    fields : sequence of str
        Columns, `keys` first; "status" is one of them.
    keys : sequence of str
    warm : callable, optional
        Called once in each process before its first run, outside the time limit.
    workers : int
    limit : float
        Wall time after which a run counts as hung and its process is ended [s].

    Returns
    -------
    list of dict
        Rows of these tasks as text, in their order.
    """
    tasks = list(tasks)
    rows = {_key(row, keys): row for row in kept_rows(path)}
    left = [task for task in tasks if _key(vars(task), keys) not in rows]
    path.parent.mkdir(parents=True, exist_ok=True)
    _rewrite(path, fields, rows.values())
    with open(path, "a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fields)
        for count, (task, values) in enumerate(_results(left, work, warm, workers, limit), 1):
            row = {name: str(vars(task)[name]) for name in keys}
            row |= {name: str(values.get(name, "")) for name in fields if name not in keys}
            rows[_key(row, keys)] = row
            writer.writerow(row)
            file.flush()
            if count % max(1, len(left) // 20) == 0:
                print(f"{count} of {len(left)}", file=sys.stderr, flush=True)
    return [rows[_key(vars(task), keys)] for task in tasks]


def _key(values: Row, keys: Sequence[str]) -> Key:
    return tuple(str(values.get(name, "")) for name in keys)


def code_of(rows: Iterable[Row]) -> str:
    """States of the kernels' source (column "kernels") that rows come from, with their number."""
    counts = Counter(row.get("kernels") or "unknown" for row in rows)
    return "kernels " + ", ".join(f"{state} ({number} runs)" for state, number in counts.items())


def _rewrite(path: Path, fields: Sequence[str], rows: Iterable[Row]) -> None:
    """The rows that are whole, so that what a kill cut off is not in the way."""
    fresh = path.with_name(path.name + ".new")
    with open(fresh, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fields, extrasaction="ignore", restval="")
        writer.writeheader()
        writer.writerows(rows)
    fresh.replace(path)


def _results(left, work, warm, workers, limit):
    """Tasks with what they gave, as they end."""
    waiting = left[::-1]
    crew = [_hire(work, warm) for _ in range(min(workers, len(left)))]
    try:
        while waiting or any(worker.task is not None for worker in crew):
            for worker in crew:
                if worker.task is None and waiting:
                    worker.task, worker.began = waiting.pop(), time.monotonic()
                    worker.channel.send(worker.task)
            busy = {worker.channel: worker for worker in crew if worker.task is not None}
            for channel in wait(list(busy), timeout=0.5):
                worker = busy[channel]
                try:
                    values = channel.recv()
                except EOFError:
                    yield _let_go(crew, worker, work, warm, CRASHED)
                    continue
                task, worker.task = worker.task, None
                yield task, values
            for worker in crew:
                if worker.task is not None and time.monotonic() - worker.began > limit:
                    yield _let_go(crew, worker, work, warm, HUNG)
    finally:
        for worker in crew:
            worker.process.terminate()


def _hire(work: Callable[[Any], Row], warm: Callable[[], object] | None) -> Worker:
    ours, theirs = CONTEXT.Pipe()
    process = CONTEXT.Process(target=_serve, args=(theirs, work, warm), daemon=True)
    process.start()
    theirs.close()
    ours.recv()
    return Worker(process, ours)


def _let_go(crew, worker, work, warm, status):
    """End a process that gives nothing any more, and put another in its place."""
    worker.process.terminate()
    task = worker.task
    crew[crew.index(worker)] = _hire(work, warm)
    return task, {"status": status, "wall_time": time.monotonic() - worker.began}


def _serve(channel: Connection, work: Callable[[Any], Row], warm) -> None:
    """Run the tasks that come, until the other end closes."""
    if warm is not None:
        warm()
    channel.send("ready")
    while True:
        try:
            task = channel.recv()
        except EOFError:
            return
        try:
            values = work(task)
        except Exception:
            traceback.print_exc()
            values = {"status": ERROR}
        channel.send(values)
