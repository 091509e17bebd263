"""Plain text with numbers in columns, read as the user states: nothing in it names itself."""

import itertools
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Stream

from archfrag.errors import InputError, RecordError
from archfrag.motions.formats.facts import trace_of
from archfrag.motions.formats.text import numbers

MOST_COLUMNS = 1000
LONGEST_LINE = 2**22  # [bytes]
UNEVEN = 0.1  # of a step: what rounded times may be off by
_BLOCK = 10_000  # lines
_COMMENTS = ("#", "%")
_BETWEEN, _FORTRAN = str.maketrans(",;", "  "), str.maketrans("Dd", "EE")
_WORDS = {
    "time": "time=COLUMN", "acceleration": "acceleration=COLUMN", "vertical": "vertical=COLUMN",
    "dt": "dt=SECONDS", "skip": "skip=LINES",
}  # fmt: skip


@dataclass(frozen=True)
class Columns:
    """Where the numbers of a plain text are: in columns counted from 1, or row after row.

    Blanks, tabs, commas and semicolons separate numbers; empty lines and those that begin with
    # or % are passed over.

    Parameters
    ----------
    acceleration : int, optional
        Column of the horizontal acceleration. Without it every number of the file is a sample,
        row after row.
    time : int, optional
        Column of the times [s], evenly spaced.
    dt : float [s], optional
        Time step of a file without times; either `time` or `dt` is needed.
    vertical : int, optional
        Column of the vertical acceleration, positive upwards.
    skip : int
        Lines before the first row.

    Raises
    ------
    InputError
        If they contradict each other.

    Examples
    --------
    >>> Columns(time=1, acceleration=2)
    Columns(acceleration=2, time=1, dt=None, vertical=None, skip=0)
    """

    acceleration: int | None = None
    time: int | None = None
    dt: float | None = None
    vertical: int | None = None
    skip: int = 0

    def __post_init__(self) -> None:
        given = [c for c in (self.time, self.acceleration, self.vertical) if c is not None]
        wrong = next((c for c in given if not 1 <= c <= MOST_COLUMNS), None)
        for refused, needed in (
            ((self.time is None) == (self.dt is None), "either time or dt"),
            (self.dt is not None and not 0.0 < self.dt < float("inf"),
             f"a positive dt, not {self.dt or 0.0:g}"),
            (self.acceleration is None and given, "acceleration where another column is named"),
            (len(set(given)) < len(given), "a different number for each column"),
            (wrong is not None, f"numbers from 1 to {MOST_COLUMNS}, not {wrong}"),
            (self.skip < 0, f"skip of at least 0, not {self.skip}"),
        ):  # fmt: skip
            if refused:
                raise InputError(f"columns must have {needed}")

    def __str__(self) -> str:
        """As `parse_columns` reads it."""
        given = {key: value for key, value in asdict(self).items() if value}
        return " ".join(f"{key}={value:.15g}" for key, value in given.items())


def parse_columns(text: str) -> Columns:
    """Columns from words such as ``time=1,acceleration=2,skip=3``, commas or blanks between.

    Raises
    ------
    InputError
        If a word is none of the fields of `Columns`, occurs twice, or holds another number than
        allowed.

    Examples
    --------
    >>> parse_columns("acceleration=1,dt=0.01")
    Columns(acceleration=1, time=None, dt=0.01, vertical=None, skip=0)
    """
    given: dict[str, Any] = {}
    for word in text.replace(",", " ").split():
        key, _, value = word.partition("=")
        try:
            number = (float if key == "dt" else int)(value)
        except ValueError:
            key = ""
        if key not in _WORDS or key in given:
            raise InputError(
                f"columns {text!r}: {word!r} {'occurs twice' if key in given else 'is not known'};"
                f" allowed are {', '.join(_WORDS.values())}"
            )
        given[key] = number
    try:
        return Columns(**given)
    except InputError as error:
        raise InputError(f"columns {text!r}{str(error).removeprefix('columns')}") from None


def read_columns(path: str | Path, columns: Columns) -> Stream:
    """Read a plain text of numbers, see `Columns`: one trace, or H and V, in the file's unit."""
    name = str(path)
    values = _table(path, name, columns)
    if len(values) < 2:
        raise RecordError(f"{name}: holds {len(values)} sample(s); 2 or more are needed")
    timed = columns.time is not None
    step = _even_step(values[:, 0], path, columns) if timed else columns.dt
    codes = ("",) if columns.vertical is None else ("H", "V")
    traces = []
    for index, code in enumerate(codes, start=int(timed)):
        samples = np.ascontiguousarray(values[:, index])
        if _rises_evenly(samples):
            raise _times(name)
        record = {"announced": samples.size, "component": code, "vertical": code == "V"}
        traces.append(trace_of(samples, float(step or 0.0), record))
    return Stream(traces)


