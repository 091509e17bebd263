"""What the runs of a study follow from, the identity of each, and the parts that hold results.

A part holds some runs, one row each with its key. Its name is the hash of its content, so that a
damaged one is seen; what the rows mean follows from their keys, so that a study that is changed
or grows keeps every run that is still what it was.
"""

import contextlib
import hashlib
import io
import re
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.files import replacing
from archfrag.kernel_cache import kernel_hash
from archfrag.mechanics.status import Model
from archfrag.study.file.members import Members, check_buildable, needs_records
from archfrag.study.file.records import PreparedRecord, load_prepared
from archfrag.study.file.schema import Study
from archfrag.study.files import digest_of, digest_of_code
from archfrag.study.runs import Cases, Grid, Requests, Verdicts, ask
from archfrag.study.runs.outcome import COLUMNS

# Code beside the kernels that decides what a run is, and what its row holds.
DECIDING = (
    "methods/**/*.py", "simulat*/**/*.py", "simulat*.py",
    "study/runs/outcome.py", "study/runs/variables.csv",
)  # fmt: skip
KEY = 16  # bytes
Table = NDArray[np.void]
# A row: its key, all columns, the time simulated in each model, and how long it took.
ROW = np.dtype([
    ("key", f"V{KEY}"), *((column.name, column.dtype) for column in COLUMNS),
    ("model_time", "f8", (len(Model),)), ("wall_time", "f8"),
])  # fmt: skip


@dataclass(frozen=True)
class Plan:
    """All that decides what the runs of a study are."""

    study: Study
    arches: Members
    records: tuple[PreparedRecord, ...]

    @cached_property
    def identity(self) -> str:
        """Digest of the kernels and of the code that calls them."""
        return digest_of([kernel_hash(), digest_of_code(*DECIDING)])

    @property
    def parts(self) -> Path:
        """Folder of the parts: one for each state of the kernels, whose runs no other can use."""
        return self.study.work / "parts" / self.identity[:12]

    @cached_property
    def method(self) -> dict[str, Any]:
        """The method and its options, as plain values."""
        return self.study.method.model_dump()

    @cached_property
    def levels(self) -> NDArray[np.float64]:
        """Levels of the study, (n_level,) [SI]."""
        return np.array(self.study.intensity.si)

    @cached_property
    def power(self) -> float:
        """A level grows with the factor to the power 1 / `power`."""
        from archfrag.motions.measures import scaling_exponent

        return 1.0 / scaling_exponent(self.study.intensity.measure)

    @cached_property
    def digests(self) -> dict[str, str]:
        """Digest of each part of the plan, by the name that a message gives it."""
        study = self.study
        parts = {
            "archfrag": self.identity,
            "study": study.id,
            "arches": [[m.entry.parameters, m.chain, m.record] for m in self.arches],
            "records": [asdict(record) for record in self.records],
            "levels": study.intensity.si,
            "measure": study.intensity.measure,
            "method": self.method,
            "design": study.design.model_dump(mode="json"),
        }
        return {name: digest_of(part) for name, part in parts.items()}

    @cached_property
    def _unscaled(self) -> NDArray[np.float64]:
        return np.array([record.factor for record in self.records])

    def factors(self, cases: Cases) -> NDArray[np.float64]:
        """Factors that bring the records of runs to their levels, (n,)."""
        return self._unscaled[cases["record"]] * cases["level"] ** self.power

    def keys(self, cases: Cases) -> NDArray[np.void]:
        """Identity of each run: of kernels, method, arch, motion and factor, (n,) of 16 bytes."""
        given, count = f"{self.identity}/{digest_of(self.method)}", len(self.records)
        pair = cases["arch"] * np.int64(count) + cases["record"]
        stems = {}
        for each in np.unique(pair).tolist():
            own = f"{self.arches[each // count].chain}/{self.records[each % count].samples}"
            stems[each] = hashlib.blake2b(f"{given}/{own}/".encode(), digest_size=KEY)
        keys = []
        for each, factor in zip(pair.tolist(), self.factors(cases).astype("<f8")):
            state = stems[each].copy()
            state.update(factor.tobytes())
            keys.append(state.digest())
        return np.frombuffer(b"".join(keys), f"V{KEY}")

    def requests(self, batch: int = 0, batches: int = 1) -> dict[int, Requests]:
        """What the design asks for, by arch, of all of it or of one of several batches."""
        if not 0 <= batch < batches:
            raise InputError(f"--batch {batch}: must be from 0 to {batches - 1}")
        from archfrag.fragility.quoted import shared_events

        design = self.study.design
        events = np.array([record.event for record in self.records])
        requests, measures = {}, self._measures()
        for arch, member in enumerate(self.arches):
            every = member.record is None
            records = np.arange(len(self.records)) if every else np.array([member.record])
            # What an adaptive design requests follows from all runs of an arch.
            share = arch if design.adaptive else arch * len(self.records) + records
            records = records[np.broadcast_to(share % batches == batch, records.shape)]
            if records.size:
                requests[arch] = design.requests(Grid(
                    arch, records, self.levels, self._unscaled[records], self.power,
                    measures[records], shared_events(events[records]),
                ))  # fmt: skip
        return requests

    def _measures(self) -> NDArray[np.float64]:
        """ln of the records' other measures where the study's own is 1, (n_record, n_measure)."""
        from archfrag.motions.measures import scaling_exponent

        own = self.study.intensity.measure
        names = [name for name in self.records[0].measures if name != own]
        values = np.array([[r.measures[name] for name in names] for r in self.records])
        exponents = np.array([scaling_exponent(name) for name in names], dtype=float)
        with np.errstate(divide="ignore"):
            logs = np.log(values) + exponents * np.log(self._unscaled)[:, None]
        return logs[:, np.isfinite(logs).all(axis=0)]


def make_plan(study: Study) -> Plan:
    """Plan of a study whose motions are prepared."""
    records = load_prepared(study)
    arches = study.members(len(records))
    if needs_records(study.arches):
        check_buildable(arches)  # of which the study's file shows those of one record
    return Plan(study, arches, tuple(records))


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


def gather(plan: Plan) -> tuple[Cases, Table, dict[int, dict[str, Any]]]:
    """All runs that the design of a plan requests, sorted by arch, record and place.

    Returned with their results, and with the notes of the design by arch. InputError if results
    are missing.
    """
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
    return cases, store.rows(plan.keys(cases)), notes


def superfluous(plan: Plan) -> dict[str, list[Path]]:
    """Parts that are of no use to a study, by why; no file that archfrag did not name."""
    found: dict[str, list[Path]] = {}
    requested = None
    with contextlib.suppress(InputError):  # what it will ask for follows from runs to be made
        requested = _sortable(plan.keys(gather(plan)[0]))
    for path in sorted(plan.parts.parent.glob("*/*.npy")):
        table = read_part(path)
        if path.parent != plan.parts:
            why = "of other kernels or another version"
        elif table is None:
            why = "that are damaged"
        elif requested is None or np.isin(_sortable(table["key"]), requested).any():
            continue
        else:
            why = "that the study does not ask for"
        if re.fullmatch(r"[0-9a-f]{32}", path.stem):
            found.setdefault(why, []).append(path)
    return found
