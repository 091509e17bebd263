"""Whether a lognormal curve describes the collapses of a study: a parametric bootstrap."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, xlogy

from archfrag.errors import FitError
from archfrag.fragility.curve import FloatArray, IntArray
from archfrag.fragility.lines import Lines, binomial_lines
from archfrag.fragility.runs import Resampling, Runs
from archfrag.fragility.shapes import pooled

_CORRELATIONS = np.array([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 1.0])
_TRIALS = 60


@dataclass(frozen=True)
class FitTest:
    """Outcome of `check_lognormal`."""

    deviance: float  #: twice the log-likelihood by which the isotonic curve is better
    p_value: float  #: probability of so large a deviance if the lognormal curve is the true one
    #: Correlation of ln capacity between two runs of a record that was supposed in the draws: 1
    #: where no verdicts contradict each other; nan where each record serves once.
    record_correlation: float

    @property
    def message(self) -> str:
        """The outcome in words."""
        p = self.p_value
        return (
            f"The lognormal curve does not describe these collapses (p = {p:.3g}): quote the "
            "isotonic or the kernel curve beside it."
            if p < 0.05
            else f"Nothing here contradicts a lognormal curve (p = {p:.2g}); with a small number "
            "of records only a large misfit would show."
        )


def check_lognormal(runs: Runs, resampling: Resampling) -> FitTest:
    """Test the lognormal curve against any curve that rises with intensity.

    The statistic is the likelihood ratio of the isotonic and the lognormal curve. It has no
    known distribution, least of all where the same records serve at all levels, so it is
    compared with its values in studies drawn from the fitted curve, each fitted anew (parametric
    bootstrap; Davison and Hinkley 1997, section 4.2), in the same cells as the study's runs.

    Records that serve at several levels are drawn as such: ln capacity of a run is ln theta +
    beta (sqrt(rho) a + sqrt(1 - rho) e), with a one normal number per record and e one per run.
    rho is the value at which the draws show as many reversals as the study (a collapse followed,
    at the next level run, by standing): 1 if there are none. Independent runs would give a test
    that finds misfits too seldom or too often. Records of one event are drawn as independent.

    Parameters
    ----------
    runs : Runs
        From `gather_runs`; a bisected study must be filled before.
    resampling : Resampling
        Its confidence is not used.

    Raises
    ------
    FitError
        If the runs have no lognormal curve.

    Examples
    --------
    >>> import numpy as np
    >>> from archfrag.fragility.goodness import check_lognormal
    >>> from archfrag.fragility.runs import Resampling, gather_runs
    >>> im = np.geomspace(0.1, 1.0, 8)
    >>> capacity = np.exp(np.random.default_rng(1).normal(-1.2, 0.4, 30))
    >>> runs = gather_runs(im >= capacity[:, None], im)
    >>> check_lognormal(runs, Resampling(seed=2, resamples=200)).p_value > 0.05
    True
    """
    x = np.log(runs.levels)
    collapses, n = runs.totals
    line = binomial_lines(x, collapses[None], n[None])
    if line.degenerate[0]:
        raise FitError("these runs have no lognormal curve, so there is nothing to test")
    deviance = _deviances(line, collapses[None], n)[0]
    generator = resampling.generator
    z = line.intercept[0] + line.slope[0] * x
    correlation = _record_correlation(runs, z, generator) if runs.records_repeat else np.nan
    drawn = _draw(runs, z, correlation, generator, resampling.resamples)
    fits = binomial_lines(x, drawn, np.broadcast_to(n, drawn.shape))
    values = _deviances(fits, drawn, n)[~fits.degenerate]
    p_value = (1.0 + np.count_nonzero(values >= deviance)) / (1.0 + values.size)
    return FitTest(float(deviance), float(p_value), float(correlation))


def _deviances(lines: Lines, collapses: FloatArray, n: FloatArray) -> FloatArray:
    values = np.empty(len(collapses))
    for i, k in enumerate(collapses):
        p = np.clip(pooled(k, n), 0.0, 1.0)
        values[i] = xlogy(k, p).sum() + xlogy(n - k, 1.0 - p).sum()
    return 2.0 * (values + lines.loss)


def _draw(
    runs: Runs, z: FloatArray, correlation: float, generator: np.random.Generator, draws: int
) -> FloatArray:
    """Collapses at each level of studies drawn from probits `z`, (n_draw, n_level)."""
    if np.isnan(correlation):
        n = runs.totals[1].astype(np.int64)
        return generator.binomial(n, ndtr(z), (draws, z.size)).astype(float)
    record, level = _cells(runs)
    out = np.empty((draws, z.size))
    for row in out:
        shared, own = _scatter(runs, record, generator)
        fell = z[level] >= np.sqrt(correlation) * shared + np.sqrt(1.0 - correlation) * own
        row[:] = np.bincount(level, fell, z.size)
    return out


def _record_correlation(runs: Runs, z: FloatArray, generator: np.random.Generator) -> float:
    """Correlation of two runs of a record that gives the study's number of reversals."""
    record, level = _cells(runs)
    next_run = (record[1:] == record[:-1]) & (level[1:] != level[:-1])
    fell = runs.collapses[record, level] > 0.0
    seen = np.count_nonzero(next_run & fell[:-1] & ~fell[1:])
    if seen == 0:
        return 1.0
    counts = np.zeros(_CORRELATIONS.size)
    for _ in range(_TRIALS):
        shared, own = _scatter(runs, record, generator)
        for i, rho in enumerate(_CORRELATIONS):
            fell = z[level] >= np.sqrt(rho) * shared + np.sqrt(1.0 - rho) * own
            counts[i] += np.count_nonzero(next_run & fell[:-1] & ~fell[1:]) / _TRIALS
    return float(np.interp(-seen, -counts, _CORRELATIONS))


def _cells(runs: Runs) -> tuple[IntArray, IntArray]:
    """Record and level of each run, rising levels within a record."""
    record, level = np.nonzero(runs.n)
    copies = runs.n[record, level].astype(np.int64)
    return np.repeat(record, copies), np.repeat(level, copies)


def _scatter(
    runs: Runs, record: IntArray, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Normal numbers of the record and of the run, (n_run,) each."""
    return generator.standard_normal(len(runs.n))[record], generator.standard_normal(record.size)
