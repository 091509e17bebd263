"""Results of runs by the identity of each: parts written completely or not at all, and read again.

A part holds some runs, one row each with its key. Its name is the hash of its content, so that a
damaged one is seen; what the rows mean follows from their keys, so that a study that is changed
or grows keeps every run that is still what it was.
"""

import contextlib
import hashlib
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.files import entries, replacing
from archfrag.mechanics.status import Model
from archfrag.study.runs.design import NO_CASES, Cases
from archfrag.study.runs.outcome import COLUMNS
from archfrag.study.runs.plan import KEY, Iterations, Plan

Table = NDArray[np.void]
# A row: its key, all columns, the time simulated in each model, and how long it took.
ROW = np.dtype([
    ("key", f"V{KEY}"), *((column.name, column.dtype) for column in COLUMNS),
    ("model_time", "f8", (len(Model),)), ("wall_time", "f8"),
])  # fmt: skip
_SUFFIX = ".npy"
_OWN = re.compile(r"[0-9a-f]{32}\.npy|plan-[0-9a-f]{12}\.json")


def new_table(keys: NDArray[np.void], columns: dict[str, NDArray]) -> Table:
    """Rows of runs from their keys and all other columns."""
    table = np.zeros(len(keys), ROW)
    table["key"] = keys
    for name, values in columns.items():
        table[name] = values
    return table


def write_part(folder: Path, table: Table) -> Path:
    """Write a part under the name of its content."""
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
        table: Table = np.load(io.BytesIO(content), allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    return table if table.dtype == ROW else None


class Store:
    """All runs of which the parts of a folder hold the results, about 300 bytes each."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._tables: list[Table] = [np.zeros(0, ROW)]
        self._order: NDArray[np.int64] | None = None
        for path in sorted(folder.glob(f"*{_SUFFIX}")):
            self.add(path)

    def add(self, path: Path) -> bool:
        """Take in a part; False if it is damaged."""
        table = read_part(path)
        if table is None:
            return False
        self._tables.append(table)
        self._order = None
        return True

    def places(self, keys: NDArray[np.void]) -> NDArray[np.int64]:
        """Row of each key among all rows, -1 where there is no result, (n,)."""
        if self._order is None:
            self._tables = [np.concatenate(self._tables)]
            self._order = np.argsort(self._keys(), kind="stable")
        known = self._keys()[self._order]
        if not len(known):
            return np.full(len(keys), -1)
        wanted = np.ascontiguousarray(keys).view(f"S{KEY}")
        at = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
        return np.where(known[at] == wanted, self._order[at], -1)

    def _keys(self) -> NDArray[np.bytes_]:
        return np.ascontiguousarray(self._tables[0]["key"]).view(f"S{KEY}")

    def rows(self, keys: NDArray[np.void]) -> Table:
        """Results by keys that are all there, (n,)."""
        return self._tables[0][self.places(keys)]

    def verdicts(self, keys: NDArray[np.void]) -> NDArray[np.int8]:
        """Verdict of each key, -1 where there is no result, (n,)."""
        place = self.places(keys)
        found = np.full(len(place), -1, np.int8)
        found[place >= 0] = self._tables[0]["verdict"][place[place >= 0]]
        return found


@dataclass(frozen=True)
class Gathered:
    """All runs that a design requests, with their results."""

    cases: Cases  # (n_run,): sorted by arch, record and place
    factors: NDArray[np.float64]  # (n_run,)
    table: Table  # (n_run,)
    notes: dict[int, dict[str, Any]]  # of the design, by arch


def replay(plan: Plan, store: Store) -> tuple[Cases, Iterations]:
    """All runs that the design of a plan requests, sorted, and its iterations at their end.

    Raises
    ------
    InputError
        If the results of some are missing.
    """
    iterations, asked = plan.iterations(), [NO_CASES]
    while len(iterations.requested):
        verdicts = store.verdicts(plan.keys(iterations.requested))
        missing = int((verdicts < 0).sum())
        if missing:
            runs = f"{missing} of {len(verdicts)} runs of iteration {iterations.count + 1}"
            how = f"`archfrag run` with the file of study {plan.study!r} makes them"
            raise InputError(f"{plan.parts.parent}: {runs} are missing or damaged; {how}")
        asked.append(iterations.requested)
        iterations.answer(verdicts)
    cases = np.concatenate(asked)
    order = np.lexsort([cases[name] for name in ("place", "record", "arch")])
    return cases[order], iterations


def gather(plan: Plan, store: Store | None = None) -> Gathered:
    """Results of all runs that the design of a plan requests; errors are those of `replay`."""
    store = Store(plan.parts) if store is None else store
    cases, iterations = replay(plan, store)
    return Gathered(cases, plan.factors(cases), store.rows(plan.keys(cases)), iterations.notes)


def superfluous(plan: Plan) -> dict[str, list[Path]]:
    """Files of parts that are of no use to a study, by why; none that archfrag did not name."""
    found: dict[str, list[Path]] = {
        "of other kernels or another version": [],
        "damaged": [],
        "that the study does not ask for": [],
    }
    other, damaged, unasked = found.values()
    try:
        asked = np.sort(plan.keys(replay(plan, Store(plan.parts))[0]).view(f"S{KEY}"))
    except InputError:
        asked = None  # what it will ask for follows from runs to be made
    for path in (Path(entry.path) for entry in entries(plan.parts.parent)):
        if not _OWN.fullmatch(path.name) or path == plan.path:
            continue
        if path.parent != plan.parts:
            other.append(path)
        elif path.suffix != _SUFFIX:
            unasked.append(path)
        elif (table := read_part(path)) is None:
            damaged.append(path)
        elif asked is not None and not np.isin(table["key"].view(f"S{KEY}"), asked).any():
            unasked.append(path)
    return {why: paths for why, paths in found.items() if paths}


def count_runs(paths: Sequence[Path]) -> int:
    """Runs that parts hold."""
    count = 0
    for path in paths:
        with contextlib.suppress(OSError, ValueError, EOFError):
            if path.suffix == _SUFFIX:
                count += len(np.load(path, mmap_mode="r", allow_pickle=False))
    return count


def remove(paths: Sequence[Path]) -> None:
    """Remove files, and folders that are empty then."""
    for path in paths:
        path.unlink(missing_ok=True)
    for folder in {path.parent for path in paths}:
        with contextlib.suppress(OSError):
            folder.rmdir()
