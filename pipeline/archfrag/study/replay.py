"""All runs that the design of a study asks for, with their results."""

from dataclasses import dataclass, replace
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
    """All runs that a design asked for.

    Attributes
    ----------
    cases : ndarray of CASE, (n_run,)
        Sorted by stage, arch, record and place.
    factors : ndarray, (n_run,)
    table : dict of ndarray
        Columns of the runs, each (n_run,); `model_time` (n_run, n_model).
    models : tuple of str
    notes : dict
        By number of the arch: what the design says of itself.
    """

    cases: Cases
    factors: NDArray[np.float64]
    table: dict[str, NDArray]
    models: tuple[str, ...]
    notes: dict[int, dict[str, Any]]

    def some(self, rows: NDArray[np.bool_]) -> "Results":
        """Some of the runs."""
        table = {name: values[rows] for name, values in self.table.items()}
        return replace(self, cases=self.cases[rows], factors=self.factors[rows], table=table)


def replay(plan: Plan, store: Store) -> tuple[Cases, Rounds]:
    """All runs that the design of a plan asks for, sorted, and its rounds at their end.

    Raises
    ------
    InputError
        If results are missing.
    """
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


def gather(plan: Plan) -> Results:
    """Results of all runs that the design of a plan asks for.

    Raises
    ------
    InputError
        If results are missing or were made by different ladders of models.
    """
    store = Store(plan.parts)
    cases, rounds = replay(plan, store)
    factors = plan.factors(cases)
    places = store.places(plan.keys(cases, factors))
    table: dict[str, NDArray] = {c.name: np.empty(len(cases), c.dtype) for c in COLUMNS}
    models: tuple[str, ...] | None = None
    for path, rows, part, _ in store.rows(places):
        names: tuple[str, ...] = part.dtype["model_time"].names or ()
        if models is None:
            models = names
            table["model_time"] = np.empty((len(cases), len(names)))
        if names != models:
            raise InputError(f"{path}: is of other models than the parts before")
        for column in COLUMNS:
            table[column.name][rows] = part[column.name]
        for number, name in enumerate(names):
            table["model_time"][rows, number] = part["model_time"][name]
    return Results(cases, factors, table, models or (), rounds.notes)
