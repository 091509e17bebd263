"""K-NET and KiK-net files: what obspy's reader leaves out, in ``stats.record``.

A K-NET station has one sensor with channels NS, EW, UD. A KiK-net station has two; the header
numbers the channels 1 to 6 and obspy names them NS1, EW1, UD1 (borehole) and NS2, EW2, UD2
(surface), after the endings of the files (NIED, "About K-NET ASCII format"). Channels of one
sensor belong together, those of the other do not: a borehole motion is not one of the ground's
surface.
"""

from typing import Any

from obspy import Stream
from obspy.core import AttribDict
from obspy.core.util.base import buffered_load_entry_point

from archfrag.motions.formats import facts
from archfrag.motions.formats.text import Source

_AZIMUTHS = {"N": 0.0, "E": 90.0}
_SENSORS = {"": "surface", "1": "borehole", "2": "surface"}


def read_knet(source: Source, **_: Any) -> Stream:
    """Read a K-NET or KiK-net file by obspy's reader and complete what its header says.

    Parameters
    ----------
    source : path or open binary buffer

    Returns
    -------
    obspy.Stream
        One trace of counts, as obspy reads it, with the factor to m/s2 in ``stats.calib``.
        ``stats.record`` has no `unit`; its `sensor` is ``borehole`` or ``surface``.
    """
    read = buffered_load_entry_point("obspy", "obspy.plugin.waveform.KNET", "readFormat")
    stream = read(str(source) if not hasattr(source, "read") else source)
    for trace in stream:
        if "knet" not in trace.stats:
            continue  # the header is cut off, and so is the rest
        knet, component = trace.stats.knet, str(trace.stats.channel)
        record = facts.known(
            level="raw",
            announced=round(knet.duration * trace.stats.sampling_rate),
            component=component,
            vertical=component.startswith("UD"),
            azimuth=_AZIMUTHS.get(component[:1]),
            sensor=_SENSORS.get(component[2:]),
            date=knet.evot.date.isoformat(),
            magnitude=knet.mag,
            depth_km=knet.evdp,
            event_latitude=knet.evla,
            event_longitude=knet.evlo,
            station=trace.stats.station,
            station_latitude=knet.stla,
            station_longitude=knet.stlo,
        )
        facts.judge_peak(record, str(knet.accmax), 100.0 * trace.stats.calib * trace.data, "gal")
        trace.stats.record = AttribDict(record)
    return stream
