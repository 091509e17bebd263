"""Tables of arches: one in each row of a CSV, with attributes that are kept as text."""

import csv
import difflib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from archfrag.errors import StudyError
from archfrag.study.arches import ARCH_KEYS, NUMBER_KEYS, ArchEntry, Chain, Table
from archfrag.study.section import first_message
from archfrag.study.yaml_file import parse_value

MOST_ROWS, LARGEST_TABLE, LONGEST_CELL = 10_000, 20_000_000, 20_000  # [1], [bytes], [characters]
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NO_COLUMNS = ("vary", "recess")  # mappings
_ALIKE = 0.85  # of a column's name to a key, by difflib's ratio, for a slip of the keyboard


@dataclass(frozen=True)
class Row:
    """An arch of a table."""

    entry: Chain  # the arch, with what the table's entry gives for all
    numbers: dict[str, float]  # its numbers of the keys that are columns of the table
    # Its text from the columns that are no keys of an arch; empty cells too.
    attributes: dict[str, str]
    place: str  # file and line, for messages


def read_fleet(table: Table) -> list[Row]:
    """Arches of a table."""
    path = Path(table.table)
    columns, lines = _cells(path)
    _check_columns(columns, path)
    adapter: TypeAdapter[Any] = TypeAdapter(ArchEntry)
    defaults, seen, rows = table.defaults(), dict[str, int](), []
    for line, cells in lines:
        place = f"{path}, line {line}"
        if len(cells) != len(columns):
            raise StudyError(
                f"{place}: has {len(cells)} cells; it must have {len(columns)}, one for each "
                "column of the first line"
            )
        row = {key: cell.strip() for key, cell in zip(columns, cells)}
        name = row.pop("id")
        if name in seen:
            raise StudyError(
                f"{place}, column id: {name!r} is the id of line {seen[name]} too; each arch "
                "needs its own"
            )
        seen[name] = line
        own = {key: _value(text, f"{place}, column {key}") for key, text in row.items()
               if key in ARCH_KEYS and text}  # fmt: skip
        given = {**defaults, **own, "id": name}
        try:
            entry = adapter.validate_python(given)
        except ValidationError as error:
            raise StudyError(_message(error, given, columns, place)) from None
        # Of rows that leave a cell empty too: the study's entry gives what they have.
        found = {key: getattr(entry, key, None) for key in row if key in NUMBER_KEYS}
        numbers = {k: float(v) for k, v in found.items() if isinstance(v, float | int)}
        attributes = {key: text for key, text in row.items() if key not in ARCH_KEYS}
        rows.append(Row(entry, numbers, attributes, place))
    return rows


def _cells(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """First line of a table, and its other lines that are not empty with their numbers."""
    try:
        if not path.is_file():
            raise FileNotFoundError(2, "there is no such file")
        if path.stat().st_size > LARGEST_TABLE:
            raise StudyError(f"{path}: is too large; it must have at most {LARGEST_TABLE} bytes")
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            columns = [name.strip() for name in next(reader, [])]
            lines = [(reader.line_num, cells) for cells in reader if any(map(str.strip, cells))]
    except OSError as error:
        raise StudyError(f"{path}: the table cannot be read ({error.strerror})") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise StudyError(f"{path}: is no table in CSV and UTF-8 ({error})") from None
    if not lines:
        raise StudyError(f"{path}: must have a line for each arch below its first line")
    if len(lines) > MOST_ROWS:
        raise StudyError(f"{path}: has {len(lines)} arches; it must have at most {MOST_ROWS}")
    return columns, lines


def _check_columns(columns: list[str], path: Path) -> None:
    if "id" not in columns:
        apart = " (commas must be between them)" if len(columns) == 1 else ""
        raise StudyError(f"{path}, line 1: a column id is missing{apart}")
    for number, name in enumerate(columns):
        if not name or not name.isprintable():
            raise StudyError(f"{path}, line 1: column {number + 1} must have a name")
        if name in columns[:number]:
            raise StudyError(f"{path}, line 1: column {name} is there twice")
        if name in _NO_COLUMNS:
            raise StudyError(f"{path}, line 1: {name} must be given in the study file")
        close = difflib.get_close_matches(name.lower(), ARCH_KEYS, n=1, cutoff=_ALIKE)
        if close and name not in ARCH_KEYS:
            raise StudyError(
                f"{path}, line 1: column {name} is no key of an arch; did you mean {close[0]}? "
                "(an attribute must have a name less like it)"
            )


def _value(text: str, place: str) -> Any:
    """Content of a cell: numbers as spreadsheets write them, else as YAML."""
    if len(text) > LONGEST_CELL:
        raise StudyError(f"{place}: must have at most {LONGEST_CELL} characters")
    if _NUMBER.fullmatch(text):
        number = float(text)
        # A spreadsheet may write 7 as 7.0, where an integer is wanted.
        return int(number) if abs(number) < 1e15 and number == int(number) else number
    return text if text[0] not in "[tTfF.-+" else parse_value(text, place)


def _message(error: ValidationError, given: dict[str, Any], columns: list[str], place: str) -> str:
    message = first_message(error, given)
    column = re.split(r"[ .\[]", message, maxsplit=1)[0]
    return f"{place}, {'column ' if column in columns else ''}{message}"
