"""``index.csv``, the table of the records in a folder: one row for each record."""

import contextlib
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from archfrag.errors import InputError, RecordError
from archfrag.files import (
    Named,
    number,
    opened,
    parse_table,
    portable,
    read_text,
    sha256_of,
    unquoted,
    write_csv,
)
from archfrag.motions.calibrate import accepted_words
from archfrag.motions.channel import Acceptable, unit_factor
from archfrag.motions.formats.columns import Columns, parse_columns
from archfrag.properties import unusual

INDEX_NAME = "index.csv"
COLUMNS = (
    "id",
    "file",
    "sha256",
    "event",
    "Mw",
    "distance_km",
    "Vs30_mps",
    "component",
    "dt_s",
    "unit",
    "terms",
    "seed",
    "event_seed",
    "site_seed",
    "model",
)
LARGEST_INDEX = 50_000_000  # [bytes], [characters]
LONGEST_ID = 255
_NEEDED = ("id", "file", "unit")
_OF_LEVEL = ("scale", "selection")  # columns that may differ between rows of a record
# Type of a number, and the least and largest that is possible.
_NUMBERS: dict[str, tuple[Any, float, float]] = {
    "Mw": (float, 0.0, 10.0),
    "distance_km": (float, 0.0, 20_040.0),
    "Vs30_mps": (float, 1.0, 1e4),
    "dt_s": (float, 1e-6, 10.0),
    "level": (float, 1e-9, 1e9),
    **dict.fromkeys(("seed", "event_seed", "site_seed"), (int, -np.inf, np.inf)),
}
_STEMS = {
    "distance": "distance_km",
    "vs30": "Vs30_mps",
    "dt": "dt_s",
    "mw": "Mw",
    "level": "level",
}
_APART = (*_NEEDED, "sha256", "accept", "accepted", "columns", "level")


def goes_with_records(path: Path) -> bool:
    """Tell whether a file is no record but belongs to records: StationXML, or an index."""
    return path.suffix.lower() == ".xml" or path.name == INDEX_NAME


@dataclass(frozen=True)
class IndexEntry:
    """One row of an index; `accept` and `columns` are as in `archfrag.read_motion`."""

    id: str
    path: Path
    sha256: str  # of the file, or its first digits; empty if not listed
    metadata: Named  # other columns: numbers as such or None, others as text
    unit: str = ""  # empty if the file or its StationXML states it
    accept: tuple[Acceptable, ...] = ()
    columns: Columns | None = None
    cautions: tuple[str, ...] = ()
    levels: tuple[float, ...] = ()  # of the study, at which alone it is run; () for all

    def alike(self, other: "IndexEntry") -> bool:
        """Tell whether two rows state the same record at different levels."""
        bare = [
            (
                replace(each, levels=(), metadata={}),
                {k: v for k, v in each.metadata.items() if k not in _OF_LEVEL},
            )
            for each in (self, other)
        ]
        apart = not {*self.levels} & {*other.levels}
        return bool(self.levels and other.levels) and apart and bare[0] == bare[1]

    @property
    def options(self) -> Named:
        """Return how the file is read, as options of `archfrag.read_motion`."""
        return {
            "unit": self.unit or None,
            "accept": self.accept,
            "columns": self.columns,
        }


def load_index(path: str | Path) -> list[IndexEntry]:
    """Read an ``index.csv``, or the one in a folder.

    Columns ``id``, ``file`` and ``unit`` are needed; see ``COLUMNS`` for the others. Of a file
    with several horizontals ``component`` names the one that is meant. Columns ``accept`` and
    ``columns`` are options of reading. Rows of one record that differ in ``level`` (and in
    ``scale`` and ``selection``) are one entry. RecordError for a missing or wrong column or value.
    """
    source = Path(path)
    source = source / INDEX_NAME if source.is_dir() else source
    names, rows = _table(source)
    for column in _NEEDED:
        if column not in names:
            raise RecordError(f"{source}: column {column!r} is missing from the index")
    for name in names:  # such as distance [m] or dt_ms
        known = _STEMS.get(re.split(r"[\s_\[(]", name)[0].casefold(), name)
        if known.casefold() != name.casefold():
            raise RecordError(
                f"{source}: column {name!r} is not known; write {known}, with numbers in the "
                "unit that its name states (of level: that of the study's levels)"
            )
    entries: dict[str, IndexEntry] = {}
    files: dict[Any, str] = {}
    for line, values in rows:
        place = f"{source}, line {line}"
        entry = _entry(source, place, values)
        own = entries.get(entry.id)
        if own:
            if not own.alike(entry):
                raise RecordError(
                    f"{place}: id {entry.id!r} occurs twice; its rows may differ in level only"
                )
            entries[entry.id] = replace(own, levels=(*own.levels, *entry.levels))
            continue
        component = str(entry.metadata.get("component") or "")
        what = os.path.realpath(entry.path), component, entry.columns
        other = files.setdefault(what, entry.id)
        if other != entry.id:
            raise RecordError(
                f"{place}: ids {other!r} and {entry.id!r} are of one file, {values['file']}, "
                "and one component; each record counts once"
            )
        entries[entry.id] = entry
    return list(entries.values())


