"""Volumes of CSMIP (CDMG, CGS) and their successor COSMOS, several channels a file, for obspy.

COSMOS V0 (counts), V1 (uncorrected), V2 (corrected): a channel is text, integers, reals and
comments, each with a line of how many and in which columns, then the samples and a line that ends
them. Meaning of the header's numbers after "COSMOS strong motion data format", version 1.20,
Consortium of Organizations for Strong-Motion Observation Systems, 2001, tables 1 to 8; indices
here are from 0.

CSMIP (DMG) volumes 1 and 2: a channel is 13 or 25 lines of text, integers in columns of 5 and
reals in columns of 10, then a line with count, step and unit and samples in columns; volume 2
goes on with velocity and displacement. Volume 1 of digitised film has no such line but pairs of
time and acceleration in columns of 7. Layout after the headers of the files themselves and Shakal
and Ragsdale, "Acceleration, velocity and displacement data in CSMIP volumes", California Division
of Mines and Geology, OSMS 85-03, 1985.
"""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Stream, Trace

from archfrag.errors import RecordError
from archfrag.motions.channel import filled
from archfrag.motions.formats import layout

_CHANNELS = re.compile(r"\(\s*(\d{1,6})\d*\s*CHNS?\s+OF", re.IGNORECASE)
_BEGINS = re.compile(
    rf"(?!{layout.END_OF_DATA.pattern})[\s\x1a]*[^\s\x1a]", re.IGNORECASE
)
_Channel = tuple[Trace | None, int, str]  # a trace, the line after it, its header

# COSMOS
_FORMAT = re.compile(
    r"(?i)\A.*\(Format\s+v\d+\.\d+\s+with\s+(\d{1,3})\s+text\s+lines\)"
)
_BLOCK = r"\s*(\d{{1,6}})\d*\s+{}-header values follow on\s+(\d{{1,6}})\d*\s+lines"
_SECTION = re.compile(r"\A\s*(\S+)\s+.*\bpts\b.*units\s*=", re.IGNORECASE)
_COSMOS_UNITS = {2: "g", 4: "cm/s2", 50: "counts"}
_NULL = -999.0

# CSMIP
_TITLE = re.compile(r"\s*(UN)?CORRECTED ACCELEROGRAM\b", re.IGNORECASE)
_COUNT_LINE = re.compile(r"NO\. OF POINTS\s*=\s*(\S*)\s+RECORD LENGTH", re.IGNORECASE)
_POINTS = re.compile(
    r"\A\s*(\S+)\s+(?:POINTS OF ACCEL|ACCELEROGRAM POINTS)", re.IGNORECASE
)
_UNITS = (
    (r"\b(G)\s*/\s*10\b", "g", 0.1),
    (r"\b(CM)/S(?:EC)?(?:/S(?:EC)?|2|/S2)", "cm/s2", 1.0),
    (r"\b(MM)/S(?:EC)?(?:/S(?:EC)?|2|/S2)", "mm/s2", 1.0),
    (r"(?:UNITS:?|IN|AND|OF|IS)\s+(G)\b", "g", 1.0),
)
# By level: lines of text, lines of integers and reals, what the peak of the samples is called.
_LEVELS = {"raw": (13, 14, "MAX"), "processed": (25, 20, "PEAK ACCELERATION")}


def _stream(
    source: layout.Source, channel: Callable[[layout.Text, int], _Channel]
) -> Stream:
    """Return the traces of channels one after the other, each read by `channel` from a line on."""
    text = layout.Text(source)
    traces = list[Trace]()
    place = stated = 0
    while (place := text.first(place, _BEGINS.match)) < len(text.lines):
        trace, place, header = channel(text, place)
        if trace is None:
            continue
        if not any(map(layout.END_OF_DATA.match, text.lines[place : place + 1])):
            cut_off = "there is no end-of-data line: the file may be cut off"
            trace.stats.record.errors.append(cut_off)
        traces.append(trace)
        stated = max(stated, int(layout.search(_CHANNELS, header) or 0))
    if not traces:
        raise RecordError(
            f"{text.name}: none of the channels of the file is an acceleration"
        )
    if stated > len(traces):
        error = f"the header counts {stated} channels, the file holds {len(traces)}"
        traces[0].stats.record.errors.append(error)
    # Traces of one code get their channel numbers as locations.
    ids = [trace.id for trace in traces]
    for count, trace in enumerate(traces, start=1):
        if ids.count(trace.id) > 1:
            trace.stats.location += trace.stats.record.number or str(count)
        if trace.id in {before.id for before in traces[: count - 1]}:
            trace.stats.location += f"-{count}"
    return Stream(traces)


is_cosmos = layout.begins_with(
    _FORMAT.pattern, r"(?im)^\s*\d+\s+Integer-header values follow"
)


def read_cosmos(source: layout.Source, **_: Any) -> Stream:
    """Read the accelerations of a COSMOS file; counts with their ``g_per_count`` if stated."""
    return _stream(source, _cosmos_channel)


