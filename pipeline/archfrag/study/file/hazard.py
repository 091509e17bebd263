"""Hazard curves of a site from files: plain CSV, and OpenQuake's CSV and NRML.

OpenQuake's formats: the engine's manual, section on the outputs of a classical calculation.
"""

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from archfrag.errors import InputError
from archfrag.files import read_text
from archfrag.fragility.risk import HazardCurve
from archfrag.motions.measures import measure_unit, parse_measure
from archfrag.study.file.blocks import LEVEL_UNITS
from archfrag.study.file.messages import read_csv

FARTHEST = 10.0  # [km], between the site asked for and the nearest one of the file
_EARTH = 6371.0  # [km]
_LARGEST = 100_000_000  # [bytes] of a file
_MEASURE_AND_UNIT = re.compile(r"([^\[\]]+?)\s*(?:\[([^\[\]]*)\])?")
_KIND = re.compile(r"(rate|poe_([0-9.eE+-]+))(?:_(.+))?")
_RULE = (
    "the header is `im [g]` or the measure's name with its unit, such as `PGA [g]`, and then "
    "`rate` (annual frequency of exceedance) or `poe_50` (probability of exceedance in 50 years), "
    "further ones as `rate_NAME` or `poe_50_NAME`"
)
# Units in which OpenQuake gives its measures, and their names here.
_UNITS = {"PGA": "g", "SA": "g", "PGV": "cm/s", "PGD": "cm", "IA": "m/s"}
_NAMES = {"SA": "Sa", "IA": "Arias"}
_STATED = re.compile(r"\b(\w+)=(?:[\"']+([^\"']*)[\"']+|([^\s,\"']+))")


@dataclass(frozen=True)
class Hazard:
    """Hazard curves of a site."""

    measure: str  # of the study it is for
    source: str  # file or files
    # Intensity in the SI unit of the measure. The first is the one that risk is quoted of, the
    # mean where the file has it; others are quantiles or branches of the epistemic uncertainty.
    curves: dict[str, HazardCurve]
    notes: tuple[str, ...] = ()  # messages on what was assumed

    @property
    def main_name(self) -> str:
        """Name of the curve that rates are computed with first."""
        return next(iter(self.curves))

    @property
    def main(self) -> HazardCurve:
        """The curve that rates are computed with first."""
        return self.curves[self.main_name]


class _Stated(NamedTuple):
    """One curve as a file states it, at one or more sites."""

    name: str
    measure: str | None  # None: not named
    unit: str | None
    years: float | None  # of probabilities of exceedance; None: annual rates
    im: list[float]
    sites: dict[str, tuple[float, float, list[float]]]  # place: lon, lat [degrees], values
    component: bool = True  # whether the measure's name would give its component


def load_hazard(
    paths: Path | Sequence[Path],
    measure: str,
    unit: str | None = None,
    site: Sequence[float] | None = None,
) -> Hazard:
    """Read the hazard curves of a site, of the study's intensity measure.

    Three kinds of file are known by what is in them: CSV with a header as `archfrag risk --help`
    states, the CSV that OpenQuake exports (one file for the mean and each quantile), and NRML's
    ``hazardCurves``. `unit` is that of the intensities, where the file does not state it; `site`
    is longitude and latitude [degrees], for files with several sites. InputError names the file,
    what is wrong there, and what is allowed.
    """
    files = [paths] if isinstance(paths, Path) else list(paths)
    found: dict[str, HazardCurve] = {}
    notes: dict[str, None] = {}
    for path in files:
        text = read_text(path, _LARGEST, InputError, "the hazard curve")
        try:
            curves, own_notes = _curves(text, measure, unit, site)
            for name in curves.keys() & found.keys():
                raise InputError(f"has the curve {name!r}, and so has a file before it")
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        found |= curves
        notes |= dict.fromkeys(f"{path}: {note}" for note in own_notes)
    order = sorted(found, key=lambda name: name != "mean")
    source = ", ".join(map(str, files))
    return Hazard(measure, source, {name: found[name] for name in order}, tuple(notes))


