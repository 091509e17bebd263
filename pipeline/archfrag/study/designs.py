"""A design asks for the runs of an arch, and estimates the curve from their verdicts.

It asks by a generator for each arch. The generator yields new requests, is sent the verdicts of
some runs that it requested, in whatever order they come, and returns facts for the report. What it
asks for follows from the verdicts alone: the same study asks for the same runs whatever the
workers, and a study that was stopped goes on by asking again.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, TypeAdapter

from archfrag.files import Named
from archfrag.fragility.curve import Curve, FloatArray, IntArray
from archfrag.fragility.fit import fit_brackets, fit_stripes
from archfrag.fragility.verdicts import Brackets, Verdict
from archfrag.study.keys import Section, check_block

# A run: `place` is the number of the study's level, 0 where a run has a level of its own.
CASE = np.dtype([("arch", "i4"), ("record", "i4"), ("place", "i4"), ("level", "f8")])
Cases = NDArray[np.void]
Verdicts = NDArray[np.int8]
_T = TypeVar("_T")
Asking = Generator[Cases, tuple[Cases, Verdicts], _T]
Requests = Asking[Named]


@dataclass
class Grid:
    """Records and levels of one arch's part of a study, and verdicts of the runs made."""

    arch: int
    records: IntArray  # (n_record,): their numbers, in the order in which a design takes them
    levels: FloatArray  # (n_level,): [SI]
    unscaled: FloatArray  # (n_record,): factors that bring the study's measure to 1
    power: float  # a level grows with the factor to the power 1 / `power`
    seed: int = 0  # of the arch, for what a design draws

    def __post_init__(self) -> None:
        self.seen = np.full(
            (self.records.size, self.levels.size), int(Verdict.NOT_RUN), np.int8
        )

    def run(
        self, rows: IntArray, places: IntArray, level: FloatArray | None = None
    ) -> Asking[Verdicts]:
        """Request runs of some rows, wait for all of them and return their verdicts."""
        cases = self.cases(rows, places, level)
        waiting = cases.size
        while waiting:
            _, _, verdicts = yield from self.some(cases)
            cases = cases[:0]
            waiting -= verdicts.size
        return self.seen[rows, places]

    def some(self, cases: Cases) -> Asking[tuple[IntArray, IntArray, Verdicts]]:
        """Request runs, and return rows, places and verdicts of the first that are made."""
        made, verdicts = yield cases
        order = np.argsort(self.records)
        row = order[np.searchsorted(self.records, made["record"], sorter=order)]
        place = made["place"]
        self.seen[row, place] = verdicts
        return row, place, verdicts

    def cases(
        self, rows: IntArray, places: IntArray, level: FloatArray | None = None
    ) -> Cases:
        """Return runs of some rows at the study's levels, or each at its own, (n,) of `CASE`."""
        cases = np.empty(rows.size, CASE)
        cases["arch"] = self.arch
        cases["record"] = self.records[rows]
        cases["place"] = places
        cases["level"] = self.levels[cases["place"]] if level is None else level
        return cases


class Design(Section, ABC):
    """Which runs are made, and how the curve follows from them."""

    kind: str
    on_levels: ClassVar[bool] = True  # whether runs are made at the study's levels
    adaptive: ClassVar[bool] = (
        False  # whether runs requested depend on verdicts of others
    )
    text: ClassVar[str] = ""  # for the report

    @abstractmethod
    def requests(self, grid: Grid) -> Requests:
        """Ask for the runs of one arch."""

    @abstractmethod
    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch, and whether it is exact, about or at most."""

    def likelihood(self, found: Brackets) -> Curve:
        """Return the curve by maximum likelihood, from the collapses at each level.

        Where runs were not made, it is from brackets of the capacities: those made at a level are
        no sample of the records.
        """
        if self.adaptive or found.gaps:
            known = found.of_records()
            return fit_brackets(known.lower, known.upper)
        levels, collapsed = found.single_runs()
        level, place = np.unique(levels, return_inverse=True)
        collapses = np.bincount(place, collapsed, level.size)
        return fit_stripes(level, collapses, np.bincount(place, minlength=level.size))

    def cautions(self, facts: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Return the messages on checks that contradict the borders found."""
        return [
            f"{name}: {own['contradictions']} of {own['checked']} checks near the border "
            "contradict the capacity of their record. Such a record has several borders between "
            "survival and collapse; the search found one of them, not always the lowest. Beta "
            "includes the scatter of single runs"
            for name, own in facts.items()
            if own.get("contradictions")
        ]


