"""Volumes with several channels a file: COSMOS, CSMIP (CDMG, CGS) and GeoNet, for obspy.

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

GeoNet V1A (raw) and V2A (processed), a block for each component: 16 lines of text, 4 of integers
and 6 of reals, ten to a line, then samples in columns of 8 characters, ten to a line. A V2A block
holds accelerations [mm/s2], velocities [mm/s] and displacements [mm] one after the other, each
beginning a line; integers 34 to 36 are how many. Integers 9, 10, 19, 20, 39 and 40 are year,
month, day, hour, minute and millisecond of the first sample.
"""

import re
from collections.abc import Callable, Iterator

from obspy import Trace

from archfrag.errors import RecordError
from archfrag.files import Named
from archfrag.motions.channel import Samples, quadrant
from archfrag.motions.formats.layout import (
    END_OF_DATA,
    WORDS,
    Text,
    acceleration_unit,
    begins_with,
    checked_count,
    direction,
    format_width,
    iso_date,
    magnitude,
    moment,
    number,
    on_even_steps,
    read_fields,
    reader,
    search,
    trace_of,
    utc_time,
)

_CHANNELS = r"\(\s*(\d{1,6})\d*\s*CHNS?\s+OF"
_BEGINS = re.compile(rf"(?!{END_OF_DATA.pattern})[\s\x1a]*[^\s\x1a]")
# A trace, None if the channel is no acceleration, and the line after it.
_Channel = tuple[Trace | None, int]

# COSMOS
_FORMAT = r"(?i)\A.*\(Format\s+v\d+\.\d+\s+with\s+(\d{1,3})\s+text\s+lines\)"
_BLOCK = r"(?i)\s*(\d{{1,6}})\d*\s+{}-header values follow on\s+(\d{{1,6}})\d*\s+lines"
_SECTION = r"\A\s*(\S+)\s+.*\bpts\b.*units\s*="
_COSMOS_UNITS = {2: "g", 4: "cm/s2", 50: "counts"}
_COSMOS_LEVELS = {0: "raw", 1: "raw", 2: "processed"}
_WAYS = {400: "UP", 401: "DOWN"}  # from 1 to 360 it is an azimuth
_NULL = -999.0
# By fact: the function that reads it, and places among the reals; the first that is there counts.
_REALS = {
    "magnitude": (lambda value: value or None, 12, 14),
    "epicentral_km": (float, 16),
    "length": (float, 62),
    "peak": ("{:.4E}".format, 63),
}

# CSMIP
_TITLE = re.compile(r"(?i)\s*(UN)?CORRECTED ACCELEROGRAM\b")
_COUNT_LINE = r"NO\. OF POINTS\s*=\s*(\S*)\s+RECORD LENGTH"
_POINTS = re.compile(r"(?i)\A\s*(\S+)\s+(?:POINTS OF ACCEL|ACCELEROGRAM POINTS)")
_UNITS = (
    (r"\b(G)\s*/\s*10\b", "g", 0.1),
    (r"\b(CM)/S(?:EC)?(?:/S(?:EC)?|2|/S2)", "cm/s2", 1.0),
    (r"\b(MM)/S(?:EC)?(?:/S(?:EC)?|2|/S2)", "mm/s2", 1.0),
    (r"(?:UNITS:?|IN|AND|OF|IS)\s+(G)\b", "g", 1.0),
)
# By level: lines of text, lines of integers and reals, what the peak of the samples is called.
_LEVELS = {"raw": (13, 14, "MAX"), "processed": (25, 20, "PEAK ACCELERATION")}

# GeoNet: number of lines of text, of text and integers together, and of the whole header.
_TEXT_LINES = 16
_INTEGERS_END = 20
_HEADER_LINES = 26
_FIELDS = {
    "announced": (str, r"^\s*Number of points +(\S+)"),
    "interval": (number, r"\bat (?:intervals of )?(\S+) s(?:ec)?\b"),
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
    "date": (iso_date, r"^\s*(\d{4} [A-Z][a-z]+ +\d+) +\d\d:\d\d:\d\d"),
    "magnitude": (number, r"^\s*Epicentre .*\bM[A-Za-z]? +([\d.]+)\s*$"),
    "epicentral_km": (number, r"^\s*Epicentre .*\bDist +([\d.]+) *km"),
    "station": (str, r"^\s*Site +(\S+) +\d"),
    "length": (number, r"\bDuration +(\S+) *s"),
}
_START = r"(?i)\A\s*(Un)?corrected accelerogram\b"


