"""The plan of a study's runs, the identity of each run, and the files with results, called parts.

A part has a row for each of some runs, with the key of the run. Its name is the hash of its
content, so that damage is noticed. The key states what a run is: if a study is changed or grows,
it keeps every run that is still the same.
"""

import contextlib
import hashlib
import io
import re
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.files import Named, replacing
from archfrag.fragility.curve import FloatArray, IntArray
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.measures import scaling_exponent
from archfrag.physics.kernels.cache import digest_of_syntax, kernel_platform
from archfrag.physics.status import Count, Energy, Level, Loss, Peak, Status
from archfrag.study.designs import Cases, Grid, Requests, Verdicts, ask, order_of
from archfrag.study.file.members import Members
from archfrag.study.file.prepared import (
    PreparedRecord,
    levels_asked,
    load_prepared,
    load_record,
)
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import digest_of, files_of_code

if TYPE_CHECKING:
    from archfrag.arch import Arch
    from archfrag.motions.motion import Motion
    from archfrag.physics.interface import Outcomes

# Code that decides what a run is, and what its row holds.
DECIDING = (
    "physics/**/*.py",
    "simulation/**/*.py",
    "motions/motion.py",
    "study/runs/store.py",
)
KEY = 16  # bytes
Table = NDArray[np.void]
Keys = NDArray[np.bytes_]
# The cube's variables by name; columns of the file: name; dimensions ("run" stands for arch,
# record and level); dtype (S for text); units (empty for codes and text); fill, what stands where
# there is no such value; missing, what stands in a cell that was not simulated; flags, the
# enumeration of the codes or the meanings of 0, 1 and so on; source, an array of the kernels'
# results with the entry there, or a record's attribute; long_name; comment.
_table = pd.read_csv(
    Path(__file__).with_name("variables.csv"), dtype=str, keep_default_na=False
)
VARIABLES: Named = {str(row.name): row for row in _table.itertuples(index=False)}
COLUMNS = tuple(each for each in VARIABLES.values() if each.dimensions == "run")
_VERDICTS = np.full(max(Status) + 1, Verdict.FAILED, np.int8)  # by status
_VERDICTS[Status.STANDING] = Verdict.SURVIVED
_VERDICTS[Status.COLLAPSED] = Verdict.COLLAPSED
_VERDICTS[Status.UNFINISHED] = Verdict.UNFINISHED
_ENTRIES: Named = {"count": Count, "loss": Loss, "peak": Peak}
# A row: its key, all columns, the time simulated in each model, and how long it took.
ROW = np.dtype(
    [
        ("key", f"S{KEY}"),
        *((column.name, column.dtype) for column in COLUMNS),
        ("model_time", "f8", (len(Level),)),
        ("wall_time", "f8"),
    ]
)
_TOGETHER = 1000  # parts that are read
_WHOLE = np.dtype((np.void, ROW.itemsize))  # numpy copies columns one by one


def code_identity() -> str:
    """Return the digest of the code that makes runs, of the columns of rows and of the platform.

    Texts that only label are left out: a run stays the same if they are mended.
    """
    rows = [[column.name, column.dtype, column.source] for column in COLUMNS]
    return digest_of(
        [kernel_platform(), digest_of_syntax(tuple(files_of_code(*DECIDING))), rows]
    )


def verdicts_of(status: NDArray) -> NDArray[np.int8]:
    """Return the verdicts of runs from the kernels' codes of `Status`, (n_run,)."""
    return _VERDICTS[status]


def table_of(keys: Keys, results: "Outcomes", wall_time, starts) -> Table:
    """Return the rows of runs, from their keys, the kernels' results and their wall times [s].

    `starts` are the times at which their records begin [s]. A run that collapses before has the
    verdict COLLAPSED_BEFORE.
    """
    table = np.zeros(len(keys), ROW)
    table["key"] = keys
    table["wall_time"] = wall_time
    table["model_time"] = results.model_time[:, list(Level)]
    table["verdict"] = verdicts_of(results.status)
    early = (results.status == Status.COLLAPSED) & (results.collapse_time < starts)
    table["verdict"][early] = Verdict.COLLAPSED_BEFORE
    balance = results.energy[:, Energy.BALANCE_ERROR_PEAK]
    largest = results.energy[:, Energy.LARGEST_KINETIC]
    np.divide(balance, largest, out=table["energy_error"], where=largest > 0.0)
    for column in COLUMNS:
        if column.source:
            name, _, entry = column.source.partition(".")
            values = getattr(results, name)
            table[column.name] = values[:, _ENTRIES[name][entry]] if entry else values
    return table


# A motion of a minute with its vertical takes 0.2 MB.
_stored_motion = lru_cache(maxsize=64)(load_record)


