"""One row per intensity measure, from a grid of runs or from scattered ones."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import log_ndtr, stdtr

from archfrag.fragility.brackets import Brackets
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import BoolArray, FloatArray, IntArray
from archfrag.fragility.lines import binomial_lines, inverse_mills, normal_lines

SIGNIFICANCE = 0.05
_LEAST = 5  # earthquakes (of magnitude) or records (of distance) that a test needs


@dataclass(frozen=True)
class MeasureRow:
    """One measure in the comparison; numbers are nan where they are not known."""

    measure: str
    theta: float  #: median capacity, in the unit of the measure
    beta: float  #: dispersion of ln capacity in the measure
    #: beta / exponent: dispersion of the amplitude at collapse of motions scaled to one value of
    #: the measure. The smaller the better; the same for a measure and its powers.
    efficiency: float
    slope_magnitude: float  #: of ln capacity on magnitude
    p_magnitude: float  #: probability of so large a slope by chance
    slope_distance: float  #: of ln capacity on ln distance
    p_distance: float
    sufficient: bool | None  #: neither p-value below 0.05; None where neither is known
    log_likelihood: float  #: of the verdicts, for scattered runs
    n_records: int  #: records used
    n_bracketed: int  #: those whose capacity lies between two levels that were run
    none: str = ""  #: why there is no curve in this measure; empty where there is


class MeasureFits(NamedTuple):
    """Fits in each measure, arrays (n_measure,); nan where there is none."""

    log_theta: FloatArray
    beta: FloatArray
    log_likelihood: FloatArray
    slopes: FloatArray  #: (n_measure, n_covariate), of ln capacity on the covariate
    p_values: FloatArray  #: (n_measure, n_covariate), probability of so large a one by chance


class LogCapacities(NamedTuple):
    """ln capacities of records in each measure, (n_measure, n_record), some as bounds only."""

    lower: FloatArray  #: the middle of each record's bracket, or -inf
    upper: FloatArray  #: the same middle, or inf
    rounding: FloatArray  #: variance that the bracket's width adds: its square over 12, or 0

    @property
    def exact(self) -> BoolArray:
        """Which records have a value, the same in all measures, (n_record,)."""
        return self.lower[0] == self.upper[0]

    def at(self, index: Any) -> "LogCapacities":
        """The same of some measures and records."""
        return LogCapacities(*(part[index] for part in self))  # type: ignore[call-arg]


def log_capacities(found: Brackets, log_value: FloatArray, exponent: FloatArray) -> LogCapacities:
    """Capacities in measures, from brackets of the scale factor of decided records.

    `log_value`, (n_measure, n_record), is of the unscaled motion, `exponent`, (n_measure,), the
    power of the scale factor in each measure.
    """
    known = found.bracketed
    lower, upper = np.where(known, found.middle, (found.lower, found.upper))
    low, high = np.where(known, (found.lower, found.upper), 1.0)
    power = exponent[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        low_end, high_end = (
            np.where(np.isfinite(end), log_value + power * end, end)
            for end in (np.log(lower), np.log(upper))
        )
        return LogCapacities(low_end, high_end, (power * np.log(high / low)) ** 2 / 12.0)


def weighted_normal(known: LogCapacities, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and deviation of ln capacity for each row of weights or of capacities, (n_fit,) each.

    Without bounds they are the moments, with n - 1; with bounds the likeliest values, with the
    same factor. The variance that the brackets' width adds is taken out (Sheppard's correction)
    unless nothing would be left.
    """
    exact = known.exact
    y, counted = np.where(exact, known.lower, 0.0), weight * exact
    total, number = weight.sum(axis=1), counted.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (counted * y).sum(axis=1) / number
        square = (counted * (y - mean[:, None]) ** 2).sum(axis=1) / number
        if not exact.all():
            # Where the values do not differ the likelihood has no maximum.
            sound = np.flatnonzero(np.broadcast_to(square > 1e-18, mean.shape))
            mean, square = np.full((2, mean.size), np.nan)
            if sound.size:
                rows = [np.broadcast_to(part, (mean.size, exact.size)) for part in known[:2]]
                weights = np.broadcast_to(weight, rows[0].shape)
                found = normal_lines(
                    np.ones((exact.size, 1)), rows[0][sound], rows[1][sound], weights[sound]
                )
                mean[sound], square[sound] = found.coefficients[:, 0], found.deviation**2
        square = square * total / (total - 1.0)
        rounding = (weight * known.rounding).sum(axis=1) / number
        square = np.where(square > rounding, square - rounding, square)
    return mean, np.where(square > 0.0, np.sqrt(np.maximum(square, 0.0)), np.nan)


