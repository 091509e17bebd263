"""Volumes 1 and 2 of CSMIP (CDMG, CGS), as a waveform plug-in of obspy.

A channel is 13 (volume 1) or 25 (volume 2) lines of text, integers in columns of 5 and reals in
columns of 10, then a line with count, step and unit and samples in columns; volume 2 goes on with
velocity and displacement. Volume 1 of digitised film has no such line but pairs of time and
acceleration in columns of 7. A file holds one channel or more. Layout after the headers of the
files themselves and Shakal and Ragsdale, "Acceleration, velocity and displacement data in CSMIP
volumes", California Division of Mines and Geology, OSMS 85-03, 1985.
"""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from obspy import Stream, Trace

from archfrag.errors import RecordError
from archfrag.motions.formats import facts
from archfrag.motions.formats.text import (
    END_OF_DATA,
    Source,
    clipped,
    format_width,
    head_lines,
    next_line,
    numbers,
    on_even_steps,
    read_lines,
    source_name,
)

_FIRST = re.compile(r"\s*(UN)?CORRECTED ACCELEROGRAM\b", re.IGNORECASE)
_SECOND = re.compile(r"\s*UNCORRECTED ACCELEROGRAM DATA", re.IGNORECASE)
_COUNT_LINE = re.compile(r"NO\. OF POINTS\s*=\s*(\S*)\s+RECORD LENGTH", re.IGNORECASE)
_SECTION = re.compile(r"\s*(\S+)\s+(?:POINTS OF ACCEL|ACCELEROGRAM POINTS)", re.IGNORECASE)
_STEP = re.compile(r"SPACED AT\s+(\S+)\s+SEC|AT\s+(\S+)\s+PTS/SEC", re.IGNORECASE)
_WORDS = re.compile(r"[A-Za-z]{4}|/&|END", re.IGNORECASE)
_STATION = re.compile(r"STATION\s+(?:NO|ID)\.\s*(\w+)(?=\s)", re.IGNORECASE)
_CHANNEL = re.compile(r"CHAN\s*(\d+)?\s*:\s*(.*)", re.IGNORECASE)
_PEAK = {
    "raw": re.compile(r"MAX\s*=\s*([-+.\d]+)\s*([A-Z/]+)", re.IGNORECASE),
    "processed": re.compile(r"PEAK ACCELERATION\s*=\s*([-+.\d]+)\s*([A-Z/]+)", re.IGNORECASE),
}
_CHANNELS = re.compile(r"\(\s*(\d+)\s*CHNS?\s+OF", re.IGNORECASE)
_UNITS = (
    (re.compile(r"\bG\s*/\s*10\b", re.IGNORECASE), "g", 0.1),
    (re.compile(r"\bCM/S(?:EC)?(?:/S(?:EC)?|2|/S2)", re.IGNORECASE), "cm/s2", 1.0),
    (re.compile(r"\bMM/S(?:EC)?(?:/S(?:EC)?|2|/S2)", re.IGNORECASE), "mm/s2", 1.0),
    (re.compile(r"(?:UNITS:?|IN|AND|OF|IS)\s+G\b", re.IGNORECASE), "g", 1.0),
)
_TEXT_LINES = {"raw": 13, "processed": 25}
_NUMBER_LINES = {"raw": 14, "processed": 20}  # of integers and reals
_LOOK = 12  # lines beyond them in which the section may begin
_WIDTH, _PAIR_WIDTH = 10, 7


class _Data(NamedTuple):
    samples: NDArray[np.float64]
    dt: float
    announced: int
    held: int
    unit: str
    log: tuple[str, ...]
    end: int  # first line after them


def is_dmg(source: Source) -> bool:
    """Tell whether a file or open binary buffer holds volume 1 or 2 of CSMIP."""
    lines = head_lines(source)
    found = _FIRST.match(lines[0]) if len(lines) > 13 else None
    if found is None:
        return False
    if found.group(1):
        return any(_COUNT_LINE.search(line) for line in lines[8:13])
    return _SECOND.match(lines[1]) is not None


