"""RESORCE acceleration files, as a plug-in of obspy.

Ten lines ``Key : value``, a line that names quantity and unit, then samples in columns of fixed
width: a minus sign leaves no blank before it.
"""

import re
from typing import Any

from obspy import Stream

from archfrag.errors import RecordError
from archfrag.motions.formats import facts
from archfrag.motions.formats.text import Source, head_lines, numbers, read_lines, source_name

_FIRST_KEY = "Event Date & Time"
_SERIES = re.compile(r"\s*(\w+) time series in (.+)", re.IGNORECASE)
_LONGEST_HEADER = 40  # lines
_DATE = re.compile(r"(\d{4})[-/](\d\d)[-/](\d\d)")
_AZIMUTHS = {"NS": 0.0, "N": 0.0, "WE": 90.0, "EW": 90.0, "E": 90.0}
_VERTICALS = ("UP", "UD", "Z", "V")


def is_resorce(source: Source) -> bool:
    """Tell whether a file or open binary buffer has the header of RESORCE.

    True if the first line is the event's and a later one names a time series and its unit.
    """
    lines = head_lines(source)[:_LONGEST_HEADER]
    return bool(lines) and lines[0].startswith(_FIRST_KEY) and any(map(_SERIES.match, lines))


def read_resorce(source: Source, **_: Any) -> Stream:
    """Read an acceleration record of RESORCE.

    Parameters
    ----------
    source : path or open binary buffer

    Returns
    -------
    obspy.Stream
        One trace in the unit of the file, with ``stats.record``; its `level` is ``processed``
        where the header gives cut-off frequencies.

    Raises
    ------
    RecordError
        If the header lacks the unit, time step or number of samples, or one of them cannot be
        used, if it is of a velocity or displacement, or a sample is no finite number.
    """
    name, lines = source_name(source), read_lines(source)
    series = next((i for i, line in enumerate(lines) if _SERIES.match(line)), None)
    if series is None:
        raise RecordError(f"{name}: no line names the time series and its unit")
    quantity, unit_text = _SERIES.match(lines[series]).groups()  # type: ignore[union-attr]
    place = f"{name}, line {series + 1}"
    if not quantity.lower().startswith("accel"):
        raise RecordError(f"{place}: an acceleration is needed, this is {quantity!r}")
    unit = facts.acceleration_unit(unit_text, place)
    header = {
        key.strip().lower(): value.strip()
        for key, colon, value in (line.partition(":") for line in lines[:series])
        if colon
    }
    step = facts.number_of(header.get("time increment (s)"))
    step = facts.positive_step(step, f"{name}, Time Increment")
    announced = facts.whole_count(header.get("number of data", ""), f"{name}, Number of Data")
    samples = numbers(lines[series + 1 :], series + 2, name)
    code, _slash, station = (part.strip() for part in _station(header).partition("/"))
    component = header.get("orientation", "")
    date = _DATE.match(header.get("event date & time", ""))
    cuts = header.get("filter cut-off frequency (hz)", "").split("-")
    record = facts.known(
        unit=unit,
        level="processed" if any(map(facts.number_or_none, cuts)) else "",
        announced=announced,
        component=component,
        vertical=component.upper() in _VERTICALS if component else None,
        azimuth=_AZIMUTHS.get(component.upper()),
        date="-".join(date.groups()) if date else None,
        station=station or code,
        header="\n".join(line.rstrip() for line in lines[: series + 1]),
    )
    peak = header.get(f"pga ({unit_text.strip().lower()})", "")
    facts.judge_peak(record, peak, samples, unit)
    return Stream([facts.trace_of(samples, step, record, codes=("", code, ""))])


def _station(header: dict[str, str]) -> str:
    return header.get("station code / name", "")
