"""Mean annual frequency of collapse: a fragility curve weighted by a hazard curve.

rate = integral of P(collapse | im) |d lambda(im)| (Cornell, Jalayer, Hamburger and Foutch 2002, J.
Struct. Eng. 128(4)), in closed form as lambda is a power of im between its points. Level by level,
it is divided by category in proportion to the collapses. This is no deaggregation of the hazard:
records are run at levels that their earthquakes did not reach. The mean of a curve over uncertain
theta and beta, and the branches of a logic tree, are made from the same draws as the mean rate.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from archfrag.errors import InputError
from archfrag.fragility.curve import (
    BoolArray,
    Curve,
    FloatArray,
    IntArray,
    Pair,
    Triple,
    log_intensity,
    positive,
    rising,
    tails,
)
from archfrag.fragility.probit import log_between
from archfrag.fragility.verdicts import independent_number, wilson

MOST_OUTSIDE = (
    0.5  # fraction of a rate outside the hazard curve; with more it is a bound
)
LEAST_ASSIGNED = 0.05  # fraction of a rate that is divided by category
# Largest ln of a rate: with a steep first slope of the hazard a wide curve would overflow.
_LARGEST_LOG = 600.0
# Probabilities of the parts of beta, in rising order (the last is small, but governs rates), and
# of the parts of theta within each.
_BETAS = np.array([0.3, 0.3, 0.25, 0.12, 0.03])
_THETAS = np.array([0.25, 0.5, 0.25])
_TRIED = 200  # values of beta
_MOST_PARTS = (
    40000  # parts of a mean curve of a class; fewer draws are taken to stay below
)


@dataclass(frozen=True)
class HazardCurve:
    """Annual frequency of exceedance against intensity, given at several points.

    Between two points it is a power of the intensity. Below the first point the first power goes
    on, above the last point the last power that falls. A curve that bends downwards in logarithmic
    scales is overestimated by both extensions.
    """

    im: FloatArray  #: (n,), intensities, increasing, > 0
    #: (n,), of exceedance [1/year], not increasing; points of 0 or infinity are left out.
    rate: FloatArray

    def __post_init__(self) -> None:
        im = np.asarray(self.im, float)
        rate = np.asarray(self.rate, float)
        if im.shape != rate.shape:
            raise InputError(
                f"the hazard curve has {im.size} intensities and {rate.size} rates"
            )
        known = ~((rate == 0.0) | (rate == np.inf))
        number = known.sum()
        if number < 2:
            raise InputError(
                f"the hazard curve has {number} of {rate.size} points with a rate "
                "above 0 that is known; at least two are needed"
            )
        im = rising(im[known], "the hazard curve's im")
        rate = positive(rate[known], "the hazard curve's rate")
        object.__setattr__(self, "im", im)
        object.__setattr__(self, "rate", rate)
        for i in np.flatnonzero(np.diff(rate) > 0.0)[:1]:
            raise InputError(
                f"the hazard curve's rate of exceedance rises from {rate[i]:g} to "
                f"{rate[i + 1]:g} at im = {im[i + 1]:g}; it never rises with intensity"
            )
        if rate[0] == rate[-1]:
            raise InputError(
                f"the hazard curve's rate is {rate[0]:g} at all its points"
            )

    @classmethod
    def from_exceedance(
        cls, im: ArrayLike, probability: ArrayLike, years: float
    ) -> "HazardCurve":
        """Return the curve of probabilities of exceedance: rate = -ln(1 - probability) / years.

        Points with a probability of 1 or 0, whose rate is not known, are left out.
        """
        probability = np.asarray(probability, float)
        bad = probability[~((probability >= 0.0) & (probability <= 1.0))]
        if bad.size:
            raise InputError(
                f"the hazard curve's probability holds {bad[0]:g}; from 0 to 1"
            )
        if not 0.0 < years < np.inf:
            raise InputError(
                f"the hazard curve is for {years:g} years; a positive time is needed"
            )
        with np.errstate(divide="ignore"):
            return cls(np.asarray(im, float), -np.log1p(-probability) / years)

    def rate_at(self, im: ArrayLike) -> FloatArray:
        """Return the annual frequency of exceedance at intensities >= 0 of any shape [1/year]."""
        x = log_intensity(im)
        anchor, log_rate, slope = self.pieces(x)
        with np.errstate(invalid="ignore"):
            fall = np.where(slope > 0.0, slope * (x - anchor), 0.0)
        return np.exp(log_rate - fall)

    def level_of(self, years: ArrayLike) -> FloatArray:
        """Return the intensities of return periods [years], nan outside the points."""
        period = np.log(1.0 / self.rate)
        logs = np.interp(np.log(years), period, np.log(self.im), np.nan, np.nan)
        return np.exp(logs)

    def pieces(self, x: FloatArray) -> Triple:
        """Return the power law at each ln im: ln im of its anchor, ln rate there, exponent."""
        knots = np.log(self.im)
        between = -np.diff(np.log(self.rate)) / np.diff(knots)
        slopes = np.concatenate([between[:1], between, between[between > 0.0][-1:]])
        place = np.searchsorted(knots, x, side="right")
        anchor = np.maximum(place - 1, 0)
        return knots[anchor], np.log(self.rate[anchor]), slopes[place]


@dataclass(frozen=True)
class CollapseRate:
    """Mean annual frequency of collapse.

    Its band is that of the fragility curve's uncertain parameters only.
    """

    rate: (
        float  #: by the curve's theta and beta, with the hazard curve extended [1/year]
    )
    #: Mean over uncertain theta and beta [1/year]; nan without draws, and if `is_bound`.
    mean: float
    lower: float  #: ends of the band [1/year]; nan as `mean`
    upper: float
    confidence: float
    below: float  #: fractions of `rate` from below and above the hazard curve, which is extended
    above: float
    below_onset: (
        float  #: rate that the curve has below the onset, not in `rate` [1/year]
    )
    is_bound: bool  #: whether most of the rate is from outside the hazard curve
    quoted: float  #: `rate`; if `is_bound`, its part within the hazard curve [1/year]
    return_period: (
        float  #: 1 / `quoted` [year]; if `is_bound`, the longest possible one
    )

    def probability_in(self, years: float) -> tuple[float, float, float]:
        """Return the probability of a collapse in some years, and the ends of its band."""
        positive(years, "years")
        rates = np.array([self.quoted, self.lower, self.upper])
        value, low, high = (-np.expm1(-years * rates)).tolist()
        return value, low, high


def collapse_rate(
    hazard: HazardCurve,
    curve: Curve,
    draws: tuple[ArrayLike, ArrayLike] | None = None,
    confidence: float = 0.9,
    onset: ArrayLike = 0.0,
) -> CollapseRate:
    """Return the mean annual frequency of collapse.

    `draws` are theta and beta, (n_draw,) each, from `Curve.draws`; without them there is no band.
    The band runs between quantiles of the rates of the draws. Draws for a class are those of its
    lognormal curve, and their rates are scaled to the rate of the class. The extension of the
    hazard below its first point adds at most the hazard's rate there to the rate of a draw.
    Nothing collapses below `onset`, one intensity or one for each of the curve's parts.
    """
    ends = tails(confidence)
    parts = rate_by_level(hazard, curve, hazard.im[[0, -1]], onset)
    rate = float(parts.sum())
    below, _, above = (parts / rate if rate > 0.0 else np.zeros(3)).tolist()
    is_bound = below + above > MOST_OUTSIDE
    mean = lower = upper = np.nan
    if draws is not None and not is_bound:
        least = np.min(onset)
        each = _lognormal(hazard, np.log(hazard.im), *draws, least)
        each[..., 0] = np.minimum(each[..., 0], hazard.rate[0])
        rates = each.sum(axis=-1)
        if curve.members is not None:
            whole = lognormal_rates(hazard, curve.theta, curve.beta, least)
            rates *= rate / whole if whole > 0.0 else 0.0
        mean = float(rates.mean())
        lower, upper = np.quantile(rates, ends).tolist()
    left_out = float(rate_by_level(hazard, curve, hazard.im[:1]).sum()) - rate
    quoted = rate * max(1.0 - (below + above), 0.0) if is_bound else rate
    return CollapseRate(
        rate,
        mean,
        lower,
        upper,
        confidence,
        below,
        above,
        max(left_out, 0.0),
        is_bound,
        quoted,
        1.0 / quoted if quoted > 0.0 else np.inf,
    )


def lognormal_rates(
    hazard: HazardCurve, theta: ArrayLike, beta: ArrayLike, onset: ArrayLike = 0.0
) -> FloatArray:
    """Return the mean annual frequency of collapse of each lognormal curve [1/year].

    `theta` and `beta` have the shape of the result; `onset` is as for `collapse_rate`.
    """
    return _lognormal(hazard, np.log(hazard.im), theta, beta, onset).sum(axis=-1)


def rate_by_level(
    hazard: HazardCurve, curve: Curve, edges: ArrayLike, onset: ArrayLike = 0.0
) -> FloatArray:
    """Return the rate of collapse by motions between rising `edges`, (n_edge + 1,) [1/year].

    The first rate is from 0 to the first edge, the last one from the last edge to infinity.
    `onset` is as for `collapse_rate`.
    """
    edges = np.log(rising(edges, "edges"))
    cuts = np.union1d(np.log(hazard.im), edges)
    theta, beta = curve.parts.T
    rates = _lognormal(hazard, cuts, theta, beta, onset).mean(axis=0)
    level = np.searchsorted(edges, np.append(-np.inf, cuts), side="right")
    return np.bincount(level, weights=rates, minlength=edges.size + 1).astype(float)


def _lognormal(
    hazard: HazardCurve,
    cuts: FloatArray,
    theta: ArrayLike,
    beta: ArrayLike,
    onset: ArrayLike = 0.0,
) -> FloatArray:
    """Return the rates of lognormal curves (...) between ln im `cuts`, (..., n_cut + 1) [1/year].

    Intensities below `onset` add nothing. By parts, a rate is [-Phi lambda] + integral of lambda
    dPhi. The integral with lambda = c e^(-k x) is lambda(theta) e^(k^2 beta^2 / 2) [Phi(z + k
    beta)], z = (x - ln theta) / beta.
    """
    theta, beta = (
        positive(v, n)[..., None] for v, n in ((theta, "theta"), (beta, "beta"))
    )
    log_theta = np.log(theta)
    least = log_intensity(onset)[..., None]
    left = np.append(-np.inf, cuts)
    right = np.append(cuts, np.inf)
    anchor, log_rate, k = hazard.pieces(left)
    low, high = ends = [np.maximum(end, least) for end in (left, right)]
    a, b = z = [(end - log_theta) / beta for end in ends]
    # Phi lambda, which is 0 at both ends of all pieces.
    parts = []
    for x, each in zip(ends, z):
        inside = np.isfinite(x)
        exceeded = hazard.rate_at(np.exp(np.where(inside, x, 0.0)))
        parts.append(np.where(inside, ndtr(each) * exceeded, 0.0))
    lower, upper = parts
    log_centre = log_rate - k * (log_theta - anchor) + 0.5 * (k * beta) ** 2
    log_moved = log_centre + log_between(a + k * beta, b + k * beta)
    moved = np.exp(np.minimum(log_moved, _LARGEST_LOG))
    # A piece without a fall of the rate has no motions; elsewhere rounding must not go below 0.
    rate = np.maximum(lower - upper + moved, 0.0)
    return np.where((k > 0.0) & (low < high), rate, 0.0)


@dataclass(frozen=True)
class Contributions:
    """The rate of collapse, or the number of collapses, by category."""

    categories: tuple[str, ...]
    counts: IntArray  #: (n_category, n_level), collapses
    rate: FloatArray  #: (n_category, n_level), rate [1/year]; `counts` without a hazard
    unassigned: FloatArray  #: (n_level,), rate of levels with no collapse seen [1/year]
    fraction: (
        FloatArray  #: (n_category,), of the rate that is assigned [1]; nan if none is
    )
    lower: FloatArray  #: (n_category,), ends of the interval of `fraction`, of collapses only
    upper: FloatArray
    n_effective: float  #: independent collapses that the interval supposes

    @property
    def shown(self) -> BoolArray:
        """Whether each category has a part of the rate, (n_category,).

        All are False if hardly any of the rate is assigned to categories.
        """
        assigned = self.rate.sum()
        enough = assigned > LEAST_ASSIGNED * (assigned + self.unassigned.sum())
        return np.asarray(self.rate.any(axis=1) & enough)


def contributions(
    collapsed: ArrayLike,
    category: ArrayLike,
    categories: Sequence[str],
    level_rate: ArrayLike | None = None,
    confidence: float = 0.9,
    groups: ArrayLike | None = None,
) -> Contributions:
    """Divide the collapses of each level by category, and its rate in proportion to them.

    `collapsed` and `category`, (n_record, n_level), are whether a run collapsed and its position
    in `categories`; `level_rate`, (n_level,), is from `rate_by_level` [1/year]; if it is not
    given, the number of collapses takes its place. The same records collapse at several levels, so
    that Wilson's interval of the fractions counts (sum m)^2 / sum m^2 collapses, m being those of
    a record (Kish 1965, *Survey Sampling*). Records with the same label in `groups`, (n_record,),
    such as their event, count as fewer, the more alike the categories of their collapses are.
    """
    collapse = np.asarray(collapsed, bool)
    kind = np.asarray(category)
    of_kind = collapse & (kind == np.arange(len(categories))[:, None, None])
    counts = of_kind.sum(axis=1)
    given = collapse.sum(axis=0) if level_rate is None else level_rate
    rates = np.asarray(given, float)
    total = counts.sum(axis=0)
    rate = rates * counts / np.maximum(total, 1)
    unassigned = np.where(total > 0, 0.0, rates)
    fraction = rate.sum(axis=1) / (rate.sum() or np.nan)
    of_record = collapse.sum(axis=1).astype(float)
    effective = float(of_record.sum() ** 2 / max(of_record @ of_record, 1.0))
    some = of_record > 0.0
    label = np.asarray(groups)[some] if groups is not None else np.empty(0)
    if np.unique(label).size > 1:
        parts = of_kind.sum(axis=2)[:, some] / of_record[some]
        effective *= independent_number(parts.T, label) / label.size
    ends = wilson(fraction * effective, effective, confidence)
    return Contributions(
        tuple(categories), counts, rate, unassigned, fraction, *ends, effective
    )


def level_edges(levels: ArrayLike) -> FloatArray:
    """Return edges between rising levels, at their geometric means, (n_level - 1,)."""
    given = rising(levels, "levels")
    return np.sqrt(given[1:] * given[:-1])


def branches_of(curve: Curve, draws: Pair) -> tuple[list[Curve], FloatArray]:
    """Return 15 curves that stand for the uncertain theta and beta, and their weights (sum 1).

    `draws` are theta and beta, (n,) each, from `Curve.draws`. They are divided into five parts by
    beta, and each of these into three by theta. Theta of a branch is the geometric mean of its
    part. Its beta gives the mean rate of collapse of the part for a usual hazard, which falls with
    the power 2.5 of the intensity from 0.05 times the median of theta on.
    """
    middle = np.median(draws[0]) * np.array([0.01, 0.05, 10.0])
    usual = HazardCurve(middle, np.array([0.05, 0.05, 10.0]) ** -2.5)
    rates = lognormal_rates(usual, *draws)
    curves = list[Curve]()
    weights = list[float]()
    theta, beta = draws
    tried = np.geomspace(beta.min(), beta.max(), _TRIED)
    for of_beta in _parted(np.argsort(beta, kind="stable"), _BETAS):
        order = of_beta[np.argsort(theta[of_beta], kind="stable")]
        for part in _parted(order, _THETAS):
            t = float(np.exp(np.log(theta[part]).mean()))
            rising = lognormal_rates(usual, t, tried)
            rising = rising[: rising.argmax() + 1]
            b = float(np.interp(rates[part].mean(), rising, tried[: rising.size]))
            members = None if curve.members is None else _parts(curve, t, b)
            branch = Curve(t, b, n_total=curve.n_total, kind="branch", members=members)
            curves.append(branch)
            weights.append(part.size / rates.size)
    return curves, np.array(weights)


def _parted(values: IntArray, probability: FloatArray) -> list[IntArray]:
    """Divide values, in their order, into parts with these probabilities."""
    ends = np.round(np.cumsum(probability)[:-1] * values.size).astype(int)
    return np.split(values, ends)


def predictive(curve: Curve, draws: Pair) -> Curve:
    """Return the mean of a curve over draws of theta and beta, at each intensity.

    Band and intervals stay those of `curve`. `theta` and `beta` are those of the lognormal curve
    with the same mean and standard deviation of ln capacity.
    """
    step = 1 + (len(curve.parts) * len(draws[0]) - 1) // _MOST_PARTS
    parts = _parts(curve, draws[0][::step], draws[1][::step])
    return mean_of(curve, parts, "predictive")


def mean_of(curve: Curve, members: FloatArray, kind: str) -> Curve:
    """Return the curve that is the mean of lognormal ones, (n,) rows of theta and beta.

    Its own theta and beta are those of the lognormal curve with the same mean and standard
    deviation of ln capacity; all else is that of `curve`.
    """
    logs = np.log(members[:, 0])
    theta = float(np.exp(logs.mean()))
    beta = float(np.sqrt((members[:, 1] ** 2).mean() + logs.var()))
    return replace(curve, theta=theta, beta=beta, kind=kind, members=members)


def _parts(curve: Curve, theta: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Return theta and beta of the parts of a curve under other parameters, one row for each.

    `theta` and `beta` are (n,) each; every pair gives all parts. ln capacity is moved and
    stretched: the arches of a class move and widen together.
    """
    theta, beta = (np.reshape(each, (-1, 1)) for each in (theta, beta))
    wider = beta / curve.beta
    own, width = curve.parts.T
    moved = theta * (own / curve.theta) ** wider, wider * width
    return np.stack([each.ravel() for each in moved], axis=1)