def _tests(covariates: FloatArray, event: IntArray) -> list[tuple[int, BoolArray, IntArray]]:
    """Covariates that can be tested, which runs know them, and what has one value of them.

    Magnitude is the first: it belongs to the earthquake, and records of one resemble each other.
    """
    found = []
    for j, values in enumerate(covariates):
        used = np.isfinite(values)
        groups = event if j == 0 else np.arange(values.size)
        known, place = np.unique(groups[used], return_inverse=True)
        if known.size >= _LEAST and np.ptp(values[used]) > 0.0:
            found.append((j, used, place))
    return found


def _sums(values: FloatArray, place: IntArray) -> FloatArray:
    """Sum of the values at each place, (..., n_place)."""
    return values @ (place[:, None] == np.arange(place.max() + 1)).astype(float)


def _expected(known: LogCapacities) -> FloatArray:
    """ln capacities, (n_measure, n_record); in the place of a bound what is expected beyond it."""
    mean, deviation = (
        part[:, None] for part in weighted_normal(known, np.ones((1, known.exact.size)))
    )
    with np.errstate(invalid="ignore"):
        low, high = ((end - mean) / deviation for end in known[:2])
        beyond = np.where(np.isfinite(low), inverse_mills(-low), -inverse_mills(high))
        return np.where(known.exact, known.lower, mean + deviation * beyond)


