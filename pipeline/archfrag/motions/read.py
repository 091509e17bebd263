"""Records of ground motion from files: waveform formats that obspy reads, and our plug-ins."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from obspy import Inventory, Stream, Trace

from archfrag.errors import RecordError
from archfrag.files import Named, opened
from archfrag.motions import calibrate
from archfrag.motions.channel import (
    Channel,
    Facts,
    choose_horizontal,
    split_by_direction,
)
from archfrag.motions.formats import OWN, TEXT, read_traces, recognise
from archfrag.motions.formats.columns import Columns, read_columns
from archfrag.motions.index import IndexEntry, check_sha256, find_entry
from archfrag.motions.measures import peak_of, sample_cautions
from archfrag.motions.motion import Motion, motion_of_channel, with_component

LARGEST_RECORD = 2**27  # [bytes]


def check_file(path: Path) -> None:
    """Raise RecordError if a path cannot be read as a record: a folder, a pipe, an empty file."""
    try:
        str(path).encode()
        with opened(path) as file:
            size = os.fstat(file.fileno()).st_size
    except UnicodeEncodeError:
        shown = os.fsencode(path).decode("utf-8", "backslashreplace")
        raise RecordError(
            f"{shown}: the name of the file is not in UTF-8; rename it"
        ) from None
    except FileNotFoundError:
        raise RecordError(f"{path}: there is no such file") from None
    except OSError as error:
        raise RecordError(
            f"{path}: the file cannot be read: {error.strerror}"
        ) from None
    if not size:
        raise RecordError(f"{path}: the file is empty")
    if size > LARGEST_RECORD:
        raise RecordError(
            f"{path}: the file has {size} bytes; a record may have at most {LARGEST_RECORD}"
        )


def read_motion(
    path: str | Path,
    unit: str | None = None,
    component: str | None = None,
    *,
    vertical: str | Path | None = None,
    inventory: str | Path | Inventory | None = None,
    accept: Iterable[str] = (),
    columns: Columns | None = None,
) -> Motion:
    """Read one horizontal component of a record, and the vertical if there is one.

    Parameters
    ----------
    path : path
        A file in PEER's AT2, COSMOS V0 to V2, CSMIP (DMG) volume 1 or 2, SMC, ESM's and ITACA's
        DYNA, GeoNet's V1A and V2A, RESORCE, K-NET, KiK-net, SLIST, TSPAIR, miniSEED, SAC, GSE1,
        GSE2, SEISAN, Kinemetrics EVT, GCF or RefTek 130; never an archive or a pickle. The mean
        of counts and uncorrected volumes is removed.
    unit : str, optional
        Of the samples (``m/s2``, ``cm/s2``, ``gal``, ``mm/s2`` or ``g``) if the file states none.
    component : str, optional
        Channel code (such as HNE), its last letter (``E``) or trace id; else the first horizontal.
    vertical : path, optional
        File of the vertical component if it is not in the same file.
    inventory : path or obspy.Inventory, optional
        StationXML of a record in counts; by default NAME.xml or NET.STA.xml beside the file.
    accept : sequence of str
        What to let pass: ``pga`` (1e-5 to 5 g), ``time_step`` (1e-4 to 0.1 s), ``samples`` (other
        than announced), ``header`` (contradicts peak, unit or code), ``sensor`` (not on ground).
    columns : Columns, optional
        Where the numbers are in a plain text whose header is not known.

    Returns
    -------
    Motion
        In m/s2. Its log has every step from the file to it, its metadata what the header states,
        what was ``accepted``, and ``errors`` and ``cautions`` on the file.

    Raises
    ------
    RecordError
        With the file and what is wrong, unless that is accepted.

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
    options: Any = {
        "unit": unit,
        "inventory": inventory,
        "accept": accept,
        "columns": columns,
    }
    motion = _read_one(Path(path), options, component, own_vertical=vertical is None)
    if vertical is None:
        return motion
    return with_component(motion, read_vertical(vertical, **options), "vertical")


def _read_one(
    path: Path,
    options: Named,
    component: str | None,
    listed: str | None = None,
    own_vertical: bool = True,
) -> Motion:
    """Read a file as `read_motion` does, by `options` of reading.

    `listed` is the component that an index names; it counts if no `component` is given. Unless
    `own_vertical`, the vertical of the file is left out.
    """
    channels, entry = read_channels(path, **options)
    chosen, verticals = choose_horizontal(channels, path, component, listed)
    if not own_vertical:
        verticals = []
    name = entry.id or record_name(path)
    return motion_of_channel(chosen, path, name, verticals, entry.metadata)


