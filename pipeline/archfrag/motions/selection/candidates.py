"""Records of a flatfile that may be selected, and their spectra."""

import re
from collections.abc import Iterable

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import RecordError

TRUTH = {"true": True, "false": False, "1": True, "0": False, "1.0": True, "0.0": False}
_SPECTRAL = re.compile(r"T(\d+(?:\.\d+)?)S")
_SAME = 1e-6  # difference of ln T of periods that are the same
_WIDEST = 2.0  # ratio of neighbouring periods between which ln Sa is interpolated
Range = tuple[float | None, float | None]


def screen(
    table: pd.DataFrame,
    *,
    magnitude: Range | None = None,
    distance_km: Range | None = None,
    vs30_mps: Range | None = None,
    pulse: bool | None = None,
) -> pd.DataFrame:
    """Rows of a flatfile within ranges; a row without the value asked about is left out.

    Ranges are a least and a largest value, both included, None for an open end; `pulse` is True
    for records with a velocity pulse only, False for those without. RecordError if a column is
    missing, a range is upside down, or nothing is left, with what each condition left.

    Examples
    --------
    >>> import pandas as pd
    >>> from archfrag.motions.selection import screen
    >>> flatfile = pd.DataFrame({"record": ["a", "b"], "magnitude": [5.6, 6.8]})
    >>> list(screen(flatfile, magnitude=(6.0, None))["record"])
    ['b']
    """
    kept, story = table, [f"{len(table)} records"]
    ranges = {"magnitude": magnitude, "distance_km": distance_km, "vs30_mps": vs30_mps}
    for column, limits in ranges.items():
        if limits is None:
            continue
        low = -np.inf if limits[0] is None else limits[0]
        high = np.inf if limits[1] is None else limits[1]
        if not low <= high:
            raise RecordError(f"{column} from {low:g} to {high:g} is upside down")
        values = numbers(kept, column)
        kept = kept[(values >= low) & (values <= high)]
        story.append(f"{column} from {low:g} to {high:g} leaves {len(kept)}")
    if pulse is not None:
        truth = column_of(kept, "pulse").map(lambda value: TRUTH.get(str(value).strip().lower()))
        kept = kept[[value is pulse for value in truth]]
        story.append(f"pulse = {str(pulse).lower()} leaves {len(kept)}")
    if kept.empty:
        raise RecordError(f"{name_of(table)}: no record is left; {', '.join(story)}")
    return kept


def sorted_candidates(table: pd.DataFrame) -> pd.DataFrame:
    """The rows in the order of their ids, so that a selection does not hang on that of a file."""
    ids = column_of(table, "record").astype(str)
    if table.empty:
        raise RecordError(f"{name_of(table)}: has no record")
    if ids.duplicated().any():
        twice = ids[ids.duplicated()].iloc[0]
        raise RecordError(f"{name_of(table)}: record {twice!r} is there twice")
    return table.iloc[np.argsort(ids.to_numpy(dtype=str))].reset_index(drop=True)


def spectra(table: pd.DataFrame, periods: ArrayLike) -> NDArray[np.float64]:
    """ln Sa [g] of the records of a flatfile, shape (n_record, n_period).

    Linear in ln T between columns ``T0.100S`` (g) that are at most a factor 2 apart; nan where a
    value is missing or not positive (-999 in NGA flatfiles).
    """
    have, names = _columns(table)
    if not names:
        raise RecordError(f"{name_of(table)}: has no column of Sa, such as T0.100S in g")
    wanted = np.atleast_1d(np.asarray(periods, dtype=np.float64))
    outside = wanted[(wanted < have[0] * (1.0 - 1e-6)) | (wanted > have[-1] * (1.0 + 1e-6))]
    if outside.size:
        given = f"has Sa from {have[0]:g} to {have[-1]:g} s"
        raise RecordError(f"{name_of(table)}: {given}, the target asks for {outside[0]:g} s")
    place = np.interp(np.log(wanted), np.log(have), np.arange(have.size))
    near, before = np.rint(place).astype(int), np.maximum(np.ceil(place).astype(int) - 1, 0)
    same, after = np.abs(np.log(have[near] / wanted)) < _SAME, np.ceil(place).astype(int)
    apart = ~same & (have[after] / have[before] > _WIDEST * (1.0 + 1e-6))
    if apart.any():
        first = int(apart.argmax())
        raise RecordError(
            f"{name_of(table)}: has no Sa between {have[before[first]]:g} and "
            f"{have[after[first]]:g} s, too far apart to interpolate the target's "
            f"{wanted[first]:g} s"
        )
    ln_sa = np.column_stack([numbers(table, name) for name in names])
    with np.errstate(invalid="ignore", divide="ignore"):
        ln_sa = np.log(np.where(ln_sa > 0.0, ln_sa, np.nan))
    part = place - before
    between = (1.0 - part) * ln_sa[:, before] + part * ln_sa[:, after]
    return np.where(same, ln_sa[:, near], between)


def is_column(table: pd.DataFrame, period: float) -> bool:
    """Whether a flatfile has Sa at a period itself, so that it need not be interpolated."""
    return bool((np.abs(np.log(_columns(table)[0] / period)) < _SAME).any())


def groups(table: pd.DataFrame, columns: Iterable[str]) -> NDArray[np.int64]:
    """A number for each row, the same where all these columns agree; one alone if any is empty."""
    known = table.reindex(columns=list(columns)).astype("string").fillna("")
    full = (known.apply(lambda column: column.str.strip()) != "").all(axis=1).to_numpy(bool)
    same = known.groupby(list(known.columns), sort=False).ngroup()
    return np.unique(np.where(full, same, -1 - np.arange(len(table))), return_inverse=True)[1]


def numbers(table: pd.DataFrame, column: str) -> NDArray[np.float64]:
    """A column as numbers; nan where it is empty. RecordError if it is missing or holds text."""
    values = column_of(table, column)
    converted = pd.to_numeric(values, errors="coerce")
    wrong = values[converted.isna() & values.notna() & (values.astype(str).str.strip() != "")]
    if len(wrong):
        raise RecordError(f"{name_of(table)}: {column} = {wrong.iloc[0]!r} is not a number")
    return converted.to_numpy(dtype=np.float64)


def column_of(table: pd.DataFrame, column: str) -> pd.Series:
    """A column; RecordError if it is missing."""
    if column not in table.columns:
        raise RecordError(f"{name_of(table)}: column {column!r} is missing")
    return table[column]


def name_of(table: pd.DataFrame) -> str:
    """What messages call a flatfile: its ``attrs["source"]`` where it has one."""
    return str(table.attrs.get("source", "the flatfile"))


def _columns(table: pd.DataFrame) -> tuple[NDArray[np.float64], list[str]]:
    """Rising periods [s] and the names of their columns of Sa."""
    names = [str(column) for column in table.columns]
    found = sorted((float(m[1]), name) for name in names if (m := _SPECTRAL.fullmatch(name)))
    return np.array([period for period, _ in found]), [name for _, name in found]
