"""Hazard curves of a site from files: plain CSV, and OpenQuake's CSV.

OpenQuake's format is described in the engine's manual, in the section on the outputs of a
classical calculation.
"""

import contextlib
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.files import (
    check_thousands,
    check_years,
    number,
    read_text,
    stated_unit,
    table_of,
)
from archfrag.fragility.risk import HazardCurve
from archfrag.motions.measures import LEVEL_UNITS, Measure, measure_unit, parse_measure
from archfrag.properties import unusual

FARTHEST = 10.0  # [km], between the site asked for and the nearest one of the file
LARGEST = 100_000_000  # [bytes] of a file
_COLUMNS = tomllib.loads(
    Path(__file__).with_name("hazard_columns.toml").read_text("utf-8")
)
_RULE = (
    "the header is `im [g]` or the measure's name with its unit, such as `PGA [g]`, and then one "
    f"of {', '.join(_COLUMNS['rate']['names'])} (with or without [1/year]), poe_50 (probability "
    "of exceedance in 50 years) or return period [years]; further ones have a name at their end, "
    "as rate_NAME or poe_50_NAME. Brackets may be ( ), and separators are , ; or tab"
)
_UNITS = {
    "PGA": "g",
    "SA": "g",
    "PGV": "cm/s",
    "PGD": "cm",
    "IA": "m/s",
    "Sa_avg2": "g",
    "Sa_avg3": "g",
    "FIV3": "cm/s",
}  # of OpenQuake
# What a file states: its measure and unit, None if not stated, and its curves by name.
_Stated = tuple[str | None, str | None, list[tuple[str, HazardCurve]]]


@dataclass(frozen=True)
class Hazard:
    """Hazard curves of a site."""

    measure: str  # of the study it is for
    source: str  # file or files
    # By name, with intensities in the SI unit of the measure. Risk is quoted for the first, which
    # is the mean curve if there is one. Others are quantiles or branches of the epistemic
    # uncertainty.
    curves: dict[str, HazardCurve]
    messages: tuple[str, ...] = ()  # on what was assumed

    @property
    def main(self) -> HazardCurve:
        """The curve for which rates are quoted."""
        return next(iter(self.curves.values()))


def load_hazard(
    paths: Sequence[Path],
    measure: str,
    unit: str | None = None,
    site: Sequence[float] | None = None,
) -> Hazard:
    """Read the hazard curves of a site, of the study's intensity measure.

    `paths` are CSV files as `archfrag risk --help` describes them, or OpenQuake's, one for the
    mean and one for each quantile. `unit` is the unit of intensities in a file that states none.
    `site` is longitude and latitude [degrees], for files with several sites. InputError names the
    file and what is wrong.
    """
    found: dict[str, HazardCurve] = {}
    messages = []
    for path in paths:
        text = read_text(path, LARGEST, InputError, "the hazard curve")
        try:
            table = table_of(text)
            for line in table.index[(table == "").any(axis=1)]:
                raise InputError(f"line {line} has an empty cell; give it a number")
            by_site = {"lon", "lat"} <= set(table)
            if site is not None and not by_site:
                raise InputError(
                    "has no columns lon and lat; leave --site or risk.site out"
                )
            file = _openquake(text, table, site) if by_site else _plain(table)
            stated, own, curves = file
            factor = _factor(stated, own or unit, measure, unit, by_site)
            for name, curve in curves:
                if name in found:
                    raise InputError(f"has a second curve {name!r}")
                found[name] = replace(curve, im=curve.im * factor)
                messages += level_cautions(measure, found[name].im, str(path))
                messages += unusual(
                    "rate", curve.rate.max(), f"{path}: the largest rate"
                )
        except (InputError, ValueError) as error:
            must = "" if isinstance(error, InputError) else "must hold numbers, but: "
            raise InputError(f"{path}: {must}{error}") from None
        if stated is None:
            messages.append(
                f"{path}: does not name its measure, which is taken to be {measure}"
            )
        elif measure_of(stated) != parse_measure(measure):
            messages.append(
                f"{path}: the file states {stated} and no component, taken to be {measure}'s"
            )
    order = dict(sorted(found.items(), key=lambda pair: pair[0] != "mean"))
    return Hazard(measure, ", ".join(map(str, paths)), order, tuple(messages))


