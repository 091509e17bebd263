"""The channels of a record file: read, judged, in m/s2, and sorted by direction.

A channel is an obspy Trace. Its ``stats.record`` has what the header states, ``announced`` and
``held`` numbers of samples, a ``log`` of what was done, ``faults`` (contradictions) and
``doubts`` (what it is refused for unless accepted); ``unit_in_file`` is empty where no unit is
known, and then the samples are those of the file.
"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from obspy import Inventory, Stream, Trace
from obspy.core import AttribDict

from archfrag.errors import RecordError
from archfrag.files import opened
from archfrag.motions.calibrate import calibrate, points_down
from archfrag.motions.formats.columns import Columns, read_columns
from archfrag.motions.formats.waveform import (
    BINARY,
    OWN,
    TEXT,
    archive_kind,
    read_as,
    recognise,
)  # fmt: skip
from archfrag.motions.index import IndexEntry, check_sha256, find_entry
from archfrag.motions.isolated import read_apart
from archfrag.motions.partners import channel_code, is_horizontal, is_vertical
from archfrag.motions.plausible import Doubt, accept_or_refuse, record_size


class Reading(NamedTuple):
    """What the user states of a file, see `archfrag.motions.read.read_motion`."""

    unit: str | None = None
    inventory: str | Path | Inventory | None = None
    accept: tuple[str, ...] = ()
    columns: Columns | None = None


def read_channels(path: Path, options: Reading) -> tuple[list[Trace], IndexEntry | None]:
    """Return the channels of a file in their order, and the row of an index that lists it."""
    entry = find_entry(path)
    if entry is not None and path.is_file():
        check_sha256(entry)
    channels, unequal, gap = examine(path, options)
    accept = (*options.accept, *(entry.accept if entry else ()))
    for channel in channels:
        record = channel.stats.record
        record.accepted = accept_or_refuse(path, accept, record.doubts)
        if channel.stats._format in OWN:  # pieces between gaps are unequal in those of networks
            record.faults = (*record.faults, *unequal)
        faults = (f"Fault: {fault}." for fault in record.faults)
        record.log = (*record.messages, *record.log, *faults)
    if gap:
        raise RecordError(f"{path}: {gap}")
    return channels, entry


def examine(path: Path, options: Reading) -> tuple[list[Trace], tuple[str, ...], str]:
    """Read a file whatever is wrong with it; RecordError only if it cannot be read at all.

    Returns
    -------
    list of obspy.Trace
    tuple of str
        That the numbers of samples are unequal, if they are.
    str
        Why its traces cannot be joined, if so.
    """
    entry = find_entry(path)
    traces = _traces(path, options.columns or (entry.columns if entry else None))
    unequal: tuple[str, ...] = ()
    if len({trace.stats.record.held for trace in traces}) > 1:
        listed = (f"{channel_code(trace)} {trace.stats.record.held}" for trace in traces)
        numbers = f"unequal numbers of samples ({', '.join(listed)})"
        unequal = (f"the channels of the file have {numbers}",)
    doubts: dict[str, tuple[Doubt, ...]] = {}
    for trace in traces:
        doubts[trace.id] = (*doubts.get(trace.id, ()), *_doubts(trace))
        record = trace.stats.record
        if record.held < record.announced and trace is traces[-1] and _breaks_off(trace, path):
            trace.data = trace.data[:-1]
            left = "the last sample is left out, since the file ends within its line"
            doubts[trace.id] = (*doubts[trace.id], ("samples", left))
    impossible = any(word is None for found in doubts.values() for word, _ in found)
    channels, gap = (traces, "") if impossible else _joined(traces)
    for channel in channels:
        if len(channels) < len(traces):
            channel.stats.record.update(dict.fromkeys(("announced", "held"), channel.stats.npts))
        _calibrate(channel, doubts[channel.id], path, options, entry)
    return channels, unequal, gap


def _traces(path: Path, columns: Columns | None) -> list[Trace]:
    """Traces of a file, of formats in binary read apart."""
    record_size(path)
    if columns is not None:
        return read_columns(path, columns)
    name = str(path)
    # By its name alone, so that a damaged header is judged by the reader that knows it.
    form = "AT2" if path.suffix.lower() == ".at2" else recognise(name, TEXT)
    if traces := read_as(name, form) if form else read_apart(name, BINARY):
        return traces
    if kind := archive_kind(name):
        raise RecordError(f"{path}: this is an archive ({kind}), which is never unpacked here")
    raise RecordError(
        f"{path}: the format is not recognised; for columns of text give `columns` (--columns "
        "time=1,acceleration=2 on the command line); if it is not a record, move it, or name the "
        "records by a pattern such as *.AT2"
    )


def _doubts(trace: Trace) -> Iterator[Doubt]:
    """What cannot be a record, or contradicts its header."""
    delta, code, record = trace.stats.delta, channel_code(trace) or trace.id, trace.stats.record
    announced, held = record.announced, record.held
    if held == 0:
        yield None, f"channel {trace.id} holds no samples"
    if not (np.isfinite(delta) and delta > 0.0):
        yield None, f"time step {delta} s of channel {trace.id} must be a positive number of s"
    if announced != held:
        only = "only " if held < announced else ""
        stated = f"the header announces {announced} samples of channel {code}"
        yield "samples", f"{stated}, the file holds {only}{held}"
    else:
        for doubt in record.get("doubts", ()):
            yield "header", f"channel {code}: {doubt}"
    if 0 < len(trace.data) < 2 or 0 < held < 2:
        yield None, f"channel {trace.id} holds {held} sample(s); 2 or more are needed"
    if np.ma.isMaskedArray(trace.data):
        yield None, f"channel {trace.id} has gaps; a record must be without gaps"
    bad = np.flatnonzero(~np.isfinite(trace.data))
    if bad.size:
        many = f"{bad.size} sample(s) that are not finite"
        yield None, f"channel {trace.id} has {many}, the first at index {bad[0]}"


def _breaks_off(trace: Trace, path: Path) -> bool:
    """Whether a text ends within its last line, so that digits may be missing."""
    with opened(path) as file:
        file.seek(-1, os.SEEK_END)
        return trace.stats._format in TEXT and not file.read(1).isspace()


def _joined(traces: list[Trace]) -> tuple[list[Trace], str]:
    """What is only split as one; why not where there are holes."""
    stream = Stream(list(traces))
    if len({trace.id for trace in stream}) < len(stream):
        stream.merge(method=-1)
    for network, station, location, channel, start, _, length, _ in stream.get_gaps():
        kind = "a gap" if length > 0 else "an overlap"
        where = f"channel {network}.{station}.{location}.{channel}"
        text = f"{where} has {kind} of {abs(length):g} s after {start}"
        return traces, f"{text}; a record must be without gaps"
    return list(stream), ""


def _calibrate(
    trace: Trace, doubts: tuple[Doubt, ...], path: Path, options: Reading,
    entry: IndexEntry | None,
) -> None:  # fmt: skip
    """Bring the samples of a channel to m/s2, upwards, where its unit is known."""
    record: AttribDict = trace.stats.record
    record.doubts, record.unit_in_file = doubts, ""
    record.log, record.faults = (tuple(record.get(key, ())) for key in ("log", "faults"))
    if any(word is None for word, _ in doubts):
        return
    values = np.asarray(trace.data, dtype=np.float64)
    try:
        done = calibrate(trace, path, options.unit, entry, options.inventory)
        trace.data, record.unit_in_file, log = done
        record.log += log
    except RecordError as error:
        record.doubts = (*doubts, (None, str(error).removeprefix(f"{path}: ")))
    mean = float(values.mean())
    motion = float(np.abs(values - mean).max())
    if abs(mean) > motion > 0.0:
        unit = record.unit_in_file or "unit unknown"
        offset = f"the offset of the samples, {mean:.4g}, is larger than their motion about it, "
        record.faults += (f"{offset}{motion:.4g} [{unit} in the file]",)
    if not record.unit_in_file:
        return
    code = channel_code(trace)
    if record.get("sensor") == "borehole":
        record.log += (f"Channel {code} is in the borehole, not at the surface.",)
    if is_vertical(trace) and points_down(trace, path, options.inventory):
        trace.data = -trace.data
        record.log += (f"Sign of {code} changed: it counts downwards.",)


def by_direction(
    channels: Sequence[Trace], path: Path, remedy: str
) -> tuple[list[Trace], list[Trace]]:
    """Return the channels that are not known to be vertical, and the vertical ones.

    RecordError if there are only verticals or, with a `remedy`, one may be horizontal or not.
    """
    verticals = [c for c in channels if is_vertical(c)]
    others = [c for c in channels if not is_vertical(c)]
    if not others:
        only = f"holds only the vertical component ({channel_code(verticals[0])})"
        raise RecordError(f"{path}: {only}; a horizontal one is needed")
    if remedy and len(channels) > 1 and not all(map(is_horizontal, others)):
        names = ", ".join(repr(channel_code(c)) for c in channels)
        unclear = f"which of the channels {names} is horizontal is not clear from their codes"
        raise RecordError(f"{path}: {unclear}; {remedy}")
    return others, verticals