def _volume(text: Text, channel: Callable[[Text, int], _Channel]) -> list[Trace]:
    """Return the traces of a volume, which has its channels one after the other.

    `channel` reads the channel that begins at a line. RecordError if no channel is an
    acceleration.
    """
    traces = list[Trace]()
    place = stated = 0
    while (begin := text.first(place, _BEGINS.match)) < len(text.lines):
        trace, place = channel(text, begin)
        if trace is None:
            continue
        if not END_OF_DATA.match(text.line(place)):
            trace.stats.record.errors.append(
                "there is no end-of-data line: the file may be cut off"
            )
        traces.append(trace)
        head = "\n".join(text.head(begin, begin + 100))
        stated = max(stated, int(search(_CHANNELS, head) or 0))
    if not traces:
        raise RecordError(
            f"{text.name}: none of the channels of the file is an acceleration"
        )
    if stated > len(traces):
        traces[0].stats.record.errors.append(
            f"the header counts {stated} channels, the file holds {len(traces)}"
        )
    # Traces of one code get their channel numbers as locations.
    ids = [trace.id for trace in traces]
    for count, trace in enumerate(traces, start=1):
        if ids.count(trace.id) > 1:
            trace.stats.location += trace.stats.record.number or str(count)
        if trace.id in {before.id for before in traces[: count - 1]}:
            trace.stats.location += f"-{count}"
    return traces


is_cosmos = begins_with(_FORMAT, r"(?im)^\s*\d+\s+Integer-header values follow")


@reader
def read_cosmos(text: Text) -> list[Trace]:
    """Read the accelerations of a COSMOS file.

    Counts get ``g_per_count`` if the header states what it follows from.
    """
    return _volume(text, _cosmos_channel)


def _cosmos_channel(text: Text, place: int) -> _Channel:
    count = int(search(_FORMAT, text.lines[place]) or 0)
    if not 5 <= count <= 100:
        raise text.needs(place, "a line with (Format v01.20 with 13 text lines)")
    lines = text.head(place, place + count)
    integers, at = _header_numbers(text, place + count, "integer")
    reals, at = _header_numbers(text, at, "real")
    real = {i: value for i, value in enumerate(reals.tolist()) if value != _NULL}
    comments = ""
    if re.match(r"(?i)\s*\d+\s+Comment line\(s\) follow", text.line(at)):
        end = text.first(at + 1, lambda line: not line.lstrip().startswith("|"))
        comments = "\n".join(text.head(at + 1, end))
        at = end
    section = text.line(at)[:200]
    if not search(_SECTION, section):
        raise text.needs(at, "the line with the number of points and their units")
    end = text.first(at + 1, WORDS.search)
    where = text.place(at)
    if not (integers[1] == 1 or (integers[1] == _NULL and "ACCEL" in section.upper())):
        return None, end
    announced = checked_count(search(_SECTION, section), where)
    samples = text.numbers(at + 1, end, announced, format_width(section))
    record, codes = _cosmos_record([*lines, *[""] * 9], int(integers[53]), comments)
    record = read_fields(_REALS, real.get) | record
    record |= {
        "level": _COSMOS_LEVELS.get(integers[0], ""),
        "unit": _COSMOS_UNITS.get(integers[2], ""),
        "announced": announced,
    }
    # The recorder's least count [µV], the sensor's sensitivity [V/g] and the gain.
    least, sensitivity, gain = (max(real.get(i, 0.0), 0.0) for i in (21, 41, 46))
    if record["unit"] == "counts" and least and sensitivity:
        record["g_per_count"] = 1e-6 * least / (sensitivity * (gain or 1.0))
    trace = trace_of(
        samples,
        # That of the samples [ms], or of the recorder [s] where the header leaves it open.
        real[61] / 1000.0 if 61 in real else real.get(33),
        where,
        record,
        codes,
        utc_time(lines[7]),
    )
    return trace, end


def _header_numbers(text: Text, at: int, kind: str) -> tuple[Samples, int]:
    """Return the integers or reals of a header, and the line after them."""
    line = text.line(at)
    block = re.match(_BLOCK.format(kind), line)
    if block is None:
        raise text.needs(at, f"a line that states how many {kind}-header values follow")
    count, height = map(int, block.groups())
    end = at + 1 + min(height, 200)  # no file takes long by what its header announces
    values = text.numbers(at + 1, end, count, format_width(line))
    if not 64 <= values.size <= count <= 1000:
        raise RecordError(
            f"{text.place(at)}: {count} {kind}-header values are announced, there are "
            f"{values.size}; 64 to 1000 are needed"
        )
    return values, end


