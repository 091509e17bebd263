"""Shared by readers of text formats: lines, numbers in columns, and facts of headers."""

import codecs
import math
import re
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from obspy import Trace, UTCDateTime
from obspy.core import AttribDict

from archfrag.errors import RecordError
from archfrag.files import opened, wide_encoding
from archfrag.motions.headers import plain_unit
from archfrag.motions.motion import METRES_PER_SECOND_SQUARED, unit_factor
from archfrag.motions.partners import AZIMUTHS, quadrant

Source = str | Path | BinaryIO

_FORTRAN = str.maketrans("Dd", "EE")
_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[Ee][-+]?\d+)?")
# Fixed-width columns leave no blank before a sign, nor after a two-digit exponent.
_RUN_TOGETHER = re.compile(r"(?<=[Ee][-+]\d\d)(?=[-+.\d])|(?<=[\d.])(?=[-+])")
_FIXED_WIDTH = re.compile(r"[-+]?(?:\d+\.\d*|\.\d+)(?:[Ee][-+]\d\d)?")
_FORMAT = re.compile(r"\(\s*\d*P?,?\s*\d*\s*[FEGDI]\s*(\d{1,2})(?:\.\d+)?\s*\)", re.IGNORECASE)
_STEPS = np.outer(10.0 ** np.arange(-5, 1), (1.0, 2.0, 2.5, 5.0)).ravel()  # [s]
END_OF_DATA = re.compile(r"/&|\s*END[ -]OF[ -]DATA", re.IGNORECASE)
WORDS = re.compile(r"[A-Za-z]{4}|/&|END", re.IGNORECASE)

_MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")
_NAMED = rf"(?P<month>{'|'.join(_MONTHS)})[A-Z]*\.?"
_DATES = (
    r"\b(?P<year>\d{4})[-/](?P<month>\d{1,2})[-/](?P<day>\d{1,2})\b",
    r"\b(?P<month>\d{1,2})[-/](?P<day>\d{1,2})[-/](?P<year>\d{4}|\d{2})\b",
    rf"\b(?P<day>\d{{1,2}})\s*{_NAMED},?\s*(?P<year>\d{{4}})\b",
    rf"\b{_NAMED}\s*(?P<day>\d{{1,2}}),?\s*(?P<year>\d{{4}})\b",
    rf"\b(?P<year>\d{{4}}) \b{_NAMED} +(?P<day>\d\d?)\b",
)
_CLOCK = re.compile(r",?\s+(\d{1,2}):\s*(\d{1,2})(?::\s*(\d*\.?\d*))?\s*(?:UTC|GMT)")
_MAGNITUDES = [rf"\b{kind}\s*=?\s*(\d\.?\d*)" for kind in ("MW", "ML", "MS", "MD", "MB", "M")]
_LONGEST = 10_000_000  # samples that a header may announce


class Text:
    """Lines of a file, whatever ends them."""

    def __init__(self, source: Source) -> None:
        is_path = isinstance(source, (str, Path))
        self.name = str(source if is_path else getattr(source, "name", "buffer"))
        content = _read_bytes(source)
        if wide := wide_encoding(content):
            raise RecordError(f"{self.name}: is text in {wide}; save it as UTF-8")
        self.lines = _lines(content)

    def place(self, index: int) -> str:
        return f"{self.name}, line {index + 1}"

    def head(self, first: int, last: int) -> list[str]:
        """Lines of a header, cut to 200 characters: patterns take long over much longer ones."""
        return [line[:200] for line in self.lines[first:last]]

    def needs(self, index: int, what: str) -> RecordError:
        end = index >= len(self.lines)
        shown = "the end of the file" if end else repr(self.lines[index].strip()[:60])
        return RecordError(f"{self.place(index)}: {what} is needed here, this is {shown}")

    def numbers(
        self, first: int, last: int | None = None, expected: int | None = None,
        width: int | None = None,
    ) -> NDArray[np.float64]:  # fmt: skip
        """Finite numbers of some lines, between blanks or in columns of a width."""
        lines, ways = self.lines[first:last], [None] if width is None else [None, width]
        found = [row for each in ways if (row := _converted(lines, each)) is not None]
        if found:
            return next((row for row in found if row.size == expected), found[0])
        values: list[float] = []
        for place, line in enumerate(lines, first):
            if rows := [row for each in ways if (row := _converted([line], each)) is not None]:
                values.extend(rows[0])
            else:
                values += [v for word in line.split() for v in split(word, self.place(place))]
        return np.array(values)

    def first(self, index: int, test: Callable[[str], object]) -> int:
        """The first line from `index` on that passes a test; the number of lines if none does."""
        count = len(self.lines)
        return next((i for i in range(index, count) if test(self.lines[i])), count)


def _read_bytes(source: Source, size: int = -1) -> bytes:
    """First bytes of a file, or of the rest of an open buffer."""
    if not isinstance(source, (str, Path)):
        return source.read(size)
    with opened(source) as file:
        return file.read(size)


