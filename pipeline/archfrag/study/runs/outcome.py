"""What is kept of each run, by the table of variables that parts and cube have in common."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode, Count, Energy, Loss, Model, Peak, Status

if TYPE_CHECKING:
    from archfrag.arch import Arch
    from archfrag.mechanics.types import Results
    from archfrag.motions.motion import Motion

_CODES: dict[str, Any] = {"Verdict": Verdict, "Status": Status, "CollapseMode": CollapseMode}
_ENTRIES: dict[str, Any] = {"count": Count, "loss": Loss, "peak": Peak}


class Variable(NamedTuple):
    """A variable of the cube, as a row of ``variables.csv`` describes it."""

    name: str
    dimensions: str  # "run" stands for arch, record and level
    dtype: str  # S for text
    units: str = ""  # empty for codes and text
    fill: str = ""  # what stands where there is no such value
    missing: str = ""  # what stands in a cell that was not simulated
    flags: str = ""  # enumeration of the codes, or the meanings of 0, 1 and so on
    source: str = ""  # array of the kernels' results, with the entry there; or record's attribute
    long_name: str = ""
    comment: str = ""

    @property
    def meanings(self) -> dict[int, str]:
        """Meaning of each code."""
        if self.flags not in _CODES:
            return dict(enumerate(self.flags.split()))
        codes = {int(code): code.name.lower() for code in _CODES[self.flags]}
        return dict(sorted(({int(self.missing): "not_simulated"} | codes).items()))


with open(Path(__file__).with_name("variables.csv"), newline="", encoding="utf-8") as _file:
    VARIABLES = {row["name"]: Variable(**row) for row in csv.DictReader(_file)}
COLUMNS = tuple(each for each in VARIABLES.values() if each.dimensions == "run")


def columns_of(results: "Results") -> dict[str, NDArray]:
    """Columns of runs by name, each (n_run,), and `model_time` (n_run, n_model) [s]."""
    energy, largest = results.energy, results.energy[:, Energy.LARGEST_KINETIC]
    columns: dict[str, NDArray] = {
        # Verdicts are the first codes of status; what comes after are failures of the solver.
        "verdict": np.minimum(results.status, Verdict.SOLVER_FAILURE),
        "energy_error": np.divide(
            energy[:, Energy.BALANCE_ERROR_PEAK], largest, out=np.zeros(len(largest)),
            where=largest > 0.0,
        ),
        "model_time": results.model_time[:, list(Model)],
    }  # fmt: skip
    for column in COLUMNS:
        if column.source:
            name, _, entry = column.source.partition(".")
            values = getattr(results, name)
            columns[column.name] = values[:, _ENTRIES[name][entry]] if entry else values
    return columns


def tabulate_cases(
    method: Mapping[str, Any], arch: "Arch", motions: Sequence["Motion"], factors: Sequence[float]
) -> dict[str, NDArray]:
    """Runs of one arch by a study's method: `columns_of` and `wall_time` [s].

    Factors are on the verticals too.
    """
    from archfrag.simulate import results_of_runs

    options = {("method" if key == "name" else key): value for key, value in method.items()}
    results, wall_time = results_of_runs(arch, motions, factors, **options)
    return columns_of(results) | {"wall_time": wall_time}
