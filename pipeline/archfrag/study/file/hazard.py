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
from archfrag.study.file.text import read_cells

FARTHEST = 10.0  # [km], between the site asked for and the nearest one of the file
_EARTH = 6371.0  # [km]
_LARGEST = 100_000_000  # [bytes] of a file
_MEASURE_AND_UNIT = re.compile(r"([^\[\]]+?)\s*(?:\[([^\[\]]*)\])?")
_KIND = re.compile(r"(rate|poe_([0-9.eE+-]+))(?:_(.+))?")
_HEADER_RULE = (
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
    """How often a site's motions exceed an intensity."""

    measure: str  # of the study it is for
    source: str  # file or files
    # Intensity in the SI unit of the measure. The first is the one that risk is quoted of, the
    # mean where the file has it; others are quantiles or branches of the epistemic uncertainty.
    curves: dict[str, HazardCurve]
    notes: tuple[str, ...] = ()  # messages on what was assumed

    @property
    def main_name(self) -> str:
        """Name of the curve that risk is quoted of."""
        return next(iter(self.curves))

    @property
    def main(self) -> HazardCurve:
        """The curve that risk is quoted of."""
        return self.curves[self.main_name]


class _Stated(NamedTuple):
    """One curve as a file states it, at one or more sites."""

    name: str
    measure: str | None  # None: not named
    unit: str | None
    years: float | None  # of probabilities of exceedance; None: annual rates
    im: list[float]
    sites: list[tuple[float, float, list[float], str]]  # lon, lat [degrees], values, place
    component: bool = True  # whether the measure's name would give its component


def load_hazard(
    paths: Path | Sequence[Path],
    measure: str,
    unit: str | None = None,
    site: Sequence[float] | None = None,
) -> Hazard:
    """Read the hazard curves of a site.

    Three kinds of file are known by what is in them: CSV with a header as `archfrag risk --help`
    states, the CSV that OpenQuake exports (one file for the mean and each quantile), and NRML's
    ``hazardCurves``.

    Parameters
    ----------
    paths : Path or sequence of Path
        One file, or several of the same site: mean and quantiles.
    measure : str
        The study's intensity measure; another one is refused.
    unit : str, optional
        Of intensities, where the file does not state it: g, m/s2, cm/s2, gal, m/s, cm/s, m, cm.
    site : (float, float), optional
        Longitude and latitude [degrees]; needed if a file holds several sites.

    Raises
    ------
    InputError
        Naming the file, what is wrong there, and what is allowed.
    """
    files = [paths] if isinstance(paths, Path) else list(paths)
    found: dict[str, HazardCurve] = {}
    notes: dict[str, None] = {}
    for path in files:
        text = read_text(path, _LARGEST, InputError, "the hazard curve")
        refused = None
        own: dict[str, HazardCurve] = {}
        try:
            for stated in _read(text):
                try:
                    factor, note = _factor(stated, measure, unit)
                except InputError as error:  # a file may hold other measures too
                    refused = refused or error
                    continue
                if stated.name in own or stated.name in found:
                    raise InputError(f"has the curve {stated.name!r}, which was there before")
                own[stated.name] = _curve(stated, site, factor)
                notes |= {f"{path}: {note}": None} if note else {}
            if refused and not own:
                raise refused
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        found |= own
    order = sorted(found, key=lambda name: name != "mean")
    source = ", ".join(map(str, files))
    return Hazard(measure, source, {name: found[name] for name in order}, tuple(notes))


def _read(text: str) -> Iterator[_Stated]:
    """The curves of a file of any kind."""
    if text.lstrip().startswith("<"):
        return _nrml(text)
    if re.search(r"^(\w+,)?lon,lat,", text, re.MULTILINE):
        return _openquake_csv(text)
    return _plain(text)


def _factor(stated: _Stated, measure: str, unit: str | None) -> tuple[float, str]:
    """SI unit in multiples of the file's, and a note on what was assumed."""
    note = ""
    if stated.measure is None:
        note = f"does not name its measure, which is taken to be {measure}"
    else:
        wanted, given = parse_measure(measure), None
        with contextlib.suppress(InputError):
            given = parse_measure(stated.measure)
        if given != wanted:
            if stated.component or given != wanted._replace(rotated=""):
                text = f"is a hazard of {stated.measure}, but the study's levels are of {measure}"
                raise InputError(text)
            note = f"the file states {stated.measure} and no component, taken to be {measure}'s"
    if stated.unit is not None and unit not in (None, stated.unit):
        raise InputError(f"gives {measure} in {stated.unit}, not in {unit}")
    own = stated.unit or unit
    allowed = LEVEL_UNITS.get(measure_unit(measure), {})
    if own not in allowed:
        text = "no unit is stated" if own is None else f"unit {own!r} is not one of {measure}"
        raise InputError(f"{text}; give one of {', '.join(allowed)}")
    return allowed[own], note


def _curve(stated: _Stated, site: Sequence[float] | None, factor: float) -> HazardCurve:
    lon, lat, values, place = _choose(stated.sites, site)
    if len(values) != len(stated.im):
        raise InputError(f"{place} has {len(values)} probabilities for {len(stated.im)} levels")
    try:
        if stated.years is None:
            curve = HazardCurve(np.array(stated.im), values)
        else:
            curve = HazardCurve.from_exceedance(stated.im, values, stated.years)
    except InputError as error:
        where = f"{place} (lon {lon:g}, lat {lat:g})" if np.isfinite(lon) else place
        raise InputError(f"{where}: {error}") from None
    return replace(curve, im=curve.im * factor)


def _choose(sites: list[Any], wanted: Sequence[float] | None) -> Any:
    """The only site, or the nearest to the one asked for."""
    if not sites:
        raise InputError("has no site")
    if np.isnan(sites[0][0]):  # of a file without places
        return sites[0]
    if wanted is None:
        if len(sites) == 1:
            return sites[0]
        some = "; ".join(f"{lon:g},{lat:g}" for lon, lat, *_ in sites[:3])
        how = f"choose one by longitude and latitude, such as {some}"
        raise InputError(f"has {len(sites)} sites; {how}")
    if not (abs(wanted[0]) <= 360.0 and abs(wanted[1]) <= 90.0):
        place = f"site {wanted[0]:g},{wanted[1]:g}"
        raise InputError(f"{place} is none: longitude comes first, latitude from -90 to 90")
    lon, lat = np.radians([site[:2] for site in sites]).T
    lon0, lat0 = np.radians(wanted)
    # Great-circle distances by the haversine formula.
    h = np.sin((lat - lat0) / 2) ** 2 + np.cos(lat) * np.cos(lat0) * np.sin((lon - lon0) / 2) ** 2
    away = 2.0 * _EARTH * np.arcsin(np.sqrt(np.minimum(h, 1.0)))
    nearest = sites[int(np.argmin(away))]
    if away.min() > FARTHEST:
        raise InputError(
            f"has no site within {FARTHEST:g} km of {wanted[0]:g},{wanted[1]:g}; the nearest is "
            f"{nearest[0]:g},{nearest[1]:g}, {away.min():.0f} km away"
        )
    return nearest


def _number(text: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{place} is {text[:40]!r}; a finite number is needed")
    return value


def _cells(text: str) -> list[tuple[int, list[str]]]:
    """Rows of a table that are as long as its first."""
    rows = read_cells(text)
    if not rows:
        raise InputError("is empty; a hazard curve in CSV or NRML is needed")
    heads = rows[0][1]
    for line, row in rows:
        if len(row) != len(heads):
            raise InputError(f"line {line} has {len(row)} columns, the header {len(heads)}")
    return rows


def _plain(text: str) -> Iterator[_Stated]:
    """Columns intensity and rates or probabilities; lines from # on are comments."""
    (_, heads), *rows = _cells(text)
    stated = _MEASURE_AND_UNIT.fullmatch(heads[0])
    measure = stated[1] if stated else ""
    known = measure == "im"
    with contextlib.suppress(InputError):
        known = known or bool(parse_measure(measure))
    if stated is None or not known:
        raise InputError(f"has {heads[0][:60]!r} as its first column; {_HEADER_RULE}")
    if len(heads) == 1:
        raise InputError(f"has one column; {_HEADER_RULE}")
    columns = [
        [_number(row[i], f"line {line}, column {head!r}") for line, row in rows]
        for i, head in enumerate(heads)
    ]
    for head, values in zip(heads[1:], columns[1:]):
        kind = _KIND.fullmatch(head)
        if kind is None:
            raise InputError(f"has a column {head[:60]!r}; {_HEADER_RULE}")
        years = _number(kind[2], f"the years of column {head!r}") if kind[2] else None
        name = None if measure == "im" else measure
        site = (np.nan, np.nan, values, f"column {head!r}")
        yield _Stated(kind[3] or "mean", name, stated[2], years, columns[0], [site])


def _openquake_csv(text: str) -> Iterator[_Stated]:
    """One statistic or branch of a calculation, from ``hazard_curve-mean-PGA_1.csv`` or such."""
    about = text.lstrip().split("\n", 1)[0]
    stated = {key: quoted or bare for key, quoted, bare in _STATED.findall(about)}
    if not about.startswith("#") or not {"imt", "investigation_time"} <= stated.keys():
        keys = "imt and investigation_time"
        raise InputError(f"looks like OpenQuake's, but its first line does not state {keys}")
    (_, heads), *rows = _cells(text)
    levels = [i for i, head in enumerate(heads) if head.startswith("poe-")]
    if not {"lon", "lat"} <= set(heads) or len(levels) < 2:
        raise InputError("has no columns lon, lat and at least two of poe-LEVEL")
    im = [_number(heads[i][4:], f"the level of column {heads[i]!r}") for i in levels]
    sites = []
    for line, row in rows:
        place = f"line {line}"
        lon, lat = (_number(row[heads.index(k)], f"{k} of {place}") for k in ("lon", "lat"))
        values = [_number(row[i], f"a probability of {place}") for i in levels]
        sites.append((lon, lat, values, place))
    years = _number(stated["investigation_time"], "investigation_time")
    yield _engine(stated.get("kind", "one branch"), stated["imt"], years, im, sites)


def _engine(name: str, imt: str, years: float, im: list[float], sites: list[Any]) -> _Stated:
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
        raise InputError(f"is no XML ({error})") from None
    for element in root.iter():
        element.tag = element.tag.rsplit("}", 1)[-1]
    groups = list(root.iter("hazardCurves"))
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
        sites = []
        for number, curve in enumerate(group.findall("hazardCurve"), start=1):
            place = f"hazardCurve {number}"
            position = [*_numbers(curve, "pos", place), np.nan, np.nan]
            sites.append((*position[:2], _numbers(curve, "poEs", place), place))
        yield _engine(name, imt, years, _numbers(group, "IMLs", "hazardCurves"), sites)


def _numbers(element: ElementTree.Element, tag: str, place: str) -> list[float]:
    text = element.findtext(f".//{tag}")
    if text is None:
        raise InputError(f"its element {place} has no {tag}")
    return [_number(cell, f"{tag} of {place}") for cell in text.split()]
