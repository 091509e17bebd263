"""GeoNet volumes V1A (raw) and V2A (processed), as a plug-in of obspy.

One block for each component: 16 lines of text, 4 of integers and 6 of reals, ten to a line, then
samples in columns of 8 characters, ten to a line. A V2A block holds accelerations [mm/s2],
velocities [mm/s] and displacements [mm] one after the other, each beginning a line; integers 34
to 36 say how many. Integers 9, 10, 19, 20, 39 and 40 are year, month, day, hour, minute and
millisecond of the first sample.
"""

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Stream, Trace, UTCDateTime

from archfrag.errors import RecordError
from archfrag.motions.formats import facts
from archfrag.motions.formats.text import Source, head_lines, numbers, read_lines, source_name

TEXT_LINES, INTEGER_LINES, HEADER_LINES, WIDTH = 16, 4, 26, 8
_START = re.compile(r"\s*(Un)?corrected accelerogram\b", re.IGNORECASE)
_PLACE = r"(\d{1,3}) +(\d\d?) +(\d\d?)([NS]) +(\d{1,3}) +(\d\d?) +(\d\d?)([EW])"
_FIELDS = {
    "site": r"^\s*Site +(\S+) +" + _PLACE,
    "count": r"^\s*Number of points +(\S+)",
    "interval": r"\bat (?:intervals of )?(\S+) s(?:ec)?\b",
    "factor": r"readings in units of +(\S+) +(\S+)",
    "component": r"^\s*Component +(\S+)",
    "peak": r"^\s*Acceleration: +peak +(\S+) +(\S+)",
    "epicentre": r"^\s*Epicentre +" + _PLACE,
    "distance": r"^\s*Epicentre .*\bDist +([\d.]+) *km",
    "depth": r"^\s*Epicentre .*\bDepth +([\d.]+) *km",
    "magnitude": r"^\s*Epicentre .*\bM[A-Za-z]? +([\d.]+)\s*$",
    "year": r"^\s*(\d{4} [A-Z][a-z]+ +\d+) +\d\d:\d\d:\d\d",
}
_PATTERNS = {key: re.compile(text, re.MULTILINE | re.IGNORECASE) for key, text in _FIELDS.items()}
_QUADRANT = re.compile(r"([NS])(\d+(?:\.\d+)?)([EW])", re.IGNORECASE)


def is_geonet(source: Source) -> bool:
    """Tell whether a file or open binary buffer is a GeoNet volume V1A or V2A.

    True if the first line names an accelerogram, the second a site, and one of the next the
    number of points.
    """
    lines = head_lines(source)[:TEXT_LINES]
    return (
        len(lines) == TEXT_LINES
        and _START.match(lines[0]) is not None
        and lines[1].lstrip().startswith("Site ")
        and _PATTERNS["count"].search("\n".join(lines)) is not None
    )


def read_geonet(source: Source, **_: Any) -> Stream:
    """Read the accelerations of a GeoNet volume V1A or V2A.

    Parameters
    ----------
    source : path or open binary buffer

    Returns
    -------
    obspy.Stream
        One trace for each component in the unit of the file, with ``stats.record``. The
        velocities and displacements of a V2A are counted and left out.

    Raises
    ------
    RecordError
        If a header is cut off or lacks the number of points or time step, a V2A block does not
        hold the numbers that its header announces, or a sample is no finite number.
    """
    name, lines = source_name(source), read_lines(source)
    starts = [i for i, line in enumerate(lines) if _START.match(line)]
    if not starts:
        raise RecordError(f"{name}: no line begins an accelerogram")
    ends = [*starts[1:], len(lines)]
    return Stream([_trace(lines[a:b], a + 1, name) for a, b in zip(starts, ends)])


