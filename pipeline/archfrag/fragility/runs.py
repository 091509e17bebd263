"""Runs that decided, ordered by intensity and by record, and their resampling."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import FloatArray, IntArray, positive, shaped, tails

MOST_LEVELS = 500
MOST_GROUPS = 2000


@dataclass(frozen=True)
class Resampling:
    """How a bootstrap is drawn and what is kept of it."""

    seed: int  #: of numpy's default generator; the same seed gives the same draws
    resamples: int = 1000  #: number of draws, at least 100
    confidence: float = 0.9  #: two-sided, between 0 and 1

    def __post_init__(self) -> None:
        if self.resamples < 100:
            raise InputError(f"resamples is {self.resamples}; quantiles need at least 100")
        tails(self.confidence)

    @property
    def generator(self) -> np.random.Generator:
        """A new generator from the seed."""
        return np.random.default_rng(self.seed)

    @property
    def tails(self) -> list[float]:
        """Lower and upper quantile of the interval."""
        return tails(self.confidence)

    def multiplicities(self, n_group: int) -> IntArray:
        """How often each group is drawn in each resample, (resamples, n_group)."""
        return self.generator.multinomial(n_group, np.full(n_group, 1.0 / n_group), self.resamples)

    def draws(self, event: ArrayLike | None, n_record: int) -> IntArray:
        """How often each record is drawn, with its event, (resamples, n_record)."""
        group = event_groups(event, n_record)
        return self.multiplicities(int(group.max()) + 1)[:, group]


@dataclass(frozen=True)
class Runs:
    """Collapses and runs at each distinct intensity, record by record."""

    levels: FloatArray  #: (n_level,), distinct intensities, rising, > 0
    collapses: FloatArray  #: (n_record, n_level)
    n: FloatArray  #: (n_record, n_level), runs that collapsed or stood
    group: IntArray  #: (n_record,); records with the same number are resampled together

    @property
    def totals(self) -> tuple[FloatArray, FloatArray]:
        """Collapses and runs at each level, (n_level,) each."""
        return self.collapses.sum(axis=0), self.n.sum(axis=0)

    @property
    def records_repeat(self) -> bool:
        """Whether some record serves at more than one level."""
        return bool(np.any(np.count_nonzero(self.n, axis=1) > 1))

    def binned(self, most: int) -> "Runs":
        """The same with at most `most` levels: neighbours are at their geometric mean."""
        if self.levels.size <= most:
            return self
        place = np.arange(self.levels.size) * most // self.levels.size
        start = np.searchsorted(place, np.arange(most))
        weight = self.totals[1]
        mean = np.bincount(place, weight * np.log(self.levels)) / np.bincount(place, weight)
        collapses, n = (np.add.reduceat(part, start, axis=1) for part in (self.collapses, self.n))
        return Runs(np.exp(mean), collapses, n, self.group)

    def resample(self, resampling: Resampling) -> tuple[FloatArray, FloatArray]:
        """Collapses and runs at each level in each draw of groups, (n_draw, n_level)."""
        kept = self.group % MOST_GROUPS
        size = min(int(self.group.max()) + 1, MOST_GROUPS)
        grouped = np.zeros((2, size, self.levels.size))
        np.add.at(grouped[0], kept, self.collapses)
        np.add.at(grouped[1], kept, self.n)
        times = resampling.multiplicities(size).astype(float)
        return times @ grouped[0], times @ grouped[1]


def gather_runs(verdict: ArrayLike, im: ArrayLike, *, event: ArrayLike | None = None) -> Runs:
    """Runs of a grid or of scattered motions, in the form that the curves of a study need.

    Verdicts other than standing and collapsed (unfinished, solver failure, not simulated) decide
    nothing and are left out. More than 500 distinct intensities are gathered into 500 groups of
    neighbours, each at its geometric mean.

    A design that chooses its runs by what the earlier ones did (`ida`) leaves out cells that are
    decided in all but name; fill them before (`archfrag.fragility.brackets.fill_verdicts`), or
    the collapses that remain are a biased choice.

    Parameters
    ----------
    verdict : array_like of int, (n_record, n_level) or (n_run,)
        Codes of `archfrag.fragility.counts.Verdict`; without levels each run has a record of its
        own.
    im : array_like
        Intensity of each run, any shape that broadcasts to that of `verdict`, > 0.
    event : array_like, (n_record,), optional
        Earthquake of each record; an empty text is an event of its own.

    Raises
    ------
    InputError
        If shapes do not match, a code is no verdict, an intensity is no positive number, or no
        run decides.

    Examples
    --------
    >>> from archfrag.fragility.runs import gather_runs
    >>> runs = gather_runs([[0, 0, 1], [0, 1, 1]], [0.1, 0.2, 0.4])
    >>> [part.tolist() for part in runs.totals]
    [[0.0, 1.0, 2.0], [2.0, 2.0, 2.0]]
    """
    codes = np.asarray(verdict)
    if codes.ndim not in (1, 2):
        raise InputError(f"verdict has shape {codes.shape}; (n_record, n_level) or (n_run,)")
    try:
        intensity = np.broadcast_to(np.asarray(im, dtype=float), codes.shape)
    except ValueError:
        shapes = f"im has shape {np.shape(im)}, verdict {codes.shape}"
        raise InputError(f"{shapes}; one intensity per run is needed") from None
    count_verdicts(codes)
    row = np.indices(codes.shape)[0]
    decided = (codes == Verdict.STANDING) | (codes == Verdict.COLLAPSED)
    if not decided.any():
        raise InputError("verdict holds no run that collapsed or stood")
    group = event_groups(event, len(codes))
    levels, column = np.unique(positive(intensity[decided], "im"), return_inverse=True)
    if levels.size > MOST_LEVELS:
        place = np.arange(levels.size) * MOST_LEVELS // levels.size
        levels = np.exp(np.bincount(place, np.log(levels)) / np.bincount(place))
        column = place[column]
    present, slot = np.unique(row[decided], return_inverse=True)
    n = np.zeros((present.size, levels.size))
    collapses = np.zeros_like(n)
    np.add.at(n, (slot, column), 1.0)
    np.add.at(collapses, (slot, column), (codes[decided] == Verdict.COLLAPSED).astype(float))
    return Runs(levels, collapses, n, np.unique(group[present], return_inverse=True)[1])


def event_groups(event: ArrayLike | None, n_record: int) -> IntArray:
    """A number for each record, the same for those of one named event."""
    if event is None:
        return np.arange(n_record)
    names = shaped(event, (n_record,), "event").astype(str)
    own = np.array([name or f"\0{i}" for i, name in enumerate(names)])
    return np.unique(own, return_inverse=True)[1]
