"""Records of earthquakes from data centres: miniSEED, StationXML and an index in one folder.

Each event has a folder with ``event.xml`` (QuakeML), one miniSEED file for each station, in
counts, and its responses as ``NET.STA.xml`` beside it.
"""

import re
from collections.abc import Iterator, Sequence
from http.client import HTTPException
from pathlib import Path
from typing import Any

import numpy as np
from obspy.clients.fdsn import Client
from obspy.clients.fdsn import header as fdsn
from obspy.geodetics import gps2dist_azimuth, kilometers2degrees

from archfrag.errors import InputError, RecordError, ServiceError
from archfrag.files import (
    Named,
    check_targets,
    make_folder,
    register,
    replacing,
    sha256_of,
    sweep,
    temporary_folder,
)
from archfrag.motions.index import INDEX_NAME, index_table, write_index
from archfrag.motions.read import read_horizontals

_KINDS = {ServiceError: "service", RecordError: "unusable", InputError: "no data"}
# What obspy raises and what it means here: no data, refused, or a service that fails for now.
_ERRORS: tuple[tuple[Any, Any], ...] = (
    (fdsn.FDSNNoDataException, InputError),
    (
        (
            fdsn.FDSNBadRequestException,
            fdsn.FDSNUnauthorizedException,
            fdsn.FDSNForbiddenException,
            fdsn.FDSNNotImplementedException,
            fdsn.FDSNRequestTooLargeException,
        ),
        RecordError,
    ),
    ((fdsn.FDSNException, HTTPException, OSError), ServiceError),
)


def fetch_records(
    folder: Path,
    events: Sequence[str],
    services: tuple[str, str],
    most: int,
    timeout: float = 60.0,
    **where,
) -> Iterator[tuple[str, str]]:
    """Fetch records of events into a folder; yield what became of each.

    `services` are the names of the service of stations and of that of events. At most `most`
    stations of an event are asked for, the nearest ones, and none again whose files are complete.
    `timeout` is that of a request [s]. `where` are other options of ``archfrag records fetch``.
    Yields ``new`` or ``kept`` with the id of a record, or the kind of a failure with a message.
    After three failures of a service in a row the rest of the event is left out. InputError if a
    service is unknown.
    """
    try:
        archive, quakes = (
            Client(name, timeout=timeout, _discover_services=False) for name in services
        )
    except ValueError as error:
        raise InputError(str(error)) from None
    check_targets([Path(folder, INDEX_NAME)])
    root = make_folder(Path(folder))
    rows = dict[str, Named](index_table(folder))
    for event in events:
        place = make_folder(root / re.sub(r"[^A-Za-z0-9_-]+", "-", event)[:60])
        failed = 0
        sweep(place)
        try:
            sites = _sites(quakes, archive, event, place, **where)[:most]
        except (ServiceError, InputError) as error:
            yield _KINDS[type(error)], f"event {event}: {error}"
            continue
        for site in sites:
            same = {key: site[key] for key in ("event", "station", "window_s")}
            known = (row for row in rows.values() if same.items() <= row.items())
            row = next(known, {})
            file = root / row.get("file", "")
            there = (
                file.is_file() and (file.parent / f"{site['station']}.xml").is_file()
            )
            if there and sha256_of(file) == row["sha256"]:
                yield "kept", row["id"]
                continue
            try:
                row = _fetched(archive, site, place, bool(row))
            except (ServiceError, InputError) as error:
                failed = failed + 1 if isinstance(error, ServiceError) else 0
                rest = "; this service is left alone" if failed == 3 else ""
                yield _KINDS[type(error)], f"{event} {site['station']}: {error}{rest}"
                if rest:
                    break
                continue
            failed = 0
            rows[row["id"]] = row
            write_index(root, [rows[key] for key in sorted(rows)])
            yield "new", row["id"]


def _ask(client: Client, method: str, **query):
    try:
        return getattr(client, method)(**query)
    except Exception as error:
        kinds = (kind for errors, kind in _ERRORS if isinstance(error, errors))
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise next(kinds, RecordError)(f"{client.base_url}: {reason}") from None