def _curves(
    text: str, measure: str, unit: str | None, site: Sequence[float] | None
) -> tuple[dict[str, HazardCurve], list[str]]:
    """The curves of one file that are of the measure, and notes on what was assumed."""
    if text.lstrip().startswith("<"):
        read = _nrml
    else:
        read = _openquake_csv if re.search(r"^(\w+,)?lon,lat,", text, re.MULTILINE) else _plain
    curves: dict[str, HazardCurve] = {}
    notes, other = [], None
    for stated in read(text):
        try:
            note = _assumed(stated, measure)
            factor = _factor(stated, measure, unit)
        except InputError as error:  # a file may hold other measures too
            other = other or error
            continue
        if stated.name in curves:
            raise InputError(f"has the curve {stated.name!r} twice")
        curves[stated.name] = _curve(stated, site, factor)
        notes += [note] if note else []
    if other and not curves:
        raise other
    return curves, notes


def _assumed(stated: _Stated, measure: str) -> str:
    """Note on what is assumed of a curve's measure; InputError if it is another one."""
    if stated.measure is None:
        return f"does not name its measure, which is taken to be {measure}"
    requested, given = parse_measure(measure), None
    with contextlib.suppress(InputError):
        given = parse_measure(stated.measure)
    if given == requested:
        return ""
    if stated.component or given != requested._replace(rotated=""):
        text = f"is a hazard of {stated.measure}, but the study's levels are of {measure}"
        raise InputError(text)
    return f"the file states {stated.measure} and no component, taken to be {measure}'s"


def _factor(stated: _Stated, measure: str, unit: str | None) -> float:
    """SI unit in multiples of the file's."""
    if stated.unit is not None and unit not in (None, stated.unit):
        raise InputError(f"gives {measure} in {stated.unit}, not in {unit}")
    own = stated.unit or unit
    allowed = LEVEL_UNITS.get(measure_unit(measure), {})
    if own not in allowed:
        text = "no unit is stated" if own is None else f"{own!r} is not a unit of {measure}"
        raise InputError(f"{text}; give one of {', '.join(allowed)}")
    return allowed[own]


def _curve(stated: _Stated, site: Sequence[float] | None, factor: float) -> HazardCurve:
    place = _choose(stated.sites, site)
    lon, lat, values = stated.sites[place]
    if len(values) != len(stated.im):
        raise InputError(f"{place} has {len(values)} probabilities for {len(stated.im)} levels")
    try:
        if stated.years is None:
            curve = HazardCurve(np.array(stated.im), np.array(values))
        else:
            curve = HazardCurve.from_exceedance(stated.im, values, stated.years)
    except InputError as error:
        where = f"{place} (lon {lon:g}, lat {lat:g})" if np.isfinite(lon) else place
        raise InputError(f"{where}: {error}") from None
    return replace(curve, im=curve.im * factor)


def _choose(sites: dict[str, Any], requested: Sequence[float] | None) -> str:
    """Place of the only site, or of the nearest to the one asked for."""
    if not sites:
        raise InputError("has no site")
    places = list(sites)
    positions = np.array([sites[place][:2] for place in places])
    if np.isnan(positions[0, 0]) or (requested is None and len(places) == 1):
        return places[0]
    if requested is None:
        some = "; ".join(f"{lon:g},{lat:g}" for lon, lat in positions[:3])
        how = f"choose one by longitude and latitude, such as {some}"
        raise InputError(f"has {len(places)} sites; {how}")
    lon, lat = np.radians(positions).T
    lon0, lat0 = np.radians(requested)
    # Great-circle distances by the haversine formula.
    h = np.sin((lat - lat0) / 2) ** 2 + np.cos(lat) * np.cos(lat0) * np.sin((lon - lon0) / 2) ** 2
    away = 2.0 * _EARTH * np.arcsin(np.sqrt(np.minimum(h, 1.0)))
    nearest = int(np.argmin(away))
    if away[nearest] > FARTHEST:
        lon, lat = positions[nearest]
        raise InputError(
            f"has no site within {FARTHEST:g} km of longitude {requested[0]:g}, latitude "
            f"{requested[1]:g}; the nearest is {lon:g},{lat:g}, {away[nearest]:.0f} km away"
        )
    return places[nearest]


def _number(text: str, place: str) -> float:
    with contextlib.suppress(ValueError):
        if np.isfinite(value := float(text)):
            return value
    raise InputError(f"{place} is {text[:40]!r}; it must be a finite number")