def _trace(block: list[str], first: int, name: str) -> Trace:
    place = f"{name}, line {first}"
    if len(block) <= HEADER_LINES:
        raise RecordError(
            f"{place}: a component has {HEADER_LINES} header lines and then samples; this one "
            f"ends after {len(block)} line(s)"
        )
    text = "\n".join(block[:TEXT_LINES])
    found = {key: pattern.search(text) for key, pattern in _PATTERNS.items()}

    def field(key: str, group: int = 1) -> str:
        match = found[key]
        return match.group(group) if match else ""

    component = field("component")
    integers = numbers(block[TEXT_LINES : TEXT_LINES + INTEGER_LINES], first + TEXT_LINES, name)
    announced = facts.whole_count(field("count"), f"{place}: Number of points")
    step = facts.number_of(field("interval"))
    samples = _samples(block[HEADER_LINES:], first + HEADER_LINES, name, integers, component)
    unit = facts.acceleration_unit(field("peak", 2) or field("factor", 2), place)
    if found["factor"]:
        samples = samples * _factor(field("factor"), place)
    record = facts.known(
        unit=unit,
        level="raw" if block[0].lstrip()[:2].lower() == "un" else "processed",
        announced=announced,
        component=component,
        vertical=component.lower() in ("up", "down") if component else None,
        azimuth=_azimuth(component),
        event=block[6].strip(),
        date=_date(field("year")),
        magnitude=facts.number_or_none(field("magnitude")),
        depth_km=facts.number_or_none(field("depth")),
        event_latitude=_degrees(found["epicentre"], 1),
        event_longitude=_degrees(found["epicentre"], 5),
        station=field("site"),
        station_latitude=_degrees(found["site"], 2),
        station_longitude=_degrees(found["site"], 6),
        epicentral_km=facts.number_or_none(field("distance")),
        header="\n".join(line.rstrip() for line in block[:HEADER_LINES]),
    )
    facts.judge_peak(record, field("peak"), samples, unit)
    return facts.trace_of(
        samples,
        facts.positive_step(step, f"{place}: interval"),
        record,
        codes=("NZ", field("site"), ""),
        start=_first_sample(integers),
    )


def _samples(
    lines: list[str], first: int, name: str, integers: NDArray[np.float64], component: str
) -> NDArray[np.float64]:
    """Accelerations of a block; those of a raw volume may be fewer or more than announced."""
    if integers.size != 10 * INTEGER_LINES:
        raise RecordError(
            f"{name}: the lines before line {first} must have {10 * INTEGER_LINES} integers, "
            f"channel {component} has {integers.size}"
        )
    counts = integers[33:36].astype(int)
    values = numbers(lines, first, name, expected=int(counts.sum()), width=WIDTH)
    if counts[1:].any() and values.size != counts.sum():
        raise RecordError(
            f"{name}: channel {component} must hold {counts[0]} accelerations, {counts[1]} "
            f"velocities and {counts[2]} displacements by its header; it holds {values.size} "
            "numbers"
        )
    return values[: counts[0]] if counts[1:].any() else values


def _factor(text: str, place: str) -> float:
    """What raw readings are multiplied by."""
    factor = facts.number_or_none(text)
    if not factor:
        raise RecordError(f"{place}: readings in units of {text!r}; a number but 0 is needed")
    return factor


def _azimuth(component: str) -> float | None:
    """Degrees clockwise from north of a bearing such as S16W."""
    match = _QUADRANT.fullmatch(component)
    if match is None:
        return None
    origin, angle, towards = match.group(1).upper(), float(match.group(2)), match.group(3).upper()
    angle = angle if origin == "N" else 180.0 - angle
    return (angle if towards == "E" else -angle) % 360.0


def _degrees(match: re.Match[str] | None, group: int) -> float | None:
    if match is None:
        return None
    degrees, minutes, seconds, letter = match.groups()[group - 1 : group + 3]
    value = int(degrees) + int(minutes) / 60.0 + int(seconds) / 3600.0
    return round(-value if letter in "SWsw" else value, 5)


def _date(text: str) -> str | None:
    from datetime import datetime

    try:
        return datetime.strptime(" ".join(text.split()), "%Y %B %d").date().isoformat()
    except ValueError:
        return None


def _first_sample(integers: NDArray[np.float64]) -> UTCDateTime | None:
    year, month, day, hour, minute, milliseconds = integers[[8, 9, 18, 19, 38, 39]]
    try:
        midnight = UTCDateTime(int(year), int(month), int(day))
    except (ValueError, OverflowError):
        return None
    return midnight + 3600.0 * hour + 60.0 * minute + milliseconds / 1000.0
