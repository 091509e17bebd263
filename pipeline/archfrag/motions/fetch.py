"""Records of earthquakes from data centres: miniSEED, StationXML and an index in one folder.

For each event a folder with ``event.xml`` (QuakeML as received), one miniSEED file for each
station, in counts, and its responses as ``NET.STA.xml`` beside it, where `archfrag.motions.read`
finds them. A station that is complete is in the index and is not asked for again.
"""

import contextlib
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from obspy import Inventory
from obspy.core.event import Event, Origin
from obspy.core.inventory import Station
from obspy.geodetics import gps2dist_azimuth, kilometers2degrees

from archfrag.errors import InputError, RecordError
from archfrag.files import (
    cannot_write,
    make_folder,
    replacing,
    sha256_of,
    sweep,
    temporary_folder,
)
from archfrag.motions.fdsn import Limits, Refusal, Service
from archfrag.motions.index import index_table, sha256, write_index
from archfrag.motions.read import read_motions

MOST_FAILURES = 3  # one after the other, after which a service is left alone
_KIND = re.compile(r"([A-Z]{2})[?*]?")
_CODE = re.compile(r"[A-Za-z0-9_-]{1,16}")


@dataclass(frozen=True)
class Request:
    """What to fetch.

    Parameters
    ----------
    events : tuple of str
        Identifiers at `events_from`.
    stations_from : str
        Service of stations and waveforms: a name that obspy knows or an address.
    events_from : str
        Service of events.
    radius : float [km]
        Largest epicentral distance, up to 2000.
    channels : tuple of str
        Band and instrument of accelerometers, the best first: ``HN``; one is taken at a station.
    before, after : float [s]
        Window around the origin time.
    most : int
        Stations of an event, the nearest first.
    limits : Limits

    Raises
    ------
    InputError
        If a value is outside its range.
    """

    events: tuple[str, ...]
    stations_from: str
    events_from: str = "USGS"
    radius: float = 100.0
    channels: tuple[str, ...] = ("HN", "EN", "BN")
    before: float = 30.0
    after: float = 180.0
    most: int = 100
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("radius [km]", self.radius, 0.0, 2000.0), ("before [s]", self.before, 0.0, 3600.0),
            ("after [s]", self.after, 1.0, 7200.0), ("stations", self.most, 1, 100_000),
            ("timeout [s]", self.limits.seconds, 0.01, 3600.0),
            ("size [MB]", self.limits.megabytes, 0.001, 2000.0),
        ):  # fmt: skip
            if not low <= value <= high:
                raise InputError(f"{name} = {value:g} must be from {low:g} to {high:g}")
        for kind in self.channels:
            if not _KIND.fullmatch(kind):
                raise InputError(
                    f"channels {kind!r} must be two capitals, band and instrument, e.g. HN or HN?"
                )


@dataclass
class Fetched:
    """What came of a request: ids of records, new and kept, and why others are not there."""

    new: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    refused: list[Refusal] = field(default_factory=list)

    @property
    def passing(self) -> list[Refusal]:
        """Those after which another attempt may help."""
        return [refusal for refusal in self.refused if refusal.passing]


class _Site(NamedTuple):
    name: str
    network: str
    station: Station
    epicentral_km: float


class _Quake(NamedTuple):
    id: str
    origin: Origin
    window: dict[str, Any]  # in the words of a query
    facts: dict[str, Any]


def fetch_records(
    request: Request, folder: str | Path, report: Callable[[str], None] = lambda _: None
) -> Fetched:
    """Fetch records of events into a folder; what is there already is kept.

    Parameters
    ----------
    request : Request
    folder : path
        Made if needed. No other command may be at work there.
    report : callable
        Takes a message for each record that came and for each that did not.

    Raises
    ------
    InputError
        If a service is unknown.
    RecordError
        If the folder's index cannot be used.
    OutputError
        If the folder cannot be written.

    Examples
    --------
    >>> from archfrag.motions.fetch import Request, fetch_records
    >>> request = Request(("nc73201181",), "NCEDC", radius=30.0)
    >>> fetched = fetch_records(request, "napa")  # doctest: +SKIP
    """
    return _Fetching(request, make_folder(Path(folder)), report).run()


