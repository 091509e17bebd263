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
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.risk import HazardCurve
from archfrag.motions.measures import Measure, measure_unit, parse_measure
from archfrag.study.file import read_csv
from archfrag.study.file.schema import LEVEL_UNITS

FARTHEST = 10.0  # [km], between the site asked for and the nearest one of the file
LARGEST = 100_000_000  # [bytes] of a file
_RULE = (
    "the header is `im [g]` or the measure's name with its unit, such as `PGA [g]`, and then "
    "`rate` (annual frequency of exceedance) or `poe_50` (probability of exceedance in 50 years), "
    "further ones as `rate_NAME` or `poe_50_NAME`"
)
# Units in which OpenQuake gives its measures, and their names here.
_UNITS = {"PGA": "g", "SA": "g", "PGV": "cm/s", "PGD": "cm", "IA": "m/s"}
_NAMES = {"SA": "Sa", "IA": "Arias"}


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
    def main(self) -> HazardCurve:
        """The curve that rates are computed with first."""
        return next(iter(self.curves.values()))


class _Stated(NamedTuple):
    """One curve as a file states it, at one or more sites."""

    name: str
    measure: str | None  # None: not named
    unit: str | None
    years: float | None  # of probabilities of exceedance; None: annual rates
    im: Any  # (n_level,)
    values: Any  # (n_site, n_level)
    sites: Any = None  # (n_site, 2): longitude and latitude [degrees]; None: one, not stated
    component: bool = True  # whether the measure's name would give its component


def load_hazard(
    paths: Sequence[Path], measure: str, unit: str | None = None,
    site: Sequence[float] | None = None,
) -> Hazard:  # fmt: skip
    """Read the hazard curves of a site, of the study's intensity measure.

    Three kinds of file are known by what is in them: CSV with a header as `archfrag risk --help`
    states, the CSV that OpenQuake exports (one file for the mean and each quantile), and NRML's
    ``hazardCurves``. `unit` is that of the intensities, where the file does not state it; `site`
    is longitude and latitude [degrees], for files with several sites. InputError names the file,
    what is wrong there, and what is allowed.
    """
    found: dict[str, HazardCurve] = {}
    notes: dict[str, None] = {}
    for path in paths:
        text = read_text(path, LARGEST, InputError, "the hazard curve")
        try:
            for stated in _of_measure(text, measure):
                if stated.name in found:
                    raise InputError(f"has a second curve {stated.name!r}")
                found[stated.name] = _curve(stated, measure, unit, site)
                if stated.measure is None:
                    what = f"does not name its measure, which is taken to be {measure}"
                    notes[f"{path}: {what}"] = None
                elif _parsed(stated.measure) != _parsed(measure):
                    what = f"the file states {stated.measure} and no component"
                    notes[f"{path}: {what}, taken to be {measure}'s"] = None
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        except ValueError as error:
            raise InputError(f"{path}: must hold numbers, but: {error}") from None
    order = sorted(found, key=lambda name: name != "mean")
    source = ", ".join(map(str, paths))
    return Hazard(measure, source, {name: found[name] for name in order}, tuple(notes))


def _of_measure(text: str, measure: str) -> list[_Stated]:
    """The curves of one file that may be of the measure; a file may hold other measures too."""
    read = _plain
    if text.lstrip().startswith("<"):
        read = _nrml
    elif re.search(r"^(\w+,)?lon,lat,", text, re.MULTILINE):
        read = _openquake_csv
    requested, every = parse_measure(measure), list(read(text))
    found = []
    for stated in every:
        alike = requested if stated.component else requested._replace(rotated="")
        if stated.measure is None or _parsed(stated.measure) in (requested, alike):
            found.append(stated)
    if every and not found:
        other = f"is a hazard of {every[0].measure}"
        raise InputError(f"{other}, but the study's levels are of {measure}")
    return found


def _parsed(name: str) -> Measure | None:
    with contextlib.suppress(InputError):
        return parse_measure(name)
    return None


def _curve(
    stated: _Stated, measure: str, unit: str | None, site: Sequence[float] | None
) -> HazardCurve:
    """The curve of the site, by intensity in the SI unit of the measure."""
    own = stated.unit or unit
    if unit not in (None, own):
        raise InputError(f"gives {measure} in {own}, not in {unit}")
    allowed = LEVEL_UNITS.get(measure_unit(measure), {})
    if own not in allowed:
        text = "no unit is stated" if own is None else f"{own!r} is not a unit of {measure}"
        raise InputError(f"{text}; give one of {', '.join(allowed)}")
    values = stated.values[0 if stated.sites is None else _chosen(stated.sites, site)]
    if stated.years is None:
        curve = HazardCurve(np.array(stated.im), np.array(values))
    else:
        curve = HazardCurve.from_exceedance(stated.im, values, stated.years)
    return replace(curve, im=curve.im * allowed[own])


