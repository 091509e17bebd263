"""The band that a report quotes, for records at several levels and for single runs.

docs/evidence/data/bands_coverage.csv shows how often it holds the truth.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from archfrag.errors import FitError
from archfrag.fragility.brackets import Brackets
from archfrag.fragility.curve import FloatArray, Fragility, shaped
from archfrag.fragility.posterior import Posterior, fit_capacity_posterior, fit_posterior

_RHO_ERRORS = 0.5


@dataclass(frozen=True)
class QuotedBand:
    """The curve of a study, how well it is known, and on what assumptions."""

    curve: Fragility  #: medians of theta and beta, kind "posterior"
    theta: tuple[float, float]  #: interval, in the unit of the levels
    beta: tuple[float, float]  #: interval
    lower: FloatArray  #: of the band of the probability of collapse, shape of the intensities
    upper: FloatArray
    method: str  #: name of the method, for a caption
    assumptions: str
    n_independent: float  #: effective number of records or runs
    n_contradictions: int  #: runs that contradict the bracket of their record


def quoted_band(
    found: Brackets, im: ArrayLike, *,
    confidence: float = 0.9, groups: ArrayLike | None = None, unit: str = "event",
) -> QuotedBand:  # fmt: skip
    """Curve of records that were run at several levels, with its band and intervals.

    Parameters
    ----------
    found : Brackets
        The same records serve at all levels, so records are independent and runs are not.
    im : array_like
        Intensities at which the band is wanted, any shape, >= 0.
    confidence : float
        Between 0 and 1.
    groups : array_like, (n_record,), optional
        Label of what rows have in common, such as the event of each record. Rows of one group
        count as fewer, by how alike their capacities are.
    unit : str
        What a group is, for `assumptions`.

    Raises
    ------
    InputError, FitError
        If an argument is not valid; if no run is decided, there is one group only, or nothing
        bounds theta from one side: the message states which levels to add.

    Examples
    --------
    >>> from archfrag.fragility.brackets import find_brackets
    >>> from archfrag.fragility.quoted import quoted_band
    >>> verdict = [[0, 0, 1, 1], [0, 1, 1, 1], [0, 0, 0, 1], [0, 0, 1, 1]]
    >>> quoted = quoted_band(find_brackets(verdict, [0.2, 0.4, 0.6, 0.8]), 0.5)
    >>> bool(quoted.lower < 0.5 < quoted.upper), quoted.n_independent
    (True, 4.0)
    """
    known, number = capacity_posterior(found, groups)
    what = "records and their capacities are independent"
    if groups is not None:
        what = (
            f"{unit}s are independent. Capacities within {unit}s resemble each other, so "
            f"{np.count_nonzero(found.decided)} rows of runs count as {number:.3g}"
        )
    if known.scatter:
        what += (
            f"; single runs of a record scatter about its capacity by {known.scatter:.2g} in "
            "natural logarithms, which beta includes"
        )
    return QuotedBand(
        known.fragility, known.theta_interval(confidence), known.beta_interval(confidence),
        *known.band(im, confidence), "posterior of capacities, right Haar prior",
        f"Capacity is lognormal, and {what}.", number, int(found.contradictions.sum()),
    )  # fmt: skip


def quoted_runs(
    level: ArrayLike, collapsed: ArrayLike, im: ArrayLike, *, confidence: float = 0.9
) -> QuotedBand:
    """Curve of decided runs, (n_run,), that each have a motion of their own.

    The other arguments and errors are those of `quoted_band`.
    """
    if not np.size(level):
        raise FitError("no run collapsed or stood, so there is nothing to fit")
    known = fit_posterior(level, collapsed, 1)
    return QuotedBand(
        known.fragility, known.theta_interval(confidence), known.beta_interval(confidence),
        *known.band(im, confidence), "posterior of independent runs, Jeffreys prior",
        "Capacity is lognormal, and runs are independent, each with a motion of its own.",
        float(np.size(level)), 0,
    )  # fmt: skip


def capacity_posterior(
    found: Brackets, groups: ArrayLike | None = None
) -> tuple[Posterior, float]:
    """Posterior that `quoted_band` quotes, and the effective number of records."""
    known = found.known()
    number = float(known.lower.size)
    if groups is not None:
        labels = shaped(groups, found.lower.shape, "groups")
        number = independent_records(known, labels[found.decided > 0])
    return fit_capacity_posterior(known, number), number


def shared_events(event: ArrayLike) -> NDArray[np.str_] | None:
    """Labels of groups from names of earthquakes; a record without one is its own.

    None if no two records are of one earthquake, or all are: one earthquake does not show how
    earthquakes differ.
    """
    names = np.asarray(event).astype(str)
    known = names[names != ""]
    if np.unique(known).size == known.size:
        return None
    labels = np.where(names == "", [f"record {i}" for i in range(names.size)], names)
    return labels if np.unique(labels).size > 1 else None


def independent_records(found: Brackets, groups: ArrayLike) -> float:
    """Effective number of records, some of which share an event.

    n / (1 + (m - 1) rho) with m = sum n_i^2 / n the records of an event (Kish 1965, Survey
    Sampling) and rho the correlation within events, by analysis of variance of ln capacity. A
    small number of events hardly shows rho, so half its standard error is added: without it 90 %
    bands held the truth in 84 to 88 % at 4 to 8 events of 3 records and rho = 0.5.
    """
    events, place, size = np.unique(np.asarray(groups), return_inverse=True, return_counts=True)
    n, n_event = place.size, events.size
    if n_event < 2:
        why = f"all records belong to one group, {events[0]!s}"
        raise FitError(f"{why}; at least two are needed to show how far they differ")
    worth = float((size**2).sum() / n)
    if n == n_event:
        return float(n)
    values = _expected_logs(found)
    means = np.bincount(place, values) / size
    within = float(((values - means[place]) ** 2).sum() / (n - n_event))
    between = float((size * (means - values.mean()) ** 2).sum() / (n_event - 1))
    usual = (n - worth) / (n_event - 1)
    total = between + (usual - 1.0) * within
    rho = (between - within) / total if total > 0.0 else 0.0
    error = (1.0 - rho) * (1.0 + (usual - 1.0) * rho)
    error *= np.sqrt(2.0 / (usual * (usual - 1.0) * n_event))
    rho = float(np.clip(rho + _RHO_ERRORS * error, 0.0, 1.0))
    return n / (1.0 + (worth - 1.0) * rho)


def _expected_logs(found: Brackets) -> FloatArray:
    """Mean of ln capacity within each bracket, by the curve of all, standardised."""
    monotone = replace(found, contradictions=0 * found.contradictions)
    curve = fit_capacity_posterior(monotone).fragility
    with np.errstate(divide="ignore"):
        low, high = (np.log(end / curve.theta) / curve.beta for end in (found.lower, found.upper))
    mass = np.maximum(ndtr(high) - ndtr(low), 1e-12)
    inside = (np.exp(-0.5 * low**2) - np.exp(-0.5 * high**2)) / (np.sqrt(2.0 * np.pi) * mass)
    return np.clip(inside, low, high)
