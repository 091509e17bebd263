"""Hazard curves of a site from files: plain CSV, OpenQuake's CSV and NRML."""

import contextlib
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from archfrag.errors import InputError
from archfrag.files import read_text
from archfrag.fragility.hazard_curve import HazardCurve
from archfrag.motions.measures import measure_unit, parse_measure
from archfrag.study.config import LEVEL_UNITS

_LARGEST = 100_000_000  # [bytes] of a file
_MEASURE_AND_UNIT = re.compile(r"([^\[\]]+?)\s*(?:\[([^\[\]]*)\])?")
_KIND = re.compile(r"(rate|poe_([0-9.eE+-]+))(?:_(.+))?")
_HEADER_RULE = (
    "the header is `im [g]` or the measure's name with its unit, such as `PGA [g]`, and then "
    "`rate` (annual frequency of exceedance) or `poe_50` (probability of exceedance in 50 years), "
    "further ones as `rate_NAME` or `poe_50_NAME`"
)


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


def load_hazard(
    paths: Path | Sequence[Path],
    measure: str,
    unit: str | None = None,
    site: tuple[float, float] | None = None,
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
    from archfrag.study.hazard_openquake import read_nrml, read_openquake_csv

    files = [paths] if isinstance(paths, Path) else list(paths)
    found: dict[str, HazardCurve] = {}
    notes: list[str] = []
    for path in files:
        text = read_text(path, _LARGEST, InputError, "the hazard curve")
        try:
            if text.lstrip().startswith("<"):
                part = read_nrml(text, measure, unit, site)
            elif re.search(r"^(\w+,)?lon,lat,", text, re.MULTILINE):
                part = read_openquake_csv(text, measure, unit, site)
            else:
                part = _plain(text, measure, unit)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        if double := found.keys() & part.curves.keys():
            raise InputError(
                f"{path}: has the curve {min(double)!r}, which an earlier file has too"
            )
        found |= part.curves
        notes += [f"{path}: {note}" for note in part.notes if f"{path}: {note}" not in notes]
    order = sorted(found, key=lambda name: name != "mean")
    source = ", ".join(map(str, files))
    return Hazard(measure, source, {name: found[name] for name in order}, tuple(notes))


def check_measure(stated: str, measure: str, component_known: bool) -> tuple[str, ...]:
    """Notes on a hazard of the measure `stated` used for a study of `measure`."""
    wanted, given = parse_measure(measure), None
    with contextlib.suppress(InputError):
        given = parse_measure(stated)
    if given == wanted:
        return ()
    if not component_known and given == wanted._replace(rotated=""):
        return (f"the file states {stated} and no component, taken to be that of {measure}",)
    raise InputError(f"is a hazard of {stated}, but the study's levels are of {measure}")


def unit_factor(unit: str | None, measure: str) -> float:
    """SI unit of a measure in multiples of `unit`."""
    allowed = LEVEL_UNITS.get(measure_unit(measure), {})
    if unit not in allowed:
        stated = "no unit is stated" if unit is None else f"unit {unit!r} is none of {measure}"
        raise InputError(f"{stated}; give one of {', '.join(allowed)}")
    return allowed[unit]


def number(text: str, place: str) -> float:
    """A number of a file."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{place} is {text[:40]!r}; a finite number is needed")
    return value


def _plain(text: str, measure: str, unit: str | None) -> Hazard:
    """Columns intensity and rates or probabilities; lines from # on are comments."""
    numbered = enumerate(text.splitlines(), 1)
    lines = [(i, line) for i, line in numbered if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        raise InputError("is empty; a hazard curve in CSV or NRML is needed")
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(line for _, line in lines)]
    except csv.Error as error:
        raise InputError(f"is no CSV ({error})") from None
    heads = rows[0]
    factor, notes = _first_head(heads[0], measure, unit)
    columns = _column_heads(heads[1:])
    values = np.empty((len(rows) - 1, len(heads)))
    for (line, _), row, store in zip(lines[1:], rows[1:], values):
        if len(row) != len(heads):
            raise InputError(f"line {line} has {len(row)} columns, the header {len(heads)}")
        store[:] = [number(cell, f"line {line}, column {h!r}") for cell, h in zip(row, heads)]
    curves = {}
    for i, (name, years) in enumerate(columns, 1):
        im, of = values[:, 0], values[:, i]
        try:
            curve = (
                HazardCurve.from_rates(im, of) if years is None
                else HazardCurve.from_exceedance(im, of, years)
            )  # fmt: skip
        except InputError as error:
            raise InputError(f"column {heads[i]!r}: {error}") from None
        curves[name] = replace(curve, im=curve.im * factor)
    return Hazard(measure, "", curves, notes)


def _first_head(head: str, measure: str, unit: str | None) -> tuple[float, tuple[str, ...]]:
    """Factor to the SI unit, and notes, from the head of the intensities' column."""
    found = _MEASURE_AND_UNIT.fullmatch(head)
    if not found:
        raise InputError(f"has {head[:60]!r} as its first column; {_HEADER_RULE}")
    name, stated = found.group(1), found.group(2)
    if stated is not None and unit is not None and stated != unit:
        raise InputError(f"states the unit {stated!r}, but the unit {unit!r} is asked for")
    notes: tuple[str, ...] = ()
    if name == "im":
        notes = (f"does not name its measure, which is taken to be {measure}",)
    else:
        try:
            parse_measure(name)
        except InputError:
            raise InputError(f"has {head[:60]!r} as its first column; {_HEADER_RULE}") from None
        check_measure(name, measure, component_known=True)
    return unit_factor(stated if stated is not None else unit, measure), notes


def _column_heads(heads: Sequence[str]) -> list[tuple[str, float | None]]:
    """Name of each curve, and the years of its probabilities; None for annual rates."""
    columns: list[tuple[str, float | None]] = []
    for head in heads:
        found = _KIND.fullmatch(head)
        if not found:
            raise InputError(f"has a column {head[:60]!r}; {_HEADER_RULE}")
        years = number(found.group(2), f"the years of column {head!r}") if found.group(2) else None
        name = found.group(3) or "mean"
        if name in (known for known, _ in columns):
            raise InputError(f"has two columns of the curve {name!r}")
        columns.append((name, years))
    if not columns:
        raise InputError(f"has one column; {_HEADER_RULE}")
    return columns
