"""Verdicts of runs: counted at each level, and bracketing the capacity of each record."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv, ndtri

from archfrag.errors import FitError, InputError
from archfrag.files import Named
from archfrag.fragility.curve import (
    BoolArray,
    FloatArray,
    IntArray,
    Pair,
    Triple,
    log_intensity,
    positive,
    tails,
)

MOST_LEVELS = 500  # of runs by intensity
RESAMPLES = 300  # of a bootstrap
NOTHING = (
    "no run collapsed or survived, so there is nothing to fit: if arches still moved at the end, "
    "raise method.follow; if they failed, try another method.name"
)


class Verdict(IntEnum):
    """Outcome of a run, as stored in kernels, cube and tables."""

    SURVIVED = 0
    COLLAPSED = 1
    UNFINISHED = 2  # the arch still moved at the end
    FAILED = 3  # no method solved it
    NOT_RUN = 4  # the design of the study asked for no such run
    COLLAPSED_BEFORE = 5  # in a first shock, before the record began


DECIDED = (Verdict.SURVIVED, Verdict.COLLAPSED)


def count_verdicts(verdict: ArrayLike) -> Named:
    """Count the runs of each verdict at each level of `verdict`, (..., n_level), by name.

    ``n`` counts the runs that collapsed or survived, ``runs`` all that were made. ``fraction`` is
    the part of ``n`` that collapsed, nan if ``n`` is 0.
    """
    codes = np.asarray(verdict).reshape(-1, np.shape(verdict)[-1])
    count: Named = {each.name.lower(): (codes == each).sum(axis=0) for each in Verdict}
    runs = len(codes) - count.pop("not_run")
    n = count["survived"] + count["collapsed"]
    fraction = count["collapsed"] / np.where(n > 0, n, np.nan)
    return count | {"n": n, "runs": runs, "fraction": fraction}


def checked_stripes(im: ArrayLike, collapses: ArrayLike, n: ArrayLike) -> Triple:
    """Return levels, collapses and runs as arrays, (n_level,); InputError if they are wrong."""
    levels, k, m = (np.asarray(values, float) for values in (im, collapses, n))
    shape = levels.shape
    if levels.ndim != 1 or levels.size == 0:
        raise InputError(f"im has shape {shape}; a list of one intensity per level")
    m = np.full(shape, m) if m.ndim == 0 else m
    for name, values in (("collapses", k), ("n", m)):
        if values.shape != shape:
            raise InputError(f"{name} has shape {values.shape}; {shape} is needed")
        whole = np.isfinite(values) & (values == np.floor(values))
        for bad in values[~(whole & (values >= 0.0))][:1]:
            raise InputError(
                f"{name} holds {bad:g}; counts are integers from 0 upwards"
            )
    for i in np.flatnonzero(k > m)[:1]:
        raise InputError(
            f"collapses is {k[i]:g} at im = {levels[i]:g}, more than the n = {m[i]:g} runs"
        )
    return positive(levels, "im"), k, m


def clopper_pearson(k: IntArray, n: IntArray, confidence: float) -> Pair:
    """Return the exact interval of each fraction k / n, (n_level,); nan if n is 0.

    Clopper and Pearson 1934, Biometrika 26.
    """
    low, high = tails(confidence)
    m = np.where(n > 0, n, np.nan)
    lower = np.where(k > 0, betaincinv(k, m - k + 1, low), 0.0 * m)
    upper = np.where(k < m, betaincinv(k + 1, m - k, high), 1.0 + 0.0 * m)
    return lower, upper


def wilson(k: FloatArray, n, confidence: float) -> Pair:
    """Return Wilson's score interval (1927) of k among n, which need not be integers."""
    z = ndtri(tails(confidence)[1])
    n = np.where(n > 0, n, np.nan)
    centre = (k + 0.5 * z * z) / (n + z * z)
    reach = z / (n + z * z) * np.sqrt(np.maximum(k * (n - k) / n, 0.0) + 0.25 * z * z)
    # At k = 0 and k = n the ends are 0 and 1 but for rounding.
    lower = np.where(k > 0.0, np.maximum(centre - reach, 0.0), 0.0 * n)
    upper = np.where(k < n, np.minimum(centre + reach, 1.0), 1.0 + 0.0 * n)
    return lower, upper


