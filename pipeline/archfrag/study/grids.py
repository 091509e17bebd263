"""Designs on the study's own levels: stripes, and a search of each record's border."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import entr, ndtr

from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import FloatArray
from archfrag.study.design import Ida, TwoStage
from archfrag.study.rounds import (
    COARSE,
    FINE,
    LEAST_RECORDS,
    Cases,
    Stop,
    Strand,
    Verdicts,
    cases_of,
    known_so_far,
    more_needed,
)

FIRST_RECORDS = 10  # searched without knowing what others have shown
# A run that stands goes on to the end of the record and costs five times one that collapses. With
# that ratio levels would be tried from above, and of a record that stands again above a level at
# which it collapsed the upper border be found.
COST_OF_STANDING = 2.0
NEAR = 2  # levels beyond a border that are checked: farther ones are hardly ever contradicted
LEAST_PRIOR = 1e-3  # at each level, whatever other records have shown
LEAST_DEVIATION = 0.1  # of ln capacity from what is expected


@dataclass(frozen=True)
class Grid:
    """Records and levels of one arch's part of a study."""

    arch: int
    records: NDArray[np.int64]  # (n_record,): their numbers
    levels: FloatArray  # (n_level,): [SI]
    # (n_record, n_measure): logarithms of other intensity measures of the records where the
    # study's own is 1.
    measures: FloatArray
    # (n_record,): labels of the records' earthquakes, where several have one in common.
    groups: NDArray[np.str_] | None = None

    def cases(self, rows: ArrayLike, places: ArrayLike, stage: int = FINE) -> Cases:
        """Runs of some rows at some levels."""
        place = np.asarray(places, dtype=np.int64)
        return cases_of(
            self.arch, self.records[np.asarray(rows)], place, self.levels[place], stage
        )


def stripes(grid: Grid) -> Strand:
    """Every record at every level, in one round."""
    n_record, n_level = grid.records.size, grid.levels.size
    rows, places = np.divmod(np.arange(n_record * n_level), n_level)
    verdicts = yield grid.cases(rows, places)
    return {"runs": len(verdicts)}


class Borders:
    """Where each record goes from standing to collapse, as far as it is known."""

    def __init__(self, grid: Grid) -> None:
        n_record, n_level = grid.records.size, grid.levels.size
        self.grid = grid
        # The highest level known to be below the border and the lowest above it.
        self.low = np.full(n_record, -1)
        self.high = np.full(n_record, n_level)
        self.seen = np.full((n_record, n_level), int(Verdict.NOT_SIMULATED), np.int8)  # verdicts
        # Probability that level l is the first above the border, n_level if none does.
        self.expected = np.full((n_record, n_level + 1), 1.0 / (n_level + 1))

    @property
    def runs(self) -> int:
        """Number of runs made."""
        return int(np.count_nonzero(self.seen != Verdict.NOT_SIMULATED))

    def expect(self, rows: ArrayLike, median: FloatArray, deviation: float) -> None:
        """Expect ln capacities of some rows to be normal about `median`."""
        ends = np.concatenate([[-np.inf], np.log(self.grid.levels), [np.inf]])
        reach = max(deviation, LEAST_DEVIATION)
        mass = np.diff(ndtr((ends - median[:, None]) / reach), axis=1) + LEAST_PRIOR
        self.expected[np.asarray(rows)] = mass / mass.sum(axis=1, keepdims=True)

    def next_places(self, rows: ArrayLike) -> NDArray[np.int64]:
        """Level to try next for each of some rows, -1 where nothing is left to try.

        The most informative one for its cost: the entropy of its verdict over the cost expected.
        Levels where a run had no verdict are not tried again.
        """
        row = np.asarray(rows)
        place = np.arange(self.grid.levels.size)
        low, high = self.low[row, None], self.high[row, None]
        within = (np.arange(place.size + 1) > low) & (np.arange(place.size + 1) <= high)
        mass = np.where(within, self.expected[row], 0.0)
        below = np.cumsum(mass, axis=1)
        collapse = below[:, :-1] / below[:, -1:]
        cost = collapse + COST_OF_STANDING * (1.0 - collapse)
        gain = (entr(collapse) + entr(1.0 - collapse)) / cost
        free = (place > low) & (place < high) & (self.seen[row] == Verdict.NOT_SIMULATED)
        best = np.where(free, gain, -1.0).argmax(axis=1)
        return np.where(free.any(axis=1), best, -1)

    def take(self, rows: NDArray, places: NDArray, verdicts: Verdicts) -> None:
        """Note verdicts."""
        self.seen[rows, places] = verdicts
        fell, stood = verdicts == Verdict.COLLAPSED, verdicts == Verdict.STANDING
        np.minimum.at(self.high, rows[fell], places[fell])
        np.maximum.at(self.low, rows[stood], places[stood])

    def middles(self) -> FloatArray:
        """ln of the middle of each bracket, half a level beyond the ends, (n_record,)."""
        logs = np.log(self.grid.levels)
        step = np.diff(logs).mean() if logs.size > 1 else 0.5
        ends = np.concatenate([[logs[0] - step], logs, [logs[-1] + step]])
        return 0.5 * (ends[self.low + 1] + ends[self.high + 1])


def search(borders: Borders, rows: ArrayLike, stage: int) -> Generator[Cases, Verdicts, None]:
    """Narrow the brackets of some rows until neighbouring levels are left."""
    left = np.asarray(rows, dtype=np.int64)
    while left.size:
        places = borders.next_places(left)
        left, places = left[places >= 0], places[places >= 0]
        if left.size:
            verdicts = yield borders.grid.cases(left, places, stage)
            borders.take(left, places, verdicts)


