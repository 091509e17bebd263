"""Curves of several arches or limit states: means, parts of dispersion, crossings, ratios, losses.

The interval of a ratio of two curves whose arches met the same motions is by the jackknife over
groups of records (Shao and Tu 1995, *The Jackknife and Bootstrap*): each group, an earthquake with
all its records, is left out of both arches at once, so that what a motion does to both cancels.
docs/evidence/data/bands_ratio.csv shows how often it holds the ratio; a percentile bootstrap held
that of medians in 52 to 84 % with few records.

Mean loss is from curves of limit states and what each costs, a fraction of the value of an arch:
loss(im) = sum of ratio_i (P(state i or worse) - P(state i + 1 or worse)) is the sum of steps of
the ratios times P(state i or worse). So the average annual loss, the integral of loss |d lambda|,
is the sum of the steps times the rates of the states. Ends of bands add up alike, as if theta and
beta of all states erred together.

Probability that a collapse takes a part of a bridge is a curve of collapse, divided:
P(collapse in part k | im) = P(collapse | im) q_k(im), where q_k is the share of the part in the
collapses near im. A collapse has one part, so that the parts add up to the curve.

Numbers of collapses at the levels are averaged with normal weights in ln im, of deviation 0.3;
beyond the levels with collapses they are those at the nearest of them. With the prior 1 / n_part
for each part they are a Dirichlet density of the shares, whose mean q_k is. Records that resemble
each other count as fewer (`contributions`: n_effective). The band is from draws of theta and beta,
and of the shares.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import ArrayLike
from scipy.special import gammaincinv, ndtr

from archfrag.errors import FitError, InputError
from archfrag.files import number
from archfrag.fragility.curve import (
    BoolArray,
    Curve,
    FloatArray,
    IntArray,
    Pair,
    log_intensity,
    tails,
)
from archfrag.fragility.risk import (
    Contributions,
    HazardCurve,
    collapse_rate,
    lognormal_rates,
)
from archfrag.fragility.verdicts import Brackets, numbered

FEWEST_GROUPS = 3
MOST_PARTS = (
    40  # parts that are left out one by one; of more groups several form a part
)
_DRAWS = 4000
_SEED = 3
_LARGEST_LOG = 20.0  # of theta and of 1 / beta in draws
_LARGEST_BETA = 4.0
_WIDTH = 0.3  # of ln intensity, within which collapses tell of parts
_PART_DRAWS = 2000
_PART_SEED = 5
_ROWS = ("before", "after", "ratio", "lower", "upper")
Numbers = dict[str, float]
Estimate = Callable[[Brackets], Curve]
Steps = list[tuple[Curve, float]]
MOST_CROSSING = 0.01  # probability by which curves of two limit states may cross


def crossing_words(curves: Sequence[Curve]) -> str:
    """Return a text on whether curves of neighbouring limit states cross.

    `curves` go from light to severe.
    """
    crossed = [
        f"those of {mild.state} and {severe.state} by up to {most:.2g}"
        for mild, severe in pairwise(curves)
        if (most := crossing(mild, severe)) > MOST_CROSSING
    ]
    if not crossed:
        return "The curves of the limit states do not cross."
    how = "Each is fitted by itself; exports move the lighter one as far as needed."
    return f"Curves cross in probability: {'; '.join(crossed)}. {how}"


def above(mild: Curve, severe: Curve) -> Curve:
    """Return the curve of a milder state, moved so that it does not cross a severer one.

    Fits of two states can cross by more than `MOST_CROSSING`, by chance and because collapse is
    estimated in another way. Then the median becomes at most that of the severer state. The
    dispersion goes towards that of the severer state, only as far as needed. Curves that do not
    cross stay as they are.
    """
    if crossing(mild, severe) <= MOST_CROSSING:
        return mild
    theta = min(mild.theta, severe.theta)
    for beta in np.linspace(mild.beta, severe.beta, 101).tolist():
        moved = replace(mild, theta=theta, beta=beta, kind="adjusted", members=None)
        if crossing(moved, severe) <= MOST_CROSSING:
            return moved
    return severe  # a mean of curves, which no lognormal one of this dispersion comes close to


def crossing(mild: Curve, severe: Curve) -> float:
    """Return the largest excess of the severer state's probability over the milder one's.

    Where it is positive, programs that subtract the two curves get a negative probability.
    """
    theta, beta = np.array([(fit.theta, fit.beta) for fit in (mild, severe)]).T
    ends = theta * np.exp(np.array([[-4.0], [4.0]]) * beta)
    im = np.geomspace(ends.min(), ends.max(), 400)
    return float((severe(im) - mild(im)).max())


def split_capacities(capacity: ArrayLike) -> tuple[float, float]:
    """Divide the dispersion of capacities, (n_arch, n_record), into two betas.

    With A the arch, var ln C = E[var(ln C | A)] + var(E[ln C | A]). The first term is
    beta_record_to_record^2, which includes what records do to some arches only; the second is
    beta_model^2. Both are returned as betas, by analysis of variance with two factors (Searle,
    Casella and McCulloch 1992, *Variance Components*, chapters 3 and 4). A negative estimate
    counts as 0. Records with an unknown capacity (nan) are left out. FitError if fewer than two
    arches, or two records of each, remain.
    """
    logs = np.log(capacity)
    logs = logs[:, ~np.isnan(logs).any(axis=0)]
    a, r = logs.shape
    if a < 2 or r < 2:
        raise FitError(
            f"{a} arches with {r} records of known capacity remain; two of each are "
            "needed to separate modelling from records"
        )
    arch = logs.mean(axis=1)
    record = logs.mean(axis=0)
    residual = logs - arch[:, None] - record + logs.mean()
    interaction = (residual**2).sum() / ((a - 1) * (r - 1))
    # var(ln C | arch) is that of the records and of the interaction together.
    within = record.var(ddof=1) + (a - 1) / a * interaction
    between = arch.var(ddof=1) - interaction / r
    return float(np.sqrt(within)), float(np.sqrt(max(between, 0.0)))


def split_curves(
    theta: ArrayLike, beta: ArrayLike, standard_error: ArrayLike, *, shared: float = 0.0
) -> tuple[float, float]:
    """Divide the dispersion as `split_capacities` does, by the curve of each arch, (n_arch,).

    beta_model^2 is the variance of ln theta over the arches less the mean square of its standard
    errors (DerSimonian and Laird 1986, Control. Clin. Trials 7, with equal weights);
    beta_record_to_record^2 is the mean of beta^2. `shared`, 0 to below 1, is the correlation of
    the errors of ln theta between arches.
    """
    logs = np.log(theta)
    if logs.size < 2:
        raise FitError("one arch has no modelling dispersion; sample several")
    sampling = np.mean(np.square(standard_error)) * (1.0 - shared)
    between = logs.var(ddof=1) - sampling
    return float(np.sqrt(np.mean(np.square(beta)))), float(np.sqrt(max(between, 0.0)))


def parts_of(groups: ArrayLike, seed: int = _SEED) -> BoolArray:
    """Return which records are left out with each part of the groups, (n_part, n_record).

    `groups` are labels, (n_record,); `seed` is for their random order. FitError if there are fewer
    than `FEWEST_GROUPS` groups.
    """
    number = numbered(groups)
    n = number.max(initial=-1) + 1
    if n < FEWEST_GROUPS:
        raise FitError(
            f"the runs are of {n} independent motions, earthquakes, first shocks or "
            f"rows; an interval of a ratio needs {FEWEST_GROUPS}"
        )
    order = np.random.default_rng(seed).permutation(n)
    part = np.empty(n, int)
    part[order] = np.arange(n) * min(n, MOST_PARTS) // n
    return np.asarray(part[number] == np.arange(part.max() + 1)[:, None])


def left_out(brackets: Brackets, parts: BoolArray, estimate: Estimate) -> FloatArray:
    """Return ln theta and ln beta of the curve without each part of records, (n_part, 2).

    `parts` is from `parts_of`; `estimate` fits a curve to brackets.
    """
    curves = [estimate(brackets.of_records(~part)) for part in parts]
    return np.log([[curve.theta, curve.beta] for curve in curves])


def crossing_groups(groups: Sequence[ArrayLike]) -> list[IntArray]:
    """Return the groupings of rows that are not nested in another, as (n_row,) numbers each.

    A grouping is nested if each of its groups lies within one group of the other. If several
    groupings remain, they cross; the last entry is then their intersection.
    """
    kept = list[IntArray]()
    for one in sorted(map(numbered, groups), key=np.max):  # the coarsest first
        pairs = (np.unique([one, other], axis=1).shape[1] for other in kept)
        if one.max() + 1 not in pairs:
            kept.append(one)
    cells = np.unique(kept, axis=1, return_inverse=True)[1].ravel()
    return [*kept, cells] if len(kept) > 1 else kept


def ratios(
    curves: tuple[Curve, Curve],
    without: Sequence[Pair],
    hazard: HazardCurve | None = None,
    onsets: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
    confidence: float = 0.9,
) -> dict[str, Numbers]:
    """Return the ratio of two curves, the second over the first, with its interval.

    `without` has, for each of `crossing_groups`, the results of `left_out` for both curves with
    the same parts. Variances of groupings that cross add up, less that of their intersection
    (Cameron, Gelbach and Miller 2011, J. Bus. Econ. Stat. 29). Returns the row ``theta`` and, if
    there is a hazard, the row ``rate``, each with before, after, ratio, lower and upper. The
    interval is by Student's t; its degrees of freedom are the parts of the coarsest grouping less
    one. For rates it is by draws of ln theta and ln beta of both arches. `onsets` are as for
    `collapse_rate`.
    """
    every = list[FloatArray]()
    for pair in without:
        m = len(pair[0])
        apart = np.hstack([each - each.mean(axis=0) for each in pair])
        every.append(apart * np.sqrt((m - 1) / m))
    errors = [np.linalg.norm(away[:, 2] - away[:, 0]) for away in every]
    n = min(map(len, every))
    away = every[0]
    error = errors[0]
    if len(every) > 1:
        *crossed, shared = np.square(errors)
        both = np.sum(crossed)
        error = np.sqrt(max(*crossed, both - (len(crossed) - 1) * shared))
        away = np.vstack(every[:-1]) * (error / max(np.sqrt(both), 1e-300))
    reach = scipy.special.stdtrit(n - 1, tails(confidence)[1])
    thetas = [curve.theta for curve in curves]
    rows = {"theta": _row(thetas, np.exp([-reach * error, reach * error]))}
    if hazard is None:
        return rows
    generator = np.random.default_rng(_SEED)
    scale = np.sqrt((n - 1) / generator.chisquare(n - 1, (_DRAWS, 1)))
    shift = scale * (generator.standard_normal((_DRAWS, len(away))) @ away)
    rates = []
    logs = []
    for i, (curve, onset) in enumerate(zip(curves, onsets)):
        rates.append(collapse_rate(hazard, curve, onset=onset).rate)
        own = shift[:, 2 * i : 2 * i + 2]
        theta, beta = np.exp(np.clip(own, -_LARGEST_LOG, _LARGEST_LOG)).T
        beta = np.clip(curve.beta * beta, np.exp(-_LARGEST_LOG), _LARGEST_BETA)
        # Those of the lognormal curve of a class, in proportion.
        both = np.append(curve.theta * theta, curve.theta), np.append(beta, curve.beta)
        drawn = np.log(
            np.maximum(lognormal_rates(hazard, *both, np.min(onset)), 1e-300)
        )
        logs.append(drawn[:-1] - drawn[-1])
    ends = np.exp(np.quantile(logs[1] - logs[0], tails(confidence)))
    return rows | {"rate": _row(rates, ends)}


def _row(values: Sequence[float], ends: FloatArray) -> Numbers:
    """Return two values, their ratio and its interval, which is the ratio times `ends`."""
    before, after = values
    ratio = after / before if before > 0.0 else np.nan
    return dict(zip(_ROWS, (before, after, ratio, *(ratio * ends).tolist())))


def states_of(curve: Curve) -> dict[str, Curve]:
    """Return the curves of all limit states as fitted, by their names in files."""
    states = {each.state.replace(" ", "_"): each for each in curve.states}
    return states | {"collapse": curve}


def loss_steps(curve: Curve, ratios: Mapping[str, float]) -> Steps:
    """Return the curves of states that cost something, each with its step in cost.

    `ratios` are costs as fractions, by state; a step is the cost beyond that of the milder state.
    States are ordered by their medians, collapse last, and moved where they cross, as in exports.
    InputError for a state that is not known or ratios that fall; FitError if a state has no curve.
    """
    states = states_of(curve)
    for name in ratios:
        if name not in states:
            raise InputError(
                f"consequence names {name!r}, which is no limit state here; it has "
                f"{', '.join(states)}"
            )
    for name in ratios:
        if not states[name].fitted:
            raise FitError(
                f"limit state {name!r} of the consequences has no curve: {states[name].reason}"
            )
    mild = sorted(set(ratios) - {"collapse"}, key=lambda name: states[name].theta)
    found = Steps()
    severe = curve
    last = "collapse"
    for name in reversed(mild):
        if ratios[name] > ratios[last]:
            raise InputError(
                f"consequence has {name}={ratios[name]:g} and "
                f"{last}={ratios[last]:g}; {last} is severer and costs no less"
            )
        found.insert(0, (severe, ratios[last] - ratios[name]))
        severe = above(states[name], severe)
        last = name
    return [(severe, ratios[last]), *found]


def checked_ratios(ratios: Mapping[str, float]) -> Numbers:
    """Return loss ratios by limit state as numbers, checked.

    InputError unless all lie from 0 to 1, each state is named once, and collapse is among them.
    """
    given = Numbers()
    for name, ratio in ratios.items():
        state = name.strip().casefold().replace(" ", "_")
        if state in given:
            raise InputError(f"consequence has {state} twice; give it one ratio")
        try:
            given[state] = number(ratio) if isinstance(ratio, str) else float(ratio)
        except ValueError as error:
            raise InputError(f"consequence of {state}: {error}") from None
    for name, ratio in given.items():
        if not 0.0 <= ratio <= 1.0:
            raise InputError(
                f"consequence has {name}={ratio:g}; a ratio lies from 0 to 1"
            )
    if "collapse" not in given:
        raise InputError(
            "consequence has no ratio of collapse; add one, such as collapse=1"
        )
    return given


def vulnerability(steps: Steps, im: ArrayLike) -> FloatArray:
    """Return the mean loss ratio at intensities (n,) and the ends of its band, (3, n)."""
    return np.sum(
        [step * np.stack([fit(im), *fit.band(im)]) for fit, step in steps], axis=0
    )


def average_annual_loss(
    hazard: HazardCurve,
    steps: Steps,
    seed: int,
    confidence: float,
    onset: Callable[[Curve], ArrayLike],
) -> dict[str, float | bool]:
    """Return the average annual loss, its mean over theta and beta, and its band [1/year].

    `onset` returns the onset of a curve, as for `collapse_rate`. If the rate of a state is a
    bound, the loss is a lower bound and has no band.
    """
    rates = [
        collapse_rate(hazard, c, c.draws(seed), confidence, onset(c)) for c, _ in steps
    ]
    parts = [(each.quoted, each.mean, each.lower, each.upper) for each in rates]
    losses: list[float] = np.dot([step for _, step in steps], parts).tolist()
    names = ("aal", "aal_mean", "aal_lower", "aal_upper")
    return dict(zip(names, losses)) | {
        "aal_is_lower_bound": any(rate.is_bound for rate in rates)
    }


def divide(
    curve: Curve, split: Contributions, levels: ArrayLike, im: ArrayLike
) -> FloatArray:
    """Return the probability of a collapse in each part, and both ends of its band.

    `split` has the collapses of each part at `levels`, (n_level,); `im`, (n,), are intensities >=
    0 in the same unit. The result is (3, n_part, n); the first row adds up to the curve.
    """
    x = log_intensity(im)
    seen = _near(split, np.log(levels), x)
    points = np.random.default_rng(_PART_SEED).random((_PART_DRAWS, len(seen), 1))
    draws = gammaincinv(seen, points)  # of all intensities alike: smooth bands
    theta, beta = np.reshape(curve.draws(_PART_SEED, _PART_DRAWS), (2, -1, 1))
    drawn = ndtr((x - np.log(theta)) / beta) / draws.sum(axis=1)
    band = np.quantile(draws * drawn[:, None], tails(curve.confidence), axis=0)
    return np.stack([curve(im) * seen / seen.sum(axis=0), *band])


def _near(split: Contributions, logs: FloatArray, x: FloatArray) -> FloatArray:
    """Return the Dirichlet parameters of the shares at ln im `x`, (n_part, n).

    `logs` are those of the levels.
    """
    number = split.counts.sum(axis=0)
    near = np.clip(x, *logs[number > 0][[0, -1]])[:, None]
    weight = np.exp(-0.5 * ((near - logs) / _WIDTH) ** 2)
    seen = split.counts @ (weight / weight.sum(axis=1, keepdims=True)).T
    return seen * min(1.0, split.n_effective / number.max()) + 1.0 / len(seen)
