"""The channels of a record file: read, judged, in m/s2, and sorted by direction."""

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from obspy import Inventory, Stream, Trace, UTCDateTime

from archfrag.errors import RecordError
from archfrag.files import opened
from archfrag.motions.calibrate import calibrate, channel_code, points_down
from archfrag.motions.formats.columns import Columns, read_columns
from archfrag.motions.formats.waveform import (
    BINARY,
    OWN,
    TEXT,
    Content,
    Unreadable,
    archive_kind,
    read_as,
    recognise,
)  # fmt: skip
from archfrag.motions.index import IndexEntry, check_sha256, find_entry
from archfrag.motions.isolated import Reader
from archfrag.motions.partners import HORIZONTAL, VERTICAL
from archfrag.motions.plausible import Doubt, accept_or_refuse, record_size

_LARGE = 4 * 2**20  # [bytes] from which a text is read within limits, too
_reader = Reader()


class Options(NamedTuple):
    """What the user states of a file, see `archfrag.motions.read.read_motion`."""

    unit: str | None = None
    inventory: str | Path | Inventory | None = None
    accept: tuple[str, ...] = ()
    columns: Columns | None = None


class Channel(NamedTuple):
    """One channel of a file, in m/s2; without samples where its unit is not known.

    `faults` are what it contradicts itself in, `doubts` what it is refused for unless accepted.
    """

    trace: Trace
    announced: int
    held: int
    samples: NDArray[np.float64]
    unit_in_file: str
    log: tuple[str, ...]
    faults: tuple[str, ...]
    doubts: tuple[Doubt, ...]
    accepted: tuple[str, ...] = ()

    @property
    def code(self) -> str:
        """Name of the component."""
        return channel_code(self.trace)

    @property
    def start(self) -> UTCDateTime:
        """Time of the first sample."""
        return self.trace.stats.starttime

    @property
    def dt(self) -> float:
        """Time step [s]."""
        return float(self.trace.stats.delta)

    @property
    def record(self) -> Mapping[str, Any]:
        """What the header of the file states."""
        return self.trace.stats.get("record", {})

    @property
    def group(self) -> str:
        """What channels of one instrument have in common."""
        stats, code = self.trace.stats, self.code
        if stats.get("_format") == "KNET":
            return f"{stats.station}.{code[2:]}"
        family = code[:-1] if len(code) == 3 and code.isalnum() and not code.isdigit() else ""
        return f"{stats.network}.{stats.station}.{stats.location}.{family}"

    @property
    def vertical(self) -> bool:
        """Whether it is vertical, by its header or its code."""
        stated = self.record.get("vertical")
        return VERTICAL.fullmatch(self.code) is not None if stated is None else bool(stated)

    @property
    def horizontal(self) -> bool:
        """Whether it is known to be horizontal, by its header or its code."""
        stated = self.record.get("vertical")
        return HORIZONTAL.fullmatch(self.code) is not None if stated is None else not stated


class Examined(NamedTuple):
    """A file whatever is wrong with it; `gap` is why its traces cannot be joined, if so."""

    format: str
    channels: list[Channel]
    messages: tuple[str, ...]
    unequal: tuple[str, ...]
    gap: str


def read_channels(path: Path, options: Options) -> tuple[list[Channel], IndexEntry | None]:
    """Channels of a file in their order, and the row of an index that lists it."""
    entry = find_entry(path)
    if entry is not None and path.is_file():
        check_sha256(entry)
    found = examine(path, options)
    accept = (*options.accept, *(entry.accept if entry else ()))
    # Pieces between gaps are unequal in the formats of networks.
    unequal = found.unequal if found.format in OWN else ()
    accepted = [accept_or_refuse(path, accept, c.doubts) for c in found.channels]
    if found.gap:
        raise RecordError(f"{path}: {found.gap}")
    channels = []
    for channel, passed in zip(found.channels, accepted):
        faults = (*channel.faults, *unequal)
        log = (*found.messages, *channel.log, *(f"Fault: {fault}." for fault in faults))
        channels.append(channel._replace(accepted=passed, faults=faults, log=log))
    return channels, entry


def examine(path: Path, options: Options) -> Examined:
    """What is in a file; RecordError only if it cannot be read at all."""
    entry = find_entry(path)
    if entry is not None:
        options = options._replace(columns=options.columns or entry.columns)
    content = file_content(path, options.columns)
    doubts: dict[str, tuple[Doubt, ...]] = {}
    left: Doubt = "samples", "the last sample is left out, since the file ends within its line"
    for trace, announced, held in zip(content.traces, content.announced, content.held):
        found = _doubtful_trace(trace, announced, held)
        doubts[trace.id] = (*doubts.get(trace.id, ()), *found)
        if held < announced and trace is content.traces[-1] and _breaks_off(content, path):
            trace.data = trace.data[:-1]
            doubts[trace.id] = (*doubts[trace.id], left)
    impossible = any(word is None for found in doubts.values() for word, _ in found)
    traces, gap = (content.traces, "") if impossible else _joined(content.traces)
    rows = list(zip(traces, content.announced, content.held))
    if len(traces) < len(content.traces):
        rows = [(trace, trace.stats.npts, trace.stats.npts) for trace in traces]
    channels = [_channel(*row, doubts[row[0].id], path, options, entry) for row in rows]
    unequal: tuple[str, ...] = ()
    if len(set(content.held)) > 1:
        listed = ", ".join(f"{channel_code(t)} {n}" for t, n in zip(content.traces, content.held))
        unequal = (f"the channels of the file have unequal numbers of samples ({listed})",)
    return Examined(content.format, channels, content.messages, unequal, gap)


