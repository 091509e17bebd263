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
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.files import replacing
from archfrag.mechanics.status import Model
from archfrag.study.runs.design import Cases, Verdicts, ask
from archfrag.study.runs.outcome import COLUMNS
from archfrag.study.runs.plan import KEY, Plan

Table = NDArray[np.void]
# A row: its key, all columns, the time simulated in each model, and how long it took.
ROW = np.dtype([
    ("key", f"V{KEY}"), *((column.name, column.dtype) for column in COLUMNS),
    ("model_time", "f8", (len(Model),)), ("wall_time", "f8"),
])  # fmt: skip


def write_part(folder: Path, keys: NDArray[np.void], columns: dict[str, NDArray]) -> Path:
    """Write runs, from their keys and all other columns, under the name of their content."""
    table = np.zeros(len(keys), ROW)
    for name, values in {"key": keys, **columns}.items():
        table[name] = values
    content = io.BytesIO()
    np.save(content, table, allow_pickle=False)
    path = folder / f"{_name(content.getvalue())}.npy"
    # Not made lasting: what a power cut tears, `read_part` takes for missing.
    with replacing(path, lasting=False) as temporary:
        temporary.write_bytes(content.getbuffer())
    return path


def read_part(path: Path) -> Table | None:
    """Rows of a part; None if it is damaged or of another version of archfrag."""
    try:
        content = path.read_bytes()
        if _name(content) != path.stem:
            return None
        table: Table = np.load(io.BytesIO(content), allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    return table if table.dtype == ROW else None


def _name(content: bytes) -> str:
    return hashlib.blake2b(content, digest_size=KEY).hexdigest()


class Store:
    """All runs of which the parts of a folder hold the results, about 300 bytes each."""

    def __init__(self, folder: Path) -> None:
        self._tables: list[Table] = [np.zeros(0, ROW)]
        self._order: NDArray[np.int64] | None = None
        for path in sorted(folder.glob("*.npy")):
            self.add(path)

    def add(self, path: Path) -> bool:
        """Take in a part; False if it is damaged."""
        table = read_part(path)
        if table is not None:
            self._tables.append(table)
            self._order = None
        return table is not None

    def places(self, keys: NDArray[np.void]) -> NDArray[np.int64]:
        """Row of each key among all rows, -1 where there is no result, (n,)."""
        if self._order is None:
            self._tables = [np.concatenate(self._tables)]
            self._order = np.argsort(_sortable(self._tables[0]["key"]), kind="stable")
        known = _sortable(self._tables[0]["key"])[self._order]
        if not len(known):
            return np.full(len(keys), -1)
        requested = _sortable(keys)
        at = np.minimum(np.searchsorted(known, requested), len(known) - 1)
        return np.where(known[at] == requested, self._order[at], -1)

    def rows(self, keys: NDArray[np.void]) -> Table:
        """Results by keys that are all there, (n,)."""
        places = self.places(keys)
        return self._tables[0][places]


def _sortable(keys: NDArray[np.void]) -> NDArray[np.bytes_]:
    return np.ascontiguousarray(keys).view(f"S{KEY}")


class Gathered(NamedTuple):
    """All runs that a design requests, with their results."""

    cases: Cases  # (n_run,): sorted by arch, record and place
    table: Table  # (n_run,)
    notes: dict[int, dict[str, Any]]  # of the design, by arch


def gather(plan: Plan) -> Gathered:
    """Results of all runs that the design of a plan requests; InputError if some are missing."""
    store, iteration = Store(plan.parts), 0

    def known(cases: Cases) -> Verdicts:
        nonlocal iteration
        iteration += 1
        keys = plan.keys(cases)
        missing = int((store.places(keys) < 0).sum())
        if missing:
            runs = f"{missing} of {len(keys)} runs of iteration {iteration}"
            how = f"`archfrag run` with the file of study {plan.study.id!r} makes them"
            raise InputError(f"{plan.parts.parent}: {runs} are missing or damaged; {how}")
        verdicts: Verdicts = store.rows(keys)["verdict"]
        return verdicts

    cases, notes = ask(plan.requests(), known)
    cases = cases[np.lexsort([cases[name] for name in ("place", "record", "arch")])]
    return Gathered(cases, store.rows(plan.keys(cases)), notes)


def superfluous(plan: Plan) -> dict[str, list[Path]]:
    """Parts that are of no use to a study, by why; no file that archfrag did not name."""
    found: dict[str, list[Path]] = {}
    requested = None
    with contextlib.suppress(InputError):  # what it will ask for follows from runs to be made
        requested = _sortable(plan.keys(gather(plan).cases))
    for path in sorted(plan.parts.parent.glob("*/*.npy")):
        table = read_part(path)
        if path.parent != plan.parts:
            why = "of other kernels or another version"
        elif table is None:
            why = "damaged"
        elif requested is None or np.isin(_sortable(table["key"]), requested).any():
            continue
        else:
            why = "that the study does not ask for"
        if re.fullmatch(r"[0-9a-f]{32}", path.stem):
            found.setdefault(why, []).append(path)
    return found


def count_runs(paths: Sequence[Path]) -> int:
    """Runs that parts hold."""
    count = 0
    for path in paths:
        with contextlib.suppress(OSError, ValueError, EOFError):
            count += len(np.load(path, mmap_mode="r", allow_pickle=False))
    return count


def remove(paths: Sequence[Path]) -> None:
    """Remove files, and folders that are empty then."""
    for path in paths:
        path.unlink(missing_ok=True)
    for folder in {path.parent for path in paths}:
        with contextlib.suppress(OSError):
            folder.rmdir()
