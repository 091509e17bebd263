"""The unit of what obspy has read: taken from the file or what lies beside it, or demanded."""

import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from obspy import Inventory, Trace, read_inventory

from archfrag.errors import RecordError
from archfrag.motions.index import IndexEntry
from archfrag.motions.units import METRES_PER_SECOND_SQUARED, unit_factor

_ACCELERATION_UNITS = {"M/S**2", "M/S^2", "M/S2", "M/S/S", "M/(S**2)", "M/SEC**2", "M/SEC/SEC"}


class Calibrated(NamedTuple):
    """Samples in m/s2, the unit they had in the file, and what was done to them."""

    samples: NDArray[np.float64]
    unit_in_file: str
    log: tuple[str, ...]


def calibrate(
    trace: Trace,
    path: Path,
    unit: str | None,
    entry: IndexEntry | None,
    inventory: Inventory | None,
) -> Calibrated:
    """Turn the samples of a trace into m/s2.

    The unit comes from the first of: the AT2 header; the K-NET scale factor (which obspy leaves
    in ``stats.calib`` as m/s2 a count, not applied); the index that lists the file; the
    instrument's sensitivity in StationXML; the argument `unit`. Records of counts are demeaned:
    their offset is the instrument's and can exceed the motion.

    Raises
    ------
    RecordError
        If no unit is known, the one asked for contradicts the file, or the StationXML does not
        describe this channel as an accelerometer.
    """
    if unit is not None:
        unit_factor(unit, str(path))
    known, source = _stated_unit(trace, entry)
    if known is not None:
        if unit is not None and METRES_PER_SECOND_SQUARED[unit] != unit_factor(known, source):
            raise RecordError(
                f"{path}: unit {unit!r} was asked for but the {source} says {known!r}; leave "
                "`unit` out"
            )
        return _from_unit(trace, known, f"unit {known} from the {source}")
    if trace.stats.get("_format") == "KNET":
        if unit not in (None, "m/s2"):
            raise RecordError(
                f"{path}: unit {unit!r} was asked for but a K-NET file has its own scale factor; "
                "leave `unit` out"
            )
        return _demeaned(trace, float(trace.stats.calib), "counts", "the file's scale factor")
    if inventory is not None:
        if unit is not None:
            raise RecordError(
                f"{path}: unit {unit!r} was asked for but StationXML gives the sensitivity; use "
                "one of the two"
            )
        sensitivity = _sensitivity(trace, path, inventory)
        text = f"the sensitivity {sensitivity:.6g} counts/(m/s2) of its StationXML"
        return _demeaned(trace, 1.0 / sensitivity, "counts", text)
    if unit is not None:
        calibrated = _from_unit(trace, unit, f"unit {unit} as asked for")
        if trace.stats.calib != 1.0:
            note = f"Calibration factor {trace.stats.calib:g} of the file not applied."
            calibrated = calibrated._replace(log=(*calibrated.log, note))
        return calibrated
    allowed = ", ".join(METRES_PER_SECOND_SQUARED)
    raise RecordError(
        f"{path}: the file does not say the unit of its samples; give `unit`, one of {allowed} "
        f"(--unit on the command line), or for counts its StationXML as {path.stem}.xml beside it "
        "or by `inventory` (--inventory on the command line)"
    )


def find_inventory(path: Path, trace: Trace, given: Any) -> Inventory | None:
    """StationXML for a trace: as given, or NAME.xml or NET.STA.xml in the folder of the record.

    Raises
    ------
    RecordError
        If the StationXML that is there or was given cannot be read.
    """
    if isinstance(given, Inventory):
        return given
    if given is not None:
        return _inventory(Path(given))
    names = (path.stem, path.name, f"{trace.stats.network}.{trace.stats.station}")
    for name in dict.fromkeys(names):
        candidate = path.with_name(f"{name}.xml")
        if candidate.is_file():
            return _inventory(candidate)
    return None


def points_down(trace: Trace, inventory: Inventory | None) -> bool:
    """Tell whether a vertical channel counts downwards as positive."""
    if inventory is not None:
        try:
            orientation = inventory.get_orientation(trace.id, trace.stats.starttime)
        except Exception:
            return False
        return (orientation.get("dip") or 0.0) > 0.0
    return channel_code(trace).upper().lstrip("+").startswith(("DWN", "DOWN", "-UP"))


def channel_code(trace: Trace) -> str:
    """Name of the component: of the AT2 header, or the channel code."""
    details = trace.stats.get("at2")
    return str(details.component if details else trace.stats.channel).strip()


def _inventory(path: Path) -> Inventory:
    if not path.is_file():
        raise RecordError(f"{path}: there is no such StationXML file")
    try:
        # From memory: obspy takes a path for a pattern or an address, and unpacks archives.
        return read_inventory(io.BytesIO(path.read_bytes()), format="STATIONXML")
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path}: cannot be read as StationXML ({reason})") from None


def _stated_unit(trace: Trace, entry: IndexEntry | None) -> tuple[str | None, str]:
    details = trace.stats.get("at2")
    if details:
        return str(details.unit), "AT2 header"
    if entry is not None and entry.unit:
        return entry.unit, "index"
    return None, ""


def _from_unit(trace: Trace, unit: str, how: str) -> Calibrated:
    factor = METRES_PER_SECOND_SQUARED[unit]
    samples = np.asarray(trace.data, dtype=np.float64) * factor
    return Calibrated(samples, unit, (f"Converted to m/s2: {how}, factor {factor:g}.",))


def _demeaned(trace: Trace, factor: float, unit: str, how: str) -> Calibrated:
    samples = np.asarray(trace.data, dtype=np.float64) * factor
    mean = float(samples.mean())
    log = (
        f"Converted from {unit} to m/s2 by {how}, factor {factor:.9g}.",
        f"Mean removed ({mean:.6g} m/s2).",
    )
    return Calibrated(samples - mean, unit, log)


def _sensitivity(trace: Trace, path: Path, inventory: Inventory) -> float:
    try:
        response = inventory.get_response(trace.id, trace.stats.starttime)
    except Exception:
        raise RecordError(
            f"{path}: the StationXML has no response for channel {trace.id} at "
            f"{trace.stats.starttime}"
        ) from None
    overall = response.instrument_sensitivity
    unit = (overall.input_units or "").upper() if overall else ""
    if unit not in _ACCELERATION_UNITS:
        raise RecordError(
            f"{path}: channel {trace.id} measures {unit or 'an unknown unit'} by its StationXML; "
            "an accelerometer (M/S**2) is needed"
        )
    if not (overall.value and np.isfinite(overall.value)):
        raise RecordError(f"{path}: the sensitivity of channel {trace.id} is {overall.value}")
    return float(overall.value)
