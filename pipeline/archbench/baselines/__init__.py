"""Methods that archfrag's own are compared with, registered when `archbench` is imported.

`methods.json` has their names, meanings, citations and parameters (as of `Parameter`, in order).
"""

import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from archfrag.physics.methods.registry import FOLLOW, MethodInfo, Parameter, register


def _from(module: str) -> Callable[[], Callable]:
    return lambda: import_module(f"archbench.baselines.{module}").run


_ROWS = json.loads(Path(__file__).with_name("methods.json").read_text(encoding="utf-8"))
BASELINES = []
for _row in _ROWS:
    _listed = _row.pop("parameters")
    _parameters = tuple(
        FOLLOW if each == "follow" else Parameter(*each) for each in _listed
    )
    BASELINES.append(
        MethodInfo(parameters=_parameters, load=_from(_row["name"]), **_row)
    )
register(*BASELINES)