def expected_by_measures(borders: Borders, known: range, rows: range) -> tuple[FloatArray, float]:
    """ln capacities of some rows from those known, by the measure that predicts these best.

    Straight lines in the logarithm of one other measure at the study's own; the one with the
    least error where each record is predicted from the others.
    """
    capacity = borders.middles()[known.start : known.stop]
    best = (capacity.mean() + np.zeros(len(rows)), float(capacity.std(ddof=1)))
    least = best[1]
    for values in borders.grid.measures.T:
        x = values[known.start : known.stop]
        centred = x - x.mean()
        if not centred @ centred > 1e-9:
            continue
        slope = centred @ capacity / (centred @ centred)
        leverage = 1.0 / x.size + centred**2 / (centred @ centred)
        left = (capacity - capacity.mean() - slope * centred) / np.maximum(1.0 - leverage, 0.05)
        error = float(np.sqrt(left @ left / (x.size - 1)))
        if error < least:
            at = values[rows.start : rows.stop] - x.mean()
            best, least = (capacity.mean() + slope * at, error), error
    return best


def ida(grid: Grid, design: Ida) -> Strand:
    """Search a border between standing and collapse of each record, then try cells near it.

    A record that stands again above a level at which it collapsed has several borders. The search
    finds one of them, not the lowest: which one depends on the levels that it tries. The cells
    near the borders show how far single runs scatter, and the curve includes this scatter.

    The first records are searched knowing nothing, the others expecting what their measures and
    the first suggest; where a record has one border, what is found does not depend on what was
    expected. In two stages the
    search is made by the coarse method, and then by the study's own, expecting what the coarse
    one found and how far it was off on the first records.
    """
    fine, coarse = Borders(grid), Borders(grid)
    n_record, done = grid.records.size, 0
    used = min(FIRST_RECORDS, n_record)
    stop = None if design.precision is None else Stop(design.precision)
    while True:
        rows = range(done, used)
        if isinstance(design, TwoStage):
            if done > 2:
                coarse.expect(rows, *expected_by_measures(coarse, range(done), rows))
            yield from search(coarse, rows, COARSE)
            decided = _decided(design, rows)
            _expect_coarse(fine, coarse, _decided(design, range(done)), decided)
        else:
            decided = list(rows)
            if done > 2:
                fine.expect(rows, *expected_by_measures(fine, range(done), rows))
        yield from search(fine, decided, FINE)
        done = used
        used = n_record if stop is None else _more_records(stop, design, fine, done)
        if used == done:
            break
    found = yield from _check(fine, design, _decided(design, range(done)))
    note = {"runs": fine.runs, "records": done, **found} | ({} if stop is None else stop.note)
    return note | ({"coarse_runs": coarse.runs} if isinstance(design, TwoStage) else {})


def _decided(design: Ida, rows: range) -> list[int]:
    """Rows whose capacity the study's own method decides: an even fraction, with the first."""
    fraction = design.fine if isinstance(design, TwoStage) else 1.0
    return [row for row in rows if int(row * fraction) > int((row - 1) * fraction) or row == 0]


def _expect_coarse(fine: Borders, coarse: Borders, known: list[int], rows: list[int]) -> None:
    """Expect what the coarse search found, corrected by how far it was off on known rows."""
    if not rows:
        return
    guess = coarse.middles()
    bias, deviation = 0.0, 2.0 * LEAST_DEVIATION
    if len(known) > 2:
        off = (fine.middles() - guess)[known]
        bias, deviation = float(off.mean()), float(off.std(ddof=1))
    fine.expect(rows, guess[rows] + bias, deviation)


def _check(
    borders: Borders, design: Ida, among: Sequence[int]
) -> Generator[Cases, Verdicts, dict[str, int]]:
    """Some cells near the borders, any as likely as another: how often do they contradict?"""
    among_rows = np.asarray(among, dtype=np.int64)
    count = among_rows.size if design.checks is None else design.checks
    place = np.arange(borders.grid.levels.size)
    low, high = borders.low[among_rows, None], borders.high[among_rows, None]
    near = (place >= low - NEAR) & (place <= high + NEAR)
    free, places = np.nonzero(near & (borders.seen[among_rows] == Verdict.NOT_SIMULATED))
    generator = np.random.default_rng([design.seed, borders.grid.arch])
    chosen = np.sort(generator.permutation(free.size)[:count])
    rows, places = among_rows[free[chosen]], places[chosen]
    if not rows.size:
        return {"checked": 0, "contradictions": 0}
    verdicts = yield borders.grid.cases(rows, places)
    borders.seen[rows, places] = verdicts
    fell, stood = verdicts == Verdict.COLLAPSED, verdicts == Verdict.STANDING
    against = np.where(places <= borders.low[rows], fell, stood)
    return {"checked": int((fell | stood).sum()), "contradictions": int(against.sum())}


def _more_records(stop: Stop, design: Ida, borders: Borders, done: int) -> int:
    """Records to use next; as many as before if there are to be no more."""
    wanted, grid = stop.wanted, borders.grid
    groups = None if grid.groups is None else grid.groups[:done]
    seen = borders.seen[:done]
    width = known_so_far(design.kind, seen, grid.levels, wanted.confidence, groups).half_width
    if stop.look(width, done, LEAST_RECORDS):
        return done
    allowed = int((wanted.runs - borders.runs) * done / max(borders.runs, 1))
    available = grid.records.size - done
    more = min(more_needed(width, wanted.theta, done), allowed, available)
    if more > 0:
        return done + more
    stop.end(f"there are no more than {done} records" if available <= 0 else "")
    return done
