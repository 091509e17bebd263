"""The unit of what obspy has read: taken from the file or what lies beside it, or demanded."""

import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from obspy import Inventory, Trace, read_inventory

from archfrag.errors import RecordError
from archfrag.files import read_bytes
from archfrag.motions.index import IndexEntry
from archfrag.motions.plausible import LARGEST_INVENTORY
from archfrag.motions.units import METRES_PER_SECOND_SQUARED, STANDARD_GRAVITY, unit_factor

_ACCELERATION_UNITS = {"M/S**2", "M/S^2", "M/S2", "M/S/S", "M/(S**2)", "M/SEC**2", "M/SEC/SEC"}


class Calibrated(NamedTuple):
    """Samples in m/s2, the unit they had in the file, and what was done to them."""

    samples: NDArray[np.float64]
    unit_in_file: str
    log: tuple[str, ...]


def calibrate(
    trace: Trace, path: Path, unit: str | None, entry: IndexEntry | None, given: Any
) -> Calibrated:
    """Samples in m/s2, by the first that is known of the sources of a unit.

    They are the file's header; the index that lists the file; the K-NET scale factor (which obspy
    leaves in ``stats.calib`` as m/s2 a count, not applied); the instrument's sensitivity in
    StationXML, `given` or beside the file; the sensitivities in a COSMOS header; the argument
    `unit`. Records of counts and uncorrected volumes are demeaned: their offset is the
    instrument's and can exceed the motion.
    """
    if unit is not None:
        unit_factor(unit, str(path))
    record, own = trace.stats.get("record", {}), trace.stats.get("record", {}).get("unit")
    known, source = own, f"{trace.stats.get('_format', '')} header"
    if own in (None, "", "counts"):
        known, source = (entry.unit if entry else ""), "index"
    if known:
        if unit and METRES_PER_SECOND_SQUARED[unit] != unit_factor(known, source):
            raise _superfluous(path, unit, f"the {source} states {known!r}")
        return _from_unit(trace, known, f"unit {known} from the {source}")
    counts: tuple[float, str] | None = None
    if trace.stats.get("_format") == "KNET":
        counts = float(trace.stats.calib), "the file's scale factor"
        unit = None if unit == "m/s2" else unit
    elif (inventory := find_inventory(path, trace, given)) is not None:
        value = _sensitivity(trace, path, inventory)
        counts = 1.0 / value, f"the sensitivity {value:.6g} counts/(m/s2) of its StationXML"
    elif per_count := record.get("g_per_count"):
        text = f"the sensitivity {1.0 / per_count:.6g} counts/g of its header"
        counts = per_count * STANDARD_GRAVITY, text
    if counts is not None:
        if unit is not None:
            raise _superfluous(path, unit, f"the file holds counts and there is {counts[1]}")
        return _from_counts(trace, *counts)
    if unit is not None:
        calibrated = _from_unit(trace, unit, f"unit {unit} as asked for")
        if trace.stats.calib != 1.0:
            note = f"Calibration factor {trace.stats.calib:g} of the file not applied."
            calibrated = calibrated._replace(log=(*calibrated.log, note))
        return calibrated
    raise RecordError(
        f"{path}: the file does not state the unit of its samples; give `unit`, one of "
        f"{', '.join(METRES_PER_SECOND_SQUARED)} (--unit on the command line), or for counts its "
        f"StationXML as {path.stem}.xml beside it or by `inventory` (--inventory on the command "
        "line)"
    )


def find_inventory(path: Path, trace: Trace, given: Any) -> Inventory | None:
    """StationXML for a trace: as given, or NAME.xml or NET.STA.xml in the folder of the record."""
    if isinstance(given, Inventory):
        return given
    if given is not None:
        return _inventory(Path(given))
    names = (path.stem, path.name, f"{trace.stats.network}.{trace.stats.station}")
    beside = (path.with_name(f"{name}.xml") for name in names)
    found = next((candidate for candidate in beside if candidate.is_file()), None)
    return None if found is None else _inventory(found)


def points_down(trace: Trace, path: Path, given: Any) -> bool:
    """Whether a vertical channel counts downwards as positive."""
    stated = trace.stats.get("record", {}).get("unit", "counts") != "counts"
    inventory = None if stated else find_inventory(path, trace, given)
    if inventory is None:
        return channel_code(trace).upper().lstrip("+").startswith(("DWN", "DOWN", "-UP"))
    try:
        dip = inventory.get_orientation(trace.id, trace.stats.starttime).get("dip")
    except Exception:
        return False
    return (dip or 0.0) > 0.0


def channel_code(trace: Trace) -> str:
    """Name of the component: by the header of the record, or the channel code."""
    return str(trace.stats.get("record", {}).get("component", trace.stats.channel)).strip()


def _superfluous(path: Path, unit: str, reason: str) -> RecordError:
    return RecordError(f"{path}: unit {unit!r} was asked for but {reason}; leave `unit` out")


def _inventory(path: Path) -> Inventory:
    content = read_bytes(path, LARGEST_INVENTORY, RecordError, "the StationXML file")
    try:
        # From memory: obspy takes a path for a pattern or an address, and unpacks archives.
        return read_inventory(io.BytesIO(content), format="STATIONXML")
    except Exception as error:
        reason = [*str(error).splitlines(), type(error).__name__][0]
        raise RecordError(f"{path}: cannot be read as StationXML ({reason})") from None


def _from_unit(trace: Trace, unit: str, how: str) -> Calibrated:
    factor = METRES_PER_SECOND_SQUARED[unit]
    samples = np.asarray(trace.data, dtype=np.float64) * factor
    log: tuple[str, ...] = (f"Converted to m/s2: {how}, factor {factor:g}.",)
    if trace.stats.get("record", {}).get("level") == "raw":
        mean = float(samples.mean())
        samples, log = samples - mean, (*log, f"Uncorrected: mean removed ({mean:.6g} m/s2).")
    return Calibrated(samples, unit, log)


def _from_counts(trace: Trace, factor: float, how: str) -> Calibrated:
    samples = np.asarray(trace.data, dtype=np.float64) * factor
    mean = float(samples.mean())
    done = f"Converted from counts to m/s2 by {how}, factor {factor:.9g}."
    return Calibrated(samples - mean, "counts", (done, f"Mean removed ({mean:.6g} m/s2)."))


def _sensitivity(trace: Trace, path: Path, inventory: Inventory) -> float:
    try:
        overall = inventory.get_response(trace.id, trace.stats.starttime).instrument_sensitivity
    except Exception:
        place = f"channel {trace.id} at {trace.stats.starttime}"
        raise RecordError(f"{path}: the StationXML has no response for {place}") from None
    unit = (overall.input_units or "").upper() if overall else ""
    if unit not in _ACCELERATION_UNITS:
        raise RecordError(
            f"{path}: channel {trace.id} measures {unit or 'an unknown unit'} by its StationXML; "
            "an accelerometer (M/S**2) is needed"
        )
    if not (overall.value and np.isfinite(overall.value)):
        raise RecordError(f"{path}: the sensitivity of channel {trace.id} is {overall.value}")
    return float(overall.value)
