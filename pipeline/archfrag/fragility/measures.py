"""Intensity measures compared: in which of them the collapses of a study scatter least.

The motion of every run is known in all measures, (value of the unscaled motion) x (scale factor)
** exponent, so one study has a curve in each of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.fragility.brackets import find_brackets
from archfrag.fragility.curve import FloatArray, IntArray, positive, shaped
from archfrag.fragility.measure_rows import (
    SIGNIFICANCE,
    Compared,
    MeasureRow,
    compare_grid,
    compare_scattered,
)
from archfrag.fragility.runs import event_groups

__all__ = ["MeasureRow", "MeasureTable", "Motions", "compare_measures"]


@dataclass(frozen=True)
class Motions:
    """What is known of the unscaled motions of a study."""

    measures: tuple[str, ...]  #: names, (n_measure,)
    value: ArrayLike  #: (n_record, n_measure), > 0
    #: (n_measure,), > 0: power of the scale factor in each measure, 2 for Arias intensity.
    exponent: ArrayLike
    magnitude: ArrayLike | None = None  #: (n_record,), of the earthquake; nan where not known
    distance: ArrayLike | None = None  #: (n_record,), from it, any unit, > 0; likewise
    event: ArrayLike | None = None  #: (n_record,), name of the earthquake; empty: one of its own


@dataclass(frozen=True)
class MeasureTable:
    """Outcome of `compare_measures`."""

    rows: tuple[MeasureRow, ...]  #: in the order of the measures given
    own: str  #: the study's measure
    #: Of the sufficient measures with a curve (if none is, of those not tested; else of all) the
    #: most efficient one: least `efficiency` for grids, greatest `log_likelihood` for scattered
    #: runs.
    best: str
    #: Probability that a measure no better than the study's own seems so much better by chance,
    #: times the number of measures that the best was chosen from (Bonferroni, at most 1); 1 if it
    #: is the study's own. By equality of scatter for grids (Pitman 1939, Morgan 1939, Biometrika
    #: 31), by the difference in log-likelihood for scattered runs (Vuong 1989, Econometrica 57).
    p_value: float
    ratio: float  #: efficiency of the best over that of the study's own
    n_test: int  #: tests of sufficiency that were made, each at 5 %
    message: str


def compare_measures(
    verdict: ArrayLike, factor: ArrayLike, motions: Motions, own: str
) -> MeasureTable:
    """Curve and qualities of each measure, from the runs of one arch.

    A grid gives each record's capacity as a bracket of its scale factor, the border that the
    fewest verdicts contradict, taken at its middle in logarithms (`find_brackets`). A record that
    collapses at its lowest level, or at none, enters as a bound. Scattered runs, one level a
    record, give a probit line in each measure.

    Efficiency and sufficiency are those of Luco and Cornell (2007, Earthquake Spectra 23(2)). A
    measure is called sufficient if ln capacity in it depends neither on magnitude nor on ln
    distance, each tested at 5 % by itself (a t test of the slope; score test for scattered runs).
    Magnitude belongs to the earthquake: it is tested on the means of events, distance on records.
    A small number of events or records does not show dependence.

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level)
        Codes of `archfrag.fragility.counts.Verdict`; all but standing and collapsed decide
        nothing. One level means scattered runs.
    factor : array_like, (n_record, n_level)
        Scale factor of each run, rising along each row, > 0.
    motions : Motions
    own : str
        The measure that the study was scaled by.

    Raises
    ------
    InputError, FitError
        If an argument cannot be; if no measure has a curve.

    Examples
    --------
    >>> import numpy as np
    >>> from archfrag.fragility.measures import Motions, compare_measures
    >>> generator = np.random.default_rng(1)
    >>> pgv = np.exp(generator.normal(-2.0, 0.5, 40))
    >>> pga = 8.0 * pgv * np.exp(generator.normal(0.0, 0.5, 40))
    >>> levels = np.geomspace(0.2, 12.0, 25)
    >>> factor = levels / pga[:, None]
    >>> verdict = factor * pgv[:, None] > np.exp(generator.normal(-1.6, 0.2, (40, 1)))
    >>> motions = Motions(("PGA", "PGV"), np.stack([pga, pgv], axis=1), [1.0, 1.0])
    >>> table = compare_measures(verdict, factor, motions, "PGA")
    >>> table.best, table.p_value < 0.05
    ('PGV', True)
    """
    codes, factors, log_value, exponent = _checked(verdict, factor, motions, own)
    event = event_groups(motions.event, len(codes))
    more = exponent, _covariates(motions, len(codes)), event
    if codes.shape[1] == 1:
        log_im = log_value + exponent[:, None] * np.log(factors[:, 0])
        return _table(own, compare_scattered(motions.measures, codes[:, 0], log_im, *more))
    found = find_brackets(codes, factors)
    return _table(own, compare_grid(motions.measures, found, log_value, *more))


def _table(own: str, compared: Compared) -> MeasureTable:
    rows, merit = compared.rows, compared.merit.tolist()
    mine = [row.measure for row in rows].index(own)
    known = [i for i, row in enumerate(rows) if not row.none and np.isfinite(merit[i])]
    if not known:
        raise FitError("no measure has a curve from these runs: " + rows[mine].none)
    tested = [i for i in known if rows[i].sufficient]
    chosen = tested or [i for i in known if rows[i].sufficient is None] or known
    best = max(chosen, key=merit.__getitem__)
    p_value, ratio = 1.0, 1.0
    if best != mine and not rows[mine].none:
        p_value = min(1.0, compared.by_chance(best, mine) * (len(chosen) - (mine in chosen)))
        ratio = rows[best].efficiency / rows[mine].efficiency
    first = max(known, key=merit.__getitem__)
    message = _message(rows[best], rows[mine], p_value, ratio)
    if rows[first].sufficient is False and first != best:
        message += f" {rows[first].measure} is more efficient, but not sufficient."
    n_test = int(np.isfinite([(row.p_magnitude, row.p_distance) for row in rows]).sum())
    if n_test:
        message += (
            f" Sufficiency took {n_test} tests at {100 * SIGNIFICANCE:g} %, of which "
            f"{SIGNIFICANCE * n_test:.1f} reject by chance where nothing depends on magnitude or "
            "distance."
        )
    return MeasureTable(rows, own, rows[best].measure, p_value, float(ratio), n_test, message)


def _message(best: MeasureRow, own: MeasureRow, p_value: float, ratio: float) -> str:
    kind = {
        True: "the sufficient measures",
        False: "the measures, none of which is sufficient,",
        None: "the measures, whose sufficiency could not be tested,",
    }[best.sufficient]
    head = f"Of {kind} {best.measure} is the most efficient (beta {best.beta:.2f}"
    if best.measure == own.measure:
        return head + "), and it is the one that the study was scaled by."
    if own.none:
        return head + f"); in {own.measure} there is no curve to compare it with."
    doubt = (
        "more than chance and the choice among them explain"
        if p_value < SIGNIFICANCE
        else "which chance and the choice among them can explain"
    )
    return head + (
        f"): its dispersion is {ratio:.2f} times that of {own.measure}, {doubt} "
        f"(p = {p_value:.2g})."
    )


def _checked(
    verdict: ArrayLike, factor: ArrayLike, motions: Motions, own: str
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    factors, names = positive(factor, "factor"), motions.measures
    codes = shaped(verdict, factors.shape, "verdict")
    if codes.ndim != 2 or codes.size == 0:
        raise InputError(f"verdict has shape {codes.shape}; (n_record, n_level) is needed")
    value = shaped(positive(motions.value, "value"), (len(codes), len(names)), "value")
    exponent = shaped(positive(motions.exponent, "exponent"), (len(names),), "exponent")
    if own not in names:
        raise InputError(f"own is {own!r}, which is none of {', '.join(names)}")
    return codes, factors, np.log(value.T), exponent


def _covariates(motions: Motions, n_record: int) -> FloatArray:
    """Magnitude and ln distance, (2, n_record); nan where not known."""
    out = np.full((2, n_record), np.nan)
    for row, name in enumerate(("magnitude", "distance")):
        given = getattr(motions, name)
        if given is not None:
            out[row] = shaped(given, (n_record,), name)
    with np.errstate(divide="ignore", invalid="ignore"):
        out[1] = np.log(out[1])
    return np.where(np.isfinite(out), out, np.nan)