def _sites(
    quakes: Client,
    archive: Client,
    id: str,
    place: Path,
    *,
    radius: float,
    channels: Sequence[str],
    before: float,
    after: float,
) -> list[Named]:
    """Return the stations within a `radius` [km] of an event, nearest first; write ``event.xml``.

    Each is a mapping of columns of the index, with the query for its record under ``query``.
    `channels` are kinds of channels, the preferred one first. Records last from `before` [s]
    before the origin time to `after` [s] after it.
    """
    quake = _ask(quakes, "get_events", eventid=id)[0]
    check_targets([place / "event.xml"])
    with replacing(place / "event.xml") as part:
        quake.write(str(part), "QUAKEML")
    origin = quake.preferred_origin() or next(iter(quake.origins), None)
    if origin is None or None in (origin.time, origin.latitude, origin.longitude):
        raise RecordError(f"{quakes.base_url}: the event has no origin")
    sizes = [m for m in (quake.preferred_magnitude(), *quake.magnitudes) if m]
    moments = [m.mag for m in sizes if str(m.magnitude_type).lower()[:2] == "mw"]
    window = {"starttime": origin.time - before, "endtime": origin.time + after}
    epicentre = float(origin.latitude), float(origin.longitude)
    inventory = _ask(
        archive,
        "get_stations",
        level="channel",
        latitude=epicentre[0],
        longitude=epicentre[1],
        # Degrees of a sphere; the distance on the ellipsoid decides.
        maxradius=kilometers2degrees(1.01 * radius),
        **window,
        channel=",".join(f"{kind[:2]}?" for kind in channels),
    )
    deep = np.nan if origin.depth is None else origin.depth / 1000.0
    sites: dict[str, Named] = {}
    for network, station in ((net, station) for net in inventory for station in net):
        metres = gps2dist_azimuth(*epicentre, station.latitude, station.longitude)[0]
        km = metres / 1000.0
        kinds = [
            (number, channel.location_code, kind[:2])
            for number, kind in enumerate(channels)
            for channel in station
            if channel.code[:2] == kind[:2]
        ]
        name = f"{network.code}.{station.code}"
        if km > radius or not kinds or name in sites:
            continue
        _, location, kind = min(kinds)
        sites[name] = {
            "event": id,
            "origin_time": str(origin.time),
            "station": name,
            "Mw": moments[0] if moments else None,
            "magnitude": sizes[0].mag if sizes else None,
            "window_s": f"-{before:g} {after:g}",
            "epicentral_km": round(km, 3),
            "distance_km": round(float(np.hypot(km, deep)), 3),
            "terms": f"those of network {network.code}, fetched from {archive.base_url}",
            "query": {
                "network": network.code,
                "station": station.code,
                **window,
                "location": location or "--",
                "channel": f"{kind}?",
            },
        }
    return sorted(
        sites.values(), key=lambda site: (site["epicentral_km"], site["station"])
    )


def _fetched(archive: Client, site: Named, place: Path, again: bool) -> Named:
    """Fetch the record of one station into a folder, and return its row of the index.

    If `again`, the index lists it already, and its files may be replaced. RecordError if it cannot
    be used.
    """
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,16}\.[A-Za-z0-9_-]{1,16}", site["station"]):
        raise RecordError("the codes of this station cannot name a file")
    query = site.pop("query")
    id = f"{place.name}_{site['station']}.{query['location'].strip('-')}.{query['channel'][:2]}"
    with temporary_folder(place) as part:
        xml = Path(part) / f"{site['station']}.xml"
        record = Path(part) / f"{id}.mseed"
        _ask(archive, "get_waveforms", filename=str(record), **query)
        _ask(archive, "get_stations", filename=str(xml), level="response", **query)
        try:
            motions = read_horizontals(record)
        except RecordError as error:
            raise RecordError(str(error).replace(part, str(place))) from None
        check_targets(place / path.name for path in (xml, record) if not again)
        for path in (xml, record):
            register(place / path.name, path)
            path.replace(place / path.name)
    facts = [motion.facts for motion in motions]
    facts += [each.of_vertical for each in facts if each.of_vertical]
    codes = dict.fromkeys(each.component for each in facts)
    return site | {
        "id": id,
        "file": f"{place.name}/{id}.mseed",
        "sha256": sha256_of(place / record.name),
        "channels": " ".join(filter(None, codes)),
        "dt_s": motions[0].dt,
        "unit": "",
        "start_time": motions[0].facts.start_time,
    }