class _Fetching:
    def __init__(self, request: Request, folder: Path, report: Callable[[str], None]) -> None:
        self.request, self.folder, self.report = request, folder, report
        self.catalogue = Service(request.events_from, request.limits)
        self.archive = Service(request.stations_from, request.limits)
        self.rows: dict[str, dict[str, Any]] = dict(index_table(folder))
        self.result = Fetched()
        sweep(folder)

    def run(self) -> Fetched:
        for id in self.request.events:
            try:
                self._event(id)
            except Refusal as refusal:
                self._refuse(refusal, f"event {id}")
            except OSError as error:
                raise cannot_write(self.folder, error) from None
        return self.result

    def _event(self, id: str) -> None:
        content, event = self.catalogue.event(id)
        quake = self._quake(id, event)
        sites = self._sites(quake)
        place = make_folder(self.folder / folder_name(id))
        with replacing(place / "event.xml") as part:
            part.write_bytes(content)
        failures = 0
        for number, site in enumerate(sites):
            try:
                self._station(quake, site, place)
                failures = 0
            except Refusal as refusal:
                self._refuse(refusal, f"{id} {site.name}")
                failures = failures + 1 if refusal.passing else 0
            if failures == MOST_FAILURES and number + 1 < len(sites):
                left = f"{len(sites) - number - 1} stations were not asked for"
                reason = f"{failures} requests in a row failed; {left}"
                raise Refusal("service", f"{self.archive.label}: {reason}")

    def _refuse(self, refusal: Refusal, what: str) -> None:
        self.result.refused.append(Refusal(refusal.kind, f"{what}: {refusal}"))
        self.report(str(self.result.refused[-1]))

    def _quake(self, id: str, event: Event) -> _Quake:
        """Origin, window and columns of the index of an event."""
        origin = event.preferred_origin() or event.origins[0]
        place = (origin.latitude, origin.longitude)
        within = None not in place and abs(place[0]) <= 90.0 and abs(place[1]) <= 360.0
        if not within or origin.time is None or not 1900 <= origin.time.year <= 2200:
            where = f"latitude {place[0]}, longitude {place[1]}, time {origin.time}"
            raise Refusal("unusable", f"its origin cannot be: {where}")
        preferred = event.preferred_magnitude() or next(iter(event.magnitudes), None)
        magnitudes = [each for each in (preferred, *event.magnitudes) if each is not None]
        moments = [m.mag for m in magnitudes if (m.magnitude_type or "").lower().startswith("mw")]
        facts = {
            "event": id, "Mw": moments[0] if moments else None,
            "event_name": next((d.text for d in event.event_descriptions if d.text), ""),
            "origin_time": str(origin.time), "event_latitude": float(origin.latitude),
            "event_longitude": float(origin.longitude),
            "depth_km": None if origin.depth is None else float(origin.depth) / 1000.0,
            "magnitude": preferred.mag if preferred else None,
            "magnitude_type": (preferred.magnitude_type or "") if preferred else "",
            "window_s": f"-{self.request.before:g} {self.request.after:g}",
        }  # fmt: skip
        window = {"starttime": origin.time - self.request.before,
                  "endtime": origin.time + self.request.after}  # fmt: skip
        return _Quake(id, origin, window, facts)

    def _sites(self, quake: _Quake) -> list[_Site]:
        """Stations within the radius, the nearest first."""
        patterns = ",".join(f"{kind[:2]}?" for kind in self.request.channels)
        inventory = self.archive.stations(
            "the list of stations", channel=patterns, level="channel",
            latitude=quake.origin.latitude, longitude=quake.origin.longitude,
            # Degrees of a sphere; the distance on the ellipsoid decides.
            maxradius=kilometers2degrees(1.01 * self.request.radius),
            **quake.window,
        )[1]  # fmt: skip
        sites = _located(inventory, quake.origin)
        near = [site for site in sites if site.epicentral_km <= self.request.radius]
        if not near:
            reach = f"{patterns} within {self.request.radius:g} km"
            raise Refusal("no data", f"{self.archive.label} has no station with {reach}")
        return near[: self.request.most]

    def _station(self, quake: _Quake, site: _Site, place: Path) -> None:
        if not all(map(_CODE.fullmatch, (site.network, site.station.code))):
            raise Refusal("unusable", "the codes of this station cannot name a file")
        same = {"event": quake.id, "station": site.name, "window_s": quake.facts["window_s"]}
        for row in self.rows.values():
            if same.items() <= row.items() and self._complete(row):
                self.result.kept.append(row["id"])
                return
        wanted, waveforms = self._waveforms(quake, site)
        what = f"the responses of {site.name}"
        responses, _ = self.archive.stations(what, level="response", **wanted)
        channel = f"{wanted['location'].replace('--', '')}.{wanted['channel'][:2]}"
        name = f"{place.name}_{site.name}.{channel}"
        stored = self._store(place, name, site, waveforms, responses)
        depth, epicentral = quake.facts["depth_km"], site.epicentral_km
        self.rows[name] = quake.facts | stored | {
            "id": name, "unit": "", "distance_kind": "hypocentral", "station": site.name,
            "distance_km": None if depth is None else round(float(np.hypot(epicentral, depth)), 3),
            "epicentral_km": round(epicentral, 3),
            "station_latitude": float(site.station.latitude),
            "station_longitude": float(site.station.longitude),
            "terms": f"those of network {site.network}, fetched from {self.archive.label}",
        }  # fmt: skip
        write_index(self.folder, [self.rows[id] for id in sorted(self.rows)])
        self.result.new.append(name)
        reached = f"{stored['channels']}, {epicentral:.1f} km from the epicentre"
        self.report(f"{quake.id} {site.name}: {reached}")

    def _complete(self, row: dict[str, Any]) -> bool:
        path = self.folder / row["file"]
        with contextlib.suppress(OSError):
            there = path.with_name(f"{row['station']}.xml").is_file()
            return there and sha256_of(path) == row["sha256"]
        return False

    def _waveforms(self, quake: _Quake, site: _Site) -> tuple[dict[str, Any], bytes]:
        """Of the first kind and place of instrument that has any, with what was asked for."""
        nothing = Refusal("no data", "no channel of these kinds")
        for kind in self.request.channels:
            places = {c.location_code for c in site.station if c.code.startswith(kind[:2])}
            for location in sorted(places):
                wanted = quake.window | {
                    "network": site.network, "station": site.station.code,
                    "location": location or "--", "channel": f"{kind[:2]}?",
                }  # fmt: skip
                try:
                    return wanted, self.archive.waveforms(**wanted)
                except Refusal as refusal:
                    if refusal.kind != "no data":
                        raise
                    nothing = refusal
        raise nothing

    def _store(
        self, place: Path, name: str, site: _Site, waveforms: bytes, responses: bytes
    ) -> dict[str, Any]:
        """Put a record that can be read, with its StationXML, in its place."""
        with temporary_folder(place) as part:
            files = [Path(part) / f"{site.name}.xml", Path(part) / f"{name}.mseed"]
            for path, content in zip(files, (responses, waveforms), strict=True):
                path.write_bytes(content)
            try:
                motions = read_motions(files[1])
            except RecordError as error:
                reason = str(error).replace(part, str(place))
                raise Refusal("unusable", f"{reason}; nothing of it is kept") from None
            for path in files:
                path.replace(place / path.name)
        verticals = dict.fromkeys(m.metadata["vertical_component"] for m in motions)
        codes = [*(motion.metadata["component"] for motion in motions), *verticals]
        return {
            "file": f"{place.name}/{name}.mseed", "sha256": sha256(waveforms),
            "dt_s": motions[0].dt, "channels": " ".join(filter(None, codes)),
            "start_time": motions[0].metadata.get("start_time", ""),
        }  # fmt: skip


def folder_name(id: str) -> str:
    """Name of a folder for an event: its identifier, where that may be the name of a file."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", id).strip("-")[:60]
    return plain if plain == id else f"{plain}-{sha256(id.encode())[:6]}"


def _located(inventory: Inventory, origin: Origin) -> list[_Site]:
    """Each station once, though its channels may be listed under several epochs, nearest first."""
    sites: dict[str, _Site] = {}
    for network in inventory:
        for station in network:
            name = f"{network.code}.{station.code}"
            if name in sites:
                sites[name].station.channels.extend(station.channels)
                continue
            ends = (origin.latitude, origin.longitude, station.latitude, station.longitude)
            metres = gps2dist_azimuth(*map(float, ends))[0]
            sites[name] = _Site(name, network.code, station, metres / 1000.0)
    return sorted(sites.values(), key=lambda site: (site.epicentral_km, site.name))
