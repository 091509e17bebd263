"""Settings as columns, and the ladder of settings of every method."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from archbench.baselines import SHARED, is_available, variant
from archfrag.physics.methods.registry import known_methods
from archfrag.simulation.arguments import default_of

OTHERS = "other solvers"
COLUMNS = ("method", "parameter", "value", "settings")


@dataclass(frozen=True)
class Setting:
    """A method, or another solver, with the one parameter by which it is refined.

    `parameter` is "dt" [s], "rtol", or one of the method's own; `settings` are those of the
    method's own parameters that differ from their defaults besides.
    """

    method: str
    parameter: str
    value: float
    settings: Mapping[str, float] = field(default_factory=dict, hash=False)

    @property
    def ours(self) -> bool:
        """Whether it is a method of archfrag."""
        return self.method in known_methods()

    @property
    def _refined(self) -> dict[str, float]:
        return {self.parameter: self.value}

    @property
    def own(self) -> dict[str, float]:
        """Values of the method's own parameters that differ from their defaults."""
        return {**self.settings, **({} if self.parameter in SHARED else self._refined)}

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments of `archfrag.simulate`."""
        method = variant(self.method, **self.own) if self.own else self.method
        shared = self._refined if self.parameter in SHARED else {}
        return {"method": method, **shared}

    @property
    def columns(self) -> dict[str, Any]:
        """The same as cells of a table, by `COLUMNS`."""
        own = json.dumps(dict(self.settings), sort_keys=True) if self.settings else ""
        return dict(
            zip(COLUMNS, (self.method, self.parameter, self.value, own), strict=True)
        )

    def finer(self, factor: float) -> Self:
        """The same with its parameter multiplied."""
        return replace(self, value=factor * self.value)


def available_methods() -> tuple[str, ...]:
    """Names of the methods that can run here, in the registry's order."""
    return tuple(name for name, info in known_methods().items() if is_available(info))


def ladders(column: str, solvers: Iterable[str] = ()) -> dict[str, list[Setting]]:
    """Settings of each method that can run here, and of other solvers, from coarse to fine.

    `column` is of `settings.json`.
    """
    table = json.loads(
        Path(__file__).with_name("settings.json").read_text(encoding="utf-8")
    )
    rows = {name: row for name, row in table.items() if name in available_methods()}
    rows |= {name: table.get(name, table[OTHERS]) for name in solvers}
    return {
        name: [Setting(name, row["parameter"], value) for value in row[column]]
        for name, row in rows.items()
        if column in row
    }


def default_setting(method: str) -> Setting:
    """A method of ours as it is without any setting."""
    info = known_methods()[method]
    parameter = "rtol" if any(each.name == "rtol" for each in info.parameters) else "dt"
    return Setting(method, parameter, default_of(info, parameter))