def _column(rows: list[dict[str, str]], name: str) -> list[float]:
    """Numbers in one column of a table."""
    return [_number(row[name], f"row {i} of column {name!r}") for i, row in enumerate(rows, 1)]


def _plain(text: str) -> Iterator[_Stated]:
    """Columns intensity and rates or probabilities."""
    rows = read_csv(text)
    first, *others = rows[0] if rows else [""]
    stated = _MEASURE_AND_UNIT.fullmatch(first)
    if stated is None or not others:
        raise InputError(f"has {first[:60]!r} as its first of {len(others) + 1} columns; {_RULE}")
    measure = None if stated[1] == "im" else stated[1]
    for head in others:
        kind = _KIND.fullmatch(head)
        if kind is None:
            raise InputError(f"has a column {head[:60]!r}; {_RULE}")
        years = _number(kind[2], f"the years of column {head!r}") if kind[2] else None
        site = {f"column {head!r}": (np.nan, np.nan, _column(rows, head))}
        im = _column(rows, first)
        yield _Stated(kind[3] or "mean", measure, stated[2], years, im, site)


def _openquake_csv(text: str) -> Iterator[_Stated]:
    """One statistic or branch of a calculation, from ``hazard_curve-mean-PGA_1.csv`` or such."""
    about = text.lstrip().split("\n", 1)[0]
    stated = {key: quoted or bare for key, quoted, bare in _STATED.findall(about)}
    if not about.startswith("#") or not {"imt", "investigation_time"} <= stated.keys():
        keys = "imt and investigation_time"
        raise InputError(f"looks like OpenQuake's, but its first line does not state {keys}")
    rows = read_csv(text)
    heads = list(rows[0]) if rows else []
    levels = [head for head in heads if head.startswith("poe-")]
    if not {"lon", "lat"} <= set(heads) or len(levels) < 2:
        raise InputError("has no columns lon, lat and at least two of poe-LEVEL")
    im = [_number(head[4:], f"the level of column {head!r}") for head in levels]
    lon, lat, *values = (_column(rows, head) for head in ("lon", "lat", *levels))
    places = enumerate(zip(lon, lat, map(list, zip(*values))), start=1)
    sites = {f"row {number}": place for number, place in places}
    years = _number(stated["investigation_time"], "investigation_time")
    yield _engine(stated.get("kind", "one branch"), stated["imt"], years, im, sites)


def _engine(name: str, imt: str, years: float, im: list[float], sites: dict[str, Any]) -> _Stated:
    kind = imt.split("(")[0]
    measure = imt.replace(kind, _NAMES.get(kind, kind), 1)
    return _Stated(name, measure, _UNITS.get(kind), years, im, sites, component=False)


def _nrml(text: str) -> Iterator[_Stated]:
    """Mean, quantiles or one branch from the elements ``hazardCurves`` of an NRML file."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("declares a document type or entities, which NRML does not have")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"is not XML ({error})") from None
    groups = list(root.iterfind(".//{*}hazardCurves"))
    if not groups:
        raise InputError(f"has no element hazardCurves, but {root.tag}")
    for group in groups:
        name = group.get("statistics")
        if name == "quantile":
            name = f"quantile-{group.get('quantileValue', '')}"
        if not name:
            paths = map(group.get, ("sourceModelTreePath", "gsimTreePath"))
            name = ("~".join(filter(None, paths)) if groups[1:] else "") or "one branch"
        imt = group.get("IMT", "not stated")
        imt += f"({period})" if (period := group.get("saPeriod")) else ""
        years = _number(group.get("investigationTime", ""), "investigationTime")
        sites = {}
        for number, curve in enumerate(group.iterfind("{*}hazardCurve"), start=1):
            place = f"hazardCurve {number}"
            lon, lat = [*_numbers(curve, "pos", place), np.nan, np.nan][:2]
            sites[place] = lon, lat, _numbers(curve, "poEs", place)
        yield _engine(name, imt, years, _numbers(group, "IMLs", "hazardCurves"), sites)


def _numbers(element: ElementTree.Element, tag: str, place: str) -> list[float]:
    text = element.findtext(f".//{{*}}{tag}")
    if text is None:
        raise InputError(f"its element {place} has no {tag}")
    return [_number(cell, f"{tag} of {place}") for cell in text.split()]
