"""Curves of several arches or limit states: their mean, parts of dispersion, and crossings."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError
from archfrag.fragility.curve import Curve

MOST_CROSSING = 0.01  # probability by which curves of two limit states may cross


def mixture(pooled: Curve, curves: Sequence[Curve]) -> Curve:
    """Return the curve of a class of arches: the mean of the curves of its arches.

    `theta` and `beta` are those of the lognormal curve with the same mean and standard deviation
    of ln capacity; covariance, band and sizes are those of the `pooled` curve of all runs.
    """
    members = np.array([[fit.theta, fit.beta] for fit in curves])
    logs = np.log(members[:, 0])
    theta, beta = float(np.exp(logs.mean())), np.sqrt((members[:, 1] ** 2).mean() + logs.var())
    return replace(pooled, theta=theta, beta=float(beta), kind="mixture", members=members)


def crossing_words(curves: Sequence[Curve]) -> str:
    """Write whether curves of neighbouring limit states cross, from light to severe."""
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
    """Move the curve of a milder state until that of a severer one lies nowhere above it.

    Fits of two states can cross by more than `MOST_CROSSING`, by chance and because that of
    collapse is another estimate. If they do, the median is at most that of the severer state, and
    the dispersion is the nearest one, on the way to that of the severer state, without a crossing.
    """
    if crossing(mild, severe) <= MOST_CROSSING:
        return mild
    theta = min(mild.theta, severe.theta)
    for beta in np.linspace(mild.beta, severe.beta, 101):
        moved = replace(mild, theta=theta, beta=float(beta), kind="adjusted")
        if crossing(moved, severe) <= MOST_CROSSING:
            return moved
    return severe  # a mean of curves, which no lognormal one of this dispersion comes close to


def crossing(mild: Curve, severe: Curve) -> float:
    """Return the largest probability by which the curve of the severer state is the higher one.

    Other programs would take a negative probability from between the two.
    """
    ends = [fit.theta * np.exp(s * 4.0 * fit.beta) for fit in (mild, severe) for s in (-1, 1)]
    im = np.geomspace(min(ends), max(ends), 400)
    return float((severe(im) - mild(im)).max())


def split_capacities(capacity: ArrayLike) -> tuple[float, float]:
    """Divide the dispersion of capacities, (n_arch, n_record), into two betas.

    With A the arch, var ln C = E[var(ln C | A)] + var(E[ln C | A]): beta_record_to_record^2, with
    what records do to some arches only, and beta_model^2; by analysis of variance with two factors
    (Searle, Casella and McCulloch 1992, *Variance Components*, chapters 3 and 4). A negative
    estimate counts as 0. Records with an unknown capacity (nan) are left out. FitError if fewer
    than two arches, or two records of each, remain.
    """
    logs = np.log(capacity)
    logs = logs[:, ~np.isnan(logs).any(axis=0)]
    a, r = logs.shape
    if a < 2 or r < 2:
        known = f"{a} arches with {r} records of known capacity remain"
        raise FitError(f"{known}; two of each are needed to separate modelling from records")
    arch, record = logs.mean(axis=1), logs.mean(axis=0)
    residual = logs - arch[:, None] - record + logs.mean()
    interaction = float((residual**2).sum()) / ((a - 1) * (r - 1))
    # var(ln C | arch) is that of the records and of the interaction together.
    within = record.var(ddof=1) + (a - 1) / a * interaction
    between = arch.var(ddof=1) - interaction / r
    return float(np.sqrt(within)), float(np.sqrt(max(between, 0.0)))


def split_curves(
    theta: ArrayLike, beta: ArrayLike, standard_error: ArrayLike, *, shared: float = 0.0
) -> tuple[float, float]:
    """Divide the dispersion as `split_capacities`, from the curve of each arch, (n_arch,).

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
