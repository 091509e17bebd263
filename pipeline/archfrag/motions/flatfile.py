"""Measures of many records as one table, with the columns of an NGA flatfile."""

import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from archfrag.errors import InputError, RecordError, reason_of
from archfrag.files import read_text, unquoted
from archfrag.motions.measures import measure_all
from archfrag.motions.motion import STANDARD_GRAVITY, Motion

LARGEST_TABLE = 200_000_000  # [bytes]
PERIODS = (
    0.01, 0.02, 0.03, 0.05, 0.075, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0,
    4.0, 5.0, 7.5, 10.0,
)  # fmt: skip
# Column, measure, and what a value in its unit is in SI.
_PEAKS = (("PGA_g", "PGA", STANDARD_GRAVITY), ("PGV_cms", "PGV", 0.01), ("PGD_cm", "PGD", 0.01))
_INTEGRALS = (
    ("arias_mps", "Arias", 1.0), ("CAV_mps", "CAV", 1.0), ("CAVstd_mps", "CAVstd", 1.0),
    ("D5_95_s", "D5_95", 1.0), ("HI_cm", "HI", 0.01),
)  # fmt: skip
# Column, its type, and the keys of a motion's metadata; the first one that is there counts.
_FACTS: dict[str, tuple[Any, ...]] = {
    "file": ("string", "file"), "event": ("string", "event"), "station": ("string", "station"),
    "magnitude": (float, "Mw", "magnitude"),
    "distance_km": (float, "distance_km", "epicentral_km"),
    "vs30_mps": (float, "Vs30_mps", "vs30_mps"), "component": ("string", "component"),
}  # fmt: skip
_TYPES = {"record": "string", **{name: kind for name, (kind, *_) in _FACTS.items()}}


def measure_records(motions: Iterable[Motion], periods: Sequence[float] = PERIODS) -> pd.DataFrame:
    """Measure records, one row each, taken one after the other.

    Columns are ``record``, ``file``, ``event``, ``station``, ``magnitude``, ``distance_km``,
    ``vs30_mps``, ``component``, ``scale``, ``dt_s``, ``PGA_g``, ``PGV_cms``, ``PGD_cm``,
    ``T0.100S`` and so on [g] at `periods` [s] of no more than three decimals, ``arias_mps``,
    ``CAV_mps``, ``CAVstd_mps``, ``D5_95_s`` and ``HI_cm``. InputError for other periods.
    """
    if wrong := [t for t in periods if round(t, 3) != t]:
        raise InputError(f"period {wrong[0]:g} s must have no more than three decimals")
    spectrum = [(f"T{t:.3f}S", f"Sa({t!r})", STANDARD_GRAVITY) for t in map(float, periods)]
    listed, rows = [*_PEAKS, *spectrum, *_INTEGRALS], []
    for motion in motions:
        values, about = measure_all(motion, [name for _, name, _ in listed]), motion.metadata
        row: dict[str, Any] = {"record": motion.id}
        for column, (_, *keys) in _FACTS.items():
            known = (about[key] for key in keys if about.get(key) not in (None, ""))
            row[column] = next(known, None)
        row |= {"scale": about.get("scale", 1.0), "dt_s": motion.dt}
        rows.append(row | {column: values[name] / unit for column, name, unit in listed})
    table = pd.DataFrame(rows)
    return table.astype({name: kind for name, kind in _TYPES.items() if name in table})


def read_flatfile(path: str | Path) -> pd.DataFrame:
    """Read a flatfile; columns that are not ours are kept.

    InputError if it is missing, no CSV with a column ``record``, or holds text for numbers.
    """
    table = read_table(path, "the flatfile", dtype=_TYPES)
    for name in table.columns[table.dtypes == "string"]:
        table[name] = table[name].map(unquoted, na_action="ignore")
    if "record" not in table:
        raise InputError(f"{path}: has no column 'record', by which a flatfile names its records")
    return table


def read_table(path: str | Path, what: str, **form: Any) -> pd.DataFrame:
    """Read a table in CSV by pandas, with errors that name the file."""
    text = read_text(Path(path), LARGEST_TABLE, InputError, what)
    try:
        return pd.read_csv(io.StringIO(text), skipinitialspace=True, **form)
    except ValueError as error:
        raise InputError(f"{path}: {what} cannot be read as CSV ({reason_of(error)})") from None


def numbers(table: pd.DataFrame, column: str, source: str) -> NDArray[np.float64]:
    """A column as numbers; nan where it is empty. RecordError if it is missing or holds text."""
    try:
        return pd.to_numeric(table[column]).to_numpy(dtype=np.float64)
    except KeyError:
        raise RecordError(f"{source}: column {column!r} is missing") from None
    except ValueError as error:
        raise RecordError(f"{source}: {column}: {error}") from None
