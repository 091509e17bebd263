"""Methods that archfrag's own are compared with, registered when `archbench` is imported.

`methods.json` has their names, meanings, citations and parameters (as of `Parameter`, in order).
"""

import importlib.util
import json
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path

from archfrag.physics.methods.registry import (
    FOLLOW,
    MethodInfo,
    Parameter,
    known_methods,
    register,
)

SHARED = ("dt", "rtol", "follow")  # parameters that are arguments of `simulate`


def is_available(info: MethodInfo) -> bool:
    """Return whether the package that a method needs, if any, is installed."""
    return info.needs is None or importlib.util.find_spec(info.needs) is not None


def variant(method: str, **own: float) -> MethodInfo:
    """Return a baseline with other values of parameters of its own."""
    info = known_methods()[method]
    return info._replace(load=lambda: partial(info.load(), **own))


def _from(name: str, parameters: tuple[Parameter, ...]) -> Callable[[], Callable]:
    own = {each.name: each.default for each in parameters if each.name not in SHARED}
    return lambda: partial(import_module(f"archbench.baselines.{name}").run, **own)


_ROWS = json.loads(Path(__file__).with_name("methods.json").read_text(encoding="utf-8"))
BASELINES = []
for _row in _ROWS:
    _row["parameters"] = tuple(
        FOLLOW if each == "follow" else Parameter(*each) for each in _row["parameters"]
    )
    load = _from(_row["name"], _row["parameters"])
    BASELINES.append(MethodInfo(load=load, **_row))
register(*BASELINES)
