"""What readers of text formats share: lines, numbers in columns, and facts of headers."""

import codecs
import contextlib
import functools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from obspy import Stream, Trace, UTCDateTime

from archfrag.errors import RecordError
from archfrag.files import Named, opened, wide_encoding
from archfrag.motions.calibrate import plain_unit
from archfrag.motions.channel import (
    AZIMUTHS,
    METRES_PER_SECOND_SQUARED,
    Channel,
    Samples,
    filled,
    quadrant,
    unit_factor,
    wrong_length,
)

Source = str | Path | BinaryIO

_FORTRAN = str.maketrans("Dd", "EE")
_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[Ee][-+]?\d+)?")
# Fixed-width columns leave no blank before a sign, nor after a two-digit exponent.
_RUN_TOGETHER = re.compile(r"(?<=[Ee][-+]\d\d)(?=[-+.\d])|(?<=[\d.])(?=[-+])")
_FIXED_WIDTH = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+)(?:[Ee][-+]\d\d)?")
_FORMAT = r"\(\s*\d*P?,?\s*\d*\s*[FEGDI]\s*(\d{1,2})(?:\.\d+)?\s*\)"
_STEPS = np.outer(10.0 ** np.arange(-5, 1), (1.0, 2.0, 2.5, 5.0)).ravel()  # [s]
END_OF_DATA = re.compile(r"(?i:/&|\s*END[ -]OF[ -]DATA)")
WORDS = re.compile(r"(?i)[A-Za-z]{4}|/&|END")

_MONTHS = "JAN|FEB|MAR|APR|MAY|JUN|JUL|AUG|SEP|OCT|NOV|DEC"
_NAMED = rf"(?P<month>{_MONTHS})[A-Z]*\.?"
_DATES = (
    r"\b(?P<year>\d{4})[-/](?P<month>\d{1,2})[-/](?P<day>\d{1,2})\b",
    r"\b(?P<month>\d{1,2})[-/](?P<day>\d{1,2})[-/](?P<year>\d{4}|\d{2})\b",
    rf"\b(?P<day>\d{{1,2}})\s*{_NAMED},?\s*(?P<year>\d{{4}})\b",
    rf"\b{_NAMED}\s*(?P<day>\d{{1,2}}),?\s*(?P<year>\d{{4}})\b",
    rf"\b(?P<year>\d{{4}}) \b{_NAMED} +(?P<day>\d\d?)\b",
)
_CLOCK = re.compile(r",?\s+(\d{1,2}):\s*(\d{1,2})(?::\s*(\d*\.?\d*))?\s*(?:UTC|GMT)")
_MAGNITUDES = [
    rf"\b{kind}\s*=?\s*(\d\.?\d*)" for kind in ("MW", "ML", "MS", "MD", "MB", "M")
]
_LONGEST = 10_000_000  # samples that a header may announce


class Text:
    """Lines of a text file, with any kind of line ends; `name` is that of the file."""

    def __init__(self, source: Source) -> None:
        is_path = isinstance(source, str | Path)
        self.name = str(source if is_path else getattr(source, "name", "buffer"))
        content = _read_bytes(source)
        wide = wide_encoding(content)
        if wide:
            raise RecordError(f"{self.name}: is text in {wide}; save it as UTF-8")
        self.lines = _lines(content)

    def place(self, index: int) -> str:
        return f"{self.name}, line {index + 1}"

    def line(self, index: int) -> str:
        """Return a line, empty beyond the last one."""
        return "".join(self.lines[index : index + 1])

    def head(self, first: int, last: int) -> list[str]:
        """Return lines of a header, cut to 200 characters: patterns take long over longer ones."""
        return [line[:200] for line in self.lines[first:last]]

    def needs(self, index: int, what: str) -> RecordError:
        end = "the end of the file" * (index >= len(self.lines))
        return RecordError(
            f"{self.place(index)}: {what} is needed here, not "
            f"{end or repr(self.line(index).strip()[:60])}"
        )

    def numbers(
        self,
        first: int,
        last: int | None = None,
        expected: int | None = None,
        width: int | None = None,
    ) -> Samples:
        """Return the numbers of the lines from `first` on and before `last`.

        They have blanks between them, or are in columns of `width` characters. If both are
        possible, the numbers are those that are as many as `expected`, or else those between
        blanks. RecordError for what is no finite number.
        """
        lines = self.lines[first:last]
        rows = _rows(lines, width)
        for row in rows:
            if row.size == expected:
                return row
        if rows:
            return rows[0]
        values: list[float] = []
        for place, line in enumerate(lines, first):
            rows = _rows([line], width)
            if rows:
                values.extend(rows[0])
            for word in () if rows else line.split():
                values += split(word, self.place(place))
        return np.array(values)

    def first(self, index: int, test: Callable[[str], object]) -> int:
        """Return the index of the first line from `index` on that passes a test.

        It is the number of lines if none does.
        """
        count = len(self.lines)
        return next((i for i in range(index, count) if test(self.lines[i])), count)


