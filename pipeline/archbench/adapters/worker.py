"""One solver in a process of its own: requests in, outcomes out, a line of JSON each.

Solvers print, stop their process, or live in another interpreter; none of that reaches the caller.
"""

import importlib
import json
import os
import sys
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import Any

# The interpreter may be another's, in which archfrag is not installed; its own folder, put first
# because this file is run as a script, would hide other modules.
sys.path[0] = str(Path(__file__).resolve().parents[2])

from archbench.adapters.drive import drive  # noqa: E402
from archbench.scene import Scene  # noqa: E402


def answer(adapter: ModuleType, request: dict[str, Any]) -> dict[str, Any]:
    """Run one request: scene, dt, settings, and what `drive` takes."""
    scene, dt = Scene(**request["scene"]), request["dt"]
    unknown = set(request["settings"]) - set(adapter.SETTINGS)
    if unknown:
        raise ValueError(f"no setting {sorted(unknown)}; there are {sorted(adapter.SETTINGS)}")
    settings = {**adapter.SETTINGS, **request["settings"]}
    if hasattr(adapter, "run"):
        return asdict(adapter.run(scene, dt, settings, **request["options"]))
    return asdict(drive(adapter.build(scene, dt, settings), scene, dt, **request["options"]))


def main() -> None:
    """Serve the solver named on the command line until the input ends."""
    solver = sys.argv[1]
    channel = os.fdopen(os.dup(1), "w", buffering=1)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    try:
        adapter = importlib.import_module(f"archbench.adapters.{solver}_adapter")
        getattr(adapter, "prepare", int)()
    except Exception as error:
        channel.write(json.dumps({"missing": f"{type(error).__name__}: {error}"}) + "\n")
        return
    channel.write(json.dumps({"ready": solver, "version": adapter.VERSION}) + "\n")
    for line in sys.stdin:
        try:
            reply = answer(adapter, json.loads(line))
        except Exception as error:
            reply = {"error": f"{type(error).__name__}: {error}"}
        channel.write(json.dumps(reply) + "\n")


if __name__ == "__main__":
    main()
