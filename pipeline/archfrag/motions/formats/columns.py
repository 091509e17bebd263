"""Plain text with numbers in columns, read as the user states, since nothing in it tells how."""

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from obspy import Trace

from archfrag import files
from archfrag.errors import InputError, RecordError
from archfrag.files import Named
from archfrag.motions.calibrate import plain_unit
from archfrag.motions.channel import Samples
from archfrag.motions.formats.layout import Text, number, search, split, trace_of

MOST_COLUMNS = 1000
# What lines before the numbers may state: units of columns (GeoCSV), a unit of acceleration, the
# step or the rate of samples, and their number.
_GEOCSV_UNITS = r"^#\s*field_unit\s*:(.*)$"
_UNIT = (
    r"(?i)(?:[\[(]\s*|\bin\s+(?:units\s+of\s+)?|\bunits?\s*(?:of|:|=)\s*)"
    r"(m?g|%g|m?gal|(?:[cm]?m|in|ft)\s*/\s*s(?:ec)?\s*(?:\^|\*\*)?\s*(?:2|Â?²|/\s*s(?:ec)?))s?(?![\w/])"
)
_VALUE = r"((?:\d+\.?\d*|\.\d+)(?:[Ee][-+]?\d+)?)"
_STEP = rf"(?:\bdt|\btime[ _-]?step|\b(?:sampl\w*|time)[ _]interval)\b[^\n\d.]{{0,15}}{_VALUE}"
_RATE = (
    rf"\bsampl\w*[^\n\d.]{{0,30}}{_VALUE}\s*(?:hz|sps)|\bsample_rate_hz\s*:\s*{_VALUE}"
)
_COUNT = (
    r"\b(?:npts|sample_count|number of (?:points|samples|data))\b\s*[:=]?\s*(\d+)\b"
)
_ALLOWED = "time=COLUMN, acceleration=COLUMN, vertical=COLUMN, dt=SECONDS, skip=LINES"


@dataclass(frozen=True)
class Columns:
    """Layout of numbers in a plain text: in columns counted from 1, or row after row.

    Semicolons, tabs, commas or blanks separate numbers, one of them in a file; empty lines and
    those that begin with # or % are passed over. InputError if the keys contradict each other.

    Parameters
    ----------
    acceleration, vertical : int, optional
        Columns of the horizontal and the vertical (upward) acceleration. Without them every
        number of the file is a sample of one motion, row after row.
    time, dt : int or float [s]
        Column of the times, evenly spaced, or the time step of a file without times.
    skip : int
        Lines before the first row.

    >>> str(Columns(time=1, acceleration=2))
    'acceleration=2 time=1'
    """

    acceleration: int | None = None
    time: int | None = None
    dt: float | None = None
    vertical: int | None = None
    skip: int = 0

    def __post_init__(self) -> None:
        every = (self.time, self.acceleration, self.vertical)
        columns = [column for column in every if column is not None]
        outside = next((c for c in columns if not 1 <= c <= MOST_COLUMNS), None)
        for wrong, needed in (
            ((self.time is None) == (self.dt is None), "either time or dt"),
            (
                self.dt is not None and not 0.0 < self.dt < np.inf,
                f"a positive dt, not {self.dt or 0.0:g}",
            ),
            (
                self.acceleration is None and columns,
                "acceleration where another column is named",
            ),
            (len(set(columns)) < len(columns), "a different number for each column"),
            (outside is not None, f"numbers from 1 to {MOST_COLUMNS}, not {outside}"),
            (self.skip < 0, f"skip of at least 0, not {self.skip}"),
        ):
            if wrong:
                raise InputError(f"columns {str(self)!r} must have {needed}")

    def __str__(self) -> str:
        """Return the text that `parse_columns` reads."""
        return " ".join(
            f"{key}={value:.15g}" for key, value in asdict(self).items() if value
        )


def parse_columns(text: str) -> Columns:
    """Read columns from words such as ``time=1,acceleration=2,skip=3``; InputError for others."""
    keys: Named = {}
    for word in text.replace(",", " ").split():
        key, _, value = word.partition("=")
        try:
            if key not in Columns.__annotations__ or key in keys:
                raise ValueError
            step = files.number(value)
            keys[key] = step if key == "dt" else int(value)
        except ValueError:
            raise InputError(
                f"columns {text!r}: {word!r} is not known or occurs twice; allowed are {_ALLOWED}"
            ) from None
    return Columns(**keys)


