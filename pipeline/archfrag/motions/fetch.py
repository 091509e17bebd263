"""Records of earthquakes from data centres: miniSEED, StationXML and an index in one folder.

Each event has a folder with ``event.xml`` (QuakeML), one miniSEED file for each station, in
counts, and its responses as ``NET.STA.xml`` beside it.
"""

import re
from collections.abc import Iterator
from http.client import HTTPException
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from obspy.clients.fdsn import Client
from obspy.clients.fdsn import header as fdsn
from obspy.geodetics import gps2dist_azimuth, kilometers2degrees

from archfrag.errors import ArchfragError, InputError, RecordError, ServiceError
from archfrag.files import make_folder, sha256_of, sweep, temporary_folder
from archfrag.motions.index import index_table, write_index
from archfrag.motions.read import read_motions

_KINDS = {ServiceError: "service", RecordError: "unusable", InputError: "no data"}
Site = dict[str, Any]
_NAME = re.compile(r"[A-Za-z0-9_-]{1,16}\.[A-Za-z0-9_-]{1,16}")
_PASSING = (fdsn.FDSNException, HTTPException, OSError)
_REFUSED = (
    fdsn.FDSNBadRequestException, fdsn.FDSNUnauthorizedException, fdsn.FDSNForbiddenException,
    fdsn.FDSNNotImplementedException, fdsn.FDSNRequestTooLargeException,
)  # fmt: skip


class Request(NamedTuple):
    """Query to `stations_from` for each event, by its identifier at `events_from`."""

    events: tuple[str, ...]
    stations_from: str
    events_from: str = "USGS"
    radius: float = 100.0  # of stations about the epicentre [km]
    channels: tuple[str, ...] = ("HN", "EN", "BN")  # kinds; of each station the first it has
    before: float = 30.0  # the origin time [s]
    after: float = 180.0
    most: int = 100  # stations, the nearest first
    timeout: float = 60.0  # for one wait [s]


def fetch_records(request: Request, folder: str | Path) -> Iterator[tuple[str, str]]:
    """Fetch records of events into a folder; a station that is complete is not asked for again.

    Yields ``new`` or ``kept`` and the id of a record, or the kind of a failure and a message.
    InputError if a service is unknown.
    """
    try:
        quakes, archive = (Client(name, timeout=request.timeout, _discover_services=False)
                           for name in (request.events_from, request.stations_from))  # fmt: skip
    except ValueError as error:
        raise InputError(str(error)) from None
    root = make_folder(Path(folder))
    rows: dict[str, dict[str, Any]] = dict(index_table(root))
    for event in request.events:
        place, failed = make_folder(root / re.sub(r"[^A-Za-z0-9_-]+", "-", event)[:60]), 0
        sweep(place)
        name = f"event {event}:"
        try:
            for site in _sites(request, quakes, archive, event, place)[: request.most]:
                name = f"{event} {site['station']}:"
                same = {key: site[key] for key in ("event", "station", "window_s")}
                row = next((r for r in rows.values() if same.items() <= r.items()), None)
                file = root / row["file"] if row else place
                there = file.is_file() and file.with_name(f"{site['station']}.xml").is_file()
                if row and there and sha256_of(file) == row["sha256"]:
                    yield "kept", row["id"]
                    continue
                try:
                    row = _fetched(archive, site, place)
                except (ServiceError, InputError) as error:
                    failed = failed + 1 if isinstance(error, ServiceError) else 0
                    if failed == 3:  # one after the other
                        raise
                    yield _KINDS[type(error)], f"{name} {error}"
                    continue
                failed, rows[row["id"]] = 0, row
                write_index(root, [rows[key] for key in sorted(rows)])
                yield "new", row["id"]
        except (ServiceError, InputError) as error:
            rest = "; this service is left alone" if failed else ""
            yield _KINDS[type(error)], f"{name} {error}{rest}"


def _ask(client: Client, method: str, **query: Any) -> Any:
    try:
        return getattr(client, method)(**query)
    except Exception as error:
        kind: type[ArchfragError] = RecordError
        if isinstance(error, fdsn.FDSNNoDataException):
            kind = InputError
        elif isinstance(error, _PASSING) and not isinstance(error, _REFUSED):
            kind = ServiceError
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise kind(f"{client.base_url}: {reason}") from None