def _chosen(sites: FloatArray, requested: Sequence[float] | None) -> int:
    """Number of the only site, or of the nearest to the one asked for."""
    if len(sites) == 1 and requested is None:
        return 0
    if requested is None or not len(sites):
        some = "; ".join(f"{lon:g},{lat:g}" for lon, lat in sites[:3]) or "none"
        how = f"choose one by longitude and latitude, such as {some}"
        raise InputError(f"has {len(sites)} sites; {how}")
    (lon, lat), (lon0, lat0) = np.radians(sites).T, np.radians(requested)
    # Great-circle distances [km] by the haversine formula.
    h = np.sin((lat - lat0) / 2) ** 2 + np.cos(lat) * np.cos(lat0) * np.sin((lon - lon0) / 2) ** 2
    away = 2.0 * 6371.0 * np.arcsin(np.sqrt(np.minimum(h, 1.0)))
    nearest = int(np.argmin(away))
    if away[nearest] > FARTHEST:
        lon, lat = sites[nearest]
        raise InputError(
            f"has no site within {FARTHEST:g} km of longitude {requested[0]:g}, latitude "
            f"{requested[1]:g}; the nearest is {lon:g},{lat:g}, {away[nearest]:.0f} km away"
        )
    return nearest


def _plain(text: str) -> Iterator[_Stated]:
    """Columns intensity and rates or probabilities."""
    table = read_csv(text)
    first, *others = table.columns
    stated = re.fullmatch(r"([^\[\]]+?)\s*(?:\[([^\[\]]*)\])?", first)
    if stated is None or not others:
        raise InputError(f"has {first[:60]!r} as its first of {len(others) + 1} columns; {_RULE}")
    measure = None if stated[1] == "im" else stated[1]
    for head in others:
        kind = re.fullmatch(r"(rate|poe_([0-9.eE+-]+))(?:_(.+))?", head)
        if kind is None:
            raise InputError(f"has a column {head[:60]!r}; {_RULE}")
        im, values = (table[name].astype(float).to_numpy() for name in (first, head))
        years = float(kind[2]) if kind[2] else None
        yield _Stated(kind[3] or "mean", measure, stated[2], years, im, [values])


def _openquake_csv(text: str) -> Iterator[_Stated]:
    """One statistic or branch of a calculation, from ``hazard_curve-mean-PGA_1.csv`` or such."""
    about = text.lstrip().split("\n", 1)[0]
    pairs = re.findall(r"\b(\w+)=(?:[\"']+([^\"']*)[\"']+|([^\s,\"']+))", about)
    stated = {key: quoted or bare for key, quoted, bare in pairs}
    if not about.startswith("#") or not {"imt", "investigation_time"} <= stated.keys():
        keys = "imt and investigation_time"
        raise InputError(f"looks like OpenQuake's, but its first line does not state {keys}")
    table = read_csv(text).set_index(["lon", "lat"]).filter(like="poe-")
    im = [float(str(head).removeprefix("poe-")) for head in table]
    sites = np.array(list(table.index), dtype=float)
    values = table.astype(float).to_numpy()
    name, years = stated.get("kind", "one branch"), float(stated["investigation_time"])
    yield _engine(name, stated["imt"], years, im, values, sites)


def _engine(name: str, imt: str, years: float, im: Any, values: Any, sites: Any) -> _Stated:
    kind = imt.split("(")[0]
    measure = imt.replace(kind, _NAMES.get(kind, kind), 1)
    return _Stated(name, measure, _UNITS.get(kind), years, im, values, sites, component=False)


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
        name = group.get("statistics") or "one branch"
        if name == "quantile":
            name = f"quantile-{group.get('quantileValue', '')}"
        imt = group.get("IMT", "not stated")
        imt += f"({period})" if (period := group.get("saPeriod")) else ""
        years = float(group.get("investigationTime", ""))
        curves = group.findall("{*}hazardCurve")
        sites = [_floats(curve, "pos")[:2] for curve in curves]
        values = [_floats(curve, "poEs") for curve in curves]
        yield _engine(name, imt, years, _floats(group, "IMLs"), values, sites)


def _floats(element: ElementTree.Element, tag: str) -> list[float]:
    """The numbers in an element below another one."""
    text = element.findtext(f".//{{*}}{tag}")
    if text is None:
        raise InputError(f"has an element without {tag}")
    return [float(cell) for cell in text.split()]
