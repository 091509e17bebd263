"""COSMOS strong-motion files, V0 (counts), V1 (uncorrected) and V2 (corrected), for obspy.

A channel is text, integers, reals and comments, each with a line that says how many and in which
columns, then the samples and a line that ends them. Meaning of the header's numbers after
"COSMOS strong motion data format", version 1.20, Consortium of Organizations for Strong-Motion
Observation Systems, 2001, tables 1 to 8; indices here are from 0.
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
    read_lines,
    source_name,
)

_FIRST = re.compile(r".*\(Format\s+v\d+\.\d+\s+with\s+(\d{1,3})\s+text\s+lines\)", re.IGNORECASE)
_BLOCKS = {
    "integer": re.compile(r"\s*(\d+)\s+Integer-header values follow", re.IGNORECASE),
    "real": re.compile(r"\s*(\d+)\s+Real-header values follow", re.IGNORECASE),
}
_LINES = re.compile(r"follow on\s+(\d+)\s+lines", re.IGNORECASE)
_COMMENTS = re.compile(r"\s*(\d+)\s+Comment line\(s\) follow", re.IGNORECASE)
_SECTION = re.compile(r"\s*(\S+)\s+.*\bpts\b.*units\s*=", re.IGNORECASE)
_WORDS = re.compile(r"[A-Za-z]{4}|/&|END", re.IGNORECASE)
_CHANNEL = re.compile(r"Sta\s+Cha\w*\s*:?\s*([\w?]+)\s*:\s*(.*?)\s*\(Rcrdr", re.IGNORECASE)
_CHANNELS = re.compile(r"\(\s*(\d+)\s*Chns?\s+of", re.IGNORECASE)
_SCNL = re.compile(r"<SCNL>\s*([\w-]+)\.([\w-]+)\.([\w-]+)\.([\w-]+)")
_STATION = re.compile(r"Code:\s*([\w-]+?)-(\w+)\s+(.*)", re.IGNORECASE)
_WEEKDAY = re.compile(r"(Mon|Tue|Wed|Thu|Fri|Sat|Sun)\b", re.IGNORECASE)
_LEVELS = {0: "raw", 1: "raw", 2: "processed"}
_UNITS = {2: ("g", 1.0), 4: ("cm/s2", 1.0), 7: ("cm/s2", 2.54), 50: ("counts", 1.0)}
_NULL = -999.0
_TEXT_LINES = (5, 100)
_HEADER_NUMBERS = (64, 1000)
_LARGEST_HEADER = 200  # lines


class _Channel(NamedTuple):
    text: list[str]
    integers: NDArray[np.float64]
    reals: NDArray[np.float64]
    comments: list[str]
    section: int  # line that announces the samples


def is_cosmos(source: Source) -> bool:
    """Tell whether a file or open binary buffer is a COSMOS file of a time series."""
    lines = head_lines(source)
    return (
        bool(lines)
        and _FIRST.match(lines[0]) is not None
        and any(_BLOCKS["integer"].match(line) for line in lines[1:])
    )


def read_cosmos(source: Source, **_: Any) -> Stream:
    """Read the accelerations of a COSMOS file.

    Parameters
    ----------
    source : path or open binary buffer

    Returns
    -------
    obspy.Stream
        A trace for each channel of acceleration in the unit of the file (in/s2 as cm/s2);
        ``stats.record`` has what the header says. Counts (``unit`` is "counts") come with
        ``g_per_count`` where the header has the sensitivities of recorder and sensor.

    Raises
    ------
    RecordError
        If a header cannot be read, no channel is an acceleration, or a sample is not finite.
    """
    name, lines = source_name(source), read_lines(source)
    traces: list[Trace] = []
    place, other, stated = 0, 0, 0
    while (place := next_line(lines, place)) < len(lines):
        channel = _header(lines, place, name)
        end = _end_of_numbers(lines, channel.section + 1)
        if _is_acceleration(channel, lines[channel.section]):
            traces.append(_trace(lines, channel, end, name))
            found = _CHANNELS.search("\n".join(channel.text))
            stated = max(stated, int(found.group(1)[:6]) if found else 0)
        else:
            other += 1
        place = end
    if not traces:
        raise RecordError(f"{name}: none of the {other} channels of the file is an acceleration")
    if len(traces) < stated:
        facts.add_fault(
            traces[0], f"the header counts {stated} channels, the file holds {len(traces)}"
        )
    return facts.stream_of(traces)


def _header(lines: Sequence[str], place: int, name: str) -> _Channel:
    first = _FIRST.match(lines[place])
    count = int(first.group(1)) if first else 0
    if not _TEXT_LINES[0] <= count <= _TEXT_LINES[1]:
        raise RecordError(
            f"{name}, line {place + 1}: a line with (Format v01.20 with 13 text lines) is needed "
            f"for a channel, this is {lines[place].strip()[:60]!r}"
        )
    text = clipped(lines[place : place + count])
    integers, at = _numbers(lines, place + count, "integer", name)
    reals, at = _numbers(lines, at, "real", name)
    comments: list[str] = []
    found = _COMMENTS.match(lines[at]) if at < len(lines) else None
    if found:
        at += 1
        while at < len(lines) and lines[at].lstrip().startswith("|"):
            comments += clipped(lines[at : at + 1])
            at += 1
    if not any(map(_SECTION.match, clipped(lines[at : at + 1]))):
        raise RecordError(
            f"{name}, line {at + 1}: the line with the number of points and their units is needed "
            f"here, this is {_shown(lines, at)}"
        )
    return _Channel(text, integers, reals, comments, at)


def _numbers(
    lines: Sequence[str], at: int, kind: str, name: str
) -> tuple[NDArray[np.float64], int]:
    """The integers or reals of a header, and the line after them."""
    found = _BLOCKS[kind].match(lines[at]) if at < len(lines) else None
    rows = _LINES.search(lines[at]) if found else None
    if found is None or rows is None:
        raise RecordError(
            f"{name}, line {at + 1}: a line that says how many {kind}-header values follow on how "
            f"many lines is needed here, this is {_shown(lines, at)}"
        )
    count, height = int(found.group(1)[:6]), int(rows.group(1)[:6])
    low, high = _HEADER_NUMBERS
    if not (low <= count <= high and height <= _LARGEST_HEADER):
        raise RecordError(
            f"{name}, line {at + 1}: {count} {kind}-header values on {height} lines; {low} to "
            f"{high} on up to {_LARGEST_HEADER} can be read"
        )
    part = lines[at + 1 : at + 1 + height]
    width = format_width(lines[at])
    values = numbers(part, at + 2, name, expected=count, width=width)
    if values.size < low:
        raise RecordError(
            f"{name}, line {at + 1}: {count} {kind}-header values are announced, there are "
            f"{values.size}"
        )
    return values, at + 1 + height


def _is_acceleration(channel: _Channel, section: str) -> bool:
    parameter = channel.integers[1]
    return parameter == 1 or (parameter == _NULL and "ACCEL" in section.upper())


def _shown(lines: Sequence[str], at: int) -> str:
    return repr(lines[at].strip()[:60]) if at < len(lines) else "the end of the file"


def _end_of_numbers(lines: Sequence[str], place: int) -> int:
    return next((i for i in range(place, len(lines)) if _WORDS.search(lines[i])), len(lines))


def _trace(lines: Sequence[str], channel: _Channel, end: int, name: str) -> Trace:
    (head,) = clipped(lines[channel.section : channel.section + 1])
    where = f"{name}, line {channel.section + 1}"
    found = _SECTION.match(head)
    announced = facts.whole_count(found.group(1) if found else "", where)
    samples = numbers(
        lines[channel.section + 1 : end], channel.section + 2, name,
        expected=announced, width=format_width(head),
    )  # fmt: skip
    integers, reals = channel.integers, channel.reals
    unit, scale = _UNITS.get(int(integers[2]), ("", 1.0))
    record, codes = _record(channel)
    record |= {"level": _LEVELS.get(int(integers[0]), ""), "unit": unit,
               "announced": announced, "held": samples.size}  # fmt: skip
    if scale != 1.0:
        samples = samples * scale
        record["log"] = ("Unit in/s2 turned into cm/s2.",)
    if unit == "counts":
        record |= facts.known(g_per_count=_g_per_count(reals))
    step = _step(reals, where)
    if reals[63] != _NULL and scale == 1.0:
        facts.judge_peak(record, f"{reals[63]:.4E}", samples, unit)
    start = facts.utc_time(channel.text[7]) if len(channel.text) > 7 else None
    trace = facts.trace_of(samples, step, record, codes=codes, start=start)
    length = _value(reals, 62)
    if length and abs(announced * step - length) > max(2.0 * step, 0.01 * length):
        facts.add_fault(
            trace,
            f"the header states a length of {length:g} s, {announced} samples at {step:g} s last "
            f"{announced * step:g} s",
        )
    if end >= len(lines) or not END_OF_DATA.match(lines[end]):
        facts.add_fault(trace, "there is no end-of-data line: the file may be cut off")
    return trace


def _step(reals: NDArray[np.float64], where: str) -> float:
    """That of the samples [ms], or of the recorder [s] where the header leaves it open."""
    own, recorder = _value(reals, 61), _value(reals, 33)
    if own is None and recorder is None:
        raise RecordError(f"{where}: the header states no time step")
    return facts.positive_step(own / 1000.0 if own is not None else recorder or 0.0, where)


def _value(numbers: NDArray[np.float64], index: int) -> float | None:
    value = float(numbers[index]) if index < numbers.size else _NULL
    return None if value == _NULL else value


def _g_per_count(reals: NDArray[np.float64]) -> float | None:
    """By the recorder's least count [µV], the sensor's sensitivity [V/g] and the gain."""
    least, sensitivity, gain = (_value(reals, index) for index in (21, 41, 46))
    if not (least and sensitivity) or least <= 0.0 or sensitivity <= 0.0:
        return None
    gain = gain if gain and gain > 0.0 else 1.0
    return 1e-6 * least / (sensitivity * gain)


def _record(channel: _Channel) -> tuple[dict[str, Any], tuple[str, str, str]]:
    text = [*channel.text, *[""] * 9]
    reals = channel.reals
    found = _CHANNEL.search(text[8])
    number, way = found.groups() if found else (None, "")
    position = re.sub(r"\s+", " ", text[8].partition("Location:")[2]).strip()
    station = _STATION.search(text[4])
    network, code, owner = station.groups() if station else ("", "", "")
    event = re.sub(r"^Re?co?rd of\s+", "", text[1].strip(), flags=re.IGNORECASE)
    record = facts.known(
        event="" if _WEEKDAY.match(event) else event,
        date=facts.iso_date(text[3]) or facts.iso_date(text[1]) or facts.iso_date(text[7]),
        magnitude=facts.magnitude(text[2]) or _value(reals, 12) or _value(reals, 14),
        event_latitude=_value(reals, 9), event_longitude=_value(reals, 10),
        depth_km=_value(reals, 11), station=re.sub(r"^\S+\s{2,}|^\S+\s+(?=\S)", "", owner).strip(),
        station_latitude=_value(reals, 0), station_longitude=_value(reals, 1),
        epicentral_km=_value(reals, 16), channel=number,
        header="\n".join(line.rstrip() for line in (*channel.text, *channel.comments)),
    )  # fmt: skip
    record |= _direction(way, channel)
    names = _SCNL.search("\n".join(channel.comments))
    if names is None:
        return record, ("" if network.startswith("-") else network, code, position)
    code, band, network, location = (part.strip("-") for part in names.groups())
    if re.fullmatch(r"[A-Za-z]{2}[ENZ123]", band):
        record |= {"component": band} | ({"vertical": True} if band[2] == "Z" else {})
    return record, (network, code, location or position)


def _direction(way: str, channel: _Channel) -> dict[str, Any]:
    """By the text of the header, or by its 54th integer: an azimuth, 400 up, 401 down."""
    record = facts.direction(way)
    if "azimuth" in record or "vertical" in record:
        return record
    code = int(channel.integers[53])
    if 1 <= code <= 360:
        return facts.direction(str(code))
    return facts.direction({400: "UP", 401: "DOWN"}.get(code, way))