def file_content(path: Path, columns: Columns | None = None) -> Content:
    """What a file holds, read within limits unless it is a text of moderate size."""
    size = record_size(path)
    if columns is not None:
        traces = list(read_columns(path, columns))
        for trace in traces:
            trace.stats._format = "COLUMNS"
        counts = [trace.stats.npts for trace in traces]
        return Content("COLUMNS", traces, counts, counts, (f"Columns {columns}.",))
    name = str(path)
    # By its name alone, so that a damaged header is judged by the reader that knows it.
    found = "AT2" if path.suffix.lower() == ".at2" else recognise(name, TEXT)
    try:
        if found and size <= _LARGE:
            return read_as(name, found)
        content = _reader.read(name, (found,) if found else BINARY)
    except Unreadable as error:
        raise RecordError(str(error)) from None
    if content is not None:
        return content
    kind = archive_kind(name)
    if kind is not None:
        raise RecordError(f"{path}: this is an archive ({kind}), which is never unpacked here")
    raise RecordError(
        f"{path}: the format is not recognised; for columns of text give `columns` (--columns "
        "time=1,acceleration=2 on the command line); if it is not a record, move it, or name the "
        "records by a pattern such as *.AT2"
    )


def _doubtful_trace(trace: Trace, announced: int, held: int) -> Iterator[Doubt]:
    """What cannot be a record, or contradicts its header."""
    delta, code = trace.stats.delta, channel_code(trace) or trace.id
    if held == 0:
        yield None, f"channel {trace.id} holds no samples"
    if not (np.isfinite(delta) and delta > 0.0):
        yield None, f"time step {delta} s of channel {trace.id} must be a positive number of s"
    if announced != held:
        only = "only " if held < announced else ""
        stated = f"the header announces {announced} samples of channel {code}"
        yield "samples", f"{stated}, the file holds {only}{held}"
    else:
        for doubt in trace.stats.get("record", {}).get("doubts", ()):
            yield "header", f"channel {code}: {doubt}"
    if 0 < len(trace.data) < 2 or 0 < held < 2:
        yield None, f"channel {trace.id} holds {held} sample(s); 2 or more are needed"
    if np.ma.isMaskedArray(trace.data):
        yield None, f"channel {trace.id} has gaps; a record must be without gaps"
    bad = np.flatnonzero(~np.isfinite(trace.data))
    if bad.size:
        many = f"{bad.size} sample(s) that are not finite"
        yield None, f"channel {trace.id} has {many}, the first at index {bad[0]}"


def _breaks_off(content: Content, path: Path) -> bool:
    """Whether a text ends within its last line, so that digits may be missing."""
    with opened(path) as file:
        file.seek(-1, os.SEEK_END)
        return content.format in TEXT and not file.read(1).isspace()


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


def _channel(
    trace: Trace, announced: int, held: int, doubts: tuple[Doubt, ...], path: Path,
    options: Options, entry: IndexEntry | None,
) -> Channel:  # fmt: skip
    record = trace.stats.get("record", {})
    found = Channel(
        trace, announced, held, np.empty(0), "", tuple(record.get("log", ())),
        tuple(record.get("faults", ())), doubts,
    )  # fmt: skip
    if any(word is None for word, _ in doubts):
        return found
    try:
        done = calibrate(trace, path, options.unit, entry, options.inventory)
    except RecordError as error:
        faults = (*found.faults, *_offset(trace, "unit unknown"))
        unknown = None, str(error).removeprefix(f"{path}: ")
        return found._replace(faults=faults, doubts=(*doubts, unknown))
    log = (*found.log, *done.log)
    if record.get("sensor") == "borehole":
        log = (*log, f"Channel {found.code} is in the borehole, not at the surface.")
    samples = done.samples
    if found.vertical and points_down(trace, path, options.inventory):
        samples, log = -samples, (*log, f"Sign of {found.code} changed: it counts downwards.")
    faults = (*found.faults, *_offset(trace, done.unit_in_file))
    return found._replace(samples=samples, unit_in_file=done.unit_in_file, log=log, faults=faults)


def _offset(trace: Trace, unit: str) -> tuple[str, ...]:
    """The fault that the mean of a record exceeds what is left without it."""
    values = np.asarray(trace.data, dtype=np.float64)
    mean = float(values.mean())
    motion = float(np.abs(values - mean).max())
    if not abs(mean) > motion > 0.0:
        return ()
    return (f"the offset of the samples, {mean:.4g}, is larger than their motion about it, "
            f"{motion:.4g} [{unit} in the file]",)  # fmt: skip


def by_direction(
    channels: Sequence[Channel], path: Path, remedy: str
) -> tuple[list[Channel], list[Channel]]:
    """The channels that are not known to be vertical, and the vertical ones.

    RecordError if there are only verticals or, with a `remedy`, one may be horizontal or not.
    """
    verticals = [c for c in channels if c.vertical]
    others = [c for c in channels if not c.vertical]
    if not others:
        only = f"holds only the vertical component ({verticals[0].code})"
        raise RecordError(f"{path}: {only}; a horizontal one is needed")
    if remedy and len(channels) > 1 and not all(c.horizontal for c in others):
        names = ", ".join(repr(c.code) for c in channels)
        unclear = f"which of the channels {names} is horizontal is not clear from their codes"
        raise RecordError(f"{path}: {unclear}; {remedy}")
    return others, verticals