def _table(path: str | Path, name: str, columns: Columns) -> NDArray[np.float64]:
    """Numbers, shape (n_row, n_column)."""
    wanted = [c - 1 for c in (columns.time, columns.acceleration, columns.vertical) if c]
    if wanted:
        return _picked(path, name, columns.skip, wanted)
    rows, parts = _rows(path, name, columns.skip), [np.empty((0, 1))]
    while block := list(itertools.islice(rows, _BLOCK)):
        texts = [text for _, text in block]
        if len(parts) == 1 and _times_in_front([text for text in texts if text]):
            raise _times(name)
        parts.append(numbers(texts, block[0][0], name)[:, None])
    return np.concatenate(parts)


def _rows(path: str | Path, name: str, skip: int) -> Iterator[tuple[int, str]]:
    """Number and text of each line from one on, blanks between numbers; comments are empty."""
    comma, points = 0, False
    try:
        with open(path, encoding="latin-1") as file:
            for place, line in enumerate(iter(partial(file.readline, LONGEST_LINE), ""), start=1):
                if len(line) == LONGEST_LINE and not line.endswith("\n"):
                    longest = f"has more than {LONGEST_LINE} characters"
                    raise RecordError(f"{name}, line {place}: {longest}")
                text = line.translate(_BETWEEN).strip()
                if place > skip and text and not text.startswith(_COMMENTS):
                    comma, points = comma or ("," in line and place), points or "." in line
                    yield place, text
                elif place > skip:
                    yield place, ""
    except OSError as error:
        raise RecordError(f"{name}: the file cannot be read ({error.strerror})") from None
    if comma and not points:
        raise RecordError(
            f"{name}, line {comma}: numbers with commas and none with a decimal point; write "
            "decimal points, and commas between numbers only"
        )


def _picked(path: str | Path, name: str, skip: int, wanted: list[int]) -> NDArray[np.float64]:
    """Columns of rows, shape (n_row, n_wanted)."""
    rows = (row.translate(_FORTRAN) for _, row in _rows(path, name, skip) if row)
    first = list(itertools.islice(rows, 1))
    if not first:
        return np.empty((0, len(wanted)))
    try:
        every = itertools.chain(first, rows)
        values = np.loadtxt(every, usecols=wanted, ndmin=2, comments=None)  # type: ignore[call-overload]
        if np.isfinite(values).all():
            return values
    except ValueError:
        pass
    for place, text in _rows(path, name, skip):
        words = text.split()
        if words and len(words) <= max(wanted):
            raise RecordError(
                f"{name}, line {place}: has {len(words)} column(s), column {max(wanted) + 1} is "
                "asked for; lines of text before the numbers are passed over by `skip`"
            )
        for word in (words[c] for c in wanted if words):
            if numbers([word], place, name).size != 1:
                raise RecordError(f"{name}, line {place}: {word!r} is not a number")
    raise RecordError(f"{name}: cannot be read as columns of numbers")


def _even_step(times: NDArray[np.float64], path: str | Path, columns: Columns) -> float:
    """Time step of times that are evenly spaced but for rounding [s]."""
    steps = np.diff(times)
    mean = (times[-1] - times[0]) / steps.size
    off = np.abs(times - (times[0] + mean * np.arange(times.size)))
    backwards = steps.min() <= 0.0
    if not backwards and off.max() <= UNEVEN * mean:
        return float(f"{mean:.9g}")
    late = int((steps <= 0.0).argmax() if backwards else np.abs(steps - mean).argmax()) + 1
    filled = (place for place, text in _rows(path, str(path), columns.skip) if text)
    where = f"{path}, line {next(itertools.islice(filled, late, None))}"
    if backwards:
        raise RecordError(
            f"{where}: time {times[late]:.9g} s in column {columns.time} does not come after "
            f"{times[late - 1]:.9g} s"
        )
    raise RecordError(
        f"{where}: times in column {columns.time} are not evenly spaced; {times[late - 1]:.9g} s "
        f"to {times[late]:.9g} s is {steps[late - 1]:.6g} s, the mean step {mean:.6g} s; where "
        "the times are only rounded give dt in their place"
    )


def _times_in_front(rows: list[str]) -> bool:
    """Whether rows of several numbers each begin with one that rises evenly."""
    words = [row.split() for row in rows]
    if len({len(row) for row in words[:-1]}) != 1 or len(words[0]) < 2:
        return False
    try:
        return _rises_evenly(np.array([row[0] for row in words], dtype=np.float64))
    except ValueError:
        return False


def _rises_evenly(values: NDArray[np.float64]) -> bool:
    steps = np.diff(values)
    return steps.size >= 4 and steps.min() > 0.0 and float(np.ptp(steps)) < 1e-3 * steps.max()


def _times(name: str) -> RecordError:
    return RecordError(
        f"{name}: what would be accelerations rises evenly, as times do; name the columns of "
        "time and acceleration"
    )
