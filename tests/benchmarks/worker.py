"""One peer in a process of its own: requests in, outcomes out, a line of JSON each.

Peers print, stop their process, or live in another interpreter; none of that reaches the caller.
"""

import importlib
import json
import os
import sys
import time
from typing import Any

from peers.drive import drive
from peers.scene import Scene


def answer(peer: str, request: dict[str, Any]) -> dict[str, Any]:
    """Run one request: scene, dt, settings, and what `drive` takes."""
    adapter = importlib.import_module(f"peers.{peer}_adapter")
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
        importlib.import_module(f"peers.{peer}_adapter")
    except Exception as error:
        channel.write(json.dumps({"missing": f"{type(error).__name__}: {error}"}) + "\n")
        return
    channel.write(json.dumps({"ready": peer}) + "\n")
    for line in sys.stdin:
        try:
            reply = answer(peer, json.loads(line))
        except Exception as error:
            reply = {"error": f"{type(error).__name__}: {error}"}
        channel.write(json.dumps(reply) + "\n")


if __name__ == "__main__":
    main()