def _cosmos_channel(text: layout.Text, place: int) -> _Channel:
    count = int(layout.search(_FORMAT, text.lines[place]) or 0)
    if not 5 <= count <= 100:
        raise text.needs(place, "a line with (Format v01.20 with 13 text lines)")
    lines = text.head(place, place + count)
    header = "\n".join(lines)
    integers, at = _header_numbers(text, place + count, "integer")
    reals, at = _header_numbers(text, at, "real")
    real = {
        index: value for index, value in enumerate(reals.tolist()) if value != _NULL
    }
    comments = ""
    if re.match(
        r"(?i)\s*\d+\s+Comment line\(s\) follow", "".join(text.lines[at : at + 1])
    ):
        end = text.first(at + 1, lambda line: not line.lstrip().startswith("|"))
        comments = "\n".join(text.head(at + 1, end))
        at = end
    section = "".join(text.head(at, at + 1))
    if not _SECTION.match(section):
        raise text.needs(at, "the line with the number of points and their units")
    end = text.first(at + 1, layout.WORDS.search)
    where = text.place(at)
    if not (integers[1] == 1 or (integers[1] == _NULL and "ACCEL" in section.upper())):
        return None, end, header
    announced = layout.checked_count(layout.search(_SECTION, section), where)
    samples = text.numbers(at + 1, end, announced, layout.format_width(section))
    unit = _COSMOS_UNITS.get(int(integers[2]), "")
    record, codes = _cosmos_record([*lines, *[""] * 9], int(integers[53]), comments)
    size = real.get(12) or real.get(14) or None
    record = {"magnitude": size, "epicentral_km": real.get(16)} | filled(record)
    level = {0: "raw", 1: "raw", 2: "processed"}.get(int(integers[0]), "")
    record |= {
        "level": level,
        "unit": unit,
        "announced": announced,
        "held": samples.size,
        "length": real.get(62),
    }
    if unit == "counts":
        # The recorder's least count [µV], the sensor's sensitivity [V/g] and the gain.
        least, sensitivity, gain = (
            max(real.get(index, 0.0), 0.0) for index in (21, 41, 46)
        )
        if least and sensitivity:
            record["g_per_count"] = 1e-6 * least / (sensitivity * (gain or 1.0))
    # That of the samples [ms], or of the recorder [s] where the header leaves it open.
    step = real[61] / 1000.0 if 61 in real else real.get(33)
    peak = f"{real[63]:.4E}" if 63 in real else ""
    start = layout.utc_time(lines[7])
    trace = layout.trace_of(
        samples, step, where, record, peak=peak, codes=codes, start=start
    )
    return trace, end, header


def _header_numbers(
    text: layout.Text, at: int, kind: str
) -> tuple[NDArray[np.float64], int]:
    """Return the integers or reals of a header, and the line after them."""
    line = text.lines[at] if at < len(text.lines) else ""
    block = re.match(_BLOCK.format(kind), line, re.IGNORECASE)
    if block is None:
        raise text.needs(at, f"a line that states how many {kind}-header values follow")
    count, height = map(int, block.groups())
    height = min(height, 200)  # no file takes long by what its header announces
    values = text.numbers(at + 1, at + 1 + height, count, layout.format_width(line))
    if not 64 <= values.size <= count <= 1000:
        few = f"{count} {kind}-header values are announced, there are {values.size}"
        raise RecordError(f"{text.place(at)}: {few}; 64 to 1000 are needed")
    return values, at + 1 + height


def _cosmos_record(
    text: list[str], angle: int, comments: str
) -> tuple[dict[str, Any], tuple[str, str, str]]:
    """Return the facts of a header, and the codes of network, station and location."""
    channel = re.search(
        r"(?i)Sta\s+Cha\w*\s*:?\s*([\w?]+)\s*:\s*(.*?)\s*\(Rcrdr", text[8]
    )
    number, bearing = channel.groups("") if channel else ("", "")
    position = " ".join(text[8].partition("Location:")[2].split())
    station = re.search(r"(?i)Code:\s*([\w-]+?)-(\w+)\s+(.*)", text[4])
    network, code, owner = station.groups() if station else ("", "", "")
    event = re.sub(r"(?i)^Re?co?rd of\s+", "", text[1].strip())
    direction = layout.direction(bearing)
    if not {"azimuth", "vertical"} & direction.keys():
        word = (
            str(angle)
            if 1 <= angle <= 360
            else {400: "UP", 401: "DOWN"}.get(angle, bearing)
        )
        direction = layout.direction(word)
    record = direction | {
        "event": ""
        if re.match(r"(?i)(Mon|Tue|Wed|Thu|Fri|Sat|Sun)\b", event)
        else event,
        "date": layout.iso_date(text[3], text[1], text[7]),
        "magnitude": layout.magnitude(text[2]),
        "number": number,
        "place": position,
        "station": re.sub(r"^\S+\s{2,}|^\S+\s+(?=\S)", "", owner).strip(),
    }
    names = re.search(r"<SCNL>\s*" + r"\.".join([r"([\w-]+)"] * 4), comments)
    if names is None:
        return record, ("" if network.startswith("-") else network, code, position)
    code, band, network, location = (part.strip("-") for part in names.groups())
    if re.fullmatch(r"[A-Za-z]{2}[ENZ123]", band):
        record |= {"code": band} | ({"vertical": True} if band[2] == "Z" else {})
    return record, (network, code, location or position)


