"""Rounds of runs: what a design asks for next, given what the runs so far have shown.

A design is a generator for each arch. It yields the runs that it wants, is sent their verdicts and
returns its report. What it asks for follows from the verdicts alone, so the same
study asks for the same runs whatever the workers, and a study that was stopped goes on by asking
again.
"""

from collections.abc import Generator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archfrag.fragility.counts import Verdict

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
    """The strands of a design, in step: a round is all that they ask for at once.

    Attributes
    ----------
    wanted : ndarray of CASE
        Runs of the present round; empty when all strands are over.
    notes : dict
        By arch: what its strand returned.
    count : int
        Rounds answered so far.
    """

    def __init__(self, strands: dict[int, Strand]) -> None:
        self.notes: dict[int, dict[str, Any]] = {}
        self.count = 0
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