def level_cautions(measure: str, levels, place: str) -> list[str]:
    """Return a list with a question if the largest level is unusual; else an empty list.

    `levels` are in the SI unit of `measure`; `place` names them in the question.
    """
    kind = parse_measure(measure).kind
    return list(unusual(kind, np.max(levels), f"{place}: the largest {measure}"))


def hazard_of_table(table, measure: str, unit: str) -> Hazard:
    """Return the hazard of a table of intensities and annual rates, (n_point, 2).

    `unit` is that of the intensities. InputError if the table cannot be read.
    """
    try:
        points = _numbers(table)
    except (TypeError, ValueError):
        points = np.zeros(0)
    if points.ndim != 2 or points.shape[1] != 2:
        raise InputError(
            f"hazard: {type(table).__name__} cannot be read; it must be a path, or a table of "
            "two columns: intensity and annual rate of exceedance"
        )
    curve = HazardCurve(
        _factor(None, unit, measure, None, False) * points[:, 0], points[:, 1]
    )
    return Hazard(measure, "a table in Python", {"mean": curve})


def _numbers(table) -> NDArray[np.float64]:
    """Return the cells of a table as numbers, in its shape; ValueError if a cell is no number."""
    cells = np.asarray(table, dtype=object)
    return np.reshape([number(str(cell)) for cell in cells.ravel()], cells.shape)


def measure_of(stated: str) -> Measure | None:
    """Return the measure that a file states, in upper or lower case; None if it is not known."""
    with contextlib.suppress(InputError):
        return parse_measure(spelled(stated))
    return None


def spelled(name: str) -> str:
    """Return the name of a measure as archfrag spells it; upper or lower case do not matter."""
    known = _COLUMNS["measure"]
    return re.sub(r"\w+", lambda word: known.get(word[0].casefold(), word[0]), name)


def _factor(
    stated: str | None, own: str | None, measure: str, unit: str | None, by_site: bool
) -> float:
    """Return the unit of a file's intensities in SI units.

    `stated` and `own` are the measure and the unit of the file, None if it does not state them.
    `measure` and `unit` are those of the study. `by_site` is true for a file of OpenQuake, which
    states no component. InputError if measure or unit disagree, or if the unit is not one of the
    measure.
    """
    requested = parse_measure(measure)
    allowed = LEVEL_UNITS.get(measure_unit(measure), {})
    # OpenQuake states no component.
    accepted = (requested, requested._replace(rotated="")) if by_site else (requested,)
    if stated is not None and measure_of(stated) not in accepted:
        raise InputError(
            f"is a hazard of {stated}, but the study's levels are of {measure}"
        )
    if unit not in (None, own):
        raise InputError(f"gives {measure} in {own}, not in {unit}")
    if own not in allowed:
        what = f"{own!r} is not a unit of {measure}"
        if own is None:
            what = (
                f"only the unit of {measure} is missing: write `{stated or 'im'} "
                f"[{next(iter(allowed))}]` in the header, or give --unit or risk.unit"
            )
        raise InputError(f"{what}; allowed are {', '.join(allowed)}")
    return allowed[own]


