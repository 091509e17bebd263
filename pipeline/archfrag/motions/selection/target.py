"""What the spectra of selected records shall be distributed as."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from archfrag.errors import InputError, RecordError
from archfrag.files import read_text
from archfrag.motions.selection.models import (
    Array,
    Rupture,
    check_positive,
    correlation,
    predict,
)  # fmt: skip

PERIODS = tuple(float(f"{period:.3g}") for period in np.geomspace(0.05, 5.0, 20))
LARGEST_TARGET = 10_000_000  # [bytes]
_SAME = 1e-6  # relative difference of periods that are the same


@dataclass(frozen=True, eq=False)
class Target:
    """Distribution of ln Sa [ln g] at rising `periods` [s] that records are selected to.

    `ln_mean` (n_period,) and `covariance` (n_period, n_period), which is zero for a spectrum that
    is a mean only. `conditioning` is the period [s] at which Sa is given, so that every record is
    scaled to it; `notes` is what users of the target should know.
    """

    periods: Array
    ln_mean: Array
    covariance: Array
    conditioning: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def median(self) -> Array:
        """exp of the mean of ln Sa, shape (n_period,) [g]."""
        return np.exp(self.ln_mean)

    @property
    def sd(self) -> Array:
        """Standard deviation of ln Sa, shape (n_period,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def given(self) -> int | None:
        """Index of the conditioning period; None without one."""
        if self.conditioning is None:
            return None
        return int(np.abs(np.log(self.periods / self.conditioning)).argmin())


def conditional_spectrum(
    rupture: Rupture,
    level: float,
    conditioning: float,
    periods: ArrayLike = PERIODS,
    model: str = "CY14",
) -> Target:
    """Mean and covariance of ln Sa, given Sa at one period.

    With median exp(mu), standard deviation sigma and correlation rho, and epsilon =
    (ln level - mu*) / sigma* at the conditioning period T*:

    mean_i = mu_i + rho_i* epsilon sigma_i
    covariance_ij = sigma_i sigma_j (rho_ij - rho_i* rho_j*)

    Baker (2011), J. Struct. Eng. 137(3); Jayaram, Lin and Baker (2011), Earthquake Spectra
    27(3), 797-815.

    `level` is Sa at T* [g], `conditioning` is T* [s], added to the `periods` [s] if it is none of
    them. InputError if a number is not positive, a period occurs twice, or is outside the model's
    or the correlation's range.

    Examples
    --------
    >>> from archfrag.motions.selection import Rupture, conditional_spectrum
    >>> crustal = Rupture(magnitude=7.0, distance_km=15.0, vs30_mps=500.0)
    >>> target = conditional_spectrum(crustal, 0.4, 1.0, [0.2, 0.5, 1.0, 2.0])
    >>> target.median.round(2), target.sd.round(2)
    (array([0.72, 0.63, 0.4 , 0.15]), array([0.54, 0.43, 0.  , 0.46]))
    """
    check_positive(level, f"level = {level} g of Sa({conditioning} s)")
    check_positive(conditioning, f"conditioning period {conditioning} s")
    grid = _rising(periods, "periods")
    near = np.abs(np.log(grid / conditioning)) < _SAME
    grid = np.where(near, conditioning, grid) if near.any() else np.append(grid, conditioning)
    grid.sort()
    known = int(np.abs(np.log(grid / conditioning)).argmin())
    rho = correlation(grid[:, None], grid)
    median, sd, notes = predict(rupture, model, grid)
    mean = median + rho[known] * (np.log(level) - median[known]) / sd[known] * sd
    covariance = np.outer(sd, sd) * (rho - np.outer(rho[known], rho[known]))
    covariance[known, :] = covariance[:, known] = 0.0
    mean[known] = np.log(level)
    return Target(grid, mean, covariance, float(conditioning), notes)


def spectrum_target(
    periods: ArrayLike, median: ArrayLike, sd: ArrayLike | None = None, source: str = "target"
) -> Target:
    """A target from a spectrum [g] at periods [s]: of a code, of uniform hazard, with its scatter.

    `median` is exp of the mean of ln Sa, `sd` its standard deviation. Where that is 0 at one
    period, this is the conditioning period. Without it, or with zeros only, the target is a mean:
    records are sought that lie close to it. Correlations are those of Baker and Jayaram (2008).
    InputError, beginning with `source`, for numbers that are missing, not positive or not finite,
    a period that occurs twice, or an sd of 0 at several periods but not at all.
    """
    given = np.asarray(periods, dtype=np.float64)
    rising = _rising(given, f"{source}: periods")
    rows, zeros = [], np.zeros(given.shape)
    for values, name in ((median, "median Sa"), (zeros if sd is None else sd, "sd")):
        row = np.asarray(values, dtype=np.float64)
        if row.shape != given.shape or not np.isfinite(row).all():
            needed = f"must be finite numbers, one for each of {given.size} periods"
            raise InputError(f"{source}: {name} {row.tolist()} {needed}")
        rows.append(row[np.argsort(given)])
    sa, scatter = rows
    if not (sa > 0.0).all():
        raise InputError(f"{source}: median Sa {sa.min():g} g must be above 0")
    if (scatter < 0.0).any():
        raise InputError(f"{source}: sd {scatter.min():g} must not be below 0")
    zero = np.flatnonzero(scatter == 0.0)
    if zero.size == scatter.size:
        return Target(rising, np.log(sa), np.zeros((sa.size, sa.size)))
    if zero.size > 1:
        raise InputError(
            f"{source}: sd is 0 at {zero.size} periods; it may be at one, which then is the "
            "conditioning period, or at all"
        )
    rho = correlation(rising[:, None], rising)
    if zero.size:
        star = rho[zero[0]]
        rest = np.sqrt(np.where(star < 1.0, 1.0 - star**2, 1.0))
        rho = (rho - np.outer(star, star)) / np.outer(rest, rest)
        np.fill_diagonal(rho, 1.0)
    conditioning = float(rising[zero[0]]) if zero.size else None
    return Target(rising, np.log(sa), np.outer(scatter, scatter) * rho, conditioning)


def read_target(path: str | Path) -> Target:
    """Read a target from CSV with columns ``period_s``, ``Sa_g`` and, if it has one, ``sd``.

    See `spectrum_target` for what the columns mean; InputError or RecordError names the file.
    """
    text = read_text(Path(path), LARGEST_TARGET, InputError, "the target")
    try:
        rows = pd.read_csv(io.StringIO(text), skipinitialspace=True)
    except ValueError as error:
        raise InputError(f"{path}: the target is not a table in CSV ({error})") from None
    if rows.empty:
        raise InputError(f"{path}: the target has no rows")
    rows.attrs["source"] = path
    sd = numbers(rows, "sd") if "sd" in rows else None
    return spectrum_target(numbers(rows, "period_s"), numbers(rows, "Sa_g"), sd, str(path))


def numbers(table: pd.DataFrame, column: str) -> Array:
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
    """What messages call a table: its ``attrs["source"]`` where it has one."""
    return str(table.attrs.get("source", "the flatfile"))


def _rising(periods: ArrayLike, name: str) -> Array:
    values = np.sort(np.asarray(periods, dtype=np.float64).ravel())
    if not (values.size and np.isfinite(values).all() and values[0] > 0.0):
        raise InputError(f"{name} {values.tolist()} must be positive numbers of seconds")
    twice = np.flatnonzero(np.diff(np.log(values)) < _SAME)
    if twice.size:
        raise InputError(f"{name}: {values[twice[0]]:g} s is there twice")
    return values
