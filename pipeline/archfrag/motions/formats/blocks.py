"""Formats whose header is lines of text, integers and reals in fixed places, for obspy.

- SMC of the U.S. Geological Survey, one component a file: 11 lines of text, 48 integers in
  columns of 10, 50 reals in columns of 15, comments that begin with ``|``, samples in cm/s2 in
  columns of 10. Uncorrected volumes of digitised film state no sampling rate and hold pairs of
  time and acceleration. Layout: USGS National Strong-Motion Project, "SMC-format data files"
  (nsmp.wr.usgs.gov/smcfmt.html).
- GeoNet V1A (raw) and V2A (processed), a block for each component: 16 lines of text, 4 of
  integers and 6 of reals, ten to a line, then samples in columns of 8 characters, ten to a line.
  A V2A block holds accelerations [mm/s2], velocities [mm/s] and displacements [mm] one after the
  other, each beginning a line; integers 34 to 36 are how many. Integers 9, 10, 19, 20, 39 and 40
  are year, month, day, hour, minute and millisecond of the first sample.
"""

import re
from typing import Any

from obspy import Stream, Trace

from archfrag.errors import RecordError
from archfrag.motions.formats import common
from archfrag.motions.partners import quadrant

# SMC: lines of text; first line, number of lines, numbers and width of integers and reals.
_TEXT, _END = 11, 27
_NUMBERS = {"integer": (11, 6, 48, 10), "real": (17, 10, 50, 15)}
_TITLE = re.compile(r"\s*([1-9])\s+([A-Z].*)")
_LEVELS = {"1": "raw", "2": "processed"}
_REALS = {"magnitude": (lambda value: value or None, 5, 7, 6, 8), "epicentral_km": (float, 16)}

# GeoNet
_TEXT_LINES, _INTEGER_LINES, _HEADER_LINES, _WIDTH = 16, 4, 26, 8
_START = re.compile(r"\s*(Un)?corrected accelerogram\b", re.IGNORECASE)
_FIELDS = {
    "interval": (str, r"\bat (?:intervals of )?(\S+) s(?:ec)?\b"),
    "factor": (str, r"readings in units of +(\S+)"),
    "peak": (str, r"^\s*Acceleration: +peak +(\S+) +\S+"),
    "unit": (str, r"^\s*Acceleration: +peak +\S+ +(\S+)", r"readings in units of +\S+ +(\S+)"),
}
_FACTS = {
    "component": (str, r"^\s*Component +(\S+)"),
    "azimuth": (quadrant, r"^\s*Component +(\S+)"),
    "vertical": (lambda text: text.lower() in ("up", "down") if text else None,
                 r"^\s*Component +(\S+)"),
    "date": (common.iso_date, r"^\s*(\d{4} [A-Z][a-z]+ +\d+) +\d\d:\d\d:\d\d"),
    "magnitude": (common.number, r"^\s*Epicentre .*\bM[A-Za-z]? +([\d.]+)\s*$"),
    "epicentral_km": (common.number, r"^\s*Epicentre .*\bDist +([\d.]+) *km"),
    "station": (str, r"^\s*Site +(\S+) +\d"),
}  # fmt: skip


# A title, lines of which some are only a star, the component, and lines of integers.
is_smc = common.begins_with(
    r"\A\s*[1-9]\s+[A-Z].*(?:\n.*){4}\n(?i:station\s*=.*component\s*=)(?:.*\n){6}"
    r"(?:[-+\d \t]+\n){6}",
    r"\A.*(?:(?:\n.*){0,7}?\n[ \t]*\*[ \t]*(?=\n)){3}",
)