def read_dmg(source: Source, **_: Any) -> Stream:
    """Read the accelerations of volume 1 or 2 of CSMIP.

    Parameters
    ----------
    source : path or open binary buffer

    Returns
    -------
    obspy.Stream
        A trace for each channel in the unit of the file, g/10 as g; ``stats.record`` has what the
        header says.

    Raises
    ------
    RecordError
        If a header cannot be read or a sample is not a finite number.
    """
    name, lines = source_name(source), read_lines(source)
    traces: list[Trace] = []
    place, stated = 0, 0
    while (place := next_line(lines, place)) < len(lines):
        trace, place, channels = _channel(lines, place, name)
        stated = max(stated, channels)
        traces.append(trace)
    if stated > len(traces):
        facts.add_fault(
            traces[0], f"the header counts {stated} channels, the file holds {len(traces)}"
        )
    return facts.stream_of(traces)


def _channel(lines: Sequence[str], place: int, name: str) -> tuple[Trace, int, int]:
    found = _FIRST.match(lines[place])
    if found is None:
        raise RecordError(
            f"{name}, line {place + 1}: a line that begins (UN)CORRECTED ACCELEROGRAM is needed "
            f"for a channel, this is {lines[place].strip()[:60]!r}"
        )
    level = "raw" if found.group(1) else "processed"
    text = clipped(lines[place : place + _TEXT_LINES[level]])
    if len(text) < _TEXT_LINES[level]:
        raise RecordError(f"{name}, line {len(lines)}: the file ends in a header")
    data = _data(lines, place, level, name)
    shift = 0 if level == "raw" else 1
    record, code, position = _record(text[shift:])
    record |= {"level": level, "announced": data.announced, "held": data.held,
               "unit": data.unit, "log": data.log, "header": "\n".join(text)}  # fmt: skip
    peak = next(filter(None, map(_PEAK[level].search, text)), None)
    if peak and _unit_of(f"in {peak.group(2)}")[0] == data.unit:
        facts.judge_peak(record, peak.group(1), data.samples, data.unit)
    end, complete = _end_of_channel(lines, data.end)
    start = next(filter(None, map(facts.utc_time, text[3 + shift : 4 + shift])), None)
    trace = facts.trace_of(data.samples, data.dt, record, codes=("", code, position), start=start)
    if not complete:
        facts.add_fault(trace, "there is no end-of-data line: the file may be cut off")
    _compare_places(trace, lines[place + len(text) : data.end])
    channels = _CHANNELS.search("\n".join(text))
    return trace, end, int(channels.group(1)[:6]) if channels else 0


def _data(lines: Sequence[str], place: int, level: str, name: str) -> _Data:
    begin = place + _TEXT_LINES[level]
    window = range(begin, min(begin + _NUMBER_LINES[level] + _LOOK, len(lines)))
    section = next((i for i in window if _SECTION.match(lines[i])), None)
    if section is None and level == "processed":
        raise RecordError(
            f"{name}, line {place + 1}: no line with the points of acceleration follows the header"
        )
    if section is None:
        return _pairs(lines, place, begin + _NUMBER_LINES[level], name)
    where = f"{name}, line {section + 1}"
    (line,) = clipped(lines[section : section + 1])
    announced = facts.whole_count(_group(_SECTION, line), where)
    step = _step(line, where)
    unit, scale = _unit_of(line)
    end = _end_of_numbers(lines, section + 1)
    width = format_width(line) or _WIDTH
    samples = numbers(lines[section + 1 : end], section + 2, name, expected=announced, width=width)
    return _Data(samples * scale, step, announced, samples.size, unit, (), end)


