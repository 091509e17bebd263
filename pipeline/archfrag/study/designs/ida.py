"""The design `ida`, which searches each record's border between survival and collapse."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike
from pydantic import Field

from archfrag.fragility.counts import Brackets, Verdict
from archfrag.fragility.curve import FloatArray, Fragility, IntArray
from archfrag.fragility.fit import fit_brackets
from archfrag.study.designs.design import Asking, Design, Grid, Requests

FIRST_RECORDS = 10  # searched without knowing what others have shown
# A run that survives goes on to the end of the record and costs five times one that collapses.
# With that ratio levels would be tried from above, and of a record that survives again above a
# level at which it collapsed the upper border be found.
COST_OF_SURVIVAL = 2.0
NEAR = 2  # levels beyond a border that are checked: farther ones are hardly ever contradicted
LEAST_PRIOR = 1e-3  # at each level, whatever other records have shown
LEAST_DEVIATION = 0.1  # of ln capacity from what is expected
MOST_NAMED = 12  # arches with checks that contradict; of more only their number


class Ida(Design):
    """The levels bisected for each record: a border between survival and collapse."""

    kind: Literal["ida"]
    seed: Annotated[int, Field(ge=0, le=10**9)] = 1
    """Seed of the random choices of the design."""
    checks: Annotated[int, Field(ge=0, le=10**6)] | None = None
    """Cells near the borders chosen at random for each arch, to see how often a run contradicts
    the capacity of its record; as many as records searched where not given."""
    adaptive = True
    text = "the levels bisected for each record"

    def requests(self, grid: Grid) -> Requests:
        """Search a border of each record, then try cells near it.

        A record that survives again above a level at which it collapsed has several borders. The
        search finds one of them, not the lowest: which one depends on the levels that it tries.
        The cells near the borders show how far single runs scatter, and the curve includes this.

        The first records are searched knowing nothing, the others expecting what the first show.
        If a record has one border, the search finds it whatever it expects. What else is known of
        a record, such as other measures, must not choose its levels: half of the runs would
        collapse at every level, which the likelihood of the verdicts takes for a larger beta.
        """
        n_record, n_level = grid.seen.shape
        # The highest level known to be below the border of each record, and the lowest above it.
        low, high = np.full(n_record, -1), np.full(n_record, n_level)
        # Probability that level l is the first above the border, n_level if none does.
        expected = np.full((n_record, n_level + 1), 1.0 / (n_level + 1))
        first = min(FIRST_RECORDS, n_record)
        yield from search(grid, low, high, expected, range(first))
        if n_record > first:
            expected[first:] = expected_borders(grid.levels, low[:first], high[:first])
            yield from search(grid, low, high, expected, range(first, n_record))
        # Some cells near the borders, any as likely as another: how often do they contradict?
        place, unseen = np.arange(n_level), grid.seen == Verdict.NOT_SIMULATED
        near = (place >= low[:, None] - NEAR) & (place <= high[:, None] + NEAR)
        free, places = np.nonzero(near & unseen)
        count = n_record if self.checks is None else self.checks
        generator = np.random.default_rng([self.seed, grid.arch])
        chosen = np.sort(generator.permutation(free.size)[:count])
        row, place = free[chosen], places[chosen]
        verdicts = yield from grid.run(row, place)
        collapsed, survived = verdicts == Verdict.COLLAPSED, verdicts == Verdict.STANDING
        against = int(np.where(place <= low[row], collapsed, survived).sum())
        checked = int((collapsed | survived).sum())
        runs = int((grid.seen != Verdict.NOT_SIMULATED).sum())
        return {
            "runs": runs, "records": n_record, "checked": checked, "contradictions": against
        }  # fmt: skip

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch: a search distinguishes levels + 1 places of the
        border.
        """
        search_runs = int(np.ceil(n_record * np.log2(n_level + 1)))
        checks = n_record if self.checks is None else self.checks
        return min(search_runs + checks, n_record * n_level), "about"

    def likelihood(self, found: Brackets) -> Fragility:
        """Return the curve by maximum likelihood, from the brackets of the records' capacities."""
        known = found.known()
        return fit_brackets(known.lower, known.upper)

    def cautions(self, facts: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Return the messages on checks that contradict the borders found."""
        against = {name: (own["contradictions"], own["checked"])
                   for name, own in facts.items() if own.get("contradictions")}  # fmt: skip
        if len(against) > MOST_NAMED:
            count, checked = np.sum(list(against.values()), axis=0).tolist()
            against = {f"{len(against)} arches": (count, checked)}
        return [
            f"{name}: {count} of {checked} checks near the border contradict the capacity of "
            "their record. Such a record has several borders between survival and collapse; the "
            "search found one of them, not always the lowest. Beta includes the scatter of single "
            "runs"
            for name, (count, checked) in against.items()
        ]


def search(
    grid: Grid, low: IntArray, high: IntArray, expected: FloatArray, rows: ArrayLike
) -> Asking[None]:
    """Narrow the brackets of some rows, from `low` to `high`, until neighbouring levels are left.

    The level to try next is the most informative one for its cost: the entropy of its verdict over
    the cost expected. Levels where a run had no verdict are not tried again. A row goes on when
    its own run is made: it waits for no other.
    """
    left, place, waiting = np.asarray(rows, dtype=np.int64), np.arange(grid.levels.size), 0
    while True:
        below, above = low[left, None], high[left, None]
        within = (np.arange(place.size + 1) > below) & (np.arange(place.size + 1) <= above)
        mass = np.cumsum(np.where(within, expected[left], 0.0), axis=1)
        collapse = mass[:, :-1] / mass[:, -1:]
        cost = collapse + COST_OF_SURVIVAL * (1.0 - collapse)
        gain = (scipy.special.entr(collapse) + scipy.special.entr(1.0 - collapse)) / cost
        free = (place > below) & (place < above) & (grid.seen[left] == Verdict.NOT_SIMULATED)
        best, some = np.where(free, gain, -1.0).argmax(axis=1), free.any(axis=1)
        waiting += int(some.sum())
        if not waiting:
            return
        left, places, verdicts = yield from grid.some(grid.cases(left[some], best[some]))
        waiting -= left.size
        collapsed, survived = verdicts == Verdict.COLLAPSED, verdicts == Verdict.STANDING
        high[left[collapsed]] = places[collapsed]
        low[left[survived]] = places[survived]


def expected_borders(levels: FloatArray, low: IntArray, high: IntArray) -> FloatArray:
    """Return the probability of each border, (n_level + 1,), of normal ln capacities.

    Their mean and deviation are those of the capacities between the borders that were found,
    (n_record,); a border beyond the ends is half a level away.
    """
    logs = np.log(levels)
    step = np.diff(logs).mean() if logs.size > 1 else 0.5
    ends = np.concatenate([[logs[0] - step], logs, [logs[-1] + step]])
    found = 0.5 * (ends[low + 1] + ends[high + 1])
    ends[[0, -1]] = -np.inf, np.inf
    reach = max(found.std(ddof=1), LEAST_DEVIATION)
    mass = np.diff(scipy.special.ndtr((ends - found.mean()) / reach)) + LEAST_PRIOR
    return mass / mass.sum()
