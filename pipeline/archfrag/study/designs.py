"""Designs choose the runs of an arch, and estimate the curve from their verdicts.

A design has a generator for each arch. The generator yields new requests, is sent the verdicts of
some runs that it requested, in whatever order they come, and returns facts for the report. Its
requests depend on the verdicts alone: the same study requests the same runs whatever the workers,
and a study that was stopped goes on by requesting again.
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
from archfrag.fragility.curve import BoolArray, Curve, FloatArray, IntArray
from archfrag.fragility.fit import fit_brackets, fit_stripes
from archfrag.fragility.verdicts import Brackets, Verdict
from archfrag.study.keys import Section, check_block

# A run: `place` is the index of its level in the study, or 0 if the run has a level of its own.
CASE = np.dtype([("arch", "i4"), ("record", "i4"), ("place", "i4"), ("level", "f8")])
Cases = NDArray[np.void]
Verdicts = NDArray[np.int8]
_T = TypeVar("_T")
Asking = Generator[Cases, tuple[Cases, Verdicts], _T]
Requests = Asking[Named]


@dataclass
class Grid:
    """The records and levels of one arch in a part of a study, and the verdicts so far.

    ``seen`` has the verdicts, (n_record, n_level).
    """

    arch: int
    records: IntArray  # (n_record,): their numbers, in the order in which a design takes them
    levels: FloatArray  # (n_level,): [SI]
    unscaled: FloatArray  # (n_record,): factors that bring the study's measure to 1
    power: float  # a level grows with the factor to the power 1 / `power`
    seed: int = 0  # of the arch, for what a design draws
    asked: BoolArray | None = (
        None  # (n_record, n_level), if records have levels of their own
    )

    def __post_init__(self) -> None:
        self.seen = np.full(
            (self.records.size, self.levels.size), int(Verdict.NOT_RUN), np.int8
        )

    def run(
        self, rows: IntArray, places: IntArray, level: FloatArray | None = None
    ) -> Asking[Verdicts]:
        """Request runs, wait for all of them and return their verdicts, (n,).

        `rows` and `places` are the indices of their records and levels, (n,); `level` is as of
        `cases`.
        """
        cases = self.cases(rows, places, level)
        waiting = cases.size
        while waiting:
            _, _, verdicts = yield from self.some(cases)
            cases = cases[:0]
            waiting -= verdicts.size
        return self.seen[rows, places]

    def some(self, cases: Cases) -> Asking[tuple[IntArray, IntArray, Verdicts]]:
        """Request runs; return rows, places and verdicts of those that are finished next.

        These may also be runs that were requested before. `cases` may be empty.
        """
        made, verdicts = yield cases
        order = np.argsort(self.records)
        row = order[np.searchsorted(self.records, made["record"], sorter=order)]
        place = made["place"]
        self.seen[row, place] = verdicts
        return row, place, verdicts

    def cases(
        self, rows: IntArray, places: IntArray, level: FloatArray | None = None
    ) -> Cases:
        """Return runs of the records `rows` at the levels `places`, (n,) of `CASE`.

        If `level` is given, (n,) [SI], it replaces the levels of the study.
        """
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
        """Return the generator that requests the runs of one arch."""

    @abstractmethod
    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch, and how exact it is: exactly, about or at most."""

    def likelihood(self, found: Brackets) -> Curve:
        """Return the curve by maximum likelihood.

        It is from the numbers of collapses at each level. If the design is adaptive, or runs are
        missing, it is from brackets of the capacities: runs made at a level are then no sample of
        the records.
        """
        if self.adaptive or found.gaps:
            known = found.of_records()
            return fit_brackets(known.lower, known.upper)
        levels, collapsed = found.single_runs()
        level, place = np.unique(levels, return_inverse=True)
        collapses = np.bincount(place, collapsed, level.size)
        return fit_stripes(level, collapses, np.bincount(place, minlength=level.size))

    def cautions(self, facts: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Return a message for each arch whose checks contradict the borders found.

        `facts` has by arch what the generators returned.
        """
        return [
            f"{name}: {own['contradictions']} of {own['checked']} checks near the border "
            "contradict the capacity of their record. Such a record has several borders between "
            "survival and collapse; the search found one of them, not always the lowest. Beta "
            "includes the scatter of single runs"
            for name, own in facts.items()
            if own.get("contradictions")
        ]


class Stripes(Design):
    """Every record at every level, or at those that an index gives it."""

    kind: Literal["stripes"] = "stripes"
    text = "every record at every level"

    def requests(self, grid: Grid) -> Requests:
        """Request all runs at once."""
        asked = grid.seen == Verdict.NOT_RUN if grid.asked is None else grid.asked
        rows, places = np.nonzero(asked)
        verdicts = yield from grid.run(rows, places)
        return {"runs": len(verdicts)}

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch, and how exact it is."""
        return n_record * n_level, "exactly"


class Cloud(Design):
    """Every record once, as it is or by one factor."""

    kind: Literal["cloud"]
    factor: float = Field(default=1.0, gt=0.0, le=1000.0)
    """On every record."""
    on_levels = False
    text = "every record once"

    def requests(self, grid: Grid) -> Requests:
        """Request all runs at once."""
        level = (self.factor / grid.unscaled) ** (1.0 / grid.power)
        every = np.arange(level.size)
        verdicts = yield from grid.run(every, np.zeros_like(every), level)
        return {"runs": len(verdicts), "records": len(verdicts)}

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch, and how exact it is."""
        return n_record, "exactly"


def ask(
    requests: Mapping[int, Requests], decide: Callable[[Cases], Verdicts]
) -> tuple[Cases, dict[int, Named]]:
    """Make all requested runs by `decide`, and return what `drive` returns.

    `decide` returns the verdicts of all runs that it is given, in their order.
    """
    return drive(requests, lambda cases: (cases, decide(cases)))


def drive(
    requests: Mapping[int, Requests], answer: Callable[[Cases], tuple[Cases, Verdicts]]
) -> tuple[Cases, dict[int, Named]]:
    """Answer the requests of all arches until none requests another run.

    `requests` has by arch a generator of `Design.requests`. `answer` takes new requests, which may
    be none, and returns some runs of all those requested so far with their verdicts. Returned are
    all runs requested, and by arch what its generator returned.
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
    """Return the indices that sort runs by arch, record and place."""
    return np.lexsort([cases[name] for name in ("place", "record", "arch")])


FIRST_RECORDS = 10  # records searched before there is anything to expect of the others
# A run that survives goes on to the end of the record, and costs five times one that collapses.
# But with a ratio of 5 levels would be tried from above, and a record with several borders would
# get its upper one.
COST_OF_SURVIVAL = 2.0
NEAR = 2  # levels beyond a border that are checked: farther ones are hardly ever contradicted
LEAST_PRIOR = 1e-3  # added to the probability of each border
LEAST_DEVIATION = 0.1  # least standard deviation of ln capacity


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
        """Search a border of each record, then check cells near it.

        A record that survives again above a level at which it collapsed has several borders. The
        search finds one of them, not always the lowest: which one depends on the levels that it
        tries. The cells near the borders show how far single runs scatter, and the curve includes
        this.

        The first records are searched with all borders equally likely. The others are searched
        with the probabilities that the first show. The names of arch and records decide which
        records are first, and which cells are checked. If a record has one border, the search
        finds it whatever it expects. Other knowledge of a record, such as other measures, must not
        choose its levels: half of the runs would then collapse at every level, which the
        likelihood of the verdicts takes for a larger beta.
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
        """Return the number of runs of an arch, and how exact it is.

        A search distinguishes n_level + 1 places of the border of a record; the checks are added.
        """
        search_runs = int(np.ceil(n_record * np.log2(n_level + 1)))
        checks = n_record if self.checks is None else self.checks
        return min(search_runs + checks, n_record * n_level), "about"


def search(
    grid: Grid, low: IntArray, high: IntArray, expected: FloatArray, left: IntArray
) -> Asking[None]:
    """Narrow the brackets of some records to neighbouring levels.

    `low` and `high` are the indices of the levels at their ends, (n_record,): -1 and n_level if
    these are not known. They are changed in place. `expected` has the probability of each border,
    (n_record, n_level + 1). `left` are the rows of the records to search.

    The level to try next is the most informative one for its cost: the entropy of its verdict over
    the expected cost. A level is not tried again if its run had no verdict. A record goes on as
    soon as its own run is made; it does not wait for others.
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
        # A run that collapsed before its record would do so at any level.
        left = left[verdicts != Verdict.COLLAPSED_BEFORE]


def expected_borders(levels: FloatArray, low: IntArray, high: IntArray) -> FloatArray:
    """Return the probability of each border, (n_level + 1,), if ln capacity is normal.

    `low` and `high` are the ends of the brackets found so far, (n_record,). Mean and standard
    deviation are those of the middles of these brackets. An end that is not known counts as one
    step beyond the levels.
    """
    logs = np.log(levels)
    step = np.diff(logs).mean() if logs.size > 1 else 0.5
    ends = np.concatenate([[logs[0] - step], logs, [logs[-1] + step]])
    found = 0.5 * (ends[low + 1] + ends[high + 1])
    ends[[0, -1]] = -np.inf, np.inf
    reach = max(found.std(ddof=1), LEAST_DEVIATION)
    mass = np.diff(scipy.special.ndtr((ends - found.mean()) / reach)) + LEAST_PRIOR
    return mass / mass.sum()


# Value of the key `design` of a study file: a block, or only the name of a design.
AnyDesign = Annotated[
    Stripes | Ida | Cloud,
    Field(discriminator="kind"),
    BeforeValidator(partial(check_block, key="kind")),
    BeforeValidator(lambda given: {"kind": given} if isinstance(given, str) else given),
]


def design_of(facts: Mapping[str, Any]) -> Design:
    """Return the design that a cube states in `facts`; facts of its arches are ignored."""
    keys = {key: value for key, value in facts.items() if key != "arches"}
    found: Design = TypeAdapter[Any](AnyDesign).validate_python(keys)
    return found
