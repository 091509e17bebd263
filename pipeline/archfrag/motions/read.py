"""Records of ground motion from files: waveform formats that obspy reads, and our plug-ins."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from obspy import Inventory

from archfrag.errors import RecordError
from archfrag.motions.channels import Channel, Options, by_direction, read_channels
from archfrag.motions.formats.columns import Columns
from archfrag.motions.formats.facts import known
from archfrag.motions.formats.waveform import recognise
from archfrag.motions.index import IndexEntry, check_sha256
from archfrag.motions.motion import Motion
from archfrag.motions.partners import common_span
from archfrag.motions.plausible import accept_or_refuse, accepted_words, doubtful_motion

# What a motion's metadata take over from a header, in the words of ``stats.record``.
HEADER = (
    "event", "date", "magnitude", "depth_km", "event_latitude", "event_longitude", "station",
    "station_latitude", "station_longitude", "vs30_mps", "epicentral_km", "azimuth", "level",
)  # fmt: skip


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
    """Read one horizontal component of a record, and the vertical where there is one.

    Parameters
    ----------
    path : path
        A file in PEER's AT2, COSMOS V0 to V2, CSMIP (DMG) volume 1 or 2, SMC, ESM's and ITACA's
        DYNA, GeoNet's V1A and V2A, RESORCE, K-NET and KiK-net, SLIST, TSPAIR, miniSEED, SAC
        (binary or text), GSE1, GSE2, SEISAN, Kinemetrics EVT, GCF or RefTek 130; never an
        archive or a pickle. Of counts and uncorrected volumes the mean is removed.
    unit : str, optional
        Unit of the samples: ``m/s2``, ``cm/s2``, ``gal``, ``mm/s2`` or ``g``. Only for files
        that do not state it themselves; it is never guessed.
    component : str, optional
        Channel code (``HNE``), its last letter (``E``) or trace id of the horizontal wanted.
        Without it the first horizontal of the file is taken, and the log names it.
    vertical : path, optional
        File of the vertical component where it is not in the same file.
    inventory : path or obspy.Inventory, optional
        StationXML of a record in counts; by default NAME.xml or NET.STA.xml beside the file.
    accept : sequence of str
        What to let pass though it is hardly right: ``pga`` (peak outside 1e-5 to 5 g),
        ``time_step`` (outside 1e-4 to 0.1 s), ``samples`` (another number than the header
        announces), ``header`` (states a peak that is off by more than a tenth). An ``index.csv``
        that lists the file may state it in a column ``accept``.
    columns : Columns, optional
        Where the numbers are in a plain text without a header that is known.

    Returns
    -------
    Motion
        In m/s2; every step from the file to it is in its log. Its metadata have what the header
        states (see ``HEADER``), what was accepted under ``accepted`` and what the file contradicts
        itself in under ``faults``.

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
    options = Options(unit, inventory, accepted_words(accept, str(path)), columns)
    return _read_one(Path(path), options, component, vertical)


def _read_one(
    source: Path, options: Options, component: str | None, vertical: str | Path | None = None,
    of_several: str | None = None,
) -> Motion:  # fmt: skip
    """See `read_motion`; `of_several` names the component in a file with several horizontals."""
    channels, entry = read_channels(source, options)
    if of_several and sum(not channel.vertical for channel in channels) > 1:
        component = of_several
    remedy = "" if component else "give `component` (--component on the command line)"
    horizontals, verticals = by_direction(channels, source, remedy)
    chosen, note = _choose(horizontals, source, component)
    upward = next((c for c in verticals if c.group == chosen.group), None)
    if vertical is not None:
        upward = _vertical_from(Path(vertical), options)
    name = entry.id if entry else record_name(source)
    motion = _motion(source, chosen, upward, name, entry, options.accept)
    return motion._replaced(log=(motion.log[0], *note, *motion.log[1:]))


def read_motions(
    path: str | Path,
    unit: str | None = None,
    *,
    inventory: str | Path | Inventory | None = None,
    accept: Iterable[str] = (),
    columns: Columns | None = None,
    name: str | None = None,
) -> list[Motion]:
    """Read every horizontal component of a file, each with the vertical of its instrument.

    Parameters and errors are those of `read_motion`; ids begin with `name` if that is given,
    with the file's name if not.
    """
    source = Path(path)
    options = Options(unit, inventory, accepted_words(accept, str(path)), columns)
    channels, entry = read_channels(source, options)
    remedy = "name them as SEED does (HNE, HNN, HNZ), or give each component a file of its own"
    horizontals, verticals = by_direction(channels, source, remedy)
    alone, codes = len(horizontals) == 1, [channel.code for channel in horizontals]
    base = entry.id if entry and alone else name or record_name(source)
    motions = []
    for channel in horizontals:
        upward = next((c for c in verticals if c.group == channel.group), None)
        twin = f"{channel.trace.stats.location}." if codes.count(channel.code) > 1 else ""
        id = base if alone else f"{base}:{twin}{channel.code}"
        motions.append(_motion(source, channel, upward, id, entry, options.accept))
    return motions


