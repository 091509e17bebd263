"""What StationXML, a header or the user knows of an instrument: unit, sense and response."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from obspy import Inventory, Trace, UTCDateTime, read_inventory

from archfrag.errors import RecordError
from archfrag.files import read_bytes
from archfrag.motions.index import IndexEntry
from archfrag.motions.motion import Motion
from archfrag.motions.partners import channel_code
from archfrag.motions.plausible import LARGEST_INVENTORY
from archfrag.motions.units import METRES_PER_SECOND_SQUARED, STANDARD_GRAVITY, unit_factor

_ACCELERATION_UNITS = {"M/S**2", "M/S^2", "M/S2", "M/S/S", "M/(S**2)", "M/SEC**2", "M/SEC/SEC"}
Calibrated = tuple[NDArray[np.float64], str, tuple[str, ...]]


def calibrate(
    trace: Trace, path: Path, unit: str | None, entry: IndexEntry | None, given: Any
) -> Calibrated:
    """Return samples in m/s2, their unit in the file, and what was done to them.

    The unit comes from the first source that states one: the file's header; the index that lists
    the file; the K-NET scale factor (which obspy leaves in ``stats.calib`` as m/s2 a count, not
    applied); the instrument's sensitivity in StationXML, `given` or beside the file; the
    sensitivities in a COSMOS header; the argument `unit`. Records of counts and uncorrected
    volumes are demeaned: their offset is the instrument's and can exceed the motion.
    """
    if unit is not None:
        unit_factor(unit, str(path))
    record = trace.stats.record
    known, source = record.get("unit"), f"{trace.stats._format} header"
    if known in (None, "", "counts"):
        known, source = (entry.unit if entry else ""), "index"
    if known:
        if unit and METRES_PER_SECOND_SQUARED[unit] != unit_factor(known, source):
            raise _superfluous(path, unit, f"the {source} states {known!r}")
        return _from_unit(trace, known, f"unit {known} from the {source}")
    counts: tuple[float, str] | None = None
    if trace.stats._format == "KNET":
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
        done = f"Converted from counts to m/s2 by {counts[1]}, factor {counts[0]:.9g}."
        samples, mean = _demeaned(np.asarray(trace.data, dtype=np.float64) * counts[0])
        return samples, "counts", (done, f"Mean removed ({mean:.6g} m/s2).")
    if unit is None:
        raise RecordError(
            f"{path}: the file does not state the unit of its samples; give `unit`, one of "
            f"{', '.join(METRES_PER_SECOND_SQUARED)} (--unit on the command line), or for counts "
            f"its StationXML as {path.stem}.xml beside it or by `inventory` (--inventory on the "
            "command line)"
        )
    samples, unit, log = _from_unit(trace, unit, f"unit {unit} as asked for")
    if trace.stats.calib != 1.0:
        log = (*log, f"Calibration factor {trace.stats.calib:g} of the file not applied.")
    return samples, unit, log


def find_inventory(path: Path, trace: Trace, given: Any) -> Inventory | None:
    """StationXML for a trace: as given, or NAME.xml or NET.STA.xml in the folder of the record."""
    if isinstance(given, Inventory):
        return given
    names = (path.stem, path.name, f"{trace.stats.network}.{trace.stats.station}")
    near = (path.with_name(f"{name}.xml") for name in names)
    file = given or next((candidate for candidate in near if candidate.is_file()), None)
    if file is None:
        return None
    content = read_bytes(Path(file), LARGEST_INVENTORY, RecordError, "the StationXML file")
    try:
        # From memory: obspy takes a path for a pattern or an address, and unpacks archives.
        return read_inventory(io.BytesIO(content), format="STATIONXML")
    except Exception as error:
        raise RecordError(f"{file}: cannot be read as StationXML ({_reason(error)})") from None


def points_down(trace: Trace, path: Path, given: Any) -> bool:
    """Whether a vertical channel counts downwards as positive."""
    stated = trace.stats.record.get("unit", "counts") != "counts"
    inventory = None if stated else find_inventory(path, trace, given)
    if inventory is None:
        return channel_code(trace).upper().lstrip("+").startswith(("DWN", "DOWN", "-UP"))
    try:
        dip = inventory.get_orientation(trace.id, trace.stats.starttime).get("dip")
    except Exception:
        return False
    return (dip or 0.0) > 0.0


def remove_response(
    motion: Motion,
    record: str | Path,
    inventory: str | Path | Inventory | None = None,
    water_level: float = 60.0,
    band: tuple[float, float, float, float] | None = None,
) -> Motion:
    """Divide the spectrum of each component by its instrument's response (obspy).

    `motion` is as read from the file `record` by the sensitivity of its StationXML, which is taken
    back first: `inventory`, or NAME.xml or NET.STA.xml beside the file. Below its largest value
    the response counts as `water_level` [dB] lower, and no more. `band` (f1, f2, f3, f4) [Hz] is
    what to keep: cosine tapers from f1 to f2 and from f3 to f4. RecordError if there is no
    StationXML, or it does not describe a channel of the record.
    """
    found: Inventory | None = None
    changed: dict[str, NDArray[np.float64]] = {}
    names = ("trace", "vertical_trace", "trace_across")
    for (key, samples), name in zip(motion.components.items(), names):
        if samples is None:
            continue
        codes = (str(motion.metadata.get(name, "")).split(".") + [""] * 4)[:4]
        header = dict(zip(("network", "station", "location", "channel"), codes))
        start = UTCDateTime(motion.metadata.get("start_time") or 0)
        trace = Trace(samples.copy(), {**header, "delta": motion.dt, "starttime": start})
        found = found or find_inventory(Path(record), trace, inventory)
        if found is None:
            raise RecordError(
                f"{record}: has no StationXML by which to remove its response; give `inventory`"
            )
        try:
            response = found.get_response(trace.id, trace.stats.starttime)
            trace.data *= response.instrument_sensitivity.value
            trace.remove_response(
                found, output="ACC", water_level=water_level, pre_filt=band, zero_mean=False,
                taper=False,
            )  # fmt: skip
        except Exception as error:
            failed = f"the response of channel {trace.id} cannot be removed"
            raise RecordError(f"{record}: {failed} ({_reason(error)})") from None
        changed[key] = np.asarray(trace.data, dtype=np.float64)
    kept = "" if band is None else f", {', '.join(f'{corner:g}' for corner in band)} Hz"
    done = f"Response removed by StationXML (obspy, water level {water_level:g} dB{kept})."
    return motion._replaced(**changed, log=(*motion.log, done))


def _superfluous(path: Path, unit: str, reason: str) -> RecordError:
    return RecordError(f"{path}: unit {unit!r} was asked for but {reason}; leave `unit` out")


def _reason(error: Exception) -> str:
    return [*str(error).splitlines(), type(error).__name__][0]


def _demeaned(samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    mean = float(samples.mean())
    return samples - mean, mean


def _from_unit(trace: Trace, unit: str, how: str) -> Calibrated:
    factor = METRES_PER_SECOND_SQUARED[unit]
    samples = np.asarray(trace.data, dtype=np.float64) * factor
    log: tuple[str, ...] = (f"Converted to m/s2: {how}, factor {factor:g}.",)
    if trace.stats.record.get("level") == "raw":
        samples, mean = _demeaned(samples)
        log = (*log, f"Uncorrected: mean removed ({mean:.6g} m/s2).")
    return samples, unit, log


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
