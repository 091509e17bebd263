"""One row per intensity measure, from a grid of runs or from scattered ones."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr

from archfrag.errors import InputError
from archfrag.fragility.binomial_lines import binomial_lines
from archfrag.fragility.brackets import Brackets
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.measure_fits import (
    LogCapacities,
    MeasureFits,
    fit_capacities,
    fit_verdicts,
    log_capacities,
    weighted_normal,
)

SIGNIFICANCE = 0.05


@dataclass(frozen=True)
class MeasureRow:
    """One measure in the comparison; numbers are nan where they are not known.

    Attributes
    ----------
    measure : str
    theta : float
        Median capacity, in the unit of the measure.
    beta : float
        Dispersion of ln capacity in the measure.
    efficiency : float
        beta / exponent: dispersion of the amplitude at collapse of motions scaled to one value
        of the measure. The smaller the better; the same for a measure and its powers.
    practicality : float
        Slope of ln demand on ln im. Of a cloud with responses, that of the regression; else the
        demand is the margin ln(factor / factor at collapse), whose slope is 1 / exponent.
    proficiency : float
        Dispersion of demand over practicality (Padgett, Nielson and DesRoches 2008, EESD 37). With
        the margin as demand this is beta.
    slope_magnitude, p_magnitude : float
        Slope of ln capacity on magnitude, and the probability of so large a one by chance.
    slope_distance, p_distance : float
        The same on ln distance.
    sufficient : bool or None
        Neither p-value below 0.05; None where neither is known.
    log_likelihood : float
        Of the verdicts, for scattered runs.
    n_records, n_bracketed : int
        Records used; those whose capacity lies between two levels that were run.
    none : str
        Why there is no curve in this measure; empty where there is.
    """

    measure: str
    theta: float
    beta: float
    efficiency: float
    practicality: float
    proficiency: float
    slope_magnitude: float
    p_magnitude: float
    slope_distance: float
    p_distance: float
    sufficient: bool | None
    log_likelihood: float
    n_records: int
    n_bracketed: int
    none: str = ""


class Compared:
    """Runs of one arch in all measures; a measure not known for all records has fewer."""

    def __init__(
        self,
        used: NDArray[np.bool_],
        log_value: FloatArray,
        exponent: FloatArray,
        times: FloatArray,
    ) -> None:
        self.log_value = log_value
        self.exponent = exponent
        self.times = times
        self.used = used & np.isfinite(log_value)

    def rows(self, names: tuple[str, ...], covariates: FloatArray) -> list[MeasureRow]:
        rows: list[MeasureRow | None] = [None] * len(names)
        patterns, pattern = np.unique(self.used, axis=0, return_inverse=True)
        for i, keep in enumerate(patterns):
            members = np.flatnonzero(pattern.ravel() == i)
            fits, n_bracketed = self.fit(members, keep, covariates[:, keep])
            for j, member in enumerate(members.tolist()):
                rows[member] = self.row(names[member], member, fits, j, n_bracketed)
        return [row for row in rows if row is not None]

    def row(
        self, name: str, member: int, fits: MeasureFits, j: int, n_bracketed: int
    ) -> MeasureRow:
        exponent, beta = float(self.exponent[member]), float(fits.beta[j])
        slopes, p_values = fits.slopes[j], fits.p_values[j]
        known = p_values[np.isfinite(p_values)]
        practicality = self.practicality(member)
        none = "" if np.isfinite(beta) else self.why_none(member)
        return MeasureRow(
            measure=name,
            theta=float(np.exp(fits.log_theta[j])),
            beta=beta,
            efficiency=beta / exponent if exponent > 0.0 else np.nan,
            practicality=practicality[0],
            proficiency=practicality[1] if np.isfinite(practicality[1]) else beta,
            slope_magnitude=float(slopes[0]),
            p_magnitude=float(p_values[0]),
            slope_distance=float(slopes[1]),
            p_distance=float(p_values[1]),
            sufficient=bool(np.all(known >= SIGNIFICANCE)) if known.size and not none else None,
            log_likelihood=float(fits.log_likelihood[j]),
            n_records=int(np.count_nonzero(self.used[member])),
            n_bracketed=n_bracketed,
            none=none,
        )

    def practicality(self, member: int) -> tuple[float, float]:
        exponent = self.exponent[member]
        return (1.0 / float(exponent) if exponent > 0.0 else np.nan), np.nan

    def fit(
        self, members: NDArray[np.int64], keep: NDArray[np.bool_], covariates: FloatArray
    ) -> tuple[MeasureFits, int]:
        raise NotImplementedError

    def why_none(self, member: int) -> str:
        raise NotImplementedError

    def merit(self, row: MeasureRow) -> float:
        """The larger the better."""
        raise NotImplementedError

    def better_by(self, best: int, own: int) -> FloatArray:
        """By how much one measure is better than another in each resample; nan if unknown."""
        raise NotImplementedError


class GridRuns(Compared):
    def __init__(
        self, found: Brackets, log_value: FloatArray, exponent: FloatArray, times: FloatArray
    ) -> None:
        super().__init__(found.decided > 0, log_value, exponent, times)
        self.found = found

    def capacities(self, members: NDArray[np.int64], keep: NDArray[np.bool_]) -> LogCapacities:
        return log_capacities(
            self.found.rows(keep), self.log_value[members][:, keep], self.exponent[members]
        )

    def fit(self, members, keep, covariates):
        if np.count_nonzero(keep) < 2:
            nothing = np.full(len(members), np.nan)
            missing = np.full((len(members), len(covariates)), np.nan)
            return MeasureFits(nothing, nothing, nothing, missing, missing), 0
        fits = fit_capacities(self.capacities(members, keep), covariates)
        steady = self.exponent[members] <= 0.0
        fits.beta[steady] = fits.log_theta[steady] = np.nan
        return fits, int(np.count_nonzero(self.found.bracketed & keep))

    def why_none(self, member):
        if self.exponent[member] <= 0.0:
            return "scaling does not change this measure, so a grid has no capacity in it"
        return "fewer than two records with different capacities in this measure"

    def merit(self, row):
        return -row.efficiency

    def better_by(self, best, own):
        keep = self.used[best] & self.used[own]
        known = self.capacities(np.array([best, own]), keep)
        times = self.times[:, keep]
        with np.errstate(invalid="ignore", divide="ignore"):
            betas = [weighted_normal(known.only(i), times)[1] for i in (0, 1)]
            return np.log(betas[1] / self.exponent[own]) - np.log(betas[0] / self.exponent[best])


class ScatteredRuns(Compared):
    def __init__(
        self,
        codes: NDArray[np.int64],
        log_factor: FloatArray,
        log_value: FloatArray,
        exponent: FloatArray,
        times: FloatArray,
    ) -> None:
        decided = (codes == Verdict.STANDING) | (codes == Verdict.COLLAPSED)
        super().__init__(decided, log_value, exponent, times)
        self.fell = (codes == Verdict.COLLAPSED).astype(float)
        self.log_im = log_value + exponent[:, None] * log_factor
        self.log_response: FloatArray | None = None

    def use_response(self, response: ArrayLike | None) -> None:
        if response is None:
            return
        values = np.asarray(response, dtype=float)
        if values.shape != self.fell.shape:
            raise InputError(f"response has shape {values.shape}; one per record is needed")
        usable = (values > 0.0) & np.isfinite(values) & (self.fell == 0.0)
        self.log_response = np.where(usable, np.log(np.where(usable, values, 1.0)), np.nan)

    def practicality(self, member):
        if self.log_response is None:
            return super().practicality(member)
        keep = self.used[member] & np.isfinite(self.log_response)
        if np.count_nonzero(keep) < 3:
            return np.nan, np.nan
        x, y = self.log_im[member][keep], self.log_response[keep]
        off = x - x.mean()
        slope = float(off @ y / (off @ off))
        residual = y - y.mean() - slope * off
        return slope, float(np.sqrt(residual @ residual / (y.size - 2)) / slope)

    def fit(self, members, keep, covariates):
        return fit_verdicts(self.log_im[members][:, keep], self.fell[keep], covariates), 0

    def why_none(self, member):
        return "collapses and standing runs give no rising probit line in this measure"

    def merit(self, row):
        return row.log_likelihood

    def better_by(self, best, own):
        keep = self.used[best] & self.used[own]
        gains = []
        for member in (best, own):
            x, fell = self.log_im[member, keep], self.fell[keep]
            lines = binomial_lines(x, fell[None], np.ones((1, x.size)))
            z = lines.intercept[0] + lines.slope[0] * x
            gains.append(log_ndtr(np.where(fell == 1.0, z, -z)))
        return self.times[:, keep] @ (gains[0] - gains[1])
