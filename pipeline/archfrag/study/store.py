"""Results of runs by the identity of each: parts written completely or not at all, and read again.

A part holds some runs, one row each with its key. Its name is the hash of its content, so that a
damaged one is seen; what the rows mean follows from their keys, so that a study that is changed
or grows keeps every run that is still what it was.
"""

import contextlib
import hashlib
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.files import entries
from archfrag.study.files import replacing
from archfrag.study.outcome import COLUMNS
from archfrag.study.plan import KEY, Plan
from archfrag.study.rounds import FINE, NO_CASES, Cases, Rounds

Table = NDArray[np.void]
_SUFFIX = ".npy"


@lru_cache(maxsize=8)
def table_type(models: tuple[str, ...]) -> np.dtype:
    """Type of a row: its key, all columns, and the time simulated in each model."""
    columns = [(column.name, column.dtype) for column in COLUMNS]
    times = [(name, "f8") for name in models]
    return np.dtype([("key", f"V{KEY}"), *columns, ("model_time", times)])


def new_table(keys: NDArray[np.void], columns: dict[str, NDArray]) -> Table:
    """Rows of runs from their keys and from `archfrag.study.outcome.columns_of`."""
    models = tuple(str(name) for name in columns["model"])
    table = np.zeros(len(keys), table_type(models))
    table["key"] = keys
    for column in COLUMNS:
        table[column.name] = columns[column.name]
    for place, name in enumerate(models):
        table["model_time"][name] = columns["model_time"][:, place]
    return table


def write_part(folder: Path, table: Table) -> Path:
    """Write a part; the same results give the same bytes under the same name."""
    content = io.BytesIO()
    np.save(content, table, allow_pickle=False)
    digest = hashlib.blake2b(content.getbuffer(), digest_size=KEY).hexdigest()
    path = folder / f"{digest}{_SUFFIX}"
    # Not made lasting: what a power cut tears, `read_part` takes for missing.
    with replacing(path, lasting=False) as temporary:
        temporary.write_bytes(content.getbuffer())
    return path


def read_part(path: Path) -> Table | None:
    """Rows of a part; None if it is damaged or of another version of archfrag."""
    try:
        content = path.read_bytes()
        if hashlib.blake2b(content, digest_size=KEY).hexdigest() != path.stem:
            return None
        table = np.load(io.BytesIO(content), allow_pickle=False)
        models = table.dtype["model_time"].names
    except (OSError, ValueError, KeyError, EOFError, AttributeError):
        return None
    if models is None or table.dtype != table_type(models):
        return None
    rows: Table = table
    return rows


