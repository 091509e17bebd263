"""What a record file holds, channel by channel, with all that is wrong with it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from obspy import Inventory

from archfrag.motions import channels
from archfrag.motions.formats.columns import Columns
from archfrag.motions.plausible import doubtful_motion


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel of a file; without `samples` [m/s2] where its unit is unknown."""

    code: str  # of the component as the file names it
    station: str
    start: str  # time of the first sample (UTC) in ISO 8601; empty if the file does not state it
    dt: float  # [s]
    announced: int  # samples by the header
    count: int  # samples in the file
    unit: str  # in the file: of acceleration, ``counts``, or empty if nothing states it
    level: str  # ``raw``, ``processed`` or empty: what kind of volume it is by its header
    vertical: bool
    samples: NDArray[np.float64] | None
    faults: tuple[str, ...]  # what is wrong or doubtful


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
    found = channels.examine(Path(path), channels.Options(unit, inventory, (), columns))
    record = found.channels[0].record
    messages = () if found.format == "COLUMNS" else found.messages
    return Inspection(
        Path(path), found.format, str(record.get("event", "")), str(record.get("date", "")),
        record.get("magnitude"), tuple(map(_channel, found.channels)),
        (*messages, *found.unequal, *filter(None, (found.gap,))),
    )  # fmt: skip


def _channel(found: channels.Channel) -> Channel:
    stats, unit = found.trace.stats, found.unit_in_file
    known = found.samples.size > 0
    faults = [*(text for _, text in found.doubts), *found.faults]
    if known:
        doubts = doubtful_motion(found.code, found.samples, found.dt, unit)
        faults += [text for _, text in doubts]
    names = [str(stats[key]) for key in ("network", "station", "location") if stats[key]]
    return Channel(
        code=found.code,
        station=str(found.record.get("station") or ".".join(names)),
        start=str(found.start) if found.start.timestamp != 0.0 else "",
        dt=found.dt, announced=found.announced, count=found.held, unit=unit,
        level=str(found.record.get("level") or ("raw" if unit == "counts" else "")),
        vertical=found.vertical, samples=found.samples if known else None,
        faults=tuple(dict.fromkeys(faults)),
    )  # fmt: skip
