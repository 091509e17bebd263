"""Hazard curves of a site from files: plain CSV, and OpenQuake's CSV and NRML.

OpenQuake's formats: the engine's manual, section on the outputs of a classical calculation.
"""

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from archfrag.errors import InputError
from archfrag.files import read_text
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
_UNITS = {"PGA": "g", "SA": "g", "PGV": "cm/s", "PGD": "cm", "IA": "m/s"}  # of OpenQuake
# One curve as a file states it: its name, measure and unit, None if not stated; years of the
# probabilities of exceedance, None for annual rates; intensities (n_level,); values (n_site,
# n_level); and longitude and latitude (n_site, 2) [degrees], None in a file not of OpenQuake.
_Stated = tuple[str, str | None, str | None, float | None, Any, Any, Any]


@dataclass(frozen=True)
class Hazard:
    """Hazard curves of a site."""

    measure: str  # of the study it is for
    source: str  # file or files
    # Intensity in the SI unit of the measure. The first is the one that risk is quoted of, the
    # mean where the file has it; others are quantiles or branches of the epistemic uncertainty.
    curves: dict[str, HazardCurve]
    messages: tuple[str, ...] = ()  # messages on what was assumed

    @property
    def main(self) -> HazardCurve:
        """The curve that rates are computed with first."""
        return next(iter(self.curves.values()))


def load_hazard(
    paths: Sequence[Path], measure: str, unit: str | None = None,
    site: Sequence[float] | None = None,
) -> Hazard:  # fmt: skip
    """Read the hazard curves of a site, of the study's intensity measure.

    Files are CSV as `archfrag risk --help` states, OpenQuake's CSV (one file for the mean and each
    quantile), or NRML's ``hazardCurves``. `unit` is that of the intensities, where the file does
    not state it; `site` is longitude and latitude [degrees], for files with several sites.
    InputError names the file, what is wrong there, and what is allowed.
    """
    found: dict[str, HazardCurve] = {}
    messages: dict[str, None] = {}
    for path in paths:
        text = read_text(path, LARGEST, InputError, "the hazard curve")
        try:
            for name, curve, message in _curves(text, measure, unit, site):
                if name in found:
                    raise InputError(f"has a second curve {name!r}")
                found[name] = curve
                messages |= {f"{path}: {message}": None} if message else {}
        except (InputError, ValueError) as error:
            must = "" if isinstance(error, InputError) else "must hold numbers, but: "
            raise InputError(f"{path}: {must}{error}") from None
    order = sorted(found, key=lambda name: name != "mean")
    source = ", ".join(map(str, paths))
    return Hazard(measure, source, {name: found[name] for name in order}, tuple(messages))


def _curves(
    text: str, measure: str, unit: str | None, site: Sequence[float] | None
) -> Iterator[tuple[str, HazardCurve, str]]:
    """Yield name, curve in SI units and assumption of all curves that may be of the measure."""
    requested, allowed = parse_measure(measure), LEVEL_UNITS.get(measure_unit(measure), {})
    read = _nrml if text.lstrip().startswith("<") else _csv
    other, any_found = "", False
    for name, stated, own, years, im, values, sites in read(text):
        given, message = None, ""
        with contextlib.suppress(InputError):  # a file may hold any other measures too
            given = parse_measure("Arias" if stated == "IA" else stated or measure)
        if stated is None:
            message = f"does not name its measure, which is taken to be {measure}"
        elif sites is not None and given == requested._replace(rotated="") != requested:
            message = f"the file states {stated} and no component, taken to be {measure}'s"
        elif given != requested:
            other = f"is a hazard of {stated}, but the study's levels are of {measure}"
            continue
        any_found, own = True, own or unit
        if unit not in (None, own):
            raise InputError(f"gives {measure} in {own}, not in {unit}")
        if own not in allowed:
            what = "no unit is stated" if own is None else f"{own!r} is not a unit of {measure}"
            raise InputError(f"{what}; give one of {', '.join(allowed)}")
        chosen = values[0 if sites is None else _nearest(sites, site)]
        if years is None:
            curve = HazardCurve(np.array(im), np.array(chosen))
        else:
            curve = HazardCurve.from_exceedance(im, chosen, years)
        yield name, replace(curve, im=curve.im * allowed[own]), message
    if other and not any_found:
        raise InputError(other)


