"""Tasks in processes with a time limit, kept as they finish; tables, complete or not at all."""

import hashlib
import json
import os
import platform
import re
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures import TimeoutError as OutOfTime
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pandas as pd
import psutil

from archbench.settings import available_methods
from archfrag.errors import InputError
from archfrag.files import make_folder, replacing
from archfrag.physics.kernels.cache import kernel_hash
from archfrag.simulation.warmup import warmup
from archfrag.study.provenance import commit, machine, strict_json, versions

Key = tuple[Any, ...]
Row = dict[str, Any]


@dataclass(frozen=True)
class Bench:
    """How and where a part is measured.

    `output` is the folder of the tables, in which the same command continues; `quick` the reduced
    set; `real` a folder of real records; `solvers` other solvers with their versions; `report`
    takes a line for the user.
    """

    output: Path
    quick: bool = False
    records: Path = Path("records")
    real: Path | None = None
    solvers: Mapping[str, str] = field(default_factory=dict)
    workers: int = 1
    report: Callable[[str], None] = field(default=print, repr=False)

    def run(
        self,
        name: str,
        function: Callable[..., Any],
        tasks: Mapping[Key, tuple],
        limit: float,
        workers: int = 0,
    ) -> dict[Key, Any]:
        """Results of ``function(*task)`` by key; what the same sources have done is kept."""
        path = make_folder(self.output / "finished") / f"{name}-{sources()}.jsonl"
        done = {}
        for line in (
            path.read_text(encoding="utf-8").splitlines() if path.exists() else ()
        ):
            with suppress(ValueError):  # of a line cut short by a kill
                key, result = json.loads(line)
                done[json.dumps(key)] = result
        todo = {key: task for key, task in tasks.items() if json.dumps(key) not in done}
        self.report(f"{name}: {len(todo)} of {len(tasks)} tasks to do")
        began = time.perf_counter()
        shown = 0.0
        with path.open("a", encoding="utf-8") as file:
            found = in_processes(function, todo, workers or self.workers, limit)
            for count, (key, result) in enumerate(found, 1):
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
                table.to_csv(temporary, index=False, float_format="%.4g")
        about = {
            "quick": self.quick,
            "solvers": dict(self.solvers),
            "workers": self.workers,
            "versions": versions(),
            "commit": commit(),
            "machine": machine(),
            "kernels": kernel_hash(),
            "processor": _processor(),
        }
        with replacing(folder / f"{part}_about.json") as temporary:
            temporary.write_text(strict_json(about) + "\n", encoding="utf-8")


def _processor() -> str:
    listed = Path("/proc/cpuinfo")
    found = re.search(
        "model name.*: (.+)", listed.read_text() if listed.exists() else ""
    )
    return found[1] if found else platform.processor()


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
        if path.suffix in (".py", ".json") and path.name not in (
            "charts.py",
            "page.py",
        ):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def in_processes(
    function: Callable[..., Any],
    tasks: Mapping[Key, Sequence[Any]],
    workers: int,
    limit: float,
    compiled: bool = True,
) -> Iterator[tuple[Key, Any]]:
    """Results of ``function(*task)`` as they come, with their keys; a message for those that fail.

    A process whose task takes longer than `limit` [s] is ended with all that it started.
    """
    try:
        from pebble import ProcessExpired, ProcessPool
    except ModuleNotFoundError:
        raise InputError(
            "archbench needs the package pebble: pip install pebble"
        ) from None
    pool = ProcessPool(workers, 0, _prepare_process, (compiled,), get_context("spawn"))
    try:
        running: dict[Future, Key] = {
            pool.schedule(function, task, timeout=limit): key
            for key, task in tasks.items()
        }
        for done in as_completed(running):
            try:
                yield running[done], done.result()
            except OutOfTime:
                yield running[done], f"not ended within {limit:g} s"
            except ProcessExpired:
                yield running[done], "its process ended by itself"
    finally:
        pool.stop()
        pool.join()


def _prepare_process(compiled: bool) -> None:
    """Have the kernels before anything is timed, and end all that it started at SIGTERM."""

    def end(*_: Any) -> None:
        for each in psutil.Process().children(recursive=True):
            with suppress(psutil.NoSuchProcess):
                each.kill()
        os._exit(1)

    signal.signal(signal.SIGTERM, end)
    for name in available_methods() if compiled else ():
        warmup(name)
