"""What a record file holds, channel by channel, with all that is wrong with it."""

from pathlib import Path
from typing import Any

from obspy import Inventory, Trace

from archfrag.motions.channels import Reading, examine
from archfrag.motions.formats.columns import Columns
from archfrag.motions.motion import Motion
from archfrag.motions.partners import channel_code, is_vertical
from archfrag.motions.plausible import doubtful_motion


def inspect_record(
    path: str | Path,
    unit: str | None = None,
    *,
    inventory: str | Path | Inventory | None = None,
    columns: Columns | None = None,
) -> dict[str, Any]:
    """What is in a record file and what is wrong with it; only an unreadable one is refused.

    `unit`, `inventory` and `columns` are as in `archfrag.motions.read.read_motion`.

    Returns
    -------
    dict
        ``file``, ``format``, ``event``, ``date``, ``magnitude``, ``faults`` of the file, and
        ``channels``, for each: ``code`` of the component, ``station``, ``start`` of the first
        sample (UTC, empty if unknown), ``dt`` [s], ``announced`` and held samples (``count``),
        ``unit`` in the file (empty if nothing states it), ``level`` (``raw``, ``processed`` or
        empty), ``vertical``, ``faults``, ``duration`` [s], ``PGA`` [m/s2] and ``motion``, a
        Motion; the last two are None where the unit is unknown.

    Raises
    ------
    RecordError
        If the file is missing, in no format that is read, or damaged.
    """
    traces, unequal, gap = examine(Path(path), Reading(unit, inventory, (), columns))
    stats = traces[0].stats
    record = stats.record
    return {
        "file": str(path), "format": stats._format,
        **{key: str(record.get(key, "")) for key in ("event", "date")},
        "magnitude": record.get("magnitude"), "channels": list(map(_channel, traces)),
        "faults": [*record.messages, *unequal, *filter(None, (gap,))],
    }  # fmt: skip


def _channel(trace: Trace) -> dict[str, Any]:
    stats, record = trace.stats, trace.stats.record
    unit, dt = record.unit_in_file, float(stats.delta)
    faults = [*(text for _, text in record.doubts), *record.faults]
    motion = None
    if unit:
        faults += [text for _, text in doubtful_motion(trace, trace.data)]
        motion = Motion(trace.data, dt) if record.held > 1 else None
    names = [str(stats[key]) for key in ("network", "station", "location") if stats[key]]
    return {
        "code": channel_code(trace), "station": str(record.get("station") or ".".join(names)),
        "start": str(stats.starttime) if stats.starttime.timestamp != 0.0 else "",
        "dt": dt, "announced": record.announced, "count": record.held, "unit": unit,
        "level": str(record.get("level") or ("raw" if unit == "counts" else "")),
        "vertical": is_vertical(trace), "faults": list(dict.fromkeys(faults)),
        "duration": (record.held - 1) * dt,
        "PGA": float(abs(trace.data).max()) if unit else None, "motion": motion,
    }  # fmt: skip
