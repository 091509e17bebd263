"""One peer in a process of its own: requests in, outcomes out, a line of JSON each.

Peers print, stop their process, or live in another interpreter; none of that reaches the caller.
"""

import importlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

# The interpreter may be another's, in which archfrag is not installed; its own folder, put first
# because this file is run as a script, would hide other modules.
sys.path[0] = str(Path(__file__).resolve().parents[3])

from archfrag.evidence.peers.drive import drive  # noqa: E402
from archfrag.evidence.scene import Scene  # noqa: E402


def answer(peer: str, request: dict[str, Any]) -> dict[str, Any]:
    """Run one request: scene, dt, settings, and what `drive` takes."""
    adapter = importlib.import_module(f"archfrag.evidence.peers.{peer}_adapter")
    scene = Scene(**request["scene"])
    settings = {**adapter.SETTINGS, **request["settings"]}
    options = request["options"]
    if hasattr(adapter, "run"):
        return adapter.run(scene, request["dt"], settings, **options).to_dict()
    began = time.perf_counter()
    stepper = adapter.build(scene, request["dt"], settings)
    setup = time.perf_counter() - began
    outcome = drive(peer, stepper, scene, request["dt"], settings, setup, **options)
    return outcome.to_dict()


def main() -> None:
    """Serve the peer named on the command line until the input ends."""
    peer = sys.argv[1]
    channel = os.fdopen(os.dup(1), "w", buffering=1)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    try:
        adapter = importlib.import_module(f"archfrag.evidence.peers.{peer}_adapter")
    except Exception as error:
        channel.write(json.dumps({"missing": f"{type(error).__name__}: {error}"}) + "\n")
        return
    channel.write(json.dumps({"ready": peer, "version": adapter.VERSION}) + "\n")
    for line in sys.stdin:
        try:
            reply = answer(peer, json.loads(line))
        except Exception as error:
            reply = {"error": f"{type(error).__name__}: {error}"}
        channel.write(json.dumps(reply) + "\n")


if __name__ == "__main__":
    main()
