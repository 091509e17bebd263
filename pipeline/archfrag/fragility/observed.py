"""Tables of arches that were seen after earthquakes, and the shaking at each of them."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
from scipy.interpolate import RegularGridInterpolator

from archfrag.errors import InputError
from archfrag.files import number, read_text, stated_unit, table_of
from archfrag.fragility.curve import Curve, FloatArray, IntArray

Observed = Any  # path of a CSV, or a DataFrame or mapping of its columns
_LARGEST = 100_000_000  # [bytes] of a file
_COLUMNS = "state", "median", "tau", "phi", "sd", "lon", "lat", "event"
_OF_STATIONS = "observed", *_COLUMNS[1:]
_UNSEEN = ("survived", "none", "0")
_RADIUS = 6371.0  # of the earth [km]
# Units of ShakeMap's grids in SI units.
_UNITS = {"pctg": 0.0980665, "%g": 0.0980665, "cms": 0.01, "cm/s": 0.01}
# Ranges of correlation in Italy [km], a + b T with the period T [s]: Esposito and Iervolino 2011,
# Bull. Seismol. Soc. Am. 101, for PGA, and 2012, the same 102, for Sa(T), as BayesFrag has them.
_LENGTHS = {"PGA": (11.5, 0.0), "Sa": (8.6, 11.6)}


@dataclass(frozen=True)
class Damage:
    """Arches that one earthquake shook. Places are where intensities are alike."""

    state: IntArray  #: (n_arch,), number of the state that an arch reached, 0 if none
    centre: FloatArray  #: (n_arch,), ln of the median intensity
    own: FloatArray  #: (n_arch,), variance of ln intensity that is an arch's own
    place: IntArray  #: (n_arch,)
    shared: FloatArray  #: (n_place, n_place), covariance of ln intensity
    likeness: FloatArray  #: (n_place, n_place), correlation of the record-to-record part


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
    table = _table(observed, _COLUMNS, curve, share)
    if shakemap:
        if stations is not None or "median" in table:
            raise InputError(
                "shakemap: it has the intensities and the stations already; leave out stations "
                "and the columns median, tau, phi and sd"
            )
        table = _shaken(table, shakemap, curve, share)
    codes, states = _states(table, curve)
    needed = ("median", "tau", "phi")
    _require(table, needed, "the table of arches")
    table = table.assign(code=codes)
    known = None
    if stations is not None:
        known = _table(stations, _OF_STATIONS, curve, share)
        _require(known, (*needed, "observed", "lon", "lat"), "the table of stations")
        _require(table, ("lon", "lat"), "the table of arches")
    found = []
    for event, rows in table.groupby("event", sort=False):
        near = None if known is None else known[known["event"] == event]
        found.append(_damage(rows, near, lambda: _length(curve, length)))
    return found, states


def _table(
    given: Observed, names: Sequence[str], curve: Curve, share: float | None
) -> pd.DataFrame:
    """Return a table with numbers, tau and phi, and an event in each row."""
    if isinstance(given, str | os.PathLike):
        text = read_text(Path(given), _LARGEST, InputError, "the table")
        table = table_of(text)
    else:
        table = pd.DataFrame(given).astype(str)
    heads = dict[str, str]()
    for head in table:
        heads[head], unit = stated_unit(str(head).strip())
        if unit not in (None, curve.unit) and heads[head] in ("median", "observed"):
            raise InputError(f"column {head!r}: the curve is in {curve.unit}; convert it")
    table = table.rename(columns=heads)
    unknown = [name for name in table if name not in names]
    if unknown:
        raise InputError(f"column {unknown[0]!r} is not known; known are {', '.join(names)}")
    for name in {*table} - {"state", "event"}:
        least = -np.inf if name in ("lon", "lat") else 0.0
        try:
            values = np.array([number(each) for each in table[name]])
        except ValueError as error:
            raise InputError(f"column {name}: {error}") from None
        bad = values[~((values >= least) & np.isfinite(values))]
        if name in ("median", "observed"):
            bad = np.append(bad, values[values == 0.0])
        if bad.size:
            raise InputError(f"column {name} holds {bad[0]:g}; it must be a number from 0 upwards")
        table[name] = values
    if table.empty:
        raise InputError("the table has no rows")
    if "event" not in table:
        table["event"] = ""
    return _divided(table, share) if "sd" in table else table


def _divided(table: pd.DataFrame, share: float | None) -> pd.DataFrame:
    """Return a table with tau and phi from the total scatter in the column sd."""
    if share is None or not 0.0 <= share <= 1.0 or {"tau", "phi"} & {*table}:
        raise InputError(
            f"share is {share}; sd is a total scatter, and share, from 0 to 1, is the part of its "
            "variance that all places of an earthquake have in common (the between-event part); "
            "give it, or columns tau and phi instead of sd"
        )
    parts = {"tau": np.sqrt(share), "phi": np.sqrt(1.0 - share)}
    return table.assign(**{name: part * table["sd"] for name, part in parts.items()})


def _require(table: pd.DataFrame, names: Sequence[str], what: str) -> None:
    """Raise InputError unless a table has all columns."""
    lacking = [name for name in names if name not in table]
    if lacking:
        raise InputError(
            f"{what} has no column {', '.join(lacking)}; it needs {', '.join(names)} (median "
            "intensity; standard deviations of its ln between and within earthquakes)"
        )


def _states(table: pd.DataFrame, curve: Curve) -> tuple[IntArray, list[Curve]]:
    """Return the number of the state of each arch, and the curves of these states."""
    _require(table, ["state"], "the table of arches")
    every = curve.limit_states
    ordered = list(every)
    words = [word.strip().replace("_", " ") for word in table["state"]]
    last = {"collapsed", "reached", curve.state, curve.state.replace("_", " ")}
    rank = dict.fromkeys(_UNSEEN, -1) | {str(i + 1): i for i in range(len(ordered))}
    rank |= {name.replace("_", " "): i for i, name in enumerate(ordered)}
    rank |= dict.fromkeys(last, len(ordered) - 1)
    for word in words:
        if word not in rank:
            raise InputError(
                f"state {word!r} is not known; known are survived, collapsed, and the limit "
                f"states that have a curve: {', '.join(ordered)} (or their numbers, 0 for none)"
            )
    found = np.array([rank[word] for word in words])
    used = sorted({*found[found >= 0].tolist(), len(ordered) - 1})
    return np.searchsorted(used, found, side="right"), [every[ordered[i]] for i in used]


def _length(curve: Curve, length: float | None) -> float:
    """Return the range of correlation [km]; InputError if it is not known."""
    kind = re.fullmatch(r"(?:RotD50\()?(PGA|Sa)(?:\(([\d.]+)\))?\)?", curve.measure)
    if length is None and kind:
        first, rise = _LENGTHS[kind[1]]
        return first + rise * float(kind[2] or 0.0)
    if length is None or not 0.0 < length < np.inf:
        raise InputError(
            f"length is {length}; the distance in km at which intensities ({curve.measure}) of one "
            "earthquake are hardly correlated, exp(-3), must be given and be above 0"
        )
    return length


def _damage(rows: pd.DataFrame, stations: pd.DataFrame | None, length) -> Damage:
    """Return the damage of one earthquake."""
    spread = rows["phi"].to_numpy()
    own = np.zeros(len(rows))
    if "lon" not in rows:
        own = spread**2
        rows = rows.assign(lon=0.0, lat=0.0, phi=0.0)
    else:
        _require(rows, ["lat"], "the table of arches")
    keys = ["lon", "lat", "tau", "phi"]
    places, place = np.unique(rows[keys].to_numpy(), axis=0, return_inverse=True)
    place = place.ravel()
    centre = np.log(rows["median"].to_numpy())
    every = places
    if stations is not None:
        every = np.vstack([places, stations[keys].to_numpy()])
    likeness = np.ones((len(every), len(every)))
    if len(np.unique(every[:, :2], axis=0)) > 1:
        likeness = np.exp(-3.0 * _distances(every[:, 0], every[:, 1]) / length())
    _, _, tau, phi = every.T
    shared = np.outer(tau, tau) + np.outer(phi, phi) * likeness
    n = len(places)
    if stations is not None and len(stations):
        inside = shared[n:, n:] + 1e-6 * np.eye(len(stations))
        gain = np.linalg.solve(inside, shared[n:, :n]).T
        away = np.log(stations["observed"].to_numpy() / stations["median"].to_numpy())
        centre = centre + (gain @ away)[place]
        shared = shared[:n, :n] - gain @ shared[n:, :n]
    return Damage(rows["code"].to_numpy(), centre, own, place, shared[:n, :n], likeness[:n, :n])


def _distances(lon: FloatArray, lat: FloatArray) -> FloatArray:
    """Return great-circle distances between places by the haversine formula, (n, n) [km]."""
    x, y = np.radians([lon, lat])[..., None]
    h = np.sin((y - y.T) / 2) ** 2 + np.cos(y) * np.cos(y.T) * np.sin((x - x.T) / 2) ** 2
    return np.asarray(2.0 * _RADIUS * np.arcsin(np.sqrt(np.minimum(h, 1.0))))


def _shaken(
    table: pd.DataFrame, files: Sequence[str | os.PathLike[str]], curve: Curve, share
) -> pd.DataFrame:
    """Return a table with the intensities of ShakeMap's grids at its places."""
    _require(table, ["lon", "lat"], "the table of arches")
    period = re.fullmatch(r"(?:RotD50\()?Sa\(([\d.]+)\)\)?", curve.measure)
    field = re.sub(r"\W|RotD50", "", curve.measure)
    if period:
        field = f"PSA{10 * float(period[1]):02.0f}"
    at = table[["lat", "lon"]].to_numpy()
    found = dict[str, FloatArray]()
    for path in files:
        fields = _grid(Path(path))
        for name in {field, f"STD{field}"} & {*fields}:
            unit, axes, values = fields[name]
            if name == field:
                if unit not in _UNITS or not (values > 0.0).all():
                    raise InputError(f"{path}: {name} is in {unit!r}, or not above 0")
                values = np.log(values * _UNITS[unit] / curve.si)
            try:
                found[name] = RegularGridInterpolator(axes, values)(at)
            except ValueError as error:
                raise InputError(f"{path}: an arch is outside the grid: {error}") from None
    if len(found) < 2:
        raise InputError(
            f"shakemap: no {field} and STD{field}; give grid.xml and uncertainty.xml"
        )
    table = table.assign(median=np.exp(found[field]), sd=found[f"STD{field}"])
    return _divided(table, share)


def _grid(path: Path) -> Mapping[str, Any]:
    """Return the fields of ShakeMap's grid by name: unit, axes (lat, lon), values (lat, lon)."""
    text = read_text(path, _LARGEST, InputError, "the ShakeMap")
    try:
        root = ElementTree.fromstring(text.encode())
        parts = {each.tag.rpartition("}")[2]: each for each in root}
        heads = [each.attrib for each in root if each.tag.endswith("grid_field")]
        cells = np.array(parts["grid_data"].text.split(), float).reshape(-1, len(heads))
        heads = {each["name"]: (i, each["units"]) for i, each in enumerate(heads)}
        lon, lat = (cells[:, heads[name][0]] for name in ("LON", "LAT"))
        order = np.lexsort([lon, lat])
        axes = np.unique(lat), np.unique(lon)
        shape = tuple(map(len, axes))
        return {
            name: (unit, axes, cells[order, column].reshape(shape))
            for name, (column, unit) in heads.items()
        }
    except (ElementTree.ParseError, LookupError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: is damaged or no grid of ShakeMap ({error})") from None
