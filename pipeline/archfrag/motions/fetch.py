"""Records of earthquakes from data centres: miniSEED, StationXML and an index in one folder.

For each event a folder with ``event.xml`` (QuakeML), one miniSEED file for each station, in
counts, and its responses as ``NET.STA.xml`` beside it. obspy's FDSN client does the asking.
"""

import re
from collections.abc import Callable, Iterator
from http.client import HTTPException
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from obspy.clients.fdsn import Client
from obspy.clients.fdsn import header as fdsn
from obspy.geodetics import gps2dist_azimuth, kilometers2degrees

from archfrag.errors import InputError, RecordError
from archfrag.files import make_folder, sha256_of, sweep, temporary_folder
from archfrag.motions.index import index_table, write_index
from archfrag.motions.read import read_motions

MOST_FAILURES = 3  # one after the other, after which a service is left alone
PASSING = ("timeout", "service")  # kinds of failure after which another attempt may help
_NAME = re.compile(r"[A-Za-z0-9_-]{1,16}\.[A-Za-z0-9_-]{1,16}")
_KINDS = (
    (fdsn.FDSNNoDataException, "no data"), (fdsn.FDSNRequestTooLargeException, "too large"),
    ((fdsn.FDSNTimeoutException, TimeoutError), "timeout"),
    ((fdsn.FDSNBadRequestException, fdsn.FDSNUnauthorizedException, fdsn.FDSNForbiddenException,
      fdsn.FDSNNotImplementedException), "unusable"),
    ((fdsn.FDSNException, HTTPException, OSError), "service"),
)  # fmt: skip


class Request(NamedTuple):
    """What to ask `stations_from` for each event, by its identifier at `events_from`.

    Stations within `radius` [km] of the epicentre, the nearest first and `most` in number; of
    each the first kind of `channels` that it has, from `before` to `after` [s] about the origin
    time. `timeout` [s] is for one wait.
    """

    events: tuple[str, ...]
    stations_from: str
    events_from: str = "USGS"
    radius: float = 100.0
    channels: tuple[str, ...] = ("HN", "EN", "BN")
    before: float = 30.0
    after: float = 180.0
    most: int = 100
    timeout: float = 60.0


class Failure(Exception):
    """Why something did not come: its kind (``no data``, ``service`` and so on) and a message."""


def fetch_records(request: Request, folder: str | Path) -> Iterator[tuple[str, str]]:
    """Fetch records of events into a folder; a station that is complete is not asked for again.

    Yields ``new`` or ``kept`` and the id of a record, or the kind of a failure and a message.
    InputError if a service is unknown, RecordError if the folder's index cannot be used.
    """
    try:
        quakes, archive = (
            Client(name, timeout=request.timeout, _discover_services=False)
            for name in (request.events_from, request.stations_from)
        )
    except ValueError as error:
        raise InputError(str(error)) from None
    root = make_folder(Path(folder))
    rows: dict[str, dict[str, Any]] = dict(index_table(root))
    for event in request.events:
        place, in_a_row = make_folder(root / re.sub(r"[^A-Za-z0-9_-]+", "-", event)[:60]), 0
        sweep(place)
        try:
            sites = _sites(request, quakes, archive, event, place)
        except Failure as failure:
            yield failure.args[0], f"event {event}: {failure.args[1]}"
            continue
        for site in sites[: request.most]:
            same = {key: site[key] for key in ("event", "station", "window_s")}
            there = [row for row in rows.values() if same.items() <= row.items()]
            files = [(root / row["file"], row["sha256"]) for row in there]
            if files and all(
                path.is_file() and sha256_of(path) == digest
                and path.with_name(f"{site['station']}.xml").is_file() for path, digest in files
            ):  # fmt: skip
                yield "kept", there[0]["id"]
                continue
            try:
                row = _fetched(request, archive, site, place)
            except Failure as failure:
                yield failure.args[0], f"{event} {site['station']}: {failure.args[1]}"
                in_a_row = in_a_row + 1 if failure.args[0] in PASSING else 0
                if in_a_row == MOST_FAILURES:
                    yield "service", f"event {event}: {in_a_row} requests in a row failed"
                    break
                continue
            in_a_row, rows[row["id"]] = 0, row
            write_index(root, [rows[key] for key in sorted(rows)])
            yield "new", row["id"]


def _ask(method: Callable[..., Any], **query: Any) -> Any:
    try:
        return method(**query)
    except Exception as error:
        kind = next((kind for kinds, kind in _KINDS if isinstance(error, kinds)), "unusable")
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        service = method.__self__.base_url  # type: ignore[attr-defined]
        raise Failure(kind, f"{service}: {reason}") from None


