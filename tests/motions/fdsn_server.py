"""A data centre on this machine that speaks the FDSN web services, well or badly.

One event, and stations north of it with accelerometers of 100 samples a second.
"""

import io
import threading
import time
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

import numpy as np
from obspy import Inventory, Stream, Trace, UTCDateTime
from obspy.core import event
from obspy.core.inventory import (
    Channel,
    InstrumentSensitivity,
    Network,
    Response,
    Station,
)

from .helpers import wave

ORIGIN = UTCDateTime(2020, 1, 1, 12)
EPICENTRE = (40.0, 15.0)
EVENT = "it2020abcd"
SENSITIVITY = 1.0e6  # [counts / (m/s2)]
# Station: degrees north of the epicentre, place and kinds of its instruments.
STATIONS = {
    "NEAR": (0.1, "", ("HN",)),
    "BOTH": (0.2, "", ("HN", "BN")),
    "SLOW": (0.3, "00", ("BN",)),
    "FAR": (3.0, "", ("HN",)),
}


def _written(data, form):
    buffer = io.BytesIO()
    data.write(buffer, format=form)
    return buffer.getvalue()


def quakeml(origins=True):
    """One event as QuakeML; the first magnitude is preferred."""
    origin = event.Origin(
        time=ORIGIN, latitude=EPICENTRE[0], longitude=EPICENTRE[1], depth=8000.0
    )
    magnitudes = [
        event.Magnitude(mag=mag, magnitude_type=kind)
        for kind, mag in (("ml", 5.4), ("mww", 5.6))
    ]
    quake = event.Event(
        resource_id=event.ResourceIdentifier(f"smi:local/{EVENT}"),
        origins=[origin] if origins else [],
        magnitudes=magnitudes,
        preferred_magnitude_id=magnitudes[0].resource_id,
    )
    return _written(event.Catalog([quake]), "QUAKEML")


def station_xml(stations, responses=True):
    """StationXML of stations by name."""
    scale = InstrumentSensitivity(SENSITIVITY, 1.0, "M/S**2", "COUNTS")
    response = Response(instrument_sensitivity=scale) if responses else None
    rows = []
    for code in stations:
        north, place, kinds = STATIONS[code]
        at = {
            "latitude": EPICENTRE[0] + north,
            "longitude": EPICENTRE[1],
            "elevation": 0.0,
        }
        channels = [
            Channel(
                kind + letter,
                place,
                **at,
                depth=0.0,
                azimuth=0.0,
                response=response,
                dip=-90.0 if letter == "Z" else 0.0,
                sample_rate=100.0,
                start_date=UTCDateTime(2010, 1, 1),
            )
            for kind in kinds
            for letter in "ENZ"
        ]
        rows.append(Station(code, **at, channels=channels))
    return _written(
        Inventory([Network("IV", stations=rows)], source="test"), "STATIONXML"
    )


def miniseed(station, location, channels, start, end):
    """A wave with an offset, in counts, on each channel."""
    shape = wave(int((end - start) * 100.0))
    header = {"network": "IV", "station": station, "location": location, "delta": 0.01}
    traces = []
    for number, name in enumerate(channels, start=1):
        counts = np.round((number * shape + 0.5) * SENSITIVITY).astype(np.int32)
        traces.append(Trace(counts, {**header, "channel": name, "starttime": start}))
    return _written(Stream(traces), "MSEED")


class DataCentre:
    """What the server answers; `faults` maps (service, station or '') to an answer of its own.

    A fault is a status, bytes, or a function of the request handler.
    """

    def __init__(self, address):
        self.address = address
        self.asked = []
        self.faults = {}

    def answer(self, service, query):
        self.asked.append(service)
        fault = self.faults.get((service, query.get("station", "")))
        return getattr(self, service)(query) if fault is None else fault

    def event(self, query):
        return quakeml() if query["eventid"] == EVENT else 204

    def station(self, query):
        if query["level"] == "response":
            return station_xml([query["station"]])
        radius = float(query["maxradius"])
        near = [code for code, (north, _, _) in STATIONS.items() if north <= radius]
        return station_xml(near, responses=False) if near else 204

    def dataselect(self, query):
        _, place, kinds = STATIONS[query["station"]]
        kind = query["channel"][:2]
        location = query["location"].replace("--", "")
        if kind not in kinds or location != place:
            return 204
        start, end = (UTCDateTime(query[key]) for key in ("starttime", "endtime"))
        return miniseed(
            query["station"], location, [kind + c for c in "ENZ"], start, end
        )


class _Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        parts = urlsplit(self.path)
        root, service, _, method = parts.path.strip("/").split("/")
        assert (root, method) == ("fdsnws", "query")
        query = {key: values[0] for key, values in parse_qs(parts.query).items()}
        answer = self.server.centre.answer(service, query)
        with suppress(OSError):  # the client went away
            if callable(answer):
                answer(self)
            elif isinstance(answer, int):
                self.send(
                    answer, b"" if answer == 204 else b"the server explains\nat length"
                )
            else:
                self.send(200, answer)

    def send(self, status, body, announced=None):
        self.send_response(status)
        self.send_header("Content-Length", str(announced or len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


def silent(handler):
    """No answer at all for a while."""
    time.sleep(5.0)


def broken_off(handler):
    """An answer that ends before the length it announced."""
    handler.send(200, b"abc", announced=1003)


@contextmanager
def data_centre():
    """A server on a free port of this machine while the block lasts."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _Handler) as server:
        server.block_on_close = False
        server.centre = DataCentre(f"http://127.0.0.1:{server.server_port}")
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        try:
            yield server.centre
        finally:
            server.shutdown()