def _regressions(
    known: LogCapacities, covariate: FloatArray, place: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Slope of ln capacity on a covariate, and p-value, in each measure.

    A t test of the slope of the means at each place. Where there are bounds, the slope is the
    likeliest one.
    """
    exact, count = known.exact, np.bincount(place)
    off = _sums(covariate, place) / count
    off -= off.mean()
    y = _sums(_expected(known), place) / count
    y -= y.mean(axis=1, keepdims=True)
    slope, freedom = y @ off / (off @ off), off.size - 2
    residual = ((y - slope[:, None] * off) ** 2).sum(axis=1) / freedom
    with np.errstate(divide="ignore", invalid="ignore"):
        p_value = 2.0 * stdtr(freedom, -np.abs(slope) / np.sqrt(residual / (off @ off)))
    if np.count_nonzero(exact) < 4:
        return np.full_like(slope, np.nan), np.full_like(slope, np.nan)
    if not exact.all():
        design = np.column_stack([np.ones(covariate.size), covariate - covariate.mean()])
        # Where the values lie on a line exactly the likelihood has no maximum.
        y = known.lower[:, exact]
        fitted = design[exact] @ np.linalg.lstsq(design[exact], y.T, rcond=None)[0]
        sound = np.abs(y.T - fitted).max(axis=0) > 1e-9
        ends = known.lower[sound], known.upper[sound]
        slope[sound] = normal_lines(design, *ends, np.ones((1, covariate.size))).coefficients[:, 1]
    return slope, p_value


def fit_verdicts(
    log_im: FloatArray, fell: FloatArray, covariates: FloatArray, event: IntArray
) -> MeasureFits:
    """Probit lines of verdicts on ln im in each measure, and score tests of covariates.

    The score test asks whether a covariate, added to the line, would raise the likelihood (Rao
    1948, Proc. Camb. Phil. Soc. 44), by the scatter of the scores of earthquakes or records; its
    first Newton step is the slope that is given. `log_im` is (n_measure, n_run), `fell`, (n_run,),
    is 1 where the run collapsed and 0 where it stood.
    """
    lines = binomial_lines(log_im, np.broadcast_to(fell, log_im.shape), np.ones(log_im.shape))
    sound = ~lines.degenerate
    slopes, p_values = np.full((2, len(log_im), len(covariates)), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        for j, used, place in _tests(covariates, event):
            x, k = log_im[:, used], fell[used]
            part = binomial_lines(x, np.broadcast_to(k, x.shape), np.ones(x.shape))
            z = part.intercept[:, None] + part.slope[:, None] * x
            score, information = _score(z, x, k, covariates[j, used])
            keep = ~part.degenerate & (information > 0.0) & sound
            slopes[keep, j] = (-score.sum(axis=1) / information / part.slope)[keep]
            one_sided = _by_chance(_sums(score, place))
            p_values[keep, j] = 2.0 * np.minimum(one_sided, 1.0 - one_sided)[keep]
        parts = (-lines.intercept / lines.slope, 1.0 / lines.slope, -lines.loss)
        theta, beta, likelihood = (np.where(sound, part, np.nan) for part in parts)
        return MeasureFits(theta, beta, likelihood, slopes, p_values)


def _score(
    z: FloatArray, x: FloatArray, fell: FloatArray, extra: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Score of an added covariate by run, given the line z, and its information, (n_measure,)."""
    up, down = inverse_mills(z), inverse_mills(-z)
    first, weight = fell * up - (1.0 - fell) * down, up * down
    extra = extra - extra.mean()
    a, b, c = weight.sum(1), (weight * x).sum(1), (weight * x * x).sum(1)
    u, v = weight @ extra, (weight * x) @ extra
    determinant = np.where(a * c > b * b, a * c - b * b, np.inf)
    constant, slope = (c * u - b * v) / determinant, (a * v - b * u) / determinant
    own = extra - constant[:, None] - slope[:, None] * x  # what the line does not hold of it
    return first * own, (weight * own**2).sum(axis=1)


def _by_chance(parts: FloatArray) -> FloatArray:
    """Probability that independent parts of mean 0 have so large a sum, by Student's t, (...)."""
    n = parts.shape[-1]
    ratio = parts.sum(axis=-1) / np.sqrt((parts**2).sum(axis=-1))
    return np.asarray(stdtr(n - 1, -ratio * np.sqrt((n - 1) / (n - ratio**2))))


def scatter_by_chance(one: FloatArray, other: FloatArray, place: IntArray) -> float:
    """Probability that `one` scatters so much more than `other` if both scatter alike.

    They are known of the same records, (n_record,): their sum and difference are then not
    correlated (Pitman 1939, Morgan 1939, Biometrika 31). Where both resemble each other within
    events, which `place` numbers from 0, the records count as less.
    """
    difference, total = (part - part.mean() for part in (one - other, one + other))
    squares, n = (difference @ difference) * (total @ total), one.size
    pairs = max(int((np.bincount(place) ** 2).sum()) - n, 1)
    alike = [max(0.0, (_sums(x, place) ** 2).sum() / (x @ x or 1.0) - 1.0)
             for x in (difference, total)]  # fmt: skip
    freedom = n / (1.0 + alike[0] * alike[1] * n / pairs) - 2.0
    if squares == 0.0 or freedom <= 0.0:
        return 1.0
    correlation = difference @ total / np.sqrt(squares)
    return float(stdtr(freedom, -correlation * np.sqrt(freedom / (1.0 - correlation**2))))


class Compared(NamedTuple):
    """Runs of one arch in all measures."""

    rows: tuple[MeasureRow, ...]
    merit: FloatArray  #: (n_measure,), the larger the better; nan where there is no curve
    #: Probability that one measure is so much better than another by chance.
    by_chance: Callable[[int, int], float]


def compare_grid(
    names: Sequence[str], found: Brackets, log_value: FloatArray, exponent: FloatArray,
    covariates: FloatArray, event: IntArray,
) -> Compared:  # fmt: skip
    """Capacities of records, as brackets of their scale factors.

    `log_value` is (n_measure, n_record), `covariates` (n_covariate, n_record), the magnitude
    first, `event` the number of each record's earthquake.
    """
    keep = found.decided > 0
    known, covariates = found.rows(keep), covariates[:, keep]
    event = np.unique(event[keep], return_inverse=True)[1]
    capacities = log_capacities(known, log_value[:, keep], exponent)
    log_theta, beta, likelihood = np.full((3, exponent.size), np.nan)
    slopes, p_values = np.full((2, exponent.size, len(covariates)), np.nan)
    if known.decided.size > 1:
        log_theta, beta = weighted_normal(capacities, np.ones((1, known.decided.size)))
    for j, used, place in _tests(covariates, event):
        some = capacities.at((slice(None), used))
        slopes[:, j], p_values[:, j] = _regressions(some, covariates[j, used], place)
    fits = MeasureFits(log_theta, beta, likelihood, slopes, p_values)
    counts = known.decided.size, int(np.count_nonzero(known.bracketed))
    none = "fewer than two records with different capacities in this measure"

    def by_chance(best: int, own: int) -> float:
        logs = _expected(capacities.at([own, best])) / exponent[[own, best], None]
        return scatter_by_chance(logs[0], logs[1], event)

    return Compared(_rows(names, exponent, fits, counts, none), -fits.beta / exponent, by_chance)


def compare_scattered(
    names: Sequence[str], codes: IntArray, log_im: FloatArray, exponent: FloatArray,
    covariates: FloatArray, event: IntArray,
) -> Compared:  # fmt: skip
    """Verdicts of runs at levels of their own, one a record; arrays as of `compare_grid`."""
    keep = (codes == Verdict.STANDING) | (codes == Verdict.COLLAPSED)
    fell = (codes[keep] == Verdict.COLLAPSED).astype(float)
    event = np.unique(event[keep], return_inverse=True)[1]
    fits = fit_verdicts(log_im[:, keep], fell, covariates[:, keep], event)
    none = "collapses and standing runs give no rising probit line in this measure"

    def by_chance(best: int, own: int) -> float:
        x = log_im[[best, own]][:, keep]
        lines = binomial_lines(x, np.broadcast_to(fell, x.shape), np.ones(x.shape))
        z = lines.intercept[:, None] + lines.slope[:, None] * x
        gains = log_ndtr(np.where(fell == 1.0, z, -z))
        return float(_by_chance(_sums(gains[0] - gains[1], event)))

    rows = _rows(names, exponent, fits, (fell.size, 0), none)
    return Compared(rows, fits.log_likelihood, by_chance)


def _rows(
    names: Sequence[str], exponent: FloatArray, fits: MeasureFits, counts: tuple[int, int],
    none: str,
) -> tuple[MeasureRow, ...]:  # fmt: skip
    """Rows of fits; `counts` are of the records used and of those with a bracket."""
    rows = []
    for i, name in enumerate(names):
        theta, beta, likelihood = (float(part[i]) for part in fits[:3])
        slopes, p_values = fits.slopes[i].tolist(), fits.p_values[i].tolist()
        tested = [p for p in p_values if np.isfinite(p)]
        why = "" if np.isfinite(beta) else none
        sufficient = min(tested) >= SIGNIFICANCE if tested and not why else None
        power = float(exponent[i])
        row = MeasureRow(
            name, float(np.exp(theta)), beta, beta / power,
            slopes[0], p_values[0], slopes[1], p_values[1], sufficient, likelihood, *counts, why,
        )  # fmt: skip
        rows.append(row)
    return tuple(rows)