def read_columns(path: str | Path, columns: Columns) -> list[Trace]:
    """Read a plain text of numbers with the layout `columns`, in the unit of the file.

    Return one trace, or two (H and V) if a vertical column is named.
    """
    text = Text(path)
    name = str(path)
    lines = [
        (place, line.split("#")[0])
        for place, line in enumerate(text.lines, 1)
        if place > columns.skip and not line.lstrip().startswith(("#", "%", "sep="))
    ]
    named = (columns.time, columns.acceleration, columns.vertical)
    chosen = [column - 1 for column in named if column]
    separator = files.separator_of(line for _, line in lines)
    rows = files.cells_of(lines, separator)
    used = [number for number, _ in rows]
    try:
        table = _numbers(rows, separator, chosen)
        if chosen:
            files.check_counts(rows, separator)
            for column in chosen[columns.time is not None :]:
                files.check_thousands([row[column] for _, row in rows], f"{column + 1}")
                files.check_one_number(rows, column, separator)
        else:
            _refuse_columns(table, used)
    except InputError as error:
        raise RecordError(f"{name}, {error}") from None
    values = np.array([value for row in table for value in row], float)
    samples = values.reshape(-1, len(chosen) or 1).T
    if len(samples[0]) < 2:
        raise RecordError(
            f"{name}: holds {len(samples[0])} sample(s); 2 or more are needed"
        )
    _refuse_header(values, used[0], name)
    step = columns.dt
    if columns.time is not None:
        step = _even_step(samples[0], used, columns, name)
        samples = samples[1:]
        chosen = chosen[1:]
    before = (line for i, line in enumerate(text.head(0, 50), 1) if i not in {*used})
    head = "\n".join(before)
    traces = []
    for code, column, series in zip("HV", chosen or [0], samples):
        if _rises_evenly(series):
            raise RecordError(
                f"{name}: the column of accelerations rises evenly, as times do; name the "
                "columns of both"
            )
        facts = {
            "announced": int(search(_COUNT, head) or series.size),
            "code": code if columns.vertical else "",
            "vertical": code == "V",
            "log": [f"Columns {columns}."],
            "contradicted": _other_step(head, step or 0.0),
        }
        trace = trace_of(np.ascontiguousarray(series), step, name, facts)
        trace.stats._format = "COLUMNS"
        trace.stats.ascii = {"unit": _unit_in(head, column)}
        traces.append(trace)
    return traces


def _unit_in(head: str, column: int) -> str:
    """Return the unit of a column (counted from 0) by `head`, the lines before the numbers.

    It is empty unless they state just one. If they state none, but name a velocity or a
    displacement and no acceleration, this word is returned.
    """
    stated = search(_GEOCSV_UNITS, head)
    if stated:
        return re.split(r"[,;|\s]+", stated.strip())[: column + 1][-1]
    known = set(map(plain_unit, re.findall(_UNIT, head)))
    if not known and not re.search("(?i)accel", head):
        return search(r"\b(velocity|displacement)\b", head)
    return known.pop() if len(known) == 1 else ""


def _other_step(head: str, step: float) -> str:
    """Return a text if `head`, the lines before the numbers, states another step than `step` [s].

    It is empty if they state the same step or rate, or none.
    """
    rate = number(search(_RATE, head) or search(_RATE, head, 2))
    stated = number(search(_STEP, head)) or (1.0 / rate if rate else 0.0)
    if not stated or abs(stated - step) <= 0.01 * stated:
        return ""
    return (
        f"the lines before its numbers state a step of {stated:g} s, {step:g} s is used"
    )


def _refuse_header(values: Samples, line: int, name: str) -> None:
    """Raise RecordError if one of the first numbers is how many numbers follow."""
    for place, value in enumerate(values[:4].tolist(), 1):
        if value >= 20.0 and value in (values.size - place, values.size - 2):
            raise RecordError(
                f"{name}, line {line}: {value:g} is how many numbers follow; if it is a header, "
                "pass over it by skip"
            )


