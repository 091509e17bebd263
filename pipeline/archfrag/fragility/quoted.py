"""Which band a report quotes, chosen for each design by its coverage.

The table is docs/evidence/data/bands_coverage.csv.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from archfrag.errors import FitError, InputError
from archfrag.fragility.brackets import Brackets, find_brackets
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import Band, FloatArray, Fragility, shaped
from archfrag.fragility.fit import fit_brackets
from archfrag.fragility.posterior import (
    Posterior,
    fit_capacity_posterior,
    fit_posterior,
    fit_scattered_posterior,
)

SAME_RECORDS = ("stripes", "ida", "two_stage")
OWN_MOTIONS = ("scattered",)
_RHO_ERRORS = 0.5


@dataclass(frozen=True)
class QuotedBand:
    """The curve of a study, how well it is known, and on what assumptions."""

    curve: Fragility  #: medians of theta and beta, kind "posterior"
    theta: tuple[float, float]  #: interval, in the unit of the levels
    beta: tuple[float, float]  #: interval
    band: Band  #: of the probability of collapse
    method: str  #: name of the method, for a caption
    assumptions: str
    n_independent: float  #: records or runs that the data are worth
    n_islands: int  #: runs against the bracket of their record (see `Brackets`)


def quoted_band(
    design: str, verdict: ArrayLike, intensity: ArrayLike, im: ArrayLike, *,
    confidence: float = 0.9, groups: ArrayLike | None = None, unit: str = "event",
) -> QuotedBand:  # fmt: skip
    """Curve of a study with the band and the intervals that its report quotes.

    Parameters
    ----------
    design : str
        ``"stripes"``, ``"ida"`` or ``"two_stage"``: the same records serve at all levels, and
        are what is independent. ``"scattered"``: each run has a motion of its own.
    verdict : array_like of int
        Codes of `Verdict`, (n_record, n_level); for ``"scattered"`` any shape. Only runs that
        collapsed or stood are used.
    intensity : array_like
        Levels (n_level,), > 0; for ``"scattered"`` of each run, the shape of `verdict`.
    im : array_like
        Intensities at which the band is wanted, any shape, >= 0.
    confidence : float
        Between 0 and 1.
    groups : array_like, (n_record,), optional
        Label of what rows have in common, such as the event of each record. Rows of one group
        are worth fewer, by how alike their capacities are.
    unit : str
        What a group is, for `assumptions`.

    Raises
    ------
    InputError, FitError
        If an argument cannot be; if no run is decided, there is one group only, or nothing bounds
        theta from one side: the message states which levels to add.

    Examples
    --------
    >>> from archfrag.fragility.quoted import quoted_band
    >>> verdict = [[0, 0, 1, 1], [0, 1, 1, 1], [0, 0, 0, 1], [0, 0, 1, 1]]
    >>> quoted = quoted_band("stripes", verdict, [0.2, 0.4, 0.6, 0.8], 0.5)
    >>> bool(quoted.band.lower < 0.5 < quoted.band.upper), quoted.n_independent
    (True, 4.0)
    """
    known, n_rows, number, n_islands = quoted_posterior(design, verdict, intensity, groups)
    method = "posterior of capacities, right Haar prior"
    what = "records and their capacities are independent"
    if design in OWN_MOTIONS:
        method = "posterior of independent runs, Jeffreys prior"
        what = "runs are independent, each with a motion of its own"
    elif groups is not None:
        what = (
            f"{unit}s are independent, their {n_rows} rows of runs worth {number:.3g} "
            f"independent ones by how alike capacities within {unit}s are"
        )
    if known.scatter:
        what += (
            f"; single runs of a record scatter about its capacity by {known.scatter:.2g} in "
            "natural logarithms, which beta includes"
        )
    return QuotedBand(
        known.fragility, known.theta_interval(confidence), known.beta_interval(confidence),
        known.band(im, confidence), method, f"Capacity is lognormal, and {what}.", number,
        n_islands,
    )  # fmt: skip


def quoted_posterior(
    design: str, verdict: ArrayLike, intensity: ArrayLike, groups: ArrayLike | None = None
) -> tuple[Posterior, int, float, int]:
    """What `quoted_band` is made of, with its arguments and errors.

    Returns
    -------
    (Posterior, int, float, int)
        And the number of records (or runs) that decide, what they are worth, and of islands.
    """
    if design in SAME_RECORDS:
        every = find_brackets(verdict, intensity, "count" if design == "stripes" else "fewest")
        found = every.known()
        number = float(found.lower.size)
        if groups is not None:
            labels = shaped(groups, every.lower.shape, "groups")
            number = independent_records(found, labels[every.decided > 0])
        if found.contradictions.any():
            line = fit_brackets(found.lower, found.upper)
            codes, order = np.asarray(verdict)[every.decided > 0], np.argsort(intensity)
            fell, stood = codes == Verdict.COLLAPSED, codes == Verdict.STANDING
            used = order[(fell | stood).any(axis=0)[order]]
            posterior = fit_scattered_posterior(
                np.asarray(intensity)[used],
                fell[:, used],
                stood[:, used],
                (np.log(line.theta), line.beta),
                number,
            )
        else:
            posterior = fit_capacity_posterior(found.lower, found.upper, number)
        return posterior, found.lower.size, number, int(found.contradictions.sum())
    if design not in OWN_MOTIONS:
        raise InputError(
            f"design is {design!r}; a band is quoted for "
            + ", ".join(repr(name) for name in SAME_RECORDS + OWN_MOTIONS)
        )
    if groups is not None:
        raise InputError(f"groups are of records, which do not repeat in the design {design!r}")
    codes = np.asarray(verdict)
    levels = shaped(intensity, codes.shape, "intensity").astype(float)
    count_verdicts(codes.reshape(1, -1))
    decided = (codes == Verdict.COLLAPSED) | (codes == Verdict.STANDING)
    fell = (codes[decided] == Verdict.COLLAPSED).astype(float)
    if not fell.size:
        raise FitError("no run collapsed or stood, so there is nothing to fit")
    return fit_posterior(levels[decided], fell, 1), fell.size, float(fell.size), 0


def shared_events(event: ArrayLike) -> NDArray[np.str_] | None:
    """Labels of groups from names of earthquakes; a record without one is its own.

    None where no two records are of one, or all are: one earthquake does not show how
    earthquakes differ.
    """
    names = np.asarray(event).astype(str)
    known = names[names != ""]
    if np.unique(known).size == known.size:
        return None
    labels = np.where(names == "", [f"record {i}" for i in range(names.size)], names)
    return labels if np.unique(labels).size > 1 else None


def independent_records(found: Brackets, groups: ArrayLike) -> float:
    """Independent records that records of two or more shared events are worth.

    n / (1 + (m - 1) rho) with m = sum n_i^2 / n the records of an event (Kish 1965, Survey
    Sampling) and rho the correlation within events, by analysis of variance of ln capacity. As
    rho is poorly known from a small number of events, half its standard error is added: without
    it 90 % bands held the truth in 84 to 88 % at 4 to 8 events of 3 records and rho = 0.5.
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
    """Mean of ln capacity within each bracket, by the curve of all."""
    curve = fit_capacity_posterior(found.lower, found.upper).fragility
    with np.errstate(divide="ignore"):
        low, high = (
            (np.log(end) - np.log(curve.theta)) / curve.beta for end in (found.lower, found.upper)
        )
    mass = np.maximum(ndtr(high) - ndtr(low), 1e-12)
    inside = (np.exp(-0.5 * low**2) - np.exp(-0.5 * high**2)) / (np.sqrt(2.0 * np.pi) * mass)
    return np.clip(inside, low, high)