def _nearest(sites: Any, requested: Sequence[float] | None) -> int:
    """Number of the only site, or of the nearest to the one asked for."""
    names = [f"{lon:g},{lat:g}" for lon, lat in sites]
    if requested is None:
        if len(names) == 1:
            return 0
        how = f"choose one by longitude and latitude, such as {'; '.join(names[:3])}"
        raise InputError(f"has {len(names)} sites; {how}")
    (lon, lat), (lon0, lat0) = np.radians(np.reshape(sites, (-1, 2))).T, np.radians(requested)
    # Great-circle distances [km] by the haversine formula.
    h = np.sin((lat - lat0) / 2) ** 2 + np.cos(lat) * np.cos(lat0) * np.sin((lon - lon0) / 2) ** 2
    away = 2.0 * 6371.0 * np.arcsin(np.sqrt(np.minimum(h, 1.0)))
    if not names or away.min() > FARTHEST:
        place = "longitude {:g}, latitude {:g}".format(*requested)
        raise InputError(f"has no site within {FARTHEST:g} km of {place}")
    return int(away.argmin())


def _csv(text: str) -> Iterator[_Stated]:
    """Columns intensity and rates or probabilities; or one of OpenQuake's, a site in each row."""
    table = read_csv(text)
    if {"lon", "lat"} <= set(table):
        about = dict(re.findall(r"\b(\w+)=[\"']*([^\s,\"']+)", text.lstrip().split("\n", 1)[0]))
        if not {"imt", "investigation_time"} <= about.keys():
            keys = "imt and investigation_time"
            raise InputError(f"looks like OpenQuake's, but its first line does not state {keys}")
        poe = table.filter(like="poe-").astype(float)
        im = [float(str(head).removeprefix("poe-")) for head in poe]
        yield (
            about.get("kind", "one branch"), about["imt"], _UNITS.get(about["imt"].split("(")[0]),
            float(about["investigation_time"]), im, poe.to_numpy(),
            table[["lon", "lat"]].astype(float).to_numpy(),
        )  # fmt: skip
        return
    first, *others = table.columns
    stated = re.fullmatch(r"([^\[\]]+?)\s*(?:\[([^\[\]]*)\])?", first)
    if stated is None or not others:
        raise InputError(f"has {first[:60]!r} as its first of {len(others) + 1} columns; {_RULE}")
    measure = None if stated[1] == "im" else stated[1]
    for head in others:
        kind = re.fullmatch(r"(rate|poe_([0-9.eE+-]+))(?:_(.+))?", head)
        if kind is None:
            raise InputError(f"has a column {head[:60]!r}; {_RULE}")
        levels, values = (table[name].astype(float).to_numpy() for name in (first, head))
        years = float(kind[2]) if kind[2] else None
        yield kind[3] or "mean", measure, stated[2], years, levels, [values], None


def _nrml(text: str) -> Iterator[_Stated]:
    """Mean, quantiles or one branch from the elements ``hazardCurves`` of an NRML file."""
    if "<!DOCTYPE" in text:  # whose entities may be endless
        raise InputError("declares a document type, which NRML does not have")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"is not XML ({error})") from None
    groups = root.findall(".//{*}hazardCurves")
    if not groups:
        raise InputError(f"has no element hazardCurves, but {root.tag}")
    for group in groups:
        name = group.get("statistics", "one branch")
        if name == "quantile":
            name = f"quantile-{group.get('quantileValue', '')}"
        years, imt = float(group.get("investigationTime", "")), group.get("IMT", "not stated")
        measure = f"{imt}({period})" if (period := group.get("saPeriod")) else imt
        curves = group.findall("{*}hazardCurve")
        sites = [_numbers(curve, "pos")[:2] for curve in curves]
        values = [_numbers(curve, "poEs") for curve in curves]
        yield name, measure, _UNITS.get(imt), years, _numbers(group, "IMLs"), values, sites


def _numbers(element: ElementTree.Element, tag: str) -> list[float]:
    text = element.findtext(f".//{{*}}{tag}")
    if text is None:
        raise InputError(f"has an element without {tag}")
    return [float(cell) for cell in text.split()]
