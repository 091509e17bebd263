"""Formats with one component a file, as plug-ins of obspy.

- PEER AT2: four lines (title; event, date, station, component; quantity and unit; number of
  samples and time step), then samples in rows. The many re-issues differ in the fourth line.
- DYNA 1.x of ESM and AFAD's TADAS, and ITACA before it: lines ``KEY: value``, then one sample a
  line (ITACA 2.x user manual, header of waveform files).
- RESORCE: ten lines ``Key : value``, quantity and unit, then samples in columns of fixed width.
- SMC of the U.S. Geological Survey: 11 lines of text, 48 integers in columns of 10, 50 reals in
  columns of 15, comments that begin with ``|``, samples in cm/s2 in columns of 10. Uncorrected
  volumes of digitised film state no sampling rate and hold pairs of time and acceleration.
  Layout: USGS National Strong-Motion Project, "SMC-format data files"
  (nsmp.wr.usgs.gov/smcfmt.html).
- K-NET and KiK-net: obspy reads them; here is what it leaves out. A KiK-net station has two
  sensors, which obspy names NS1, EW1, UD1 (borehole) and NS2, EW2, UD2 (surface), after the
  endings of the files (NIED, "About K-NET ASCII format").

Samples stay in the unit of the file (``stats.record.unit``) and ``stats.calib`` is 1, so that no
factor can be applied twice. Only for K-NET is ``stats.calib`` the factor from counts to m/s2.
"""

import contextlib
import re

from obspy import Stream, Trace
from obspy.core.util.base import buffered_load_entry_point

from archfrag.errors import RecordError
from archfrag.files import Named
from archfrag.motions.channel import AZIMUTHS, Channel
from archfrag.motions.formats.layout import (
    Source,
    Text,
    acceleration_unit,
    begins_with,
    checked_count,
    direction,
    judge_peak,
    moment,
    number,
    on_even_steps,
    read_fields,
    reader,
    search,
    trace_of,
)

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?)"
_NPTS = rf"NPTS\s*=\s*{_NUMBER}"
_DT = rf"\bDT\s*=\s*{_NUMBER}"
_TRAILING = rf"^\s*{_NUMBER}\s+{_NUMBER}\s+NPTS\s*,\s*DT"
_KEY = r"\s*([A-Za-z][\w/^().-]*)\s*:(.*)"
_DAY = r"(\d{4})[-/]?(\d\d)[-/]?(\d\d)"
_DIRECTION = r"(?i)[\s,_-]+(\d{1,3}|[NSEWVZ]|NS|EW|UP|UD|[NS]\d+[EW])(\s*DEG\w*)?\W*$"
_CLOCK = re.compile(_DAY + r"[_ T](\d\d):?(\d\d):?(\d\d(?:\.\d+)?)")
_SERIES = re.compile(r"(?i)\s*(\w+) time series in (.+)")


def _day(text: str) -> str:
    day = re.match(_DAY, text)
    return "-".join(day.groups()) if day else ""


# By fact: the function that reads it, and keys of DYNA; the first that is there counts.
_DYNA = {
    "code": (str, "STREAM", "COMPONENT"),
    "date": (_day, "EVENT_DATE_YYYYMMDD"),
    "magnitude": (number, "MAGNITUDE_W", "MAGNITUDE_L"),
    "station": (str, "STATION_CODE"),
    "vs30_mps": (number, "VS30_M/S", "VS30_MS"),
    "epicentral_km": (number, "EPICENTRAL_DISTANCE_KM"),
    "length": (number, "DURATION_S"),
    "depth": (number, "SENSOR_DEPTH_M"),
}
# Keys of RESORCE, and the keys of DYNA for the same facts.
_RESORCE = {
    "TIME INCREMENT (S)": "SAMPLING_INTERVAL_S",
    "NUMBER OF DATA": "NDATA",
    "ORIENTATION": "COMPONENT",
    "EVENT DATE & TIME": "EVENT_DATE_YYYYMMDD",
    "FILTER CUT-OFF FREQUENCY (HZ)": "LOW_CUT_FREQUENCY_HZ",
    "PGA (M/S/S)": "PGA_M/S/S",
    "STATION CODE / NAME": "STATION_CODE",
}
# Of SMC: first line, number of lines, numbers and width of integers and reals.
_NUMBERS = {"integer": (11, 6, 48, 10), "real": (17, 10, 50, 15)}
_LEVELS = {"1": "raw", "2": "processed"}
# By fact: the function that reads it, and places among the reals; the first that is there counts.
_REALS = {
    "epicentral_km": (float, 16),
    "magnitude": (lambda value: value or None, 5, 7, 6, 8),
}


