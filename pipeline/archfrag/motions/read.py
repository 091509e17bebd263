"""Records of ground motion from files: waveform formats that obspy reads, and our plug-ins.

A channel is an obspy Trace. Its ``stats.record`` has what the header states, ``announced`` and
``held`` numbers of samples, a ``log``, ``errors`` (contradictions) and ``warnings`` (for which it
is refused unless accepted); if ``unit_in_file`` is empty the samples are those of the file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from obspy import Inventory, Stream, Trace
from obspy.core import AttribDict

from archfrag.errors import RecordError
from archfrag.motions import calibrate, partners
from archfrag.motions.calibrate import accept_or_refuse, implausible
from archfrag.motions.cautions import sample_cautions
from archfrag.motions.formats import OWN, TEXT, read_traces, recognise
from archfrag.motions.formats.columns import Columns, read_columns
from archfrag.motions.formats.layout import known
from archfrag.motions.headers import Warned
from archfrag.motions.index import IndexEntry, check_sha256, find_entry
from archfrag.motions.motion import Motion, unit_factor
from archfrag.motions.partners import channel_code, is_horizontal, is_vertical

# What a motion's metadata take over from a header, in the words of ``stats.record``.
HEADER = ("event", "date", "magnitude", "station", "vs30_mps", "epicentral_km", "azimuth", "level",
          "origin_time")  # fmt: skip


def read_motion(
    path: str | Path, unit: str | None = None, component: str | None = None, *,
    vertical: str | Path | None = None, inventory: str | Path | Inventory | None = None,
    accept: Iterable[str] = (), columns: Columns | None = None,
) -> Motion:  # fmt: skip
    """Read one horizontal component of a record, and the vertical if there is one.

    Parameters
    ----------
    path : path
        A file in PEER's AT2, COSMOS V0 to V2, CSMIP (DMG) volume 1 or 2, SMC, ESM's and ITACA's
        DYNA, GeoNet's V1A and V2A, RESORCE, K-NET, KiK-net, SLIST, TSPAIR, miniSEED, SAC, GSE1,
        GSE2, SEISAN, Kinemetrics EVT, GCF or RefTek 130; never an archive or a pickle. Of counts
        and uncorrected volumes the mean is removed.
    unit : str, optional
        Of the samples (``m/s2``, ``cm/s2``, ``gal``, ``mm/s2`` or ``g``) if the file states none.
    component : str, optional
        Channel code (``HNE``), its last letter (``E``) or trace id of the horizontal to read, if
        not the first of the file.
    vertical : path, optional
        File of the vertical component if it is not in the same file.
    inventory : path or obspy.Inventory, optional
        StationXML of a record in counts; by default NAME.xml or NET.STA.xml beside the file.
    accept : sequence of str
        What to let pass: ``pga`` (1e-5 to 5 g), ``time_step`` (1e-4 to 0.1 s), ``samples`` (other
        than announced), ``header`` (its peak is off by a tenth, or it contradicts unit or code).
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
    options: Any = {"unit": unit, "inventory": inventory, "accept": accept, "columns": columns}
    motion = _read_one(Path(path), options, component, own_vertical=vertical is None)
    if vertical is None:
        return motion
    return partners.joined(motion, read_vertical(vertical, **options), "vertical")


def _read_one(
    source: Path, options: dict[str, Any], component: str | None, listed: str | None = None,
    own_vertical: bool = True,
) -> Motion:  # fmt: skip
    """See `read_motion`; `listed` names the component in a file with several horizontals."""
    channels, entry = read_channels(source, **options)
    chosen, verticals = _chosen(channels, source, component, listed)
    name = entry.id if entry else record_name(source)
    return _motion(source, chosen, name, entry, verticals if own_vertical else ())


def _chosen(
    channels: Sequence[Trace], source: Path, component: str | None, listed: str | None = None
) -> tuple[Trace, list[Trace]]:
    """The horizontal channel to take, its log saying so, and the verticals."""
    horizontals, verticals = _by_direction(channels, source, not (component or listed))
    several, codes = len(horizontals) > 1, [channel_code(channel) for channel in horizontals]
    names = ", ".join(code or "(no code)" for code in codes)
    component, chosen = component or (listed if several else None), horizontals[0]
    record = chosen.stats.record
    if component:
        spelled = [channel.id for channel in horizontals] + codes + [code[-1:] for code in codes]
        places = [i for i, name in enumerate(spelled) if name.upper() == component.upper()]
        if not places:
            raise RecordError(f"{source}: no horizontal component {component!r}; there is {names}")
        chosen = horizontals[places[0] % len(horizontals)]
    elif several:
        record.log = (f"Horizontal {codes[0]} taken, the first of {names}.", *record.log)
    elif not is_horizontal(chosen):
        taken = f"Channel code {codes[0]!r} taken to be horizontal: the only one."
        record.log = (taken, *record.log)
    return chosen, verticals


