"""The arches that a study amounts to: its entries, what is drawn for them and rows of tables."""

import json
import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import groupby
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from archfrag.errors import GeometryError, InputError, StabilityError, StudyError
from archfrag.files import counted
from archfrag.study.arches import Chain, FromDrawing, StudyArch, Table, file_of
from archfrag.study.fleet import Member, draw, listed, read_fleet

if TYPE_CHECKING:
    from archfrag.study.config import Study

MOST_CHECKED = 500  # arches that are built to validate a study; a run builds all of them
MOST_MEMBERS = 20_000  # arches of a study, sampled ones counted each
SHOWN = 12  # arches that a report shows one by one; of more it shows three


class Members(tuple[Member, ...]):
    """All arches of a study, in the order of its entries."""

    __slots__ = ()

    @property
    def entries(self) -> tuple[Chain, ...]:
        """Arches, each with `build()`, `id` and `model_dump()`."""
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
        """What arches differ by within their classes: name to (n_arch,); nan where fixed."""
        columns = _columns([member.values for member in self], np.nan)
        return {name: np.array(values) for name, values in columns.items()}

    def attributes(self) -> dict[str, list[str]]:
        """Attributes from tables: name to one text for each arch; empty where it has none."""
        return _columns([member.attributes for member in self], "")

    def checked(self) -> "Members":
        """All arches, or of very many some at equal distances."""
        return Members(self[:: -(-len(self) // MOST_CHECKED) or 1])

    def meets(self, n_record: int) -> NDArray[np.bool_]:
        """Which arch meets which record, (n_arch, n_record)."""
        own = np.array([-1 if m.record is None else m.record for m in self])
        return (own[:, None] < 0) | (own[:, None] == np.arange(n_record))


def _columns(rows: Sequence[dict[str, Any]], missing: Any) -> dict[str, list[Any]]:
    """Values of all rows by name."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name, missing) for row in rows] for name in names}


def members(study: "Study", n_record: int | None = None) -> Members:
    """The arches of a study.

    Parameters
    ----------
    study : Study
    n_record : int, optional
        Records of the study; needed where a class has `crossed: false`.

    Returns
    -------
    Members

    Raises
    ------
    StudyError
        As `expand`.
    """
    return expand(study.arches, n_record)


def shown(theta: Sequence[float]) -> list[int]:
    """Places of the arches that a report shows one by one.

    All of up to `SHOWN`; of many the weakest, the middle and the strongest.

    Parameters
    ----------
    theta : sequence of float
        Median capacity of each arch; nan where there is no curve.

    Examples
    --------
    >>> from archfrag.study.members import shown
    >>> shown([2.0, 1.0]), shown([0.1 * i for i in range(20)])
    ([0, 1], [0, 10, 19])
    """
    if len(theta) <= SHOWN:
        return list(range(len(theta)))
    order = np.argsort(np.asarray(theta, dtype=float), kind="stable")
    known = order[: max(1, int(np.isfinite(theta).sum()))]
    return sorted({int(known[0]), int(known[len(known) // 2]), int(known[-1])})


def needs_records(entries: Sequence[Any]) -> bool:
    """Whether the arches depend on the number of records: some class has `crossed: false`."""
    return any(entry.vary is not None and not entry.vary.crossed for entry in entries)


def expand(entries: Sequence[Any], n_record: int | None = None) -> Members:
    """The arches that entries of a study file amount to."""
    text = json.dumps([entry.model_dump(exclude_none=True) for entry in entries])
    paths = [path for path in map(file_of, entries) if path is not None and path.is_file()]
    # What distinguishes an edited table from the one that was read.
    states = tuple((path.stat().st_mtime_ns, path.stat().st_size) for path in paths)
    return Members(_expanded(text, states, n_record))


def summaries(given: Members) -> tuple[str, ...]:
    """Classes whose arches were drawn or come from a table: how many, and what they differ by."""
    found = []
    for name, alike in groupby(given, attrgetter("arch_class")):
        own = Members(alike)
        if not any(member.number or member.id != name for member in own):
            continue
        parts = [f"{name}: {counted(len(own), 'arch')}"]
        for key, values in own.parameters().items():
            low, high = np.nanmin(values), np.nanmax(values)
            parts.append(f"{key} {low:.4g}" + (f" to {high:.4g}" if high > low else ""))
        parts += [f"{len(set(texts))} of {key}" for key, texts in own.attributes().items()]
        found.append(", ".join(parts))
    return tuple(found)


def check_buildable(given: Members) -> None:
    """See that all arches can exist."""
    wrong: list[tuple[Member, GeometryError]] = []
    for member in given:
        try:
            member.entry.build()
        except GeometryError as error:
            wrong.append((member, error))
    if wrong:
        first, why = wrong[0]
        some = [member for member, _ in wrong]
        which = f"cannot exist: {_samples(given, some)}: " if first.number else ""
        raise StudyError(f"{first.place}: {which}{why}") from why


def check_standing(given: Members) -> None:
    """See that all arches stand under their own weight."""
    from archfrag.simulate import onset

    check_buildable(given)
    fallen = [member for member in given if not onset(member.entry.build()).stands]
    if fallen:
        where, advice = f"{fallen[0].place}: does not stand under its own weight", ""
        if fallen[0].number:
            advice = "narrow the distributions by lower and upper, "
            where += f": {_samples(given, fallen)}; such an arch has no fragility"
        raise StabilityError(f"{where}; {advice}make it thicker or raise the friction")


def _samples(given: Members, some: Sequence[Member]) -> str:
    """How many samples of the first one's class are among some, and what was drawn for it."""
    first = some[0]
    alike, drawn = (sum(m.place == first.place for m in each) for each in (some, given))
    values = listed(first.values)
    return f"{alike} of {drawn} samples, the first is sample {first.number} ({values})"


# A study's arches are asked for by each of its steps.
@lru_cache(maxsize=8)
def _expanded(
    text: str, tables: tuple[tuple[int, int], ...], n_record: int | None
) -> tuple[Member, ...]:
    entries = TypeAdapter(list[StudyArch]).validate_python(json.loads(text))
    found: list[Member] = []
    seen: dict[str, str] = {}
    for i, entry in enumerate(entries):
        where = f"arches[{i}] ({entry.id})"
        if isinstance(entry, FromDrawing):
            try:
                entry = entry.read()
            except GeometryError as error:
                raise StudyError(f"{where}: {error}") from None
        new = _of_table(entry, where, n_record) if isinstance(entry, Table) else _of_entry(
            entry, entry.id, where, n_record
        )  # fmt: skip
        found += new
        if len(found) > MOST_MEMBERS:
            most = f"{MOST_MEMBERS} arches with those before it"
            raise StudyError(f"{where}: makes more than {most}; a study must have no more")
        for name in dict.fromkeys((entry.id, *(member.id for member in new))):
            if name in seen:
                whose = f"which belongs to {seen[name]}"
                raise StudyError(f"{where}: an arch has the id {name!r}, {whose}")
            seen[name] = where
    return tuple(found)


def _of_table(table: Table, where: str, n_record: int | None) -> list[Member]:
    try:
        rows = read_fleet(table)
    except StudyError as error:
        raise StudyError(f"{where}: {error}") from None
    found = []
    for row in rows:
        # Rows are drawn independently, whatever other rows there are.
        stream = (zlib.crc32(row.entry.id.encode()),)
        place = f"{where}: {row.place}"
        for member in _of_entry(row.entry, table.id, place, n_record, stream):
            values = {**row.values, **member.values}
            found.append(replace(member, values=values, attributes=row.attributes))
    return found


def _of_entry(
    entry: Chain, arch_class: str, where: str, n_record: int | None, stream: tuple[int, ...] = ()
) -> list[Member]:
    vary = entry.vary
    if vary is None:
        return [Member(entry, arch_class, 0, None, {}, {}, where)]
    if vary.crossed:
        owners: list[int | None] = [None] * vary.samples
    elif n_record is None:
        raise StudyError(f"{where}: has crossed: false, and the number of records is not known")
    else:
        owners = [record for record in range(n_record) for _ in range(vary.samples)]
    if len(owners) > MOST_MEMBERS:
        most = f"a study must have at most {MOST_MEMBERS}"
        raise StudyError(f"{where}: makes {len(owners)} arches; {most}")
    try:
        drawn = draw(entry, len(owners), stream)
    except InputError as error:
        raise StudyError(f"{where}: {error}") from None
    return [
        Member(concrete, arch_class, number, record, values, {}, where)
        for number, ((concrete, values), record) in enumerate(zip(drawn, owners), start=1)
    ]