def numbered(labels: ArrayLike) -> IntArray:
    """Return a number for each label, (n,), from 0 in the sorted order of the labels."""
    return np.asarray(np.unique(np.asarray(labels), return_inverse=True)[1])


def draws_of_records(
    event: ArrayLike | None, n_record: int, seed: int = 1, resamples: int = RESAMPLES
) -> IntArray:
    """Draw how often each record is in each resample, (resamples, n_record).

    The bootstrap draws whole events, (n_record,) labels; if `event` is None, single records.
    """
    group = numbered(np.arange(n_record) if event is None else event)
    n = group.max() + 1
    generator = np.random.default_rng(seed)
    return generator.multinomial(n, np.full(n, 1.0 / n), resamples)[:, group]


def independent_number(values: ArrayLike, groups: ArrayLike) -> float:
    """Return the effective number of values, (n,) or (n, k), some of which share a group.

    n / (1 + (m - 1) rho) with m = sum n_i^2 / n (Kish 1965, Survey Sampling) and rho the
    correlation within groups, by analysis of variance. A small number of groups hardly shows rho,
    so half its standard error is added: without it 90 % bands held the truth in 84 to 88 % at 4
    to 8 events of 3 records and rho = 0.5. FitError if there is one group only.
    """
    labels = np.asarray(groups)
    place = numbered(labels)
    size = np.bincount(place)
    n = place.size
    n_event = size.size
    if n_event < 2:
        raise FitError(
            f"all records belong to one group, {labels[0]!s}; two are needed"
        )
    if n == n_event:
        return float(n)
    value = np.reshape(values, (n, -1))
    mean_size = (size**2).sum() / n
    means = np.stack([np.bincount(place, column) / size for column in value.T], axis=1)
    within = ((value - means[place]) ** 2).sum() / (n - n_event)
    apart = (means - value.mean(axis=0)) ** 2
    between = (size[:, None] * apart).sum() / (n_event - 1)
    usual = (n - mean_size) / (n_event - 1)
    total = between + (usual - 1.0) * within
    rho = (between - within) / total if total > 0.0 else 0.0
    error = (1.0 - rho) * (1.0 + (usual - 1.0) * rho)
    error *= np.sqrt(2.0 / (usual * (usual - 1.0) * n_event))
    rho = np.clip(rho + 0.5 * error, 0.0, 1.0)
    return float(n / (1.0 + (mean_size - 1.0) * rho))