def _sites(request: Request, quakes: Client, archive: Client, id: str, place: Path) -> list[dict]:
    """Columns of the index for the stations of an event, the nearest first, and what to ask."""
    catalogue = _ask(quakes.get_events, eventid=id)
    catalogue.write(str(place / "event.xml"), "QUAKEML")
    origin = catalogue[0].preferred_origin() or next(iter(catalogue[0].origins), None)
    if origin is None or None in (origin.time, origin.latitude, origin.longitude):
        raise Failure("unusable", f"{quakes.base_url}: the event has no origin")
    preferred = catalogue[0].preferred_magnitude()
    magnitudes = list(filter(None, (preferred, *catalogue[0].magnitudes)))
    moments = (m.mag for m in magnitudes if (m.magnitude_type or "").lower().startswith("mw"))
    window = {"starttime": origin.time - request.before, "endtime": origin.time + request.after}
    epicentre = float(origin.latitude), float(origin.longitude)
    depth = None if origin.depth is None else float(origin.depth) / 1000.0
    event = {
        "event": id, "Mw": next(moments, None), "origin_time": str(origin.time),
        "event_latitude": epicentre[0], "event_longitude": epicentre[1], "depth_km": depth,
        "magnitude": magnitudes[0].mag if magnitudes else None,
        "window_s": f"-{request.before:g} {request.after:g}", "window": window,
    }  # fmt: skip
    inventory = _ask(
        archive.get_stations, level="channel", latitude=epicentre[0], longitude=epicentre[1],
        channel=",".join(f"{kind[:2]}?" for kind in request.channels),
        # Degrees of a sphere; the distance on the ellipsoid decides.
        maxradius=kilometers2degrees(1.01 * request.radius), **window,
    )  # fmt: skip
    sites: dict[str, dict[str, Any]] = {}
    for network, station in [(each, station) for each in inventory for station in each]:
        name, at = f"{network.code}.{station.code}", (station.latitude, station.longitude)
        km = gps2dist_azimuth(*map(float, (*epicentre, *at)))[0] / 1000.0
        site = event | {
            "station": name, "epicentral_km": round(km, 3), "codes": set(),
            "distance_km": None if depth is None else round(float(np.hypot(km, depth)), 3),
            "station_latitude": float(at[0]), "station_longitude": float(at[1]),
            "terms": f"those of network {network.code}, fetched from {request.stations_from}",
        }  # fmt: skip
        codes = {(channel.code[:2], channel.location_code) for channel in station}
        if km <= request.radius and codes:
            sites.setdefault(name, site)["codes"] |= codes  # of all its epochs
    return sorted(sites.values(), key=lambda site: (site["epicentral_km"], site["station"]))


def _fetched(request: Request, archive: Client, site: dict[str, Any], place: Path) -> dict:
    """Fetch what one station recorded, and return its row of the index."""
    if not _NAME.fullmatch(site["station"]):
        raise Failure("unusable", "the codes of this station cannot name a file")
    network, code = site["station"].split(".")
    kinds = [kind[:2] for kind in request.channels]
    own = sorted((kinds.index(kind), where) for kind, where in site["codes"] if kind in kinds)
    with temporary_folder(place) as part:
        for number, location in own:
            id = f"{place.name}_{site['station']}.{location}.{kinds[number]}"
            files = [Path(part) / f"{site['station']}.xml", Path(part) / f"{id}.mseed"]
            wanted = site["window"] | {
                "network": network, "station": code, "location": location or "--",
                "channel": f"{kinds[number]}?",
            }  # fmt: skip
            try:
                _ask(archive.get_waveforms, filename=str(files[1]), **wanted)
                break
            except Failure as failure:
                if failure.args[0] != "no data" or (number, location) == own[-1]:
                    raise
        _ask(archive.get_stations, level="response", filename=str(files[0]), **wanted)
        try:
            motions = read_motions(files[1])
        except RecordError as error:
            raise Failure("unusable", str(error).replace(part, str(place))) from None
        for path in files:
            path.replace(place / path.name)
    about = [motion.metadata for motion in motions]
    codes = dict.fromkeys(m[key] for key in ("component", "vertical_component") for m in about)
    row = {key: value for key, value in site.items() if key not in ("window", "codes")}
    return row | {
        "id": id, "file": f"{place.name}/{id}.mseed", "unit": "", "dt_s": motions[0].dt,
        "sha256": sha256_of(place / f"{id}.mseed"), "channels": " ".join(filter(None, codes)),
        "start_time": about[0].get("start_time", ""),
    }  # fmt: skip
