"""Cells of text files: the one separator of a file, its rows, and numbers that are ambiguous."""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from archfrag.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

Row = tuple[int, list[str]]  # number of the line, cells
NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}
_COMMA = re.compile(r"[-+]?\d+(,\d+)+(\.\d*)?([eE][-+]?\d+)?")
_POINT = re.compile(r"[-+]?\d*\.\d*([eE][-+]?\d+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}\.\d{3}")
_WHOLE = re.compile(r"[-+]?\d{1,3}")
_INTEGER, _THREE = re.compile(r"[-+]?\d+"), re.compile(r"\d{3}(\.\d*)?")
_ROUNDED = re.compile(r"[1-9]\d*(\.\d{1,3})?")  # at least 1, with at most three decimals


def separator_of(lines: Iterable[str]) -> str:
    """Return what separates the cells of some lines: semicolons, tabs, commas, else blanks."""
    rows = [line for line in lines if line.strip()]
    for mark, least in ((";", 0.5), ("\t", 1.0), (",", 0.5)):
        if rows and sum(mark in row for row in rows) >= least * len(rows):
            return mark
    return " "


def cells_of(lines: Iterable[tuple[int, str]], separator: str) -> list[Row]:
    """Split lines, each with its number, at the separator.

    Lines without a character are left out, as are columns at the right end that are empty.
    """
    rows = []
    for number, line in lines:
        if separator == " ":
            cells = re.split(r"[ \t]+", line.strip(" \t\r"))
        elif '"' in line:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        else:
            cells = line.split(separator)
        cells = [cell.strip(" \t\r") for cell in cells]
        if any(cells):
            rows.append((number, cells))
    while rows and all(len(cells) > 1 and not cells[-1] for _, cells in rows):
        rows = [(number, cells[:-1]) for number, cells in rows]
    return rows


def check_counts(rows: Sequence[Row], separator: str, count: int | None = None) -> None:
    """Raise InputError for the first row that has other than `count` cells, or than most have."""
    if count is None:
        count = Counter(len(cells) for _, cells in rows).most_common(1)[0][0] if rows else 0
    for number, cells in rows:
        if len(cells) != count:
            found = f"line {number} has {len(cells)} of {count} cells, {NAMES[separator]} between"
            if len(cells) > count:
                found = f"line {number} has {len(cells)} cells, the other rows have {count}"
            how = "a row is cut, or a comma, blank or other sign stands within a number"
            raise InputError(f"{found}: {', '.join(cells)[:60]!r}; {how}")


def check_decimals(cells: Iterable[tuple[int, str]]) -> None:
    """Raise InputError for a comma within a number: it is a decimal or separates thousands."""
    for number, cell in cells:
        if _COMMA.fullmatch(cell):
            how = "write decimal points, and no separators of thousands"
            raise InputError(f"line {number}: {cell!r} has a comma within a number; {how}")


def check_thousands(cells: Sequence[str], name: str) -> None:
    """Raise InputError for a column whose points may separate thousands: 1.193 beside 980."""
    dotted = [cell for cell in cells if "." in cell]
    whole = next((cell for cell in cells if "." not in cell), None)
    alike = all((_THOUSANDS if "." in cell else _WHOLE).fullmatch(cell) for cell in cells)
    if dotted and whole and alike:
        both = f"{dotted[0]} beside {whole}: do its points separate thousands?"
        raise _ambiguous(name, both, dotted[0])


def check_one_number(rows: Sequence[Row], column: int, separator: str) -> None:
    """Raise InputError if a separator stands within each number: 1,193.5 or 1 193.5 or 0,123."""
    pairs = [cells[column : column + 2] for _, cells in rows]
    if not all(len(pair) == 2 and _INTEGER.fullmatch(pair[0]) for pair in pairs):
        return
    rest = {other for _, other in pairs}
    thousands = separator in ", " and all(map(_THREE.fullmatch, rest))
    decimals = separator == "," and all(map(str.isdecimal, rest)) and len(set(map(len, rest))) == 1
    if len(rest) > 2 and (thousands or decimals):
        parts = f"{pairs[0][0]!r} and {pairs[0][1]!r} may be one number"
        how = f"{NAMES[separator]} are between the cells; put another sign there"
        raise InputError(f"line {rows[0][0]}: {parts}: {how}")


def check_years(cells: Sequence[str], name: str) -> None:
    """Refuse separators of thousands in return periods, such as 1.000, 2.475 and 5.000."""
    check_thousands(cells, name)
    dotted = [cell for cell in cells if _THOUSANDS.fullmatch(cell)]
    short = all(map(_ROUNDED.fullmatch, cells)) and max(map(float, cells)) < 100.0
    if dotted and (len(dotted) == len(cells) or short):
        shown = ", ".join(cells[:3])
        raise _ambiguous(name, f"{shown}: years, or thousands of years?", dotted[0])


def _ambiguous(name: str, found: str, cell: str) -> InputError:
    plain, other = cell.replace(".", ""), f"{cell}0"
    return InputError(f"column {name!r} has {found} Write {plain} or {other} for {cell}")


def with_points(rows: Sequence[Row], separator: str) -> list[Row]:
    """Replace decimal commas by points; InputError if a file has both, or commas between cells."""
    cells = [(number, cell) for number, row in rows for cell in row]
    commas = [each for each in cells if _COMMA.fullmatch(each[1])]
    point = next((each for each in cells if _POINT.fullmatch(each[1])), None)
    if separator == "," or any(cell.count(",") > 1 or "." in cell for _, cell in commas):
        check_decimals(commas)
    if commas and point:
        (line, cell), (other, its) = commas[0], point
        both = f"{cell!r} in line {line} has a comma, {its!r} in line {other} a point"
        raise InputError(f"{both}: one of the two must be the decimal in the whole file")
    return [(number, [cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell for cell in row])
            for number, row in rows]  # fmt: skip


def parse_table(text: str, comments: bool = True) -> tuple[str, list[str], list[Row]]:
    """Split a table: the separator of its first line, the names in it, and its rows.

    Lines that begin with # are left out if they are `comments`, and so are rows without a cell.
    InputError for a row with more or fewer cells than the first line, and a name that is missing
    or there twice.
    """
    if comments:
        text = re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
    separator = separator_of([next((line for line in text.splitlines() if line.strip()), "")])
    separator = "," if separator == " " else separator
    rows = list[Row]()
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    try:
        for row in reader:
            if any(cells := [cell.strip() for cell in row]):
                rows.append((reader.line_num, cells))
    except csv.Error as error:
        raise InputError(f"is not a table in CSV ({error})") from None
    if not rows:
        raise InputError("is not a table in CSV (No columns in it)")
    (head, names), *rows = rows
    kept = max((i for i, name in enumerate(names, 1) if name), default=0)
    # Spreadsheets may write empty cells beyond the last column.
    rows = [(number, cells if any(cells[kept:]) else cells[:kept]) for number, cells in rows]
    names = names[:kept]
    if twice := [name for name, times in Counter(names).items() if times > 1 or not name]:
        what = f"column {twice[0]!r} is there twice" if twice[0] else "a column has no name"
        raise InputError(f"line {head}: {what}; give each column a name of its own")
    check_counts(rows, separator, kept)
    return separator, names, rows


def table_of(names: Sequence[str], rows: Sequence[Row]) -> "pd.DataFrame":
    """Return rows as a table of text."""
    import pandas as pd  # takes a third of a second

    return pd.DataFrame([cells for _, cells in rows], columns=list(names), dtype=str)
