"""The response of an instrument taken off a record, by its StationXML."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from obspy import Inventory, Trace, UTCDateTime

from archfrag.errors import RecordError
from archfrag.motions.calibrate import find_inventory
from archfrag.motions.motion import Motion


def remove_response(
    motion: Motion,
    record: str | Path,
    inventory: str | Path | Inventory | None = None,
    water_level: float = 60.0,
    band: tuple[float, float, float, float] | None = None,
) -> Motion:
    """Divide the spectrum of each component by its instrument's response (obspy).

    Parameters
    ----------
    motion : Motion
        As read by the sensitivity of its StationXML, which is taken back first.
    record : path
        The file it was read from: for messages, and to find the StationXML beside it.
    inventory : path or obspy.Inventory, optional
        StationXML; by default NAME.xml or NET.STA.xml beside the file.
    water_level : float [dB]
        Below its largest value the response counts as this much lower, and no more.
    band : (f1, f2, f3, f4) [Hz], optional
        What to keep: cosine tapers from f1 to f2 and from f3 to f4.

    Raises
    ------
    RecordError
        If there is no StationXML, or it does not describe a channel of the record.
    """
    found: Inventory | None = None
    changed: dict[str, NDArray[np.float64]] = {}
    names = ("trace", "vertical_trace", "trace_across")
    for (key, samples), name in zip(motion.components.items(), names):
        if samples is None:
            continue
        trace = _trace(motion, samples, str(motion.metadata.get(name, "")))
        found = found or find_inventory(Path(record), trace, inventory)
        if found is None:
            raise RecordError(
                f"{record}: has no StationXML by which to remove its response; give `inventory`"
            )
        try:
            trace.data *= found.get_response(
                trace.id, trace.stats.starttime
            ).instrument_sensitivity.value
            trace.remove_response(
                found, output="ACC", water_level=water_level, pre_filt=band, zero_mean=False,
                taper=False,
            )  # fmt: skip
        except Exception as error:
            reason = [*str(error).splitlines(), type(error).__name__][0]
            failed = f"the response of channel {trace.id} cannot be removed"
            raise RecordError(f"{record}: {failed} ({reason})") from None
        changed[key] = np.asarray(trace.data, dtype=np.float64)
    kept = "" if band is None else f", {', '.join(f'{corner:g}' for corner in band)} Hz"
    done = f"Response removed by StationXML (obspy, water level {water_level:g} dB{kept})."
    return motion._replaced(**changed, log=(*motion.log, done))


def _trace(motion: Motion, samples: NDArray[np.float64], name: str) -> Trace:
    parts = (name.split(".") + [""] * 4)[:4]
    header = dict(zip(("network", "station", "location", "channel"), parts))
    start = UTCDateTime(motion.metadata.get("start_time") or 0)
    return Trace(samples.copy(), header={**header, "delta": motion.dt, "starttime": start})
