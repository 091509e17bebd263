"""A data centre on this machine: event, station and dataselect of the FDSN web services."""

import io
import threading
import time
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

import numpy as np
from obspy import Inventory, Stream, Trace, UTCDateTime
from obspy.core import event
from obspy.core.inventory import Channel, InstrumentSensitivity, Network, Response, Station
from obspy.geodetics import locations2degrees

from .helpers import wave

ORIGIN = UTCDateTime(2020, 1, 1, 12)
EPICENTRE = (40.0, 15.0)
EVENT = "it2020abcd"
SENSITIVITY = 1.0e6  # [counts / (m/s2)]
# Station: degrees north of the epicentre, channels of its instruments by place.
STATIONS = {
    "NEAR": (0.1, {"": ("HNE", "HNN", "HNZ")}),
    "BOTH": (0.2, {"": ("HNE", "HNN", "HNZ", "BNE", "BNN", "BNZ")}),
    "SLOW": (0.3, {"00": ("BNE", "BNN", "BNZ")}),
    "FAR": (3.0, {"": ("HNE", "HNN", "HNZ")}),
}


def quakeml(magnitudes=(("ml", 5.4), ("mww", 5.6)), origins=True):
    """One event as QuakeML; the first magnitude is preferred."""
    origin = event.Origin(time=ORIGIN, latitude=EPICENTRE[0], longitude=EPICENTRE[1], depth=8000.0)
    quake = event.Event(
        resource_id=event.ResourceIdentifier(f"smi:local/{EVENT}"),
        origins=[origin] if origins else [],
        magnitudes=[event.Magnitude(mag=value, magnitude_type=kind) for kind, value in magnitudes],
        event_descriptions=[event.EventDescription("Somewhere, Italy")],
    )
    if magnitudes:
        quake.preferred_magnitude_id = quake.magnitudes[0].resource_id
    return _written(event.Catalog([quake]), "QUAKEML")


def station_xml(stations, responses=True):
    """StationXML of stations by name."""
    rows = []
    for code in stations:
        north, places = STATIONS[code]
        at = {"latitude": EPICENTRE[0] + north, "longitude": EPICENTRE[1], "elevation": 0.0}
        channels = [
            Channel(
                name, place, **at, depth=0.0, azimuth=0.0, dip=-90.0 if name[2] == "Z" else 0.0,
                sample_rate=100.0, start_date=UTCDateTime(2010, 1, 1),
                response=Response(
                    instrument_sensitivity=InstrumentSensitivity(
                        SENSITIVITY, 1.0, "M/S**2", "COUNTS"
                    )
                ) if responses else None,
            )
            for place, names in places.items()
            for name in names
        ]  # fmt: skip
        rows.append(Station(code, **at, channels=channels))
    return _written(Inventory([Network("IV", stations=rows)], source="test"), "STATIONXML")


def miniseed(station, location, channels, start, end, peak=1.0):
    """A wave of `peak` [m/s2] with an offset, in counts, on each channel."""
    count = int((end - start) * 100.0)
    shape = wave(count)
    header = {"network": "IV", "station": station, "location": location, "delta": 0.01}
    traces = [
        Trace(
            np.round((peak * (number + 1) * shape + 0.5) * SENSITIVITY).astype(np.int32),
            {**header, "channel": name, "starttime": start},
        )
        for number, name in enumerate(channels)
    ]
    return _written(Stream(traces), "MSEED")


def _written(data, form):
    buffer = io.BytesIO()
    data.write(buffer, format=form)
    return buffer.getvalue()


class DataCentre:
    """What the server answers; `faults` maps (service, station or '') to an answer of its own.

    A fault is a status, bytes, or a function of the request handler.
    """

    def __init__(self, address):
        self.address = address
        self.asked = []
        self.faults = {}
        self.quakeml = quakeml()

    def count(self, service):
        return sum(name == service for name, _ in self.asked)

    def answer(self, service, query):
        station = query.get("station", "")
        self.asked.append((service, query))
        fault = self.faults.get((service, station))
        if fault is not None:
            return fault
        return getattr(self, service)(query)

    def event(self, query):
        return self.quakeml if query["eventid"] == EVENT else 204

    def station(self, query):
        if query["level"] == "response":
            return station_xml([query["station"]])
        reach = float(query["maxradius"])
        origin = float(query["latitude"]), float(query["longitude"])
        kinds = tuple(pattern[:2] for pattern in query["channel"].split(","))
        near = [
            code
            for code, (north, places) in STATIONS.items()
            if locations2degrees(*origin, EPICENTRE[0] + north, EPICENTRE[1]) <= reach
            and any(name.startswith(kinds) for names in places.values() for name in names)
        ]
        return station_xml(near, responses=False) if near else 204

    def dataselect(self, query):
        location = query["location"].replace("--", "")
        names = STATIONS[query["station"]][1].get(location, ())
        channels = [name for name in names if name[:2] == query["channel"][:2]]
        if not channels:
            return 204
        start, end = (UTCDateTime(query[key]) for key in ("starttime", "endtime"))
        return miniseed(query["station"], location, channels, start, end)


class _Handler(BaseHTTPRequestHandler):
    def do_GET(self):
        parts = urlsplit(self.path)
        root, service, _, method = parts.path.strip("/").split("/")
        assert (root, method) == ("fdsnws", "query")
        query = {key: values[0] for key, values in parse_qs(parts.query).items()}
        answer = self.server.centre.answer(service, query)
        if callable(answer):
            answer(self)
        elif isinstance(answer, int):
            self.send(answer, b"" if answer == 204 else b"the server explains\nat length")
        else:
            self.send(200, answer)

    def send(self, status, body, announced=None):
        self.send_response(status)
        self.send_header("Content-Length", str(len(body) if announced is None else announced))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


def dripping(seconds=30.0, piece=b"x"):
    """An answer of which a byte comes now and then, so that no single wait is long."""

    def answer(handler):
        handler.send(200, b"", announced=10**6)
        end = time.monotonic() + seconds
        try:
            while time.monotonic() < end:
                handler.wfile.write(piece)
                time.sleep(0.05)
        except OSError:
            pass  # the client went away

    return answer


def silent(seconds=5.0):
    """No answer at all for a while."""
    return lambda handler: time.sleep(seconds)


def broken_off(body):
    """An answer that ends before the length it announced."""
    return lambda handler: handler.send(200, body, announced=len(body) + 1000)


def endless(handler):
    """Bytes without end and without a length."""
    handler.send_response(200)
    handler.end_headers()
    try:
        while True:
            handler.wfile.write(b"\0" * 2**16)
    except OSError:
        pass  # the client had enough


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def handle_error(self, *_):
        pass  # a client that went away


@contextmanager
def data_centre():
    """A server on a free port of this machine while the block lasts."""
    server = _Server(("127.0.0.1", 0), _Handler)
    server.centre = DataCentre(f"http://127.0.0.1:{server.server_port}")
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield server.centre
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