def reader(read: Callable[[Text], Iterable[Trace]]) -> Callable[..., Stream]:
    """Make a plug-in of obspy from a function that reads the lines of a file.

    The plug-in takes a path or an open buffer and returns a Stream.
    """

    @functools.wraps(read)
    def plug_in(source: Source, **_) -> Stream:
        return Stream(list(read(Text(source))))

    return plug_in


def _read_bytes(source: Source, size: int = -1) -> bytes:
    """Return the first `size` bytes (-1: all) of a file, or of the rest of an open buffer."""
    if not isinstance(source, str | Path):
        return source.read(size)
    with opened(source) as file:
        return file.read(size)


def begins_with(*patterns: str) -> Callable[[Source], bool]:
    """Return a function that tests whether a file or open buffer is text with certain patterns.

    Its first 4096 bytes count: they must have no zero byte and match all `patterns`.
    """

    def is_text(source: Source) -> bool:
        try:
            content = _read_bytes(source, 4096)
        except (OSError, ValueError):  # obspy goes on to other formats
            return False
        text = "\n".join(_lines(content))
        return b"\0" not in content and all(
            re.search(pattern, text) for pattern in patterns
        )

    return is_text


def _lines(content: bytes) -> list[str]:
    plain = content.removeprefix(codecs.BOM_UTF8)
    text = plain.decode("latin-1").replace("\0", " ")  # with which some rows are filled
    return re.sub("\r+\n|\r", "\n", text).rstrip("\x1a ").split("\n")


def format_width(text: str) -> int | None:
    """Return the width of columns by a Fortran format such as ``(8f9.6)``, None without one."""
    return int(search(_FORMAT, text) or 0) or None


def _rows(lines: Sequence[str], width: int | None) -> list[Samples]:
    """Return the numbers of lines in two ways: between blanks, and in columns of a width.

    A way is left out if one of its words or columns is not a finite number, and columns also
    without a `width`.
    """
    text = "\n".join(lines).translate(_FORTRAN)
    if "_" in text:  # Python allows 1_000
        return []
    ways = [text.split()]
    if width is not None and "\t" not in text:
        columns = re.compile(f".{{1,{width}}}")
        rows = map(str.rstrip, text.split("\n"))
        ways.append([cell for row in rows for cell in columns.findall(row)])
    found = []
    for cells in ways:
        with contextlib.suppress(ValueError):
            values = np.array(list(map(float, cells)))
            if np.isfinite(values).all():
                found.append(values)
    return found


def split(word: str, place: str) -> list[float]:
    """Return the numbers of one word, which columns of fixed width may have joined."""
    text = word.translate(_FORTRAN).upper()
    pieces = [text] if _NUMBER.fullmatch(text) else _RUN_TOGETHER.sub(" ", text).split()
    values = [value for value in map(number, pieces) if value is not None]
    whole = len(pieces) == 1 or all(map(_FIXED_WIDTH.fullmatch, pieces))
    if not whole or len(values) < len(pieces):
        raise RecordError(f"{place}: {word[:40]!r} is not a finite number")
    return values


