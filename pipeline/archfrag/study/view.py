"""A cube in memory as plain arrays: what the report reads, without the time that xarray takes.

It has those of xarray's names that reading needs, so that a Dataset serves in its place.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Variable:
    """Values with the names of their dimensions."""

    dims: tuple[str, ...]
    values: NDArray
    attrs: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ndim(self) -> int:
        """Number of dimensions."""
        return self.values.ndim

    def transpose(self, *dims: str | EllipsisType) -> "Variable":
        """The same with its dimensions in another order; ``...`` stands for the others."""
        named = [name for name in dims if isinstance(name, str)]
        others = [name for name in self.dims if name not in named]
        order = [
            o for name in dims for o in (others if isinstance(name, EllipsisType) else [name])
        ]
        values = self.values.transpose([self.dims.index(name) for name in order])
        return Variable(tuple(order), values, self.attrs)

    def isel(self, **places: int) -> "Variable":
        """One place along some dimensions, which are gone then."""
        where = tuple(places.get(name, slice(None)) for name in self.dims)
        left = tuple(name for name in self.dims if name not in places)
        return Variable(left, np.asarray(self.values[where]), self.attrs)

    def max(self) -> float:
        """Largest value that is a number."""
        return float(np.nanmax(self.values))

    def __float__(self) -> float:
        return float(self.values)


@dataclass(frozen=True)
class View:
    """Variables by name."""

    data_vars: Mapping[str, Variable]
    attrs: Mapping[str, Any]

    def __getitem__(self, name: str) -> Variable:
        return self.data_vars[name]

    def __contains__(self, name: str) -> bool:
        return name in self.data_vars

    def get(self, name: str) -> Variable | None:
        """A variable; None if there is none of the name."""
        return self.data_vars.get(name)

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of the dimensions."""
        return {
            name: size
            for each in self.data_vars.values()
            for name, size in zip(each.dims, each.values.shape)
        }

    def isel(self, **places: int) -> "View":
        """One place along some dimensions of all variables that have them."""
        found = {
            name: each.isel(**{d: i for d, i in places.items() if d in each.dims})
            for name, each in self.data_vars.items()
        }
        return View(found, self.attrs)
