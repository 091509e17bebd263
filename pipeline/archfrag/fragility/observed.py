"""Tables of arches that were seen after earthquakes, and the shaking at each of them."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy  # whose parts are loaded when they are used

from archfrag.errors import InputError
from archfrag.files import number, read_text, stated_unit, table_of
from archfrag.fragility.curve import Curve, FloatArray, IntArray

Observed = Any  # path of a CSV, or a DataFrame or mapping of its columns
_LARGEST = 100_000_000  # [bytes] of a file
_SHAKING = ["median", "tau", "phi"]
_PLACE = ["lon", "lat"]
_KNOWN = ["state", "observed", "sd", "event", *_SHAKING, *_PLACE]
# Least and largest value of a column; those of intensities are in the unit of the curve.
_BOUNDS = (
    dict.fromkeys(("median", "observed"), (1e-9, 1e9))
    | dict.fromkeys(("sd", "tau", "phi"), (0.0, 5.0))
    | {"lon": (-360.0, 360.0), "lat": (-90.0, 90.0)}
)
_TO_PLANE = 111.195  # km of a degree of a great circle
# Units of ShakeMap's grids in SI units.
_UNITS = {"pctg": 0.0980665, "%g": 0.0980665, "cms": 0.01, "cm/s": 0.01}
# Ranges of correlation in Italy [km], a + b T with the period T [s]: Esposito and Iervolino 2011,
# Bull. Seismol. Soc. Am. 101, for PGA, and 2012, the same 102, for Sa(T), as BayesFrag has them.
_LENGTHS = {"PGA": (11.5, 0.0), "Sa": (8.6, 11.6)}
_FIELD = re.compile(r'<grid_field\b[^>]*\bname="(\w+)"[^>]*\bunits="([^"]*)"')
_MEASURE = re.compile(r"(?:RotD\d+\()?([A-Za-z]*)(?:\(([\d.]+)\))?")


@dataclass(frozen=True)
class Damage:
    """Arches that one earthquake shook. Places are where intensities are alike."""

    state: IntArray  #: (n_arch,), number of the state that an arch reached, 0 if none
    centre: FloatArray  #: (n_arch,), ln of the median intensity
    own: FloatArray  #: (n_arch,), variance of ln intensity that is an arch's own
    place: IntArray  #: (n_arch,)
    shared: FloatArray  #: (n_place, n_place), covariance of ln intensity
    likeness: (
        FloatArray  #: (n_place, n_place), correlation of the record-to-record part
    )


def damage_of(
    curve: Curve,
    observed: Observed,
    stations: Observed = None,
    shakemap: Sequence[str | os.PathLike[str]] = (),
    length: float | None = None,
    share: float | None = None,
) -> tuple[list[Damage], list[Curve]]:
    """Return the damage of each earthquake, and the curves of the states that a table names.

    Arguments are those of `Curve.update`. InputError says what a table lacks.
    """
    table = _table(observed, curve)
    if shakemap:
        if stations is not None or "median" in table:
            raise InputError(
                "shakemap has intensities and stations already; leave out stations and median"
            )
        _complete(table, _PLACE)
        table = table.assign(**_shaken(table[_PLACE], shakemap, curve))
    needed = ["state", *_SHAKING]
    known = pd.DataFrame(columns=["event"])
    if stations is not None:
        needed += _PLACE
        known = _complete(
            _table(stations, curve), ["observed", *_SHAKING, *_PLACE], share
        )
    table = _complete(table, needed, share)
    codes, states = _states(table["state"], curve)
    found = [
        _damage(
            rows.assign(state=codes[rows.index]),
            known[known["event"] == event],
            curve,
            length,
        )
        for event, rows in table.groupby("event", sort=False)
    ]
    return found, states


def _table(given: Observed, curve: Curve) -> pd.DataFrame:
    """Return a table with numbers, and an event in each row; its attribute `place` names it."""
    place = "the table"
    if isinstance(given, str | os.PathLike):
        place = f"the table {given}"
        text = read_text(Path(given), _LARGEST, InputError, "the table")
        try:
            table = table_of(text)
        except InputError as error:
            raise InputError(f"{place}: {error}") from None
    else:
        table = pd.DataFrame(given).astype(str)
    if table.empty:
        raise InputError(f"{place} has no rows; give one for each arch or station")
    heads = [stated_unit(str(head).strip()) for head in table]
    table = table.set_axis([name for name, _ in heads], axis=1).reset_index(drop=True)
    for name, unit in heads:
        _check_head([*table], name, unit, curve, place)
        if name not in ("state", "event"):
            table[name] = _numbers(table[name], place)
    table.attrs["place"] = place
    return table if "event" in table else table.assign(event="")


def _check_head(
    names: list[str], name: str, unit: str | None, curve: Curve, place: str
) -> None:
    """Raise InputError unless a column is known, there once, and in the unit of the curve."""
    why = ""
    if name not in _KNOWN:
        why = f"is not known; known are {', '.join(_KNOWN)}"
    elif names.count(name) > 1:
        why = "is there twice; leave one out"
    elif unit not in (None, curve.unit):
        why = (
            f"is in {unit}; intensities must be in {curve.unit}, the unit of the curve"
        )
    if why:
        raise InputError(f"{place}: column {name!r} {why}")


def _numbers(cells: pd.Series, place: str) -> pd.Series:
    """Return the numbers of a column; InputError for what cannot be one of it."""
    low, high = _BOUNDS[str(cells.name)]
    for cell in cells:
        try:
            good = low <= number(cell) <= high
        except ValueError as error:
            raise InputError(f"{place}: column {cells.name!r}: {error}") from None
        if not good:
            raise InputError(
                f"{place}: column {cells.name!r} has {cell}; from {low:g} to {high:g} is allowed"
            )
    return cells.map(number)


def _complete(
    table: pd.DataFrame, names: Sequence[str], share: float | None = None
) -> pd.DataFrame:
    """Return a table with tau and phi, which are parts of the column sd if there is one.

    InputError unless it has all columns `names`.
    """
    if "sd" in table:
        if share is None or not 0.0 <= share <= 1.0:
            raise InputError(
                f"share is {share}; sd is a total scatter, and share, from 0 to 1, is the part of "
                "its square that all places of an earthquake have in common: give it, or columns "
                "tau and phi instead of sd"
            )
        tau, phi = (np.sqrt(part) * table["sd"] for part in (share, 1.0 - share))
        table = table.drop(columns="sd").assign(tau=tau, phi=phi)
    for name in names:
        if name not in table:
            raise InputError(
                f"{table.attrs['place']} has no column {name!r}; it needs "
                f"{', '.join(names)} (tau and phi: standard deviations of ln intensity between "
                "and within earthquakes)"
            )
    return table


def _states(words: pd.Series, curve: Curve) -> tuple[IntArray, list[Curve]]:
    """Return the number of the state of each arch, and the curves of these states."""
    curves = [*curve.limit_states.values()]
    last = len(curves)
    number_of = {"survived": 0, "collapsed": last} | {
        str(i): i for i in range(last + 1)
    }
    number_of |= {each.state: i for i, each in enumerate(curves, 1)}
    found = words.str.strip().str.replace("_", " ").map(number_of)
    if found.isna().any():
        word = words[found.isna()].iloc[0]
        raise InputError(
            f"{words.attrs['place']}: column 'state' has {word!r}, which is not known; known are "
            f"{', '.join(number_of)}"
        )
    used = sorted({*found[found > 0], last})
    return np.searchsorted(used, found, side="right"), [
        curves[int(i) - 1] for i in used
    ]


def _correlation(places: FloatArray, curve: Curve, length: float | None) -> FloatArray:
    """Return exp(-3 h / length) between places, (n, 2) longitude and latitude, (n, n)."""
    plane = _TO_PLANE * places * [np.cos(np.radians(places[:, 1].mean())), 1.0]
    away = scipy.spatial.distance.cdist(plane, plane)
    ((kind, period), *_) = _MEASURE.findall(curve.measure)
    if length is None and kind in _LENGTHS:
        first, rise = _LENGTHS[kind]
        length = first + rise * float(period or 0.0)
    if away.any() and not (length and 0.0 < length < np.inf):
        raise InputError(
            f"length is {length}; give the distance [km], above 0, at which intensities of an "
            f"earthquake ({curve.measure or 'no measure'}) correlate by exp(-3)"
        )
    return np.exp(-3.0 * away / (length or 1.0))


def _damage(
    rows: pd.DataFrame, stations: pd.DataFrame, curve: Curve, length: float | None
) -> Damage:
    """Return the damage of one earthquake."""
    own = np.zeros(len(rows))
    if "lon" not in rows:
        own = rows["phi"].to_numpy() ** 2
        rows = rows.assign(lon=0.0, lat=0.0, phi=0.0)
    _complete(rows, _PLACE)
    keys = [*_PLACE, "tau", "phi"]
    every, place = np.unique(rows[keys].to_numpy(), axis=0, return_inverse=True)
    n = len(every)
    if len(stations):
        every = np.vstack([every, stations[keys].to_numpy()])
    likeness = _correlation(every[:, :2], curve, length)
    tau, phi = every[:, 2:].T
    shared = np.outer(tau, tau) + np.outer(phi, phi) * likeness
    centre = np.log(rows["median"].to_numpy())
    place = place.ravel()
    if len(stations):
        inside = shared[n:, n:] + 1e-6 * np.eye(len(stations))
        gain = np.linalg.solve(inside, shared[n:, :n]).T
        centre = (
            centre + (gain @ np.log(stations["observed"] / stations["median"]))[place]
        )
        shared[:n, :n] -= gain @ shared[n:, :n]
    return Damage(
        rows["state"].to_numpy(), centre, own, place, shared[:n, :n], likeness[:n, :n]
    )


def _shaken(
    places: pd.DataFrame, files: Sequence[str | os.PathLike[str]], curve: Curve
) -> dict[str, FloatArray]:
    """Return median and sd of the intensity at places, from ShakeMap's grids."""
    ((kind, period), *_) = _MEASURE.findall(curve.measure)
    field = f"PSA{10 * float(period):02.0f}" if period else kind
    found = dict[str, FloatArray]()
    for path in files:
        text = read_text(Path(path), _LARGEST, InputError, "the ShakeMap")
        units = dict(_FIELD.findall(text))
        cells = text.partition("<grid_data>")[2].partition("<")[0].split()
        try:
            grid = pd.DataFrame(
                np.reshape(cells, (-1, len(units))).astype(float), columns=[*units]
            )
            nodes = grid[["LON", "LAT"]].to_numpy()
            for name in {field, f"STD{field}"} & {*units}:
                values = grid[name].to_numpy()
                if name == field:
                    values = np.log(values * _UNITS[units[name]] / curve.si)
                found[name] = scipy.interpolate.LinearNDInterpolator(nodes, values)(
                    places.to_numpy()
                )
        except (LookupError, ValueError) as error:
            raise InputError(
                f"{path}: is damaged or no grid of ShakeMap: {error}"
            ) from None
    if len(found) < 2 or not np.isfinite([*found.values()]).all():
        raise InputError(
            f"shakemap: no {field} and STD{field} at all places; give grid.xml and "
            "uncertainty.xml of this measure that cover them"
        )
    return {"median": np.exp(found[field]), "sd": found[f"STD{field}"]}
