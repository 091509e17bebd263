"""All arches of a study: those of its entries, samples drawn for them, and rows of tables."""

import hashlib
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import ValidationError

from archfrag.errors import GeometryError, InputError, StabilityError, StudyError
from archfrag.files import counted, read_text
from archfrag.study.file.arches import COLUMNS, NUMBERS, ArchEntry
from archfrag.study.file.messages import first_message, meant, parse_value, read_csv
from archfrag.study.file.samples import draw, listed

MOST_CHECKED = 500  # arches that are built to validate a study; a run builds all of them
MOST_MEMBERS = 20_000  # arches of a study, sampled ones counted each
SHOWN = 12  # arches that a report shows one by one; of more it shows three
MOST_ROWS, LARGEST_TABLE = 10_000, 20_000_000  # [1], [bytes]
_ALIKE = 0.85  # of a column's name to a key, by difflib's ratio, for a slip of the keyboard


@dataclass(frozen=True)
class Member:
    """An arch of a study."""

    entry: ArchEntry  # the arch as a study file could have given it; its `id` is unique
    # Id of the study's entry that it was drawn for or listed in; its own id otherwise.
    arch_class: str
    place: str  # where it comes from, for messages
    number: int = 0  # of the sample, from 1; 0 if it was not drawn
    record: int | None = None  # place of the one record that it meets, from 0; None: it meets all
    # What it differs by within its class: numbers drawn, and numbers from a table [SI, degrees].
    values: dict[str, float] = field(default_factory=dict)
    attributes: dict[str, str] = field(default_factory=dict)  # text from a table

    @property
    def id(self) -> str:
        """Name of the arch in results."""
        return self.entry.id

    @cached_property
    def chain(self) -> str:
        """Digest of the arrays that the kernels get of the arch."""
        digest = hashlib.sha256()
        for name, value in self.entry.build().chain._asdict().items():
            array = np.ascontiguousarray(value, "<f8")
            digest.update(f"{name} {array.shape} ".encode() + array.tobytes())
        return digest.hexdigest()


