"""A design asks for the runs of an arch, and estimates the curve from their verdicts.

Here are the two that ask for all runs at once; `ida` has a module of its own.

It asks by a generator for each arch. The generator yields new requests, is sent the verdicts of
some runs that it requested, in whatever order they come, and returns facts for the report. What it
asks for follows from the verdicts alone: the same study asks for the same runs whatever the
workers, and a study that was stopped goes on by asking again.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from archfrag.fragility.counts import Brackets, Verdict
from archfrag.fragility.curve import FloatArray, Fragility, IntArray
from archfrag.fragility.fit import fit_stripes
from archfrag.fragility.posterior import fit_posterior
from archfrag.fragility.quoted import capacity_posterior, quoted_band, quoted_runs
from archfrag.study.keys import Section

if TYPE_CHECKING:
    from archfrag.fragility.posterior import Posterior
    from archfrag.fragility.quoted import Answer

# A run: `place` is the number of the study's level, 0 where a run has a level of its own.
CASE = np.dtype([("arch", "i4"), ("record", "i4"), ("place", "i4"), ("level", "f8")])
Cases = NDArray[np.void]
Verdicts = NDArray[np.int8]
_T = TypeVar("_T")
Asking = Generator[Cases, tuple[Cases, Verdicts], _T]
Requests = Asking[dict[str, Any]]


@dataclass
class Grid:
    """Records and levels of one arch's part of a study, and verdicts of the runs made."""

    arch: int
    records: IntArray  # (n_record,): their numbers, which increase
    levels: FloatArray  # (n_level,): [SI]
    unscaled: FloatArray  # (n_record,): factors that bring the study's measure to 1
    power: float  # a level grows with the factor to the power 1 / `power`

    def __post_init__(self) -> None:
        shape = self.records.size, self.levels.size
        self.seen = np.full(shape, int(Verdict.NOT_SIMULATED), np.int8)

    def run(
        self, rows: ArrayLike, places: ArrayLike, level: FloatArray | None = None
    ) -> Asking[Verdicts]:
        """Request runs of some rows, wait for all of them and return their verdicts."""
        row, place = np.asarray(rows, dtype=np.int64), np.asarray(places, dtype=np.int64)
        cases, waiting = self.cases(row, place, level), row.size
        while waiting:
            _, _, verdicts = yield from self.some(cases)
            cases, waiting = cases[:0], waiting - verdicts.size
        return self.seen[row, place]

    def some(self, cases: Cases) -> Asking[tuple[IntArray, IntArray, Verdicts]]:
        """Request runs, and return rows, places and verdicts of the first that are made."""
        made, verdicts = yield cases
        row, place = np.searchsorted(self.records, made["record"]), made["place"]
        self.seen[row, place] = verdicts
        return row, place, verdicts

    def cases(self, rows: ArrayLike, places: ArrayLike, level: FloatArray | None = None) -> Cases:
        """Return the runs of some rows at some of the study's levels, or each at its own, (n,) of
        `CASE`.
        """
        row = np.asarray(rows, dtype=np.int64)
        cases = np.empty(row.size, CASE)
        cases["arch"], cases["record"], cases["place"] = self.arch, self.records[row], places
        cases["level"] = self.levels[cases["place"]] if level is None else level
        return cases


class Design(Section, ABC):
    """Which runs are made, and how the curve follows from them."""

    kind: str
    on_levels: ClassVar[bool] = True  # whether runs are made at the study's levels
    adaptive: ClassVar[bool] = False  # whether runs requested depend on verdicts of others
    text: ClassVar[str] = ""  # for the report

    @abstractmethod
    def requests(self, grid: Grid) -> Requests:
        """Ask for the runs of one arch."""

    @abstractmethod
    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch, and whether it is exact, about or at most."""

    def estimate(self, found: Brackets, im: ArrayLike, **options: Any) -> "Answer":
        """Return the curve and band; options and errors are those of `quoted_band`."""
        return quoted_band(found, im, **options)

    def posterior(self, found: Brackets) -> "tuple[Posterior, float]":
        """Return the posterior of the curve, and the number of records or runs."""
        return capacity_posterior(found)

    def likelihood(self, found: Brackets) -> Fragility:
        """Return curve by maximum likelihood, from the fractions that collapsed at each level."""
        decided = found.collapsed | found.survived
        level, place = np.unique(found.levels[decided], return_inverse=True)
        collapsed = np.bincount(place, found.collapsed[decided], level.size)
        return fit_stripes(level, collapsed, np.bincount(place, minlength=level.size))

    def cautions(self, facts: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Return the messages on what `requests` returned, by arch."""
        return []


class Stripes(Design):
    """Every record at every level."""

    kind: Literal["stripes"] = "stripes"
    text = "every record at every level"

    def requests(self, grid: Grid) -> Requests:
        """Ask for all runs at once."""
        n_record, n_level = grid.records.size, grid.levels.size
        verdicts = yield from grid.run(*np.divmod(np.arange(n_record * n_level), n_level))
        return {"runs": len(verdicts)}

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch, and whether it is exact, about or at most."""
        return n_record * n_level, "exactly"


class Cloud(Design):
    """Every record once, as it is or by one factor."""

    kind: Literal["cloud"]
    factor: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    """On every record."""
    on_levels = False
    text = "every record once"

    def requests(self, grid: Grid) -> Requests:
        """Ask for all runs at once."""
        level = (self.factor / grid.unscaled) ** (1.0 / grid.power)
        verdicts = yield from grid.run(np.arange(level.size), np.zeros(level.size), level)
        return {"runs": len(verdicts), "records": len(verdicts)}

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Return the number of runs of an arch, and whether it is exact, about or at most."""
        return n_record, "exactly"

    def estimate(self, found: Brackets, im: ArrayLike, **options: Any) -> "Answer":
        """Return the curve and band from single runs, each with a motion of its own."""
        return quoted_runs(*_single(found), im, confidence=options["confidence"])

    def posterior(self, found: Brackets) -> "tuple[Posterior, float]":
        """Return the posterior of the curve of single runs, and their number."""
        level, collapsed = _single(found)
        return fit_posterior(level, collapsed, 1), float(level.size)


def _single(found: Brackets) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the levels of the decided runs, (n_run,), and whether they collapsed."""
    decided = found.collapsed | found.survived
    return found.levels[decided], found.collapsed[decided]


def ask(
    requests: Mapping[int, Requests], decide: Callable[[Cases], Verdicts]
) -> tuple[Cases, dict[int, dict[str, Any]]]:
    """Drive requests with a `decide` that returns the verdicts of all runs that it is given, in
    order.
    """
    return drive(requests, lambda cases: (cases, decide(cases)))


def drive(
    requests: Mapping[int, Requests], answer: Callable[[Cases], tuple[Cases, Verdicts]]
) -> tuple[Cases, dict[int, dict[str, Any]]]:
    """Ask the designs of all arches, by `Design.requests`, until none requests a run.

    `answer` takes new requests, which may be none, and returns some runs of all those requested
    so far with their verdicts. Returned are all runs requested, and what each design returned, by
    arch.
    """
    requested, facts = [], {}
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
        cases, verdicts = cases[order], verdicts[order]
        arches, first = np.unique(cases["arch"], return_index=True)
        pairs = zip(np.split(cases, first[1:]), np.split(verdicts, first[1:]))
        answers = dict(zip(arches.tolist(), pairs))


def order_of(cases: Cases) -> IntArray:
    """Return the order of runs by arch, record and place."""
    return np.lexsort([cases[name] for name in ("place", "record", "arch")])
