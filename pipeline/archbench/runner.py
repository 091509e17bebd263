"""Parts: their tasks in processes with a time limit, kept as they finish, and their tables."""

import hashlib
import json
import math
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
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import psutil

from archbench.settings import available_methods
from archfrag.errors import InputError
from archfrag.files import make_folder, replacing
from archfrag.physics.kernels.cache import HOME, digest_of_syntax, text_of
from archfrag.simulation.warmup import warmup
from archfrag.study.provenance import commit, machine, strict_json, versions

Key = tuple[Any, ...]
Row = dict[str, Any]


class Part(NamedTuple):
    """Title of a part, how long it may take on two cores, and whose code its tables follow from.

    `minutes` are those of all of it; its quick set may take a twelfth. `follows` are patterns of
    files of archfrag, `uses` modules of other parts and folders that it needs of this package.
    """

    title: str
    minutes: float
    follows: tuple[str, ...] = ("physics/**/*.py",)
    uses: tuple[str, ...] = ()


GIVING = ("physics/**/*.py", "simulation/joints.py", "simulation/elastic.py")
PARTS = {
    "speed": Part("Speed against accuracy", 40.0, uses=("growth",)),
    "fragility": Part("Fragility: error of the curve against cost of the study", 40.0),
    "knee": Part("Knee: what an error of theta costs", 35.0, uses=("fragility",)),
    "growth": Part("Growth with the number of voussoirs", 15.0),
    "stability": Part("Stability: where methods fail", 30.0),
    "joints": Part("Joints that give", 20.0, GIVING),
    "spans": Part("One span or three", 15.0, uses=("joints",)),
    "corner_cases": Part("Corner cases", 20.0, uses=("cases",)),
    "bands": Part(
        "How often bands hold the truth", 25.0, ("fragility/*.py", "study/designs.py")
    ),
}
QUICK = 1.0 / 12.0
# Without these kernels and figures are the same.
APART = ("cache.py", "load.py", "__main__.py")
UNUSED = {"page", "charts", "__main__", "nature", "harmonic", "paper", "cases", *PARTS}