@dataclass(frozen=True)
class Plan:
    """The arches and records of a study, and how each of its runs is made of them."""

    study: StudyKeys
    arches: Members
    records: tuple[PreparedRecord, ...]
    # Digest of the code that makes runs.
    identity: str = field(default_factory=lambda: code_identity())
    # Loaded motions by their files, for workers without the study's folder.
    motions: "dict[str, Motion]" = field(default_factory=dict, compare=False)
    # Arches that have been built, by number.
    built: "dict[int, Arch]" = field(default_factory=dict, compare=False)

    def with_motions(self) -> "Plan":
        """Return the plan with all motions loaded, for workers without the study's folder."""
        stored = {each for record in self.records for each in record.motions}
        loaded = {each.stored: load_record(self.study.work, each) for each in stored}
        return replace(self, motions=loaded)

    def motion(self, record: PreparedRecord) -> "Motion":
        """Return the motion of a record or of a first shock."""
        known = self.motions.get(record.stored)
        return known or _stored_motion(self.study.work, record)

    def shock(
        self, arch: int, record: int
    ) -> tuple[PreparedRecord, float, float] | None:
        """Return the first shock before a record, its factor and the gap [s]; None without one."""
        first = self.records[record].first
        if first is None or self.arches[arch].intact:
            return None
        level, gap = self.arches[arch].shock
        return first, first.factor * level**self.power, gap

    def ground(self, arch: int, record: int, factor: float) -> "tuple[Motion, float]":
        """Return the motion of a run, and the factor to scale it by.

        If a first shock comes before the record, the motion is both, already scaled, and the
        factor is 1.
        """
        motion = self.motion(self.records[record])
        shock = self.shock(arch, record)
        if shock is None:
            return motion, factor
        first, scale, gap = shock
        return self.motion(first).scaled(scale).then(motion.scaled(factor), gap), 1.0

    def arch(self, number: int) -> "Arch":
        """Return the arch with a number; it is built only once."""
        if number not in self.built:
            self.built[number] = self.arches[number].entry.build()
        return self.built[number]

    @property
    def parts(self) -> Path:
        """Folder of the parts; each identity of the code has its own."""
        return self.study.work / "parts" / self.identity[:12]

    @cached_property
    def levels(self) -> FloatArray:
        """The levels of the study, (n_level,) [SI]."""
        return np.array(self.study.intensity.si)

    @cached_property
    def power(self) -> float:
        """The exponent p by which a factor grows with the level: factor = unscaled * level**p."""
        return 1.0 / scaling_exponent(self.study.intensity.measure)

    @cached_property
    def unscaled(self) -> FloatArray:
        """The factors that bring the records to 1 in the study's measure, (n_record,)."""
        return np.array([record.factor for record in self.records])

    def factors(self, cases: Cases) -> FloatArray:
        """Return the factors that bring the records of runs to their levels, (n,)."""
        return self.unscaled[cases["record"]] * cases["level"] ** self.power

    def keys(self, cases: Cases) -> Keys:
        """Return the key of each run, (n,): a hash of code, method, arch, motions and factors."""
        given = f"{self.identity}/{digest_of(self.study.method.model_dump())}"
        stems = {}
        keys = []
        for pair, factor in zip(
            zip(cases["arch"].tolist(), cases["record"].tolist()),
            self.factors(cases).astype("<f8"),
        ):
            if pair not in stems:
                own = f"{given}/{self.arches[pair[0]].chain}/{self.records[pair[1]].samples}/"
                shock = self.shock(*pair)
                if shock is not None:
                    first, scale, gap = shock
                    own += f"{first.samples}/{scale.hex()}/{gap.hex()}/"
                stems[pair] = hashlib.blake2b(own.encode(), digest_size=KEY)
            state = stems[pair].copy()
            state.update(factor.tobytes())
            keys.append(state.digest())
        return np.array(keys, f"S{KEY}")

    def requests(self, batch: int = 0, batches: int = 1) -> dict[int, Requests]:
        """Return the generators of requests by arch, for one of several batches.

        `batches` is their number. An arch without a run in the batch has no generator. InputError
        if `batch` is not from 0 to batches - 1.
        """
        if not 0 <= batch < batches:
            raise InputError(f"--batch {batch}: must be from 0 to {batches - 1}")
        design = self.study.design
        asked = levels_asked(self.study, self.records)
        requests = {}
        # Records are ordered by their names, so that the order in the study changes nothing.
        turns = [zlib.crc32(record.id.encode()) for record in self.records]
        # An adaptive design has all runs of an arch in one batch: it needs all their verdicts.
        shares = 1 if design.adaptive else len(turns)
        for arch, member in enumerate(self.arches):
            records = np.argsort(turns, kind="stable")
            share = arch * shares + records % shares
            records = records[share % batches == batch]
            if records.size:
                about = (
                    self.levels,
                    self.unscaled[records],
                    self.power,
                    zlib.crc32(member.id.encode()),
                    asked[records],
                )
                requests[arch] = design.requests(Grid(arch, records, *about))
        return requests


