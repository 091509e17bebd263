"""Records of ground motion from files: waveform formats that obspy reads, and PEER AT2."""

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from obspy import Inventory, Stream, Trace, UTCDateTime

from archfrag.errors import RecordError
from archfrag.motions.calibrate import calibrate, channel_code, find_inventory, points_down
from archfrag.motions.formats.waveform import (
    BINARY,
    TEXT,
    Content,
    Unreadable,
    archive_kind,
    read_as,
    recognise,
)
from archfrag.motions.index import IndexEntry, check_sha256, find_entry
from archfrag.motions.isolated import Reader
from archfrag.motions.motion import Motion
from archfrag.motions.plausible import (
    accept_or_refuse,
    accepted_words,
    check_name,
    doubtful_count,
    doubtful_motion,
)

_VERTICAL = re.compile(r"[-+]?(U|V|Z|UD\d?|UP|DWN|DOWN|VERT|VERTICAL|..Z)", re.IGNORECASE)
_HORIZONTAL = re.compile(
    r"(EW|NS)\d?|[ENXYRTHL]\d?|[NS]\d+(\.\d+)?[EW]|\d{1,3}|..[ENXYRT12]", re.IGNORECASE
)
_LARGE = 16 * 2**20  # [bytes] from which a text is read within limits, too
_reader = Reader()


class _Options(NamedTuple):
    """What the user said of a file."""

    unit: str | None
    inventory: str | Path | Inventory | None
    accept: tuple[str, ...]


class _Channel(NamedTuple):
    code: str
    group: str
    start: UTCDateTime
    dt: float
    samples: NDArray[np.float64]
    unit_in_file: str
    log: tuple[str, ...]
    accepted: tuple[str, ...]
    trace: Trace


