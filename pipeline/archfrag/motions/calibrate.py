"""Units and senses of records from file, StationXML and user, and checks of plausibility."""

import io
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

import numpy as np

from archfrag.errors import RecordError, reason_of
from archfrag.files import opened, read_bytes
from archfrag.motions import headers
from archfrag.motions.headers import Acceptable, Warned
from archfrag.motions.motion import METRES_PER_SECOND_SQUARED, STANDARD_GRAVITY, unit_factor
from archfrag.motions.partners import Trace, channel_code, is_vertical

Inventory = Any  # obspy's, whose import takes time
_ACCELERATION_UNITS = {"M/S**2", "M/S^2", "M/S2", "M/S/S", "M/(S**2)", "M/SEC**2", "M/SEC/SEC"}
ACCEPTABLE: tuple[Acceptable, ...] = get_args(Acceptable)
LARGEST_RECORD, LARGEST_INVENTORY = 2**27, 50_000_000  # [bytes]


def check_file(path: Path) -> None:
    """Raise RecordError for what cannot be read as a record: a folder, a pipe, an empty file."""
    try:
        str(path).encode()
        with opened(path) as file:
            size = os.fstat(file.fileno()).st_size
    except UnicodeEncodeError:
        shown = os.fsencode(path).decode("utf-8", "backslashreplace")
        raise RecordError(f"{shown}: the name of the file is not in UTF-8; rename it") from None
    except FileNotFoundError:
        raise RecordError(f"{path}: there is no such file") from None
    except OSError as error:
        raise RecordError(f"{path}: the file cannot be read: {error.strerror}") from None
    if not 0 < size <= LARGEST_RECORD:
        many = f"has {size} bytes; a record may have at most {LARGEST_RECORD}"
        raise RecordError(f"{path}: the file {many if size else 'is empty'}")


def accepted_words(words: Iterable[str], place: str) -> tuple[str, ...]:
    """The words of an `accept`, commas or blanks between, in the order of ``ACCEPTABLE``."""
    given = (words if isinstance(words, str) else " ".join(words)).replace(",", " ").split()
    for word in given:
        if word not in ACCEPTABLE:
            raise RecordError(f"{place}: accept {word!r} is not one of {', '.join(ACCEPTABLE)}")
    return tuple(word for word in ACCEPTABLE if word in given)


def implausible(channel: Trace) -> Iterator[Warned]:
    """List what is implausible about a channel in m/s2."""
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
    """Log accepted warnings; RecordError for a warning that is not in `accept`."""
    lines: tuple[str, ...] = ()
    for word, fact in warnings:
        if word not in accept:
            given = f"give `accept` with {word} (--accept {word} on the command line)"
            remedy = f"; to use it as it is {given}" if word else ""
            raise RecordError(f"{path}: {fact}{remedy}")
        lines += (f"Accepted: {fact}.",)
    return lines


def to_si(trace: Trace, path: Path, asked: str | None, listed: str, given: Any) -> None:
    """Bring the samples of a channel to m/s2, upwards, if its unit is known; else add why not.

    `asked` is the user's unit, `listed` that of an index, `given` the user's StationXML.
    """
    record, values, inventory = trace.stats.record, trace.data, None
    record.unit_in_file = ""
    for more in ((), headers.add_stated(trace)):
        record.warnings += tuple(more)
        if any(word is None for word, _ in record.warnings):
            return
    try:
        if record.get("unit") in (None, "", "counts"):
            inventory = find_inventory(path, trace, given)
        if inventory is not None:
            record.warnings += tuple(headers.add_station(trace, inventory))
        _scale(trace, path, asked, listed, inventory)
    except RecordError as error:
        record.warnings += ((None, str(error).removeprefix(f"{path}: ")),)
    mean = float(values.mean())
    motion = float(np.abs(values - mean).max())
    if abs(mean) > motion > 0.0:
        offset = f"the offset of the samples, {mean:.4g}, is larger than their motion about it"
        unit = record.unit_in_file or "unit unknown"
        record.errors += (f"{offset}, {motion:.4g} [{unit} in the file]",)
    if not record.unit_in_file:
        return
    code = channel_code(trace)
    if (sensor := record.get("sensor", "surface")) != "surface":
        where = "is in the borehole, not at the surface" if sensor == "borehole" else sensor
        record.cautions += (f"channel {code} {where}",)
    down = code.upper().lstrip("+").startswith(("DWN", "DOWN", "-UP")) and inventory is None
    if is_vertical(trace) and record.get("downwards", down):
        trace.data = -trace.data
        record.log += (f"Sign of {code} changed: it counts downwards.",)


