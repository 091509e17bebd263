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
from archfrag.motions.channel import quadrant
from archfrag.motions.formats import layout

# SMC: first line, number of lines, numbers and width of integers and reals.
_NUMBERS = {"integer": (11, 6, 48, 10), "real": (17, 10, 50, 15)}
_LEVELS = {"1": "raw", "2": "processed"}

# GeoNet: lines of text, of text and integers, and of the header.
_TEXT_LINES = 16
_INTEGERS_END = 20
_HEADER_LINES = 26
_FIELDS = {
    "announced": (str, r"^\s*Number of points +(\S+)"),
    "interval": (layout.number, r"\bat (?:intervals of )?(\S+) s(?:ec)?\b"),
    "factor": (str, r"readings in units of +(\S+)"),
    "peak": (str, r"^\s*Acceleration: +peak +(\S+) +\S+"),
    "unit": (
        str,
        r"^\s*Acceleration: +peak +\S+ +(\S+)",
        r"readings in units of +\S+ +(\S+)",
    ),
    "code": (str, r"^\s*Component +(\S+)"),
    "azimuth": (quadrant, r"^\s*Component +(\S+)"),
    "vertical": (lambda text: text.lower() in ("up", "down"), r"^\s*Component +(\S+)"),
    "date": (layout.iso_date, r"^\s*(\d{4} [A-Z][a-z]+ +\d+) +\d\d:\d\d:\d\d"),
    "magnitude": (layout.number, r"^\s*Epicentre .*\bM[A-Za-z]? +([\d.]+)\s*$"),
    "epicentral_km": (layout.number, r"^\s*Epicentre .*\bDist +([\d.]+) *km"),
    "station": (str, r"^\s*Site +(\S+) +\d"),
    "length": (layout.number, r"\bDuration +(\S+) *s"),
}


# A title, lines of which some are only a star, the component, and lines of integers.
is_smc = layout.begins_with(
    r"\A\s*[1-9]\s+[A-Z].*(?:\n.*){4}\n(?i:station\s*=.*component\s*=)(?:.*\n){6}"
    r"(?:[-+\d \t]+\n){6}",
    r"\A.*(?:(?:\n.*){0,7}?\n[ \t]*\*[ \t]*(?=\n)){3}",
)


def read_smc(source: layout.Source, **_: Any) -> Stream:
    """Read the acceleration of an SMC file, in cm/s2."""
    text = layout.Text(source)
    head = [*text.head(0, 11), *[""] * 6]
    level = _LEVELS.get(layout.search(r"\A\s*([1-9])\s+[A-Z]", head[0]))
    if level is None or "ACCEL" not in head[0].upper():
        raise text.needs(0, "an accelerogram (type 1 or 2)")
    numbers = []
    for kind, (place, height, many, width) in _NUMBERS.items():
        numbers.append(text.numbers(place, place + height, many, width))
        if numbers[-1].size != many:
            raise RecordError(
                f"{text.place(place)}: {numbers[-1].size} of {many} {kind} numbers"
            )
    integers, reals = numbers
    first = text.first(27, lambda line: not line.lstrip().startswith("|"))
    count = layout.checked_count(f"{integers[16]:.0f}", text.place(13))
    values = text.numbers(first, None, count, 10)
    stated = {i: value for i, value in enumerate(reals.tolist()) if value != reals[0]}
    names = re.match(r"(?i)station\s*=\s*(.*?)\s*component\s*=\s*(.*)", head[5])
    station, bearing = names.groups() if names else ("", "")
    record = layout.direction(bearing)
    tilt = integers[12]  # degrees from the vertical, from north
    azimuth = integers[13]
    if tilt in (0.0, 180.0):
        record |= {"code": "UP" if tilt == 0.0 else "DOWN", "vertical": True}
    elif tilt == 90.0 and azimuth != integers[0] and 0 <= azimuth <= 360:
        record |= {"azimuth": float(azimuth), "vertical": False}
    year, day, hour, minute, second = integers[1:6]
    dated = (
        layout.moment(year, 1, 1, 24.0 * (day - 1), 0, 0) if 1 <= day <= 366 else None
    )
    start = None
    if dated and 0 <= hour < 24 and 0 <= minute < 60:
        start = (
            dated
            + 3600.0 * hour
            + 60.0 * minute
            + (second if 0 <= second < 60 else 0.0)
        )
    record |= {
        "event": re.sub(r"^[\s\d]+", "", head[3]).strip(),
        "station": station,
        "date": str(dated.date) if dated else "",
        "epicentral_km": stated.get(16),
        "magnitude": next(filter(None, map(stated.get, (5, 7, 6, 8))), None),
    }
    log = []
    step = 1.0 / stated[1] if stated.get(1) else None
    per = 1 if 1 in stated else 2
    # Writers of uncorrected volumes left a last row of what was in their memory.
    if count < values.size <= count + 8:
        values = values[:count]
        log.append(f"Row left out: it is beyond the {count} numbers of the header.")
    record |= {
        "level": level,
        "unit": "cm/s2",
        "announced": count // per,
        "held": values.size // per,
    }
    if per == 2:  # pairs of time and acceleration
        values, step, done = layout.on_even_steps(values, text.name)
        log += filter(None, (done,))
    peaks = [abs(stated[index]) for index in (29, 31) if index in stated]
    return Stream(
        [
            layout.trace_of(
                values,
                step,
                text.place(first - 1),
                record | {"log": log},
                start=start,
                peak=f"{max(peaks):.6E}" if peaks else "",
                codes=("", head[2].strip().split(" ")[0], ""),
            )
        ]
    )


