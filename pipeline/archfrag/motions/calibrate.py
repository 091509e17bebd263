"""What a file, StationXML and the user state of a record: unit, sense, and what is plausible."""

import contextlib
import io
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import RecordError
from archfrag.files import opened, read_bytes
from archfrag.motions.motion import METRES_PER_SECOND_SQUARED, STANDARD_GRAVITY, unit_factor
from archfrag.motions.partners import channel_code, is_vertical

if TYPE_CHECKING:
    from obspy import Inventory, Trace

    from archfrag.motions.formats.columns import Columns
    from archfrag.motions.index import IndexEntry

    Given: TypeAlias = str | Path | Inventory | None

_ACCELERATION_UNITS = {"M/S**2", "M/S^2", "M/S2", "M/S/S", "M/(S**2)", "M/SEC**2", "M/SEC/SEC"}
Acceptable = Literal["pga", "time_step", "samples", "header"]
ACCEPTABLE: tuple[Acceptable, ...] = get_args(Acceptable)
LARGEST_RECORD, LARGEST_INVENTORY = 2**27, 50_000_000  # [bytes]
Warned = tuple[Acceptable | None, str]  # None: nothing makes it acceptable
_Scaled = tuple[NDArray[np.float64], str, tuple[str, ...]]


class Reading(NamedTuple):
    """What the user states of a file, see `archfrag.motions.read.read_motion`."""

    unit: str | None = None
    inventory: "Given" = None
    accept: Iterable[str] = ()
    columns: "Columns | None" = None


def check_file(path: Path) -> None:
    """Raise RecordError for what cannot be read as a record: a folder, a pipe, an empty file."""
    try:
        str(path).encode()
        with opened(path) as file:
            size = os.fstat(file.fileno()).st_size
    except UnicodeEncodeError:
        shown = os.fsencode(path).decode("utf-8", "backslashreplace")
        remedy = "rename it, the id of a record is made of its name"
        raise RecordError(f"{shown}: the name of the file is not in UTF-8; {remedy}") from None
    except FileNotFoundError:
        raise RecordError(f"{path}: there is no such file") from None
    except OSError as error:
        raise RecordError(f"{path}: the file cannot be read: {error.strerror}") from None
    if not 0 < size <= LARGEST_RECORD:
        many = f"the file has {size} bytes; a record may have at most {LARGEST_RECORD}"
        raise RecordError(f"{path}: {many if size else 'the file is empty'}")


def accepted_words(words: Iterable[str], place: str) -> tuple[str, ...]:
    """The words of an `accept`, commas or blanks between, in the order of ``ACCEPTABLE``."""
    given = (words if isinstance(words, str) else " ".join(words)).replace(",", " ").split()
    for word in given:
        if word not in ACCEPTABLE:
            raise RecordError(f"{place}: accept {word!r} is not one of {', '.join(ACCEPTABLE)}")
    return tuple(word for word in ACCEPTABLE if word in given)


def implausible(channel: "Trace") -> Iterator[Warned]:
    """What is implausible about a channel in m/s2."""
    code, dt = channel_code(channel), float(channel.stats.delta)
    # A rate such as 10 Hz need not give 0.1 s to the last digit.
    if not 1e-4 * (1.0 - 1e-9) <= dt <= 0.1 * (1.0 + 1e-9):
        yield "time_step", f"time step of channel {code} is {dt:g} s, outside 0.0001 to 0.1 s"
    peak = float(np.abs(channel.data).max()) / STANDARD_GRAVITY
    if not 1e-5 <= peak <= 5.0:
        text = f"{peak:.4g} g by its unit {channel.stats.record.unit_in_file}"
        yield "pga", f"peak of channel {code} is {text}, outside 1e-05 to 5 g"


def accept_or_refuse(
    path: object, accept: tuple[str, ...], warnings: Iterable[Warned]
) -> tuple[str, ...]:
    """Lines for the log on warnings whose word is in `accept`; RecordError for any other one."""
    found = tuple(warnings)
    for word, fact in found:
        if word not in accept:
            given = f"give `accept` with {word} (--accept {word} on the command line)"
            remedy = f"; to use it as it is {given}" if word else ""
            raise RecordError(f"{path}: {fact}{remedy}")
    return tuple(f"Accepted: {fact}." for _, fact in found)


def calibrate(
    trace: "Trace", warnings: tuple[Warned, ...], path: Path, options: Reading,
    entry: "IndexEntry | None",
) -> None:  # fmt: skip
    """Bring the samples of a channel to m/s2, upwards, if its unit is known; else add why not."""
    record = trace.stats.record
    record.warnings, record.unit_in_file = warnings, ""
    record.log, record.faults = (tuple(record.get(key, ())) for key in ("log", "faults"))
    if any(word is None for word, _ in warnings):
        return
    values, inventory = np.asarray(trace.data, dtype=np.float64), None
    try:
        if record.get("unit") in (None, "", "counts"):
            inventory = find_inventory(path, trace, options.inventory)
        trace.data, record.unit_in_file, log = _scaled(trace, path, options.unit, entry, inventory)
        record.log += log
    except RecordError as error:
        record.warnings = (*warnings, (None, str(error).removeprefix(f"{path}: ")))
    mean = float(values.mean())
    motion = float(np.abs(values - mean).max())
    if abs(mean) > motion > 0.0:
        unit = record.unit_in_file or "unit unknown"
        offset = f"the offset of the samples, {mean:.4g}, is larger than their motion about it"
        record.faults += (f"{offset}, {motion:.4g} [{unit} in the file]",)
    if not record.unit_in_file:
        return
    code = channel_code(trace)
    if record.get("sensor") == "borehole":
        record.log += (f"Channel {code} is in the borehole, not at the surface.",)
    down = code.upper().lstrip("+").startswith(("DWN", "DOWN", "-UP"))
    if inventory is not None:
        down = False
        with contextlib.suppress(Exception):  # obspy's, of a channel that is not in it
            dip = inventory.get_orientation(trace.id, trace.stats.starttime).get("dip")
            down = (dip or 0.0) > 0.0
    if is_vertical(trace) and down:
        trace.data = -trace.data
        record.log += (f"Sign of {code} changed: it counts downwards.",)


