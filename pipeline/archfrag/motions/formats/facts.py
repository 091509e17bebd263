"""What headers of text formats say of event, station and samples, in common words."""

import math
import re
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Stream, Trace, UTCDateTime
from obspy.core import AttribDict

from archfrag.errors import RecordError
from archfrag.motions.units import METRES_PER_SECOND_SQUARED

_MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")
_MONTH_DAY_YEAR = re.compile(r"\b(\d{1,2})[-/](\d{1,2})[-/](\d{4}|\d{2})\b")
_YEAR_MONTH_DAY = re.compile(r"\b(\d{4})[-/](\d{1,2})[-/](\d{1,2})\b")
_NAMED_MONTH = re.compile(r"\b(" + "|".join(_MONTHS) + r")[A-Z]*\.?\s*(\d{1,2}),?\s*(\d{4})\b")
_DAY_NAMED_MONTH = re.compile(r"\b(\d{1,2})\s*(" + "|".join(_MONTHS) + r")[A-Z]*\.?,?\s*(\d{4})\b")
_CLOCK = re.compile(r",?\s+(\d{1,2}):\s*(\d{1,2})(?::\s*(\d*\.?\d*))?\s*(?:UTC|GMT)")
_MAGNITUDES = tuple(
    re.compile(rf"\b{kind}\s*=?\s*(\d\.?\d*)") for kind in ("MW", "ML", "MS", "MD", "MB", "M")
)
_PLACE = re.compile(r"(\d+\.?\d*)\s*([NS])\s*,?\s*(\d+\.?\d*)\s*([EW])\b")
_SIGNED_PLACE = re.compile(r"([-+]?\d+\.\d+)\s*,?\s+([-+]?\d+\.\d+)")
_DEPTH = re.compile(r"\bH\s*=\s*(\d+\.?\d*)\s*KM")
_PEAK_WITHIN = 0.01  # of the header's peak, beside its rounding
_PEAK_DOUBTFUL = 0.1
# Starts before or after these are none: in the years 68 and 2762 [s].
_EARLIEST, _LATEST = -6e10, 2.5e10
_LONGEST = 10_000_000  # samples that a header may announce


def iso_date(text: str) -> str:
    """First date in a text as YYYY-MM-DD (months before days, as in the USA); else nothing."""
    text = text.upper()
    found = _YEAR_MONTH_DAY.search(text)
    if found:
        year, month, day = (int(part) for part in found.groups())
    elif found := _MONTH_DAY_YEAR.search(text):
        month, day, year = (int(part) for part in found.groups())
        year += (1900 if year >= 30 else 2000) if year < 100 else 0
    elif found := _DAY_NAMED_MONTH.search(text):
        day, month, year = (
            int(found.group(1)),
            _MONTHS.index(found.group(2)) + 1,
            int(found.group(3)),
        )
    elif found := _NAMED_MONTH.search(text):
        month = _MONTHS.index(found.group(1)) + 1
        day, year = int(found.group(2)), int(found.group(3))
    else:
        return ""
    return f"{year:04d}-{month:02d}-{day:02d}" if 1 <= month <= 12 and 1 <= day <= 31 else ""


def utc_time(text: str) -> UTCDateTime | None:
    """Date and time of day in a text that says UTC or GMT; None if there is none such."""
    date, clock = iso_date(text), _CLOCK.search(text.upper())
    if not date or clock is None:
        return None
    hour, minute, second = clock.groups()
    try:
        midnight = UTCDateTime(date)
        seconds = 3600 * int(hour) + 60 * int(minute) + float((second or "").rstrip(".") or 0)
    except (ValueError, TypeError, OverflowError):
        return None
    return midnight + seconds if seconds < 86400 else None


def magnitude(text: str) -> float | None:
    """Magnitude in a text, the first there is of moment, local, surface-wave and other ones."""
    for kind in _MAGNITUDES:
        found = kind.search(text.upper())
        if found and 0.0 < float(found.group(1)) < 10.0:
            return float(found.group(1))
    return None


def place(text: str) -> tuple[float, float] | None:
    """Latitude and longitude in a text such as ``34.2N, 118.5W`` or ``34.2 -118.5`` [degrees]."""
    found = _PLACE.search(text.upper())
    if found:
        latitude = float(found.group(1)) * (1 if found.group(2) == "N" else -1)
        longitude = float(found.group(3)) * (1 if found.group(4) == "E" else -1)
    elif found := _SIGNED_PLACE.search(text):
        latitude, longitude = float(found.group(1)), float(found.group(2))
    else:
        return None
    return (latitude, longitude) if abs(latitude) <= 90 and abs(longitude) <= 360 else None


def depth(text: str) -> float | None:
    """Depth in a text such as ``H= 18KM`` [km]."""
    found = _DEPTH.search(text.upper())
    return float(found.group(1)) if found else None


def whole_count(text: str, where: str) -> int:
    """Number of samples that a header announces.

    Raises
    ------
    RecordError
        If it is none that a record can have; begins with `where`.
    """
    count = int(text) if text.strip().isdigit() and len(text.strip()) < 12 else -1
    if not 2 <= count <= _LONGEST:
        raise RecordError(
            f"{where}: {text.strip()!r} samples are announced; a record has 2 to {_LONGEST}"
        )
    return count


def positive_step(value: float, where: str) -> float:
    """A time step [s] if it is one.

    Raises
    ------
    RecordError
        If it is not a positive finite number; begins with `where`.
    """
    if not (math.isfinite(value) and value > 0.0):
        raise RecordError(f"{where}: time step {value:g} s must be a positive number of seconds")
    return value