def motion_of_stream(
    stream: Stream | Trace, unit: str, component: str | None, accept: Iterable[str]
) -> Motion:
    """See `archfrag.Motion.from_obspy`."""
    channels = [trace.copy() for trace in ([stream] if isinstance(stream, Trace) else stream)]
    if not channels:
        raise RecordError("the stream has no trace")
    first, names = channels[0].stats, [channel.id for channel in channels]
    source = Path(".".join(filter(None, (first.network, first.station))) or "stream")
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise RecordError(f"{twice}: is there in several pieces; join them by `stream.merge()`")
    factor, words = unit_factor(unit, str(source)), calibrate.accepted_words(accept, str(source))
    for channel in channels:
        held, channel.stats._format = len(channel.data), "obspy"
        done = f"Converted to m/s2: unit {unit} as stated, factor {factor:g}."
        record: dict[str, Any] = {"announced": held, "held": held, "unit_in_file": unit}
        record |= {"accept": words, "errors": (), "cautions": (), "log": (done,)}
        channel.stats.record = AttribDict(record)
        channel.stats.record.accepted = accept_or_refuse(source, words, _warnings(channel))
        channel.data = np.asarray(channel.data, dtype=np.float64) * factor
    chosen, verticals = _chosen(channels, source, component)
    return _motion(source, chosen, chosen.id, None, verticals)


def read_horizontals(
    path: str | Path, unit: str | None = None, *, name: str | None = None, **options: Any
) -> list[Motion]:
    """As `read_motion`, each horizontal of a file with its vertical; `name` begins their ids."""
    source = Path(path)
    channels, entry = read_channels(source, unit, **options)
    horizontals, verticals = _by_direction(channels, source)
    alone, codes = len(horizontals) == 1, [channel_code(channel) for channel in horizontals]
    base = entry.id if entry and alone else name or record_name(source)
    motions = []
    for channel, code in zip(horizontals, codes):
        twin = f"{channel.stats.location}." if codes.count(code) > 1 else ""
        own = base if alone else f"{base}:{twin}{code}"
        motions.append(_motion(source, channel, own, entry, verticals))
    return motions


def read_vertical(path: str | Path, unit: str | None = None, **options: Any) -> Motion:
    """Read the vertical of a file as the horizontal of a motion; options as in `read_motion`."""
    source = Path(path)
    channels, _ = read_channels(source, unit, **options)
    verticals = [channel for channel in channels if is_vertical(channel)]
    if not verticals and len(channels) == 1 and not is_horizontal(channels[0]):
        verticals = channels
    if len(verticals) != 1:
        names = ", ".join(repr(channel_code(channel)) for channel in channels)
        raise RecordError(f"{path}: one vertical channel is needed, the file holds {names}")
    return _motion(source, verticals[0], record_name(source), None)


def record_name(path: Path) -> str:
    """Return the base of a record's id: its file's name, with the ending for K-NET."""
    return path.name if recognise(str(path), ("KNET",)) else path.stem


def load_motion(entry: IndexEntry) -> Motion:
    """Read the record of a row of an index; RecordError if it is not as the row states."""
    check_sha256(entry)
    options = {"unit": entry.unit or None, "accept": entry.accept, "columns": entry.columns}
    motion = _read_one(entry.path, options, None, entry.metadata.get("component"))
    step = entry.metadata.get("dt_s")
    if step is not None and not np.isclose(step, motion.dt, rtol=1e-6, atol=0.0):
        raise RecordError(f"{entry.path}: dt is {motion.dt} s, the index lists dt_s = {step} s")
    merged = {**motion.metadata, **known(**entry.metadata)}
    return motion._replaced(id=entry.id, metadata=merged)


