"""Records of ground motion from files: every waveform format of obspy, and PEER AT2."""

import glob
import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import obspy
from numpy.typing import NDArray
from obspy import Inventory, Stream, Trace, UTCDateTime

from archfrag.errors import RecordError
from archfrag.motions.calibrate import calibrate, channel_code, find_inventory, points_down
from archfrag.motions.index import IndexEntry, check_sha256, find_entry
from archfrag.motions.motion import Motion

_VERTICAL = re.compile(r"[-+]?(U|V|Z|UD\d?|UP|DWN|DOWN|VERT|VERTICAL|..Z)", re.IGNORECASE)
_HORIZONTAL = re.compile(
    r"(EW|NS)\d?|[ENXYRTHL]\d?|[NS]\d+(\.\d+)?[EW]|\d{1,3}|..[ENXYRT12]", re.IGNORECASE
)


class _Channel(NamedTuple):
    code: str
    group: str
    start: UTCDateTime
    dt: float
    samples: NDArray[np.float64]
    unit_in_file: str
    log: tuple[str, ...]
    trace: Trace


def read_motion(
    path: str | Path,
    unit: str | None = None,
    component: str | None = None,
    *,
    vertical: str | Path | None = None,
    inventory: str | Path | Inventory | None = None,
) -> Motion:
    """Read one horizontal component of a record, and the vertical where there is one.

    Parameters
    ----------
    path : path
        A file in any waveform format of obspy, or in PEER's AT2.
    unit : str, optional
        Unit of the samples: ``m/s2``, ``cm/s2``, ``gal``, ``mm/s2`` or ``g``. Only for files
        that do not say it themselves; it is never guessed.
    component : str, optional
        Channel code (``HNE``), its last letter (``E``) or trace id of the horizontal wanted.
        Without it the first horizontal of the file is taken, and the log says which.
    vertical : path, optional
        File of the vertical component where it is not in the same file.
    inventory : path or obspy.Inventory, optional
        StationXML of a record in counts; by default NAME.xml or NET.STA.xml beside the file.

    Returns
    -------
    Motion
        In m/s2; every step from the file to it is in its log.

    Raises
    ------
    RecordError
        With the file and what is wrong: missing, empty, truncated, not finite, with gaps,
        unknown format or unit, no positive time step, or no such horizontal component.

    Examples
    --------
    >>> from pathlib import Path
    >>> import archfrag as af
    >>> lines = ["PEER", "Event, 1/1/1999, Station, 90", "ACCELERATION IN UNITS OF G"]
    >>> lines += ["NPTS=  4, DT=  .0100 SEC", " .1E+00 -.2E+00 .1E+00 .0E+00"]
    >>> _ = Path("example.AT2").write_text("\\n".join(lines) + "\\n")
    >>> motion = af.read_motion("example.AT2")
    >>> float(round(abs(motion.acceleration).max(), 4)), motion.dt
    (1.9613, 0.01)
    """
    source = Path(path)
    channels, entry = _channels(source, unit, inventory)
    horizontals, verticals = _sorted_by_direction(channels, source, component)
    chosen, note = _choose(horizontals, source, component)
    upward = next((c for c in verticals if c.group == chosen.group), None)
    if vertical is not None:
        upward = _vertical_from(Path(vertical), unit, inventory)
    name = entry.id if entry else _identifier(source, chosen, alone=True)
    return _motion(source, chosen, upward, name, entry, note)


def read_motions(
    path: str | Path,
    unit: str | None = None,
    *,
    inventory: str | Path | Inventory | None = None,
) -> list[Motion]:
    """Read every horizontal component of a file, each with the vertical of its instrument.

    Parameters and errors are those of `read_motion`.
    """
    source = Path(path)
    channels, entry = _channels(source, unit, inventory)
    horizontals, verticals = _sorted_by_direction(channels, source, None)
    motions = []
    for channel in horizontals:
        upward = next((c for c in verticals if c.group == channel.group), None)
        alone = len(horizontals) == 1
        name = entry.id if entry and alone else _identifier(source, channel, alone)
        motions.append(_motion(source, channel, upward, name, entry, ()))
    return motions


def load_motion(entry: IndexEntry) -> Motion:
    """Read the record of a row, once its sha256, unit and time step are found as stated.

    Raises
    ------
    RecordError
        If the file is missing, has changed since it was listed, or has another time step.
    """
    check_sha256(entry)
    motion = read_motion(entry.path, unit=entry.unit)
    step = entry.metadata.get("dt_s")
    if step is not None and not np.isclose(step, motion.dt, rtol=1e-6, atol=0.0):
        raise RecordError(
            f"{entry.path}: the index lists dt_s = {step} s, the file has {motion.dt} s"
        )
    merged = {**motion.metadata, **_given(entry.metadata)}
    return Motion(motion.acceleration, motion.dt, motion.vertical, entry.id, merged, motion.log)