def read_horizontals(
    path: str | Path,
    unit: str | None = None,
    *,
    name: str | None = None,
    **options,
) -> list[Motion]:
    """Read each horizontal of a file with its vertical, as `read_motion` does.

    `name` begins the ids of the motions; without it, the name of the file does. The id of a single
    horizontal is that in an index if one lists the file.
    """
    path = Path(path)
    channels, entry = read_channels(path, unit, **options)
    horizontals, verticals = split_by_direction(channels, path)
    codes = [channel.code for channel in horizontals]
    base = name or record_name(path)
    if not codes[1:]:
        base = entry.id or base
    motions = []
    for channel, code in zip(horizontals, codes):
        place = f"{channel.trace.stats.location}." * (codes.count(code) > 1)
        id = f"{base}:{place}{code}" if codes[1:] else base
        motions.append(motion_of_channel(channel, path, id, verticals, entry.metadata))
    return motions


def read_vertical(path: str | Path, unit: str | None = None, **options) -> Motion:
    """Read the vertical of a file as the horizontal of a motion; options as in `read_motion`."""
    path = Path(path)
    channels, _ = read_channels(path, unit, **options)
    verticals = [channel for channel in channels if channel.is_vertical]
    if not channels[1:] and not channels[0].is_horizontal:
        verticals = channels
    if len(verticals) != 1:
        raise RecordError(
            f"{path}: one vertical channel is needed, the file holds "
            f"{', '.join(repr(channel.code) for channel in channels)}"
        )
    return motion_of_channel(verticals[0], path, record_name(path))


def record_name(path: Path) -> str:
    """Return the base of a record's id: the name of its file, without the ending unless K-NET."""
    return path.name if recognise(str(path), ("KNET",)) else path.stem


def load_motion(entry: IndexEntry) -> Motion:
    """Read the record of a row of an index; RecordError if it is not as the row states."""
    check_sha256(entry)
    component = entry.metadata.get("component")
    motion = _read_one(entry.path, entry.options, None, component)
    step = entry.metadata.get("dt_s")
    if step is not None and not np.isclose(step, motion.dt, rtol=1e-6, atol=0.0):
        raise RecordError(
            f"{entry.path}: dt is {motion.dt} s, the index lists dt_s = {step} s"
        )
    facts = Facts.of({**motion.metadata, **Facts.of(entry.metadata)})
    facts.cautions.extend(entry.cautions)
    facts.levels.extend(entry.levels)
    return replace(motion, id=entry.id, metadata=facts)


def read_channels(
    path: Path, unit: str | None = None, *, accept: Iterable[str] = (), **options
) -> tuple[list[Channel], IndexEntry]:
    """Return the channels of a file in m/s2, and the row of an index that lists it."""
    entry = find_entry(path)
    words = calibrate.accepted_words(accept, path) + entry.accept
    if path.is_file():
        check_sha256(entry)
    channels, gap = _examine(path, entry, unit, **options)
    if "sensor" not in words:
        channels = _on_the_ground(channels)
    for channel in channels:
        channel.accept = words
        channel.accepted = calibrate.accept_or_refuse(path, words, channel.warnings)
        errors = [f"Error in the file: {error}." for error in channel.errors]
        cautions = [f"Caution: {caution}." for caution in channel.cautions]
        channel.log = channel.messages + channel.log + errors + cautions
    if gap:
        raise RecordError(f"{path}: {gap}")
    return channels, entry


def _on_the_ground(channels: list[Channel]) -> list[Channel]:
    """Return the channels without those of sensors in boreholes and structures.

    All are returned if no other channel is horizontal.
    """
    ground = [channel for channel in channels if not channel.sensor]
    others = [channel for channel in channels if channel.sensor]
    if not others or all(channel.is_vertical for channel in ground):
        return channels
    for channel in ground:
        channel.cautions.append(
            f"channel {', '.join(dict.fromkeys(each.code for each in others))} "
            f"{others[0].sensor} and is left out; `accept` with sensor reads it"
        )
    return ground


