"""Plain text with numbers in columns, read as the user states: nothing in it names itself."""

import contextlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Trace

from archfrag.errors import InputError, RecordError
from archfrag.motions.formats.common import FORTRAN, Text, split, trace_of

MOST_COLUMNS, LONGEST_LINE = 1000, 2**22  # [columns], [characters]
_BETWEEN = str.maketrans(",;", "  ")
_RISES = "what would be accelerations rises evenly, as times do; name the columns of both"
_ALLOWED = "time=COLUMN, acceleration=COLUMN, vertical=COLUMN, dt=SECONDS, skip=LINES"


@dataclass(frozen=True)
class Columns:
    """Where the numbers of a plain text are: in columns counted from 1, or row after row.

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
                raise InputError(f"columns must have {needed}")

    def __str__(self) -> str:
        """As `parse_columns` reads it."""
        return " ".join(f"{key}={value:.15g}" for key, value in asdict(self).items() if value)


def parse_columns(text: str) -> Columns:
    """Columns from words such as ``time=1,acceleration=2,skip=3``, commas or blanks between.

    InputError if a word is none of the fields of `Columns`, occurs twice, or holds another number
    than allowed.
    """
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
    try:
        return Columns(**given)
    except InputError as error:
        raise InputError(f"columns {text!r}{str(error).removeprefix('columns')}") from None


def read_columns(path: str | Path, columns: Columns) -> list[Trace]:
    """Read a plain text of numbers, see `Columns`: one trace, or H and V, in the file's unit."""
    text, name = Text(path), str(path)
    _make_plain(text, columns.skip)
    chosen = [c - 1 for c in (columns.time, columns.acceleration, columns.vertical) if c]
    values = _picked(text, chosen) if chosen else text.numbers(columns.skip)[:, None]
    if len(values) < 2:
        raise RecordError(f"{name}: holds {len(values)} sample(s); 2 or more are needed")
    # Rows of several numbers that each begin with a time are no samples row after row.
    width = len(next(filter(None, text.lines)).split())
    first = values[::width, 0] if not chosen and width > 1 else values[:0, 0]
    timed = columns.time is not None
    step = _even_step(values[:, 0], text, columns) if timed else columns.dt
    traces = []
    for index, code in enumerate(("H", "V") if columns.vertical else ("",), start=int(timed)):
        samples = np.ascontiguousarray(values[:, index])
        if _rises_evenly(samples) or _rises_evenly(first):
            raise RecordError(f"{name}: {_RISES}")
        record = {
            "announced": samples.size, "held": samples.size, "component": code,
            "vertical": code == "V", "messages": (), "log": (f"Columns {columns}.",),
        }  # fmt: skip
        traces.append(trace_of(samples, step, name, record))
        traces[-1].stats._format = "COLUMNS"
    return traces


def _make_plain(text: Text, skip: int) -> None:
    """Leave blanks between numbers; comments and the lines before the first row are empty."""
    comma, points = 0, False
    text.lines[:skip] = [""] * min(skip, len(text.lines))
    for place, line in enumerate(text.lines):
        if len(line) > LONGEST_LINE:
            raise RecordError(f"{text.place(place)}: has more than {LONGEST_LINE} characters")
        row = line.translate(_BETWEEN).strip()
        text.lines[place] = "" if row.startswith(("#", "%")) else row
        if text.lines[place]:
            comma, points = comma or ("," in line and place + 1), points or "." in line
    if comma and not points:
        commas = "numbers with commas and none with a decimal point"
        raise RecordError(f"{text.name}, line {comma}: {commas}; write decimal points")


def _picked(text: Text, chosen: list[int]) -> NDArray[np.float64]:
    """Columns of rows, shape (n_row, n_chosen)."""
    filled = [row.translate(FORTRAN) for row in text.lines if row]
    if not filled:
        return np.empty((0, len(chosen)))
    with contextlib.suppress(ValueError):
        values = np.loadtxt(filled, usecols=chosen, ndmin=2, comments=None)  # type: ignore[call-overload]
        if np.isfinite(values).all():
            return values
    for place, row in enumerate(text.lines):
        words, where = row.split(), text.place(place)
        if words and len(words) <= max(chosen):
            few = f"has {len(words)} column(s), column {max(chosen) + 1} is asked for"
            raise RecordError(f"{where}: {few}; `skip` passes over lines before the numbers")
        for word in (words[c] for c in chosen if words):
            if len(split(word, where)) != 1:
                raise RecordError(f"{where}: {word!r} is not a number")
    raise RecordError(f"{text.name}: cannot be read as columns of numbers")


def _even_step(times: NDArray[np.float64], text: Text, columns: Columns) -> float:
    """Time step of times that are evenly spaced but for rounding [s]."""
    steps = np.diff(times)
    mean = (times[-1] - times[0]) / steps.size
    off = np.abs(times - (times[0] + mean * np.arange(times.size)))
    if steps.min() > 0.0 and off.max() <= 0.1 * mean:
        return float(f"{mean:.9g}")
    wrong = steps <= 0.0 if steps.min() <= 0.0 else np.abs(steps - mean)
    late = int(wrong.argmax()) + 1
    where = text.place([place for place, row in enumerate(text.lines) if row][late])
    found = f"{times[late]:.9g} s in column {columns.time} comes after {times[late - 1]:.9g} s"
    remedy = "if times are only rounded, give dt instead of their column"
    raise RecordError(f"{where}: times must be evenly spaced, {found}; {remedy}")


def _rises_evenly(values: NDArray[np.float64]) -> bool:
    steps = np.diff(values)
    return steps.size >= 4 and steps.min() > 0.0 and float(np.ptp(steps)) < 1e-3 * steps.max()
