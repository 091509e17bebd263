"""The channels of a record file: read, judged, in m/s2, and sorted by direction."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from obspy import Inventory, Stream, Trace, UTCDateTime

from archfrag.errors import RecordError
from archfrag.motions.calibrate import calibrate, channel_code, find_inventory, points_down
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
from archfrag.motions.plausible import accept_or_refuse, check_name, doubtful_count

_LARGE = 4 * 2**20  # [bytes] from which a text is read within limits, too
_reader = Reader()


class Options(NamedTuple):
    """What the user states of a file, see `archfrag.motions.read.read_motion`."""

    unit: str | None = None
    inventory: str | Path | Inventory | None = None
    accept: tuple[str, ...] = ()
    columns: Columns | None = None


class Channel(NamedTuple):
    """One channel of a file, in m/s2."""

    code: str
    group: str
    start: UTCDateTime
    dt: float
    samples: NDArray[np.float64]
    unit_in_file: str
    log: tuple[str, ...]
    accepted: tuple[str, ...]
    faults: tuple[str, ...]
    trace: Trace

    @property
    def record(self) -> Mapping[str, Any]:
        """What the header of the file states."""
        return self.trace.stats.get("record", {})

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


def read_channels(path: Path, options: Options) -> tuple[list[Channel], IndexEntry | None]:
    """Channels of a file in their order, and the row of an index that lists it."""
    entry = find_entry(path)
    if entry is not None:
        accept = (*options.accept, *entry.accept)
        options = options._replace(accept=accept, columns=options.columns or entry.columns)
        if path.is_file():
            check_sha256(entry)
    content = file_content(path, options.columns)
    accepted = _check_counts(content, path, options.accept)
    # Pieces between gaps are unequal in the formats of networks.
    unequal = unequal_counts(content) if content.format in OWN else ()
    stream = joined(content.traces, path)
    channels = []
    for trace in stream:
        channel = _channel(trace, path, options, entry, content.messages)
        faults = (*channel.faults, *unequal)
        log = (*channel.log, *(f"Fault: {fault}." for fault in faults))
        passed = accepted.get(trace.id, ())
        channels.append(channel._replace(accepted=passed, faults=faults, log=log))
    return channels, entry


def file_content(path: Path, columns: Columns | None = None) -> Content:
    """What a file holds, read within limits unless it is a text of moderate size."""
    size = _readable_size(path)
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
        f"{path}: the format is not recognised; {', '.join((*TEXT, *BINARY))} can be read"
    )


def _readable_size(path: Path) -> int:
    check_name(path)
    for wrong, what in (
        (not path.exists(), "there is no such file"),
        (path.is_dir(), "this is a folder; a record is one file"),
        (not path.is_file(), "this is no regular file"),
    ):
        if wrong:
            raise RecordError(f"{path}: {what}")
    try:
        with open(path, "rb") as file:
            size = file.seek(0, os.SEEK_END)
    except OSError as error:
        raise RecordError(f"{path}: the file cannot be read ({error.strerror})") from None
    if size == 0:
        raise RecordError(f"{path}: the file is empty")
    return size


def _check_counts(
    content: Content, path: Path, accept: tuple[str, ...]
) -> dict[str, tuple[str, ...]]:
    """Judge what cannot be a record, and numbers of samples; what was accepted by trace id."""
    accepted: dict[str, tuple[str, ...]] = {}
    counts = zip(content.traces, content.announced, content.held, strict=True)
    for trace, announced, held in counts:
        delta = trace.stats.delta
        if held == 0:
            raise RecordError(f"{path}: channel {trace.id} holds no samples")
        if not (np.isfinite(delta) and delta > 0.0):
            raise RecordError(
                f"{path}: time step {delta} s of channel {trace.id} must be a positive number of "
                "seconds"
            )
        code = channel_code(trace) or trace.id
        contradicted = trace.stats.get("record", {}).get("doubts", ()) if held == announced else ()
        doubts = (
            *doubtful_count(code, announced, held),
            *(("header", f"channel {code}: {doubt}") for doubt in contradicted),
        )
        passed = accept_or_refuse(path, accept, doubts)
        if held < announced and trace is content.traces[-1] and _ends_in_a_number(content, path):
            trace.data = trace.data[:-1]
            passed += ("Last sample left out: the file ends in the middle of its line.",)
        if len(trace.data) < 2:
            raise RecordError(
                f"{path}: channel {trace.id} holds {len(trace.data)} sample(s) that can be used; "
                "2 or more are needed"
            )
        accepted[trace.id] = (*accepted.get(trace.id, ()), *passed)
    return accepted


def _ends_in_a_number(content: Content, path: Path) -> bool:
    """Whether a text breaks off within its last line, so that digits may be missing."""
    with open(path, "rb") as file:
        file.seek(-1, os.SEEK_END)
        return content.format in TEXT and not file.read(1).isspace()


def unequal_counts(content: Content) -> tuple[str, ...]:
    """The fault that channels of one record have different numbers of samples."""
    if len(set(content.held)) < 2:
        return ()
    counts = zip(content.traces, content.held)
    listed = ", ".join(f"{channel_code(trace)} {held}" for trace, held in counts)
    return (f"the channels of the file have unequal numbers of samples ({listed})",)


def joined(traces: list[Trace], path: Path) -> Stream:
    """Join what is only split; refuse holes."""
    stream = Stream(traces)
    if len({trace.id for trace in stream}) < len(stream):
        stream.merge(method=-1)
    gaps = stream.get_gaps()
    if gaps:
        network, station, location, channel, start, _, length, _ = gaps[0]
        kind = "a gap" if length > 0 else "an overlap"
        raise RecordError(
            f"{path}: channel {network}.{station}.{location}.{channel} has {kind} of "
            f"{abs(length):g} s after {start}; a record must be without gaps"
        )
    return stream


def _channel(
    trace: Trace, path: Path, options: Options, entry: IndexEntry | None, log: tuple[str, ...]
) -> Channel:
    stats = trace.stats
    record = stats.get("record", {})
    known = record.get("unit") not in (None, "", "counts") or stats.get("_format") == "KNET"
    stated = known or (entry is not None and entry.unit)
    table = None if stated else find_inventory(path, trace, options.inventory)
    if np.ma.isMaskedArray(trace.data):
        raise RecordError(f"{path}: channel {trace.id} has gaps; a record must be without gaps")
    bad = np.flatnonzero(~np.isfinite(trace.data))
    if bad.size:
        raise RecordError(
            f"{path}: channel {trace.id} has {bad.size} sample(s) that are not finite, the first "
            f"at index {bad[0]}"
        )
    calibrated = calibrate(trace, path, options.unit, entry, table)
    samples = calibrated.samples
    faults = (*record.get("faults", ()), *offset_fault(trace, calibrated.unit_in_file))
    steps = (*log, *record.get("log", ()), *calibrated.log)
    code = channel_code(trace)
    if record.get("sensor") == "borehole":
        steps = (*steps, f"Channel {code} is in the borehole, not at the surface.")
    family = code[:-1] if len(code) == 3 and code.isalnum() and not code.isdigit() else ""
    group = f"{stats.network}.{stats.station}.{stats.location}.{family}"
    if stats.get("_format") == "KNET":
        group = f"{stats.station}.{code[2:]}"
    channel = Channel(
        code, group, stats.starttime, float(stats.delta), samples, calibrated.unit_in_file, steps,
        (), faults, trace,
    )  # fmt: skip
    if channel.vertical and points_down(trace, table):
        steps = (*steps, f"Sign of {code} changed: it counts downwards.")
        channel = channel._replace(samples=-samples, log=steps)
    return channel


def offset_fault(trace: Trace, unit: str) -> tuple[str, ...]:
    """The fault that the mean of a record exceeds what is left without it."""
    values = np.asarray(trace.data, dtype=np.float64)
    mean = float(values.mean())
    motion = float(np.abs(values - mean).max())
    if not abs(mean) > motion > 0.0:
        return ()
    return (f"the offset of the samples, {mean:.4g}, is larger than their motion about it, "
            f"{motion:.4g} [{unit} in the file]",)  # fmt: skip


def by_direction(channels: Sequence[Channel], path: Path) -> tuple[list[Channel], list[Channel]]:
    """The horizontal channels, and those that are not known to be vertical; the vertical ones."""
    verticals = [c for c in channels if c.vertical]
    others = [c for c in channels if not c.vertical]
    if not others:
        raise RecordError(
            f"{path}: holds only the vertical component ({verticals[0].code}); a horizontal one "
            "is needed"
        )
    return others, verticals


def refuse_unclear(
    horizontals: Sequence[Channel], channels: Sequence[Channel], path: Path, remedy: str
) -> None:
    """Raise RecordError if one channel of several may be horizontal or not."""
    unclear = [c for c in horizontals if not c.horizontal]
    if unclear and len(channels) > 1:
        names = ", ".join(repr(c.code) for c in channels)
        raise RecordError(
            f"{path}: which of the channels {names} is horizontal is not clear from their "
            f"codes; {remedy}"
        )
