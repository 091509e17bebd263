"""Methods that archfrag's own are compared with, registered when `archbench` is imported.

`methods.json` has their names, meanings, citations and parameters (as of `Parameter`, in order).
"""

import importlib.util
import json
from functools import partial
from pathlib import Path
from typing import Any

from archfrag.physics.methods.registry import (
    FOLLOW,
    MethodInfo,
    Parameter,
    known_methods,
    register,
)

SHARED = ("dt", "rtol", "follow")  # parameters that are arguments of `simulate`


class Baseline(MethodInfo):
    """A method with parameters of its own, which its functions take by keyword."""

    def load(self, function: str = "run") -> Any:
        """Import the module, and return a function of it with the parameters' defaults."""
        own = {p.name: p.default for p in self.parameters if p.name not in SHARED}
        found = super().load(function)
        return found and partial(found, **own)


def is_available(info: MethodInfo) -> bool:
    """Return whether the package that a method needs, if any, is installed."""
    return info.needs is None or importlib.util.find_spec(info.needs) is not None


def variant(method: str, **own: float) -> MethodInfo:
    """Return a baseline with other values of parameters of its own."""
    info = known_methods()[method]
    changed = (p._replace(default=own.get(p.name, p.default)) for p in info.parameters)
    return info._replace(parameters=tuple(changed))


_ROWS = json.loads(Path(__file__).with_name("methods.json").read_text(encoding="utf-8"))
BASELINES = []
for _row in _ROWS:
    _row["parameters"] = tuple(
        FOLLOW if each == "follow" else Parameter(*each) for each in _row["parameters"]
    )
    BASELINES.append(Baseline(module=f"archbench.baselines.{_row['name']}", **_row))
register(*BASELINES)