def _numbers(
    rows: Sequence[files.Row], separator: str, chosen: Sequence[int]
) -> list[list[float]]:
    """Return the numbers of each row; InputError for a cell that is no number.

    `chosen` are the columns that are read, counted from 0; all are read if it is empty.
    """
    table = []
    for line, row in rows:
        if chosen and len(row) <= max(chosen):
            raise InputError(
                f"line {line}: has {len(row)} column(s), column {max(chosen) + 1} is asked for; "
                "`skip` passes over lines before the numbers"
            )
        picked = [row[column] for column in chosen] or row
        if "" in picked:
            column = (chosen or range(len(row)))[picked.index("")] + 1
            raise InputError(
                f"line {line}: the cell in column {column} is empty; give it a number, or leave "
                "such rows out"
            )
        files.check_decimals((line, cell) for cell in picked)
        values = list[float]()
        for cell in picked:
            if separator != " " and re.search(r"\s", cell):
                raise InputError(
                    f"line {line}: {cell[:40]!r} is not a finite number; "
                    f"{files.NAMES[separator]} are between the cells of this file"
                )
            values += split(cell, f"line {line}")
        if len(values) != len(picked) and (chosen or separator != " "):
            raise InputError(f"line {line}: columns run together")
        table.append(values)
    cells = " ".join(cell for _, row in rows for cell in row)
    if rows and separator == "," and not re.search("[.Ee]", cells):
        raise InputError(
            f"line {rows[0][0]}: has only whole numbers, with commas between them: are the "
            "commas decimal? Write decimal points"
        )
    return table


def _refuse_columns(table: Sequence[list[float]], lines: Sequence[int]) -> None:
    """Raise InputError unless rows can be the samples of one motion, row after row.

    They must be equally long but for the last, and must not look like columns side by side.
    `lines` are their line numbers.
    """
    width = max(map(len, table), default=0)
    for line, row in zip(lines[:-1], table):
        if len(row) < width:
            raise InputError(
                f"line {line}: has fewer than {width} numbers; only the last row may"
            )
    full = np.array([row for row in table if len(row) == width])
    if width > 1 and _rises_evenly(full[:, 0]):
        raise InputError(
            f"line {lines[0]}: the first column rises evenly, as times do; name them by "
            "acceleration=COLUMN"
        )
    if width > 1 and len(full) >= 50:
        within, along = (np.abs(np.diff(full, axis=axis)).mean() for axis in (1, 0))
        between = np.abs(full[1:, 0] - full[:-1, -1]).mean()
        # Samples of one motion differ less from the next one than from one further on, and as much
        # within rows as between them: ratios of 84 real ones are at least 1.5, and 0.86 to 1.17.
        if along < 1.2 * within or between > 1.3 * within:
            raise InputError(
                f"line {lines[0]}: the {width} numbers a row are columns side by side, not one "
                f"motion row after row; name them by acceleration=COLUMN"
            )


def _rises_evenly(values: Samples) -> bool:
    """Return whether numbers rise in equal steps, as times do."""
    steps = np.diff(values)
    return bool(
        steps.size >= 4 and steps.min() > 0.0 and np.ptp(steps) < 1e-3 * steps.max()
    )


def _even_step(
    times: Samples, lines: Sequence[int], columns: Columns, name: str
) -> float:
    """Return the step of times [s]; RecordError unless they are evenly spaced but for rounding."""
    steps = np.diff(times)
    mean = (times[-1] - times[0]) / steps.size
    off = np.abs(times - (times[0] + mean * np.arange(times.size)))
    if steps.min() > 0.0 and off.max() <= 0.1 * mean:
        return float(f"{mean:.9g}")
    wrong = steps <= 0.0 if steps.min() <= 0.0 else np.abs(steps - mean)
    late = int(wrong.argmax()) + 1
    raise RecordError(
        f"{name}, line {lines[late]}: times must be evenly spaced, {times[late]:.9g} s in column "
        f"{columns.time} comes after {times[late - 1]:.9g} s; if times are only rounded, give dt "
        "instead of their column"
    )
