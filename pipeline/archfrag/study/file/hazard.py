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
from archfrag.motions.measures import measure_unit, parse_measure
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
    # (n_site, 2): longitude and latitude [degrees]; None: one, in a file that is not OpenQuake's
    sites: Any = None


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
            for stated, note in _of_measure(text, measure):
                if stated.name in found:
                    raise InputError(f"has a second curve {stated.name!r}")
                found[stated.name] = _curve(stated, measure, unit, site)
                notes |= {f"{path}: {note}": None} if note else {}
        except (InputError, ValueError) as error:
            must = "" if isinstance(error, InputError) else "must hold numbers, but: "
            raise InputError(f"{path}: {must}{error}") from None
    order = sorted(found, key=lambda name: name != "mean")
    source = ", ".join(map(str, paths))
    return Hazard(measure, source, {name: found[name] for name in order}, tuple(notes))


def _of_measure(text: str, measure: str) -> list[tuple[_Stated, str]]:
    """The curves of one file that may be of the measure, with a note on what is assumed."""
    read = _plain
    if text.lstrip().startswith("<"):
        read = _nrml
    elif re.search(r"^(\w+,)?lon,lat,", text, re.MULTILINE):
        read = _openquake_csv
    requested, found, other = parse_measure(measure), [], ""
    for stated in read(text):
        given = None
        with contextlib.suppress(InputError):  # a file may hold any other measures too
            given = parse_measure(stated.measure or measure)
        if stated.measure is None:
            note = f"does not name its measure, which is taken to be {measure}"
            found.append((stated, note))
        elif given == requested:
            found.append((stated, ""))
        elif stated.sites is not None and given == requested._replace(rotated=""):
            note = f"the file states {stated.measure} and no component, taken to be {measure}'s"
            found.append((stated, note))
        else:
            other = f"is a hazard of {stated.measure}, but the study's levels are of {measure}"
    if other and not found:
        raise InputError(other)
    return found


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
    names = [f"{lon:g},{lat:g}" for lon, lat in sites]
    if requested is None or not names:
        how = f"choose one by longitude and latitude, such as {'; '.join(names[:3])}"
        raise InputError(f"has {len(names)} sites; {how}")
    (lon, lat), (lon0, lat0) = np.radians(sites).T, np.radians(requested)
    # Great-circle distances [km] by the haversine formula.
    h = np.sin((lat - lat0) / 2) ** 2 + np.cos(lat) * np.cos(lat0) * np.sin((lon - lon0) / 2) ** 2
    away = 2.0 * 6371.0 * np.arcsin(np.sqrt(np.minimum(h, 1.0)))
    nearest = int(np.argmin(away))
    if away[nearest] > FARTHEST:
        far = f"the nearest is {names[nearest]}, {away[nearest]:.0f} km away"
        place = "longitude {:g}, latitude {:g}".format(*requested)
        raise InputError(f"has no site within {FARTHEST:g} km of {place}; {far}")
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
    return _Stated(name, measure, _UNITS.get(kind), years, im, values, sites)


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