def on_even_steps(pairs: Samples, name: str) -> tuple[NDArray, float, str]:
    """Return samples at equal steps, the step [s] and a text, of `pairs` of time and sample.

    If times are even but for rounding, the samples stay and the text is empty. If not, samples are
    interpolated linearly, and the text says so. RecordError if times decrease or are too uneven.
    """
    times, values = pairs[: pairs.size // 2 * 2].reshape(-1, 2).T
    if times.size < 2:
        return values[:0], 1.0, ""
    steps = np.diff(times)
    length = times[-1] - times[0]
    if steps.min() < 0.0 or not length > 0.0:
        bad = int(np.argmax(steps < 0.0)) + 1 if steps.min() < 0.0 else 0
        raise RecordError(
            f"{name}: times must increase; sample {bad} is at {times[bad]:g} s"
        )
    mean = float(length) / steps.size
    if np.abs(times - times[0] - mean * np.arange(times.size)).max() <= 0.05 * mean:
        # Times rounded to their last digit give a step that is nearly what it was before.
        rounded = (float(f"{mean:.{digits}g}") for digits in (1, 2, 3))
        step = next(
            (value for value in rounded if abs(value - mean) <= 1e-5 * mean), mean
        )
        return np.ascontiguousarray(values), step, ""
    # Linear between samples, as digitised film is; a step of 1, 2, 2.5, 5, 10... up to the median.
    median = np.median(steps[steps > 0.0])
    step = float(_STEPS[median >= _STEPS / 1.02].max(initial=0.0)) or median
    if not length / step < 20 * times.size:
        raise RecordError(
            f"{name}: times are too uneven: steps of {median:g} s in {length:g} s"
        )
    grid = times[0] + step * np.arange(int(length / step * (1.0 + 1e-12)) + 1)
    done = (
        f"Samples at unequal steps of {steps.min():.4g} to {steps.max():.4g} s read at equal "
        f"steps of {step:g} s, linear between them ({values.size} to {grid.size} samples)."
    )
    return np.interp(grid, times, values), step, done


def search(pattern: str, text: str, group: int = 1) -> str:
    """Return a group of the first match in a text; empty if there is none. Case is ignored."""
    match = re.search(pattern, text, re.IGNORECASE | re.MULTILINE)
    return (match.group(group) or "") if match else ""


def read_fields(table: Mapping[str, Any], find: Callable[[Any], Any]) -> Named:
    """Return the facts that are found by a `table`.

    For the name of each fact it has the function that reads it, and places at which `find` looks
    one after another until it finds the fact.
    """
    facts = Named()
    for name, (read, *places) in table.items():
        values = (find(place) for place in places)
        read_values = (read(value) for value in values if value not in (None, ""))
        facts[name] = next(
            (fact for fact in read_values if fact not in (None, "")), None
        )
    return filled(facts)


def number(text: str | None) -> float | None:
    """Return the number that a text holds; None if it is no finite number."""
    try:
        value = float(
            (text or "").translate(_FORTRAN).replace("_", "?")
        )  # Python allows 1_000
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def iso_date(*texts: str) -> str:
    """Return the first date in texts as YYYY-MM-DD; empty if there is none.

    In dates of numbers alone that do not begin with the year, months come before days.
    """
    matches = (re.search(form, text.upper()) for text in texts for form in _DATES)
    for date in filter(None, matches):
        named = date["month"]
        month = int(named) if named.isdigit() else _MONTHS.split("|").index(named) + 1
        year = int(date["year"])
        day = int(date["day"])
        if year < 100:
            year += 1900 if year >= 30 else 2000
        if 1 <= month <= 12 and 1 <= day <= 31:
            return f"{year:04d}-{month:02d}-{day:02d}"
    return ""


def utc_time(text: str) -> UTCDateTime | None:
    """Return the date and time of day in a text with UTC or GMT; None without one."""
    date = iso_date(text)
    clock = _CLOCK.search(text.upper())
    if not date or clock is None:
        return None
    parts = (float((part or "").rstrip(".") or 0) for part in clock.groups())
    return moment(*map(int, date.split("-")), *parts)


def moment(
    year: float, month: float, day: float, hour: float, minute: float, second: float
) -> UTCDateTime | None:
    """Return the time with these parts; None if there is no such time from 1800 to 2200."""
    try:
        midnight = UTCDateTime(int(year), int(month), int(day))
        time = midnight + 3600.0 * hour + 60.0 * minute + second
        return time if 1800 <= time.year <= 2200 else None
    except (ValueError, TypeError, OverflowError):
        return None


def magnitude(text: str) -> float | None:
    """Return the moment magnitude in a text, or else another kind of magnitude, or None."""
    values = (search(kind, text.upper()) for kind in _MAGNITUDES)
    return next(
        (float(value) for value in values if value and 0.0 < float(value) < 10.0), None
    )


def direction(text: str) -> Named:
    """Return the facts of a component by a text such as ``90 DEG`` or ``UP``.

    They are its code and, if known, its azimuth [degrees] and whether it is vertical.
    """
    word = text.strip().upper()
    angle = re.match(r"(\d{1,3})\s*(?:DEG|\.|$)", word)
    bearing = re.match(r"[NS]\s*\d{1,2}\s*[EW]\b", word)
    code = (word.split() or [""])[0]
    azimuth = AZIMUTHS.get(code)
    if angle and int(angle[1]) <= 360:
        code = str(int(angle[1]))
        azimuth = float(code)
    elif bearing:
        code = bearing[0]
        azimuth = quadrant(re.sub(r"\s", "", code))
    elif re.match(r"(UP|VERT|DOWN|DWN|[-+]?[UVZ]\b)", word):
        down = word.startswith(("DOWN", "DWN", "-"))
        return {"code": "DOWN" if down else "UP", "vertical": True}
    known = {} if azimuth is None else {"azimuth": azimuth, "vertical": False}
    return {"code": code, **known}


def checked_count(text: str, where: str) -> int:
    """Return the number of samples that a header announces; RecordError unless it is possible."""
    word = text.strip()
    if not (word.isdigit() and len(word) < 12 and 2 <= int(word) <= _LONGEST):
        raise RecordError(
            f"{where}: {word[:40]!r} samples are announced, not 2 to {_LONGEST}"
        )
    return int(word)


def acceleration_unit(text: str, where: str) -> str:
    """Return a unit of acceleration as archfrag spells it; RecordError if it is none."""
    plain = plain_unit(text)
    known = plain in METRES_PER_SECOND_SQUARED
    unit_factor(plain if known else text.strip()[:40], where)
    return plain


def judge_peak(channel: Channel, stated: str, values: Samples, unit: str) -> None:
    """Compare the peak that a header states, rounded to its last digit, with the samples.

    The channel is contradicted by a difference of more than 10 %, and has an error by one of more
    than 1 %.
    """
    peak = abs(number(stated) or 0.0)
    if not peak or not values.size:
        return
    rounding = 10.0 ** int(
        Decimal(stated.strip().translate(_FORTRAN)).as_tuple().exponent
    )
    peaks = [np.abs(row).max() for row in (values, values - values.mean())]
    nearest = min(peaks, key=lambda value: abs(value - peak))
    off = abs(nearest - peak) - rounding
    text = f"the header states a peak of {peak:g} {unit}, the samples have {nearest:.4g} {unit}"
    if off > 0.1 * peak:
        channel.contradicted = text
    elif off > 0.01 * peak:
        channel.errors.append(text)


def trace_of(
    samples: Samples,
    dt: float | None,
    where: str,
    facts: Named,
    codes: Sequence[str] = (),
    start: UTCDateTime | None = None,
) -> Trace:
    """Return a trace with network, station and location `codes`, and `facts` in its `Channel`.

    RecordError if the time step `dt` [s] is missing or not above 0. A "peak" and a "length" [s]
    among the facts are those that the header states: they are compared with the samples.
    """
    if not 0.0 < (dt or 0.0) < math.inf:
        raise RecordError(
            f"{where}: no time step above 0 s is stated, but {dt or 'none'}"
        )
    peak = facts.pop("peak", "")
    length = facts.pop("length", None)
    channel = Channel(**{"held": samples.size, **facts})
    judge_peak(channel, peak, samples, channel.unit)
    if not channel.contradicted:
        channel.contradicted = wrong_length(length, channel.held, dt or 0.0)
    header = Named(zip(("network", "station", "location"), codes))
    header |= {"delta": dt, "channel": channel.code, "record": channel}
    header |= {"starttime": start} if start else {}
    return Trace(samples, header)