# An acceleration with its unit, number of samples and time step.
is_at2 = begins_with(
    r"(?i)\A(?:[^\n\x80-\xff]*\n){2}(?=.*ACCELERATION)"
    r"[^\n\x80-\xff]*?UNITS?[ \t]+OF[ \t]+[^\s.,;].*\n"
    rf"(?:(?=.*{_NPTS}).*{_DT}|{_TRAILING[1:]})"
)
# The event, and the time step or the number of samples in a later line.
is_dyna = begins_with(
    r"\AEVENT_(?:NAME|ID)\s*:", r"(?m)^\s*(?:SAMPLING_INTERVAL_S|NDATA)\s*:"
)
is_resorce = begins_with(r"\AEvent Date & Time", r"(?im)^\s*\w+ time series in .")


@reader
def read_at2(text: Text) -> list[Trace]:
    """Read a PEER AT2 acceleration record."""
    if text.lines[-1] == "":
        text.lines.pop()
    if len(text.lines) <= 4:
        raise RecordError(
            f"{text.name}: ends after {len(text.lines)} line(s), 4 are the header"
        )
    about, quantity, last = (line.strip() for line in text.head(1, 4))
    if "ACCELERATION" not in quantity.upper():
        raise text.needs(2, "an acceleration")
    unit = search(r"UNITS?\s+OF\s+([^\s.,;]+)", quantity) or "none"
    count = search(_NPTS, last) or search(_TRAILING, last)
    step = search(_DT, last) or search(_TRAILING, last, 2)
    if not (count and step):
        raise text.needs(
            3, "a line with the number of samples (NPTS) and the time step (DT)"
        )
    stated = number(count)
    if stated is not None and stated % 1 == 0:
        count = f"{stated:.0f}"
    # Without a direction at its end, by which records of one event would differ.
    record: Named = {"event": re.sub(_DIRECTION, "", about)}
    parts = [part.strip() for part in about.split(",")]
    if len(parts) >= 3:
        first = 1
        component = parts[-1].split("(")[0].strip()
        if component:
            record = direction(component)
        if re.fullmatch(r"\d+/\d+/\d+", parts[1]) and parts[3:]:
            record["date"] = parts[1]
            first = 2
        station = ", ".join(parts[first:-1])
        record |= {"event": parts[0], "station": station, "code": component}
    record["unit"] = acceleration_unit(unit, text.place(2))
    where = text.place(3)
    record["announced"] = checked_count(count, where)
    return [trace_of(text.numbers(4), number(step), where, record)]


@reader
def read_dyna(text: Text) -> list[Trace]:
    """Read an acceleration record of ESM, ITACA or AFAD."""
    header: dict[str, str] = {}
    for count, line in enumerate(text.lines):
        match = re.match(_KEY, line)
        if match is None:
            break
        key = match[1].upper()
        if key in header:
            raise RecordError(f"{text.place(count)}: {key} is there a second time")
        header[key] = match[2].strip()
        with contextlib.suppress(UnicodeDecodeError):  # names may be in UTF-8
            header[key] = match[2].encode("latin-1").decode("utf-8").strip()
    codes = [header.get(key, "") for key in ("NETWORK", "STATION_CODE", "LOCATION")]
    return [_keyed(text, header, len(header), codes)]