class Store:
    """All runs of which the parts of a folder hold the results.

    Only keys and verdicts are kept in memory, 25 bytes a run.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._files: list[Path] = []
        self._key: list[NDArray[np.void]] = []
        self._verdict: list[NDArray[np.int8]] = []
        self._of_part: list[int] = []
        self._sorted: tuple[NDArray, NDArray, NDArray] | None = None
        for path in sorted(folder.glob(f"*{_SUFFIX}")):
            self.add(path)

    def add(self, path: Path) -> bool:
        """Take in a part; False if it is damaged."""
        table = read_part(path)
        if table is None:
            return False
        self._files.append(path)
        self._key.append(table["key"].copy())
        self._verdict.append(table["verdict"].copy())
        self._of_part.append(len(table))
        self._sorted = None
        return True

    def _index(self) -> tuple[NDArray, NDArray, NDArray]:
        """Sorted keys, their places among all rows, and all verdicts."""
        if self._sorted is None:
            keys = np.concatenate([np.empty(0, f"V{KEY}"), *self._key]).view(f"S{KEY}")
            order = np.argsort(keys, kind="stable")
            verdict = np.concatenate([np.empty(0, np.int8), *self._verdict])
            self._sorted = (keys[order], order, verdict)
        return self._sorted

    def places(self, keys: NDArray[np.void]) -> NDArray[np.int64]:
        """Row of each key among all rows, -1 where there is no result, (n,)."""
        known, order, _ = self._index()
        if not len(known):
            return np.full(len(keys), -1)
        wanted = np.ascontiguousarray(keys).view(f"S{KEY}")
        at = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
        return np.where(known[at] == wanted, order[at], -1)

    def verdicts(self, keys: NDArray[np.void]) -> NDArray[np.int8]:
        """Verdict of each key, -1 where there is no result, (n,)."""
        place = self.places(keys)
        verdict = self._index()[2]
        found = np.full(len(place), -1, np.int8)
        found[place >= 0] = verdict[place[place >= 0]]
        return found

    def rows(
        self, places: NDArray[np.int64]
    ) -> Iterator[tuple[Path, NDArray[np.int64], Table, NDArray[np.float64]]]:
        """Part by part its file, which of some places are in it, their rows, wall times [s]."""
        ends = np.cumsum(self._of_part)
        order = np.argsort(places, kind="stable")
        starts = np.searchsorted(places[order], np.concatenate([[0], ends]))
        for number in np.flatnonzero(np.diff(starts)).tolist():
            path, some = self._files[number], order[starts[number] : starts[number + 1]]
            table = read_part(path)
            if table is None:
                again = "the same command again states what is to be done"
                raise InputError(f"{path}: was damaged or removed while it was read; {again}")
            within = places[some] - (ends[number] - len(table))
            times = read_timing(path, len(table))[within]
            yield path, some, table[within], times


def timings_folder(parts: Path) -> Path:
    """Folder of the wall times beside the parts: they belong in no result."""
    return parts / "timings"


def write_timing(part: Path, wall_time: NDArray[np.float64]) -> None:
    """Write the wall times of the rows of a part [s]."""
    path = timings_folder(part.parent) / part.name
    with replacing(path, lasting=False) as temporary, open(temporary, "wb") as file:
        np.save(file, wall_time)


def read_timing(part: Path, count: int) -> NDArray[np.float64]:
    """Wall times of the rows of a part [s], nan where they are not known."""
    with contextlib.suppress(OSError, ValueError, EOFError):
        times: NDArray[np.float64] = np.load(timings_folder(part.parent) / part.name)
        if times.shape == (count,):
            return times
    return np.full(count, np.nan)


@dataclass(frozen=True)
class Results:
    """Runs that a design asked for."""

    cases: Cases  # (n_run,): sorted by stage, arch, record and place
    factors: NDArray[np.float64]  # (n_run,)
    table: dict[str, NDArray]  # columns of the runs, each (n_run,); `model_time` (n_run, n_model)


def replay(plan: Plan, store: Store) -> tuple[Cases, Rounds]:
    """All runs that the design of a plan asks for, sorted, and its rounds at their end."""
    rounds, asked = plan.rounds(), []
    while len(rounds.wanted):
        keys = plan.keys(rounds.wanted, plan.factors(rounds.wanted))
        verdicts = store.verdicts(keys)
        missing = int((verdicts < 0).sum())
        if missing:
            runs = f"{missing} of {len(keys)} runs of round {rounds.count + 1}"
            how = f"`archfrag run STUDY --resume` with the file of study {plan.study!r} makes them"
            raise InputError(
                f"{plan.parts.parent}: {runs} are missing or damaged; {how} and the cube"
            )
        asked.append(rounds.wanted)
        rounds.answer(verdicts)
    cases = np.concatenate([NO_CASES, *asked])
    order = np.lexsort([cases[name] for name in ("place", "record", "arch", "stage")])
    return cases[order], rounds


class Gathered:
    """All runs that a design asks for, 150 bytes each; their results are read where wanted."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self._store = plan, Store(plan.parts)
        self.cases, rounds = replay(plan, self._store)  # sorted by stage, arch, record, place
        self._factors = plan.factors(self.cases)
        self._places = self._store.places(plan.keys(self.cases, self._factors))
        self.notes: dict[int, dict[str, Any]] = rounds.notes  # of the design, by arch
        self.models: tuple[str, ...] = ()
        for _, _, table, _ in self._store.rows(self._places[:1]):
            self.models = table.dtype["model_time"].names or ()

    def read(self, arch: int | None = None, stage: int = FINE) -> Results:
        """Results of all runs, about 250 bytes each, or of those of one arch in a stage."""
        own = slice(0, len(self.cases))
        if arch is not None:
            # They are sorted by stage, then by arch.
            n_arch = len(self._plan.arches)
            kinds = self.cases["stage"] * np.int64(n_arch) + self.cases["arch"]
            kind = stage * n_arch + arch
            own = slice(*np.searchsorted(kinds, [kind, kind + 1]).tolist())
        count = own.stop - own.start
        table: dict[str, NDArray] = {c.name: np.empty(count, c.dtype) for c in COLUMNS}
        table["model_time"] = np.empty((count, len(self.models)))
        for path, rows, part, _ in self._store.rows(self._places[own]):
            if part.dtype["model_time"].names != self.models:
                raise InputError(f"{path}: is of other models than the parts before")
            for column in COLUMNS:
                table[column.name][rows] = part[column.name]
            for number, name in enumerate(self.models):
                table["model_time"][rows, number] = part["model_time"][name]
        return Results(self.cases[own], self._factors[own], table)


_OWN = re.compile(r"[0-9a-f]{32}\.npy|plan-[0-9a-f]{12}\.json")


def superfluous(plan: Plan) -> dict[str, list[Path]]:
    """Files of parts that are of no use to a study, by why; none that archfrag did not name."""
    store = Store(plan.parts)
    found: dict[str, list[Path]] = {
        "of other kernels or another version": [],
        "damaged": [],
        "that the study does not ask for": [],
    }
    other, damaged, unasked = found.values()
    try:
        cases, _ = replay(plan, store)
        asked = np.sort(plan.keys(cases, plan.factors(cases)).view(f"S{KEY}"))
    except InputError:
        asked = None  # what it will ask for follows from runs to be made
    for entry in entries(plan.parts.parent):
        path = Path(entry.path)
        if not _OWN.fullmatch(path.name) or path == plan.path:
            continue
        part = path.parent.parent / path.name if path.parent.name == "timings" else path
        if part.parent != plan.parts:
            other.append(path)
        elif path.suffix != _SUFFIX:
            unasked.append(path)
        elif (table := read_part(part)) is None:
            damaged.append(path)
        elif asked is not None and not np.isin(table["key"].view(f"S{KEY}"), asked).any():
            unasked.append(path)
    return {why: paths for why, paths in found.items() if paths}


def count_runs(paths: Sequence[Path]) -> int:
    """Runs that parts hold."""
    count = 0
    for path in paths:
        if path.parent.name != "timings" and path.suffix == _SUFFIX:
            with contextlib.suppress(OSError, ValueError, EOFError):
                count += len(np.load(path, mmap_mode="r", allow_pickle=False))
    return count


def remove(paths: Sequence[Path]) -> None:
    """Remove files, and folders that are empty then."""
    for path in paths:
        path.unlink(missing_ok=True)
    for folder in sorted({path.parent for path in paths}, reverse=True):
        for place in (folder, folder.parent):
            with contextlib.suppress(OSError):
                place.rmdir()
