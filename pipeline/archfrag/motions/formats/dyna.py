"""ESM and ITACA acceleration files (DYNA 1.x, and ITACA before it), as a plug-in of obspy.

Lines ``KEY: value``, then one sample a line. DYNA 1.0 has 55 of them and DYNA 1.2, which ESM
and AFAD's TADAS give out too, 64 (ITACA 2.x user manual, header of waveform files); the ITACA 1
header has fewer and gives the component as NS, WE or UP. Nothing here counts lines: what matters
is found by its key.
"""

import re
from typing import Any

from obspy import Stream, UTCDateTime

from archfrag.errors import RecordError
from archfrag.motions.formats import facts
from archfrag.motions.formats.text import Source, head_lines, numbers, read_lines, source_name

_KEY = re.compile(r"\s*([A-Za-z][\w/^().-]*)\s*:(.*)")
_DATE = re.compile(r"(\d{4})[/-]?(\d\d)[/-]?(\d\d)")
_CLOCK = r"[_ T](\d\d):?(\d\d):?(\d\d(?:\.\d+)?)"
_FIRST_SAMPLE = re.compile(_DATE.pattern + _CLOCK)
_DAY_FIRST = re.compile(r"(\d\d)/(\d\d)/(\d{4})" + _CLOCK)  # AFAD
_AZIMUTHS = {"N": 0.0, "NS": 0.0, "E": 90.0, "WE": 90.0, "EW": 90.0}
_VERTICALS = ("Z", "UP", "V", "UD")


def is_dyna(source: Source) -> bool:
    """Tell whether a file or open binary buffer has the header of ESM, ITACA or AFAD.

    True if the first line names an event and a later one the time step or number of samples,
    whatever their values: those are judged by `read_dyna`.
    """
    keys = [match.group(1) for match in map(_KEY.match, head_lines(source)) if match]
    lines = head_lines(source)[:1]
    return (
        bool(lines)
        and re.match(r"EVENT_(NAME|ID)\s*:", lines[0]) is not None
        and not {"SAMPLING_INTERVAL_S", "NDATA"}.isdisjoint(keys)
    )


def read_dyna(source: Source, **_: Any) -> Stream:
    """Read an acceleration record of ESM, ITACA or AFAD.

    Parameters
    ----------
    source : path or open binary buffer

    Returns
    -------
    obspy.Stream
        One trace in the unit of the file, with ``stats.record``; its `level` is ``processed``
        where the header gives a cut-off frequency.

    Raises
    ------
    RecordError
        If the header lacks the unit, time step or number of samples, or one of them cannot be
        used, if it is of a velocity, displacement or spectrum, or a sample is no finite number.
    """
    name, lines = source_name(source), read_lines(source)
    header, places = _header(lines, name)
    kind = header.get("DATA_TYPE", "")
    if kind and kind.upper() != "ACCELERATION":
        raise RecordError(f"{places['DATA_TYPE']}: an acceleration is needed, this is {kind!r}")
    needed = ("UNITS", "SAMPLING_INTERVAL_S", "NDATA")
    for key in needed:
        if not header.get(key):
            raise RecordError(f"{places.get(key, name)}: the header gives no {key}")
    unit = facts.acceleration_unit(header["UNITS"], places["UNITS"])
    step = facts.number_of(header["SAMPLING_INTERVAL_S"])
    step = facts.positive_step(step, places["SAMPLING_INTERVAL_S"])
    announced = facts.whole_count(header["NDATA"], places["NDATA"])
    samples = numbers(lines[len(header) :], len(header) + 1, name)
    component = header.get("STREAM") or header.get("COMPONENT") or ""
    letter = component[-1:] if len(component) == 3 else component
    start = _first_sample(header.get("DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS", ""))
    codes = (header.get("NETWORK", ""), header.get("STATION_CODE", ""), header.get("LOCATION", ""))
    record = facts.known(
        unit=unit,
        level=_level(header),
        announced=announced,
        component=component,
        vertical=letter.upper() in _VERTICALS if letter else None,
        azimuth=_AZIMUTHS.get(letter.upper()),
        header="\n".join(line.rstrip() for line in lines[: len(header)]),
        **_event(header),
    )
    facts.judge_peak(record, header.get(f"PGA_{header['UNITS'].upper()}", ""), samples, unit)
    return Stream([facts.trace_of(samples, step, record, codes=codes, start=start)])


def _header(lines: list[str], name: str) -> tuple[dict[str, str], dict[str, str]]:
    """Values by key, and where each stands."""
    header: dict[str, str] = {}
    places: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        match = _KEY.match(line)
        if match is None:
            break
        key = match.group(1).upper()
        if key in header:
            raise RecordError(f"{name}, line {number}: {key} is there a second time")
        header[key], places[key] = _readable(match.group(2)), f"{name}, line {number}"
    return header, places


def _readable(text: str) -> str:
    """A value, whose names may be in UTF-8."""
    try:
        return text.encode("latin-1").decode("utf-8").strip()
    except UnicodeDecodeError:
        return text.strip()


def _event(header: dict[str, str]) -> dict[str, Any]:
    def given(key: str) -> float | None:
        return facts.number_or_none(header.get(key))

    date = _DATE.fullmatch(header.get("EVENT_DATE_YYYYMMDD", ""))
    magnitude = given("MAGNITUDE_W")
    vs30 = given("VS30_M/S")
    return {
        "event": header.get("EVENT_NAME") or header.get("EVENT_ID"),
        "date": "-".join(date.groups()) if date else None,
        "magnitude": given("MAGNITUDE_L") if magnitude is None else magnitude,
        "depth_km": given("EVENT_DEPTH_KM"),
        "event_latitude": given("EVENT_LATITUDE_DEGREE"),
        "event_longitude": given("EVENT_LONGITUDE_DEGREE"),
        "station": header.get("STATION_CODE"),
        "station_latitude": given("STATION_LATITUDE_DEGREE"),
        "station_longitude": given("STATION_LONGITUDE_DEGREE"),
        "vs30_mps": given("VS30_MS") if vs30 is None else vs30,
        "epicentral_km": given("EPICENTRAL_DISTANCE_KM"),
    }


def _level(header: dict[str, str]) -> str:
    cuts = (header.get("LOW_CUT_FREQUENCY_HZ"), header.get("HIGH_CUT_FREQUENCY_HZ"))
    if any(facts.number_or_none(cut) for cut in cuts):
        return "processed"
    return "raw" if "NOT REMOVED" in header.get("BASELINE_CORRECTION", "").upper() else ""


def _first_sample(text: str) -> UTCDateTime | None:
    found, day_first = _FIRST_SAMPLE.match(text), _DAY_FIRST.match(text)
    if found:
        year, month, day = map(int, found.groups()[:3])
    elif day_first:
        day, month, year = map(int, day_first.groups()[:3])
    match = found or day_first
    if match is None:
        return None
    hour, minute, second = map(float, match.groups()[3:])
    try:
        return UTCDateTime(year, month, day) + 3600.0 * hour + 60.0 * minute + second
    except ValueError:
        return None