def direction(text: str) -> dict[str, Any]:
    """Component, azimuth and whether it is vertical, of a text such as ``90 DEG`` or ``UP``."""
    word = text.strip().upper()
    found = re.match(r"(\d{1,3})\s*(?:DEG|\.|$)", word)
    if found and int(found.group(1)) <= 360:
        code = str(int(found.group(1)))
        return {"component": code, "azimuth": float(code), "vertical": False}
    found = re.match(r"([NS])\s*(\d{1,2})\s*([EW])\b", word)
    if found:
        north, east = found.group(1) == "N", found.group(3) == "E"
        angle = float(found.group(2))
        azimuth = (angle if east else -angle) if north else (180 - angle if east else 180 + angle)
        return {"component": found.group(0), "azimuth": azimuth % 360, "vertical": False}
    if re.match(r"(UP|VERT|DOWN|DWN|[-+]?[UVZ]\b)", word):
        down = word.startswith(("DOWN", "DWN", "-"))
        return {"component": "DOWN" if down else "UP", "vertical": True}
    named = {"N": 0.0, "NORTH": 0.0, "NS": 0.0, "E": 90.0, "EAST": 90.0, "EW": 90.0,
             "S": 180.0, "SOUTH": 180.0, "W": 270.0, "WEST": 270.0}  # fmt: skip
    code = (word.split() or [""])[0]
    if code in named:
        return {"component": code, "azimuth": named[code], "vertical": False}
    return {"component": code}


def known(**facts: Any) -> dict[str, Any]:
    """The facts without those that a header leaves open."""
    return {key: fact for key, fact in facts.items() if fact not in (None, "")}


def judge_peak(
    record: dict[str, Any], stated: str, values: NDArray[np.float64], unit: str
) -> None:
    """Compare the peak that a header states with the samples, with and without their mean.

    A sentence goes to ``faults`` of the record, or to ``doubts`` if the peak is off by more
    than a tenth: then the unit, the scale or the samples are hardly what the header says.

    Parameters
    ----------
    record : dict
    stated : str
        As in the header: its last digit says how it was rounded.
    values : array, shape (n,)
        In `unit`, that of the peak.
    """
    try:
        number = Decimal(stated.strip().upper().replace("D", "E"))
    except InvalidOperation:
        return
    if values.size == 0 or not number.is_finite() or number == 0:
        return
    peak = abs(float(number))
    rounding = 10.0 ** int(number.as_tuple().exponent)
    found = [float(np.abs(row).max()) for row in (values, values - values.mean())]
    nearest = min(found, key=lambda value: abs(value - peak))
    off = abs(nearest - peak) - rounding
    if off > _PEAK_WITHIN * peak:
        sentence = (
            f"the header states a peak of {peak:g} {unit}, the samples have {nearest:.4g} {unit}"
        )
        key = "doubts" if off > _PEAK_DOUBTFUL * peak else "faults"
        record[key] = (*record.get(key, ()), sentence)


def stream_of(traces: list[Trace]) -> Stream:
    """The traces as a stream, told apart by their channel numbers where their codes are equal."""
    ids = [trace.id for trace in traces]
    for number, trace in enumerate(traces, start=1):
        if ids.count(trace.id) > 1:
            own = trace.stats.record.get("channel", number)
            trace.stats.location = f"{trace.stats.location}{own}"
    seen: set[str] = set()
    for number, trace in enumerate(traces, start=1):
        if trace.id in seen:
            trace.stats.location = f"{trace.stats.location}-{number}"
        seen.add(trace.id)
    return Stream(traces)


def trace_of(
    samples: NDArray[np.float64], dt: float, record: dict[str, Any], *,
    codes: tuple[str, str, str] = ("", "", ""), start: UTCDateTime | None = None,
) -> Trace:  # fmt: skip
    """A trace with what the header says under ``stats.record``.

    Parameters
    ----------
    codes : tuple of str
        Network, station and location; the channel is the component of the record.
    """
    network, station, location = codes
    header: dict[str, Any] = {
        "delta": dt, "network": network, "station": station, "location": location,
        "channel": record.get("component", ""), "record": AttribDict(record),
    }  # fmt: skip
    if start is not None and _EARLIEST < start.timestamp < _LATEST:
        header["starttime"] = start
    return Trace(samples, header=header)


def number_of(text: str | None) -> float:
    """A number of a header; NaN where there is none."""
    try:
        return float((text or "").upper().replace("D", "E"))
    except ValueError:
        return math.nan


def number_or_none(text: str | None) -> float | None:
    """A finite number of a header, None where there is none."""
    value = number_of(text)
    return value if math.isfinite(value) else None


def acceleration_unit(text: str, where: str) -> str:
    """A unit of acceleration as archfrag spells it.

    Raises
    ------
    RecordError
        If it is none; begins with `where`.

    Examples
    --------
    >>> acceleration_unit("cm/s^2", "a.ASC"), acceleration_unit("m/s/s", "a.acc")
    ('cm/s2', 'm/s2')
    """
    plain = re.sub(r"[\s^*()]", "", text.lower()).replace("sec", "s").replace("/s/s", "/s2")
    if plain not in METRES_PER_SECOND_SQUARED:
        raise RecordError(
            f"{where}: unknown unit {text.strip()[:40]!r} of acceleration; allowed are "
            f"{', '.join(METRES_PER_SECOND_SQUARED)}"
        )
    return plain


def add_fault(trace: Trace, sentence: str) -> None:
    """Add a sentence to what is odd about a record."""
    record = trace.stats.record
    record.faults = (*record.get("faults", ()), sentence)