def read_motion(
    path: str | Path,
    unit: str | None = None,
    component: str | None = None,
    *,
    vertical: str | Path | None = None,
    inventory: str | Path | Inventory | None = None,
    accept: Iterable[str] = (),
) -> Motion:
    """Read one horizontal component of a record, and the vertical where there is one.

    Parameters
    ----------
    path : path
        A file in PEER's AT2, K-NET, SLIST, TSPAIR, miniSEED, SAC (binary or text), GSE1, GSE2,
        SEISAN, Kinemetrics EVT, GCF or RefTek 130; never an archive or a pickle.
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
    accept : sequence of str
        What to let pass though it is hardly right: ``pga`` (peak outside 1e-5 to 5 g),
        ``time_step`` (outside 1e-4 to 0.1 s), ``samples`` (another number than the header
        announces). An ``index.csv`` that lists the file may say it in a column ``accept``.

    Returns
    -------
    Motion
        In m/s2; every step from the file to it is in its log, and what was accepted also under
        ``accepted`` in its metadata.

    Raises
    ------
    RecordError
        With the file and what is wrong: missing, empty, truncated, not finite, with gaps,
        unknown format or unit, not plausible and not accepted, or no such horizontal component.

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
    options = _Options(unit, inventory, accepted_words(accept, str(path)))
    return _read_one(Path(path), options, component, vertical)


def _read_one(
    source: Path, options: _Options, component: str | None, vertical: str | Path | None = None,
    of_several: str | None = None,
) -> Motion:  # fmt: skip
    """See `read_motion`; `of_several` names the component in a file with several horizontals."""
    channels, entry = _channels(source, options)
    horizontals, verticals = _sorted_by_direction(channels, source)
    if of_several and len(horizontals) > 1:
        component = of_several
    if component is None:
        remedy = "give `component` (--component on the command line)"
        _refuse_unclear(horizontals, channels, source, remedy)
    chosen, note = _choose(horizontals, source, component)
    upward = next((c for c in verticals if c.group == chosen.group), None)
    if vertical is not None:
        upward = _vertical_from(Path(vertical), options)
    name = entry.id if entry else record_name(source)
    motion = _motion(source, chosen, upward, name, entry, options.accept)
    return replace(motion, log=(motion.log[0], *note, *motion.log[1:]))


def read_motions(
    path: str | Path,
    unit: str | None = None,
    *,
    inventory: str | Path | Inventory | None = None,
    accept: Iterable[str] = (),
    name: str | None = None,
) -> list[Motion]:
    """Read every horizontal component of a file, each with the vertical of its instrument.

    Parameters and errors are those of `read_motion`; ids begin with `name` if that is given,
    with the file's name if not.
    """
    source = Path(path)
    options = _Options(unit, inventory, accepted_words(accept, str(path)))
    channels, entry = _channels(source, options)
    horizontals, verticals = _sorted_by_direction(channels, source)
    remedy = "name them as SEED does (HNE, HNN, HNZ), or give each component a file of its own"
    _refuse_unclear(horizontals, channels, source, remedy)
    alone = len(horizontals) == 1
    base = entry.id if entry and alone else name or record_name(source)
    motions = []
    for channel in horizontals:
        upward = next((c for c in verticals if c.group == channel.group), None)
        id = base if alone else f"{base}:{channel.code}"
        motions.append(_motion(source, channel, upward, id, entry, options.accept))
    return motions


def record_name(path: Path) -> str:
    """What the id of a record is made of: the name of its file, without what only says the format.

    The files of a K-NET record differ in their endings only, which are kept.
    """
    return path.name if recognise(str(path), ("KNET",)) else path.stem


def load_motion(entry: IndexEntry) -> Motion:
    """Read the record of a row, once its sha256, unit and time step are found as stated.

    Raises
    ------
    RecordError
        If the file is missing, has changed since it was listed, or has another time step.
    """
    check_sha256(entry)
    options = _Options(entry.unit or None, None, entry.accept)
    motion = _read_one(entry.path, options, None, of_several=entry.metadata.get("component"))
    step = entry.metadata.get("dt_s")
    if step is not None and not np.isclose(step, motion.dt, rtol=1e-6, atol=0.0):
        raise RecordError(
            f"{entry.path}: the index lists dt_s = {step} s, the file has {motion.dt} s"
        )
    merged = {**motion.metadata, **_given(entry.metadata)}
    return Motion(motion.acceleration, motion.dt, motion.vertical, entry.id, merged, motion.log)


def _channels(path: Path, options: _Options) -> tuple[list[_Channel], IndexEntry | None]:
    entry = find_entry(path)
    if entry is not None:
        options = options._replace(accept=(*options.accept, *entry.accept))
        if path.is_file():
            check_sha256(entry)
    content = _content(path)
    accepted = _check_counts(content, path, options.accept)
    stream = _joined(content.traces, path)
    return [
        _channel(trace, path, options, entry, content.messages, accepted.get(trace.id, ()))
        for trace in stream
    ], entry


def _content(path: Path) -> Content:
    """What a file holds, read within limits unless it is a text of moderate size."""
    size = _readable_size(path)
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
    if not path.exists():
        raise RecordError(f"{path}: there is no such file")
    if path.is_dir():
        raise RecordError(f"{path}: this is a folder; a record is one file")
    if not path.is_file():
        raise RecordError(f"{path}: this is no regular file")
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
    """Judge what cannot be a record, and numbers of samples; sentences for each trace id."""
    accepted: dict[str, tuple[str, ...]] = {}
    for trace, announced in zip(content.traces, content.announced, strict=True):
        held, delta = trace.stats.npts, trace.stats.delta
        if held == 0:
            raise RecordError(f"{path}: channel {trace.id} holds no samples")
        if not (np.isfinite(delta) and delta > 0.0):
            raise RecordError(
                f"{path}: time step {delta} s of channel {trace.id} must be a positive number of "
                "seconds"
            )
        doubts = doubtful_count(channel_code(trace) or trace.id, announced, held)
        sentences = accept_or_refuse(path, accept, doubts)
        if held < announced and trace is content.traces[-1] and _ends_in_a_number(content, path):
            trace.data = trace.data[:-1]
            sentences += ("Last sample left out: the file ends in the middle of its line.",)
        accepted[trace.id] = (*accepted.get(trace.id, ()), *sentences)
    return accepted


def _ends_in_a_number(content: Content, path: Path) -> bool:
    """Whether a text breaks off within its last line, so that digits may be missing."""
    with open(path, "rb") as file:
        file.seek(-1, os.SEEK_END)
        return content.format in TEXT and not file.read(1).isspace()


def _joined(traces: list[Trace], path: Path) -> Stream:
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
    trace: Trace, path: Path, options: _Options, entry: IndexEntry | None, log: tuple[str, ...],
    accepted: tuple[str, ...],
) -> _Channel:  # fmt: skip
    stats = trace.stats
    listed = entry is not None and entry.unit
    stated = stats.get("at2") or listed or stats.get("_format") == "KNET"
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
        accepted, trace,
    )  # fmt: skip


def _sorted_by_direction(
    channels: Sequence[_Channel], path: Path
) -> tuple[list[_Channel], list[_Channel]]:
    verticals = [c for c in channels if _VERTICAL.fullmatch(c.code)]
    others = [c for c in channels if not _VERTICAL.fullmatch(c.code)]
    if not others:
        raise RecordError(
            f"{path}: holds only the vertical component ({verticals[0].code}); a horizontal one "
            "is needed"
        )
    return others, verticals


def _refuse_unclear(
    horizontals: Sequence[_Channel], channels: Sequence[_Channel], path: Path, remedy: str
) -> None:
    unclear = [c for c in horizontals if not _HORIZONTAL.fullmatch(c.code)]
    if unclear and len(channels) > 1:
        names = ", ".join(repr(c.code) for c in channels)
        raise RecordError(
            f"{path}: which of the channels {names} is horizontal cannot be told from their "
            f"codes; {remedy}"
        )


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


def _vertical_from(path: Path, options: _Options) -> _Channel:
    channels, _ = _channels(path, options)
    verticals = [c for c in channels if _VERTICAL.fullmatch(c.code)]
    if len(verticals) == 1:
        return verticals[0]
    if len(channels) == 1 and not _HORIZONTAL.fullmatch(channels[0].code):
        return channels[0]
    names = ", ".join(repr(c.code) for c in channels)
    raise RecordError(f"{path}: one vertical channel is needed, the file holds {names}")


def _motion(
    path: Path, channel: _Channel, upward: _Channel | None, name: str, entry: IndexEntry | None,
    accept: tuple[str, ...],
) -> Motion:  # fmt: skip
    stats = channel.trace.stats
    log: tuple[str, ...] = (f"Read from {path.name} ({stats.get('_format', '')}).", *channel.log)
    horizontal, vertical = channel.samples, None
    if upward is not None:
        horizontal, vertical, cut = _aligned(channel, upward, path)
        log = (*log, *(f"Vertical {upward.code}: {step}" for step in upward.log), *cut)
    accept = (*accept, *(entry.accept if entry else ()))
    accepted = channel.accepted + accept_or_refuse(
        path, accept, doubtful_motion(channel.code, horizontal, channel.dt, channel.unit_in_file)
    )
    if upward is not None and vertical is not None:
        doubts = doubtful_motion(upward.code, vertical, upward.dt, upward.unit_in_file)
        accepted += upward.accepted + accept_or_refuse(path, accept, doubts)
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
    if accepted:
        metadata["accepted"] = list(accepted)
    return Motion(horizontal, channel.dt, vertical, name, metadata, log + accepted)


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
