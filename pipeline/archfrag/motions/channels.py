"""The channels of a record file: read, judged, in m/s2, and sorted by direction.

A channel is an obspy Trace. Its ``stats.record`` has what the header states, ``announced`` and
``held`` numbers of samples, a ``log``, ``faults`` (contradictions) and ``warnings`` (for which it
is refused unless accepted); if ``unit_in_file`` is empty the samples are those of the file.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from obspy import Inventory, Stream, Trace

from archfrag.errors import RecordError
from archfrag.motions.calibrate import (
    Reading,
    Warned,
    accept_or_refuse,
    accepted_words,
    calibrate,
    check_file,
    implausible,
)
from archfrag.motions.formats import OWN, TEXT, read_traces
from archfrag.motions.formats.columns import Columns, read_columns
from archfrag.motions.index import IndexEntry, check_sha256, find_entry
from archfrag.motions.motion import Motion
from archfrag.motions.partners import channel_code, is_horizontal, is_vertical


def read_channels(path: Path, options: Reading) -> tuple[list[Trace], IndexEntry | None]:
    """Return the channels of a file in their order, and the row of an index that lists it."""
    accept = accepted_words(options.accept, str(path))
    entry = find_entry(path)
    if entry is not None and path.is_file():
        check_sha256(entry)
    channels, unequal, gap = _examine(path, options, entry)
    for channel in channels:
        record = channel.stats.record
        record.accept = (*accept, *(entry.accept if entry else ()))
        record.accepted = accept_or_refuse(path, record.accept, record.warnings)
        if channel.stats._format in OWN:  # pieces between gaps are unequal in those of networks
            record.faults = (*record.faults, *unequal)
        faults = (f"Fault: {fault}." for fault in record.faults)
        record.log = (*record.messages, *record.log, *faults)
    if gap:
        raise RecordError(f"{path}: {gap}")
    return channels, entry


def _examine(
    path: Path, options: Reading, entry: IndexEntry | None
) -> tuple[list[Trace], tuple[str, ...], str]:
    """Channels of a file whatever is wrong with it, its faults, and why it cannot be joined."""
    check_file(path)
    if columns := options.columns or (entry.columns if entry else None):
        traces = read_columns(path, columns)
    else:
        # AT2 by its name alone, so that a damaged header is judged by the reader that knows it.
        traces = read_traces(str(path), "AT2" if path.suffix.lower() == ".at2" else None)
    listed = ", ".join(f"{channel_code(trace)} {trace.stats.record.held}" for trace in traces)
    differ = len({trace.stats.record.held for trace in traces}) > 1
    fault = f"the channels of the file have unequal numbers of samples ({listed})"
    unequal = (fault,) if differ else ()
    warnings: dict[str, tuple[Warned, ...]] = {}
    for trace in traces:
        warnings[trace.id] = (*warnings.get(trace.id, ()), *_warnings(trace))
        record = trace.stats.record
        last = trace is traces[-1] and trace.stats._format in TEXT
        # If a text ends within its last line, digits may be missing.
        if last and record.held < record.announced and not path.read_bytes()[-1:].isspace():
            trace.data = trace.data[:-1]
            left = "the last sample is left out, since the file ends within its line"
            warnings[trace.id] = (*warnings[trace.id], ("samples", left))
    impossible = any(word is None for found in warnings.values() for word, _ in found)
    channels, gap = traces, ""
    if not impossible:
        stream = Stream(list(traces))
        if len({trace.id for trace in stream}) < len(stream):
            stream.merge(method=-1)
        for *codes, start, _, length, _ in stream.get_gaps()[:1]:
            kind = f"{'a gap' if length > 0 else 'an overlap'} of {abs(length):g} s after {start}"
            gap = f"channel {'.'.join(codes)} has {kind}; a record must be without gaps"
        channels = traces if gap else list(stream)
    for channel in channels:
        if len(channels) < len(traces):
            channel.stats.record.update(dict.fromkeys(("announced", "held"), channel.stats.npts))
        calibrate(channel, warnings[channel.id], path, options, entry)
    return channels, unequal, gap


def _warnings(trace: Trace) -> Iterator[Warned]:
    """What cannot be a record, or contradicts its header."""
    delta, code, record = trace.stats.delta, channel_code(trace) or trace.id, trace.stats.record
    announced, held = record.announced, record.held
    if not (np.isfinite(delta) and delta > 0.0):
        yield None, f"time step {delta} s of channel {trace.id} must be a positive number of s"
    if announced != held:
        only = "only " if held < announced else ""
        stated = f"the header announces {announced} samples of channel {code}"
        yield "samples", f"{stated}, the file holds {only}{held}"
    else:
        for warning in record.get("warnings", ()):
            yield "header", f"channel {code}: {warning}"
    if (count := min(held, len(trace.data))) < 2:
        yield None, f"channel {trace.id} holds {count} sample(s); 2 or more are needed"
    if np.ma.isMaskedArray(trace.data):
        yield None, f"channel {trace.id} has gaps; a record must be without gaps"
    bad = np.flatnonzero(~np.isfinite(trace.data))
    if bad.size:
        many = f"{bad.size} sample(s) that are not finite"
        yield None, f"channel {trace.id} has {many}, the first at index {bad[0]}"


def by_direction(
    channels: Sequence[Trace], path: Path, remedy: str
) -> tuple[list[Trace], list[Trace]]:
    """Return the channels that are not known to be vertical, and the vertical ones.

    RecordError if there are only verticals or, with a `remedy`, one may be horizontal or not.
    """
    verticals = [c for c in channels if is_vertical(c)]
    others = [c for c in channels if not is_vertical(c)]
    if not others:
        raise RecordError(f"{path}: holds only the vertical component; a horizontal one is needed")
    if remedy and len(channels) > 1 and not all(map(is_horizontal, others)):
        names = ", ".join(repr(channel_code(c)) for c in channels)
        raise RecordError(f"{path}: which of {names} is horizontal is not clear by code; {remedy}")
    return others, verticals


def inspect_record(
    path: str | Path,
    unit: str | None = None,
    *,
    inventory: str | Path | Inventory | None = None,
    columns: Columns | None = None,
) -> dict[str, Any]:
    """List what is in a record file and what is wrong with it; arguments are as in `read_motion`.

    Has ``file``, ``format``, ``event``, ``date``, ``magnitude``, ``faults`` and, for each of its
    ``channels``, ``code`` of the component, ``station``, ``start`` (UTC), ``dt`` [s], samples
    ``announced`` and held (``count``), ``unit`` in the file, ``level`` (``raw``, ``processed``),
    ``vertical``, ``faults``, ``duration`` [s], ``PGA`` [m/s2] and ``motion``. What is unknown is
    empty or None. RecordError if the file is missing, in no format that is read, or damaged.
    """
    options = Reading(unit, inventory, (), columns)
    traces, unequal, gap = _examine(Path(path), options, find_entry(path))
    channels, about = [], traces[0].stats.record
    for trace in traces:
        stats, record, dt = trace.stats, trace.stats.record, float(trace.stats.delta)
        unit = record.unit_in_file
        names = [str(stats[key]) for key in ("network", "station", "location") if stats[key]]
        faults = [*(text for _, text in record.warnings), *record.faults]
        faults += [text for _, text in implausible(trace)] if unit else []
        channels.append({
            "code": channel_code(trace), "station": str(record.get("station") or ".".join(names)),
            "start": str(stats.starttime) if stats.starttime.timestamp != 0.0 else "",
            "dt": dt, "announced": record.announced, "count": record.held, "unit": unit,
            "level": str(record.get("level") or ("raw" if unit == "counts" else "")),
            "vertical": is_vertical(trace), "faults": list(dict.fromkeys(faults)),
            "duration": (record.held - 1) * dt,
            "PGA": float(abs(trace.data).max()) if unit else None,
            "motion": Motion(trace.data, dt) if unit and record.held > 1 else None,
        })  # fmt: skip
    return {
        "file": str(path), "format": traces[0].stats._format,
        **{key: str(about.get(key, "")) for key in ("event", "date")},
        "magnitude": about.get("magnitude"), "channels": channels,
        "faults": [*about.messages, *unequal, *filter(None, (gap,))],
    }  # fmt: skip
