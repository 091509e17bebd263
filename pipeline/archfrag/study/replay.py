"""All runs that the design of a study asks for, with their results."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.study.outcome import COLUMNS
from archfrag.study.plan import Plan
from archfrag.study.rounds import NO_CASES, Cases, Rounds
from archfrag.study.store import Store


@dataclass(frozen=True)
class Results:
    """Runs that a design asked for."""

    cases: Cases  # (n_run,): sorted by stage, arch, record and place
    factors: NDArray[np.float64]  # (n_run,)
    table: dict[str, NDArray]  # columns of the runs, each (n_run,); `model_time` (n_run, n_model)


def replay(plan: Plan, store: Store) -> tuple[Cases, Rounds]:
    """All runs that the design of a plan asks for, sorted, and its rounds at their end."""
    rounds, asked = plan.rounds(), []
    while len(rounds.wanted):
        keys = plan.keys(rounds.wanted, plan.factors(rounds.wanted))
        verdicts = store.verdicts(keys)
        missing = int((verdicts < 0).sum())
        if missing:
            raise InputError(
                f"{plan.parts}: {missing} of {len(keys)} runs of round {rounds.count + 1} are "
                f"missing or damaged; `archfrag run STUDY --resume` with the file of study "
                f"{plan.study!r} makes them and the cube"
            )
        asked.append(rounds.wanted)
        rounds.answer(verdicts)
    cases = np.concatenate([NO_CASES, *asked])
    return cases[
        np.lexsort([cases[name] for name in ("place", "record", "arch", "stage")])
    ], rounds


class Gathered:
    """All runs that the design of a plan asks for; their results are read where they are wanted.

    Memory: about 150 bytes a run, and the results of the runs that are read together.

    Attributes
    ----------
    cases : ndarray of CASE, (n_run,)
        Sorted by stage, arch, record and place.
    models : tuple of str
    notes : dict
        By number of the arch: what the design says of itself.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._store = plan, Store(plan.parts)
        self.cases, rounds = replay(plan, self._store)
        self._factors = plan.factors(self.cases)
        self._places = self._store.places(plan.keys(self.cases, self._factors))
        self.notes: dict[int, dict[str, Any]] = rounds.notes
        self.models: tuple[str, ...] = ()
        for rows in self._store.rows(self._places[:1]):
            self.models = rows.table.dtype["model_time"].names or ()

    def read(self, arch: int, stage: int) -> Results:
        """Results of the runs of an arch in a stage."""
        # They are sorted by stage, then by arch.
        count = len(self._plan.arches)
        kinds = self.cases["stage"] * np.int64(count) + self.cases["arch"]
        kind = stage * count + arch
        return self._read(slice(*np.searchsorted(kinds, [kind, kind + 1]).tolist()))

    def read_all(self) -> Results:
        """Results of all runs, about 250 bytes each; errors as of `read`."""
        return self._read(slice(0, len(self.cases)))

    def _read(self, own: slice) -> Results:
        count = own.stop - own.start
        table: dict[str, NDArray] = {c.name: np.empty(count, c.dtype) for c in COLUMNS}
        table["model_time"] = np.empty((count, len(self.models)))
        for path, rows, part, _ in self._store.rows(self._places[own]):
            if part.dtype["model_time"].names != self.models:
                raise InputError(f"{path}: is of other models than the parts before")
            for column in COLUMNS:
                table[column.name][rows] = part[column.name]
            for number, name in enumerate(self.models):
                table["model_time"][rows, number] = part["model_time"][name]
        return Results(self.cases[own], self._factors[own], table)