def _cosmos_record(
    text: list[str], angle: int, comments: str
) -> tuple[Named, tuple[str, str, str]]:
    """Return the facts of a header, and the codes of network, station and location."""
    channel = re.search(
        r"(?i)Sta\s+Cha\w*\s*:?\s*([\w?]+)\s*:\s*(.*?)\s*\(Rcrdr", text[8]
    )
    sensor, bearing = channel.groups("") if channel else ("", "")
    position = " ".join(text[8].partition("Location:")[2].split())
    station = re.search(r"(?i)Code:\s*([\w-]+?)-(\w+)\s+(.*)", text[4])
    network, code, owner = station.groups() if station else ("", "", "")
    event = re.sub(r"(?i)^Re?co?rd of\s+", "", text[1].strip())
    if re.match(r"(?i)(Mon|Tue|Wed|Thu|Fri|Sat|Sun)\b", event):
        event = ""
    known = direction(bearing)
    if not {"azimuth", "vertical"} & known.keys():
        word = str(angle) if 1 <= angle <= 360 else _WAYS.get(angle, bearing)
        known = direction(word)
    record = known | {
        "event": event,
        "date": iso_date(text[3], text[1], text[7]),
        "number": sensor,
        "place": position,
        "station": re.sub(r"^\S+\s{2,}|^\S+\s+(?=\S)", "", owner).strip(),
    }
    size = magnitude(text[2])
    if size:
        record["magnitude"] = size
    names = re.search(r"<SCNL>\s*" + r"\.".join([r"([\w-]+)"] * 4), comments)
    if names is None:
        return record, ("" if network.startswith("-") else network, code, position)
    code, band, network, location = (part.strip("-") for part in names.groups())
    if re.fullmatch(r"[A-Za-z]{2}[ENZ123]", band):
        record["code"] = band
        if band[2] == "Z":
            record["vertical"] = True
    return record, (network, code, location or position)


# Volume 1 has its number of points in one of the lines 9 to 13.
is_dmg = begins_with(
    rf"(?i)\A\s*UNCORRECTED ACCELEROGRAM\b(?:.*\n){{8,12}}.*{_COUNT_LINE}"
    r"|\A\s*CORRECTED ACCELEROGRAM\b.*\n\s*UNCORRECTED ACCELEROGRAM DATA"
)


@reader
def read_dmg(text: Text) -> list[Trace]:
    """Read the accelerations of volume 1 or 2 of CSMIP in the unit of the file, g/10 as g."""
    return _volume(text, _dmg_channel)


def _dmg_channel(text: Text, place: int) -> _Channel:
    title = _TITLE.match(text.lines[place])
    if title is None:
        raise text.needs(place, "a line that begins (UN)CORRECTED ACCELEROGRAM")
    level = "raw" if title[1] else "processed"
    count, rows, peak_name = _LEVELS[level]
    lines = text.head(place, place + count)
    if len(lines) < count:
        raise RecordError(
            f"{text.place(len(text.lines) - 1)}: the file ends in a header"
        )
    first = place + count
    section = text.first(first, _POINTS.match)
    if section < min(first + rows + 12, len(text.lines)):
        read = _dmg_section(text, section)
    elif level == "raw":
        read = _dmg_pairs(text, place, lines, first + rows)
    else:
        raise RecordError(
            f"{text.place(place)}: no line states the number of acceleration points"
        )
    samples, step, record, end, where = read
    named = re.compile(rf"(?i){peak_name}\s*=\s*([-+.\d]+)\s*([A-Z/]+)")
    stated = next(filter(None, map(named.search, lines)), None)
    if stated and _unit_of(f"in {stated[2]}")[0] == record["unit"]:
        record["peak"] = stated[1]
    end = text.first(end, lambda line: END_OF_DATA.match(line) or _TITLE.match(line))
    head = lines if level == "raw" else lines[1:]
    channel = re.search(r"(?i)CHAN\s*(\d+)?\s*:\s*(.*)", head[6])
    sensor, bearing = channel.groups("") if channel else ("", "")
    bearing, _, position = bearing.partition("LOCATION:")
    record |= direction(bearing) | {
        "event": "" if re.match(r"(?i)\s*RE?CO?RD OF", head[1]) else head[1].strip(),
        "date": iso_date(head[2].upper().partition("ORIGIN")[2], head[2], head[1]),
        "magnitude": magnitude(head[8]),
        "number": sensor,
        "level": level,
        "place": position,
        "station": re.split(r"\s{3,}", head[5].strip())[0],
    }
    code = search(r"STATION\s+(?:NO|ID)\.\s*(\w+)(?=\s)", head[4])
    codes = ("", code, " ".join(position.split()))
    return trace_of(samples, step, where, record, codes, utc_time(head[3])), end


