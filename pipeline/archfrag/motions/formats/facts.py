"""What headers of text formats state about event, station and samples, in common words."""

import math
import re
from collections.abc import Callable, Mapping
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Trace, UTCDateTime
from obspy.core import AttribDict

from archfrag.errors import RecordError
from archfrag.motions.motion import METRES_PER_SECOND_SQUARED, unit_factor
from archfrag.motions.partners import AZIMUTHS, quadrant

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
Table = Mapping[str, tuple[Any, ...]]


def search(pattern: str | re.Pattern[str], text: str, group: int = 1) -> str:
    """Group of the first match in a text, empty without one; case does not matter."""
    if isinstance(pattern, str):
        pattern = re.compile(pattern, re.IGNORECASE | re.MULTILINE)
    found = pattern.search(text)
    return (found.group(group) or "") if found else ""


def known(**facts: Any) -> dict[str, Any]:
    """The facts without those that a header leaves open."""
    return {key: fact for key, fact in facts.items() if fact not in (None, "")}


def read_fields(table: Table, find: Callable[[Any], Any]) -> dict[str, Any]:
    """Read the facts of a header by a table: for each name what reads it and where it may stand.

    `find` gives what a header has at a place, which is a key, a pattern or an index; of several
    places the first one that gives a fact counts.
    """
    return known(**{
        name: next((fact for place in places if (value := find(place)) not in (None, "")
                    and (fact := read(value)) not in (None, "")), None)
        for name, (read, *places) in table.items()
    })  # fmt: skip


def number(text: str | None) -> float | None:
    """A finite number of a header; None for any other text."""
    try:
        value = float((text or "").upper().replace("D", "E"))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def iso_date(*texts: str) -> str:
    """First date in some texts as YYYY-MM-DD (months before days, as in the USA); else nothing."""
    for text in texts:
        found = next(filter(None, (re.search(each, text.upper()) for each in _DATES)), None)
        if found is None:
            continue
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
    hour, minute, second = (float((part or "").rstrip(".") or 0) for part in clock.groups())
    within = 3600.0 * hour + 60.0 * minute + second < 86400.0
    return moment(*map(int, date.split("-")), hour, minute, second) if within else None


def moment(year: float, month: float, day: float, *clock: float) -> UTCDateTime | None:
    """Time by its parts to hour, minute and second; None if there is no such time."""
    hour, minute, second = (*clock, 0.0, 0.0, 0.0)[:3]
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
    found = re.match(r"(\d{1,3})\s*(?:DEG|\.|$)", word)
    if found and int(found[1]) <= 360:
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
    plain = re.sub(r"[\s^*()]", "", text.lower()).replace("sec", "s").replace("/s/s", "/s2")
    unit_factor(plain if plain in METRES_PER_SECOND_SQUARED else text.strip()[:40], where)
    return plain


def add_fault(record: Any, fault: str, kind: str = "faults") -> None:
    """Add to the contradictions of a record, or to its ``warnings``, for which it is refused."""
    record[kind] = (*record.get(kind, ()), fault)


def judge_peak(
    record: dict[str, Any], stated: str, values: NDArray[np.float64], unit: str
) -> None:
    """Compare the peak that a header states, rounded to its last digit, with the samples."""
    try:
        given = Decimal(stated.strip().upper().replace("D", "E"))
    except InvalidOperation:
        return
    if values.size == 0 or not given.is_finite() or given == 0:
        return
    peak = abs(float(given))
    rounding = 10.0 ** int(given.as_tuple().exponent)
    found = [float(np.abs(row).max()) for row in (values, values - values.mean())]
    nearest = min(found, key=lambda value: abs(value - peak))
    off = abs(nearest - peak) - rounding
    if off > 0.01 * peak:
        text = f"the header states a peak of {peak:g} {unit}, the samples have {nearest:.4g}"
        kind = "warnings" if off > 0.1 * peak else "faults"
        add_fault(record, f"{text} {unit}", kind)


def trace_of(
    samples: NDArray[np.float64], dt: float | None, where: str, record: dict[str, Any], *,
    peak: str = "", codes: tuple[str, str, str] = ("", "", ""), start: UTCDateTime | None = None,
) -> Trace:  # fmt: skip
    """A trace of network, station and location `codes`, with the header as ``stats.record``.

    RecordError if the time step [s] is not one; a `peak` that the header states is judged.
    """
    step = math.nan if dt is None else dt
    if not 0.0 < step < math.inf:
        raise RecordError(f"{where}: time step {step:g} s must be a positive number of seconds")
    judge_peak(record, peak, samples, record.get("unit", ""))
    header = dict(zip(("network", "station", "location"), codes)) | {
        "delta": step, "channel": record.get("component", ""), "record": AttribDict(record),
    }  # fmt: skip
    return Trace(samples, header | ({} if start is None else {"starttime": start}))