def read_channels(
    path: Path, unit: str | None = None, *, accept: Iterable[str] = (), **options: Any
) -> tuple[list[Trace], IndexEntry | None]:
    """Return the channels of a file in their order, and the row of an index that lists it."""
    words = calibrate.accepted_words(accept, str(path))
    entry = find_entry(path)
    if entry is not None and path.is_file():
        check_sha256(entry)
    channels, gap = _examine(path, entry, unit, **options)
    for channel in channels:
        record = channel.stats.record
        record.accept = (*words, *(entry.accept if entry else ()))
        record.accepted = accept_or_refuse(path, record.accept, record.warnings)
        errors = (f"Error in the file: {error}." for error in record.errors)
        cautions = (f"Caution: {caution}." for caution in record.cautions)
        record.log = (*record.messages, *record.log, *errors, *cautions)
    if gap:
        raise RecordError(f"{path}: {gap}")
    return channels, entry


def _examine(
    path: Path, entry: IndexEntry | None, unit: str | None,
    inventory: str | Path | Inventory | None = None, columns: Columns | None = None,
) -> tuple[list[Trace], str]:  # fmt: skip
    """Channels of a file whatever is wrong with it, and why its pieces cannot be joined."""
    calibrate.check_file(path)
    if columns := columns or (entry.columns if entry else None):
        traces = read_columns(path, columns)
    else:
        # AT2 by its name alone, so that a damaged header is judged by the reader that knows it.
        traces = read_traces(str(path), "AT2" if path.suffix.lower() == ".at2" else None)
    channels, form, gap = traces, traces[0].stats._format, ""
    if len({trace.id for trace in traces}) < len(traces):
        try:
            stream = Stream(traces).merge(method=-1)
            gaps = stream.get_gaps()
        except Exception as error:  # obspy's, of time steps that differ
            raise RecordError(f"{path}: pieces of a channel cannot be joined ({error})") from None
        channels = list(stream)
        for channel in channels:
            channel.stats.record.update(dict.fromkeys(("announced", "held"), channel.stats.npts))
        for *codes, start, _, length, _ in gaps[:1]:
            kind = f"{'a gap' if length > 0 else 'an overlap'} of {abs(length):g} s after {start}"
            gap = f"channel {'.'.join(codes)} has {kind}; a record must be without gaps"
    counts, listed = [c.stats.record.held for c in channels], entry.unit if entry else ""
    unequal = len(set(counts)) > 1 and form in OWN
    held = ", ".join(f"{channel_code(c)} {count}" for c, count in zip(channels, counts))
    differing = (f"the channels of the file have unequal numbers of samples ({held})",)
    places: dict[str, set[str]] = {}
    for channel in channels:
        places.setdefault(channel_code(channel), set()).add(str(channel.stats.location))
    for channel in channels:
        record, code = channel.stats.record, channel_code(channel)
        record.warnings, record.cautions = tuple(_warnings(channel)), ()
        if code and len(places[code]) > 1:
            several = f"of sensors at locations {' and '.join(sorted(places[code]))}"
            record.cautions = (f"channel {code} is there {several}; one may be in a borehole",)
        # If a text ends within its last line, digits may be missing.
        cut_off = channel is channels[-1] and form in TEXT and record.held < record.announced
        if cut_off and not path.read_bytes()[-1:].isspace():
            channel.data = channel.data[:-1]
            left = "the last sample is left out, since the file ends within its line"
            record.warnings += (("samples", left),)
        calibrate.to_si(channel, path, unit, listed, inventory)
        record.errors += differing if unequal else ()
    return channels, gap


def _warnings(trace: Trace) -> Iterator[Warned]:
    """List what is impossible in a record, or contradicts its header."""
    delta, code, record = trace.stats.delta, channel_code(trace) or trace.id, trace.stats.record
    announced, held = record.announced, record.held
    if not 0.0 < delta < np.inf:
        yield None, f"time step {delta} s of channel {trace.id} must be a positive number of s"
    if announced != held:
        stated = f"the header announces {announced} samples of channel {code}"
        yield "samples", f"{stated}, the file holds {'only ' if held < announced else ''}{held}"
    for warning in record.get("warnings", ()) if announced == held else ():
        yield "header", f"channel {code}: {warning}"
    if min(held, len(trace.data)) < 2:
        yield None, f"channel {trace.id} holds less than 2 samples"
    if np.iscomplexobj(trace.data):
        yield None, f"channel {trace.id} has complex samples; accelerations are real numbers"
    if np.ma.isMaskedArray(trace.data):
        yield None, f"channel {trace.id} has gaps; a record must be without gaps"
    if (bad := np.flatnonzero(~np.isfinite(trace.data))).size:
        yield None, f"channel {trace.id} is not finite, the first time at index {bad[0]}"


