"""PEER AT2 acceleration files, as a waveform plug-in of obspy.

Four header lines (what it is; event, date, station, component; quantity and unit; number of
samples and time step), then samples in rows. The headers of the NGA database, of the strong
motion database before it and of its many re-issues differ in the fourth line only.

The samples of the trace stay in the unit that the file names (``stats.record.unit``) and
``stats.calib`` stays 1, so nothing is left that could be applied twice.
"""

import re
from typing import Any

import numpy as np
from obspy import Stream

from archfrag.errors import RecordError
from archfrag.motions.formats import facts
from archfrag.motions.formats.text import (
    Source,
    head_lines,
    numbers,
    read_lines,
    source_name,
)
from archfrag.motions.units import METRES_PER_SECOND_SQUARED

HEADER_LINES = 4
_QUANTITY = re.compile(r"ACCELERATION", re.IGNORECASE)
_UNIT = re.compile(r"UNITS?\s+OF\s+([^\s.,;]+)", re.IGNORECASE)
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][-+]?\d+)?"
_NAMED = (
    re.compile(r"NPTS\s*=\s*(" + _NUMBER + ")", re.IGNORECASE),
    re.compile(r"\bDT\s*=\s*(" + _NUMBER + ")", re.IGNORECASE),
)
_TRAILING = re.compile(rf"^\s*({_NUMBER})\s+({_NUMBER})\s+NPTS\s*,\s*DT", re.IGNORECASE)
_DATE = re.compile(r"\d+/\d+/\d+")
_UNIT_NAMES = {"G": "g", "CM/S2": "cm/s2", "CM/SEC2": "cm/s2", "CM/S/S": "cm/s2",
               "CM/SEC/SEC": "cm/s2", "GAL": "gal", "M/S2": "m/s2", "M/SEC2": "m/s2",
               "M/S/S": "m/s2", "MM/S2": "mm/s2"}  # fmt: skip


def is_at2(source: Source) -> bool:
    """Tell whether a file or open binary buffer holds a PEER AT2 acceleration record.

    True if the third line names an acceleration and its unit and the fourth the number of
    samples and the time step, whatever their values: those are judged by `read_at2`.
    """
    lines = head_lines(source)[:HEADER_LINES]
    return (
        len(lines) == HEADER_LINES
        and "".join(lines).isascii()
        and _QUANTITY.search(lines[2]) is not None
        and _UNIT.search(lines[2]) is not None
        and _count_and_step(lines[3]) is not None
    )


def read_at2(source: Source, *, partial: bool = False, **_: Any) -> Stream:
    """Read a PEER AT2 acceleration record.

    Parameters
    ----------
    source : path or open binary buffer
    partial : bool
        Leave it to the caller to compare the number of samples with the one announced.

    Returns
    -------
    obspy.Stream
        One trace in the unit of the file. ``stats.record`` holds ``unit`` (as archfrag writes
        it), ``announced`` (number of samples), ``event``, ``date``, ``station``, ``component``
        with what it says of the direction, and ``header`` (four lines).

    Raises
    ------
    RecordError
        If the header cannot be read, the unit is unknown, the time step is not positive, a
        sample is not a finite number, or there are fewer or more samples than announced (unless
        `partial`).
    """
    name, lines = source_name(source), read_lines(source)
    if lines[-1] == "":
        lines.pop()
    if len(lines) <= HEADER_LINES:
        raise RecordError(
            f"{name}: an AT2 file has {HEADER_LINES} header lines and then samples; this one "
            f"ends after {len(lines)} line(s)"
        )
    header = [line.strip() for line in lines[:HEADER_LINES]]
    unit = _unit(header[2], name)
    announced, step = _announcement(header[3], name)
    samples = numbers(lines[HEADER_LINES:], HEADER_LINES + 1, name)
    if samples.size != announced and not partial:
        word = "only " if samples.size < announced else ""
        raise RecordError(
            f"{name}: the header announces NPTS = {announced} samples, the file holds "
            f"{word}{samples.size}"
        )
    record = _names(header[1])
    record |= {"unit": unit, "announced": announced, "header": "\n".join(header)}
    return Stream([facts.trace_of(samples, step, record)])


def _count_and_step(line: str) -> tuple[str, str] | None:
    named = [pattern.search(line) for pattern in _NAMED]
    if named[0] and named[1]:
        return named[0].group(1), named[1].group(1)
    trailing = _TRAILING.search(line)
    return (trailing.group(1), trailing.group(2)) if trailing else None


def _announcement(line: str, name: str) -> tuple[int, float]:
    found = _count_and_step(line)
    if found is None:
        raise RecordError(
            f"{name}, line {HEADER_LINES}: the number of samples (NPTS) and the time step (DT) "
            f"are not in {line!r}"
        )
    count, step = (float(text.upper().replace("D", "E")) for text in found)
    if count < 2 or count != int(count):
        raise RecordError(
            f"{name}, line {HEADER_LINES}: NPTS = {found[0]} must be a whole number, 2 or more"
        )
    if not (np.isfinite(step) and step > 0.0):
        raise RecordError(
            f"{name}, line {HEADER_LINES}: time step DT = {found[1]} s must be a positive number "
            "of seconds"
        )
    return int(count), step


def _unit(line: str, name: str) -> str:
    if not _QUANTITY.search(line):
        raise RecordError(f"{name}, line 3: an acceleration is needed, this is {line!r}")
    found = _UNIT.search(line)
    unit = _UNIT_NAMES.get(found.group(1).upper()) if found else None
    if unit is None:
        asked = repr(found.group(1)) if found else "none"
        allowed = ", ".join(METRES_PER_SECOND_SQUARED)
        raise RecordError(
            f"{name}, line 3: unknown unit {asked} of acceleration; allowed are {allowed}"
        )
    return unit


def _names(line: str) -> dict[str, Any]:
    parts = [part.strip() for part in line.split(",")]
    if len(parts) < 3:
        return {"event": line, "component": ""}
    dated = _DATE.fullmatch(parts[1]) is not None and len(parts) > 3
    component = parts[-1].split("(")[0].strip()
    return (facts.direction(component) if component else {}) | {
        "event": parts[0],
        "date": parts[1] if dated else "",
        "station": ", ".join(parts[2 if dated else 1 : -1]),
        "component": component,
    }