@reader
def read_resorce(text: Text) -> list[Trace]:
    """Read an acceleration record of RESORCE."""
    series = text.first(0, _SERIES.match)
    match = _SERIES.match(text.line(series))
    if match is None:
        raise RecordError(f"{text.name}: no line names the time series and its unit")
    header: dict[str, str] = {"DATA_TYPE": match[1], "UNITS": match[2]}
    for line in text.lines[:series]:
        name, colon, value = line.partition(":")
        key = _RESORCE.get(name.rstrip().upper())
        if colon and key:
            header[key] = value.strip()
    code, name = map(str.strip, header.get("STATION_CODE", "").partition("/")[::2])
    header["STATION_CODE"] = name or code
    return [_keyed(text, header, series + 1, ["", code, ""])]


def _keyed(text: Text, header: dict[str, str], first: int, codes: list[str]) -> Trace:
    """Return the trace of a file whose `header` has the keys of DYNA.

    Its samples are in the lines from `first` on. `codes` are those of network, station, location.
    """
    kind = header.get("DATA_TYPE", "ACCELERATION")
    if kind and not kind.upper().startswith("ACCEL"):
        raise RecordError(
            f"{text.name}: an acceleration is needed, DATA_TYPE is {kind!r}"
        )
    for key in ("UNITS", "SAMPLING_INTERVAL_S", "NDATA"):
        if not header.get(key):
            raise RecordError(f"{text.name}: the header gives no {key}")
    record = read_fields(_DYNA, header.get)
    component = record.get("code", "")
    letter = (component[-1:] if len(component) == 3 else component).upper()
    cuts = (header.get(f"{end}_CUT_FREQUENCY_HZ", "") for end in ("LOW", "HIGH"))
    if re.search("[1-9]", "".join(cuts)):
        record["level"] = "processed"
    elif "NOT REMOVED" in header.get("BASELINE_CORRECTION", "").upper():
        record["level"] = "raw"
    record |= {
        "unit": acceleration_unit(header["UNITS"], f"{text.name}, UNITS"),
        "announced": checked_count(header["NDATA"], f"{text.name}, NDATA"),
        "peak": header.get(f"PGA_{header['UNITS'].upper()}", ""),
        "vertical": letter in ("Z", "UP", "V", "UD") if letter else None,
        "azimuth": AZIMUTHS.get(letter),
        # A name may be of a country alone, that of many earthquakes.
        "event": ", ".join(filter(None, map(header.get, ("EVENT_NAME", "EVENT_ID")))),
    }
    if header.get("LATE/NORMAL_TRIGGERED", "").upper() == "LT":
        record["cautions"] = [
            "its header says that it triggered late: the beginning of the motion is missing"
        ]
    # Such as 20010203_040510.250 or, of AFAD, 03/02/2001 04:05:10.250.
    start = header.get("DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS", "")
    start = re.sub(r"(\d\d)/(\d\d)/(\d{4})", r"\3\2\1", start, count=1)
    day, clock = (
        header.get(f"EVENT_{key}", "") for key in ("DATE_YYYYMMDD", "TIME_HHMMSS")
    )
    times = [
        moment(*map(float, match.groups())) if match else None
        for match in map(_CLOCK.match, (start, f"{day} {clock}"))
    ]
    if times[1]:
        record["origin_time"] = str(times[1])
    return trace_of(
        text.numbers(first),
        number(header["SAMPLING_INTERVAL_S"]),
        f"{text.name}, SAMPLING_INTERVAL_S",
        record,
        codes,
        times[0],
    )


# A title, lines of which some are only a star, the component, and lines of integers.
is_smc = begins_with(
    r"\A\s*[1-9]\s+[A-Z].*(?:\n.*){4}\n(?i:station\s*=.*component\s*=)(?:.*\n){6}"
    r"(?:[-+\d \t]+\n){6}",
    r"\A.*(?:(?:\n.*){0,7}?\n[ \t]*\*[ \t]*(?=\n)){3}",
)