class Members(tuple[Member, ...]):
    """All arches of a study, in the order of its entries."""

    __slots__ = ()

    @property
    def entries(self) -> tuple[ArchEntry, ...]:
        """Arches, each with `build()`, `id` and `parameters`."""
        return tuple(member.entry for member in self)

    @property
    def ids(self) -> list[str]:
        """Names of the arches."""
        return [member.id for member in self]

    @property
    def classes(self) -> list[str]:
        """Class of each arch."""
        return [member.arch_class for member in self]

    def parameters(self) -> dict[str, NDArray[np.float64]]:
        """Numbers in which arches of a class differ: name to (n_arch,); nan where fixed."""
        table = pd.DataFrame([member.values for member in self])
        return {str(name): column.to_numpy(float) for name, column in table.items()}

    def attributes(self) -> dict[str, list[str]]:
        """Attributes from tables: name to one text for each arch; empty where it has none."""
        table = pd.DataFrame([member.attributes for member in self], dtype=object).fillna("")
        return {str(name): column.tolist() for name, column in table.items()}

    def checked(self) -> "Members":
        """All arches; if there are very many, some of them at equal distances."""
        return Members(self[:: -(-len(self) // MOST_CHECKED) or 1])

    def meets(self, n_record: int) -> NDArray[np.bool_]:
        """Which arch meets which record, (n_arch, n_record)."""
        own = np.array([-1 if m.record is None else m.record for m in self])
        return (own[:, None] < 0) | (own[:, None] == np.arange(n_record))

    def summaries(self) -> tuple[str, ...]:
        """Classes whose arches were drawn or come from a table: how many, and how they differ."""
        found = []
        for name, alike in groupby(self, attrgetter("arch_class")):
            own = Members(alike)
            if all(member.number == 0 and member.id == name for member in own):
                continue
            parts = [f"{name}: {counted(len(own), 'arch')}"]
            for key, values in own.parameters().items():
                low, high = np.nanmin(values), np.nanmax(values)
                parts.append(f"{key} {low:.4g}" + (f" to {high:.4g}" if high > low else ""))
            parts += [f"{len(set(texts))} of {key}" for key, texts in own.attributes().items()]
            found.append(", ".join(parts))
        return tuple(found)


def shown(theta: Sequence[float]) -> list[int]:
    """Places of the arches that a report shows one by one, by their median capacities.

    All of up to `SHOWN`; of many the weakest, the middle and the strongest. A capacity is nan
    where there is no curve.

    Examples
    --------
    >>> from archfrag.study.file.members import shown
    >>> shown([2.0, 1.0]), shown([0.1 * i for i in range(20)])
    ([0, 1], [0, 10, 19])
    """
    if len(theta) <= SHOWN:
        return list(range(len(theta)))
    order = np.argsort(np.asarray(theta, dtype=float), kind="stable")
    known = order[: max(1, int(np.isfinite(theta).sum()))]
    return sorted({int(known[0]), int(known[len(known) // 2]), int(known[-1])})


def needs_records(entries: Sequence[ArchEntry]) -> bool:
    """Whether the arches depend on the number of records: some class has `crossed: false`."""
    return any(entry.vary is not None and not entry.vary.crossed for entry in entries)


def expand(entries: Sequence[ArchEntry], n_record: int | None = None) -> Members:
    """List all arches of the entries of a study file.

    The number of records is needed where a class has `crossed: false`. StudyError if a table or
    drawing cannot be used, two arches have the same id, or there are too many.
    """
    found: list[Member] = []
    seen: dict[str, str] = {}
    for i, entry in enumerate(entries):
        where = f"arches[{i}] ({entry.id})"
        try:
            if entry.table is None:
                bases = [Member(entry.read(), entry.id, where)]
            else:
                bases = [replace(row, place=f"{where}: {row.place}") for row in read_table(entry)]
        except (GeometryError, StudyError) as error:
            raise StudyError(f"{where}: {error}") from None
        new = [member for base in bases for member in _drawn(base, n_record, entry)]
        found += new
        if len(found) > MOST_MEMBERS:
            most = f"makes {len(found)} arches with those before it"
            raise StudyError(f"{where}: {most}; a study must have at most {MOST_MEMBERS}")
        for name in dict.fromkeys((entry.id, *(member.id for member in new))):
            if name in seen:
                raise StudyError(f"{where}: the id {name!r} already belongs to {seen[name]}")
            seen[name] = where
    return Members(found)


def _drawn(base: Member, n_record: int | None, entry: ArchEntry) -> Iterator[Member]:
    """The samples of an arch, or itself if it does not vary."""
    vary = base.entry.vary
    if vary is None:
        yield base
        return
    owners: list[int | None] = [None] * vary.samples
    if not vary.crossed:
        if n_record is None:
            text = "has crossed: false, and the number of records is not known"
            raise StudyError(f"{base.place}: {text}")
        owners = [record for record in range(n_record) for _ in range(vary.samples)]
    if len(owners) > MOST_MEMBERS:
        most = f"a study must have at most {MOST_MEMBERS}"
        raise StudyError(f"{base.place}: makes {len(owners)} arches; {most}")
    # Rows of a table are drawn independently, whatever other rows there are.
    stream = () if entry.table is None else (zlib.crc32(base.id.encode()),)
    try:
        drawn = draw(base.entry, len(owners), stream)
    except InputError as error:
        raise StudyError(f"{base.place}: {error}") from None
    for number, ((arch, values), record) in enumerate(zip(drawn, owners), start=1):
        own = base.values | values
        yield replace(base, entry=arch, number=number, record=record, values=own)


def read_table(entry: ArchEntry) -> list[Member]:
    """Read the arches of a table; keys of the entry fill the cells that a row leaves empty."""
    path = Path(entry.table or "")
    text = read_text(path, LARGEST_TABLE, StudyError, "the table")
    try:
        rows = read_csv(text)
    except InputError as error:
        raise StudyError(f"{path}: {error}") from None
    _check_table(rows, path)
    defaults = entry.model_dump(exclude={"id", "table"}, exclude_unset=True, exclude_none=True)
    found = []
    for cells in rows:
        place = f"{path}, arch {cells['id']}"
        own = {key: _value(text, f"{place}, column {key}") for key, text in cells.items()
               if key in COLUMNS and key != "id" and text}  # fmt: skip
        given = {**defaults, **own, "id": cells["id"]}
        try:
            arch = ArchEntry.model_validate(given)
        except ValidationError as error:
            message = first_message(error, given)
            column = re.split(r"[ .\[]", message, maxsplit=1)[0] in cells
            raise StudyError(f"{place}, {'column ' if column else ''}{message}") from None
        # Of rows that leave a cell empty too: the study's entry gives what they have.
        values = {key: getattr(arch, key) for key in cells if key in NUMBERS}
        numbers = {k: float(v) for k, v in values.items() if isinstance(v, float | int)}
        attributes = {key: text for key, text in cells.items() if key not in COLUMNS}
        found.append(Member(arch, entry.id, place, values=numbers, attributes=attributes))
    return found


def _check_table(rows: list[dict[str, str]], path: Path) -> None:
    """Check that arches of a table have different ids, and no column is a misspelt key."""
    if not 1 <= len(rows) <= MOST_ROWS:
        raise StudyError(f"{path}: has {len(rows)} arches; it must have 1 to {MOST_ROWS}")
    for name in rows[0]:
        if name in ("vary", "recess"):
            raise StudyError(f"{path}: give {name} in the study file, not in a column")
        if name not in COLUMNS and (hint := meant(name.lower(), COLUMNS, _ALIKE)):
            rule = "give an attribute a name less like it"
            raise StudyError(f"{path}: column {name} is not a key of an arch; {hint} ({rule})")
    if "id" not in rows[0]:
        raise StudyError(f"{path}: a column id is missing; commas must be between columns")
    name, count = Counter(row["id"] for row in rows).most_common(1)[0]
    if count > 1:
        raise StudyError(f"{path}: {count} arches have the id {name!r}")


def _value(text: str, place: str) -> Any:
    """Content of a cell: numbers as spreadsheets write them, else as YAML."""
    try:
        number = float(text)
    except ValueError:
        return parse_value(text, place) if text[0] in "[tTfF" else text
    # A spreadsheet may write 7 as 7.0, where an integer is needed.
    return int(number) if abs(number) < 1e15 and number == int(number) else number


def check_buildable(given: Members) -> None:
    """Check that all arches can exist; StudyError names the first that cannot."""
    wrong: list[tuple[Member, GeometryError]] = []
    for member in given:
        try:
            member.entry.build()
        except GeometryError as error:
            wrong.append((member, error))
    if wrong:
        first, why = wrong[0]
        which = _samples(given, [member for member, _ in wrong])
        where = f"{first.place}: cannot exist: {which}" if first.number else first.place
        raise StudyError(f"{where}: {why}") from why


def check_standing(given: Members) -> None:
    """Check that all arches can exist (or StudyError) and stand (or StabilityError)."""
    from archfrag.simulate import onset

    check_buildable(given)
    unstable = [member for member in given if not onset(member.entry.build()).stands]
    if unstable:
        where, advice = f"{unstable[0].place}: does not stand under its own weight", ""
        if unstable[0].number:
            advice = "narrow the distributions by lower and upper, "
            where += f": {_samples(given, unstable)}; such an arch has no fragility"
        raise StabilityError(f"{where}; {advice}make it thicker or raise the friction")


def _samples(given: Members, some: Sequence[Member]) -> str:
    """Count the wrong samples of the first one's class, and show what was drawn for it."""
    first = some[0]
    alike, drawn = (sum(m.place == first.place for m in each) for each in (some, given))
    values = listed(first.values)
    return f"{alike} of {drawn} samples, the first is sample {first.number} ({values})"
