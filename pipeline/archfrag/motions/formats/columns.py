"""Plain text with numbers in columns, read as the user states: nothing in it names itself."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Trace

from archfrag.errors import InputError, RecordError
from archfrag.motions.formats.common import Text, split, trace_of

MOST_COLUMNS = 1000
_BETWEEN = str.maketrans(",;", "  ")
_ALLOWED = "time=COLUMN, acceleration=COLUMN, vertical=COLUMN, dt=SECONDS, skip=LINES"


@dataclass(frozen=True)
class Columns:
    """Layout of numbers in a plain text: in columns counted from 1, or row after row.

    Blanks, tabs, commas and semicolons separate numbers; empty lines and those that begin with
    # or % are passed over. InputError if the keys contradict each other.

    Parameters
    ----------
    acceleration, vertical : int, optional
        Columns of the horizontal and the vertical (upward) acceleration. Without them every
        number of the file is a sample, row after row.
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
        given = [c for c in (self.time, self.acceleration, self.vertical) if c is not None]
        outside = next((c for c in given if not 1 <= c <= MOST_COLUMNS), None)
        for wrong, needed in (
            ((self.time is None) == (self.dt is None), "either time or dt"),
            (self.dt is not None and not 0.0 < self.dt < float("inf"),
             f"a positive dt, not {self.dt or 0.0:g}"),
            (self.acceleration is None and given, "acceleration where another column is named"),
            (len(set(given)) < len(given), "a different number for each column"),
            (outside is not None, f"numbers from 1 to {MOST_COLUMNS}, not {outside}"),
            (self.skip < 0, f"skip of at least 0, not {self.skip}"),
        ):  # fmt: skip
            if wrong:
                raise InputError(f"columns {str(self)!r} must have {needed}")

    def __str__(self) -> str:
        """As `parse_columns` reads it."""
        return " ".join(f"{key}={value:.15g}" for key, value in asdict(self).items() if value)


def parse_columns(text: str) -> Columns:
    """Columns from words such as ``time=1,acceleration=2,skip=3``, or InputError."""
    given: dict[str, Any] = {}
    for word in text.replace(",", " ").split():
        key, _, value = word.partition("=")
        try:
            if key not in Columns.__annotations__ or key in given:
                raise ValueError
            given[key] = (float if key == "dt" else int)(value)
        except ValueError:
            wrong = f"{word!r} is not known or occurs twice"
            raise InputError(f"columns {text!r}: {wrong}; allowed are {_ALLOWED}") from None
    return Columns(**given)


def read_columns(path: str | Path, columns: Columns) -> list[Trace]:
    """Read a plain text of numbers, see `Columns`: one trace, or H and V, in the file's unit."""
    text, name = Text(path), str(path)
    lines = [(text.place(place), line) for place, line in enumerate(text.lines)
             if place >= columns.skip and not line.lstrip().startswith(("#", "%"))]  # fmt: skip
    comma = next((where for where, line in lines if "," in line), None)
    if comma is not None and not any("." in line for _, line in lines):
        commas = "numbers with commas and none with a decimal point"
        raise RecordError(f"{comma}: {commas}; write decimal points")
    rows = [(where, words) for where, line in lines if (words := line.translate(_BETWEEN).split())]
    chosen = [c - 1 for c in (columns.time, columns.acceleration, columns.vertical) if c]
    table = []
    for where, words in rows:
        if chosen and len(words) <= max(chosen):
            few = f"has {len(words)} column(s), column {max(chosen) + 1} is asked for"
            raise RecordError(f"{where}: {few}; `skip` passes over lines before the numbers")
        picked = [words[c] for c in chosen] or words
        table.append([value for word in picked for value in split(word, where)])
        if chosen and len(table[-1]) != len(chosen):
            raise RecordError(f"{where}: columns run together")
    values = np.array([value for row in table for value in row]).reshape(-1, len(chosen) or 1)
    if len(values) < 2:
        raise RecordError(f"{name}: holds {len(values)} sample(s); 2 or more are needed")
    timed, step = columns.time is not None, columns.dt
    if timed:
        step = _even_step(values[:, 0], [where for where, _ in rows], columns)
    # Rows of several numbers that each begin with a time are no samples row after row.
    paired = not chosen and {len(row) for row in table[:-1]} - {1}
    first = np.array([row[0] for row in table if paired])
    traces = []
    for index, code in enumerate(("H", "V") if columns.vertical else ("",), start=int(timed)):
        samples = np.ascontiguousarray(values[:, index])
        for steps in (np.diff(samples), np.diff(first)):
            if steps.size >= 4 and steps.min() > 0.0 and np.ptp(steps) < 1e-3 * steps.max():
                rises = "what would be accelerations rises evenly, as times do"
                raise RecordError(f"{name}: {rises}; name the columns of both")
        record = {
            "announced": samples.size, "held": samples.size, "component": code,
            "vertical": code == "V", "messages": (), "log": (f"Columns {columns}.",),
        }  # fmt: skip
        traces.append(trace_of(samples, step, name, record))
        traces[-1].stats._format = "COLUMNS"
    return traces


def _even_step(times: NDArray[np.float64], places: list[str], columns: Columns) -> float:
    """Time step of times that are evenly spaced but for rounding [s]."""
    steps = np.diff(times)
    mean = (times[-1] - times[0]) / steps.size
    off = np.abs(times - (times[0] + mean * np.arange(times.size)))
    if steps.min() > 0.0 and off.max() <= 0.1 * mean:
        return float(f"{mean:.9g}")
    wrong = steps <= 0.0 if steps.min() <= 0.0 else np.abs(steps - mean)
    late = int(wrong.argmax()) + 1
    found = f"{times[late]:.9g} s in column {columns.time} comes after {times[late - 1]:.9g} s"
    remedy = "if times are only rounded, give dt instead of their column"
    raise RecordError(f"{places[late]}: times must be evenly spaced, {found}; {remedy}")
