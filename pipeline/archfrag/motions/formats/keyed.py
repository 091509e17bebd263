"""Formats whose header gives names and values, one component a file, as plug-ins of obspy.

- PEER AT2: four lines (title; event, date, station, component; quantity and unit; number of
  samples and time step), then samples in rows. The many re-issues differ in the fourth line.
- DYNA 1.x of ESM and AFAD's TADAS, and ITACA before it: lines ``KEY: value``, then one sample a
  line (ITACA 2.x user manual, header of waveform files).
- RESORCE: ten lines ``Key : value``, quantity and unit, then samples in columns of fixed width.
- K-NET and KiK-net: obspy reads them; here is what it leaves out. A KiK-net station has two
  sensors, which obspy names NS1, EW1, UD1 (borehole) and NS2, EW2, UD2 (surface), after the
  endings of the files (NIED, "About K-NET ASCII format").

Samples stay in the unit of the file (``stats.record.unit``) and ``stats.calib`` is 1, so nothing
is left that could be applied twice; counts of K-NET have it in ``stats.calib``.
"""

import contextlib
import re
from typing import Any

from obspy import Stream
from obspy.core.util.base import buffered_load_entry_point

from archfrag.errors import RecordError
from archfrag.motions.channel import AZIMUTHS, Channel
from archfrag.motions.formats import layout

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?)"
_NPTS = rf"NPTS\s*=\s*{_NUMBER}"
_DT = rf"\bDT\s*=\s*{_NUMBER}"
_TRAILING = rf"^\s*{_NUMBER}\s+{_NUMBER}\s+NPTS\s*,\s*DT"
_KEY = re.compile(r"\s*([A-Za-z][\w/^().-]*)\s*:(.*)")
_DAY = re.compile(r"(\d{4})[-/]?(\d\d)[-/]?(\d\d)")
_DIRECTION = re.compile(
    r"[\s,_-]+(\d{1,3}|[NSEWVZ]|NS|EW|UP|UD|[NS]\d+[EW])(\s*DEG\w*)?\W*$", re.IGNORECASE
)
_CLOCK = re.compile(_DAY.pattern + r"[_ T](\d\d):?(\d\d):?(\d\d(?:\.\d+)?)")
_SERIES = re.compile(r"\s*(\w+) time series in (.+)", re.IGNORECASE)
# The keys of DYNA by what they state, the first there is.
_DYNA = {
    "code": (str, "STREAM", "COMPONENT"),
    "date": (
        lambda text: (day := _DAY.match(text)) and "-".join(day.groups()),
        "EVENT_DATE_YYYYMMDD",
    ),
    "magnitude": (layout.number, "MAGNITUDE_W", "MAGNITUDE_L"),
    "station": (str, "STATION_CODE"),
    "vs30_mps": (layout.number, "VS30_M/S", "VS30_MS"),
    "epicentral_km": (layout.number, "EPICENTRAL_DISTANCE_KM"),
    "length": (layout.number, "DURATION_S"),
    "depth": (layout.number, "SENSOR_DEPTH_M"),
}
# Keys of RESORCE in those of DYNA.
_RESORCE = {
    "TIME INCREMENT (S)": "SAMPLING_INTERVAL_S",
    "NUMBER OF DATA": "NDATA",
    "ORIENTATION": "COMPONENT",
    "EVENT DATE & TIME": "EVENT_DATE_YYYYMMDD",
    "FILTER CUT-OFF FREQUENCY (HZ)": "LOW_CUT_FREQUENCY_HZ",
    "PGA (M/S/S)": "PGA_M/S/S",
    "STATION CODE / NAME": "STATION_CODE",
}


# An acceleration with its unit, number of samples and time step.
is_at2 = layout.begins_with(
    r"(?i)\A(?:[^\n\x80-\xff]*\n){2}(?=.*ACCELERATION)"
    r"[^\n\x80-\xff]*?UNITS?[ \t]+OF[ \t]+[^\s.,;].*\n"
    rf"(?:(?=.*{_NPTS}).*{_DT}|{_TRAILING[1:]})"
)
# The event, and the time step or the number of samples in a later line.
is_dyna = layout.begins_with(
    r"\AEVENT_(?:NAME|ID)\s*:", r"(?m)^\s*(?:SAMPLING_INTERVAL_S|NDATA)\s*:"
)
is_resorce = layout.begins_with(
    r"\AEvent Date & Time", r"(?im)^\s*\w+ time series in ."
)


def read_at2(source: layout.Source, **_: Any) -> Stream:
    """Read a PEER AT2 acceleration record."""
    text = layout.Text(source)
    if text.lines[-1] == "":
        text.lines.pop()
    if len(text.lines) <= 4:
        raise RecordError(
            f"{text.name}: ends after {len(text.lines)} line(s), 4 are the header"
        )
    about, quantity, last = (line.strip() for line in text.head(1, 4))
    if "ACCELERATION" not in quantity.upper():
        raise text.needs(2, "an acceleration")
    unit = layout.search(r"UNITS?\s+OF\s+([^\s.,;]+)", quantity) or "none"
    count, step = (layout.search(pattern, last) for pattern in (_NPTS, _DT))
    if not (count and step):
        count, step = (layout.search(_TRAILING, last, group) for group in (1, 2))
    if not (count and step):
        raise text.needs(
            3, "a line with the number of samples (NPTS) and the time step (DT)"
        )
    stated = layout.number(count)
    where = text.place(3)
    count = f"{stated:.0f}" if stated is not None and stated % 1 == 0 else count
    # Without a direction at its end, by which records of one event would differ.
    record: dict[str, Any] = {"event": _DIRECTION.sub("", about)}
    parts = [part.strip() for part in about.split(",")]
    if len(parts) >= 3:
        dated = re.fullmatch(r"\d+/\d+/\d+", parts[1]) is not None and len(parts) > 3
        component = parts[-1].split("(")[0].strip()
        record = (layout.direction(component) if component else {}) | {
            "event": parts[0],
            "date": parts[1] if dated else "",
            "station": ", ".join(parts[2 if dated else 1 : -1]),
            "code": component,
        }
    record |= {
        "unit": layout.acceleration_unit(unit, text.place(2)),
        "announced": layout.checked_count(count, where),
    }
    return Stream(
        [layout.trace_of(text.numbers(4), layout.number(step), where, record)]
    )


