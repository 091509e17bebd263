"""Curves that are not bound to a lognormal shape: isotonic, and local probit lines."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.special import ndtr

from archfrag.errors import FitError
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.lines import binomial_lines
from archfrag.fragility.runs import Resampling, Runs

_FOLDS = 5
_CANDIDATES = 7
_GRID = 17
_BINS = 40


@dataclass(frozen=True)
class FreeCurve:
    """A curve and its band at some intensities; between them both are linear in ln im.

    The band is pointwise, from the bootstrap of records (percentile method). Where all runs of a
    level agree, so do those of each resample: it has no width there. It is somewhat too narrow,
    most of all in the upper tail: a nominal 90 % held a lognormal curve (beta 0.4, 15 levels, 200
    studies, standard error 2 %) at p = 0.1, 0.25, 0.5, 0.75, 0.9 in 86, 90, 88, 87, 79 % with 24
    records and in 88, 86, 88, 86, 81 % with 44 (isotonic), within 4 % of that for the kernel.
    """

    kind: str  #: "isotonic" or "kernel"
    im: FloatArray  #: (n_point,), rising
    value: FloatArray  #: (n_point,), probabilities of collapse at `im`
    lower: FloatArray  #: (n_point,), of the band
    upper: FloatArray


def isotonic_curve(runs: Runs, resampling: Resampling) -> FreeCurve:
    """Likeliest curve that never falls with intensity.

    Pool adjacent violators, fractions weighted by their runs, is the maximum of the binomial
    likelihood under that condition alone (Ayer, Brunk, Ewing, Reid and Silverman 1955, Ann.
    Math. Stat. 26). The band is from the bootstrap of records, or of events where they are
    named; it is known to be inconsistent for isotonic curves where intensities are many and runs
    at each are not (Sen, Banerjee and Woodroofe 2010, Ann. Stat. 38): read it as a rough one for
    scattered runs.

    Parameters
    ----------
    runs : Runs
        From `gather_runs`, of at least two levels.
    resampling : Resampling

    Raises
    ------
    FitError
        If all runs are at one level.

    Examples
    --------
    >>> from archfrag.fragility.runs import Resampling, gather_runs
    >>> from archfrag.fragility.shapes import isotonic_curve
    >>> runs = gather_runs([[0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 1, 1]], [0.1, 0.2, 0.4])
    >>> isotonic_curve(runs, Resampling(seed=1)).value.tolist()
    [0.0, 0.5, 0.75]
    """
    _require_levels(runs)
    drawn = zip(*runs.resample(resampling), strict=True)
    draws = np.array([_pooled_with_gaps(k, count) for k, count in drawn])
    band = np.quantile(draws, resampling.tails, axis=0)
    return FreeCurve("isotonic", runs.levels, pooled(*runs.totals), *band)


def pooled(collapses: FloatArray, n: FloatArray) -> FloatArray:
    """Isotonic fractions of collapse, (n_level,); every level must have runs."""
    return isotonic_regression(collapses / n, weights=n).x


def kernel_curve(runs: Runs, resampling: Resampling) -> FreeCurve:
    """Local likelihood: at each intensity, a probit line fitted to the runs near it.

    Runs count by a Gaussian kernel in ln im (Fan, Heckman and Wand 1995, J. Am. Stat. Assoc. 90);
    for a wide kernel the curve is the lognormal one itself. It may fall where the data do. The
    bandwidth is the one of seven from the mean distance of the levels to twice their range under
    which records left out (a fifth at a time, events together) are likeliest; the band is drawn
    with this bandwidth kept. More than 40 levels are gathered into 40 of neighbours. Arguments
    and errors are those of `isotonic_curve`.

    Examples
    --------
    >>> from archfrag.fragility.runs import Resampling, gather_runs
    >>> from archfrag.fragility.shapes import kernel_curve
    >>> runs = gather_runs([[0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 1, 1]], [0.1, 0.2, 0.4])
    >>> curve = kernel_curve(runs, Resampling(seed=1))
    >>> bool(0.0 < curve.value[0] < curve.value[-1] < 1.0)
    True
    """
    _require_levels(runs)
    runs = runs.binned(_BINS)
    x = np.log(runs.levels)
    nodes = np.linspace(x[0], x[-1], _GRID)
    width = _bandwidth(runs, x, nodes)
    collapses, n = (part[None] for part in runs.totals)
    value = _local(x, collapses, n, nodes, width)[0]
    draws = _local(x, *runs.resample(resampling), nodes, width)
    band = np.quantile(draws, resampling.tails, axis=0)
    return FreeCurve("kernel", np.exp(nodes), value, *band)


def _local(
    x: FloatArray, collapses: FloatArray, n: FloatArray, nodes: FloatArray, width: float
) -> FloatArray:
    """Local fits of each data set at each node, (n_fit, n_node)."""
    kernel = np.exp(-0.5 * ((x - nodes[:, None]) / width) ** 2)
    kernel /= kernel.max(axis=1, keepdims=True)
    values = np.empty((len(n), nodes.size))
    for j, node in enumerate(nodes):
        near = kernel[j] > 1e-8
        if np.count_nonzero(near) < 2:
            near = np.argsort(np.abs(x - node)) < 2
        k, count = (part[:, near] * kernel[j, near] for part in (collapses, n))
        values[:, j] = ndtr(binomial_lines(x[near] - node, k, count).intercept)
    return values


def _bandwidth(runs: Runs, x: FloatArray, nodes: FloatArray) -> float:
    """Bandwidth under which the records left out are likeliest."""
    extent = x[-1] - x[0]
    least = max(extent / (len(x) - 1), extent / _GRID)
    candidates = np.geomspace(least, 2.0 * extent, _CANDIDATES)
    fold = runs.group % min(_FOLDS, int(runs.group.max()) + 1)
    kept = [fold != i for i in np.unique(fold)]
    if len(kept) < 2:
        return float(candidates[-1])
    collapses, n = (
        np.stack([part[keep].sum(0) for keep in kept]) for part in (runs.collapses, runs.n)
    )
    k_out, n_out = runs.totals[0] - collapses, runs.totals[1] - n
    scores = []
    for width in candidates:
        values = _local(x, collapses, n, nodes, float(width))
        p = np.clip([np.interp(x, nodes, value) for value in values], 1e-4, 1.0 - 1e-4)
        scores.append(np.sum(k_out * np.log(p) + (n_out - k_out) * np.log1p(-p)))
    return float(candidates[int(np.argmax(scores))])


def _pooled_with_gaps(collapses: FloatArray, n: FloatArray) -> FloatArray:
    """`pooled`; a level without runs in this draw lies on the line between its neighbours."""
    used = n > 0.0
    at = np.flatnonzero(used)
    return np.interp(np.arange(n.size), at, pooled(collapses[used], n[used]))


def _require_levels(runs: Runs) -> None:
    if runs.levels.size < 2:
        why = "all runs are at one level, {}, which gives no curve"
        raise FitError(f"{why}; add levels", runs.levels[0])