def begins_with(*patterns: str) -> Callable[[Source], bool]:
    """A test of a file or open binary buffer: plain text in whose first 4096 bytes all match."""

    def begins(source: Source) -> bool:
        try:
            content = _read_bytes(source, 4096)
        except (OSError, ValueError):  # obspy goes on to other formats
            return False
        text = "\n".join(_lines(content))
        return b"\0" not in content and all(re.search(pattern, text) for pattern in patterns)

    return begins


def _lines(content: bytes) -> list[str]:
    plain = content.removeprefix(codecs.BOM_UTF8)
    text = plain.decode("latin-1").replace("\0", " ")  # with which some rows are filled
    return re.sub("\r+\n|\r", "\n", text).rstrip("\x1a ").split("\n")


def format_width(text: str) -> int | None:
    """Width of the columns by a Fortran format such as ``(8f9.6)`` in a text."""
    return int(search(_FORMAT, text) or 0) or None


def _converted(lines: Sequence[str], width: int | None) -> NDArray[np.float64] | None:
    """All numbers at once; None if a word or a column is not a finite number."""
    text = "\n".join(lines).translate(_FORTRAN)
    if "_" in text or (width is not None and "\t" in text):  # Python allows 1_000
        return None
    cells = text.split() if width is None else [
        line[i : i + width]
        for line in map(str.rstrip, text.split("\n"))
        for i in range(0, len(line), width)
    ]  # fmt: skip
    try:
        values = np.array(list(map(float, cells)))
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def split(word: str, place: str) -> list[float]:
    """Numbers of one word, of which fixed-width columns may have made several."""
    text = word.translate(_FORTRAN).upper()
    pieces = [text] if _NUMBER.fullmatch(text) else _RUN_TOGETHER.sub(" ", text).split()
    values = [value for value in map(number, pieces) if value is not None]
    whole = len(pieces) == 1 or all(map(_FIXED_WIDTH.fullmatch, pieces))
    if not whole or len(values) < len(pieces):
        raise RecordError(f"{place}: {word[:40]!r} is not a finite number")
    return values