@dataclass(frozen=True, eq=False)
class Brackets:
    """Two levels between which the capacity of each record lies, and the runs that show it."""

    lower: (
        FloatArray  #: (n_record,), highest level below the capacity; 0 if there is none
    )
    upper: FloatArray  #: (n_record,), lowest level above the capacity; inf if there is none
    contradictions: IntArray  #: (n_record,), verdicts on the wrong side of the border
    levels: FloatArray  #: (n_record, n_level), rising in each row
    verdict: (
        IntArray  #: (n_record, n_level), codes of `Verdict` in the order of `levels`
    )

    @property
    def decided(self) -> BoolArray:
        """Whether each run collapsed or survived, (n_record, n_level)."""
        return np.isin(self.verdict, DECIDED)

    @property
    def logs(self) -> FloatArray:
        """ln of `lower` and `upper`, (2, n_record)."""
        return log_intensity([self.lower, self.upper])

    @property
    def bracketed(self) -> BoolArray:
        """Whether both ends of a bracket are known, (n_record,)."""
        return (self.lower > 0.0) & np.isfinite(self.upper)

    @property
    def single(self) -> bool:
        """Whether no record has more than one decided run, so that no capacity is bracketed."""
        return bool((self.decided.sum(axis=1) < 2).all())

    @property
    def gaps(self) -> bool:
        """Whether some records were not run at a level at which others were."""
        made = self.verdict != Verdict.NOT_RUN
        if (self.levels != self.levels[:1]).any() and not self.single:
            return True
        return not made[made.any(axis=1)][:, made.any(axis=0)].all()

    @property
    def middle(self) -> FloatArray:
        """Geometric mean of both ends, (n_record,); nan where one is not known."""
        low, high = np.where(self.bracketed, (self.lower, self.upper), np.nan)
        return np.sqrt(low * high)

    @property
    def filled(self) -> IntArray:
        """Verdicts, completed by what the brackets imply, (n_record, n_level)."""
        codes = self.verdict.copy()
        codes[~self.decided & (self.levels < self.lower[:, None])] = Verdict.SURVIVED
        codes[~self.decided & (self.levels > self.upper[:, None])] = Verdict.COLLAPSED
        return codes

    @property
    def packed(self) -> "Brackets":
        """The brackets with the runs that were made alone, as many columns as a record has most.

        Cells that are left over are not run, at the end of their bracket that is known.
        """
        made = self.verdict != Verdict.NOT_RUN
        width = made.sum(axis=1).max(initial=1)
        order = np.argsort(~made, axis=1, kind="stable")[:, :width]
        made, levels, verdict = (
            np.take_along_axis(each, order, 1)
            for each in (made, self.levels, self.verdict)
        )
        end = np.where(self.lower > 0.0, self.lower, self.upper)[:, None]
        return replace(self, levels=np.where(made, levels, end), verdict=verdict)

    def at_levels(self, filled: bool = False) -> Triple:
        """Return the levels, and which runs collapsed and which are decided.

        If `filled`, runs that the brackets imply count too; without them the collapses of a search
        would be a biased choice. Levels, (n_level,), rise; if there are more than 500, neighbours
        are merged. The other two, (n_record, n_level), are 1 where a run collapsed, and 1 where it
        is decided. FitError if no run is decided.
        """
        codes = self.filled if filled else self.verdict
        row, column = np.nonzero(np.isin(codes, DECIDED))
        if not row.size:
            raise FitError(NOTHING)
        levels, place = np.unique(self.levels[row, column], return_inverse=True)
        if levels.size > MOST_LEVELS:
            near = np.arange(levels.size) * MOST_LEVELS // levels.size
            levels = np.exp(np.bincount(near, np.log(levels)) / np.bincount(near))
            place = near[place]
        collapses, n = np.zeros((2, len(codes), levels.size))
        n[row, place] = 1.0
        collapses[row, place] = codes[row, column] == Verdict.COLLAPSED
        return levels, collapses, n

    def single_runs(self) -> tuple[FloatArray, BoolArray]:
        """Return the levels of all decided runs, and whether they collapsed, (n_run,) each."""
        decided = self.decided
        return self.levels[decided], self.verdict[decided] == Verdict.COLLAPSED

    def without_scatter(self) -> "Brackets":
        """Return the brackets as if no verdict contradicted them."""
        return replace(self, contradictions=0 * self.contradictions)

    @property
    def run(self) -> BoolArray:
        """Whether a record has a decided run, (n_record,); else its bracket is (0, inf)."""
        return np.asarray(self.decided.any(axis=1))

    def of_records(self, kept: BoolArray | bool = True) -> "Brackets":
        """Return the brackets of records with a decided run only, of those that are `kept`.

        FitError if none is left.
        """
        kept = kept & self.run
        if not kept.any():
            raise FitError(NOTHING)
        return Brackets(*(each[kept] for each in vars(self).values()))


def find_brackets(verdict: ArrayLike, levels: ArrayLike) -> Brackets:
    """Find the border between survival and collapse of each record.

    It is the border that the fewest verdicts contradict; of several such borders, the lowest.
    `verdict`, (n_record, n_level), holds codes of `Verdict`; `levels`, (n_level,) or (n_record,
    n_level), are > 0 and in any order.
    """
    codes = np.asarray(verdict)
    level = np.broadcast_to(positive(levels, "levels"), codes.shape)
    order = np.argsort(level, axis=1, kind="stable")
    codes, level = (np.take_along_axis(each, order, 1) for each in (codes, level))
    collapsed = codes == Verdict.COLLAPSED
    survived = codes == Verdict.SURVIVED
    change = np.cumsum(collapsed.astype(int) - survived, axis=1)
    # Verdicts against each border, but for a constant.
    wrong = np.pad(change, ((0, 0), (1, 0)))
    below = np.arange(codes.shape[1]) < wrong.argmin(axis=1)[:, None]
    decided = collapsed | survived
    lower = np.where(decided & below, level, 0.0).max(axis=1)
    upper = np.where(decided & ~below, level, np.inf).min(axis=1)
    against = np.where(below, collapsed, survived).sum(axis=1)
    return Brackets(lower, upper, against, level, codes.astype(np.int64))