def _nearest(sites, requested: Sequence[float] | None) -> int:
    """Return the row of the site that is nearest to a longitude and latitude [degrees].

    InputError if none is within `FARTHEST`, or if there are several sites and none is requested.
    """
    names = [f"{lon:g},{lat:g}" for lon, lat in sites]
    if requested is None:
        if len(names) == 1:
            return 0
        raise InputError(
            f"has {len(names)} sites; choose one by longitude and latitude, such as "
            f"{'; '.join(names[:3])}"
        )
    lon, lat = np.radians(np.reshape(sites, (-1, 2))).T
    lon0, lat0 = np.radians(requested)
    # Great-circle distances [km] by the haversine formula.
    h = (
        np.sin((lat - lat0) / 2) ** 2
        + np.cos(lat) * np.cos(lat0) * np.sin((lon - lon0) / 2) ** 2
    )
    away = 2.0 * 6371.0 * np.arcsin(np.sqrt(np.minimum(h, 1.0)))
    if not (away <= FARTHEST).any():
        raise InputError(
            f"has no site within {FARTHEST:g} km of longitude {requested[0]:g}, latitude "
            f"{requested[1]:g}"
        )
    return int(away.argmin())


def _openquake(text: str, table: pd.DataFrame, site: Sequence[float] | None) -> _Stated:
    """Return the measure, the unit and the curve that OpenQuake's CSV states for a site.

    Each row of the table is a site; its columns are probabilities of exceedance.
    """
    head = text.lstrip().split("\n", 1)[0]
    about = dict(re.findall(r"\b(\w+)=[\"']*([^\s,\"']+)", head))
    if not {"imt", "investigation_time"} <= about.keys():
        raise InputError(
            "looks like OpenQuake's, but its first line does not state imt and "
            "investigation_time"
        )
    poe = table.filter(like="poe-")
    im = [number(str(head).removeprefix("poe-")) for head in poe]
    row = _nearest(_numbers(table[["lon", "lat"]]), site)
    years = number(about["investigation_time"])
    curve = HazardCurve.from_exceedance(im, _numbers(poe)[row], years)
    unit = _UNITS.get(about["imt"].split("(")[0])
    return about["imt"], unit, [(about.get("kind", "one branch"), curve)]


def with_unit(head: str) -> tuple[str, str | None]:
    """Split a header into its name and its unit in lower case; None if it states no unit.

    Brackets of a measure, as in Sa(1), hold no unit.
    """
    name, unit = stated_unit(head)
    if unit is None or measure_of(head) is not None:
        return head, None
    return name, unit.casefold()


def _plain(table: pd.DataFrame) -> _Stated:
    """Return the measure, the unit and the curves that a plain table states.

    Its first column is intensities; each of the others is rates, probabilities or return periods.
    """
    first, *others = table.columns
    if not others:
        raise InputError(
            f"has {first[:60]!r} as its first of {len(others) + 1} columns; {_RULE}"
        )
    stated, unit = with_unit(first)
    curves = []
    for head in others:
        kind, rest = _kind(head)
        check_thousands(table[first].tolist(), first)
        if kind == "return period":
            check_years(table[head].tolist(), head)
        levels, values = (_numbers(table[column]) for column in (first, head))
        if kind == "poe":
            years, _, rest = rest.partition("_")
            curve = HazardCurve.from_exceedance(levels, values, number(years))
        else:
            with np.errstate(divide="ignore"):
                curve = HazardCurve(levels, values if kind == "rate" else 1.0 / values)
        curves.append((rest or "mean", curve))
    return (
        None if stated.casefold() in _COLUMNS["im"]["names"] else stated,
        unit,
        curves,
    )


def _kind(head: str) -> tuple[str, str]:
    """Return the kind of a column (rate, poe or return period) and the rest of its name.

    The rest names the curve; for poe it begins with the number of years. InputError if the name of
    the column is not known.
    """
    text, unit = with_unit(head)
    for kind in ("rate", "poe", "return period"):
        known = _COLUMNS[kind]
        rest = r"_([\d.eE+-]+(?:_.+)?)" if kind == "poe" else "(?:_(.+))?"
        names = "|".join(known["names"]).replace(" ", "[ _]")
        found = re.fullmatch(f"(?:{names}){rest}", text, re.IGNORECASE)
        if found and (unit is None or unit in known["units"]):
            return kind, found[1] or ""
    raise InputError(f"has a column {head[:60]!r}; {_RULE}")