# Volume 1 has its number of points in one of the lines 9 to 13.
is_dmg = layout.begins_with(
    rf"(?i)\A\s*UNCORRECTED ACCELEROGRAM\b(?:.*\n){{8,12}}.*{_COUNT_LINE.pattern}"
    r"|\A\s*CORRECTED ACCELEROGRAM\b.*\n\s*UNCORRECTED ACCELEROGRAM DATA"
)


def read_dmg(source: layout.Source, **_: Any) -> Stream:
    """Read the accelerations of volume 1 or 2 of CSMIP in the unit of the file, g/10 as g."""
    return _stream(source, _dmg_channel)


def _dmg_channel(text: layout.Text, place: int) -> _Channel:
    title = _TITLE.match(text.lines[place])
    if title is None:
        raise text.needs(place, "a line that begins (UN)CORRECTED ACCELEROGRAM")
    level = "raw" if title.group(1) else "processed"
    count, rows, peak_name = _LEVELS[level]
    lines = text.head(place, place + count)
    if len(lines) < count:
        raise RecordError(
            f"{text.place(len(text.lines) - 1)}: the file ends in a header"
        )
    window = range(place + count, min(place + count + rows + 12, len(text.lines)))
    section = next((i for i in window if _POINTS.match(text.lines[i])), None)
    if section is None and level == "processed":
        raise RecordError(
            f"{text.place(place)}: no line states the number of acceleration points"
        )
    samples, step, record, data_end = _dmg_samples(text, place, lines, rows, section)
    named = re.compile(rf"{peak_name}\s*=\s*([-+.\d]+)\s*([A-Z/]+)", re.IGNORECASE)
    stated = next(filter(None, map(named.search, lines)), None)
    peak = (
        stated[1] if stated and _unit_of(f"in {stated[2]}")[0] == record["unit"] else ""
    )
    end = text.first(
        data_end, lambda line: layout.END_OF_DATA.match(line) or _TITLE.match(line)
    )
    head = lines if level == "raw" else lines[1:]
    channel = re.search(r"(?i)CHAN\s*(\d+)?\s*:\s*(.*)", head[6])
    number, bearing = channel.groups("") if channel else ("", "")
    bearing, _, position = bearing.partition("LOCATION:")
    record |= layout.direction(bearing) | {
        "event": "" if re.match(r"(?i)\s*RE?CO?RD OF", head[1]) else head[1].strip(),
        "date": layout.iso_date(
            head[2].upper().partition("ORIGIN")[2], head[2], head[1]
        ),
        "magnitude": layout.magnitude(head[8]),
        "number": number,
        "level": level,
        "place": position,
        "station": re.split(r"\s{3,}", head[5].strip())[0],
    }
    code = layout.search(r"STATION\s+(?:NO|ID)\.\s*(\w+)(?=\s)", head[4])
    trace = layout.trace_of(
        samples,
        step,
        text.place(place if section is None else section),
        record,
        peak=peak,
        codes=("", code, " ".join(position.split())),
        start=layout.utc_time(head[3]),
    )
    return trace, end, "\n".join(lines)


def _dmg_samples(
    text: layout.Text, place: int, lines: list[str], rows: int, section: int | None
) -> tuple[NDArray[np.float64], float | None, dict[str, Any], int]:
    """Return samples, their step, what is stated of them, and the line after them.

    Without a `section`, samples are pairs of time and acceleration.
    """
    step = None
    done = [""]
    per = 2
    width = 7
    first = place + len(lines) + rows
    if section is None:
        index = next((i for i, row in enumerate(lines) if _COUNT_LINE.search(row)), 0)
        where = text.place(place + index)
        stated = layout.search(_COUNT_LINE, lines[index])
        line = next((row for row in lines if "UNITS OF" in row.upper()), "")
    else:
        where, (line,) = text.place(section), text.head(section, section + 1)
        per = 1
        width = layout.format_width(line) or 10
        first = section + 1
        stated = layout.search(_POINTS, line)
        step = layout.number(layout.search(r"SPACED AT\s+(\S+)\s+SEC", line))
        rate = layout.number(layout.search(r"AT\s+(\S+)\s+PTS/SEC", line))
        step = 1.0 / rate if step is None and rate else step
    announced, (unit, scale) = layout.checked_count(stated, where), _unit_of(line)
    end = text.first(first, layout.WORDS.search)
    samples = text.numbers(first, end, per * announced, width)
    held = samples.size // per
    samples[per - 1 :: per] *= scale
    if section is None:
        samples, step, *done = layout.on_even_steps(samples, text.place(first))
        done.insert(0, "Unit g/10 converted into g." if scale != 1.0 else "")
    log = list(filter(None, done))
    return (
        samples,
        step,
        {"announced": announced, "held": held, "unit": unit, "log": log},
        end,
    )


def _unit_of(text: str) -> tuple[str, float]:
    units = (
        (unit, scale) for pattern, unit, scale in _UNITS if layout.search(pattern, text)
    )
    return next(units, ("", 1.0))