def read_dyna(source: layout.Source, **_: Any) -> Stream:
    """Read an acceleration record of ESM, ITACA or AFAD."""
    text = layout.Text(source)
    header: dict[str, str] = {}
    for count, line in enumerate(text.lines):
        match = _KEY.match(line)
        if match is None:
            break
        key = match[1].upper()
        if key in header:
            raise RecordError(f"{text.place(count)}: {key} is there a second time")
        header[key] = match[2].strip()
        with contextlib.suppress(UnicodeDecodeError):  # names may be in UTF-8
            header[key] = match[2].encode("latin-1").decode("utf-8").strip()
    codes = (
        header.get("NETWORK", ""),
        header.get("STATION_CODE", ""),
        header.get("LOCATION", ""),
    )
    return _keyed(text, header, len(header), codes)


def read_resorce(source: layout.Source, **_: Any) -> Stream:
    """Read an acceleration record of RESORCE."""
    text = layout.Text(source)
    series = text.first(0, _SERIES.match)
    match = _SERIES.match("".join(text.lines[series : series + 1]))
    if match is None:
        raise RecordError(f"{text.name}: no line names the time series and its unit")
    header: dict[str, str] = {"DATA_TYPE": match[1], "UNITS": match[2]}
    for line in text.lines[:series]:
        name, colon, value = line.partition(":")
        if colon and (key := _RESORCE.get(name.rstrip().upper())):
            header[key] = value.strip()
    code, name = map(str.strip, header.get("STATION_CODE", "").partition("/")[::2])
    header["STATION_CODE"] = name or code
    return _keyed(text, header, series + 1, ("", code, ""))


def _keyed(
    text: layout.Text, header: dict[str, str], first: int, codes: tuple[str, str, str]
) -> Stream:
    """Return the record of a header in DYNA's keys, its samples from line `first` on."""
    kind = header.get("DATA_TYPE", "")
    if kind and not kind.upper().startswith("ACCEL"):
        raise RecordError(
            f"{text.name}: an acceleration is needed, DATA_TYPE is {kind!r}"
        )
    for key in ("UNITS", "SAMPLING_INTERVAL_S", "NDATA"):
        if not header.get(key):
            raise RecordError(f"{text.name}: the header gives no {key}")
    record = layout.read_fields(_DYNA, header.get)
    component = record.get("code", "")
    letter = (component[-1:] if len(component) == 3 else component).upper()
    cuts = (header.get(f"{end}_CUT_FREQUENCY_HZ", "") for end in ("LOW", "HIGH"))
    raw = "NOT REMOVED" in header.get("BASELINE_CORRECTION", "").upper()
    record |= {
        "unit": layout.acceleration_unit(header["UNITS"], f"{text.name}, UNITS"),
        "level": "processed"
        if re.search("[1-9]", "".join(cuts))
        else "raw"
        if raw
        else "",
        "announced": layout.checked_count(header["NDATA"], f"{text.name}, NDATA"),
        "vertical": letter in ("Z", "UP", "V", "UD") if letter else None,
        "azimuth": AZIMUTHS.get(letter),
        # A name may be of a country alone, that of many earthquakes.
        "event": ", ".join(filter(None, map(header.get, ("EVENT_NAME", "EVENT_ID")))),
    }
    if header.get("LATE/NORMAL_TRIGGERED", "").upper() == "LT":
        late = "its header says that it triggered late: the beginning of the motion is missing"
        record["cautions"] = [late]
    # Such as 20010203_040510.250 or, of AFAD, 03/02/2001 04:05:10.250.
    start = header.get("DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS", "")
    start = re.sub(r"(\d\d)/(\d\d)/(\d{4})", r"\3\2\1", start, count=1)
    origin = (
        f"{header.get('EVENT_DATE_YYYYMMDD', '')} {header.get('EVENT_TIME_HHMMSS', '')}"
    )
    clock, quake = (_CLOCK.match(text) for text in (start, origin))
    if quake and (time := layout.moment(*map(float, quake.groups()))):
        record["origin_time"] = str(time)
    return Stream(
        [
            layout.trace_of(
                text.numbers(first),
                layout.number(header["SAMPLING_INTERVAL_S"]),
                f"{text.name}, SAMPLING_INTERVAL_S",
                record,
                codes=codes,
                peak=header.get(f"PGA_{header['UNITS'].upper()}", ""),
                start=layout.moment(*map(float, clock.groups())) if clock else None,
            )
        ]
    )


def read_knet(source: layout.Source, **_: Any) -> Stream:
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
        layout.judge_peak(
            channel, str(knet.accmax), 100.0 * trace.stats.calib * trace.data, "gal"
        )
    return stream