def _pairs(lines: Sequence[str], place: int, first: int, name: str) -> _Data:
    text = clipped(lines[place : place + _TEXT_LINES["raw"]])
    line = next((i for i, each in enumerate(text) if _COUNT_LINE.search(each)), None)
    if line is None:
        raise RecordError(f"{name}, line {place + 1}: the header has no NO. OF POINTS")
    announced = facts.whole_count(
        _group(_COUNT_LINE, text[line]), f"{name}, line {place + line + 1}"
    )
    units = next((each for each in text if "UNITS OF" in each.upper()), "")
    unit, scale = _unit_of(units)
    end = _end_of_numbers(lines, first)
    values = numbers(lines[first:end], first + 1, name, expected=2 * announced, width=_PAIR_WIDTH)
    held = values.size // 2
    if held < 2:
        return _Data(values[:0], 1.0, announced, held, unit, (), end)
    times, samples = values[: 2 * held : 2], values[1 : 2 * held : 2] * scale
    samples, step, sentence = on_even_steps(times, samples, f"{name}, line {first + 1}")
    log = tuple(filter(None, ("Unit g/10 turned into g." if scale != 1.0 else "", sentence)))
    return _Data(samples, step, announced, held, unit, log, end)


def _end_of_numbers(lines: Sequence[str], place: int) -> int:
    return next((i for i in range(place, len(lines)) if _WORDS.search(lines[i])), len(lines))


def _end_of_channel(lines: Sequence[str], place: int) -> tuple[int, bool]:
    for i in range(place, len(lines)):
        if END_OF_DATA.match(lines[i]):
            return i + 1, True
        if _FIRST.match(lines[i]):
            return i, False
    return len(lines), False


def _step(line: str, where: str) -> float:
    found = _STEP.search(line)
    try:
        given = found.group(1) or found.group(2) if found else ""
        value = float(given)
    except ValueError:
        raise RecordError(f"{where}: no time step is stated in {line.strip()!r}") from None
    if found and found.group(2):
        value = 1.0 / value if value else 0.0
    return facts.positive_step(value, where)


def _unit_of(text: str) -> tuple[str, float]:
    found = ((unit, scale) for pattern, unit, scale in _UNITS if pattern.search(text))
    return next(found, ("", 1.0))


def _group(pattern: re.Pattern[str], line: str) -> str:
    found = pattern.search(line)
    return found.group(1) if found else ""


def _record(text: Sequence[str]) -> tuple[dict[str, Any], str, str]:
    """What the lines of a header say, the station's code and the place of the sensor."""
    channel = _CHANNEL.search(text[6])
    number, way = channel.groups() if channel else (None, "")
    way, _, position = way.partition("LOCATION:")
    named = "" if re.match(r"\s*RE?CO?RD OF", text[1], re.IGNORECASE) else text[1].strip()
    origin = text[2].upper().partition("ORIGIN")[2]
    hypocentre = facts.place(text[8])
    station = facts.place(text[4])
    record = facts.known(
        event=named,
        date=facts.iso_date(origin) or facts.iso_date(text[2]) or facts.iso_date(text[1]),
        magnitude=facts.magnitude(text[8]),
        depth_km=facts.depth(text[8]),
        event_latitude=hypocentre[0] if hypocentre else None,
        event_longitude=hypocentre[1] if hypocentre else None,
        station=re.split(r"\s{3,}", text[5].strip())[0],
        station_latitude=station[0] if station else None,
        station_longitude=station[1] if station else None,
        channel=number,
    )
    record |= facts.direction(way)
    return record, _group(_STATION, text[4]), re.sub(r"\s+", " ", position).strip()


def _compare_places(trace: Trace, lines: Sequence[str]) -> None:
    """Later headers give the station among their reals, too."""
    record = trace.stats.record
    try:
        reals = [float(lines[10][i : i + 10]) for i in range(40, 60, 10)]
        text = record.station_latitude, record.station_longitude
    except (IndexError, ValueError, AttributeError):
        return
    for word, stated, real in zip(("latitude", "longitude"), text, reals):
        if real not in (0.0, -999.0) and abs(real) <= 360.0 and abs(stated - real) > 0.01:
            facts.add_fault(
                trace,
                f"{word} of the station is {stated:g} in the text of the header and {real:g} "
                "among its numbers",
            )
