"""One driver for all solvers: steps, clocks and judges them alike.

As a script it is the process of one solver: requests in, outcomes out, a line of JSON each.
Solvers print, stop their process, or live in another interpreter; none of that reaches the caller.
"""

import importlib
import json
import os
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import numpy as np

if __name__ == "__main__":
    # The interpreter may be another's, in which archfrag is not installed; its own folder, put
    # first because this file is run as a script, would hide other modules.
    package = ModuleType("archbench")
    package.__path__ = [str(Path(__file__).resolve().parents[1])]
    sys.path[0] = str(Path(__file__).resolve().parents[2])
    sys.modules["archbench"] = package  # without the methods that it registers

from archbench.scene import Array, Scene

MOST_SPEED = 100.0  # nothing that falls for ten seconds is faster [m/s]
SAMPLING = 0.01  # interval at which centroids are looked at [s]


class Stepper(Protocol):
    """A solver ready to step; `unconverged` counts steps left so, None if it is not reported."""

    unconverged: int | None

    def step(self, acceleration: float) -> None:
        """Take a step with the ground acceleration held [m/s2]."""

    def centroids(self) -> Array:
        """Centroids of the voussoirs in the ground's frame, (n, 2) [m]; after each `SAMPLING`."""


@dataclass
class Outcome:
    """What a run gave, by measures that are the same for every solver.

    `collapsed`: a centroid has moved more than two thicknesses from its place. `cpu_seconds` are
    of stepping alone; `history` has `time` [s] and `centroids` (time, voussoir, xy) [m], as lists.
    """

    collapsed: bool
    peak_displacement: float
    simulated_seconds: float
    steps: int
    cpu_seconds: float
    unconverged: int | None
    history: dict[str, Any] | None = field(default=None, repr=False)


def drive(stepper: Stepper, scene: Scene, dt: float, history: bool = False) -> Outcome:
    """Run a built scene with steps of `dt` [s] to its end, or to its collapse.

    ArithmeticError if positions are not finite, or change faster than `MOST_SPEED`.
    """
    start = scene.bodies().centroid
    acceleration = scene.step_means(dt)
    stride = max(1, round(SAMPLING / dt))
    peak = 0.0
    cpu = 0.0
    done = 0
    times = [0.0]
    seen = [start + scene.initial_state()[0][:, :2]]
    while done < len(acceleration) and peak <= 2.0 * scene.thickness:
        chunk = acceleration[done : done + stride]
        before = time.process_time()
        for value in chunk.tolist():
            stepper.step(value)
        cpu += time.process_time() - before
        done += len(chunk)
        centroids = stepper.centroids()
        speed = float(np.hypot(*(centroids - seen[-1]).T).max()) / (len(chunk) * dt)
        if not speed <= MOST_SPEED:
            raise ArithmeticError(
                f"a centroid moves at {speed:.3g} m/s at {done * dt:g} s"
            )
        times.append(done * dt)
        seen.append(centroids)
        peak = max(peak, float(np.hypot(*(centroids - start).T).max()))
    kept = {"time": times, "centroids": np.array(seen).tolist()} if history else None
    collapsed = peak > 2.0 * scene.thickness
    return Outcome(collapsed, peak, done * dt, done, cpu, stepper.unconverged, kept)


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
