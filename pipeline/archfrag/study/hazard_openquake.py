"""Hazard curves as OpenQuake writes them: CSV of all sites, and NRML 0.4 and 0.5.

Formats: the OpenQuake engine's manual, section on the outputs of a classical calculation.
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from archfrag.errors import InputError
from archfrag.fragility.hazard_curve import HazardCurve
from archfrag.study.hazard import Hazard, check_measure, number, unit_factor

FARTHEST = 10.0  # [km], between the site asked for and the nearest one of the file
_EARTH = 6371.0  # [km]
# Units in which the engine gives its measures, and their names here.
_UNITS = {"PGA": "g", "SA": "g", "PGV": "cm/s", "PGD": "cm", "IA": "m/s"}
_STATED = re.compile(r"\b(\w+)=(?:[\"']+([^\"']*)[\"']+|([^\s,\"']+))")
_NAMES = {"SA": "Sa", "IA": "Arias"}


class _Site(NamedTuple):
    """Probabilities of exceedance at one place, in the file's order."""

    lon: float
    lat: float
    cells: Sequence[str]
    place: str  # in the file


def read_openquake_csv(
    text: str, measure: str, unit: str | None, site: tuple[float, float] | None
) -> Hazard:
    """One statistic or branch of a calculation, from ``hazard_curve-mean-PGA_1.csv`` or such."""
    about, *lines = (line for line in text.splitlines() if line.strip())
    stated = {key: quoted or bare for key, quoted, bare in _STATED.findall(about)}
    if not about.startswith("#") or not {"imt", "investigation_time"} <= stated.keys():
        keys = "imt and investigation_time"
        raise InputError(f"looks like OpenQuake's, but its first line does not state {keys}")
    heads, *rows = csv.reader(lines)
    levels = [i for i, head in enumerate(heads) if head.startswith("poe-")]
    if not {"lon", "lat"} <= set(heads) or len(levels) < 2:
        raise InputError("has no columns lon, lat and at least two of poe-LEVEL")
    im = [number(heads[i][4:], f"the level of column {heads[i]!r}") for i in levels]
    sites = []
    for i, row in enumerate(rows, 1):
        if len(row) != len(heads):
            raise InputError(
                f"row {i} of its sites has not the {len(heads)} columns of its header"
            )
        lon, lat = (number(row[heads.index(k)], f"{k} of row {i}") for k in ("lon", "lat"))
        sites.append(_Site(lon, lat, [row[j] for j in levels], f"row {i}"))
    factor, notes = _factor(stated["imt"], measure, unit)
    years = number(stated["investigation_time"], "investigation_time")
    curve = _curve(im, _choose(sites, site), years, factor)
    return Hazard(measure, "", {stated.get("kind", "one branch"): curve}, notes)


def read_nrml(
    text: str, measure: str, unit: str | None, site: tuple[float, float] | None
) -> Hazard:
    """Mean, quantiles or one branch from the elements ``hazardCurves`` of an NRML file."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("declares a document type or entities, which NRML does not have")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"is no XML ({error})") from None
    for element in root.iter():
        element.tag = element.tag.rsplit("}", 1)[-1]
    groups = list(root.iter("hazardCurves"))
    if not groups:
        raise InputError(f"has no element hazardCurves, but {root.tag}")
    curves: dict[str, HazardCurve] = {}
    notes: tuple[str, ...] = ()
    refusal = None
    for group in groups:
        imt = group.get("IMT", "not stated")
        imt += f"({period})" if (period := group.get("saPeriod")) else ""
        try:
            factor, notes_here = _factor(imt, measure, unit)
        except InputError as error:
            refusal = error
            continue
        name = _statistic(group, len(groups))
        if name in curves:
            raise InputError(f"has several curves {name!r} of {imt}; leave one of them in it")
        years = number(group.get("investigationTime", ""), "investigationTime")
        im = [number(cell, "IMLs") for cell in _child_text(group, "IMLs").split()]
        curves[name] = _curve(im, _choose(_nrml_sites(group), site), years, factor)
        notes = notes_here
    if refusal and not curves:
        raise refusal
    return Hazard(measure, "", curves, notes)


def _factor(imt: str, measure: str, unit: str | None) -> tuple[float, tuple[str, ...]]:
    """Factor from the engine's unit to the SI unit of the measure, and notes."""
    kind = imt.split("(")[0]
    notes = check_measure(imt.replace(kind, _NAMES.get(kind, kind), 1), measure, False)
    own = _UNITS.get(kind)
    if own is None:
        return unit_factor(unit, measure), notes
    if unit not in (None, own):
        raise InputError(f"is of OpenQuake, which gives {imt} in {own}, not in {unit}")
    return unit_factor(own, measure), notes


