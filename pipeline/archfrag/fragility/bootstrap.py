"""Bands from resampled runs, records and events."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from archfrag.errors import InputError
from archfrag.fragility.binomial_lines import binomial_lines
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import FloatArray, Fragility, log_intensity
from archfrag.fragility.fit import checked_stripes, curves_of_lines
from archfrag.fragility.intervals import Band, RecordBand
from archfrag.fragility.runs import Resampling


def bootstrap_band(
    fit: Fragility,
    im: ArrayLike,
    levels: ArrayLike,
    n: ArrayLike,
    resampling: Resampling,
) -> Band:
    """Pointwise band of a curve fitted to stripes, from a parametric bootstrap.

    Collapses are drawn anew at each level from the fitted curve, the curve is fitted to each
    draw, and the band runs between the quantiles of the curves (percentile method). A draw whose
    likelihood has no maximum is not thrown away, for that would narrow the band: it enters with
    the curve that its likelihood tends to (all 0, all 1, a step, or constant) and is counted.

    Parameters
    ----------
    fit : Fragility
        From `fit_stripes`.
    im : array_like
        Intensities, any shape, unit of ``fit.theta``, >= 0.
    levels, n : array_like, (n_level,)
        As given to `fit_stripes`.
    resampling : Resampling
        The same gives the same band.

    Raises
    ------
    InputError
        If an argument cannot be, or `fit` does not come from stripes.
    """
    if fit.kind != "stripes":
        raise InputError(f"the fit is of kind {fit.kind!r}; the bootstrap redraws 'stripes' only")
    levels, _, n = checked_stripes(levels, np.zeros(np.shape(levels)), n)
    im = np.asarray(im, dtype=float)
    log_intensity(im)
    shape = (resampling.resamples, n.size)
    draws = resampling.generator.binomial(n.astype(np.int64), fit.probability(levels), shape)
    distinct, copies = np.unique(draws, axis=0, return_counts=True)
    curves, parameters = _refit(
        levels, distinct.astype(float), np.broadcast_to(n, distinct.shape), im
    )
    lower, upper = np.quantile(np.repeat(curves, copies, axis=0), resampling.tails, axis=0)
    return Band(lower, upper, resampling.confidence, int(copies[np.isnan(parameters[:, 0])].sum()))


def record_bootstrap_band(
    verdict: ArrayLike,
    levels: ArrayLike,
    im: ArrayLike,
    resampling: Resampling,
    *,
    groups: ArrayLike | None = None,
) -> RecordBand:
    """Pointwise band where the same records serve at all levels.

    A record that fells the arch at one level tends to fell it at the next, so the runs of a
    study are not independent as the binomial likelihood takes them to be, and the band from its
    covariance is too narrow. Here whole records are drawn with replacement (the cluster
    bootstrap; Davison and Hinkley 1997, section 3.8), each with its verdicts at all levels, and
    the curve is fitted to each draw. Draws without a curve enter as in `bootstrap_band`.

    Where several records share one event whole events are drawn. The percentile method is too
    narrow where records or events are few (tests/benchmarks/RESULTS.md, "Coverage of the
    bands"); it is a check that assumes no family of curves between records, not what is quoted
    (`archfrag.fragility.quoted.quoted_band`).

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level)
        Codes of `archfrag.fragility.counts.Verdict`; unfinished runs and solver failures count
        as neither.
    levels : array_like, (n_level,)
        Intensity of each level, > 0.
    im : array_like
        Intensities at which the band is wanted, any shape, unit of `levels`, >= 0.
    resampling : Resampling
        The same gives the same band.
    groups : array_like, (n_record,), optional
        Label of the event of each record; every record is its own if left out.

    Raises
    ------
    InputError
        If an argument cannot be.
    """
    count_verdicts(verdict)
    codes = np.asarray(verdict)
    if codes.ndim != 2 or codes.shape[1:] != np.shape(levels) or codes.shape[0] < 2:
        raise InputError(
            f"verdict has shape {codes.shape}, levels {np.shape(levels)}; at least two records "
            "by all levels are needed"
        )
    levels = checked_stripes(levels, np.zeros(codes.shape[1]), codes.shape[0])[0]
    im = np.asarray(im, dtype=float)
    log_intensity(im)
    fell, stood = (_by_event(codes == v, groups) for v in (Verdict.COLLAPSED, Verdict.STANDING))
    times = resampling.multiplicities(len(fell))
    collapses = times @ fell
    n = collapses + times @ stood
    decided = n.sum(axis=1) > 0
    if not decided.any():
        raise InputError("verdict holds no run that collapsed or stood")
    curves, parameters = _refit(levels, collapses[decided], n[decided], im)
    lower, upper = np.quantile(curves, resampling.tails, axis=0)
    known = parameters[~np.isnan(parameters[:, 0])]
    theta = beta = (np.nan, np.nan)
    if known.size:
        (a, b), (c, d) = np.quantile(known, resampling.tails, axis=0).T
        theta, beta = (float(a), float(b)), (float(c), float(d))
    return RecordBand(
        lower, upper, resampling.confidence, resampling.resamples - len(known), theta, beta
    )


def _by_event(table: NDArray[np.bool_], groups: ArrayLike | None) -> FloatArray:
    """Rows of a table added up by their event, (n_event, n_level)."""
    if groups is None:
        return table.astype(float)
    labels = np.asarray(groups)
    if labels.shape != table.shape[:1]:
        raise InputError(
            f"groups has shape {labels.shape}; one label for each of "
            f"{len(table)} records is needed"
        )
    events, place = np.unique(labels, return_inverse=True)
    if events.size < 2:
        raise InputError(f"groups holds one event, {events[0]!s}; at least two are needed")
    added = np.zeros((events.size, table.shape[1]))
    np.add.at(added, place, table)
    return added


def _refit(
    levels: FloatArray, collapses: FloatArray, n: FloatArray, im: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Curves at `im`, and (theta, beta), of many draws, (n_draw, n_level); nan without a fit."""
    lines = binomial_lines(np.log(levels), collapses, n)
    many = curves_of_lines(lines, collapses, n)
    column = (slice(None), *(None,) * im.ndim)
    x = np.maximum(log_intensity(im), -1e3)
    curves = ndtr(lines.intercept[column] + lines.slope[column] * x)
    return curves, np.stack([many.theta, many.beta], axis=1)