def _examine(
    path: Path,
    entry: IndexEntry,
    unit: str | None,
    inventory: str | Path | Inventory | None = None,
    columns: Columns | None = None,
) -> tuple[list[Channel], str]:
    """Return the channels of a file with their warnings, and why its pieces cannot be joined.

    No warning stops the reading. The text is empty if the pieces can be joined.
    """
    check_file(path)
    columns = columns or entry.columns
    if columns:
        traces = read_columns(path, columns)
    else:
        # AT2 by its name alone, so that a damaged header is judged by the reader that knows it.
        form = "AT2" if path.suffix.lower() == ".at2" else None
        traces = read_traces(str(path), form)
    form = traces[0].stats._format
    gap = ""
    if len({trace.id for trace in traces}) < len(traces):
        traces, gap = _join_pieces(path, traces)
    channels = []
    places: dict[str, set[str]] = {}
    for trace in traces:
        channel = trace.stats.record
        channel.trace = trace
        channels.append(channel)
        places.setdefault(channel.code, set()).add(str(trace.stats.location))
    unequal = len({channel.held for channel in channels}) > 1 and form in OWN
    for channel in channels:
        channel.warnings = list(calibrate.impossible(channel))
        several = sorted(places[channel.code])
        if channel.code and several[1:]:
            channel.cautions.append(
                f"channel {channel.code} is there of sensors at locations "
                f"{' and '.join(several)}; one may be in a borehole"
            )
        # If a text ends within its last line, digits may be missing.
        cut_off = form in TEXT and channel.held < channel.announced
        if cut_off and channel is channels[-1] and not path.read_bytes()[-1:].isspace():
            channel.trace.data = channel.trace.data[:-1]
            left = "the last sample is left out, since the file ends within its line"
            channel.warn(left, "samples")
        calibrate.to_si(channel, path, unit, entry.unit, inventory)
        if unequal:
            channel.errors.append(
                "the channels of the file have unequal numbers of samples "
                f"({', '.join(f'{each.code} {each.held}' for each in channels)})"
            )
    return channels, gap


def _join_pieces(path: Path, traces: Sequence[Trace]) -> tuple[list[Trace], str]:
    """Join the pieces of channels; return the traces, and where a gap or an overlap is.

    The text is empty if there is neither.
    """
    try:
        stream = Stream(traces).merge(method=-1)
        gaps = stream.get_gaps()
    except Exception as error:  # obspy's, of time steps that differ
        raise RecordError(
            f"{path}: pieces of a channel cannot be joined ({error})"
        ) from None
    for trace in stream:
        trace.stats.record.announced = trace.stats.record.held = trace.stats.npts
    if not gaps:
        return list(stream), ""
    *codes, start, _, length, _ = gaps[0]
    return list(stream), (
        f"channel {'.'.join(codes)} has {'a gap' if length > 0 else 'an overlap'} of "
        f"{abs(length):g} s after {start}; a record must be without gaps"
    )


def inspect_record(path: str | Path, unit: str | None = None, **options) -> Named:
    """List what is in a record file and what is wrong with it; arguments are as in `read_motion`.

    Times are in s (``start`` in UTC), ``PGA`` in m/s2, ``count`` is the number of samples held.
    What is unknown is empty or None. RecordError if the file cannot be read.
    """
    path = Path(path)
    channels, gap = _examine(path, find_entry(path), unit, **options)
    first = channels[0]
    listed = []
    for channel in channels:
        trace = channel.trace
        stats = trace.stats
        dt = stats.delta
        names = (stats.network, stats.station, stats.location)
        errors = [text for _, text in channel.warnings]
        errors += channel.errors + channel.cautions
        peak = None
        if channel.unit_in_file:
            peak = peak_of(trace.data)
            errors += [text for _, text in calibrate.implausible(channel)]
            errors += sample_cautions(trace.data, dt)
        listed.append(
            {
                "code": channel.code,
                "station": channel.station or ".".join(filter(None, names)),
                "start": str(stats.starttime) if stats.starttime.timestamp else "",
                "dt": dt,
                "announced": channel.announced,
                "count": channel.held,
                "unit": channel.unit_in_file,
                "level": channel.level or "raw" * (channel.unit_in_file == "counts"),
                "vertical": channel.is_vertical,
                "errors": list(dict.fromkeys(errors)),
                "duration": (channel.held - 1) * dt,
                "PGA": peak,
            }
        )
    return {
        "file": str(path),
        "format": first.trace.stats._format,
        "event": first.event,
        "date": first.date,
        "magnitude": first.magnitude,
        "channels": listed,
        "errors": [*first.messages, *filter(None, (gap,))],
    }