def _scaled(
    trace: "Trace", path: Path, unit: str | None, entry: "IndexEntry | None",
    inventory: "Inventory | None",
) -> _Scaled:  # fmt: skip
    """Samples in m/s2, their unit in the file, and what was done to them.

    The first source that states a unit counts: the file's header; the index that lists the file;
    the K-NET scale factor (which obspy leaves in ``stats.calib``, not applied); StationXML; the
    sensitivities in a COSMOS header; the user. Records of counts and uncorrected volumes are
    demeaned: their offset is the instrument's and can exceed the motion.
    """
    record = trace.stats.record
    if unit is not None:
        unit_factor(unit, str(path))
    known, source = record.get("unit"), f"{trace.stats._format} header"
    if known in (None, "", "counts"):
        known, source = (entry.unit if entry else ""), "index"
    counts = None if known else _of_counts(trace, path, inventory)
    if known or counts:
        if known:
            stated = f"the {source} states {known!r}"
            same = unit and METRES_PER_SECOND_SQUARED[unit] == unit_factor(known, source)
        else:
            stated = f"the file holds counts and there is {counts and counts[1]}"
            same = unit == "m/s2" and trace.stats._format == "KNET"
        if unit and not same:
            raise RecordError(f"{path}: unit {unit!r} asked for but {stated}; leave `unit` out")
        unit = known or "counts"
    if unit is None:
        raise RecordError(
            f"{path}: the file does not state the unit of its samples; give `unit`, one of "
            f"{', '.join(METRES_PER_SECOND_SQUARED)} (--unit on the command line), or for counts "
            f"its StationXML as {path.stem}.xml beside it or by `inventory` (--inventory on the "
            "command line)"
        )
    if counts:
        factor, raw = counts[0], "Mean removed"
        done = f"Converted from counts to m/s2 by {counts[1]}, factor {factor:.9g}."
    else:
        factor = METRES_PER_SECOND_SQUARED[unit]
        raw = "Uncorrected: mean removed" if record.get("level") == "raw" else ""
        how = f"{unit} from the {source}" if known else f"{unit} as asked for"
        done = f"Converted to m/s2: unit {how}, factor {factor:g}."
    samples = np.asarray(trace.data, dtype=np.float64) * factor
    if raw:
        mean = float(samples.mean())
        return samples - mean, unit, (done, f"{raw} ({mean:.6g} m/s2).")
    if not known and trace.stats.calib != 1.0:
        kept = f"Calibration factor {trace.stats.calib:g} of the file not applied."
        return samples, unit, (done, kept)
    return samples, unit, (done,)


def _of_counts(
    trace: "Trace", path: Path, inventory: "Inventory | None"
) -> tuple[float, str] | None:
    """The factor from counts to m/s2 and its source, None if nothing states one."""
    if trace.stats._format == "KNET":
        return float(trace.stats.calib), "the file's scale factor"
    if inventory is not None:
        channel = f"{path}: channel {trace.id}"
        try:
            response = inventory.get_response(trace.id, trace.stats.starttime)
            overall = response.instrument_sensitivity
        except Exception:
            none = f"the StationXML has no response for channel {trace.id}"
            raise RecordError(f"{path}: {none} at {trace.stats.starttime}") from None
        unit = (overall.input_units or "").upper() if overall else ""
        if unit not in _ACCELERATION_UNITS:
            raise RecordError(f"{channel} measures {unit or 'no unit'} in StationXML, not M/S**2")
        value = overall.value
        if not (value and np.isfinite(value)):
            raise RecordError(f"{channel} has the sensitivity {value}")
        return 1.0 / value, f"the sensitivity {value:.6g} counts/(m/s2) of its StationXML"
    if per_count := trace.stats.record.get("g_per_count"):
        text = f"the sensitivity {1.0 / per_count:.6g} counts/g of its header"
        return per_count * STANDARD_GRAVITY, text
    return None


def find_inventory(path: Path, trace: "Trace", given: "Given") -> "Inventory | None":
    """StationXML for a trace: as given, or NAME.xml or NET.STA.xml in the folder of the record."""
    from obspy import read_inventory

    from archfrag.motions.formats import reason_of

    if not (given is None or isinstance(given, (str, Path))):
        return given
    names = (path.stem, f"{trace.stats.network}.{trace.stats.station}")
    near = (path.with_name(f"{name}.xml") for name in names)
    file = given or next((candidate for candidate in near if candidate.is_file()), None)
    if file is None:
        return None
    content = read_bytes(Path(file), LARGEST_INVENTORY, RecordError, "the StationXML file")
    try:
        # From memory: obspy takes a path for a pattern or an address, and unpacks archives.
        return read_inventory(io.BytesIO(content), format="STATIONXML")
    except Exception as error:
        raise RecordError(f"{file}: cannot be read as StationXML ({reason_of(error)})") from None