def _scale(
    trace: Trace, path: Path, asked: str | None, listed: str, inventory: Inventory | None
) -> None:  # fmt: skip
    """Multiply the samples so that they are in m/s2.

    The first source that states a unit counts: the file's header; the index that lists the file;
    the K-NET scale factor (which obspy leaves in ``stats.calib``, not applied); StationXML; the
    sensitivities in a COSMOS header; the user. Records of counts and uncorrected volumes are
    demeaned: their offset is the instrument's and can exceed the motion.
    """
    record, form = trace.stats.record, trace.stats._format
    if asked is not None:
        unit_factor(asked, str(path))
    unit, source = record.get("unit"), f"{form} header"
    if unit in (None, "", "counts"):
        unit, source = listed, "index"
    raw = "Uncorrected: mean removed" if record.get("level") == "raw" else ""
    if unit:
        factor = unit_factor(unit, source)
        same, stated = METRES_PER_SECOND_SQUARED.get(asked or unit) == factor, f"states {unit!r}"
        done = f"Converted to m/s2: unit {unit} from the {source}, factor {factor:g}."
    elif found := _of_counts(trace, path, inventory):
        (factor, source), unit, raw = found, "counts", "Mean removed"
        same, stated = not asked or (asked == "m/s2" and form == "KNET"), "converts its counts"
        done = f"Converted from counts to m/s2 by the {source}, factor {factor:.9g}."
    elif asked:
        unit, factor, same, stated = asked, METRES_PER_SECOND_SQUARED[asked], True, ""
        done = f"Converted to m/s2: unit {unit} as asked for, factor {factor:g}."
    else:
        units = f"one of {', '.join(METRES_PER_SECOND_SQUARED)} (--unit on the command line)"
        need = f"does not state the unit of its samples; give `unit`, {units}, or for counts its"
        if record.get("unit") == "counts":
            need = "states counts and does not state the unit of one; give its"
        place = f"as {path.stem}.xml beside it or by `inventory` (--inventory on the command line)"
        raise RecordError(f"{path}: the file {need} StationXML {place}")
    if record.get("unit") in (None, "", "counts") and unit != "counts":
        record.warnings += tuple(headers.against_the_user(trace, unit))
    if not same:
        conflict = f"unit {asked!r} asked for but the {source} {stated}"
        raise RecordError(f"{path}: {conflict}; leave `unit` out")
    trace.data = trace.data * factor
    record.unit_in_file, record.log = unit, (*record.log, done)
    if raw:
        record.log += (f"{raw} ({trace.data.mean():.6g} m/s2).",)
        trace.data = trace.data - trace.data.mean()


def _of_counts(trace: Trace, path: Path, inventory: Inventory | None) -> tuple[float, str] | None:
    """The factor from counts to m/s2 and its source, None if nothing states one."""
    if trace.stats._format == "KNET":
        return float(trace.stats.calib), "file's scale factor"
    if inventory is not None:
        try:
            response = inventory.get_response(trace.id, trace.stats.starttime)
            overall = response.instrument_sensitivity
            unit, value = (overall.input_units or "").upper(), float(overall.value)
            out = (overall.output_units or "COUNTS").upper()
        except Exception:
            none = f"the StationXML has no response for channel {trace.id}"
            raise RecordError(f"{path}: {none} at {trace.stats.starttime}") from None
        counts = re.search("COUNT|CNT|DIGIT", out) is not None
        if unit not in _ACCELERATION_UNITS or not (counts and value and np.isfinite(value)):
            what = f"channel {trace.id} has {value:g} {out.lower()}/({unit}) in StationXML"
            raise RecordError(f"{path}: {what}; counts/(M/S**2) are needed")
        return 1.0 / value, f"sensitivity {value:.6g} counts/(m/s2) of its StationXML"
    if per_count := trace.stats.record.get("g_per_count"):
        text = f"sensitivity {1.0 / per_count:.6g} counts/g of its header"
        return per_count * STANDARD_GRAVITY, text
    return None


def find_inventory(path: Path, trace: Trace, given: Any) -> Inventory | None:
    """StationXML for a trace: as given, or NAME.xml or NET.STA.xml in the folder of the record."""
    from obspy import read_inventory

    if not (given is None or isinstance(given, (str, Path))):
        return given
    names = (path.stem, f"{trace.stats.network}.{trace.stats.station}")
    near = (path.with_name(f"{name}.xml") for name in names)
    if not (file := given or next((each for each in near if each.is_file()), None)):
        return None
    content = read_bytes(Path(file), LARGEST_INVENTORY, RecordError, "the StationXML file")
    try:
        # From memory: obspy takes a path for a pattern or an address, and unpacks archives.
        return read_inventory(io.BytesIO(content), format="STATIONXML")
    except Exception as error:
        raise RecordError(f"{file}: cannot be read as StationXML ({reason_of(error)})") from None
