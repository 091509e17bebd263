"""Records of ground motion from files: waveform formats that obspy reads, and our plug-ins."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from obspy import Inventory, Trace

from archfrag.errors import RecordError
from archfrag.motions.calibrate import Reading, accept_or_refuse, implausible
from archfrag.motions.channels import by_direction, read_channels
from archfrag.motions.formats import recognise
from archfrag.motions.formats.columns import Columns
from archfrag.motions.formats.facts import known
from archfrag.motions.index import IndexEntry, check_sha256
from archfrag.motions.motion import Motion
from archfrag.motions.partners import (
    channel_code,
    instrument,
    is_horizontal,
    is_vertical,
    with_vertical,
)

# What a motion's metadata take over from a header, in the words of ``stats.record``.
HEADER = ("event", "date", "magnitude", "station", "vs30_mps", "epicentral_km", "azimuth", "level")


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
        DYNA, GeoNet's V1A and V2A, RESORCE, K-NET and KiK-net, SLIST, TSPAIR, miniSEED, SAC
        (binary or text), GSE1, GSE2, SEISAN, Kinemetrics EVT, GCF or RefTek 130; never an
        archive or a pickle. Of counts and uncorrected volumes the mean is removed.
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
        What to let pass though it is hardly right: ``pga`` (peak outside 1e-5 to 5 g),
        ``time_step`` (outside 1e-4 to 0.1 s), ``samples`` (another number than the header
        announces), ``header`` (states a peak that is off by more than a tenth).
    columns : Columns, optional
        Where the numbers are in a plain text whose header is not known.

    Returns
    -------
    Motion
        In m/s2; every step from the file to it is in its log. Its metadata have what the header
        states, what was ``accepted``, and the ``faults``: contradictions in the file.

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
    options = Reading(unit, inventory, accept, columns)
    motion = _read_one(Path(path), options, component, own_vertical=vertical is None)
    if vertical is not None:
        return with_vertical(motion, read_vertical(vertical, **options._asdict()))
    return motion


def _read_one(
    source: Path, options: Reading, component: str | None, listed: str | None = None,
    own_vertical: bool = True,
) -> Motion:  # fmt: skip
    """See `read_motion`; `listed` names the component in a file with several horizontals."""
    channels, entry = read_channels(source, options)
    remedy = "give `component` (--component on the command line)"
    horizontals, verticals = by_direction(channels, source, "" if component or listed else remedy)
    several, codes = len(horizontals) > 1, [channel_code(channel) for channel in horizontals]
    names = ", ".join(code or "(no code)" for code in codes)
    component, chosen, line = component or (several and listed) or None, horizontals[0], ""
    if component is not None:
        spelled = [channel.id for channel in horizontals] + codes + [code[-1:] for code in codes]
        places = [i for i, name in enumerate(spelled) if name.upper() == component.upper()]
        if not places:
            raise RecordError(f"{source}: no horizontal component {component!r}; there is {names}")
        chosen = horizontals[places[0] % len(horizontals)]
    elif several:
        line = f"Horizontal {codes[0]} taken, the first of {names}."
    elif not is_horizontal(chosen):
        line = f"Channel code {codes[0]!r} taken to be horizontal: the only one."
    motion = _motion(source, chosen, entry.id if entry else record_name(source), entry)
    motion = motion._replaced(log=(motion.log[0], *filter(None, (line,)), *motion.log[1:]))
    return _with_own_vertical(motion, chosen, verticals if own_vertical else (), source, entry)


def read_motions(
    path: str | Path, unit: str | None = None, *, name: str | None = None, **options: Any
) -> list[Motion]:
    """Read every horizontal component of a file, each with the vertical of its instrument.

    Options and errors are those of `read_motion`; ids begin with `name` if that is given, with
    the file's name if not.
    """
    source = Path(path)
    channels, entry = read_channels(source, Reading(unit, **options))
    remedy = "name them as SEED does (HNE, HNN, HNZ), or give each component a file of its own"
    horizontals, verticals = by_direction(channels, source, remedy)
    alone, codes = len(horizontals) == 1, [channel_code(channel) for channel in horizontals]
    base = entry.id if entry and alone else name or record_name(source)
    motions = []
    for channel, code in zip(horizontals, codes):
        twin = f"{channel.stats.location}." if codes.count(code) > 1 else ""
        motion = _motion(source, channel, base if alone else f"{base}:{twin}{code}", entry)
        motions.append(_with_own_vertical(motion, channel, verticals, source, entry))
    return motions


def read_vertical(path: str | Path, unit: str | None = None, **options: Any) -> Motion:
    """Read the vertical component of a file as the horizontal component of a motion.

    Options and errors are those of `read_motion`.
    """
    source = Path(path)
    channels, _ = read_channels(source, Reading(unit, **options))
    verticals = [channel for channel in channels if is_vertical(channel)]
    if not verticals and len(channels) == 1 and not is_horizontal(channels[0]):
        verticals = channels
    if len(verticals) != 1:
        names = ", ".join(repr(channel_code(channel)) for channel in channels)
        raise RecordError(f"{path}: one vertical channel is needed, the file holds {names}")
    return _motion(source, verticals[0], record_name(source), None)


def record_name(path: Path) -> str:
    """What the id of a record is made of: its file's name, of K-NET's with the ending."""
    return path.name if recognise(str(path), ("KNET",)) else path.stem


def load_motion(entry: IndexEntry) -> Motion:
    """Read the record of a row of an index; RecordError if it is not as the row states."""
    check_sha256(entry)
    options = Reading(entry.unit or None, None, entry.accept, entry.columns)
    motion = _read_one(entry.path, options, None, entry.metadata.get("component"))
    step = entry.metadata.get("dt_s")
    if step is not None and not np.isclose(step, motion.dt, rtol=1e-6, atol=0.0):
        raise RecordError(f"{entry.path}: dt is {motion.dt} s, the index lists dt_s = {step} s")
    merged = {**motion.metadata, **known(**entry.metadata)}
    return motion._replaced(id=entry.id, metadata=merged)


def _with_own_vertical(
    motion: Motion, channel: Trace, verticals: Sequence[Trace], path: Path,
    entry: IndexEntry | None,
) -> Motion:  # fmt: skip
    """The motion with the vertical of its instrument, if the file has it."""
    own = next((v for v in verticals if instrument(v) == instrument(channel)), None)
    if own is None:
        return motion
    try:
        return with_vertical(motion, _motion(path, own, motion.id, entry))
    except RecordError as error:
        raise RecordError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


def _motion(path: Path, channel: Trace, name: str, entry: IndexEntry | None) -> Motion:
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
    if record.faults:
        metadata["faults"] = list(record.faults)
    if stats.starttime.timestamp != 0.0:
        metadata["start_time"] = str(stats.starttime)
    if entry is not None:
        metadata |= known(**entry.metadata)
    if accepted:
        metadata["accepted"] = list(accepted)
    kind = " ".join(filter(None, (stats._format, record.get("level"))))
    log = (f"Read from {path.name} ({kind}).", *record.log, *accepted)
    return Motion(channel.data, float(stats.delta), None, name, metadata, log)