def read_vertical(
    path: str | Path,
    unit: str | None = None,
    *,
    inventory: str | Path | Inventory | None = None,
    accept: Iterable[str] = (),
) -> Motion:
    """Read the vertical component of a file, in the place of the horizontal one of a motion.

    Parameters and errors are those of `read_motion`.
    """
    source = Path(path)
    options = Options(unit, inventory, accepted_words(accept, str(path)))
    channel = _vertical_from(source, options)
    return _motion(source, channel, None, record_name(source), None, options.accept)


def record_name(path: Path) -> str:
    """What the id of a record is made of: its file's name, of K-NET's with the ending."""
    return path.name if recognise(str(path), ("KNET",)) else path.stem


def load_motion(entry: IndexEntry) -> Motion:
    """Read the record of a row, once its sha256, unit and time step are found as stated.

    Raises
    ------
    RecordError
        If the file is missing, has changed since it was listed, or has another time step.
    """
    check_sha256(entry)
    options = Options(entry.unit or None, None, entry.accept, entry.columns)
    motion = _read_one(entry.path, options, None, of_several=entry.metadata.get("component"))
    step = entry.metadata.get("dt_s")
    if step is not None and not np.isclose(step, motion.dt, rtol=1e-6, atol=0.0):
        raise RecordError(
            f"{entry.path}: the index lists dt_s = {step} s, the file has {motion.dt} s"
        )
    merged = {**motion.metadata, **known(**entry.metadata)}
    return motion._replaced(id=entry.id, metadata=merged)


def _choose(
    horizontals: Sequence[Channel], path: Path, component: str | None
) -> tuple[Channel, tuple[str, ...]]:
    names = ", ".join(c.code or "(no code)" for c in horizontals)
    if component is not None:
        for match in (lambda c: c.trace.id, lambda c: c.code, lambda c: c.code[-1:]):
            for channel in horizontals:
                if match(channel).upper() == component.upper():
                    return channel, ()
        has = f"there is no horizontal component {component!r}; there is {names}"
        raise RecordError(f"{path}: {has}")
    chosen = horizontals[0]
    if len(horizontals) > 1:
        return chosen, (f"Horizontal {chosen.code} taken, the first of {names}.",)
    if not chosen.horizontal:
        return chosen, (f"Channel code {chosen.code!r} taken to be horizontal: the only one.",)
    return chosen, ()


def _vertical_from(path: Path, options: Options) -> Channel:
    channels, _ = read_channels(path, options)
    verticals = [c for c in channels if c.vertical]
    if len(verticals) == 1:
        return verticals[0]
    if len(channels) == 1 and not channels[0].horizontal:
        return channels[0]
    names = ", ".join(repr(c.code) for c in channels)
    raise RecordError(f"{path}: one vertical channel is needed, the file holds {names}")


def _motion(
    path: Path, channel: Channel, upward: Channel | None, name: str, entry: IndexEntry | None,
    accept: tuple[str, ...],
) -> Motion:  # fmt: skip
    stats, record = channel.trace.stats, channel.record
    kind = " ".join(filter(None, (stats.get("_format", ""), record.get("level"))))
    log: tuple[str, ...] = (f"Read from {path.name} ({kind}).", *channel.log)
    horizontal, vertical = channel.samples, None
    if upward is not None:
        sizes = horizontal.size, upward.samples.size
        later = round((upward.start - channel.start) / channel.dt)
        both = f"{path}: {channel.code} and the vertical {upward.code}"
        kept, its_kept, count = common_span(both, (channel.dt, upward.dt), later, sizes)
        horizontal, vertical = horizontal[kept], upward.samples[its_kept]
        log = (*log, *(f"Vertical {upward.code}: {step}" for step in upward.log))
        if count < max(sizes):
            log = (*log, f"Cut to the {count} samples common to {channel.code} ({sizes[0]}) and "
                         f"{upward.code} ({sizes[1]}).")  # fmt: skip
    accept = (*accept, *(entry.accept if entry else ()))
    accepted: tuple[str, ...] = ()
    for each, samples in ((channel, horizontal), (upward, vertical)):
        if each is not None and samples is not None:
            doubts = doubtful_motion(each.code, samples, each.dt, each.unit_in_file)
            accepted += each.accepted + accept_or_refuse(path, accept, doubts)
    metadata: dict[str, Any] = {
        "file": path.name, "format": stats.get("_format", ""),
        "unit_in_file": channel.unit_in_file, "event": "", "date": "", "station": stats.station,
        **{key: record[key] for key in HEADER if key in record},
        "component": channel.code, "vertical_component": upward.code if upward else "",
    }  # fmt: skip
    if stats.network or stats.station:
        metadata["trace"] = channel.trace.id
        metadata["vertical_trace"] = upward.trace.id if upward else ""
    if faults := dict.fromkeys((*channel.faults, *(upward.faults if upward else ()))):
        metadata["faults"] = list(faults)
    if stats.starttime.timestamp != 0.0:
        metadata["start_time"] = str(channel.start)
    if entry is not None:
        metadata |= known(**entry.metadata)
    if accepted:
        metadata["accepted"] = list(accepted)
    return Motion._owning(horizontal, channel.dt, vertical, name, metadata, log + accepted)