class Stripes(Design):
    """Every record at every level."""

    kind: Literal["stripes"] = "stripes"
    text = "every record at every level"

    def requests(self, grid: Grid) -> Requests:
        """Ask for all runs at once."""
        verdicts = yield from grid.run(
            *np.divmod(np.arange(grid.seen.size), grid.levels.size)
        )
        return {"runs": len(verdicts)}

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch, and whether it is exact, about or at most."""
        return n_record * n_level, "exactly"


class Cloud(Design):
    """Every record once, as it is or by one factor."""

    kind: Literal["cloud"]
    factor: float = Field(default=1.0, gt=0.0, le=1000.0)
    """On every record."""
    on_levels = False
    text = "every record once"

    def requests(self, grid: Grid) -> Requests:
        """Ask for all runs at once."""
        level = (self.factor / grid.unscaled) ** (1.0 / grid.power)
        every = np.arange(level.size)
        verdicts = yield from grid.run(every, np.zeros_like(every), level)
        return {"runs": len(verdicts), "records": len(verdicts)}

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch, and whether it is exact, about or at most."""
        return n_record, "exactly"


def ask(
    requests: Mapping[int, Requests], decide: Callable[[Cases], Verdicts]
) -> tuple[Cases, dict[int, Named]]:
    """Drive requests with a `decide` that returns the verdicts of all its runs, in order."""
    return drive(requests, lambda cases: (cases, decide(cases)))


def drive(
    requests: Mapping[int, Requests], answer: Callable[[Cases], tuple[Cases, Verdicts]]
) -> tuple[Cases, dict[int, Named]]:
    """Ask the designs of all arches, by `Design.requests`, until none requests a run.

    `answer` takes new requests, which may be none, and returns some runs of all those requested
    so far with their verdicts. Returned are all runs requested, and what each design returned, by
    arch.
    """
    requested = []
    facts = {}
    answers = dict[int, Any].fromkeys(requests)  # None starts a generator
    while True:
        new = [np.empty(0, CASE)]
        for arch, verdicts in answers.items():
            try:
                new.append(requests[arch].send(verdicts))  # type: ignore[arg-type]  # None starts it
            except StopIteration as over:
                facts[arch] = over.value
        requested.append(np.concatenate(new))
        if len(facts) == len(requests):
            return np.concatenate(requested), facts
        cases, verdicts = answer(requested[-1])
        order = np.argsort(cases["arch"], kind="stable")
        cases = cases[order]
        verdicts = verdicts[order]
        arches, first = np.unique(cases["arch"], return_index=True)
        pairs = zip(np.split(cases, first[1:]), np.split(verdicts, first[1:]))
        answers = dict(zip(arches.tolist(), pairs))


def order_of(cases: Cases) -> IntArray:
    """Return the order of runs by arch, record and place."""
    return np.lexsort([cases[name] for name in ("place", "record", "arch")])


FIRST_RECORDS = 10  # searched without knowing what others have shown
# A run that survives goes on to the end of the record and costs five times one that collapses.
# With that ratio levels would be tried from above, and of a record that survives again above a
# level at which it collapsed the upper border be found.
COST_OF_SURVIVAL = 2.0
NEAR = 2  # levels beyond a border that are checked: farther ones are hardly ever contradicted
LEAST_PRIOR = 1e-3  # at each level, whatever other records have shown
LEAST_DEVIATION = 0.1  # of ln capacity from what is expected


