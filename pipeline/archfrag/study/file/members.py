"""All arches of a study: those of its entries, samples drawn for them, and rows of tables."""

import hashlib
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from archfrag.errors import GeometryError, InputError, StabilityError
from archfrag.files import read_text
from archfrag.study.file import first_message, meant, parse_value, read_csv
from archfrag.study.file.arches import COLUMNS, ArchEntry
from archfrag.study.file.vary import VARIABLE

MOST_CHECKED = 500  # arches that are built to validate a study; a run builds all of them
MOST_MEMBERS = 20_000  # arches of a study, sampled ones counted each
SHOWN = 12  # arches that a report shows one by one; of more it shows three
LARGEST_TABLE = 20_000_000  # [bytes]
_ALIKE = 0.85  # of a column's name to a key, by difflib's ratio, for a slip of the keyboard


@dataclass(frozen=True)
class Member:
    """An arch of a study."""

    entry: ArchEntry  # the arch as a study file could have given it; its `id` is unique
    # Id of the study's entry that it was drawn for or listed in; its own id otherwise.
    arch_class: str
    place: str  # where it comes from and what was drawn for it, for messages
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
        names = dict.fromkeys(name for member in self for name in member.values)
        return {n: np.array([member.values.get(n, np.nan) for member in self]) for n in names}

    def attributes(self) -> dict[str, list[str]]:
        """Attributes from tables: name to one text for each arch; empty where it has none."""
        names = dict.fromkeys(name for member in self for name in member.attributes)
        return {name: [member.attributes.get(name, "") for member in self] for name in names}

    def checked(self) -> "Members":
        """All arches; if there are very many, some of them at equal distances."""
        return Members(self[:: -(-len(self) // MOST_CHECKED) or 1])


def shown(theta: Sequence[float]) -> list[int]:
    """Places of the arches that a report shows one by one, by their median capacities.

    All of up to `SHOWN`; of many the weakest, the middle and the strongest. nan: no curve.
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

    The number of records is needed where a class has `crossed: false`. InputError if a table or
    drawing cannot be used, two arches have the same id, or there are too many.
    """
    found: list[Member] = []
    seen: dict[str, str] = {}
    for i, entry in enumerate(entries):
        where, vary = f"arches[{i}] ({entry.id})", entry.vary
        try:
            plain = entry.table is None
            bases = [Member(entry.read(), entry.id, where)] if plain else [*_rows(entry, where)]
            each = 1 if vary is None else vary.samples * (1 if vary.crossed else n_record or 0)
            if (count := len(found) + each * len(bases)) > MOST_MEMBERS:
                most = f"a study must have at most {MOST_MEMBERS}"
                raise InputError(f"{where}: makes {count} arches with those before it; {most}")
            new = [member for base in bases for member in _drawn(base, n_record or 0)]
        except GeometryError as error:
            raise InputError(f"{where}: {error}") from None
        for name in dict.fromkeys((entry.id, *(member.id for member in new))):
            if name in seen:
                raise InputError(f"{where}: the id {name!r} already belongs to {seen[name]}")
            seen[name] = where
        found += new
    return Members(found)


def _drawn(base: Member, n_record: int) -> Iterator[Member]:
    """The samples of an arch, or itself if it does not vary."""
    vary = base.entry.vary
    if vary is None:
        yield base
        return
    records = [None] if vary.crossed else range(n_record)
    owners = [record for record in records for _ in range(vary.samples)]
    # Rows of a table are drawn independently, whatever other rows there are.
    stream = () if base.id == base.arch_class else (zlib.crc32(base.id.encode()),)
    plain = base.entry.model_dump(exclude_none=True, exclude={"vary"})
    n_joint = 0 if vary.joints is None else base.entry.build().n_joint
    drawn = vary.draw(plain, n_joint, len(owners), stream)
    for number, ((given, values), record) in enumerate(zip(drawn, owners), start=1):
        own = base.values | values
        told = ", ".join(f"{name} = {value:.6g}" for name, value in own.items()) or "joints"
        place = f"{base.place}: sample {number} ({told})"
        entry = _entry(given, place)
        yield replace(base, entry=entry, place=place, record=record, values=own)


def _entry(given: dict[str, Any], place: str) -> ArchEntry:
    try:
        return ArchEntry.model_validate(given)
    except ValidationError as error:
        raise InputError(f"{place}: {first_message(error, given)}") from None


def _rows(entry: ArchEntry, where: str) -> Iterator[Member]:
    """The arches of a table; keys of the entry fill the cells that a row leaves empty."""
    place = f"{where}: {entry.table}"
    text = read_text(Path(entry.table or ""), LARGEST_TABLE, InputError, f"{where}: the table")
    try:
        table = read_csv(text)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    if "id" not in table or table.empty:
        raise InputError(f"{place}: must have arches and a column id; commas between columns")
    for name in map(str, table):
        if name not in COLUMNS and (hint := meant(name.lower(), COLUMNS, _ALIKE)):
            rule = "give an attribute a name less like it"
            raise InputError(f"{place}: column {name} is not a key of an arch; {hint} ({rule})")
    if (twice := table["id"].duplicated()).any():
        raise InputError(f"{place}: several arches have the id {table['id'][twice].iloc[0]!r}")
    defaults = entry.model_dump(exclude={"id", "table"}, exclude_unset=True, exclude_none=True)
    keys = [name for name in map(str, table) if name in COLUMNS and name != "id"]
    numeric = [key for key in keys if key in ("voussoirs", *VARIABLE)]
    for row in table.to_dict("records"):
        own: dict[str, Any] = {}
        for key in filter(row.get, keys):
            try:  # numbers as spreadsheets write them, such as 7.0 for 7
                number = float(row[key])
                own[key] = int(number) if number.is_integer() else number
            except ValueError:
                own[key] = parse_value(row[key], f"{place}, column {key}")
        place_of_row = f"{place}, arch {row['id']}"
        arch = _entry({**defaults, **own, "id": row["id"]}, place_of_row)
        # Of rows that leave a cell empty too: the study's entry gives what they have.
        values = {key: getattr(arch, key) for key in numeric}
        numbers = {key: float(v) for key, v in values.items() if isinstance(v, float | int)}
        attributes = {str(key): text for key, text in row.items() if key not in COLUMNS}
        yield Member(arch, entry.id, place_of_row, values=numbers, attributes=attributes)


def check_buildable(given: Members) -> None:
    """Check that all arches can exist; InputError names the first that cannot."""
    for member in given:
        try:
            member.entry.build()
        except GeometryError as error:
            raise InputError(f"{member.place}: cannot exist: {error}") from error


def check_standing(given: Members) -> None:
    """Check that all arches can exist (or InputError) and stand (or StabilityError)."""
    from archfrag.simulate import onset

    check_buildable(given)
    for member in given:
        if not onset(member.entry.build()).stands:
            how = "make it thicker, raise the friction, or narrow the distributions of what varies"
            raise StabilityError(f"{member.place}: does not stand under its own weight; {how}")