def _curve(im: Sequence[float], site: _Site, years: float, factor: float) -> HazardCurve:
    poe = [number(cell, f"a probability of {site.place}") for cell in site.cells]
    if len(poe) != len(im):
        raise InputError(f"{site.place} has {len(poe)} probabilities for {len(im)} levels")
    try:
        curve = HazardCurve.from_exceedance(im, poe, years)
    except InputError as error:
        raise InputError(f"{site.place} (lon {site.lon:g}, lat {site.lat:g}): {error}") from None
    return replace(curve, im=curve.im * factor)


def _choose(sites: Sequence[_Site], wanted: tuple[float, float] | None) -> _Site:
    """The only site, or the nearest to the one asked for."""
    if not sites:
        raise InputError("has no site")
    if wanted is None:
        if len(sites) == 1:
            return sites[0]
        some = "; ".join(f"{site.lon:g},{site.lat:g}" for site in sites[:3])
        how = f"choose one by longitude and latitude, such as {some}"
        raise InputError(f"has {len(sites)} sites; {how}")
    if not (abs(wanted[0]) <= 360.0 and abs(wanted[1]) <= 90.0):
        place = f"site {wanted[0]:g},{wanted[1]:g}"
        raise InputError(f"{place} is none: longitude comes first, latitude from -90 to 90")
    lon, lat = np.radians([[site.lon, site.lat] for site in sites]).T
    lon0, lat0 = np.radians(wanted)
    # Great-circle distances by the haversine formula.
    h = np.sin((lat - lat0) / 2) ** 2 + np.cos(lat) * np.cos(lat0) * np.sin((lon - lon0) / 2) ** 2
    away = 2.0 * _EARTH * np.arcsin(np.sqrt(np.minimum(h, 1.0)))
    nearest = sites[int(np.argmin(away))]
    if away.min() > FARTHEST:
        raise InputError(
            f"has no site within {FARTHEST:g} km of {wanted[0]:g},{wanted[1]:g}; the nearest is "
            f"{nearest.lon:g},{nearest.lat:g}, {away.min():.0f} km away"
        )
    return nearest


def _child_text(element: ElementTree.Element, tag: str) -> str:
    text = element.findtext(f".//{tag}")
    if text is None:
        raise InputError(f"its element {element.tag} has no {tag}")
    return text


def _statistic(group: ElementTree.Element, of: int) -> str:
    statistics = group.get("statistics")
    if statistics == "quantile":
        return f"quantile-{group.get('quantileValue', '')}"
    if statistics:
        return statistics
    branch = "~".join(filter(None, map(group.get, ("sourceModelTreePath", "gsimTreePath"))))
    return (branch or "one branch") if of > 1 else "one branch"


def _nrml_sites(group: ElementTree.Element) -> list[_Site]:
    sites: list[_Site] = []
    for element in group.findall("hazardCurve"):
        place = f"hazardCurve {len(sites) + 1}"
        position = _child_text(element, "pos").split()
        if len(position) < 2:
            raise InputError(f"{place} has no longitude and latitude")
        lon, lat = (number(cell, f"pos of {place}") for cell in position[:2])
        sites.append(_Site(lon, lat, _child_text(element, "poEs").split(), place))
    return sites
