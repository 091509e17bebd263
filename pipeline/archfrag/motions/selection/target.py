"""What the spectra of selected records shall be distributed as."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError
from archfrag.files import read_text
from archfrag.motions.selection.candidates import numbers
from archfrag.motions.selection.models import Rupture, correlation, predict

PERIODS = tuple(float(f"{period:.3g}") for period in np.geomspace(0.05, 5.0, 20))
LARGEST_TARGET = 10_000_000  # [bytes]
_SAME = 1e-6  # relative difference of periods that are the same


@dataclass(frozen=True, eq=False)
class Target:
    """Distribution of ln Sa that records are selected to.

    Attributes
    ----------
    periods : numpy.ndarray, shape (n_period,) [s]
        Increasing.
    ln_mean : numpy.ndarray, shape (n_period,)
        Mean of ln Sa, Sa in g.
    covariance : numpy.ndarray, shape (n_period, n_period)
        Of ln Sa; zero for a spectrum that is a mean only.
    conditioning : float or None [s]
        Period T* at which Sa is given, so that every record is scaled to it.
    notes : tuple of str
        What whoever uses the target should know.
    """

    periods: NDArray[np.float64]
    ln_mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    conditioning: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def median(self) -> NDArray[np.float64]:
        """exp of the mean of ln Sa, shape (n_period,) [g]."""
        return np.exp(self.ln_mean)

    @property
    def sd(self) -> NDArray[np.float64]:
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

    Parameters
    ----------
    rupture : Rupture
    level : float [g]
        Sa at the conditioning period.
    conditioning : float [s]
        T*; added to the periods if it is none of them.
    periods : array_like, shape (n_period,) [s]
        Twenty from 0.05 to 5 s where not given.
    model : str
        Ground-motion model, see `predict`.

    Returns
    -------
    Target

    Raises
    ------
    InputError
        If a number is not positive, a period occurs twice, or is outside the model's or the
        correlation's range.

    Examples
    --------
    >>> from archfrag.motions.selection import Rupture, conditional_spectrum
    >>> crustal = Rupture(magnitude=7.0, distance_km=15.0, vs30_mps=500.0)
    >>> target = conditional_spectrum(crustal, 0.4, 1.0, [0.2, 0.5, 1.0, 2.0])
    >>> target.median.round(2), target.sd.round(2)
    (array([0.72, 0.63, 0.4 , 0.15]), array([0.54, 0.43, 0.  , 0.46]))
    """
    for name, value in ((f"level = {level} g of Sa({conditioning} s)", level),
                        (f"conditioning period {conditioning} s", conditioning)):  # fmt: skip
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be a number above 0")
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
    order = np.argsort(given)
    sa = _like(median, given, f"{source}: median Sa")[order]
    if not (sa > 0.0).all():
        raise InputError(f"{source}: median Sa {sa.min():g} g must be above 0")
    scatter = np.zeros(given.size) if sd is None else _like(sd, given, f"{source}: sd")[order]
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

    See `spectrum_target` for what the columns mean.

    Raises
    ------
    InputError, RecordError
        Naming the file and, for a value, its column.

    Examples
    --------
    >>> from pathlib import Path
    >>> from archfrag.motions.selection import read_target
    >>> rows = ["period_s,Sa_g,sd", "0.2,0.9,0.5", "1.0,0.4,0", "2.0,0.2,0.4"]
    >>> _ = Path("target.csv").write_text("\\n".join(rows))
    >>> read_target("target.csv").conditioning
    1.0
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


def _rising(periods: ArrayLike, name: str) -> NDArray[np.float64]:
    values = np.asarray(periods, dtype=np.float64)
    if values.ndim != 1 or not values.size:
        raise InputError(f"{name} must be one row of numbers, not of shape {values.shape}")
    values = np.sort(values)
    if not (np.isfinite(values).all() and values[0] > 0.0):
        raise InputError(f"{name} {values.tolist()} must be positive numbers of seconds")
    twice = np.flatnonzero(np.diff(np.log(values)) < _SAME)
    if twice.size:
        raise InputError(f"{name}: {values[twice[0]]:g} s is there twice")
    return values


def _like(values: ArrayLike, periods: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    row = np.asarray(values, dtype=np.float64)
    if row.shape != periods.shape:
        raise InputError(f"{name} has shape {row.shape}; the periods have {periods.shape}")
    if not np.isfinite(row).all():
        raise InputError(f"{name} {row.tolist()} must be finite numbers")
    return row