def _channels(
    path: Path, unit: str | None, inventory: Any
) -> tuple[list[_Channel], IndexEntry | None]:
    entry = find_entry(path)
    if entry is not None and path.is_file():
        check_sha256(entry)
    stream, log = _read_stream(path)
    return [_channel(trace, path, unit, entry, inventory, log) for trace in stream], entry


def _read_stream(path: Path) -> tuple[Stream, tuple[str, ...]]:
    if not path.exists():
        raise RecordError(f"{path}: there is no such file")
    if path.is_dir():
        raise RecordError(f"{path}: this is a folder; a record is one file")
    if path.stat().st_size == 0:
        raise RecordError(f"{path}: the file is empty")
    wanted = "AT2" if path.suffix.lower() == ".at2" else None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            stream = obspy.read(glob.escape(str(path)), format=wanted)
        except RecordError:
            raise
        except TypeError as error:
            if "Unknown format" not in str(error):
                raise RecordError(_unreadable(path, error)) from None
            raise RecordError(
                f"{path}: the format is not recognised; obspy's waveform formats and PEER AT2 "
                "can be read"
            ) from None
        except Exception as error:
            raise RecordError(_unreadable(path, error)) from None
    messages = [w for w in caught if not issubclass(w.category, DeprecationWarning)]
    for message in messages:
        if "MSEED" in message.category.__name__:
            raise RecordError(f"{path}: damaged or truncated miniSEED ({message.message})")
    _check_complete(stream, path)
    log = tuple(dict.fromkeys(f"obspy: {' '.join(str(m.message).split())}" for m in messages))
    return stream, log


def _unreadable(path: Path, error: Exception) -> str:
    lines = str(error).strip().splitlines()
    reason = lines[0] if lines else type(error).__name__
    if reason.startswith("Cannot open file"):  # what obspy says of a file without whole records
        reason = "no trace could be read from it"
    return f"{path}: the file is damaged, truncated or not what it seems ({reason})"


def _check_complete(stream: Stream, path: Path) -> None:
    """Refuse what was cut off or has holes, and join what is only split."""
    for trace in stream:
        blocks = trace.stats.get("mseed", {})
        length = blocks.get("record_length")
        if length and blocks.get("filesize", 0) % length:
            raise RecordError(
                f"{path}: truncated miniSEED: {blocks.filesize} bytes are not a whole number of "
                f"records of {length} bytes"
            )
        details = trace.stats.get("knet", {})
        announced = round(details.get("duration", 0.0) * trace.stats.sampling_rate)
        if announced and trace.stats.npts != announced:
            raise RecordError(
                f"{path}: the header announces {announced} samples, the file holds "
                f"{trace.stats.npts}"
            )
        if trace.stats.npts == 0:
            raise RecordError(f"{path}: channel {trace.id} holds no samples")
        delta = trace.stats.delta
        if not (np.isfinite(delta) and delta > 0.0):
            raise RecordError(
                f"{path}: time step {delta} s of channel {trace.id} must be a positive number of "
                "seconds"
            )
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


def _channel(
    trace: Trace, path: Path, unit: str | None, entry: IndexEntry | None, inventory: Any,
    log: tuple[str, ...],
) -> _Channel:  # fmt: skip
    stats = trace.stats
    stated = stats.get("at2") or entry is not None or stats.get("_format") == "KNET"
    table = None if stated else find_inventory(path, trace, inventory)
    if np.ma.isMaskedArray(trace.data):
        raise RecordError(f"{path}: channel {trace.id} has gaps; a record must be without gaps")
    bad = np.flatnonzero(~np.isfinite(trace.data))
    if bad.size:
        raise RecordError(
            f"{path}: channel {trace.id} has {bad.size} sample(s) that are not finite, the first "
            f"at index {bad[0]}"
        )
    calibrated = calibrate(trace, path, unit, entry, table)
    samples, steps = calibrated.samples, (*log, *calibrated.log)
    code = channel_code(trace)
    if _VERTICAL.fullmatch(code) and points_down(trace, table):
        samples, steps = -samples, (*steps, f"Sign of {code} changed: it counts downwards.")
    family = code[:-1] if len(code) == 3 and not code.isdigit() else ""
    group = f"{stats.network}.{stats.station}.{stats.location}.{family}"
    if stats.get("_format") == "KNET":
        group = f"{stats.station}.{code[2:]}"
    return _Channel(
        code, group, stats.starttime, float(stats.delta), samples, calibrated.unit_in_file, steps,
        trace,
    )  # fmt: skip


