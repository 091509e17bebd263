"""SMC files of the U.S. Geological Survey, as a waveform plug-in of obspy.

One component a file: 11 lines of text, 48 integers in columns of 10, 50 reals in columns of 15,
comments that begin with ``|``, samples in cm/s2 in columns of 10. Uncorrected volumes of digitised
film state no sampling rate and hold pairs of time and acceleration. Layout: USGS National
Strong-Motion Project, "SMC-format data files" (nsmp.wr.usgs.gov/smcfmt.html).
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Stream, UTCDateTime

from archfrag.errors import RecordError
from archfrag.motions.formats import facts
from archfrag.motions.formats.text import (
    Source,
    head_lines,
    numbers,
    on_even_steps,
    read_lines,
    source_name,
)

_TEXT, _INTEGERS, _REALS = 11, 48, 50
_INTEGER_LINES, _REAL_LINES = 6, 10
_TITLE = re.compile(r"\s*([1-9])\s+([A-Z].*)")
_LEVELS = {"1": "raw", "2": "processed"}
_COMPONENT = re.compile(r"station\s*=\s*(.*?)\s*component\s*=\s*(.*)", re.IGNORECASE)
_ROW = 8  # numbers: writers of uncorrected volumes left a last row of what was in their memory
_WIDTHS = {"integer": 10, "real": 15, "sample": 10}


def is_smc(source: Source) -> bool:
    """Tell whether a file or open binary buffer is an SMC file, of whatever quantity."""
    lines = head_lines(source)
    if len(lines) < _TEXT + _INTEGER_LINES or not _TITLE.match(lines[0]):
        return False
    stars = sum(line.strip() == "*" for line in lines[1:_TEXT])
    integers = lines[_TEXT : _TEXT + _INTEGER_LINES]
    return (
        stars >= 3
        and _COMPONENT.match(lines[5]) is not None
        and all(re.fullmatch(r"[-+\d\s]+", line) for line in integers)
    )


def read_smc(source: Source, **_: Any) -> Stream:
    """Read the acceleration of an SMC file.

    Parameters
    ----------
    source : path or open binary buffer

    Returns
    -------
    obspy.Stream
        One trace in cm/s2; ``stats.record`` has what the header says.

    Raises
    ------
    RecordError
        If the file holds something other than an acceleration, a header cannot be read or a
        sample is not a finite number.
    """
    name, lines = source_name(source), read_lines(source)
    title = _TITLE.match(lines[0])
    level = _LEVELS.get(title.group(1)) if title else None
    if level is None or "ACCEL" not in lines[0].upper():
        raise RecordError(
            f"{name}, line 1: an accelerogram (type 1 or 2) is needed, this is "
            f"{lines[0].strip()[:60]!r}"
        )
    integers = _header(lines, _TEXT, _INTEGERS, "integer", name)
    reals = _header(lines, _TEXT + _INTEGER_LINES, _REALS, "real", name)
    null = {"integer": integers[0], "real": reals[0]}
    first = _TEXT + _INTEGER_LINES + _REAL_LINES
    while first < len(lines) and lines[first].lstrip().startswith("|"):
        first += 1
    count = facts.whole_count(f"{integers[16]:.0f}", f"{name}, line {_TEXT + 3}")
    values = numbers(lines[first:], first + 1, name, expected=count, width=_WIDTHS["sample"])
    record = _record(lines[:_TEXT], integers, reals, null)
    if count < values.size <= count + _ROW:
        values = values[:count]
        record["log"] = (f"Row beyond the {count} numbers that the header counts left out.",)
    record |= {"level": level, "unit": "cm/s2", "announced": count, "held": values.size}
    record["header"] = "\n".join(line.rstrip() for line in lines[:_TEXT])
    _judge(record, reals, null["real"], values)
    if reals[1] != null["real"]:
        rate = float(reals[1])
        step = facts.positive_step(1.0 / rate if rate else 0.0, f"{name}, line {first}")
    else:
        values, step = _even(record, values, count, name)
    codes = ("", str(lines[2].strip().split(" ")[0]), "")
    start = _start(integers, null["integer"])
    return Stream([facts.trace_of(values, step, record, codes=codes, start=start)])


def _header(
    lines: Sequence[str], place: int, count: int, kind: str, name: str
) -> NDArray[np.float64]:
    rows = lines[place : place + (_INTEGER_LINES if kind == "integer" else _REAL_LINES)]
    values = numbers(rows, place + 1, name, expected=count, width=_WIDTHS[kind])
    if values.size != count:
        raise RecordError(
            f"{name}, line {place + 1}: {count} {kind} numbers are needed in the header, there "
            f"are {values.size}"
        )
    return values


def _even(
    record: dict[str, Any], values: NDArray[np.float64], count: int, name: str
) -> tuple[NDArray[np.float64], float]:
    """Samples of pairs of time and acceleration."""
    held = values.size // 2
    record |= {"announced": count // 2, "held": held}
    if held < 2:
        return values[:0], 1.0
    samples, step, sentence = on_even_steps(values[: 2 * held : 2], values[1 : 2 * held : 2], name)
    record["log"] = (*record.get("log", ()), *filter(None, (sentence,)))
    return samples, step


def _record(
    text: Sequence[str], integers: NDArray[np.float64], reals: NDArray[np.float64],
    null: dict[str, float],
) -> dict[str, Any]:  # fmt: skip
    found = _COMPONENT.match(text[5])
    station, way = found.groups() if found else ("", "")
    stated = facts.direction(way)
    upward, across = integers[12], integers[13]  # degrees from the vertical, from north

    def real(index: int) -> float | None:
        return None if reals[index] == null["real"] else float(reals[index])

    if upward in (0.0, 180.0):
        stated |= {"component": "UP" if upward == 0.0 else "DOWN", "vertical": True}
    elif upward == 90.0 and across != null["integer"] and 0 <= across <= 360:
        stated |= {"azimuth": float(across), "vertical": False}
    year, day = integers[1], integers[2]
    date = ""
    if 1800 <= year <= 2200 and 1 <= day <= 366:
        date = str((UTCDateTime(int(year), 1, 1) + 86400 * (int(day) - 1)).date)
    named = re.sub(r"^[\s\d]+", "", text[3]).strip()
    return stated | facts.known(
        event=named, date=date, magnitude=real(5) or real(7) or real(6) or real(8),
        depth_km=real(4), event_latitude=real(2), event_longitude=real(3), station=station,
        station_latitude=real(10), station_longitude=real(11), epicentral_km=real(16),
    )  # fmt: skip


def _judge(
    record: dict[str, Any], reals: NDArray[np.float64], null: float, values: NDArray[np.float64]
) -> None:
    """The larger of the header's maximum and minimum against the samples."""
    samples = values if reals[1] != null else values[1::2]
    peaks = [value for value in (reals[29], reals[31]) if value != null]
    if peaks:
        facts.judge_peak(record, f"{max(map(abs, peaks)):.6E}", samples, "cm/s2")


def _start(integers: NDArray[np.float64], null: float) -> UTCDateTime | None:
    year, day, hour, minute, second = integers[1:6]
    if null in (year, day, hour, minute) or not (1800 <= year <= 2200 and 1 <= day <= 366):
        return None
    if not (0 <= hour < 24 and 0 <= minute < 60):
        return None
    seconds = second if second != null and 0 <= second < 60 else 0.0
    midnight = UTCDateTime(int(year), 1, 1) + 86400 * (int(day) - 1)
    return midnight + 3600 * int(hour) + 60 * int(minute) + float(seconds)
