"""One solver in a process of its own: requests in, outcomes out, a line of JSON each.

Solvers print, stop their process, or live in another interpreter; none of that reaches the caller.
"""

import importlib
import json
import os
import sys
from dataclasses import asdict
from pathlib import Path

# The interpreter may be another's, in which archfrag is not installed; its own folder, put first
# because this file is run as a script, would hide other modules.
sys.path[0] = str(Path(__file__).resolve().parents[2])

from archbench.adapters.drive import drive  # noqa: E402
from archbench.scene import Scene  # noqa: E402


def main() -> None:
    """Serve the adapter named on the command line until the input ends."""
    channel = os.fdopen(os.dup(1), "w", buffering=1)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    try:
        adapter = importlib.import_module(sys.argv[1])
        getattr(adapter, "prepare", int)()
    except Exception as error:
        channel.write(json.dumps({"error": f"{type(error).__name__}: {error}"}) + "\n")
        return
    channel.write(json.dumps({"version": adapter.VERSION}) + "\n")
    for line in sys.stdin:
        try:
            request = json.loads(line)
            scene = Scene(**request["scene"])
            dt = request["dt"]
            reply = asdict(
                drive(adapter.build(scene, dt), scene, dt, request["history"])
            )
        except Exception as error:
            reply = {"error": f"{type(error).__name__}: {error}"}
        channel.write(json.dumps(reply) + "\n")


if __name__ == "__main__":
    main()