def _entry(source: Path, place: str, values: dict[str, str]) -> IndexEntry:
    """Return a row of the index `source`; RecordError, which names `place`, for a wrong value."""
    name = values["id"]
    if not name or not values["file"]:
        raise RecordError(f"{place}: {'file' if name else 'id'} is empty")
    if len(name) > LONGEST_ID or "/" in name or not name.isprintable():
        raise RecordError(
            f"{place}: id {name[:40]!r} is too long, or has a / or line breaks"
        )
    if values["unit"]:
        unit_factor(values["unit"], place)
    metadata: Named = {key: value for key, value in values.items() if key not in _APART}
    cautions = list[str]()
    for column in filter(metadata.__contains__, _NUMBERS):
        text = metadata[column]
        metadata[column] = _number(column, text, place) if text else None
        cautions += unusual(column, metadata[column])
    columns = None
    level = values.get("level")
    if values.get("columns"):
        try:
            columns = parse_columns(values["columns"])
        except InputError as error:
            raise RecordError(f"{place}: {error}") from None
    path = Path(portable(str(source.parent / values["file"])))
    return IndexEntry(
        name,
        path,
        values.get("sha256", ""),
        metadata,
        values["unit"],
        accepted_words(values.get("accept", ""), place),
        columns,
        tuple(cautions),
        (_number("level", level, place),) if level else (),
    )


def _number(column: str, text: str, place: str) -> float:
    """Return the number in a cell of `column`; RecordError if it is none, or impossible."""
    kind, least, most = _NUMBERS[column]
    try:
        number(text)
        value = kind(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise RecordError(f"{place}: {column} = {text!r} is not a number")
    if not least <= value <= most:
        raise RecordError(
            f"{place}: {column} = {text} is impossible; it must be {least:g} to {most:g}, or "
            "empty if it is not known"
        )
    return kind(value)


def _table(source: Path) -> tuple[list[str], list[tuple[int, dict[str, str]]]]:
    """Return the columns of an index, and its rows with the numbers of their lines."""
    text = read_text(source, LARGEST_INDEX, RecordError, "the index")
    try:
        names, rows = parse_table(text, comments=False)
    except InputError as error:
        raise RecordError(f"{source}: {error}") from None
    names = ["level" if name.casefold() == "level" else name for name in names]
    return names, [
        (line, dict(zip(names, map(unquoted, cells)))) for line, cells in rows
    ]


def find_entry(path: str | Path) -> IndexEntry:
    """Return the row that lists a file in the index of its folder, or of the folder above.

    If there is none, the row has no id.
    """
    record = Path(os.path.realpath(path))  # which takes links that form a circle
    for folder in (record.parent, record.parent.parent):
        index = folder / INDEX_NAME
        if index.is_file():
            state = index.stat()
            rows = _by_path(index, state.st_mtime_ns, state.st_size)
            if record in rows:
                return rows[record]
    return IndexEntry("", record, "", {})


@lru_cache(maxsize=4)
def _by_path(index: Path, changed: int, size: int) -> dict[Path, IndexEntry]:
    """Return the rows of an index by the paths of their files.

    There are none if the file is another program's. Rows are kept, since thousands of files may
    lie in a folder; with another time of change [ns] or size the index is read again.
    """
    with contextlib.suppress(OSError):
        with opened(index) as file:
            lines = (file.readline(10_000) for _ in range(2))  # of Excel the second
            head = b"".join(lines).decode("latin-1")
        # Other programs have a file of this name, too.
        if set(_NEEDED) <= set(re.findall(r"\w+", head)):
            rows = reversed(load_index(index))
            return {Path(os.path.realpath(entry.path)): entry for entry in rows}
    return {}


def index_table(folder: str | Path) -> dict[str, dict[str, str]]:
    """Return the rows of the index of a folder by id, as text; none if there is no index."""
    path = Path(folder) / INDEX_NAME
    if not path.exists():
        return {}
    load_index(path)
    return {row["id"]: row for _, row in _table(path)[1]}


def write_index(folder: str | Path, rows: Iterable[Mapping[str, Any]]) -> Path:
    """Write the index of a folder; columns beyond ``COLUMNS`` come last."""
    import pandas as pd  # start-up: studies read indices without it

    path = Path(folder) / INDEX_NAME
    table = pd.DataFrame(list(rows), dtype=object)
    others = [name for name in table if name not in COLUMNS]
    write_csv(path, [table.reindex(columns=[*COLUMNS, *others])])
    return path


def check_sha256(entry: IndexEntry) -> None:
    """Raise RecordError unless the file of a row has the sha256 that the row lists (if any)."""
    try:
        digest = sha256_of(entry.path) if entry.sha256 else ""
    except OSError as error:
        raise RecordError(
            f"{entry.path}: listed, but cannot be read ({error.strerror})"
        ) from None
    if not digest.startswith(entry.sha256.lower()):
        raise RecordError(
            f"{entry.path}: sha256 is {digest[:16]}…, the index lists {entry.sha256[:16]}…; "
            "the file has changed since it was listed"
        )