@dataclass(frozen=True)
class Bench:
    """How and where a part is measured.

    `output` is the folder of the tables, in which the same command continues; `quick` the reduced
    set; `solvers` other solvers with their versions; `until` when the part's time is over, on the
    monotonic clock, and `seconds` how long it was; `report` takes a line for the user. `left_out`
    is what was not measured, and why.
    """

    output: Path
    quick: bool = False
    part: str = "speed"
    solvers: Mapping[str, str] = field(default_factory=dict)
    workers: int = 1
    report: Callable[[str], None] = field(default=print, repr=False)
    until: float = math.inf
    seconds: float = 0.0
    left_out: list[tuple[str, str]] = field(default_factory=list)

    def run(
        self,
        name: str,
        function: Callable[..., Any],
        tasks: Mapping[Key, tuple],
        limit: float,
        share: float = 1.0,
    ) -> dict[Key, Any]:
        """Results of ``function(*task)`` by key; what the same sources have done is kept.

        Tasks begin in their order; those that have not ended after a `share` of the part's time
        are not among the results.
        """
        folder = make_folder(self.output / "finished")
        digests = digest(self.part), own_digest(self.part)
        path = folder / "-".join([f"{name}{'_quick' * self.quick}", *digests])
        path = path.with_name(path.name + ".jsonl")
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
        until = self.until - (1.0 - share) * self.seconds
        with path.open("a", encoding="utf-8") as file:
            found = in_processes(function, todo, self.workers, limit, until)
            for count, (key, result) in enumerate(found, 1):
                done[json.dumps(key)] = result
                file.write(json.dumps([key, result]) + "\n")
                file.flush()
                spent = time.perf_counter() - began
                if spent > shown + 20.0 or count == len(todo):
                    shown = spent
                    self.report(f"{name}: {count} of {len(todo)} done in {spent:.0f} s")
        results = {
            key: done[json.dumps(key)] for key in tasks if json.dumps(key) in done
        }
        if late := len(tasks) - len(results):
            self.leave_out(
                f"{late} of {len(tasks)} tasks of {name}", "no time was left"
            )
        for key, result in results.items():
            if isinstance(result, str):
                self.leave_out(f"{name}: {', '.join(map(str, key))}", result)
        return results

    def rows(
        self,
        name: str,
        function: Callable[..., Any],
        tasks: Mapping,
        share: float = 1.0,
    ) -> pd.DataFrame:
        """A table of the rows that tasks give, without those that gave none."""
        found = self.run(name, function, tasks, self.seconds or math.inf, share)
        listed = [each for each in found.values() if not isinstance(each, str)]
        return pd.DataFrame([row for rows in listed for row in rows])

    def leave_out(self, what: str, why: str) -> None:
        """Note what was not measured, and why."""
        self.left_out.append((what, why))

    def about(self) -> Row:
        """What the part's tables follow from, by which they are kept."""
        return {
            "quick": self.quick,
            "kernels": digest(self.part),
            "sources": own_digest(self.part),
            "solvers": dict(self.solvers),
        }

    def is_measured(self) -> bool:
        """Whether the part's tables are of today's sources, with all these solvers."""
        kept = about_of(self.output, self.part)
        now = self.about()
        missed = now.pop("solvers").items() - dict(kept.get("solvers", {})).items()
        return not missed and now.items() <= kept.items()

    def save(self, tables: Mapping[str, pd.DataFrame]) -> None:
        """Write the part's tables as CSV, with what was left out, and what they were made by."""
        folder = make_folder(self.output)
        left = pd.DataFrame(self.left_out, columns=["what", "why"])
        for path in folder.glob(f"{self.part}_*.csv"):
            path.unlink()
        known = {name: table for name, table in tables.items() if len(table)}
        for name, table in {**known, "left_out": left}.items():
            with replacing(folder / f"{self.part}_{name}.csv") as temporary:
                table.to_csv(temporary, index=False, float_format="%.4g")
        about = {
            **self.about(),
            "workers": self.workers,
            "versions": versions(),
            "commit": commit(),
            "machine": machine(),
            "processor": _processor(),
        }
        with replacing(folder / f"{self.part}_about.json") as temporary:
            temporary.write_text(strict_json(about) + "\n", encoding="utf-8")


def about_of(folder: Path, part: str) -> Row:
    """What a part's tables were made by; empty if it was not measured."""
    path = folder / f"{part}_about.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


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


def digest(part: str) -> str:
    """Digest of what the code of archfrag does that a part's tables follow from: its kernels."""
    found = [path for each in PARTS[part].follows for path in HOME.glob(each)]
    chosen = tuple(sorted(path for path in found if path.name not in APART))
    return digest_of_syntax(chosen)[:12]


@cache
def own_digest(part: str) -> str:
    """Digest of this package as far as a part needs it."""
    here = Path(__file__).parent
    unused = UNUSED - {part, *PARTS[part].uses}
    found = hashlib.sha256()
    for path in sorted(here.rglob("*")):
        if (
            path.suffix in (".py", ".json")
            and not {path.stem, path.parent.name} & unused
        ):
            text = path.read_bytes()
            own = text_of(text).encode() if path.suffix == ".py" else text
            found.update(path.relative_to(here).as_posix().encode() + own)
    return found.hexdigest()[:12]


def in_processes(
    function: Callable[..., Any],
    tasks: Mapping[Key, Sequence[Any]],
    workers: int,
    limit: float,
    until: float = math.inf,
    compiled: bool = True,
) -> Iterator[tuple[Key, Any]]:
    """Results of ``function(*task)`` as they come, with their keys; a message for those that fail.

    A process whose task takes longer than `limit` [s] is ended with all that it started, and so is
    all that goes on at `until` on the monotonic clock, without a result.
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
        left = None if math.isinf(until) else max(until - time.monotonic(), 0.0)
        with suppress(OutOfTime):
            for done in as_completed(running, left):
                yield running[done], _result(done, limit, ProcessExpired)
    finally:
        pool.stop()
        pool.join()


def _result(done: Future, limit: float, expired: type[Exception]) -> Any:
    try:
        return done.result()
    except OutOfTime:
        return f"not ended within {limit:g} s"
    except expired:
        return "its process ended by itself"


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