def make_plan(study: StudyKeys) -> Plan:
    """Return the plan of a study whose motions are prepared."""
    return Plan(study, study.members, tuple(load_prepared(study)))


def write_part(folder: Path, table: Table) -> Path:
    """Write rows to a part, named by the hash of its content; return its path."""
    content = io.BytesIO()
    np.save(content, table, allow_pickle=False)
    name = hashlib.blake2b(content.getbuffer(), digest_size=KEY).hexdigest()
    path = folder / f"{name}.npy"
    # Not made lasting: what a power cut tears, `read_part` takes for missing.
    with replacing(path, lasting=False) as temporary:
        temporary.write_bytes(content.getbuffer())
    return path


def read_part(path: Path) -> Table | None:
    """Return the rows of a part; None if it is damaged or of another version of archfrag."""
    try:
        content = path.read_bytes()
        if hashlib.blake2b(content, digest_size=KEY).hexdigest() != path.stem:
            return None
        start = content.index(b"\n") + 1
        if _dtype_of(content[:start]) != ROW:
            return None
        return np.frombuffer(content, ROW, offset=start)
    except (OSError, ValueError):
        return None


@lru_cache
def _dtype_of(header: bytes) -> np.dtype:
    """Return the dtype that the header of a part states.

    It is cached, since reading the headers of many parts takes longer than reading their rows.
    """
    file = io.BytesIO(header)
    np.lib.format.read_magic(file)
    return np.lib.format.read_array_header_1_0(file)[2]


def read_parts(folder: Path) -> Table:
    """Return the rows of all parts in a folder, sorted by key.

    A row takes about 300 bytes, twice as much while rows are sorted.
    """
    paths = sorted(folder.glob("*.npy"))
    # Memory of small files would be kept by the process, that of some together is given back.
    some = (paths[i : i + _TOGETHER] for i in range(0, len(paths), _TOGETHER))
    return joined(joined(map(read_part, own)) for own in some)


def joined(parts: Iterable[Table | None]) -> Table:
    """Return the rows of several tables, sorted by key; None stands for a damaged part."""
    known = [part for part in parts if part is not None and part.size]
    keys = np.concatenate([np.empty(0, ROW["key"]), *(part["key"] for part in known)])
    order = np.argsort(keys, kind="stable")
    if len(known) == 1 and (np.diff(order) == 1).all():
        return known[0]
    # From the parts straight to their places: a million rows take 260 MB.
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    table = np.empty(order.size, ROW)
    rows = table.view(_WHOLE)
    for part, at in zip(known, np.split(place, np.cumsum([*map(len, known)])[:-1])):
        rows[at] = part.view(_WHOLE)
    return table


def places(table: Table, keys: Keys) -> IntArray:
    """Return the index of the row with each key, (n,); -1 if the table has none.

    The rows of the table must be sorted by key.
    """
    known = np.append(table["key"], b"")  # which is no key
    at = np.searchsorted(known[:-1], keys)
    return np.where(known[at] == keys, at, -1)


def gather(plan: Plan) -> tuple[Cases, Table, dict[int, Named]]:
    """Return all runs of a plan, their results, and by arch the facts that the design returned.

    Runs and results are sorted by arch, record and place. InputError if results are missing.
    """
    table = read_parts(plan.parts)
    found = list[IntArray]()

    def known(cases: Cases) -> Verdicts:
        at = places(table, plan.keys(cases))
        missing = np.count_nonzero(at < 0)
        if missing:
            raise InputError(
                f"{plan.parts.parent}: {missing} of {at.size} runs are missing or damaged; "
                f"`archfrag run` with the file of study {plan.study.id!r} makes them"
            )
        found.append(at)
        verdicts: Verdicts = table["verdict"][at]
        return verdicts

    cases, facts = ask(plan.requests(), known)
    order = order_of(cases)
    # `take` copies whole rows.
    return cases.take(order), table.take(np.concatenate(found)[order]), facts


def superfluous(plan: Plan) -> dict[str, list[Path]]:
    """Return the stored parts that a study no longer needs, by reason.

    A file that is not named like a part is left out.
    """
    found: dict[str, list[Path]] = {}
    requested = None
    # If results are missing, it is not known what the design will request.
    with contextlib.suppress(InputError):
        requested = plan.keys(gather(plan)[0])
    for path in sorted(plan.parts.parent.glob("*/*.npy")):
        table = read_part(path)
        if path.parent != plan.parts:
            why = "of other kernels or another version"
        elif table is None:
            why = "that are damaged"
        elif requested is None or np.isin(table["key"], requested).any():
            continue
        else:
            why = "that the study does not ask for"
        if re.fullmatch(r"[0-9a-f]{32}", path.stem):
            found.setdefault(why, []).append(path)
    return found
