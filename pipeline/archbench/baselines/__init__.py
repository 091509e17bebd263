"""Methods that archfrag's own are compared with, registered when `archbench` is imported.

`methods.json` has their names, meanings, citations and parameters (as of `Parameter`, in order).
"""

import json
from pathlib import Path

from archfrag.physics.methods.registry import FOLLOW, MethodInfo, Parameter, register

_ROWS = json.loads(Path(__file__).with_name("methods.json").read_text(encoding="utf-8"))
BASELINES = []
for _row in _ROWS:
    _listed = _row.pop("parameters")
    _parameters = tuple(
        FOLLOW if each == "follow" else Parameter(*each) for each in _listed
    )
    BASELINES.append(
        MethodInfo(
            parameters=_parameters, module=f"archbench.baselines.{_row['name']}", **_row
        )
    )
register(*BASELINES)
