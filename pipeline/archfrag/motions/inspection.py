"""What a record file holds, channel by channel, with all that is wrong with it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Inventory, Trace

from archfrag.errors import RecordError
from archfrag.motions.calibrate import Calibrated, calibrate, channel_code, find_inventory
from archfrag.motions.channels import file_content, joined, offset_fault, unequal_counts
from archfrag.motions.formats.columns import Columns
from archfrag.motions.index import IndexEntry, find_entry
from archfrag.motions.partners import VERTICAL
from archfrag.motions.plausible import doubtful_count, doubtful_motion


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel of a file.

    Attributes
    ----------
    code : str
        Component as the file names it.
    station : str
    start : str
        Time of the first sample (UTC) in ISO 8601; empty where the file does not state it.
    dt : float [s]
    announced, count : int
        Samples by the header and in the file.
    unit : str
        Of the samples in the file: of acceleration, ``counts``, or empty if nothing states it.
    level : str
        ``raw``, ``processed`` or empty: what kind of volume it is by its header.
    vertical : bool
    samples : numpy.ndarray, shape (count,) [m/s2], or None if the unit is unknown
    faults : tuple of str
        What is wrong or doubtful.
    """

    code: str
    station: str
    start: str
    dt: float
    announced: int
    count: int
    unit: str
    level: str
    vertical: bool
    samples: NDArray[np.float64] | None
    faults: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Inspection:
    """A file: its format, what its header states of the event, its channels and its faults."""

    path: Path
    format: str
    event: str
    date: str
    magnitude: float | None
    channels: tuple[Channel, ...]
    faults: tuple[str, ...]


def inspect_record(
    path: str | Path,
    unit: str | None = None,
    *,
    inventory: str | Path | Inventory | None = None,
    columns: Columns | None = None,
) -> Inspection:
    """What is in a record file and what is wrong with it; only an unreadable one is refused.

    Parameters
    ----------
    path : path
    unit : str, optional
        Of the samples, where the file does not state it.
    inventory : path or obspy.Inventory, optional
        StationXML of a record in counts.
    columns : Columns, optional
        Where the numbers of a plain text are.

    Returns
    -------
    Inspection

    Raises
    ------
    RecordError
        If the file is missing, in no format that is read, or damaged.

    Examples
    --------
    >>> from pathlib import Path
    >>> from archfrag.motions.inspection import inspect_record
    >>> lines = ["PEER", "Event, 1/1/1999, Station, 90", "ACCELERATION IN UNITS OF G"]
    >>> lines += ["NPTS=  5, DT=  .0100 SEC", " .1E+00 -.2E+00 .1E+00 .0E+00"]
    >>> _ = Path("short.AT2").write_text("\\n".join(lines) + "\\n")
    >>> inspect_record("short.AT2").channels[0].faults
    ('the header announces 5 samples of channel 90, the file holds only 4',)
    """
    source = Path(path)
    entry = find_entry(source)
    columns = columns or (entry.columns if entry else None)
    content = file_content(source, columns)
    faults = [*(() if columns else content.messages), *unequal_counts(content)]
    traces, announced = list(content.traces), list(content.announced)
    try:
        pieces = list(joined(list(content.traces), source))
        if len(pieces) < len(traces):
            traces, announced = pieces, [trace.stats.npts for trace in pieces]
    except RecordError as error:
        faults.append(_without(source, error))
    channels = tuple(
        _channel(trace, count, (source, unit, inventory, entry))
        for trace, count in zip(traces, announced, strict=True)
    )
    record = _record(traces[0])
    event, date = str(record.get("event", "")), str(record.get("date", ""))
    magnitude, found = record.get("magnitude"), tuple(dict.fromkeys(faults))
    return Inspection(source, content.format, event, date, magnitude, channels, found)


def _channel(
    trace: Trace, announced: int, how: tuple[Path, str | None, Any, IndexEntry | None]
) -> Channel:
    stats, record, code = trace.stats, _record(trace), channel_code(trace)
    data = np.ma.compressed(trace.data).astype(np.float64)
    faults = [fact for _, fact in doubtful_count(code or trace.id, announced, data.size)]
    calibrated, unit, samples = None, "", None
    if data.size == 0 or not np.isfinite(data).all():
        faults.append("there are no samples" if data.size == 0 else "not all samples are finite")
    else:
        calibrated, refused = _calibrated(trace, how)
        faults += [*offset_fault(trace, calibrated[1] if calibrated else "unit unknown"), *refused]
    if calibrated is not None:
        samples, unit, _ = calibrated
        faults += [fact for _, fact in doubtful_motion(code, samples, float(stats.delta), unit)]
    vertical = record.get("vertical")
    names = [str(stats[key]) for key in ("network", "station", "location") if stats[key]]
    return Channel(
        code=code,
        station=str(record.get("station") or ".".join(names)),
        start=str(stats.starttime) if stats.starttime.timestamp != 0.0 else "",
        dt=float(stats.delta), announced=announced, count=data.size, unit=unit,
        level=str(record.get("level") or ("raw" if unit == "counts" else "")),
        vertical=bool(VERTICAL.fullmatch(code)) if vertical is None else bool(vertical),
        samples=samples,
        faults=tuple(dict.fromkeys((*record.get("faults", ()), *faults))),
    )  # fmt: skip


def _calibrated(
    trace: Trace, how: tuple[Path, str | None, Any, IndexEntry | None]
) -> tuple[Calibrated | None, list[str]]:
    path, unit, inventory, entry = how
    try:
        return calibrate(trace, path, unit, entry, find_inventory(path, trace, inventory)), []
    except RecordError as error:
        return None, [_without(path, error)]


def _record(trace: Trace) -> Any:
    return trace.stats.get("record") or {}


def _without(path: Path, error: RecordError) -> str:
    return str(error).removeprefix(f"{path}: ")