def on_even_steps(pairs: NDArray[np.float64], name: str) -> tuple[NDArray, float, str]:
    """Samples at equal steps, the step [s] and what was done, from pairs of time and sample."""
    times, values = pairs[: pairs.size // 2 * 2].reshape(-1, 2).T
    if times.size < 2:
        return values[:0], 1.0, ""
    steps, length = np.diff(times), times[-1] - times[0]
    if steps.min() < 0.0 or not length > 0.0:
        bad = int(np.argmax(steps < 0.0)) + 1 if steps.min() < 0.0 else 0
        raise RecordError(f"{name}: times must increase; sample {bad} is at {times[bad]:g} s")
    mean = float(length) / steps.size
    if np.abs(times - times[0] - mean * np.arange(times.size)).max() <= 0.05 * mean:
        # Times rounded to their last digit give a step that is nearly what it was before.
        rounded = (float(f"{mean:.{digits}g}") for digits in (1, 2, 3))
        step = next((value for value in rounded if abs(value - mean) <= 1e-5 * mean), mean)
        return np.ascontiguousarray(values), step, ""
    # Linear between samples, as digitised film is; a step of 1, 2, 2.5, 5, 10... up to the median.
    median = float(np.median(steps[steps > 0.0]))
    step = float(_STEPS[median >= _STEPS / 1.02].max(initial=0.0)) or median
    if not length / step < 20 * times.size:
        raise RecordError(f"{name}: times are too uneven: steps of {median:g} s in {length:g} s")
    grid = times[0] + step * np.arange(int(length / step * (1.0 + 1e-12)) + 1)
    unequal = f"Samples at unequal steps of {steps.min():.4g} to {steps.max():.4g} s"
    sizes = f"linear between them ({values.size} to {grid.size} samples)"
    done = f"{unequal} read at equal steps of {step:g} s, {sizes}."
    return np.interp(grid, times, values), step, done


def search(pattern: str | re.Pattern[str], text: str, group: int = 1) -> str:
    """Group of the first match in a text, empty without one; case does not matter."""
    if isinstance(pattern, str):
        pattern = re.compile(pattern, re.IGNORECASE | re.MULTILINE)
    found = pattern.search(text)
    return (found.group(group) or "") if found else ""


def known(**facts: Any) -> dict[str, Any]:
    """The facts without those that a header leaves open."""
    return {key: fact for key, fact in facts.items() if fact not in (None, "")}


def read_fields(
    table: Mapping[str, tuple[Any, ...]], find: Callable[[Any], Any]
) -> dict[str, Any]:
    """Read facts by a table: name, reader and places, at which `find` looks one after another."""
    return known(**{
        name: next((fact for place in places if (value := find(place)) not in (None, "")
                    and (fact := read(value)) not in (None, "")), None)
        for name, (read, *places) in table.items()
    })  # fmt: skip


def number(text: str | None) -> float | None:
    """A finite number of a header; None for any other text."""
    try:
        value = float((text or "").translate(_FORTRAN).replace("_", "?"))  # Python allows 1_000
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def iso_date(*texts: str) -> str:
    """First date in some texts as YYYY-MM-DD (months before days, as in the USA); else nothing."""
    every = (re.search(each, text.upper()) for text in texts for each in _DATES)
    for found in filter(None, every):
        named = found["month"]
        month = int(named) if named.isdigit() else _MONTHS.index(named) + 1
        year, day = int(found["year"]), int(found["day"])
        year += 0 if year >= 100 else 1900 if year >= 30 else 2000
        if 1 <= month <= 12 and 1 <= day <= 31:
            return f"{year:04d}-{month:02d}-{day:02d}"
    return ""


def utc_time(text: str) -> UTCDateTime | None:
    """Date and time of day in a text with UTC or GMT; None if it has no such time."""
    date, clock = iso_date(text), _CLOCK.search(text.upper())
    if not date or clock is None:
        return None
    parts = (float((part or "").rstrip(".") or 0) for part in clock.groups())
    return moment(*map(int, date.split("-")), *parts)


def moment(
    year: float, month: float, day: float, hour: float, minute: float, second: float
) -> UTCDateTime | None:
    """Time by its parts; None if there is no such time."""
    try:
        midnight = UTCDateTime(int(year), int(month), int(day))
        found = midnight + 3600.0 * hour + 60.0 * minute + second
        return found if 1800 <= found.year <= 2200 else None
    except (ValueError, TypeError, OverflowError):
        return None


def magnitude(text: str) -> float | None:
    """Magnitude in a text, the first there is of moment, local, surface-wave and other ones."""
    found = (search(kind, text.upper()) for kind in _MAGNITUDES)
    return next((float(value) for value in found if value and 0.0 < float(value) < 10.0), None)


def direction(text: str) -> dict[str, Any]:
    """Component, azimuth and whether it is vertical, of a text such as ``90 DEG`` or ``UP``."""
    word = text.strip().upper()
    if (found := re.match(r"(\d{1,3})\s*(?:DEG|\.|$)", word)) and int(found[1]) <= 360:
        return {"component": str(int(found[1])), "azimuth": float(found[1]), "vertical": False}
    if found := re.match(r"[NS]\s*\d{1,2}\s*[EW]\b", word):
        azimuth = quadrant(re.sub(r"\s", "", found[0]))
        return {"component": found[0], "azimuth": azimuth, "vertical": False}
    if re.match(r"(UP|VERT|DOWN|DWN|[-+]?[UVZ]\b)", word):
        down = word.startswith(("DOWN", "DWN", "-"))
        return {"component": "DOWN" if down else "UP", "vertical": True}
    code = (word.split() or [""])[0]
    stated = {"azimuth": AZIMUTHS[code], "vertical": False} if code in AZIMUTHS else {}
    return {"component": code} | stated


def checked_count(text: str, where: str) -> int:
    """Number of samples that a header announces, if a record can have it."""
    word = text.strip()
    if not (word.isdigit() and len(word) < 12 and 2 <= int(word) <= _LONGEST):
        raise RecordError(f"{where}: {word[:40]!r} samples are announced, not 2 to {_LONGEST}")
    return int(word)


def acceleration_unit(text: str, where: str) -> str:
    """A unit of acceleration as archfrag spells it: ``cm/s^2`` and ``cm/sec/sec`` as ``cm/s2``."""
    plain = plain_unit(text)
    unit_factor(plain if plain in METRES_PER_SECOND_SQUARED else text.strip()[:40], where)
    return plain


def judge_peak(record: Any, stated: str, values: NDArray[np.float64], unit: str) -> None:
    """Compare the peak that a header states, rounded to its last digit, with the samples."""
    peak = abs(number(stated) or 0.0)
    if not peak or not values.size:
        return
    rounding = 10.0 ** int(Decimal(stated.strip().translate(_FORTRAN)).as_tuple().exponent)
    found = [float(np.abs(row).max()) for row in (values, values - values.mean())]
    nearest = min(found, key=lambda value: abs(value - peak))
    off = abs(nearest - peak) - rounding
    if off > 0.01 * peak:
        text = f"the header states a peak of {peak:g} {unit}, the samples have {nearest:.4g}"
        record["warnings" if off > 0.1 * peak else "errors"] = (f"{text} {unit}",)


def trace_of(
    samples: NDArray[np.float64], dt: float | None, where: str, record: dict[str, Any], *,
    peak: str = "", codes: tuple[str, str, str] = ("", "", ""), start: UTCDateTime | None = None,
) -> Trace:  # fmt: skip
    """A trace of network, station and location `codes`, with the header as ``stats.record``.

    RecordError if the time step [s] is not one; a `peak` that the header states is judged.
    """
    if not 0.0 < (dt or 0.0) < math.inf:
        raise RecordError(f"{where}: no time step above 0 s is stated, but {dt or 'none'}")
    judge_peak(record, peak, samples, record.get("unit", ""))
    header = dict(zip(("network", "station", "location"), codes)) | {
        "delta": dt, "channel": record.get("component", ""),
        "record": AttribDict({"log": (), "errors": (), **record}),
    }  # fmt: skip
    return Trace(samples, header | ({} if start is None else {"starttime": start}))
