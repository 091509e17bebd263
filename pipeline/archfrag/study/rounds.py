"""Rounds of runs: what a design asks for next, given what the runs so far have shown.

A design is a generator for each arch. It yields the runs that it wants, is sent their verdicts and
returns its report. What it asks for follows from the verdicts alone, so the same
study asks for the same runs whatever the workers, and a study that was stopped goes on by asking
again.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from archfrag.errors import FitError
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import FloatArray
from archfrag.fragility.quoted import quoted_posterior
from archfrag.study.design import Scattered

if TYPE_CHECKING:
    from archfrag.study.design import Precision

FINE, COARSE = 0, 1  # stage: by the study's method, by the coarse one
# A run: `place` is the number of the study's level, 0 where a run has a level of its own.
CASE = np.dtype(
    [("stage", "i1"), ("arch", "i4"), ("record", "i4"), ("place", "i4"), ("level", "f8")]
)
Cases = NDArray[np.void]
Verdicts = NDArray[np.int8]
Strand = Generator[Cases, Verdicts, dict[str, Any]]
_MADE = [verdict for verdict in Verdict if verdict != Verdict.NOT_SIMULATED]
NO_CASES: Cases = np.empty(0, CASE)


def cases_of(
    arch: int, record: ArrayLike, place: ArrayLike, level: ArrayLike, stage: int = FINE
) -> Cases:
    """Runs of one arch, (n,) of `CASE`."""
    cases = np.empty(np.size(record), CASE)
    cases["stage"], cases["arch"] = stage, arch
    cases["record"], cases["place"], cases["level"] = record, place, level
    return cases


class Rounds:
    """The strands of a design, in step: `wanted` is what they ask for at once, at last none."""

    def __init__(self, strands: dict[int, Strand]) -> None:
        self.notes: dict[int, dict[str, Any]] = {}  # by arch: what its strand returned
        self.count = 0  # rounds answered
        self._asked: list[tuple[int, Strand, Cases]] = []
        for arch, strand in strands.items():
            self._ask(arch, strand, None)
        self._gather()

    def _ask(self, arch: int, strand: Strand, verdicts: Verdicts | None) -> None:
        try:
            cases = next(strand) if verdicts is None else strand.send(verdicts)
            while not len(cases):
                cases = strand.send(np.empty(0, np.int8))
            self._asked.append((arch, strand, cases))
        except StopIteration as over:
            self.notes[arch] = over.value

    def _gather(self) -> None:
        asked = [cases for _, _, cases in self._asked]
        self.wanted: Cases = np.concatenate(asked) if asked else NO_CASES

    def answer(self, verdicts: Verdicts) -> None:
        """Take the verdicts of all runs of the round, in the order of `wanted`."""
        if len(verdicts) != len(self.wanted) or not np.isin(verdicts, _MADE).all():
            raise ValueError("each run of a round must have been made")
        asked, self._asked = self._asked, []
        ends = np.cumsum([len(cases) for _, _, cases in asked])
        for (arch, strand, _), own in zip(asked, np.split(verdicts, ends[:-1])):
            self._ask(arch, strand, own)
        self.count += 1
        self._gather()


MOST_AT_ONCE = 2.0  # factor by which runs are added at most
MARGIN = 1.1  # on the runs that the present width suggests
# A design that looks after each round stops too soon where its runs happen to scatter little.
LEAST_RECORDS = 20
LOOKS_IN_A_ROW = 2
BETWEEN_LOOKS = 0.05  # of the runs so far are added at least, so that a second look is one


@dataclass(frozen=True)
class Known:
    """Curve so far."""

    log_median: float = np.nan  # posterior medians; nan if there is no curve yet
    beta: float = np.nan  # posterior medians; nan if there is no curve yet
    # The farther end of the interval of ln(median) is this far from it; inf if there is none.
    half_width: float = np.inf


def known_so_far(
    design: str,
    verdict: ArrayLike,
    level: ArrayLike,
    confidence: float = 0.9,
    groups: ArrayLike | None = None,
) -> Known:
    """Curve of the runs made, by the posterior from which a report quotes its band."""
    try:
        known = quoted_posterior(design, verdict, level, groups)[0]
    except FitError:
        return Known()
    middle = float(np.log(known.fragility.theta))
    low, high = np.log(known.theta_interval(confidence))
    return Known(middle, known.fragility.beta, float(max(middle - low, high - middle)))


class Stop:
    """Whether there are runs enough: the interval is narrow enough in two rounds in a row."""

    def __init__(self, wanted: "Precision") -> None:
        self.wanted = wanted
        self.met = 0
        self.note: dict[str, Any] = {}

    def look(self, half_width: float, done: int, least: int) -> bool:
        """Note the width after `done` records or runs, of which `least` are needed."""
        narrow = half_width <= self.wanted.theta and done >= least
        self.met = self.met + 1 if narrow else 0
        reached = self.met >= LOOKS_IN_A_ROW
        self.note = {"half_width": half_width, "reached": reached}
        return reached

    def end(self, why: str) -> None:
        """Note that there are to be no more runs, and why if not for their number."""
        if self.note["half_width"] <= self.wanted.theta:
            self.note["reached"] = True
        else:
            self.note["why"] = why or f"{self.wanted.runs} runs do not suffice"


def more_needed(width: float, wanted: float, done: int) -> int:
    """Runs or records to add to `done`, for a width that falls with the root of their number."""
    if not np.isfinite(width):
        return done
    needed = MARGIN * done * (width / wanted) ** 2
    needed = min(max(needed, (1.0 + BETWEEN_LOOKS) * done), MOST_AT_ONCE * done)
    return int(np.ceil(needed)) - done


BEYOND = 3.0  # times the highest, or below the lowest, of the study's levels that a run may go


def scattered(
    arch: int, records: NDArray[np.int64], levels: FloatArray, design: Scattered
) -> Strand:
    """A pilot over the range of the levels, then runs near the wanted probabilities.

    Levels of the pilot are a scrambled Sobol sequence in their logarithm. After it each round is
    placed by the curve estimated so far. Records are taken in their order, each once.
    """
    ends = np.log([levels[0], levels[-1]])
    most = design.runs if design.precision is None else design.precision.runs
    most = min(most, len(records))
    pilot = min(design.pilot, most)
    level = _pilot_levels(pilot, ends, [design.seed, arch])
    verdict = np.empty(0, np.int8)
    tried = np.empty(0)
    stop = None if design.precision is None else Stop(design.precision)
    while level.size:
        place = np.arange(tried.size, tried.size + level.size)
        found = yield cases_of(arch, records[place], np.zeros(place.size, int), level)
        tried, verdict = np.concatenate([tried, level]), np.concatenate([verdict, found])
        confidence = 0.9 if stop is None else stop.wanted.confidence
        known = known_so_far("scattered", verdict, tried, confidence)
        more = min(design.round, most - tried.size)
        if stop is not None:
            reached = stop.look(known.half_width, tried.size, 0)
            # One round, or two where many are needed.
            far = more_needed(known.half_width, stop.wanted.theta, tried.size) > design.round
            more = 0 if reached else min((1 + far) * design.round, most - tried.size)
            if not more and not reached:
                none_left = tried.size >= len(records)
                stop.end(f"there are no more than {len(records)} records" if none_left else "")
        level = _levels_at(design.targets, more, known, ends)
    note = {"runs": int(tried.size), "records": int(tried.size)}
    return note | ({} if stop is None else stop.note)


def _levels_at(targets: Sequence[float], count: int, known: Known, ends: FloatArray) -> FloatArray:
    """Levels where the curve has the wanted probabilities, (count,)."""
    centre, beta = known.log_median, known.beta
    if not np.isfinite(centre):
        centre, beta = ends.mean(), 0.25 * (ends[1] - ends[0])
    aims = ndtri(np.resize(targets, count)) * beta + centre
    # Last digits, which differ between machines, would make other runs of the same study.
    return np.exp(np.round(np.clip(aims, ends[0] - np.log(BEYOND), ends[1] + np.log(BEYOND)), 6))


def _pilot_levels(count: int, ends: FloatArray, seed: list[int]) -> FloatArray:
    """Levels that fill the range evenly in their logarithm, in random order, (count,)."""
    from scipy.stats import qmc

    points = qmc.Sobol(1, seed=np.random.default_rng(seed)).random_base2(
        int(np.ceil(np.log2(max(count, 2))))
    )
    rank = points[:count, 0].argsort().argsort()
    return np.exp(ends[0] + (rank + 0.5) / count * (ends[1] - ends[0]))


def cloud(arch: int, records: NDArray[np.int64], own_levels: FloatArray) -> Strand:
    """Every record once, at the level that it has by the factor of the design, in one round."""
    verdicts = yield cases_of(arch, records, np.zeros(len(records), int), own_levels)
    return {"runs": len(verdicts), "records": len(verdicts)}