def _by_direction(
    channels: Sequence[Trace], path: Path, surely: bool = True
) -> tuple[list[Trace], list[Trace]]:
    """Return channels that are not known to be vertical, or `surely` are not, and verticals."""
    verticals = [c for c in channels if is_vertical(c)]
    others = [c for c in channels if not is_vertical(c)]
    if not others:
        raise RecordError(f"{path}: holds only the vertical component; a horizontal one is needed")
    if surely and len(channels) > 1 and not all(map(is_horizontal, others)):
        names = ", ".join(repr(channel_code(c)) for c in channels)
        remedy = "name them as SEED does (HNE, HNN, HNZ), or read one by `component` (--component)"
        raise RecordError(f"{path}: which of {names} is horizontal is not clear by code; {remedy}")
    return others, verticals


def _motion(
    path: Path, channel: Trace, name: str, entry: IndexEntry | None,
    verticals: Sequence[Trace] = (),
) -> Motion:  # fmt: skip
    """The motion of a channel, with the vertical of its instrument if that is among them."""
    stats, record = channel.stats, channel.stats.record
    accepted = record.accepted + accept_or_refuse(path, record.accept, implausible(channel))
    metadata: dict[str, Any] = {
        "file": path.name, "format": stats._format, "unit_in_file": record.unit_in_file,
        "event": "", "date": "", "station": stats.station,
        **{key: record[key] for key in HEADER if key in record},
        "component": channel_code(channel), "vertical_component": "",
    }  # fmt: skip
    if stats.network or stats.station:
        metadata |= {"trace": channel.id, "vertical_trace": ""}
    if stats.starttime.timestamp != 0.0:
        metadata["start_time"] = str(stats.starttime)
    if entry is not None:
        metadata |= known(**entry.metadata)
    found = {"errors": record.errors, "cautions": record.cautions, "accepted": accepted}
    metadata |= {key: list(lines) for key, lines in found.items() if lines}
    kind = " ".join(filter(None, (stats._format, record.get("level"))))
    log = (f"Read from {path.name} ({kind}).", *record.log, *accepted)
    motion = Motion(channel.data, float(stats.delta), None, name, metadata, log)
    for own in (v for v in verticals if partners.instrument(v) == partners.instrument(channel)):
        vertical = _motion(path, own, name, entry)
        try:
            return partners.joined(motion, vertical, "vertical")
        except RecordError as error:
            raise RecordError(f"{path}: {error}") from None
    return motion


def inspect_record(path: str | Path, unit: str | None = None, **options: Any) -> dict[str, Any]:
    """List what is in a record file and what is wrong with it; arguments are as in `read_motion`.

    Times are in s (``start`` in UTC), ``PGA`` in m/s2, ``count`` is the number of samples held.
    What is unknown is empty or None. RecordError if the file cannot be read.
    """
    traces, gap = _examine(Path(path), find_entry(path), unit, **options)
    channels, about = [], traces[0].stats.record
    for trace in traces:
        stats, record, dt = trace.stats, trace.stats.record, float(trace.stats.delta)
        unit = record.unit_in_file
        names = [str(stats[key]) for key in ("network", "station", "location") if stats[key]]
        errors = [*(text for _, text in record.warnings), *record.errors, *record.cautions]
        if unit:
            errors += [text for _, text in implausible(trace)]
            errors += sample_cautions(trace.data, dt)
        channels.append({
            "code": channel_code(trace), "station": str(record.get("station") or ".".join(names)),
            "start": str(stats.starttime) if stats.starttime.timestamp != 0.0 else "",
            "dt": dt, "announced": record.announced, "count": record.held, "unit": unit,
            "level": str(record.get("level") or ("raw" if unit == "counts" else "")),
            "vertical": is_vertical(trace), "errors": list(dict.fromkeys(errors)),
            "duration": (record.held - 1) * dt,
            "PGA": float(abs(trace.data).max()) if unit else None,
        })  # fmt: skip
    return {
        "file": str(path), "format": traces[0].stats._format,
        **{key: str(about.get(key, "")) for key in ("event", "date")},
        "magnitude": about.get("magnitude"), "channels": channels,
        "errors": [*about.messages, *filter(None, (gap,))],
    }  # fmt: skip