_Read = tuple[Samples, float | None, Named, int, str]


def _dmg_section(text: Text, at: int) -> _Read:
    """Read the samples after the line `at`, which states their number and unit.

    Return the samples, their step [s] (None if not stated), facts, the line after them, and the
    place of the line `at` for messages.
    """
    line = text.line(at)[:200]
    announced = checked_count(search(_POINTS.pattern, line), text.place(at))
    unit, scale = _unit_of(line)
    end = text.first(at + 1, WORDS.search)
    samples = text.numbers(at + 1, end, announced, format_width(line) or 10) * scale
    step = number(search(r"SPACED AT\s+(\S+)\s+SEC", line))
    rate = number(search(r"AT\s+(\S+)\s+PTS/SEC", line))
    if step is None and rate:
        step = 1.0 / rate
    return samples, step, {"announced": announced, "unit": unit}, end, text.place(at)


def _dmg_pairs(text: Text, place: int, lines: list[str], first: int) -> _Read:
    """Read pairs of time and acceleration, which begin at the line `first`.

    `lines` are the text of the header, which begins at the line `place`. The return value is as of
    `_dmg_section`.
    """
    index = next((i for i, row in enumerate(lines) if search(_COUNT_LINE, row, 0)), 0)
    stated = search(_COUNT_LINE, lines[index])
    announced = checked_count(stated, text.place(place + index))
    unit, scale = _unit_of(
        next((row for row in lines if "UNITS OF" in row.upper()), "")
    )
    end = text.first(first, WORDS.search)
    pairs = text.numbers(first, end, 2 * announced, 7)
    held = pairs.size // 2
    pairs[1::2] *= scale
    samples, step, done = on_even_steps(pairs, text.place(first))
    log = ["Unit g/10 converted into g."] * (scale != 1.0) + [done] * bool(done)
    record = {"announced": announced, "held": held, "unit": unit, "log": log}
    return samples, step, record, end, text.place(place)


def _unit_of(text: str) -> tuple[str, float]:
    units = ((unit, scale) for pattern, unit, scale in _UNITS if search(pattern, text))
    return next(units, ("", 1.0))


is_geonet = begins_with(
    _START + r".*\n\s*(?-i:Site )(?:.*\n){1,13}\s*Number of points +\S"
)


@reader
def read_geonet(text: Text) -> Iterator[Trace]:
    """Read the accelerations of a GeoNet volume; velocities and displacements are left out."""
    starts = [i for i, line in enumerate(text.lines) if re.match(_START, line)]
    if not starts:
        raise RecordError(f"{text.name}: no line begins an accelerogram")
    for first, end in zip(starts, [*starts[1:], len(text.lines)]):
        yield _geonet_trace(text, first, end)


def _geonet_trace(text: Text, first: int, end: int) -> Trace:
    place = text.place(first)
    data = first + _HEADER_LINES
    if end <= data:
        raise RecordError(
            f"{place}: ends after {end - first} line(s), {_HEADER_LINES} are header"
        )
    head = "\n".join(text.lines[first : first + _TEXT_LINES])
    record: Named = {"code": "", "unit": "", "announced": "", "factor": "1"}
    record |= read_fields(_FIELDS, lambda pattern: search(pattern, head))
    interval, factor = (record.pop(key, "") for key in ("interval", "factor"))
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
            raise RecordError(
                f"{channel} must hold {counts[0]} accelerations, {counts[1]} velocities and "
                f"{counts[2]} displacements; it holds {samples.size}"
            )
        samples = samples[: counts[0]]
    scale = number(factor)
    if not scale:
        raise RecordError(f"{place}: readings in units of {factor!r}, not a number")
    raw = text.lines[first].lstrip()[:1] in "Uu"
    record |= {
        "unit": acceleration_unit(record["unit"], place),
        "announced": checked_count(record["announced"], f"{place}: Number of points"),
        "level": "raw" if raw else "processed",
        "event": text.lines[first + 6].strip(),
    }
    return trace_of(
        samples * scale,
        interval or None,
        f"{place}: interval",
        record,
        ("NZ", record.get("station", "")),
        # Year, month, day, hour, minute and millisecond of the first sample.
        moment(*integers[[8, 9, 18, 19, 38, 39]] / (1, 1, 1, 1, 1, 1000)),
    )