_START = r"(?i)\A\s*(Un)?corrected accelerogram\b"
is_geonet = layout.begins_with(
    _START + r".*\n\s*(?-i:Site )(?:.*\n){1,13}\s*Number of points +\S"
)


def read_geonet(source: layout.Source, **_: Any) -> Stream:
    """Read the accelerations of a GeoNet volume; velocities and displacements are left out."""
    text = layout.Text(source)
    starts = [i for i, line in enumerate(text.lines) if re.match(_START, line)]
    if not starts:
        raise RecordError(f"{text.name}: no line begins an accelerogram")
    ends = [*starts[1:], len(text.lines)]
    return Stream([_geonet_trace(text, a, b) for a, b in zip(starts, ends)])


def _geonet_trace(text: layout.Text, first: int, end: int) -> Trace:
    place = text.place(first)
    data = first + _HEADER_LINES
    if end <= data:
        raise RecordError(
            f"{place}: ends after {end - first} line(s), {_HEADER_LINES} are header"
        )
    head = "\n".join(text.lines[first : first + _TEXT_LINES])
    record: dict[str, Any] = {"code": "", "unit": "", "announced": "", "factor": "1"}
    record |= layout.read_fields(_FIELDS, lambda pattern: layout.search(pattern, head))
    interval, factor, peak = (
        record.pop(key, "") for key in ("interval", "factor", "peak")
    )
    integers = text.numbers(first + _TEXT_LINES, first + _INTEGERS_END)
    channel = f"{text.name}: channel {record['code']}"
    if integers.size != 40:
        raise RecordError(
            f"{channel} has {integers.size} of 40 integers before line {data + 1}"
        )
    # Accelerations, velocities and displacements; a raw volume has the first only, however many.
    counts = integers[33:36].astype(int)
    samples = text.numbers(data, end, int(counts.sum()), 8)
    if counts[1:].any():
        if samples.size != counts.sum():
            needed = "{} accelerations, {} velocities and {} displacements".format(
                *counts
            )
            raise RecordError(f"{channel} must hold {needed}; it holds {samples.size}")
        samples = samples[: counts[0]]
    if not (scale := layout.number(factor)):
        raise RecordError(f"{place}: readings in units of {factor!r}, not a number")
    raw = re.match(_START, text.lines[first])[1]  # type: ignore[index]
    record |= {
        "unit": layout.acceleration_unit(record["unit"], place),
        "announced": layout.checked_count(
            record["announced"], f"{place}: Number of points"
        ),
        "level": "raw" if raw else "processed",
        "event": text.lines[first + 6].strip(),
    }
    return layout.trace_of(
        samples * scale,
        interval or None,
        f"{place}: interval",
        record,
        peak=peak,
        codes=("NZ", record.get("station", ""), ""),
        # Year, month, day, hour, minute and millisecond of the first sample.
        start=layout.moment(*integers[[8, 9, 18, 19, 38, 39]] / (1, 1, 1, 1, 1, 1000)),
    )