def read_smc(source: common.Source, **_: Any) -> Stream:
    """Read the acceleration of an SMC file, in cm/s2."""
    text = common.Text(source)
    head = text.head(0, _TEXT)
    level = _LEVELS.get(common.search(_TITLE, head[0]))
    if level is None or "ACCEL" not in head[0].upper():
        raise text.needs(0, "an accelerogram (type 1 or 2)")
    numbers = []
    for kind, (place, height, many, width) in _NUMBERS.items():
        numbers.append(text.numbers(place, place + height, many, width))
        if numbers[-1].size != many:
            raise RecordError(f"{text.place(place)}: {numbers[-1].size} of {many} {kind} numbers")
    integers, reals = numbers
    first = text.first(_END, lambda line: not line.lstrip().startswith("|"))
    count = common.checked_count(f"{integers[16]:.0f}", text.place(_TEXT + 2))
    values = text.numbers(first, None, count, 10)
    known = {i: value for i, value in enumerate(reals.tolist()) if value != reals[0]}
    found = re.match(r"(?i)station\s*=\s*(.*?)\s*component\s*=\s*(.*)", head[5])
    station, bearing = found.groups() if found else ("", "")
    record = common.direction(bearing)
    tilt, azimuth = integers[12], integers[13]  # degrees from the vertical, from north
    if tilt in (0.0, 180.0):
        record |= {"component": "UP" if tilt == 0.0 else "DOWN", "vertical": True}
    elif tilt == 90.0 and azimuth != integers[0] and 0 <= azimuth <= 360:
        record |= {"azimuth": float(azimuth), "vertical": False}
    day, start = _time(integers[1], integers[2], 0, 0, 0), _time(*integers[1:6])
    event = re.sub(r"^[\s\d]+", "", head[3]).strip()
    record |= common.read_fields(_REALS, known.get)
    record |= common.known(event=event, date=str(day.date) if day else "", station=station)
    log, step = [], 1.0 / known[1] if known.get(1) else None
    # Writers of uncorrected volumes left a last row of what was in their memory.
    if count < values.size <= count + 8:
        values = values[:count]
        log.append(f"Row beyond the {count} numbers that the header counts left out.")
    record |= {"level": level, "unit": "cm/s2", "announced": count, "held": values.size}
    if 1 not in known:  # pairs of time and acceleration
        record |= {"announced": count // 2, "held": values.size // 2}
        values, step, done = common.on_even_steps(values, text.name)
        log += filter(None, (done,))
    record["log"] = tuple(log)
    peaks = [abs(known[index]) for index in (29, 31) if index in known]
    peak = f"{max(peaks):.6E}" if peaks else ""
    codes = ("", head[2].strip().split(" ")[0], "")
    where = text.place(first - 1)
    trace = common.trace_of(values, step, where, record, peak=peak, codes=codes, start=start)
    return Stream([trace])


def _time(year: float, day: float, hour: float, minute: float, second: float) -> Any:
    """Time by the day of the year, None if there is no such time; unknown seconds count as 0."""
    if not (1 <= day <= 366 and 0 <= hour < 24 and 0 <= minute < 60):
        return None
    second = second if 0 <= second < 60 else 0.0
    return common.moment(year, 1, 1, 24.0 * (day - 1) + hour, minute, second)


is_geonet = common.begins_with(
    r"(?i)\A\s*(?:Un)?corrected accelerogram\b.*\n\s*(?-i:Site )(?:.*\n){1,13}"
    r"\s*Number of points +\S"
)


def read_geonet(source: common.Source, **_: Any) -> Stream:
    """Read the accelerations of a GeoNet volume; velocities and displacements are left out."""
    text = common.Text(source)
    starts = [i for i, line in enumerate(text.lines) if _START.match(line)]
    if not starts:
        raise RecordError(f"{text.name}: no line begins an accelerogram")
    ends = [*starts[1:], len(text.lines)]
    return Stream([_geonet_trace(text, a, b) for a, b in zip(starts, ends)])


def _geonet_trace(text: common.Text, first: int, end: int) -> Trace:
    place, data = text.place(first), first + _HEADER_LINES
    if end <= data:
        raise RecordError(f"{place}: ends after {end - first} line(s), {_HEADER_LINES} are header")
    head = "\n".join(text.lines[first : first + _TEXT_LINES])
    field, record = (
        common.read_fields(table, lambda pattern: common.search(pattern, head))
        for table in (_FIELDS, _FACTS)
    )
    integers = text.numbers(first + _TEXT_LINES, first + _TEXT_LINES + _INTEGER_LINES)
    announced = common.checked_count(
        common.search(r"^\s*Number of points +(\S+)", head), f"{place}: Number of points"
    )
    record.setdefault("component", "")
    channel = f"{text.name}: channel {record['component']}"
    if integers.size != 10 * _INTEGER_LINES:
        raise RecordError(f"{channel} has {integers.size} of 40 integers before line {data + 1}")
    # Accelerations, velocities and displacements; a raw volume has the first only, however many.
    counts = integers[33:36].astype(int)
    samples = text.numbers(data, end, int(counts.sum()), _WIDTH)
    if counts[1:].any():
        if samples.size != counts.sum():
            needed = "{} accelerations, {} velocities and {} displacements".format(*counts)
            raise RecordError(f"{channel} must hold {needed}; it holds {samples.size}")
        samples = samples[: counts[0]]
    unit = common.acceleration_unit(field.get("unit", ""), place)
    if stated := field.get("factor"):
        factor = common.number(stated)
        if not factor:
            raise RecordError(f"{place}: readings in units of {stated!r}; a number is needed")
        samples = samples * factor
    raw = text.lines[first].lstrip()[:2].lower() == "un"
    record |= {"unit": unit, "announced": announced, "level": "raw" if raw else "processed"}
    record |= common.known(event=text.lines[first + 6].strip())
    return common.trace_of(
        samples, common.number(field.get("interval")), f"{place}: interval", record,
        peak=field.get("peak", ""), codes=("NZ", record.get("station", ""), ""),
        # Year, month, day, hour, minute and millisecond of the first sample.
        start=common.moment(*integers[[8, 9, 18, 19, 38]], integers[39] / 1000.0),
    )  # fmt: skip