@reader
def read_smc(text: Text) -> list[Trace]:
    """Read the acceleration of an SMC file, in cm/s2."""
    head = [*text.head(0, 11), *[""] * 6]
    level = _LEVELS.get(search(r"\A\s*([1-9])\s+[A-Z]", head[0]))
    if level is None or "ACCEL" not in head[0].upper():
        raise text.needs(0, "an accelerogram (type 1 or 2)")
    numbers = []
    for kind, (place, height, many, width) in _NUMBERS.items():
        values = text.numbers(place, place + height, many, width)
        if values.size != many:
            raise RecordError(
                f"{text.place(place)}: {values.size} of {many} {kind} numbers"
            )
        numbers.append(values)
    integers, reals = numbers
    stated = {i: value for i, value in enumerate(reals.tolist()) if value != reals[0]}
    first = text.first(27, lambda line: not line.lstrip().startswith("|"))
    count = checked_count(f"{integers[16]:.0f}", text.place(13))
    values = text.numbers(first, None, count, 10)
    names = re.match(r"(?i)station\s*=\s*(.*?)\s*component\s*=\s*(.*)", head[5])
    station, bearing = names.groups() if names else ("", "")
    record = direction(bearing) | read_fields(_REALS, stated.get)
    tilt, azimuth = integers[12:14]  # degrees from the vertical, from north
    if tilt in (0.0, 180.0):
        record |= {"code": "UP" if tilt == 0.0 else "DOWN", "vertical": True}
    elif tilt == 90.0 and azimuth != integers[0] and 0 <= azimuth <= 360:
        record |= {"azimuth": float(azimuth), "vertical": False}
    year, day, hour, minute, second = integers[1:6]
    dated = moment(year, 1, 1, 24.0 * (day - 1), 0, 0) if 1 <= day <= 366 else None
    start = None
    if dated and 0 <= hour < 24 and 0 <= minute < 60:
        start = dated + 3600.0 * hour + 60.0 * minute
        start += second if 0 <= second < 60 else 0.0
    per = 1 if 1 in stated else 2
    record |= {
        "event": re.sub(r"^[\s\d]+", "", head[3]).strip(),
        "station": station,
        "date": str(dated.date) if dated else "",
        "level": level,
        "unit": "cm/s2",
        "announced": count // per,
        "log": [],
    }
    # Writers of uncorrected volumes left a last row of what was in their memory.
    if count < values.size <= count + 8:
        values = values[:count]
        record["log"].append(
            f"Row left out: it is beyond the {count} numbers of the header."
        )
    record["held"] = values.size // per
    step = 1.0 / stated[1] if stated.get(1) else None
    if per == 2:  # pairs of time and acceleration
        values, step, done = on_even_steps(values, text.name)
        record["log"] += [done] * bool(done)
    peaks = [abs(stated[index]) for index in (29, 31) if index in stated]
    if peaks:
        record["peak"] = f"{max(peaks):.6E}"
    codes = ("", head[2].strip().split(" ")[0])
    return [trace_of(values, step, text.place(first - 1), record, codes, start)]


def read_knet(source: Source, **_) -> Stream:
    """Read a K-NET or KiK-net file by obspy's reader and complete what its header states."""
    read = buffered_load_entry_point(
        "obspy", "obspy.plugin.waveform.KNET", "readFormat"
    )
    stream = read(source if hasattr(source, "read") else str(source))
    # Without a header that is whole, nothing follows.
    for trace in (trace for trace in stream if "knet" in trace.stats):
        knet = trace.stats.knet
        component = str(trace.stats.channel)
        trace.stats.record = channel = Channel(
            component,
            date=knet.evot.date.isoformat(),
            origin_time=str(knet.evot),
            magnitude=knet.mag,
            level="raw",
            station=trace.stats.station,
            held=trace.data.size,
            announced=round(knet.duration * trace.stats.sampling_rate),
            vertical=component.startswith("UD"),
            azimuth={"N": 0.0, "E": 90.0}.get(component[:1]),
        )
        gal = 100.0 * trace.stats.calib * trace.data
        judge_peak(channel, str(knet.accmax), gal, "gal")
    return stream