def _sites(request: Request, quakes: Client, archive: Client, id: str, place: Path) -> list[Site]:
    """The stations of an event, the nearest first: columns of the index, and what to ask."""
    catalogue = _ask(quakes, "get_events", eventid=id)
    catalogue.write(str(place / "event.xml"), "QUAKEML")
    quake = catalogue[0]
    origin = quake.preferred_origin() or next(iter(quake.origins), None)
    if origin is None or None in (origin.time, origin.latitude, origin.longitude):
        raise RecordError(f"{quakes.base_url}: the event has no origin")
    sizes = [m for m in (quake.preferred_magnitude(), *quake.magnitudes) if m]
    moments = [m.mag for m in sizes if (m.magnitude_type or "").lower().startswith("mw")]
    window = {"starttime": origin.time - request.before, "endtime": origin.time + request.after}
    epicentre = float(origin.latitude), float(origin.longitude)
    inventory = _ask(
        archive, "get_stations", level="channel", latitude=epicentre[0], longitude=epicentre[1],
        # Degrees of a sphere; the distance on the ellipsoid decides.
        maxradius=kilometers2degrees(1.01 * request.radius), **window,
        channel=",".join(f"{kind[:2]}?" for kind in request.channels),
    )  # fmt: skip
    sites: dict[str, Site] = {}
    for network, station in [(each, station) for each in inventory for station in each]:
        km = gps2dist_azimuth(*epicentre, station.latitude, station.longitude)[0] / 1000.0
        own = [(number, channel.location_code) for number, kind in enumerate(request.channels)
               for channel in station if channel.code[:2] == kind[:2]]  # fmt: skip
        if km > request.radius or not own:
            continue
        number, location = min(own)
        deep = None if origin.depth is None else float(np.hypot(km, origin.depth / 1000.0))
        name = f"{network.code}.{station.code}"
        sites.setdefault(name, {
            "event": id, "Mw": next(iter(moments), None), "origin_time": str(origin.time),
            "magnitude": sizes[0].mag if sizes else None,
            "window_s": f"-{request.before:g} {request.after:g}", "station": name,
            "epicentral_km": round(km, 3), "distance_km": deep and round(deep, 3),
            "terms": f"those of network {network.code}, fetched from {request.stations_from}",
            "query": {"network": network.code, "station": station.code, **window,
                      "location": location or "--", "channel": f"{request.channels[number][:2]}?"},
        })  # fmt: skip
    return sorted(sites.values(), key=lambda site: (site["epicentral_km"], site["station"]))


def _fetched(archive: Client, site: Site, place: Path) -> dict[str, Any]:
    """Fetch what one station recorded, and return its row of the index."""
    if not _NAME.fullmatch(site["station"]):
        raise RecordError("the codes of this station cannot name a file")
    query = site["query"]
    kind = f"{query['location'].strip('-')}.{query['channel'][:2]}"
    id = f"{place.name}_{site['station']}.{kind}"
    with temporary_folder(place) as part:
        xml, record = Path(part) / f"{site['station']}.xml", Path(part) / f"{id}.mseed"
        _ask(archive, "get_waveforms", filename=str(record), **query)
        _ask(archive, "get_stations", filename=str(xml), level="response", **query)
        try:
            motions = read_motions(record)
        except RecordError as error:
            raise RecordError(str(error).replace(part, str(place))) from None
        for path in (xml, record):
            path.replace(place / path.name)
    codes = dict.fromkeys(motion.metadata[key] for key in ("component", "vertical_component")
                          for motion in motions)  # fmt: skip
    return {key: value for key, value in site.items() if key != "query"} | {
        "id": id, "file": f"{place.name}/{id}.mseed", "unit": "", "dt_s": motions[0].dt,
        "sha256": sha256_of(place / f"{id}.mseed"), "channels": " ".join(filter(None, codes)),
        "start_time": motions[0].metadata.get("start_time", ""),
    }  # fmt: skip