class Ida(Design):
    """The levels bisected for each record: a border between survival and collapse."""

    kind: Literal["ida"]
    seed: int = Field(default=1, ge=0, le=10**9)
    """Seed of the random choices of the design."""
    checks: int | None = Field(default=None, ge=0, le=10**6)
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
        Which are first and which cells are tried follows from the names of arch and records.
        If a record has one border, the search finds it whatever it expects. What else is known of
        a record, such as other measures, must not choose its levels: half of the runs would
        collapse at every level, which the likelihood of the verdicts takes for a larger beta.
        """
        n_record, n_level = grid.seen.shape
        # The highest level known to be below the border of each record, and the lowest above it.
        low = np.full(n_record, -1)
        high = np.full(n_record, n_level)
        # Probability that level l is the first above the border, n_level if none does.
        expected = np.full((n_record, n_level + 1), 1.0 / (n_level + 1))
        first = min(FIRST_RECORDS, n_record)
        every = np.arange(n_record)
        yield from search(grid, low, high, expected, every[:first])
        if n_record > first:
            expected[first:] = expected_borders(grid.levels, low[:first], high[:first])
            yield from search(grid, low, high, expected, every[first:])
        # Some cells near the borders, any as likely as another: how often do they contradict?
        place = np.arange(n_level)
        unseen = grid.seen == Verdict.NOT_RUN
        near = (place >= low[:, None] - NEAR) & (place <= high[:, None] + NEAR)
        free, places = np.nonzero(near & unseen)
        count = n_record if self.checks is None else self.checks
        generator = np.random.default_rng([self.seed, grid.seed])
        chosen = np.sort(generator.permutation(free.size)[:count])
        row = free[chosen]
        place = places[chosen]
        verdicts = yield from grid.run(row, place)
        collapsed = verdicts == Verdict.COLLAPSED
        survived = verdicts == Verdict.SURVIVED
        against = int(np.where(place <= low[row], collapsed, survived).sum())
        return {
            "runs": int((grid.seen != Verdict.NOT_RUN).sum()),
            "records": n_record,
            "checked": int((collapsed | survived).sum()),
            "contradictions": against,
        }

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the runs of an arch: a search tells apart levels + 1 places of the border."""
        search_runs = int(np.ceil(n_record * np.log2(n_level + 1)))
        checks = n_record if self.checks is None else self.checks
        return min(search_runs + checks, n_record * n_level), "about"


def search(
    grid: Grid, low: IntArray, high: IntArray, expected: FloatArray, left: IntArray
) -> Asking[None]:
    """Narrow the brackets of the rows `left`, from `low` to `high`, to neighbouring levels.

    The level to try next is the most informative one for its cost: the entropy of its verdict over
    the cost expected. Levels where a run had no verdict are not tried again. A row goes on when
    its own run is made: it waits for no other.
    """
    border = np.arange(grid.levels.size + 1)
    place = border[:-1]
    waiting = 0
    while True:
        below = low[left, None]
        above = high[left, None]
        mass = np.cumsum(
            np.where((border > below) & (border <= above), expected[left], 0.0), axis=1
        )
        collapse = mass[:, :-1] / mass[:, -1:]
        cost = collapse + COST_OF_SURVIVAL * (1.0 - collapse)
        entropy = scipy.special.entr(collapse) + scipy.special.entr(1.0 - collapse)
        free = (place > below) & (place < above) & (grid.seen[left] == Verdict.NOT_RUN)
        best = np.where(free, entropy / cost, -1.0).argmax(axis=1)
        some = free.any(axis=1)
        waiting += int(some.sum())
        if not waiting:
            return
        left, places, verdicts = yield from grid.some(
            grid.cases(left[some], best[some])
        )
        waiting -= left.size
        collapsed = verdicts == Verdict.COLLAPSED
        survived = verdicts == Verdict.SURVIVED
        high[left[collapsed]] = places[collapsed]
        low[left[survived]] = places[survived]
        left = left[verdicts != Verdict.COLLAPSED_BEFORE]  # as it would at any level


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


# By the key `design` of a study file; the name of a design may stand for its block.
AnyDesign = Annotated[
    Stripes | Ida | Cloud,
    Field(discriminator="kind"),
    BeforeValidator(partial(check_block, key="kind")),
    BeforeValidator(lambda given: {"kind": given} if isinstance(given, str) else given),
]


def design_of(facts: Mapping[str, Any]) -> Design:
    """Return the design of a cube, whose facts may hold those of its arches too."""
    keys = {key: value for key, value in facts.items() if key != "arches"}
    found: Design = TypeAdapter[Any](AnyDesign).validate_python(keys)
    return found