def _sorted_by_direction(
    channels: Sequence[_Channel], path: Path, component: str | None
) -> tuple[list[_Channel], list[_Channel]]:
    verticals = [c for c in channels if _VERTICAL.fullmatch(c.code)]
    others = [c for c in channels if not _VERTICAL.fullmatch(c.code)]
    if not others:
        raise RecordError(
            f"{path}: holds only the vertical component ({verticals[0].code}); a horizontal one "
            "is needed"
        )
    unclear = [c for c in others if not _HORIZONTAL.fullmatch(c.code)]
    if unclear and len(channels) > 1 and component is None:
        names = ", ".join(repr(c.code) for c in channels)
        raise RecordError(
            f"{path}: which of the channels {names} is horizontal cannot be told from their "
            "codes; give component="
        )
    return others, verticals


def _choose(
    horizontals: Sequence[_Channel], path: Path, component: str | None
) -> tuple[_Channel, tuple[str, ...]]:
    names = ", ".join(c.code or "(no code)" for c in horizontals)
    if component is not None:
        wanted = component.upper()
        for match in (lambda c: c.trace.id, lambda c: c.code, lambda c: c.code[-1:]):
            found = [c for c in horizontals if match(c).upper() == wanted]
            if found:
                return found[0], ()
        raise RecordError(
            f"{path}: there is no horizontal component {component!r}; there is {names}"
        )
    chosen = horizontals[0]
    if len(horizontals) > 1:
        return chosen, (f"Horizontal {chosen.code} taken, the first of {names}.",)
    if not _HORIZONTAL.fullmatch(chosen.code):
        return chosen, (f"Channel code {chosen.code!r} taken to be horizontal: the only one.",)
    return chosen, ()


def _vertical_from(path: Path, unit: str | None, inventory: Any) -> _Channel:
    channels, _ = _channels(path, unit, inventory)
    verticals = [c for c in channels if _VERTICAL.fullmatch(c.code)]
    if len(verticals) == 1:
        return verticals[0]
    if len(channels) == 1 and not _HORIZONTAL.fullmatch(channels[0].code):
        return channels[0]
    names = ", ".join(repr(c.code) for c in channels)
    raise RecordError(f"{path}: one vertical channel is needed, the file holds {names}")


def _identifier(path: Path, channel: _Channel, alone: bool) -> str:
    # The files of a K-NET record differ in their endings only.
    name = path.name if channel.trace.stats.get("_format") == "KNET" else path.stem
    return name if alone else f"{name}:{channel.code}"


def _motion(
    path: Path, channel: _Channel, upward: _Channel | None, name: str, entry: IndexEntry | None,
    note: tuple[str, ...],
) -> Motion:  # fmt: skip
    stats = channel.trace.stats
    log: tuple[str, ...] = (f"Read from {path.name} ({stats.get('_format', '')}).", *note)
    log = (*log, *channel.log)
    horizontal, vertical = channel.samples, None
    if upward is not None:
        horizontal, vertical, cut = _aligned(channel, upward, path)
        log = (*log, *(f"Vertical {upward.code}: {step}" for step in upward.log), *cut)
    details = stats.get("at2", {})
    metadata = {
        "file": path.name,
        "format": stats.get("_format", ""),
        "unit_in_file": channel.unit_in_file,
        "event": details.get("event", ""),
        "date": details.get("date", ""),
        "station": details.get("station", stats.station),
        "component": channel.code,
        "vertical_component": upward.code if upward else "",
    }
    if stats.starttime.timestamp != 0.0:
        metadata["start_time"] = str(channel.start)
    if entry is not None:
        listed = {key: value for key, value in entry.metadata.items() if value not in (None, "")}
        metadata.update(listed)
    return Motion(horizontal, channel.dt, vertical, name, metadata, log)


def _aligned(
    channel: _Channel, upward: _Channel, path: Path
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[str, ...]]:
    if not np.isclose(channel.dt, upward.dt, rtol=1e-6, atol=0.0):
        raise RecordError(
            f"{path}: time step of {channel.code} is {channel.dt:g} s and of the vertical "
            f"{upward.code} {upward.dt:g} s; they must be equal"
        )
    later = round((upward.start - channel.start) / channel.dt)
    first, first_upward = max(0, later), max(0, -later)
    count = min(channel.samples.size - first, upward.samples.size - first_upward)
    if count < 2:
        raise RecordError(
            f"{path}: {channel.code} and the vertical {upward.code} have no time in common"
        )
    log: tuple[str, ...] = ()
    if count < max(channel.samples.size, upward.samples.size):
        log = (
            f"Cut to the {count} samples common to {channel.code} ({channel.samples.size}) and "
            f"{upward.code} ({upward.samples.size}).",
        )
    return (
        channel.samples[first : first + count],
        upward.samples[first_upward : first_upward + count],
        log,
    )


def _given(metadata: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in metadata.items() if value not in (None, "")}
