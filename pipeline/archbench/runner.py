"""Tasks in processes with a time limit, kept as they finish; tables, complete or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures import TimeoutError as OutOfTime
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pandas as pd
import psutil

from archfrag.errors import InputError
from archfrag.files import make_folder, replacing
from archfrag.kernel_cache import kernel_hash
from archfrag.simulate import warmup
from archfrag.simulation.checks import available_methods
from archfrag.study.provenance import commit, machine, strict_json, versions

Key = tuple[Any, ...]


@dataclass(frozen=True)
class Bench:
    """How and where a part is measured.

    Attributes
    ----------
    output : Path
        Folder of the tables; the same command continues in it.
    quick : bool
        The reduced set.
    records : Path
        The shipped records.
    real : Path or None
        A folder of real ones.
    solvers : tuple of str
        Other solvers, by the names of `archbench.adapters.client`.
    workers : int
    report : callable
        Takes a line for the user.
    """

    output: Path
    quick: bool = False
    records: Path = Path("records")
    real: Path | None = None
    solvers: tuple[str, ...] = ()
    workers: int = 1
    report: Callable[[str], None] = field(default=print, repr=False)

    @property
    def folders(self) -> tuple[Path | None, ...]:
        """Where records are sought."""
        return self.records, self.real

    def run(
        self, name: str, function: Callable[..., Any], tasks: Mapping[Key, tuple], limit: float
    ) -> dict[Key, Any]:
        """Results of ``function(*task)`` by key, in the order of tasks.

        What an earlier run of the same sources has finished is not done again.
        """
        path = make_folder(self.output / "finished") / f"{name}-{sources()}.jsonl"
        done = _finished(path)
        todo = {key: task for key, task in tasks.items() if json.dumps(key) not in done}
        self.report(f"{name}: {len(todo)} of {len(tasks)} tasks to do")
        began, shown = time.perf_counter(), 0.0
        with path.open("a", encoding="utf-8") as file:
            for count, (key, result) in enumerate(
                in_processes(function, todo, self.workers, limit), 1
            ):
                done[json.dumps(key)] = result
                file.write(json.dumps([key, result]) + "\n")
                file.flush()
                spent = time.perf_counter() - began
                if spent > shown + 20.0 or count == len(todo):
                    shown = spent
                    self.report(f"{name}: {count} of {len(todo)} done in {spent:.0f} s")
        return {key: done[json.dumps(key)] for key in tasks}

    def save(self, part: str, tables: Mapping[str, pd.DataFrame]) -> None:
        """Write a part's tables as CSV, with what they were made by beside them."""
        folder = make_folder(self.output)
        for name, table in tables.items():
            with replacing(folder / f"{part}_{name}.csv") as temporary:
                table.to_csv(temporary, index=False, float_format="%.5g")
        about = {
            "quick": self.quick, "solvers": list(self.solvers), "workers": self.workers,
            "versions": versions(), "commit": commit(), "machine": machine(),
            "kernels": kernel_hash(),
        }  # fmt: skip
        with replacing(folder / f"{part}_about.json") as temporary:
            temporary.write_text(strict_json(about) + "\n", encoding="utf-8")


def load_tables(folder: Path, part: str) -> dict[str, pd.DataFrame]:
    """A part's tables by their names; none if it was not measured."""
    tables = {}
    for path in sorted(folder.glob(f"{part}_*.csv")):
        try:
            tables[path.stem.removeprefix(f"{part}_")] = pd.read_csv(path)
        except (OSError, ValueError) as error:
            raise InputError(f"{path} is no table of results: {error}") from error
    return tables


def sources() -> str:
    """Hash of the kernels and of this package: results of other sources are not continued."""
    digest = hashlib.sha256(kernel_hash().encode())
    for path in sorted(Path(__file__).parent.rglob("*")):
        if path.suffix in (".py", ".json") and path.name not in ("charts.py", "page.py"):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _finished(path: Path) -> dict[str, Any]:
    """Results by the JSON of their keys; a line cut short by a kill is left out."""
    done = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            key, result = json.loads(line)
        except ValueError:
            continue
        done[json.dumps(key)] = result
    return done


def load_kernels() -> None:
    """Have the kernels of all methods in this process, before anything is timed."""
    for name in available_methods():
        warmup(name)


def in_processes(
    function: Callable[..., Any],
    tasks: Mapping[Key, Sequence[Any]],
    workers: int,
    limit: float,
    prepare: Callable[[], None] = load_kernels,
):
    """Results of ``function(*task)`` as they come, with their keys; a message for those that fail.

    Each worker is a process of its own, which is ended and replaced when a task takes too long.

    Examples
    --------
    >>> from archbench.runner import in_processes
    >>> dict(in_processes(divmod, {("a",): (7, 2)}, 1, 60.0, prepare=int))
    {('a',): (3, 1)}
    """
    finished: SimpleQueue = SimpleQueue()
    slots: SimpleQueue = SimpleQueue()
    for _ in range(workers):
        slots.put(_Slot(prepare))

    def work(key: Key, task: Sequence[Any]) -> None:
        slot = slots.get()
        try:
            finished.put((key, slot.call(partial(function, *task), limit), None))
        except BaseException as error:
            finished.put((key, None, error))
        finally:
            slots.put(slot)

    with ThreadPoolExecutor(workers) as threads:
        for key, task in tasks.items():
            threads.submit(work, key, task)
        try:
            for _ in tasks:
                key, result, error = finished.get()
                if error is not None:
                    raise error
                yield key, result
        finally:
            threads.shutdown(cancel_futures=True)
            for _ in range(workers):
                slots.get().end()


def _pid(_: Callable[..., Any]) -> int:
    return os.getpid()


class _Slot:
    """One process at a time, which takes one task at a time."""

    def __init__(self, prepare: Callable[[], None]) -> None:
        self.prepare = prepare
        self.pool: ProcessPoolExecutor | None = None
        self.pid = 0

    def call(self, task: partial, limit: float) -> Any:
        if self.pool is None:
            self.pool = ProcessPoolExecutor(1, get_context("spawn"), initializer=self.prepare)
            # Its module is imported with it, outside the limit.
            self.pid = self.pool.submit(_pid, task.func).result()
        running: Future = self.pool.submit(task)
        try:
            return running.result(timeout=limit)
        except OutOfTime:
            self.end()
            return f"not ended within {limit:g} s"
        except BrokenExecutor:
            self.end()
            return "its process ended by itself"

    def end(self) -> None:
        """End the process and those that it started."""
        if self.pool is None:
            return
        with suppress(psutil.NoSuchProcess):
            process = psutil.Process(self.pid)
            for each in (*process.children(recursive=True), process):
                each.kill()
        self.pool.shutdown(wait=False, cancel_futures=True)
        self.pool = None
