"""P(collapse | two intensities): a plane on the probit scale, and what it gains over a curve.

ln capacity in x1 is normal about alpha + gamma s, where s = ln x2 - k ln x1 is the same at all
levels of a record, so that P = Phi(a + b1 ln x1 + b2 ln x2). The posterior is summed over weighted
draws. To hold an event back, they are weighted anew, without a new fit.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, ndtr, softmax, stdtr

from archfrag.errors import FitError
from archfrag.fragility.curve import FloatArray, log_intensity, plots, tails
from archfrag.fragility.posterior import (
    capacity_prior,
    fit_capacity_posterior,
    likely_beta,
)
from archfrag.fragility.probit import log_between, normal_lines
from archfrag.fragility.quoted import independent_records
from archfrag.fragility.several import parts_of
from archfrag.fragility.verdicts import Brackets

SIGNIFICANCE = 0.05
FEWEST = 8  # events, or records of no event
MOST_ALIKE = 0.99  # correlation of ln x1 and ln x2 over the runs
_DRAWS = 4000
_FITS = 3
_FREEDOM = 5.0
_SEED = 11
# Negative log-likelihood below which a plane without scatter agrees with all verdicts.
_SEPARATED = 0.01


@dataclass(frozen=True, repr=False, eq=False)
class Plane:
    """Probability of collapse against two intensities, and what the second one tells.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> turns, window = np.geomspace(3, 30, 12), np.hanning(200)
    >>> waves = [window * np.sin(turn * np.arange(0, 4, 0.02)) for turn in turns]
    >>> motions = [af.Motion(wave, 0.02, id=f"wave{i}") for i, wave in enumerate(waves)]
    >>> study = af.Study(af.Block(0.4, 2, 0.8), motions, levels=[0.2, 0.5, 1, 2, 4], id="waves")
    >>> plane = study.run(progress=False).plane("PGV")
    >>> plane.gains, plane.to_dataframe().columns[:3].tolist()
    (True, ['PGA [g]', 'PGV [m/s]', 'probability'])
    """

    coefficients: FloatArray  #: (3,): a, b1, b2 by maximum likelihood
    draws: FloatArray  #: (3, n): coefficients from the posterior, equally probable
    gain: float  #: mean ln probability of a held-back record, less that by the x1 curve
    p_value: (
        float  #: of such a gain by chance, and by the choice among `tests` measures
    )
    runs: FloatArray  #: (n_run, 3): both intensities, and 1 if the run collapsed
    power: float  #: k in s = ln x2 - k ln x1
    measures: tuple[str, str] = ("x1", "x2")
    units: tuple[str, str] = ("1", "1")
    tests: int = 1

    @property
    def gains(self) -> bool:
        """Whether the second measure tells more than chance would."""
        return self.gain > 0.0 and self.p_value < SIGNIFICANCE

    def __repr__(self) -> str:
        one, two = self.measures
        best = f" (best of {self.tests})" * (self.tests > 1)
        how = "more than chance explains" if self.gains else "which chance can explain"
        return (
            f"by {one} and {two}{best}, runs of records held back are {np.exp(self.gain):.3g} "
            f"times as likely as by {one} alone, {how} (p = {self.p_value:.2g})"
        )

    def at(self, x1: ArrayLike, x2: ArrayLike, confidence: float = 0.9) -> FloatArray:
        """Return probability and both ends of the band at pairs of intensities, (3, ...)."""
        a, b1, b2 = self.draws
        z = a + b1 * log_intensity(x1)[..., None] + b2 * log_intensity(x2)[..., None]
        return ndtr(np.quantile(z, (0.5, *tails(confidence)), axis=-1))

    def to_dataframe(self, points: int = 25) -> pd.DataFrame:
        """Tabulate probability and band on a grid of intensities, where there are runs.

        `points` is the number of grid lines each way. FitError if the plane gains nothing.
        """
        if not self.gains:
            raise FitError(f"{self!r}: use the curve in {self.measures[0]}")
        logs = np.log(self.runs[:, :2])
        x, y = np.meshgrid(*np.linspace(logs.min(axis=0), logs.max(axis=0), points).T)
        s = logs[:, 1] - self.power * logs[:, 0]
        kept = np.abs(y - self.power * x - 0.5 * (s.min() + s.max())) <= 0.5 * np.ptp(s)
        at = np.exp([x[kept], y[kept]])
        heads = [f"{each} [{unit}]" for each, unit in zip(self.measures, self.units)]
        heads += ["probability", "lower", "upper"]
        return pd.DataFrame([*at, *self.at(*at)], heads).T

    def plot(self, ax=None):
        """Draw contours of the probability, and the runs; FitError if the plane gains nothing."""
        return plots().plot_plane(self.to_dataframe(80), self.runs, ax)


def fit_plane(
    brackets: Brackets, ratio: ArrayLike, power: float, groups: ArrayLike | None = None
) -> Plane:
    """Fit the plane to records with brackets in x1, and test what it gains over the curve in x1.

    `ratio`, (n_record,), is x2 / x1^`power`. Records with the same label in `groups` count as
    fewer, and are held back together. The prior is that of a curve: Jeffreys' if each record has a
    single run; else that of capacities, times a Cauchy prior of gamma, whose scale is the span of
    ln levels, for s over its standard deviation. Scatter of single runs adds as much to beta^2 as
    in the curve. The test is Student's t test: p_plane / p_curve - 1, summed over the records of
    an event that is held back, has the mean 0 if the curve is true. FitError if there is no plane,
    or none can be tested.
    """
    known = brackets.of_records()
    s = np.log(np.asarray(ratio, float)[brackets.run])
    label = np.arange(s.size) if groups is None else np.asarray(groups)[brackets.run]
    level, collapsed = known.single_runs()
    second = s[np.nonzero(known.decided)[0]] + power * np.log(level)
    events = np.unique(label).size
    if events < FEWEST:
        raise FitError(
            f"the records are of {events} independent earthquakes or records; a test of two "
            f"measures holds some back and needs {FEWEST}"
        )
    alike = np.corrcoef(np.log(level), second)[0, 1] if np.ptp(second) else 1.0
    if abs(alike) > MOST_ALIKE or not s.std():
        raise FitError(
            f"the two measures say the same (correlation of their logarithms {alike:.3f}); choose "
            "another second one"
        )
    parts = parts_of(label)
    scores = []
    alone = known.without_scatter()
    whole, between = (
        fit_capacity_posterior(each).curve.beta ** 2 for each in (known, alone)
    )
    for u in (np.empty((s.size, 0)), (s[:, None] - s.mean()) / s.std()):
        start, p, logs, weight, share = _weighted(alone, u, label)
        held = softmax(weight - share * (parts @ logs), axis=1)  # (n_part, n_draw)
        scores.append(np.log((parts * (held @ np.exp(logs.T))).sum(axis=0)))
    gains = scores[1] - scores[0]
    by_part = parts @ np.expm1(gains)
    t = np.sqrt(len(parts)) * by_part.mean() / by_part.std(ddof=1)
    at = (np.arange(_DRAWS) + 0.5) / _DRAWS
    place = np.searchsorted(np.cumsum(softmax(weight)), at).clip(max=_DRAWS - 1)
    alpha, gamma, one = np.vstack([start, p[place]]).T
    gamma /= s.std()
    lines = np.stack([gamma * s.mean() - alpha, one + gamma * power, -gamma])
    lines[:, 1:] /= np.sqrt(1.0 + max(whole - between, 0.0) * one[1:] ** 2)
    p_value = float(stdtr(len(parts) - 1, -t))
    runs = np.stack([level, np.exp(second), collapsed], axis=1)
    return Plane(lines[:, 0], lines[:, 1:], float(gains.mean()), p_value, runs, power)


def _weighted(
    known: Brackets, u: FloatArray, label: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Draw (alpha, gamma, 1) / beta, (n, q), from a t density that is fitted anew in each round.

    Returns the likeliest values (q,), the draws, ln likelihoods of records (n_record, n),
    log-weights (n,), and the effective number of records over the actual one. `u` is standardised
    s, (n_record, 1), or has no columns for the curve in x1.
    """
    low, high = known.logs[..., None]
    design = np.column_stack([np.ones(len(u)), u])
    (start,), (deviation,), (loss,), (information,) = normal_lines(design, *known.logs)
    if not loss > _SEPARATED:
        raise FitError(
            "a plane without scatter agrees with all runs; add records or levels"
        )
    shift = np.exp(-u @ start[1:])
    moved = replace(known, lower=known.lower * shift, upper=known.upper * shift)
    share = independent_records(moved, label) / len(u)
    ends = np.sort(np.log(known.single_runs()[0]))
    width = (high - low)[known.bracketed]
    resolved = np.median(width) if width.size else 0.0
    span = np.ptp(ends)
    generator = np.random.default_rng(_SEED)
    q = len(information)
    mean = start = np.append(start, 1.0) / deviation
    covariance = np.linalg.inv(information) / share
    for _ in range(_FITS):
        e = generator.standard_normal((_DRAWS, q))
        e *= np.sqrt(_FREEDOM / generator.chisquare(_FREEDOM, (_DRAWS, 1)))
        p = mean + e @ np.linalg.cholesky(covariance).T
        one = np.abs(p[:, -1])
        shifts = design @ p[:, :-1].T
        logs = np.maximum(log_between(low * one - shifts, high * one - shifts), -700.0)
        weight = share * logs.sum(axis=0)
        weight += 0.5 * (_FREEDOM + q) * np.log1p((e**2).sum(axis=1) / _FREEDOM)
        if known.verdict.shape[1] > 1:
            # In (alpha, gamma, ln beta), of which p has one^q.
            weight += capacity_prior(1.0 / one, resolved, ends) - q * np.log(one)
            weight -= np.log1p((p[:, 1:-1].T / one / span) ** 2).sum(axis=0)
        else:
            z = np.log(known.levels) * one - shifts
            each = np.exp(-z * z - log_ndtr(z) - log_ndtr(-z))
            rows = np.column_stack([design, np.log(known.levels)])
            square = np.einsum("rn,ri,rj->nij", each, rows, rows, optimize=True)
            root = np.linalg.det(square)
            weight += 0.5 * np.log(np.maximum(root, 1e-250)) - np.log(one)
            weight -= np.log1p((one * likely_beta(span)) ** -2.0)
        weight[p[:, -1] <= 0.0] = -np.inf
        probability = softmax(weight)
        mean = probability @ p
        covariance = np.cov(p, rowvar=False, aweights=probability)
    return start, p, logs, weight, share
